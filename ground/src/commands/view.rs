//! `adit view`.

use std::fmt;
use std::net::SocketAddr;
use std::path::PathBuf;
use std::process::{Command, Stdio};

use adit_ground::view::{Viewer, listen};
use anyhow::{Context, Result};
use clap::Args;
use serde::Serialize;

use super::{Answer, Common, print};

/// Walk through a reconstruction in the browser.
///
/// Serves a page that flies through the textured tunnel, unrolls it, zooms down to the photos' own pixels, measures along
/// the wall, shows coverage, relief and photos, and marks findings. These are saved in OUT/findings.json and exported as CSV,
/// JSON and EN 13508-2 XML. The page needs WebGL 2 and no network.
///
/// The address is printed; Ctrl-C ends the server. It listens on this machine only unless --listen names another
/// address: then everyone who reaches that can look and can mark findings.
#[derive(Debug, Args)]
#[command(after_help = "Examples:\n  adit view demo/survey/out --open\n  adit view survey/out --listen 127.0.0.1:8080")]
pub(super) struct Arguments {
    /// Where `adit reconstruct` left its results
    #[arg(value_name = "OUT")]
    out: PathBuf,
    /// Address and port; port 0 takes any free one
    #[arg(long, value_name = "ADDR", default_value = "127.0.0.1:0")]
    listen: SocketAddr,
    /// Open the page in the browser
    #[arg(long)]
    open: bool,
}

/// What is printed.
#[derive(Serialize)]
struct Figures {
    url: String,
}

impl fmt::Display for Figures {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(f, "{}", self.url)
    }
}

pub(super) fn run(arguments: &Arguments, common: &Common) -> Result<Answer> {
    let viewer = Viewer::open(&arguments.out)?;
    let runtime =
        tokio::runtime::Builder::new_current_thread().enable_all().build().context("cannot start the server")?;
    runtime.block_on(async {
        let listener = listen(arguments.listen).await?;
        let address = listener.local_addr().context("cannot tell the server's address")?;
        let figures = Figures { url: format!("http://{address}/") };
        print(&figures, common)?;
        eprintln!("showing {}; Ctrl-C ends it", arguments.out.display());
        if !address.ip().is_loopback() {
            eprintln!("warning: everyone who reaches {address} can look at the survey and mark findings");
        }
        if arguments.open {
            open(&figures.url);
        }
        viewer.serve(listener, interrupted()).await?;
        Ok(Answer::Yes)
    })
}

async fn interrupted() {
    if tokio::signal::ctrl_c().await.is_err() {
        // Without the signal the server is ended by killing it, as any program.
        std::future::pending::<()>().await;
    }
}

/// Asks the desktop to show the page; that is a convenience, so a desktop that cannot is only told of.
fn open(url: &str) {
    let program = match std::env::consts::OS {
        "windows" => "explorer",
        "macos" => "open",
        _ => "xdg-open",
    };
    let started = Command::new(program).arg(url).stdout(Stdio::null()).stderr(Stdio::null()).spawn();
    if let Err(error) = started {
        eprintln!("warning: {program} cannot open the page ({error}); open {url} in a browser");
    }
}
