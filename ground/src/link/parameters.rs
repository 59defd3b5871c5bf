//! The board's parameters: read, changed.

use std::fmt;

use adit_protocol::mavlink::{Encoding, Incoming, Name, RawValue, Target, Value};

use super::error::{LinkError, Question};
use super::parameter_fetch::{Parameter, ParameterFetch, Wanted};
use super::pump::Build;
use super::session::{Dialogue, Session, Step, Turn};
use super::version::Board;

/// Angles go through radians on the board; a single keeps seven digits.
const RELATIVE_TOLERANCE: f32 = 1e-6;
/// How often another value is heard in answer to a change, without a word, before it is taken for a refusal.
const ANSWERS_TO_REFUSAL: u32 = 3;

/// Whether a value that was asked for and one that came back are the same, but for the rounding of a conversion.
pub fn same_value(one: Value, other: Value) -> bool {
    if let (Value::Whole(one), Value::Whole(other)) = (one, other) {
        return one == other;
    }
    let (one, other) = (one.real(), other.real());
    one == other || (one - other).abs() <= RELATIVE_TOLERANCE * one.abs().max(other.abs())
}

/// A value as people write it.
#[derive(Clone, Copy, Debug)]
pub struct Shown(pub Value);

impl fmt::Display for Shown {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.0 {
            Value::Whole(value) => write!(out, "{value}"),
            Value::Real(value) => write!(out, "{value}"),
        }
    }
}

struct ListDialogue<'p> {
    whom: Target,
    fetch: ParameterFetch,
    progress: &'p mut (dyn FnMut(usize, usize) + Send),
}

impl Dialogue for ListDialogue<'_> {
    type Answer = ();

    fn turn(&mut self, _attempt: u32) -> Turn<()> {
        let whom = self.whom;
        match self.fetch.wanted() {
            Wanted::Nothing => Turn::Done(()),
            Wanted::List => Turn::Send(vec![Box::new(move |sender| sender.parameter_list(whom))]),
            Wanted::Places(places) => Turn::Send(
                places
                    .into_iter()
                    .map(|index| -> Build { Box::new(move |sender| sender.parameter_read_at(whom, index)) })
                    .collect(),
            ),
        }
    }

    fn hear(&mut self, incoming: &Incoming) -> Step<()> {
        if !self.fetch.hear(incoming) {
            return Step::Nothing;
        }
        let (there, of) = self.fetch.progress();
        (self.progress)(there, of);
        match self.fetch.is_complete() {
            true => Step::Done(()),
            false if self.fetch.is_answered() => Step::Ask,
            false => Step::Progress,
        }
    }
}

struct ReadDialogue {
    whom: Target,
    name: Name,
    encoding: Encoding,
}

impl Dialogue for ReadDialogue {
    type Answer = Parameter;

    fn turn(&mut self, _attempt: u32) -> Turn<Parameter> {
        let (whom, name) = (self.whom, self.name.clone());
        Turn::Send(vec![Box::new(move |sender| sender.parameter_read(whom, &name))])
    }

    fn hear(&mut self, incoming: &Incoming) -> Step<Parameter> {
        match incoming {
            Incoming::ParameterValue { name: Some(name), value, index, .. } if *name == self.name => {
                let value = Value::read(*value, self.encoding);
                value.map_or(Step::Nothing, |value| {
                    Step::Done(Parameter { name: name.to_string(), value, index: *index })
                })
            }
            _ => Step::Nothing,
        }
    }
}

/// What a change ends with: the value that is there now and, if it is another one, what was said.
type Changed = Result<Value, (Value, Option<String>)>;

struct ChangeDialogue {
    whom: Target,
    name: Name,
    value: Value,
    raw: RawValue,
    encoding: Encoding,
    /// Another value came in answer.
    other: Option<Value>,
    others: u32,
    said: Option<String>,
}

impl ChangeDialogue {
    fn new(board: &Board, name: Name, value: Value) -> Self {
        let (whom, encoding, raw) = (board.target, board.encoding, value.write(board.encoding));
        Self { whom, name, value, raw, encoding, other: None, others: 0, said: None }
    }

    /// A refusal is another value and a word; in either order.
    fn refusal(&self) -> Step<Changed> {
        match (self.other, &self.said) {
            (Some(other), Some(said)) => Step::Done(Err((other, Some(said.clone())))),
            _ => Step::Nothing,
        }
    }
}

impl Dialogue for ChangeDialogue {
    type Answer = Changed;

    fn turn(&mut self, _attempt: u32) -> Turn<Changed> {
        // Without a word, another value may be the late answer to an earlier question: it is asked again.
        if let Some(other) = self.other
            && self.others >= ANSWERS_TO_REFUSAL
        {
            return Turn::Done(Err((other, self.said.clone())));
        }
        let (whom, name, raw) = (self.whom, self.name.clone(), self.raw);
        Turn::Send(vec![Box::new(move |sender| sender.parameter_set(whom, &name, raw))])
    }

    fn hear(&mut self, incoming: &Incoming) -> Step<Changed> {
        match incoming {
            Incoming::ParameterValue { name: Some(name), value, .. } if *name == self.name => {
                let Some(value) = Value::read(*value, self.encoding) else { return Step::Nothing };
                if same_value(value, self.value) {
                    return Step::Done(Ok(value));
                }
                self.other = Some(value);
                self.others += 1;
                self.refusal()
            }
            Incoming::Text { text, .. } if text.starts_with(self.name.as_str()) => {
                self.said = Some(text.to_string());
                self.refusal()
            }
            _ => Step::Nothing,
        }
    }
}

