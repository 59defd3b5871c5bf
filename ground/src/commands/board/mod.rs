//! `adit board`: the board over its link.

mod info;
mod key;
mod load;
mod logs;
mod params;
mod params_file;

use std::path::PathBuf;
use std::time::Duration;

use adit_ground::link::{Board, CommandOutcome, Config, KeyFile, LinkError, Patience, Session};
use adit_protocol::connection::Connection;
use anyhow::{Context, Result};
use clap::{Args, Subcommand};
use indicatif::{ProgressBar, ProgressStyle};

use super::{Answer, Common, positive, print};

/// Ask and set the board over its MAVLink line.
///
/// CONNECTION says where it is, as in the MAVLink world: serial:DEVICE:BAUD, udpin:HOST:PORT (waits to be spoken to),
/// udpout:HOST:PORT (speaks first), tcpin:HOST:PORT (server), tcpout:HOST:PORT (client). The board is component 191 of its
/// vehicle; a radio or a router that carries the autopilot's messages carries the board's.
#[derive(Debug, Args)]
#[command(after_help = "Examples:\n  adit board info serial:/dev/ttyUSB0:57600\n  \
    adit board params get udpin:0.0.0.0:14550 SPD_MARGIN RIG_IMAGES\n  \
    adit board fetch-log tcpout:127.0.0.1:5760 --out logs")]
pub(super) struct Arguments {
    #[command(subcommand)]
    action: Action,
}

#[derive(Debug, Subcommand)]
enum Action {
    Info(info::Arguments),
    Load(load::Arguments),
    Params(params::Arguments),
    Restart(RestartArguments),
    Logs(logs::ListArguments),
    FetchLog(logs::FetchArguments),
    Key(key::Arguments),
}

/// Restart the board.
///
/// Parameters that were changed take effect with it. The answer is no (exit code 1) unless the board is at rest.
#[derive(Debug, Args)]
#[command(after_help = "Example:\n  adit board restart serial:/dev/ttyUSB0:57600")]
struct RestartArguments {
    #[command(flatten)]
    link: LinkArguments,
}

/// Where the board is, and how to talk to it.
#[derive(Clone, Debug, Args)]
pub(super) struct LinkArguments {
    /// Where the board is: serial:DEVICE:BAUD, udpin:, udpout:, tcpin: or tcpout:HOST:PORT
    #[arg(value_name = "CONNECTION")]
    connection: Connection,
    #[command(flatten)]
    options: LinkOptions,
}

#[derive(Clone, Debug, Args)]
pub(super) struct LinkOptions {
    /// Sign with this key (see `adit board key`), and believe only what is signed with it
    #[arg(long, value_name = "FILE")]
    key: Option<PathBuf>,
    /// Record every frame, sent and heard, as .tlog, which Mission Planner and MAVProxy open; a file that is
    /// there is not replaced
    #[arg(long, value_name = "FILE")]
    record: Option<PathBuf>,
    /// Seconds without an answer before giving up
    #[arg(long, value_name = "S", default_value = "10", value_parser = positive)]
    timeout: f64,
    /// Number of the vehicle [default: that of the first board heard]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u8).range(1..))]
    system: Option<u8>,
}

pub(super) fn run(arguments: &Arguments, common: &Common) -> Result<Answer> {
    match &arguments.action {
        Action::Info(arguments) => info::run(arguments, common),
        Action::Load(arguments) => load::run(arguments, common),
        Action::Params(arguments) => params::run(arguments, common),
        Action::Restart(arguments) => restart(arguments),
        Action::Logs(arguments) => logs::list(arguments, common),
        Action::FetchLog(arguments) => logs::fetch(arguments, common),
        Action::Key(arguments) => key::run(arguments),
    }
}

fn restart(arguments: &RestartArguments) -> Result<Answer> {
    with_board(&arguments.link, async |session, board| {
        let outcome = session.restart(board).await?;
        Ok(told("restart", outcome))
    })
}

/// Says on standard error what became of a command.
fn told(what: &str, outcome: CommandOutcome) -> Answer {
    eprintln!("{what}: {outcome}");
    if outcome == CommandOutcome::Accepted { Answer::Yes } else { Answer::No }
}

/// Opens a session, finds the board, does something with it and ends the session in good order.
fn with_board<T>(
    link: &LinkArguments,
    action: impl AsyncFnOnce(&Session, &Board) -> Result<T, LinkError>,
) -> Result<T> {
    with_session(link, async |session| {
        let board = session.board().await?;
        action(session, &board).await
    })
}

/// Opens a session, does something with it and ends it in good order.
pub(super) fn with_session<T>(
    link: &LinkArguments,
    action: impl AsyncFnOnce(&Session) -> Result<T, LinkError>,
) -> Result<T> {
    let runtime = tokio::runtime::Builder::new_current_thread()
        .enable_all()
        .build()
        .context("cannot start the runtime of the link")?;
    runtime.block_on(async {
        let session = Session::open(&link.connection, config(&link.options)?).await?;
        let done = action(&session).await;
        // The record must be complete whatever came of the action; the action's error goes first.
        let closed = session.close().await;
        let done = done?;
        closed?;
        Ok(done)
    })
}

fn config(options: &LinkOptions) -> Result<Config> {
    let silence = Duration::try_from_secs_f64(options.timeout).context("--timeout")?;
    let patience = Patience { silence, answer: Patience::default().answer.min(silence / 3) };
    let key = options.key.as_deref().map(KeyFile::read).transpose()?;
    Ok(Config { system: options.system, key, record: options.record.clone(), patience })
}

/// A bar on standard error, where that is a terminal.
fn bar(what: &'static str, template: &str) -> ProgressBar {
    let bar = ProgressBar::new(0).with_prefix(what);
    if let Ok(style) = ProgressStyle::with_template(template) {
        bar.set_style(style.progress_chars("=> "));
    }
    bar
}
