//! `adit board load`.

use std::fmt;
use std::path::{Path, PathBuf};
use std::time::Duration;

use adit_geometry::profile::ProfileSpec;
use adit_ground::link::{Board, CommandOutcome, LinkError, Session, figures, fingerprint, gathered, log_name};
use adit_protocol::log::{FlightLog, PARAMETERS_FILE};
use adit_protocol::parameters::Parameters;
use anyhow::{Context, Result, bail};
use clap::Args;
use serde::Serialize;
use tokio::time::{Instant, sleep};

use super::params::all;
use super::params_file::{Changes, KEPT, apply, planned};
use super::{Answer, Common, LinkArguments, print, with_board};

/// Between two looks at a board that restarts.
const PAUSE: Duration = Duration::from_millis(500);
/// A board is up again within 2 s; its card may take longer.
const RESTART: Duration = Duration::from_secs(15);

/// Give the board the parameters of a plan, and make sure that it has them.
///
/// Sends PARAMS.ADT, which `adit plan --out` wrote: sets what differs, shows it, reads everything back and compares it by its
/// hash. The board keeps the parameters; they are in force from its next start on, with --restart at once, which is then
/// read out of its new log. A section that is a chain of vertices goes by card only.
///
/// The answer is no (exit code 1) if a parameter is refused, or what is read back is not what was sent. `adit board params
/// load` sets single parameters from a text file.
#[derive(Debug, Args)]
#[command(after_help = "Examples:\n  adit board load serial:/dev/ttyUSB0:921600 plan --restart\n  \
    adit board load udpin:0.0.0.0:14550 plan/PARAMS.ADT --dry-run")]
pub(super) struct Arguments {
    #[command(flatten)]
    link: LinkArguments,
    /// The plan's folder, or its PARAMS.ADT
    #[arg(value_name = "PLAN")]
    plan: PathBuf,
    /// Restart the board, and see that the parameters are in force
    #[arg(long, conflicts_with = "dry_run")]
    restart: bool,
    /// Only say what would be set
    #[arg(long)]
    dry_run: bool,
}

/// What became of it.
#[derive(Debug, Serialize)]
struct Loaded {
    changes: Changes,
    /// Of the plan's parameters, as the link tells them.
    hash: String,
    /// Of what was read back; absent in a dry run.
    read_back_hash: Option<String>,
    /// Of what is in force after a restart, and the log that tells it.
    in_force: Option<InForce>,
}

#[derive(Debug, Serialize)]
struct InForce {
    log: String,
    hash: String,
}

impl Loaded {
    fn is_good(&self) -> bool {
        let same = |hash: &String| *hash == self.hash;
        !self.changes.any_refused()
            && self.read_back_hash.as_ref().is_none_or(same)
            && self.in_force.as_ref().is_none_or(|in_force| same(&in_force.hash))
    }
}

impl fmt::Display for Loaded {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(out, "{}", self.changes)?;
        let compared = |hash: &String| if *hash == self.hash { "as planned" } else { "NOT as planned" };
        writeln!(out, "plan       {}", self.hash)?;
        if let Some(hash) = &self.read_back_hash {
            writeln!(out, "read back  {hash}  {}", compared(hash))?;
        }
        if let Some(InForce { log, hash }) = &self.in_force {
            writeln!(out, "in force   {hash}  {}, by {log}", compared(hash))?;
        }
        Ok(())
    }
}

pub(super) fn run(arguments: &Arguments, common: &Common) -> Result<Answer> {
    let parameters = read(&arguments.plan)?;
    if matches!(parameters.profile, ProfileSpec::Chain { .. }) {
        bail!(
            "{}: a section that is a chain of vertices has no parameters on the link; copy {PARAMETERS_FILE} to the root of \
             the board's card instead",
            arguments.plan.display()
        );
    }
    let hash = shown(fingerprint(&parameters)?);
    let loaded =
        with_board(&arguments.link, async |session, board| load(session, board, arguments, &parameters, hash).await)?;
    print(&loaded, common)?;
    if loaded.changes.any_set() && !arguments.restart {
        eprintln!("{KEPT}");
    }
    Ok(if loaded.is_good() { Answer::Yes } else { Answer::No })
}

/// The parameters of a plan's folder or file.
fn read(plan: &Path) -> Result<Parameters> {
    let path = if plan.is_dir() { plan.join(PARAMETERS_FILE) } else { plan.to_owned() };
    let bytes = std::fs::read(&path)
        .with_context(|| format!("cannot read {}; `adit plan MISSION.toml --out PLAN` makes it", path.display()))?;
    let header = FlightLog::from_bytes(&bytes).sessions.into_iter().next().and_then(|session| session.header);
    let header = header.with_context(|| {
        let found = "no parameters in it, or those of another version of the format";
        format!("{}: {found}; expected what `adit plan --out` writes", path.display())
    })?;
    Ok(header.parameters)
}

async fn load(
    session: &Session,
    board: &Board,
    arguments: &Arguments,
    parameters: &Parameters,
    hash: String,
) -> Result<Loaded, LinkError> {
    let wanted: Vec<(String, f64)> =
        figures(parameters).into_iter().map(|(name, value)| (name.to_owned(), f64::from(value.real()))).collect();
    // To the last bit: what is nearly the same has another hash.
    let plan = planned(&wanted, &all(session, board).await?, |there, wanted| there == wanted);
    let changes = apply(session, board, plan, arguments.dry_run).await?;
    if arguments.dry_run {
        return Ok(Loaded { changes, hash, read_back_hash: None, in_force: None });
    }
    let told = all(session, board).await?;
    let read_back = gathered(&told).map_or_else(|error| error.to_string(), |there| hash_of(&there));
    let restarts = arguments.restart && read_back == hash;
    let in_force = if restarts { in_force(session, board).await? } else { None };
    Ok(Loaded { changes, hash, read_back_hash: Some(read_back), in_force })
}

/// Restarts the board, and reads what is in force out of its new log.
async fn in_force(session: &Session, board: &Board) -> Result<Option<InForce>, LinkError> {
    let newest = async || Ok::<_, LinkError>(session.logs(board).await?.last().copied());
    let nothing = |hash: &str| Some(InForce { log: "no log".to_owned(), hash: hash.to_owned() });
    let before = newest().await?;
    match session.restart(board).await? {
        CommandOutcome::Accepted => {}
        outcome => return Ok(nothing(&format!("restart {outcome}"))),
    }
    let until = Instant::now() + RESTART;
    while Instant::now() < until {
        sleep(PAUSE).await;
        let Some(log) = newest().await? else { continue };
        if before.is_some_and(|before| before.number >= log.number) {
            continue;
        }
        if let Some(header) = session.log_header(board, log).await? {
            let (log, hash) = (log_name(log.number), hash_of(&header.parameters));
            return Ok(Some(InForce { log, hash }));
        }
    }
    Ok(nothing("not known: no card?"))
}

fn hash_of(parameters: &Parameters) -> String {
    fingerprint(parameters).map_or_else(|error| error.to_string(), shown)
}

fn shown(hash: u64) -> String {
    format!("{hash:016x}")
}
