//! `adit board key`.

use std::path::PathBuf;
use std::time::SystemTime;

use adit_ground::link::{KeyFile, LinkError};
use anyhow::Result;
use clap::{Args, Subcommand};

use super::{Answer, LinkArguments, with_board};

/// Make a key, give it to the board, take it away.
///
/// A board with a key obeys only who signs with it (MAVLink 2 signing): commands and changes of parameters. Keys are given and
/// taken by the board's service port (TELEM2) while it is at rest: who can do that has it in hand.
#[derive(Debug, Args)]
#[command(after_help = "Example:\n  adit board key new board.key\n  \
    adit board key install serial:/dev/ttyUSB0:57600 board.key\n  \
    adit board params set udpin:0.0.0.0:14550 SPD_MARGIN=0.7 --key board.key")]
pub(super) struct Arguments {
    #[command(subcommand)]
    action: Action,
}

#[derive(Debug, Subcommand)]
enum Action {
    New(NewArguments),
    Install(InstallArguments),
    Remove(RemoveArguments),
}

/// Make a new key: 32 random bytes in hexadecimal digits, in a file that only you can read.
///
/// A file that is there is not replaced. Beside it, in FILE.state, is kept what must outlive a session; it is no secret.
#[derive(Debug, Args)]
#[command(after_help = "Example:\n  adit board key new board.key")]
struct NewArguments {
    /// The file
    #[arg(value_name = "FILE")]
    file: PathBuf,
}

/// Give the board a key, by its service port.
///
/// Done when the board signs with it. The answer is no (exit code 1) if the board refuses: wrong port, or not at rest.
#[derive(Debug, Args)]
#[command(after_help = "Example:\n  adit board key install serial:/dev/ttyUSB0:57600 board.key")]
struct InstallArguments {
    #[command(flatten)]
    link: LinkArguments,
    /// The key
    #[arg(value_name = "FILE")]
    file: PathBuf,
}

/// Take the board's key away, by its service port.
///
/// The answer is no (exit code 1) if the board refuses: wrong port, or not at rest.
#[derive(Debug, Args)]
#[command(after_help = "Example:\n  adit board key remove serial:/dev/ttyUSB0:57600")]
struct RemoveArguments {
    #[command(flatten)]
    link: LinkArguments,
}

pub(super) fn run(arguments: &Arguments) -> Result<Answer> {
    match &arguments.action {
        Action::New(arguments) => {
            KeyFile::create(&arguments.file)?;
            eprintln!("a new key is in {}; keep it, and keep it secret", arguments.file.display());
            Ok(Answer::Yes)
        }
        Action::Install(arguments) => {
            let file = KeyFile::read(&arguments.file)?;
            let time = file.time(SystemTime::now());
            told(
                "installed",
                with_board(&arguments.link, async |session, board| {
                    Ok(session.install_key(board, file.key, time).await)
                })?,
            )
        }
        Action::Remove(arguments) => {
            told("removed", with_board(&arguments.link, async |session, board| Ok(session.remove_key(board).await))?)
        }
    }
}

fn told(done: &str, outcome: Result<(), LinkError>) -> Result<Answer> {
    match outcome {
        Ok(()) => {
            eprintln!("the key is {done}");
            Ok(Answer::Yes)
        }
        Err(error @ LinkError::KeyRefused { .. }) => {
            eprintln!("adit: {error}");
            Ok(Answer::No)
        }
        Err(error) => Err(error.into()),
    }
}
