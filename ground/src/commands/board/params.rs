//! `adit board params`.

use std::fmt;
use std::path::PathBuf;

use adit_ground::link::{Board, LinkError, Parameter, Session, Shown};
use adit_protocol::connection::Connection;
use adit_protocol::mavlink::Value;
use adit_protocol::parameters::ParameterTable;
use anyhow::Result;
use clap::{Args, Subcommand};
use serde::Serialize;

use super::{Answer, Common, LinkArguments, LinkOptions, bar, params_file, print, with_board};

/// Read and change the board's parameters.
///
/// Without a further command: all parameters, as `get` shows them. A change is kept by the board at once and takes effect at
/// its next start (`adit board restart`). While the board scans nothing is changed.
#[derive(Debug, Args)]
#[command(args_conflicts_with_subcommands = true, subcommand_negates_reqs = true)]
#[command(after_help = "Examples:\n  adit board params serial:/dev/ttyUSB0:57600\n  \
    adit board params set serial:/dev/ttyUSB0:57600 SPD_MARGIN=0.7 RIG_IMAGES=12\n  \
    adit board params save udpin:0.0.0.0:14550 board.param")]
pub(super) struct Arguments {
    #[command(subcommand)]
    action: Option<Action>,
    /// Where the board is: serial:DEVICE:BAUD, udpin:, udpout:, tcpin: or tcpout:HOST:PORT
    #[arg(value_name = "CONNECTION", required = true)]
    connection: Option<Connection>,
    #[command(flatten)]
    options: LinkOptions,
}

#[derive(Debug, Subcommand)]
enum Action {
    Get(GetArguments),
    Set(SetArguments),
    Save(SaveArguments),
    Load(LoadArguments),
}

/// Show parameters: name, value, range, meaning.
#[derive(Debug, Args)]
#[command(after_help = "Examples:\n  adit board params get serial:/dev/ttyUSB0:57600\n  \
    adit board params get serial:/dev/ttyUSB0:57600 SPD_MARGIN RIG_IMAGES --json")]
struct GetArguments {
    #[command(flatten)]
    link: LinkArguments,
    /// Which [default: all]
    #[arg(value_name = "NAME", value_parser = name)]
    names: Vec<String>,
}

/// Change parameters.
///
/// Each is set, and confirmed by the board's answer. The answer is no (exit code 1) if one is refused; the others are set all
/// the same.
#[derive(Debug, Args)]
#[command(after_help = "Example:\n  adit board params set serial:/dev/ttyUSB0:57600 SPD_MARGIN=0.7 RIG_IMAGES=12")]
struct SetArguments {
    #[command(flatten)]
    link: LinkArguments,
    /// Name and value
    #[arg(value_name = "NAME=VALUE", required = true, value_parser = assignment)]
    assignments: Vec<(String, f64)>,
}

/// Save all parameters to a file.
///
/// The file is plain text, NAME,VALUE per line: Mission Planner and MAVProxy read it, `load` does.
#[derive(Debug, Args)]
#[command(after_help = "Example:\n  adit board params save serial:/dev/ttyUSB0:57600 board.param")]
struct SaveArguments {
    #[command(flatten)]
    link: LinkArguments,
    /// The file; one that is there is replaced
    #[arg(value_name = "FILE")]
    file: PathBuf,
}

/// Set all parameters that differ from a file's.
///
/// The file: NAME,VALUE or NAME VALUE per line, comments behind #, as Mission Planner, MAVProxy and QGroundControl write it.
/// Parameters are set in the board's order; those refused are tried again when the others are set, since one may allow the
/// other. The answer is no (exit code 1) if one stays refused.
#[derive(Debug, Args)]
#[command(after_help = "Examples:\n  adit board params load serial:/dev/ttyUSB0:57600 board.param --dry-run\n  \
    adit board params load serial:/dev/ttyUSB0:57600 board.param")]
struct LoadArguments {
    #[command(flatten)]
    link: LinkArguments,
    /// The file
    #[arg(value_name = "FILE")]
    file: PathBuf,
    /// Only say what would be set
    #[arg(long)]
    dry_run: bool,
}

fn name(text: &str) -> Result<String, String> {
    let name = text.to_ascii_uppercase();
    match ParameterTable::find(&name) {
        Some(_) => Ok(name),
        None => Err("no parameter of the board has this name; `adit board params get CONNECTION` shows all".to_owned()),
    }
}

fn assignment(text: &str) -> Result<(String, f64), String> {
    let (left, right) = text.split_once('=').ok_or("expected NAME=VALUE")?;
    let value: f64 = right.trim().parse().map_err(|_| format!("{right:?} is not a number"))?;
    if value.is_finite() { Ok((name(left.trim())?, value)) } else { Err(format!("{right:?} is not a finite number")) }
}

