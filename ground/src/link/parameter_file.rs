//! Parameters in a file, in the plain form that Mission Planner and MAVProxy read and write: `NAME,VALUE` or `NAME VALUE` per
//! line, comments behind `#`. QGroundControl's five columns (vehicle, component, name, value, type) are read as well.

use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::fs;
use std::io;
use std::path::{Path, PathBuf};

use adit_protocol::mavlink::{NAME_BYTES, Value};

use super::parameter_fetch::Parameter;
use super::parameters::Shown;
use crate::files;

/// Names and values, in the file's order.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct ParameterFile {
    /// Each name once.
    pub entries: Vec<(String, f64)>,
}

/// What is wrong with a line.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum ParameterFileProblem {
    /// It has too few or too many columns.
    #[error("line {line}: found {found} columns; expected NAME,VALUE or NAME VALUE")]
    Columns {
        /// The line, from 1.
        line: usize,
        /// How many it has.
        found: usize,
    },
    /// It names nothing.
    #[error("line {line}: {name:?} is no name of a parameter; expected 1 to 16 letters, digits and underscores")]
    Name {
        /// The line, from 1.
        line: usize,
        /// What is there.
        name: String,
    },
    /// The value is none.
    #[error("line {line}: {name}: {value:?} is not a number")]
    Value {
        /// The line, from 1.
        line: usize,
        /// Whose value it is.
        name: String,
        /// What is there.
        value: String,
    },
    /// A name is there twice.
    #[error("line {line}: {name} is there already, in line {first}")]
    Twice {
        /// The line, from 1.
        line: usize,
        /// The name.
        name: String,
        /// The line where it was first.
        first: usize,
    },
}

/// Why a file of parameters cannot be used.
#[derive(Debug, thiserror::Error)]
pub enum ParameterFileError {
    /// It cannot be read or written.
    #[error("{}: cannot be {doing}", path.display())]
    Io {
        /// The file.
        path: PathBuf,
        /// What was tried.
        doing: &'static str,
        /// What the system said.
        source: io::Error,
    },
    /// Its content is wrong; all problems.
    #[error("{}:\n{}", path.display(), problems.iter().map(ToString::to_string).collect::<Vec<_>>().join("\n"))]
    Content {
        /// The file.
        path: PathBuf,
        /// What is wrong.
        problems: Vec<ParameterFileProblem>,
    },
}

impl ParameterFile {
    /// Reads a file.
    ///
    /// # Errors
    /// [`ParameterFileError`] with all that is wrong.
    pub fn read(path: &Path) -> Result<Self, ParameterFileError> {
        let failed = |source| ParameterFileError::Io { path: path.to_owned(), doing: "read", source };
        let text = fs::read_to_string(path).map_err(failed)?;
        Self::parse(&text).map_err(|problems| ParameterFileError::Content { path: path.to_owned(), problems })
    }

    /// Reads a text.
    ///
    /// # Errors
    /// All that is wrong.
    pub fn parse(text: &str) -> Result<Self, Vec<ParameterFileProblem>> {
        let mut entries: Vec<(String, f64)> = Vec::new();
        let mut lines = BTreeMap::new();
        let mut problems = Vec::new();
        for (line, content) in (1..).zip(text.lines()) {
            let content = content.split('#').next().unwrap_or_default().trim();
            if content.is_empty() {
                continue;
            }
            match entry(line, content) {
                Ok((name, value)) => {
                    if let Some(first) = lines.get(&name).copied() {
                        problems.push(ParameterFileProblem::Twice { line, name, first });
                        continue;
                    }
                    lines.insert(name.clone(), line);
                    entries.push((name, value));
                }
                Err(problem) => problems.push(problem),
            }
        }
        if problems.is_empty() { Ok(Self { entries }) } else { Err(problems) }
    }

    /// Writes parameters to a file, whole or not at all; `about` becomes its first line.
    ///
    /// # Errors
    /// [`ParameterFileError::Io`].
    pub fn write(path: &Path, about: &str, parameters: &[Parameter]) -> Result<(), ParameterFileError> {
        let text = Self::format(about, parameters);
        files::write_whole(path, text.as_bytes()).map_err(|source| ParameterFileError::Io {
            path: path.to_owned(),
            doing: "written",
            source,
        })
    }

