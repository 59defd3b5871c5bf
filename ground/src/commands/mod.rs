//! The subcommands: arguments in, a call into the library, figures out.

mod ablation;
mod adjust;
mod board;
mod calibrate;
mod calibrate_rig;
mod compare;
mod evaluate;
mod export;
mod ingest;
mod live;
mod match_photos;
mod plan;
mod preflight;
mod reconstruct;
mod view;

use std::io::Write;
use std::num::NonZeroU16;

use anyhow::{Context, Result};
use clap::{Args, Parser, Subcommand};
use serde::Serialize;

/// What a command found out; the exit code says it too.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Answer {
    /// Done, exit code 0.
    Yes,
    /// The answer is no, exit code 1.
    No,
}

/// Adit: from a flight through a tunnel to the place of every pixel.
///
/// A survey's way: `adit plan` and `adit preflight` before the flight, `adit live` during it, `adit ingest` and `adit reconstruct` after it, `adit evaluate` where
/// there is a truth to compare with, `adit export` for other programs. `adit board` talks to the board: its parameters, its logs, its key.
#[derive(Debug, Parser)]
#[command(name = "adit", version, after_help = AFTER_HELP, max_term_width = 100)]
pub(crate) struct Cli {
    #[command(subcommand)]
    command: Command,
    #[command(flatten)]
    pub(crate) common: Common,
}

const AFTER_HELP: &str = "Units: files and options say theirs in the name (radius_m, shaft_deg, --mm-per-px).\n\
                          Exit codes: 0 done, 1 the answer is no, 2 could not run.";

/// Options of every command.
#[derive(Clone, Debug, Args)]
pub(crate) struct Common {
    /// Worker threads [default: one per core]
    #[arg(long, global = true, value_name = "N")]
    pub(crate) threads: Option<NonZeroU16>,
    /// Print the figures as JSON on standard output
    #[arg(long, global = true)]
    pub(crate) json: bool,
    /// Say more on standard error (twice: details); `RUST_LOG` goes before it
    #[arg(short, long, global = true, action = clap::ArgAction::Count)]
    pub(crate) verbose: u8,
}

#[derive(Debug, Subcommand)]
enum Command {
    Plan(plan::Arguments),
    Preflight(preflight::Arguments),
    Calibrate(calibrate::Arguments),
    CalibrateRig(calibrate_rig::Arguments),
    Ingest(ingest::Arguments),
    Reconstruct(reconstruct::Arguments),
    Evaluate(evaluate::Arguments),
    Match(match_photos::Arguments),
    Board(board::Arguments),
    Live(live::Arguments),
    Adjust(adjust::Arguments),
    Ablation(ablation::Arguments),
    View(view::Arguments),
    Export(export::Arguments),
    Compare(compare::Arguments),
}

impl Cli {
    /// Whether the command draws on the whole terminal, so that talk on standard error would spoil it.
    pub(crate) fn owns_terminal(&self) -> bool {
        matches!(self.command, Command::Live(_)) && live::Arguments::owns_terminal(&self.common)
    }

    pub(crate) fn run(self) -> Result<Answer> {
        match self.command {
            Command::Plan(arguments) => plan::run(&arguments, &self.common),
            Command::Preflight(arguments) => preflight::run(&arguments, &self.common),
            Command::Calibrate(arguments) => calibrate::run(&arguments, &self.common),
            Command::CalibrateRig(arguments) => calibrate_rig::run(&arguments, &self.common),
            Command::Ingest(arguments) => ingest::run(&arguments, &self.common),
            Command::Reconstruct(arguments) => reconstruct::run(&arguments, &self.common),
            Command::Evaluate(arguments) => evaluate::run(&arguments, &self.common),
            Command::Match(arguments) => match_photos::run(&arguments, &self.common),
            Command::Board(arguments) => board::run(&arguments, &self.common),
            Command::Live(arguments) => live::run(&arguments, &self.common),
            Command::Adjust(arguments) => adjust::run(&arguments, &self.common),
            Command::Ablation(arguments) => ablation::run(&arguments, &self.common),
            Command::View(arguments) => view::run(&arguments, &self.common),
            Command::Export(arguments) => export::run(&arguments, &self.common),
            Command::Compare(arguments) => compare::run(&arguments, &self.common),
        }
    }
}

/// Prints figures: as JSON if asked, else as the text they display as.
fn print(figures: &(impl Serialize + std::fmt::Display), common: &Common) -> Result<()> {
    let text = if common.json { format!("{}\n", serde_json::to_string_pretty(figures)?) } else { figures.to_string() };
    let mut out = std::io::stdout().lock();
    match out.write_all(text.as_bytes()).and_then(|()| out.flush()) {
        // The reader (`head`, a closed pager) has seen enough.
        Err(error) if error.kind() == std::io::ErrorKind::BrokenPipe => Ok(()),
        written => written.context("cannot write to standard output"),
    }
}

/// Parses a number above zero.
fn positive(text: &str) -> Result<f64, String> {
    let value: f64 = text.parse().map_err(|_| "not a number".to_owned())?;
    if value.is_finite() && value > 0.0 { Ok(value) } else { Err("expected a number above 0".to_owned()) }
}

#[cfg(test)]
mod tests {
    use clap::CommandFactory;

    use super::*;

    #[test]
    fn the_arguments_are_consistent() {
        Cli::command().debug_assert();
    }

    #[test]
    fn every_help_text_is_as_reviewed() {
        let mut command = Cli::command().term_width(100);
        command.build();
        insta::assert_snapshot!("help", command.render_long_help());
        assert_help_of_subcommands("help", &mut command);
    }

    fn assert_help_of_subcommands(prefix: &str, command: &mut clap::Command) {
        for sub in command.get_subcommands_mut().filter(|sub| sub.get_name() != "help") {
            let name = format!("{prefix}-{}", sub.get_name());
            insta::assert_snapshot!(name.clone(), sub.render_long_help());
            assert_help_of_subcommands(&name, sub);
        }
    }

    #[test]
    fn parameters_are_shown_with_and_without_a_word_for_it() {
        let parses = |arguments: &[&str]| Cli::try_parse_from(arguments).is_ok();
        assert!(parses(&["adit", "board", "params", "udpin:0.0.0.0:14550"]));
        assert!(parses(&["adit", "board", "params", "udpin:0.0.0.0:14550", "--json", "--timeout", "3"]));
        assert!(parses(&["adit", "board", "params", "get", "udpin:0.0.0.0:14550", "SPD_MARGIN", "--json"]));
        assert!(parses(&["adit", "board", "params", "set", "udpin:0.0.0.0:14550", "SPD_MARGIN=-1"]));
        assert!(!parses(&["adit", "board", "params"]));
        assert!(!parses(&["adit", "board", "params", "set", "udpin:0.0.0.0:14550"]));
        assert!(!parses(&["adit", "board", "params", "get"]));
        assert!(!parses(&["adit", "board", "info", "carrier:pigeon"]));
    }

    #[test]
    fn numbers_out_of_range_are_refused() {
        assert!(Cli::try_parse_from(["adit", "evaluate", "survey", "--threads", "0"]).is_err());
        assert!(Cli::try_parse_from(["adit", "evaluate", "survey", "--max-aligned-mm", "-1"]).is_err());
        assert!(Cli::try_parse_from(["adit", "evaluate", "survey", "--threads", "2", "--json"]).is_ok());
    }
}
