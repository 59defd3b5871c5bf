//! `adit board params set`, `save` and `load`.

use std::fmt;
use std::path::Path;

use adit_ground::link::{Board, LinkError, Parameter, ParameterFile, Session, Shown, same_value, value_like};
use adit_protocol::mavlink::Value;
use anyhow::Result;
use serde::Serialize;

use super::params::{all, json};
use super::{Answer, Common, LinkArguments, print, with_board};

/// Passes over what is to be set: what was refused once may be possible when the others are set.
const PASSES: usize = 2;

/// What became of one parameter.
#[derive(Debug, Serialize)]
struct Change {
    name: String,
    #[serde(serialize_with = "value")]
    before: Option<Value>,
    wanted: f64,
    outcome: Outcome,
    /// Why it was not set.
    #[serde(skip_serializing_if = "Option::is_none")]
    why: Option<String>,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
enum Outcome {
    Same,
    WouldSet,
    Set,
    Refused,
}

#[derive(Debug, Serialize)]
#[serde(transparent)]
struct Changes(Vec<Change>);

#[expect(clippy::ref_option, clippy::trivially_copy_pass_by_ref, reason = "serde calls it so")]
fn value<S: serde::Serializer>(value: &Option<Value>, serializer: S) -> Result<S::Ok, S::Error> {
    value.map(json).serialize(serializer)
}

impl fmt::Display for Changes {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        for change in self.0.iter().filter(|change| change.outcome != Outcome::Same) {
            let before = change.before.map_or_else(|| "?".to_owned(), |value| Shown(value).to_string());
            let word = match change.outcome {
                Outcome::Set => "set",
                Outcome::WouldSet => "would be set",
                Outcome::Refused => "refused",
                Outcome::Same => "as it is",
            };
            write!(out, "{:16}  {before} -> {}  {word}", change.name, change.wanted)?;
            match &change.why {
                Some(why) => writeln!(out, ": {why}")?,
                None => writeln!(out)?,
            }
        }
        let count = |outcome| self.0.iter().filter(|change| change.outcome == outcome).count();
        let [set, would, same, refused] = [Outcome::Set, Outcome::WouldSet, Outcome::Same, Outcome::Refused].map(count);
        let set = if would > 0 { format!("{would} would be set") } else { format!("{set} set") };
        writeln!(out, "{set}, {same} as they were, {refused} refused")
    }
}

impl Changes {
    fn report(&self, common: &Common) -> Result<Answer> {
        print(self, common)?;
        let any = |outcome| self.0.iter().any(|change| change.outcome == outcome);
        if any(Outcome::Set) {
            eprintln!("kept by the board; in force from its next start on: adit board restart");
        }
        Ok(if any(Outcome::Refused) { Answer::No } else { Answer::Yes })
    }
}

pub(super) fn set(link: &LinkArguments, assignments: &[(String, f64)], common: &Common) -> Result<Answer> {
    let changes = with_board(link, async |session, board| {
        let mut there = Vec::new();
        for (name, _) in assignments {
            there.push(session.parameter(board, name).await?);
        }
        apply(session, board, assignments, &there, false).await
    })?;
    changes.report(common)
}

pub(super) fn save(link: &LinkArguments, file: &Path) -> Result<Answer> {
    let (board, parameters) = with_board(link, async |session, board| Ok((*board, all(session, board).await?)))?;
    let uid = board.uid.map_or_else(|| "unknown".to_owned(), |uid| format!("{uid:016x}"));
    let about = format!("parameters of the Adit board with chip {uid}, by adit {}", env!("CARGO_PKG_VERSION"));
    ParameterFile::write(file, &about, &parameters)?;
    eprintln!("{} parameters saved to {}", parameters.len(), file.display());
    Ok(Answer::Yes)
}

pub(super) fn load(link: &LinkArguments, file: &Path, dry_run: bool, common: &Common) -> Result<Answer> {
    let wanted = ParameterFile::read(file)?.entries;
    let changes = with_board(link, async |session, board| {
        let there = all(session, board).await?;
        apply(session, board, &wanted, &there, dry_run).await
    })?;
    changes.report(common)
}

/// Sets what differs, in the board's order, and what was refused once more.
async fn apply(
    session: &Session,
    board: &Board,
    wanted: &[(String, f64)],
    there: &[Parameter],
    dry_run: bool,
) -> Result<Changes, LinkError> {
    let mut changes = planned(wanted, there);
    if dry_run {
        return Ok(Changes(changes));
    }
    for _ in 0..PASSES {
        for change in &mut changes {
            let value = change.before.and_then(|before| value_like(change.wanted, before));
            let (Outcome::WouldSet, Some(value)) = (change.outcome, value) else { continue };
            match session.set_parameter(board, &change.name, value).await {
                Ok(_) => (change.outcome, change.why) = (Outcome::Set, None),
                Err(LinkError::ParameterRefused { found, said, .. }) => {
                    change.why = Some(said.unwrap_or_else(|| format!("the board keeps {}", Shown(found))));
                }
                Err(error) => return Err(error),
            }
        }
    }
    for change in changes.iter_mut().filter(|change| change.outcome == Outcome::WouldSet) {
        change.outcome = Outcome::Refused;
    }
    Ok(Changes(changes))
}

/// What is to be done: in the board's order; what the board does not have comes last.
fn planned(wanted: &[(String, f64)], there: &[Parameter]) -> Vec<Change> {
    let find = |name: &str| there.iter().find(|parameter| parameter.name == name);
    let mut ordered: Vec<_> = wanted.iter().map(|(name, value)| (find(name), name, *value)).collect();
    ordered.sort_by_key(|(found, ..)| found.map_or(u16::MAX, |parameter| parameter.index));
    let change = |(found, name, wanted): (Option<&Parameter>, &String, f64)| {
        let before = found.map(|parameter| parameter.value);
        let (outcome, why) = match before.map(|before| (before, value_like(wanted, before))) {
            None => (Outcome::Refused, Some("the board has no parameter of this name")),
            Some((_, None)) => (Outcome::Refused, Some("must be a whole number")),
            Some((before, Some(value))) if same_value(before, value) => (Outcome::Same, None),
            Some(_) => (Outcome::WouldSet, None),
        };
        Change { name: name.clone(), before, wanted, outcome, why: why.map(ToOwned::to_owned) }
    };
    ordered.into_iter().map(change).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_differs_is_set_in_the_boards_order_and_the_rest_told() {
        let parameter = |name: &str, value, index| Parameter { name: name.to_owned(), value, index };
        let there = [
            parameter("A", Value::Whole(1), 0),
            parameter("B", Value::Real(0.1), 1),
            parameter("C", Value::Whole(3), 2),
        ];
        let wanted = [("NONE", 1.0), ("C", 4.0), ("B", 0.1), ("A", 1.5)].map(|(name, value)| (name.to_owned(), value));
        insta::assert_snapshot!(Changes(planned(&wanted, &there)), @r"
        A                 1 -> 1.5  refused: must be a whole number
        C                 3 -> 4  would be set
        NONE              ? -> 1  refused: the board has no parameter of this name
        1 would be set, 1 as they were, 2 refused
        ");
    }
}
