//! The BAL text format: a line `cameras points observations`, a line `camera point x y` per observation, then nine numbers per
//! camera (rotation vector, translation, f, k1, k2) and three per point, one a line.

use std::fmt::Write as _;
use std::path::Path;
use std::str::SplitAsciiWhitespace;

use nalgebra::{Point3, UnitQuaternion, Vector3};

use super::{BalCamera, BalProblem};
use crate::adjust::tracks::{Observation, Tracks};
use crate::files::write_whole;

/// A file is not a BAL problem.
#[derive(Debug, thiserror::Error)]
pub enum BalError {
    /// The file cannot be read or written.
    #[error("{}: {source}", path.display())]
    Io {
        /// Which.
        path: std::path::PathBuf,
        /// Why.
        source: std::io::Error,
    },
    /// The file ends early.
    #[error("the file ends in line {line}: expected {expected}")]
    Truncated {
        /// The last line.
        line: usize,
        /// What should have come.
        expected: Expected,
    },
    /// Something is not a number, or not one that can stand there.
    #[error("line {line}: found \"{found}\", expected {expected}")]
    Unexpected {
        /// Counted from 1.
        line: usize,
        /// What stands there.
        found: Box<str>,
        /// What should.
        expected: Expected,
    },
}

/// What a BAL file should say at a place.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Expected {
    /// One of the three counts of the first line.
    Count(&'static str),
    /// An index below the given count.
    Index(&'static str, usize),
    /// A finite number: which, and of which observation, camera or point (from 0), of how many.
    Number(&'static str, usize, usize),
    /// Nothing more in the line.
    LineEnd,
    /// Nothing more.
    End,
}

impl std::fmt::Display for Expected {
    fn fmt(&self, out: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::Count(of) => write!(out, "the number of {of} in the first line"),
            Self::Index(of, count) => write!(out, "the index of a {of}, from 0 to {}", count.saturating_sub(1)),
            Self::Number(of, index, count) => write!(out, "a finite number for {of} {index} of {count}"),
            Self::LineEnd => write!(out, "the end of the line (do the counts of the first line agree?)"),
            Self::End => write!(out, "the end of the file"),
        }
    }
}

/// Numbers of a text with the lines that they stand in.
struct Words<'a> {
    lines: std::iter::Enumerate<std::str::Lines<'a>>,
    rest: SplitAsciiWhitespace<'a>,
    line: usize,
}

impl<'a> Words<'a> {
    fn new(text: &'a str) -> Self {
        Self { lines: text.lines().enumerate(), rest: "".split_ascii_whitespace(), line: 0 }
    }

    fn next(&mut self) -> Option<&'a str> {
        loop {
            if let Some(word) = self.rest.next() {
                return Some(word);
            }
            let (index, line) = self.lines.next()?;
            (self.line, self.rest) = (index + 1, line.split_ascii_whitespace());
        }
    }

    fn parse<T>(&mut self, expected: Expected, good: impl Fn(&T) -> bool) -> Result<T, BalError>
    where
        T: std::str::FromStr,
    {
        let found = self.next().ok_or(BalError::Truncated { line: self.line, expected })?;
        let value = found.parse().ok().filter(good);
        value.ok_or_else(|| BalError::Unexpected { line: self.line, found: found.into(), expected })
    }

    fn number(&mut self, of: &'static str, index: usize, count: usize) -> Result<f64, BalError> {
        self.parse(Expected::Number(of, index, count), |value: &f64| value.is_finite())
    }

    fn end_line(&mut self) -> Result<(), BalError> {
        match self.rest.next() {
            Some(found) => {
                Err(BalError::Unexpected { line: self.line, found: found.into(), expected: Expected::LineEnd })
            }
            None => Ok(()),
        }
    }

    /// A number that has its line to itself.
    fn line(&mut self, of: &'static str, index: usize, count: usize) -> Result<f64, BalError> {
        let value = self.number(of, index, count)?;
        self.end_line()?;
        Ok(value)
    }
}

/// Reads a problem.
///
/// # Errors
/// [`BalError`] with the line, what was found and what was expected.
pub fn read_bal(path: &Path) -> Result<BalProblem, BalError> {
    let text = std::fs::read_to_string(path).map_err(|source| BalError::Io { path: path.to_owned(), source })?;
    parse_bal(&text)
}

pub(super) fn parse_bal(text: &str) -> Result<BalProblem, BalError> {
    let mut words = Words::new(text);
    // Indices are kept in 32 bits; and no count can exceed the file's length.
    let most = text.len().min(u32::MAX as usize);
    let mut count = |of| words.parse(Expected::Count(of), |&count: &usize| count <= most);
    let [cameras, points, observations] = [count("cameras")?, count("points")?, count("observations")?];
    words.end_line()?;
    let mut seen: Vec<Vec<Observation>> = vec![Vec::new(); points];
    for index in 0..observations {
        let photo = words.parse(Expected::Index("camera", cameras), |&camera: &u32| (camera as usize) < cameras)?;
        let point = words.parse(Expected::Index("point", points), |&point: &usize| point < points)?;
        let mut pixel = || Ok(words.number("a pixel of observation", index, observations)? as f32);
        seen[point].push(Observation { photo, pixel: [pixel()?, pixel()?] });
        words.end_line()?;
    }
    let mut problem = BalProblem { cameras: Vec::with_capacity(cameras), tracks: Tracks::default() };
    for index in 0..cameras {
        let mut values = [0.0; 9];
        for value in &mut values {
            *value = words.line("camera", index, cameras)?;
        }
        let [a, b, c, x, y, z, focal_px, k1, k2] = values;
        problem.cameras.push(BalCamera {
            rotation: UnitQuaternion::from_scaled_axis(Vector3::new(a, b, c)),
            translation: Vector3::new(x, y, z),
            focal_px,
            radial: [k1, k2],
        });
    }
    for (index, seen) in seen.into_iter().enumerate() {
        let mut value = || words.line("point", index, points);
        problem.tracks.push(Point3::new(value()?, value()?, value()?), seen);
    }
    match words.next() {
        Some(found) => Err(BalError::Unexpected { line: words.line, found: found.into(), expected: Expected::End }),
        None => Ok(problem),
    }
}

/// Writes a problem, observations in the order of the points.
///
/// # Errors
/// [`BalError::Io`].
pub fn write_bal(path: &Path, problem: &BalProblem) -> Result<(), BalError> {
    write_whole(path, to_text(problem).as_bytes()).map_err(|source| BalError::Io { path: path.to_owned(), source })
}

pub(super) fn to_text(problem: &BalProblem) -> String {
    let BalProblem { cameras, tracks } = problem;
    let mut text = format!("{} {} {}\n", cameras.len(), tracks.len(), tracks.observations().len());
    let mut line = |arguments: std::fmt::Arguments<'_>| {
        // Writing to a string cannot fail.
        let _ = text.write_fmt(arguments);
        text.push('\n');
    };
    for (point, (_, seen)) in tracks.iter().enumerate() {
        for Observation { photo, pixel: [x, y] } in seen {
            line(format_args!("{photo} {point} {x:e} {y:e}"));
        }
    }
    for camera in cameras {
        let (r, t) = (camera.rotation.scaled_axis(), camera.translation);
        let [k1, k2] = camera.radial;
        for value in [r.x, r.y, r.z, t.x, t.y, t.z, camera.focal_px, k1, k2] {
            line(format_args!("{value:e}"));
        }
    }
    for position in tracks.positions() {
        for value in position.iter() {
            line(format_args!("{value:e}"));
        }
    }
    text
}
