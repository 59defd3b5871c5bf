//! `adit board info`.

use std::fmt;

use adit_ground::link::Board;
use adit_protocol::mavlink::Encoding;
use anyhow::Result;
use clap::Args;
use serde::Serialize;

use super::{Answer, Common, LinkArguments, print, with_board};

/// Say what the board is: its program, its chip, its mode, its vehicle.
#[derive(Debug, Args)]
#[command(after_help = "Examples:\n  adit board info serial:/dev/ttyUSB0:57600\n  \
    adit board info udpin:0.0.0.0:14550 --json")]
pub(super) struct Arguments {
    #[command(flatten)]
    link: LinkArguments,
}

/// Names of the board's modes by their numbers.
const MODES: [&str; 7] = ["boot", "idle", "self-test", "ready", "scanning", "degraded", "fault"];

#[derive(Debug, Serialize)]
struct Info {
    system: u8,
    component: u8,
    version: Option<String>,
    uid: Option<String>,
    mode: String,
    autopilot: String,
    whole_numbers: &'static str,
}

impl Info {
    fn of(board: &Board) -> Self {
        let [system, component] = board.target;
        let mode = usize::try_from(board.mode).ok().and_then(|mode| MODES.get(mode));
        Self {
            system,
            component,
            version: board.version.map(|[major, minor, patch, _]| format!("{major}.{minor}.{patch}")),
            uid: board.uid.map(|uid| format!("{uid:016x}")),
            mode: mode.map_or_else(|| format!("unknown ({})", board.mode), ToString::to_string),
            autopilot: board.autopilot.map_or_else(|| "none heard".to_owned(), |autopilot| autopilot.to_string()),
            whole_numbers: match board.encoding {
                Encoding::Bytewise => "byte by byte",
                Encoding::Cast => "converted to single",
            },
        }
    }
}

impl fmt::Display for Info {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        let unknown = "not told";
        writeln!(out, "board          {}/{}", self.system, self.component)?;
        writeln!(out, "program        {}", self.version.as_deref().unwrap_or(unknown))?;
        writeln!(out, "chip           {}", self.uid.as_deref().unwrap_or(unknown))?;
        writeln!(out, "mode           {}", self.mode)?;
        writeln!(out, "autopilot      {}", self.autopilot)?;
        writeln!(out, "whole numbers  {}", self.whole_numbers)
    }
}

pub(super) fn run(arguments: &Arguments, common: &Common) -> Result<Answer> {
    let board = with_board(&arguments.link, async |_, board| Ok(*board))?;
    print(&Info::of(&board), common)?;
    Ok(Answer::Yes)
}

#[cfg(test)]
mod tests {
    use adit_protocol::record::Mode;

    use super::*;

    #[test]
    fn every_mode_has_its_name() {
        let modes = [Mode::Boot, Mode::Idle, Mode::SelfTest, Mode::Ready, Mode::Scanning, Mode::Degraded, Mode::Fault];
        for (number, mode) in modes.into_iter().enumerate() {
            assert_eq!(mode as usize, number);
        }
        assert_eq!(MODES.get(Mode::Scanning as usize), Some(&"scanning"));
        assert_eq!(MODES.len(), modes.len());
    }
}