impl Session {
    /// All parameters of the board, in its order; `progress` is told how many of how many are there.
    ///
    /// # Errors
    /// [`LinkError::NoAnswer`], [`LinkError::Ended`].
    pub async fn parameters(
        &self,
        board: &Board,
        progress: &mut (dyn FnMut(usize, usize) + Send),
    ) -> Result<Vec<Parameter>, LinkError> {
        let fetch = ParameterFetch::new(board.encoding);
        let mut dialogue = ListDialogue { whom: board.target, fetch, progress };
        self.lead(board.target, Question::Parameters, &mut dialogue).await?;
        dialogue.fetch.finish().ok_or(LinkError::Ended)
    }

    /// A parameter. The board does not answer to a name that it does not know.
    ///
    /// # Errors
    /// [`LinkError::NoAnswer`], [`LinkError::Ended`].
    pub async fn parameter(&self, board: &Board, name: &str) -> Result<Parameter, LinkError> {
        let question = Question::Parameter(name.to_owned());
        let name = letters_of(name, &question)?;
        let mut dialogue = ReadDialogue { whom: board.target, name, encoding: board.encoding };
        self.lead(board.target, question, &mut dialogue).await
    }

    /// Changes a parameter. Done when the board answers with the value; it is kept then, and in force from the board's next
    /// start on.
    ///
    /// # Errors
    /// [`LinkError::ParameterRefused`] with the value that the board keeps and what it says of it; [`LinkError::NoAnswer`].
    pub async fn set_parameter(&self, board: &Board, name: &str, value: Value) -> Result<Value, LinkError> {
        let question = Question::Change(name.to_owned());
        let letters = letters_of(name, &question)?;
        let mut dialogue = ChangeDialogue::new(board, letters, value);
        match self.lead(board.target, question, &mut dialogue).await? {
            Ok(value) => Ok(value),
            Err((found, said)) => {
                Err(LinkError::ParameterRefused { name: name.to_owned(), wanted: value, found, said })
            }
        }
    }
}

/// A name that is too long is nobody's: nobody would answer.
fn letters_of(name: &str, question: &Question) -> Result<Name, LinkError> {
    Name::try_from(name).map_err(|_| LinkError::NoAnswer {
        question: question.clone(),
        within: std::time::Duration::ZERO,
        said: None,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn dialogue(value: Value) -> ChangeDialogue {
        let board = Board {
            target: [1, 191],
            mode: 1,
            encoding: Encoding::Bytewise,
            version: None,
            uid: None,
            autopilot: None,
        };
        ChangeDialogue::new(&board, Name::try_from("SPD_MARGIN").unwrap(), value)
    }

    fn answer(value: f32) -> Incoming {
        let name = Name::try_from("SPD_MARGIN").ok();
        Incoming::ParameterValue { name, value: Value::Real(value).write(Encoding::Bytewise), count: 90, index: 5 }
    }

    fn words(text: &str) -> Incoming {
        Incoming::Text { severity: 4, text: text.try_into().unwrap() }
    }

    #[test]
    fn values_are_the_same_through_radians_and_back() {
        for degrees in [45.0_f32, 0.1, -179.3, 720.0] {
            assert!(same_value(Value::Real(degrees), Value::Real(degrees.to_radians().to_degrees())));
        }
        assert!(!same_value(Value::Real(0.5), Value::Real(0.50001)));
        assert!(!same_value(Value::Whole(921_600), Value::Whole(921_601)));
        assert!(!same_value(Value::Real(f32::NAN), Value::Real(f32::NAN)));
    }

    #[test]
    fn a_refusal_is_another_value_and_a_word_in_either_order() {
        let refused = |step: Step<Changed>| matches!(step, Step::Done(Err((Value::Real(0.8), Some(ref said)))) if said.contains("refused"));
        let mut first = dialogue(Value::Real(2.0));
        assert!(matches!(first.hear(&answer(0.8)), Step::Nothing));
        assert!(refused(first.hear(&words("SPD_MARGIN: value refused"))));
        let mut second = dialogue(Value::Real(2.0));
        assert!(matches!(second.hear(&words("SPD_MARGIN: value refused")), Step::Nothing));
        assert!(refused(second.hear(&answer(0.8))));
    }

    #[test]
    fn a_late_answer_to_an_earlier_question_is_no_refusal() {
        let mut change = dialogue(Value::Real(0.5));
        assert!(matches!(change.hear(&answer(0.8)), Step::Nothing));
        assert!(matches!(change.turn(1), Turn::Send(_)));
        assert!(matches!(change.hear(&answer(0.5)), Step::Done(Ok(Value::Real(0.5)))));
    }

    #[test]
    fn another_value_again_and_again_is_a_refusal_without_a_word() {
        let mut change = dialogue(Value::Real(0.5));
        for _ in 0..ANSWERS_TO_REFUSAL {
            assert!(matches!(change.turn(0), Turn::Send(_)));
            change.hear(&answer(0.8));
        }
        assert!(matches!(change.turn(3), Turn::Done(Err((Value::Real(0.8), None)))));
    }
}
