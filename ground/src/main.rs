//! `adit`: the ground station's command line.
//!
//! Figures go to standard output, talk to standard error. Exit codes: 0 done, 1 the answer is no, 2 could not run.
#![forbid(unsafe_code)]

mod commands;

use std::io::IsTerminal;
use std::process::ExitCode;

use anyhow::{Context, Result};
use clap::Parser;
use tracing_subscriber::EnvFilter;

use commands::{Answer, Cli};

#[global_allocator]
static ALLOCATOR: mimalloc::MiMalloc = mimalloc::MiMalloc;

fn main() -> ExitCode {
    let cli = Cli::parse();
    match run(cli) {
        Ok(Answer::Yes) => ExitCode::SUCCESS,
        Ok(Answer::No) => ExitCode::from(1),
        Err(error) => {
            eprintln!("adit: {}", message(&error));
            ExitCode::from(2)
        }
    }
}

fn run(cli: Cli) -> Result<Answer> {
    if !cli.owns_terminal() {
        start_talk(cli.common.verbose);
    }
    if let Some(threads) = cli.common.threads {
        rayon::ThreadPoolBuilder::new()
            .num_threads(usize::from(threads.get()))
            .build_global()
            .context("cannot start the worker threads")?;
    }
    cli.run()
}

/// Warnings, with `-v` information, with `-vv` details; `RUST_LOG` goes before both.
fn start_talk(verbose: u8) {
    let default = match verbose {
        0 => "warn",
        1 => "info",
        _ => "debug",
    };
    let filter = EnvFilter::try_from_default_env().unwrap_or_else(|_| EnvFilter::new(default));
    let colours = std::io::stderr().is_terminal() && std::env::var_os("NO_COLOR").is_none();
    tracing_subscriber::fmt()
        .with_env_filter(filter)
        .with_writer(std::io::stderr)
        .with_ansi(colours)
        .with_target(false)
        .without_time()
        .init();
}

/// The error and its causes in one text; causes that only repeat what was said are left out.
fn message(error: &anyhow::Error) -> String {
    let mut text = String::new();
    for cause in error.chain() {
        let cause = cause.to_string();
        if text.is_empty() {
            text = cause;
        } else if !text.contains(&cause) {
            let separator = if cause.contains('\n') { ":\n" } else { ": " };
            text = format!("{text}{separator}{cause}");
        }
    }
    text
}
