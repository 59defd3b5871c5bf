//! `adit live`.

use std::fs;
use std::io::{IsTerminal, Write};
use std::net::{SocketAddr, UdpSocket};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

use adit_ground::link::{Config, KeyFile, Patience, Session};
use adit_ground::live::{Ending, Frame, Live, Page, Replay, Screen, Setting, State, Token, follow, replay, run_screen};
use adit_ground::view::listen;
use adit_protocol::connection::Connection;
use adit_protocol::mission::Mission;
use anyhow::{Context, Result};
use clap::Args;
use tokio::sync::{oneshot, watch};

use super::{Answer, Common, positive};

/// Watch a flight: where the vehicle is, what the sensors say, how fast it may fly, which wall has been photographed.
///
/// Shows all of it on this terminal and as a page for a tablet, records every frame, connects again by itself, and shows what is
/// old as old. A gap in the wall's coverage is told while one can still fly back. Where the output is no terminal it prints the
/// page's address instead, and with --json a line of JSON for every picture, five a second.
///
/// The page is served on this machine only unless --web names another address: its own then carries a token, without which
/// nothing is shown. Section, camera and rig come from --mission; without it the board is asked for its own.
#[derive(Debug, Args)]
#[command(
    after_help = "Examples:\n  adit live serial:/dev/ttyUSB0:57600 --mission mission.toml --record flight.tlog\n  \
    adit live udpin:0.0.0.0:14550 --web 0.0.0.0:8080\n  adit live --replay flight.tlog --mission mission.toml --speed 10\n\n\
    Keys: q ends, ? explains the screen."
)]
pub(super) struct Arguments {
    /// Where the board is: serial:DEVICE:BAUD, udpin:, udpout:, tcpin: or tcpout:HOST:PORT; directly, or through the
    /// autopilot's telemetry
    #[arg(value_name = "CONNECTION", required_unless_present = "replay", conflicts_with = "replay")]
    connection: Option<Connection>,
    /// Show this record again, ours or another ground station's .tlog
    #[arg(long, value_name = "FILE")]
    replay: Option<PathBuf>,
    /// So many times as fast as it was
    #[arg(long, value_name = "X", default_value = "1", value_parser = positive, requires = "replay")]
    speed: f64,
    /// Mission file: section, camera and rig
    #[arg(long, value_name = "FILE")]
    mission: Option<PathBuf>,
    /// Record every frame, sent and heard, as .tlog; a file that is there is not replaced
    #[arg(long, value_name = "FILE", conflicts_with = "replay")]
    record: Option<PathBuf>,
    /// Address and port of the page; port 0 takes any free one
    #[arg(long, value_name = "ADDR", default_value = "127.0.0.1:0")]
    web: SocketAddr,
    /// Believe only what is signed with this key (see `adit board key`)
    #[arg(long, value_name = "FILE", conflicts_with = "replay")]
    key: Option<PathBuf>,
    /// Number of the vehicle [default: that of the first board heard]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u8).range(1..))]
    system: Option<u8>,
}

impl Arguments {
    /// Whether words on standard error would spoil the screen.
    pub(super) fn owns_terminal(common: &Common) -> bool {
        std::io::stdout().is_terminal() && !common.json
    }
}

/// Who shows what is seen, besides the page.
enum Shows {
    Screen,
    Lines,
    Nobody,
}

pub(super) fn run(arguments: &Arguments, common: &Common) -> Result<Answer> {
    let mut state = State::new(arguments.system);
    if let Some(path) = &arguments.mission {
        let setting = setting(path)?;
        state.set(setting).with_context(|| path.display().to_string())?;
    }
    let runtime = tokio::runtime::Builder::new_current_thread()
        .enable_all()
        .build()
        .context("cannot start the link's runtime")?;
    let shows = match (Arguments::owns_terminal(common), common.json) {
        (true, _) => Shows::Screen,
        (false, true) => Shows::Lines,
        (false, false) => Shows::Nobody,
    };
    runtime.block_on(attend(arguments, state, &shows))
}

fn setting(path: &Path) -> Result<Setting> {
    let text = fs::read_to_string(path).with_context(|| format!("{}: cannot be read", path.display()))?;
    let mission = Mission::from_toml(&text).with_context(|| path.display().to_string())?;
    Setting::of_mission(&mission).with_context(|| path.display().to_string())
}