pub(super) fn run(arguments: &Arguments, common: &Common) -> Result<Answer> {
    match (&arguments.action, arguments.connection.clone()) {
        (Some(Action::Get(arguments)), _) => get(&arguments.link, &arguments.names, common),
        (Some(Action::Set(arguments)), _) => params_file::set(&arguments.link, &arguments.assignments, common),
        (Some(Action::Save(arguments)), _) => params_file::save(&arguments.link, &arguments.file),
        (Some(Action::Load(arguments)), _) => {
            params_file::load(&arguments.link, &arguments.file, arguments.dry_run, common)
        }
        (None, Some(connection)) => {
            let link = LinkArguments { connection, options: arguments.options.clone() };
            get(&link, &[], common)
        }
        (None, None) => anyhow::bail!("expected CONNECTION, or one of get, set, save and load"),
    }
}

fn get(link: &LinkArguments, names: &[String], common: &Common) -> Result<Answer> {
    let parameters = with_board(link, async |session, board| {
        if names.is_empty() {
            return all(session, board).await;
        }
        let mut parameters = Vec::new();
        for name in names {
            parameters.push(session.parameter(board, name).await?);
        }
        Ok(parameters)
    })?;
    print(&Table(parameters.into_iter().map(Row::of).collect()), common)?;
    Ok(Answer::Yes)
}

/// The whole list, with a bar.
pub(super) async fn all(session: &Session, board: &Board) -> Result<Vec<Parameter>, LinkError> {
    let bar = bar("parameters", "{prefix} [{bar:30}] {pos}/{len}");
    let mut tell = |there: usize, of: usize| {
        bar.set_length(of as u64);
        bar.set_position(there as u64);
    };
    let list = session.parameters(board, &mut tell).await;
    bar.finish_and_clear();
    list
}

/// A value as a number in JSON: whole numbers without a point.
pub(super) fn json(value: Value) -> serde_json::Value {
    match value {
        Value::Whole(value) => value.into(),
        // Through its text: a single's digits, not those of the double that is nearest to it.
        Value::Real(value) => value.to_string().parse::<f64>().map_or(serde_json::Value::Null, Into::into),
    }
}

#[derive(Debug, Serialize)]
#[serde(transparent)]
struct Table(Vec<Row>);

#[derive(Debug, Serialize)]
struct Row {
    name: String,
    value: serde_json::Value,
    #[serde(skip)]
    shown: String,
    least: Option<f32>,
    most: Option<f32>,
    about: Option<&'static str>,
}

impl Row {
    fn of(parameter: Parameter) -> Self {
        let known = ParameterTable::find(&parameter.name).and_then(|index| ParameterTable::rows().get(index));
        Self {
            value: json(parameter.value),
            shown: Shown(parameter.value).to_string(),
            name: parameter.name,
            least: known.map(|row| row.least),
            most: known.map(|row| row.most),
            about: known.map(|row| row.about),
        }
    }

    fn range(&self) -> String {
        match (self.least, self.most) {
            (Some(least), Some(most)) => format!("{least} to {most}"),
            _ => String::new(),
        }
    }
}

impl fmt::Display for Table {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        let width = |text: &dyn Fn(&Row) -> usize| self.0.iter().map(text).max().unwrap_or_default();
        let names = width(&|row| row.name.len());
        let values = width(&|row| row.shown.len());
        let ranges = width(&|row| row.range().len());
        for row in &self.0 {
            let about = row.about.unwrap_or("not known to this program");
            writeln!(out, "{:names$}  {:>values$}  {:ranges$}  {about}", row.name, row.shown, row.range())?;
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use adit_protocol::parameters::Parameters;

    use super::*;

    #[test]
    fn the_table_of_all_parameters_is_as_reviewed() {
        let mut table = ParameterTable::new(Parameters::default());
        let parameter = |(index, row): (usize, &adit_protocol::parameters::Row)| {
            let value = table.get(index)?;
            Some(Parameter { name: row.name.to_owned(), value, index: index as u16 })
        };
        let rows: Vec<_> = ParameterTable::rows().iter().enumerate().filter_map(parameter).map(Row::of).collect();
        insta::assert_snapshot!(Table(rows));
    }

    #[test]
    fn names_and_assignments_are_read_in_any_case_and_wrong_ones_told() {
        assert_eq!(assignment("spd_margin = 0.7"), Ok(("SPD_MARGIN".to_owned(), 0.7)));
        for wrong in ["SPD_MARGIN", "SPD_MARGIN=fast", "SPD_MARGIN=inf", "NO_SUCH=1"] {
            assert!(assignment(wrong).is_err(), "{wrong}");
        }
    }

    #[test]
    fn json_has_the_digits_of_a_single() {
        assert_eq!(json(Value::Real(0.1)).to_string(), "0.1");
        assert_eq!(json(Value::Whole(12)).to_string(), "12");
        assert_eq!(json(Value::Real(f32::NAN)).to_string(), "null");
    }
}
