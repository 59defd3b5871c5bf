//! Ours and COLMAP on the same surveys, one table of accuracy, time and memory, and what must hold of it.
//!
//! Peers come from `PyPI` into a virtual environment; sets from the simulator and from `../shared/samples` where they are.
//! Both sides get two threads, the same photos and masks, and go through the same `adit evaluate`.

mod bal;
mod calibration;
mod outcome;
mod peer;
mod sets;
mod table;
mod verdict;

use std::fs;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result, bail};

use crate::shell::{output, run, top};
pub(crate) use calibration::bench_calibration;
use outcome::{Outcome, Who};
use sets::Set;

/// Threads of either side.
const THREADS: &str = "2";

/// What to compare and where the results go.
pub(crate) struct Options {
    /// Names of sets; `None` for all but the long ones.
    pub(crate) sets: Option<Vec<String>>,
    /// Where table and results go.
    pub(crate) out: PathBuf,
    /// Leave the peer out.
    pub(crate) skip_peer: bool,
    /// Measure again what an earlier run has measured.
    pub(crate) fresh: bool,
}

/// `cargo xtask bench-peers`.
pub(crate) fn bench_peers(options: &Options) -> Result<()> {
    let chosen = sets::chosen(options.sets.as_deref())?;
    let wants_bal = options.sets.as_ref().is_none_or(|names| names.iter().any(|name| name == bal::NAME));
    run("cargo", &["build", "--locked", "--release", "--package", "adit-ground", "--package", "adit-hil-sim"])?;
    peer::install()?;
    let bench = Bench {
        results: options.out.join("results"),
        work: options.out.join("work"),
        fresh: options.fresh,
        run: date()?,
    };
    fs::create_dir_all(&bench.results).with_context(|| format!("cannot make {}", bench.results.display()))?;

    let mut outcomes = Vec::new();
    for set in &chosen {
        let Some(folder) = set.folder()? else {
            eprintln!("xtask: {}: skipped, no shared/samples beside or above the checkout", set.name);
            continue;
        };
        outcomes.push(bench.measured(set, &folder, Who::Ours)?);
        if set.for_peer && !options.skip_peer {
            outcomes.push(bench.measured(set, &folder, Who::Peer)?);
        }
        table::write(&options.out, &outcomes, None, &bench.run)?;
    }
    let solved = if wants_bal { bal::compare(&bench)? } else { None };
    let text = table::write(&options.out, &outcomes, solved.as_ref(), &bench.run)?;
    print!("{text}");
    eprintln!("xtask: this table is in {}/table.md and table.json", options.out.display());
    Ok(())
}

/// One run of the bench.
struct Bench {
    /// Finished outcomes, one file each.
    results: PathBuf,
    /// What the programs leave.
    work: PathBuf,
    fresh: bool,
    /// When this run started; outcomes of the same run compare in time.
    run: String,
}

impl Bench {
    /// The outcome of one side on one set: an earlier one where set and program are still the same, else a new one.
    fn measured(&self, set: &Set, folder: &Path, who: Who) -> Result<Outcome> {
        let file = self.results.join(format!("{}-{}.json", set.name, who.name()));
        let key = format!("{:016x} {}", sets::digest(folder)?, peer::version_of(who)?);
        if !self.fresh
            && let Ok(text) = fs::read_to_string(&file)
            && let Ok(kept) = serde_json::from_str::<Outcome>(&text)
            && kept.key == key
        {
            eprintln!("xtask: {}, {}: kept from {}", set.name, who.name(), kept.run);
            return Ok(kept);
        }
        let work = self.work.join(format!("{}-{}", set.name, who.name()));
        let outcome = outcome::measure(set, folder, who, &work, key, &self.run)?;
        let text = serde_json::to_string_pretty(&outcome)?;
        fs::write(&file, text).with_context(|| format!("cannot write {}", file.display()))?;
        Ok(outcome)
    }
}

fn date() -> Result<String> {
    let Some(date) = output("date", &["-u", "+%Y-%m-%d %H:%M:%S UTC"]) else { bail!("cannot run date") };
    Ok(date.trim().to_owned())
}

/// A program of the release build.
fn program(name: &str) -> String {
    top().join("target/release").join(name).to_string_lossy().into_owned()
}

/// A path as an argument.
fn text(path: &Path) -> String {
    path.to_string_lossy().into_owned()
}
