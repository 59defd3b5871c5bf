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

/// Said after a change.
pub(super) const KEPT: &str = "kept by the board; in force from its next start on: adit board restart";

/// What became of one parameter.
#[derive(Debug, Serialize)]
pub(super) struct Change {
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
pub(super) struct Changes(Vec<Change>);

/// Whether a value that is there is the one that is wanted.
pub(super) type Same = fn(Value, Value) -> bool;

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
    fn any(&self, outcome: Outcome) -> bool {
        self.0.iter().any(|change| change.outcome == outcome)
    }

    /// Whether something was set.
    pub(super) fn any_set(&self) -> bool {
        self.any(Outcome::Set)
    }

    /// Whether something was refused.
    pub(super) fn any_refused(&self) -> bool {
        self.any(Outcome::Refused)
    }

    fn report(&self, common: &Common) -> Result<Answer> {
        print(self, common)?;
        if self.any_set() {
            eprintln!("{KEPT}");
        }
        Ok(if self.any_refused() { Answer::No } else { Answer::Yes })
    }
}

pub(super) fn set(link: &LinkArguments, assignments: &[(String, f64)], common: &Common) -> Result<Answer> {
    let changes = with_board(link, async |session, board| {
        let mut there = Vec::new();
        for (name, _) in assignments {
            there.push(session.parameter(board, name).await?);
        }
        apply(session, board, planned(assignments, &there, same_value), false).await
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
        apply(session, board, planned(&wanted, &there, same_value), dry_run).await
    })?;
    changes.report(common)
}

/// Sets what differs, in the board's order, and what was refused once more.
pub(super) async fn apply(
    session: &Session,
    board: &Board,
    Changes(mut changes): Changes,
    dry_run: bool,
) -> Result<Changes, LinkError> {
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
pub(super) fn planned(wanted: &[(String, f64)], there: &[Parameter], same: Same) -> Changes {
    let find = |name: &str| there.iter().find(|parameter| parameter.name == name);
    let mut ordered: Vec<_> = wanted.iter().map(|(name, value)| (find(name), name, *value)).collect();
    ordered.sort_by_key(|(found, ..)| found.map_or(u16::MAX, |parameter| parameter.index));
    let change = |(found, name, wanted): (Option<&Parameter>, &String, f64)| {
        let before = found.map(|parameter| parameter.value);
        let (outcome, why) = match before.map(|before| (before, value_like(wanted, before))) {
            None => (Outcome::Refused, Some("the board has no parameter of this name")),
            Some((_, None)) => (Outcome::Refused, Some("must be a whole number")),
            Some((before, Some(value))) if same(before, value) => (Outcome::Same, None),
            Some(_) => (Outcome::WouldSet, None),
        };
        Change { name: name.clone(), before, wanted, outcome, why: why.map(ToOwned::to_owned) }
    };
    Changes(ordered.into_iter().map(change).collect())
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
        insta::assert_snapshot!(planned(&wanted, &there, same_value), @r"
        A                 1 -> 1.5  refused: must be a whole number
        C                 3 -> 4  would be set
        NONE              ? -> 1  refused: the board has no parameter of this name
        1 would be set, 1 as they were, 2 refused
        ");
    }
}