    /// The text of a file. Values have as many digits as it takes to read the same value again.
    pub fn format(about: &str, parameters: &[Parameter]) -> String {
        let mut text = format!("# {about}\n");
        for Parameter { name, value, .. } in parameters {
            // Writing to a string does not fail.
            let _ = writeln!(text, "{name},{}", Shown(*value));
        }
        text
    }
}

/// A value of the same kind as the one that is there; `None` if it must be a whole number and is none.
pub fn value_like(value: f64, there: Value) -> Option<Value> {
    match there {
        Value::Real(_) => Some(Value::Real(value as f32)),
        Value::Whole(_) => {
            let whole = value as i32;
            (f64::from(whole) == value).then_some(Value::Whole(whole))
        }
    }
}

fn entry(line: usize, content: &str) -> Result<(String, f64), ParameterFileProblem> {
    let is_separator = |letter: char| letter == ',' || letter.is_whitespace();
    let columns: Vec<&str> = content.split(is_separator).filter(|column| !column.is_empty()).collect();
    let ([name, value] | [_, _, name, value, _]) = columns[..] else {
        return Err(ParameterFileProblem::Columns { line, found: columns.len() });
    };
    let is_name = name.len() <= NAME_BYTES && name.bytes().all(|byte| byte.is_ascii_alphanumeric() || byte == b'_');
    if !is_name {
        return Err(ParameterFileProblem::Name { line, name: name.to_owned() });
    }
    match value.parse::<f64>() {
        Ok(number) if number.is_finite() => Ok((name.to_owned(), number)),
        _ => Err(ParameterFileProblem::Value { line, name: name.to_owned(), value: value.to_owned() }),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_forms_of_all_three_ground_stations_are_read() {
        let expected = vec![("SPD_MARGIN".to_owned(), 0.8), ("RIG_IMAGES".to_owned(), 10.0)];
        for text in [
            "# Adit\nSPD_MARGIN,0.8\nRIG_IMAGES,10\n",
            "SPD_MARGIN       0.800000 # share\r\n\r\nRIG_IMAGES\t10.000000\r\n",
            "1\t191\tSPD_MARGIN\t0.8\t9\n1\t191\tRIG_IMAGES\t10\t6\n",
        ] {
            assert_eq!(ParameterFile::parse(text).unwrap().entries, expected, "{text}");
        }
    }

    #[test]
    fn all_that_is_wrong_is_told_by_its_line() {
        let problems = ParameterFile::parse("A,1\nB\nC,x\nA,2\nWAY_TOO_LONG_A_NAME,1\nD,inf\n").unwrap_err();
        let lines: Vec<_> = problems.iter().map(ToString::to_string).collect();
        insta::assert_snapshot!(lines.join("\n"), @r#"
        line 2: found 1 columns; expected NAME,VALUE or NAME VALUE
        line 3: C: "x" is not a number
        line 4: A is there already, in line 1
        line 5: "WAY_TOO_LONG_A_NAME" is no name of a parameter; expected 1 to 16 letters, digits and underscores
        line 6: D: "inf" is not a number
        "#);
    }

    #[test]
    fn what_is_written_is_read_to_the_last_bit() {
        let values = [0.1_f32, 1.0 / 3.0, 1e-9, -123_456.7, f32::MAX];
        let parameter =
            |(index, value): (u16, f32)| Parameter { name: format!("P{index}"), value: Value::Real(value), index };
        let list: Vec<_> = (0..).zip(values).map(parameter).collect();
        let read = ParameterFile::parse(&ParameterFile::format("test", &list)).unwrap();
        let back: Vec<_> = read.entries.iter().map(|(_, value)| *value as f32).collect();
        assert_eq!(back, values);
    }

    #[test]
    fn a_value_takes_the_kind_of_the_one_that_is_there() {
        assert_eq!(value_like(3.0, Value::Whole(1)), Some(Value::Whole(3)));
        assert_eq!(value_like(3.5, Value::Whole(1)), None);
        assert_eq!(value_like(3.0, Value::Real(1.0)), Some(Value::Real(3.0)));
    }
}
