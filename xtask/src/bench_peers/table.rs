//! The table, as Markdown for people and JSON for programs.

use std::fmt::Write as _;
use std::fs;
use std::path::Path;

use anyhow::{Context, Result};
use serde_json::{Value, json};

use super::outcome::{MAPPER_LIMIT_S, Outcome, RUNS, Who};
use super::verdict::{Verdict, verdicts};
use crate::shell::output;

/// Writes table.md and table.json and returns the former.
pub(super) fn write(out: &Path, outcomes: &[Outcome], bal: Option<&Value>, run: &str) -> Result<String> {
    let verdicts = verdicts(outcomes, bal);
    let machine = machine();
    let mut text = format!("# Ours and COLMAP\n\nRun of {run} on {machine}.\n\n");
    text.push_str(HEADER);
    for outcome in outcomes {
        let other = outcomes.iter().find(|other| other.set == outcome.set && other.who == Who::Peer);
        row(&mut text, outcome, other.filter(|_| outcome.who == Who::Ours));
    }
    text.push_str(&notes());
    if let Some(bal) = bal {
        bal_rows(&mut text, bal);
    }
    text.push_str("\n| must hold | found | |\n|---|---|---|\n");
    for Verdict { must_hold, found, holds } in &verdicts {
        let word = holds.map_or("not measured", |holds| if holds { "pass" } else { "FAIL" });
        // Writing to a string cannot fail.
        let _ = writeln!(text, "| {must_hold} | {found} | {word} |");
    }
    let value = json!({
        "format": 1, "run": run, "machine": machine, "outcomes": outcomes, "bal": bal, "verdicts": verdicts,
    });
    for (name, content) in [("table.md", text.clone()), ("table.json", serde_json::to_string_pretty(&value)?)] {
        fs::write(out.join(name), content).with_context(|| format!("cannot write {}", out.join(name).display()))?;
    }
    Ok(text)
}

const HEADER: &str = "\
| set | who | registered | aligned mm | absolute mm | rotation deg, aligned / absolute | drift mm/m | scale % | stages s | total s | peak MiB | times faster |
|---|---|---|---|---|---|---|---|---|---|---|---|
";

/// What the columns mean.
fn notes() -> String {
    format!(
        "
Aligned: root mean square of positions after the best similarity; absolute: in the tunnel frame, without any alignment, which
the peer has none of. Errors are of the registered photos only. Drift: `adit evaluate --help`. Total: of ours the whole process
(median of {RUNS} runs); of the peer extraction, matching and its better mapper, each given
{MAPPER_LIMIT_S} s at most. Peak: largest resident set.
"
    )
}

fn row(text: &mut String, outcome: &Outcome, peer: Option<&Outcome>) {
    let accuracy = &outcome.accuracy;
    let number =
        |value: Option<f64>, decimals: usize| value.map_or("n/a".to_owned(), |value| format!("{value:.decimals$}"));
    let stages: Vec<String> = outcome.stages_s.iter().map(|(name, seconds)| format!("{name} {seconds:.2}")).collect();
    let ratio = peer.map_or(String::new(), |peer| {
        let apart = if peer.run == outcome.run { String::new() } else { format!(" (peer timed {})", peer.run) };
        format!("{:.1}{apart}", peer.total_s / outcome.total_s)
    });
    let _ = writeln!(
        text,
        "| {} | {} | {} of {} | {} | {} | {} / {} | {} | {} | {} | {:.1} | {:.0} | {ratio} |",
        outcome.set,
        outcome.who.name(),
        accuracy.registered,
        outcome.photos,
        number(accuracy.aligned_mm, 3),
        number(accuracy.absolute_mm, 3),
        number(accuracy.aligned_deg, 4),
        number(accuracy.absolute_deg, 4),
        number(accuracy.drift_mm_per_m, 3),
        number(accuracy.scale_error_percent, 4),
        stages.join(", "),
        outcome.total_s,
        outcome.peak_mib,
    );
}

fn bal_rows(text: &mut String, bal: &Value) {
    text.push_str(
        "\n| BAL | initial cost | final cost | iterations | s | ms per iteration |\n|---|---|---|---|---|---|\n",
    );
    for who in ["ours", "peer"] {
        let side = &bal[who];
        let Some(seconds) = side["seconds"].as_f64() else {
            let _ = writeln!(text, "| {who} | could not run | | | | |");
            continue;
        };
        let number = |key: &str| side[key].as_f64().unwrap_or(f64::NAN);
        let _ = writeln!(
            text,
            "| {} | {:.2} | {:.3} | {} | {seconds:.3} | {:.1} |",
            side["version"].as_str().unwrap_or(who),
            number("initial_cost"),
            number("final_cost"),
            side["iterations"],
            number("seconds_per_iteration") * 1e3,
        );
    }
    if let Some(behind) = bal["peer"]["behind"].as_u64() {
        let _ = writeln!(
            text,
            "\nThe peer's costs lack the {behind} sightings of points behind their camera, which COLMAP leaves out."
        );
    }
}

/// Processors of this machine.
fn machine() -> String {
    let count = std::thread::available_parallelism().map_or(0, usize::from);
    let lines = output("cat", &["/proc/cpuinfo"]).unwrap_or_default();
    let model = lines.lines().find_map(|line| line.strip_prefix("model name")).and_then(|line| line.split(": ").nth(1));
    format!("{count} cores, {}", model.unwrap_or("unknown processor"))
}
