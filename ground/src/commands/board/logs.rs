//! `adit board logs` and `adit board fetch-log`.

use std::fmt;
use std::path::PathBuf;

use adit_ground::link::{LogEntry, LogProgress, log_name};
use anyhow::{Context, Result};
use clap::Args;
use serde::Serialize;

use super::{Answer, Common, LinkArguments, bar, print, with_board};

/// List the logs on the board's card.
///
/// The board does not answer while it scans.
#[derive(Debug, Args)]
#[command(after_help = "Example:\n  adit board logs serial:/dev/ttyUSB0:57600")]
pub(super) struct ListArguments {
    #[command(flatten)]
    link: LinkArguments,
}

/// Fetch logs from the board's card.
///
/// A log is written to ADITnnnn.LOG.part and renamed when it is complete; a fetch that was cut short goes on where it was. A
/// file that is there already is compared with the board's and not fetched again. A megabyte takes four minutes at 57,600
/// baud: the card in a reader is faster.
///
/// The answer is no (exit code 1) if there is no such log.
#[derive(Debug, Args)]
#[command(after_help = "Examples:\n  adit board fetch-log serial:/dev/ttyUSB0:57600 --out logs\n  \
    adit board fetch-log udpin:0.0.0.0:14550 12 --out logs\n  adit board fetch-log udpin:0.0.0.0:14550 --all --out logs")]
pub(super) struct FetchArguments {
    #[command(flatten)]
    link: LinkArguments,
    /// Which [default: the newest]
    #[arg(value_name = "NUMBER", conflicts_with = "all")]
    number: Option<u16>,
    /// All that are on the card
    #[arg(long)]
    all: bool,
    /// The folder to write to
    #[arg(long, value_name = "DIR", default_value = ".")]
    out: PathBuf,
}

#[derive(Debug, Serialize)]
#[serde(transparent)]
struct List(Vec<LogEntry>);

impl fmt::Display for List {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        for log in &self.0 {
            writeln!(out, "{:>5}  {}  {:>10} bytes", log.number, log_name(log.number), log.bytes)?;
        }
        Ok(())
    }
}

/// A log that is here now.
#[derive(Debug, Serialize)]
struct Fetched {
    number: u16,
    bytes: u32,
    file: PathBuf,
}

#[derive(Debug, Serialize)]
#[serde(transparent)]
struct AllFetched(Vec<Fetched>);

impl fmt::Display for AllFetched {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.0.iter().try_for_each(|file| writeln!(out, "{}", file.file.display()))
    }
}

pub(super) fn list(arguments: &ListArguments, common: &Common) -> Result<Answer> {
    let logs = with_board(&arguments.link, async |session, board| session.logs(board).await)?;
    if logs.is_empty() {
        eprintln!("there are no logs on the board's card, or there is no card");
    }
    print(&List(logs), common)?;
    Ok(Answer::Yes)
}

pub(super) fn fetch(arguments: &FetchArguments, common: &Common) -> Result<Answer> {
    let out = &arguments.out;
    std::fs::create_dir_all(out).with_context(|| format!("{}: cannot be made", out.display()))?;
    let fetched = with_board(&arguments.link, async |session, board| {
        let wanted = wanted(session.logs(board).await?, arguments);
        let mut files = Vec::new();
        for log in wanted {
            let bar = bar("log", "{prefix} {msg} [{bar:30}] {bytes}/{total_bytes} {bytes_per_sec} {eta}");
            bar.set_message(log_name(log.number));
            let mut tell = |progress: LogProgress| {
                bar.set_length(u64::from(progress.of));
                bar.set_position(u64::from(progress.bytes));
            };
            let path = session.fetch_log(board, log, out, &mut tell).await;
            bar.finish_and_clear();
            files.push(Fetched { number: log.number, bytes: log.bytes, file: path? });
        }
        Ok(files)
    })?;
    if fetched.is_empty() {
        eprintln!("adit: there is no such log; `adit board logs {}` lists all", arguments.link.connection);
        return Ok(Answer::No);
    }
    print(&AllFetched(fetched), common)?;
    Ok(Answer::Yes)
}

fn wanted(mut logs: Vec<LogEntry>, arguments: &FetchArguments) -> Vec<LogEntry> {
    match arguments.number {
        _ if arguments.all => logs,
        Some(number) => logs.into_iter().filter(|log| log.number == number).collect(),
        None => logs.pop().into_iter().collect(),
    }
}