async fn attend(arguments: &Arguments, state: State, shows: &Shows) -> Result<Answer> {
    let (live, shown) = Live::new(state);
    // What can be refused is tried before the screen is taken.
    let source = match (&arguments.connection, &arguments.replay) {
        (Some(connection), _) => Source::Flight(Box::new(Session::open(connection, config(arguments)?).await?)),
        (None, Some(path)) => Source::Record(Replay::open(path)?),
        (None, None) => anyhow::bail!("a connection or --replay is needed"),
    };
    let token = if arguments.web.ip().is_loopback() { None } else { Some(Token::random().context("no token")?) };
    let page = Page::new(shown.clone(), token);
    let listener = listen(arguments.web).await?;
    let address = page.address(reachable(listener.local_addr().context("cannot tell the page's address")?));
    let serving = tokio::spawn(page.serve(listener, std::future::pending()));
    let (stop, stopped) = oneshot::channel();
    let over = Arc::new(AtomicBool::new(false));
    let showing = match shows {
        Shows::Screen => Some(spawn_screen(shown.clone(), address, Arc::clone(&over), stop)?),
        Shows::Lines => {
            tokio::spawn(print_lines(shown.clone(), stop));
            None
        }
        Shows::Nobody => {
            writeln!(std::io::stdout(), "{address}").context("cannot write to standard output")?;
            eprintln!("Ctrl-C ends it");
            tokio::spawn(interrupted(stop));
            None
        }
    };
    let done = source.show(live, arguments, stopped).await;
    over.store(true, Ordering::Relaxed);
    if let Some(thread) = showing {
        thread.join().map_err(|_| anyhow::anyhow!("the screen failed"))?.context("the terminal's screen")?;
    }
    serving.abort();
    done.map(|()| Answer::Yes)
}

/// An address that a tablet can open, where the server listens at all of this machine's.
fn reachable(address: SocketAddr) -> SocketAddr {
    if !address.ip().is_unspecified() {
        return address;
    }
    // The way to anywhere leads over the network that others are on; nothing is sent to find it.
    let own = UdpSocket::bind("0.0.0.0:0").and_then(|socket| {
        socket.connect("192.0.2.1:9")?;
        socket.local_addr()
    });
    own.map_or(address, |own| SocketAddr::new(own.ip(), address.port()))
}

fn config(arguments: &Arguments) -> Result<Config> {
    let key = arguments.key.as_deref().map(KeyFile::read).transpose()?;
    Ok(Config { system: arguments.system, key, record: arguments.record.clone(), patience: Patience::default() })
}

/// What is shown.
enum Source {
    Flight(Box<Session>),
    Record(Replay),
}

impl Source {
    async fn show(self, live: Live, arguments: &Arguments, mut stopped: oneshot::Receiver<()>) -> Result<()> {
        let stop = async {
            // Whoever held the other end is gone: nobody watches any more.
            let _ = (&mut stopped).await;
        };
        match self {
            Self::Flight(session) => {
                let name = arguments.record.as_ref().map(|path| path.display().to_string());
                follow(*session, live, name, stop).await?;
            }
            Self::Record(record) => {
                let ended = replay(record, live, arguments.speed, stop).await?;
                // The end is looked at until somebody has seen enough.
                if ended == Ending::RecordOver && !stopped.is_terminated() {
                    let _ = stopped.await;
                }
            }
        }
        Ok(())
    }
}

type Showing = std::thread::JoinHandle<std::io::Result<()>>;

/// A thread of its own: a terminal that takes nothing must not hold up the record.
fn spawn_screen(
    shown: watch::Receiver<Arc<Frame>>,
    address: String,
    over: Arc<AtomicBool>,
    stop: oneshot::Sender<()>,
) -> Result<Showing> {
    let screen = Screen { page: Some(address), is_help: false };
    let run = move || {
        let ended = run_screen(&shown, screen, &over);
        // The link may have ended before.
        let _ = stop.send(());
        ended
    };
    std::thread::Builder::new().name("screen".to_owned()).spawn(run).context("cannot start the screen's thread")
}

/// Prints a line for every picture, until nobody reads any more or Ctrl-C.
async fn print_lines(mut shown: watch::Receiver<Arc<Frame>>, stop: oneshot::Sender<()>) {
    let printing = async {
        while shown.changed().await.is_ok() {
            let frame = Arc::clone(&shown.borrow_and_update());
            let Ok(line) = serde_json::to_string(&frame.view) else { return };
            let mut out = std::io::stdout().lock();
            if writeln!(out, "{line}").and_then(|()| out.flush()).is_err() {
                return;
            }
            if frame.view.replay.is_some_and(|replay| replay.is_over) {
                return;
            }
        }
    };
    tokio::select! {
        () = printing => {}
        _ = tokio::signal::ctrl_c() => {}
    }
    let _ = stop.send(());
}

async fn interrupted(stop: oneshot::Sender<()>) {
    if tokio::signal::ctrl_c().await.is_err() {
        // Without the signal it is ended by killing it, as any program.
        tokio::time::sleep(Duration::MAX).await;
    }
    let _ = stop.send(());
}
