//! A list of parameters under way: what is there, what is missing.

use adit_protocol::mavlink::{Encoding, Incoming, Value};

/// Asked for at once by their places: the board keeps 16 questions.
const ASKED_AT_ONCE: usize = 8;
/// More than any component has; what claims more is damage.
const MOST: u16 = 4096;

/// A parameter.
#[derive(Clone, Debug, PartialEq)]
pub struct Parameter {
    /// Its name.
    pub name: String,
    /// Its value.
    pub value: Value,
    /// Its place in the list.
    pub index: u16,
}

/// What is to be asked next.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) enum Wanted {
    /// The whole list.
    List,
    /// These places of it.
    Places(Vec<u16>),
    /// Nothing: all are there.
    Nothing,
}

/// Collects the answers to one request of the whole list.
#[derive(Clone, Debug)]
pub struct ParameterFetch {
    encoding: Encoding,
    found: Vec<Option<Parameter>>,
    /// Places that were asked for one by one and are not there yet.
    asked: Vec<u16>,
    is_list_over: bool,
}

impl ParameterFetch {
    /// Nothing is known yet.
    pub fn new(encoding: Encoding) -> Self {
        Self { encoding, found: Vec::new(), asked: Vec::new(), is_list_over: false }
    }

    /// How many are there, and how many there are to be; 0 if nobody said.
    pub fn progress(&self) -> (usize, usize) {
        (self.found.iter().flatten().count(), self.found.len())
    }

    /// Places that are missing.
    pub fn missing(&self) -> impl Iterator<Item = u16> {
        self.found.iter().zip(0..).filter(|(found, _)| found.is_none()).map(|(_, index)| index)
    }

    /// Whether all are there.
    pub fn is_complete(&self) -> bool {
        !self.found.is_empty() && self.found.iter().all(Option::is_some)
    }

    /// Hears a message; true if it brought a parameter that was missing.
    pub fn hear(&mut self, incoming: &Incoming) -> bool {
        let Incoming::ParameterValue { name: Some(name), value, count, index } = incoming else { return false };
        if index >= count || *count > MOST {
            return false;
        }
        if usize::from(*count) != self.found.len() {
            // Another program runs there now: what came before is of no use.
            *self = Self::new(self.encoding);
            self.found.resize(usize::from(*count), None);
        }
        self.is_list_over |= index + 1 == *count;
        self.asked.retain(|asked| asked != index);
        let Some(value) = Value::read(*value, self.encoding) else { return false };
        let Some(place) = self.found.get_mut(usize::from(*index)) else { return false };
        let is_new = place.is_none();
        // The newest counts: it may have been changed meanwhile.
        *place = Some(Parameter { name: name.to_string(), value, index: *index });
        is_new
    }

    /// Whether what was asked for is answered, so that more can be asked for at once.
    pub(super) fn is_answered(&self) -> bool {
        self.is_list_over && self.asked.is_empty()
    }

    /// What to ask next.
    pub(super) fn wanted(&mut self) -> Wanted {
        if self.found.is_empty() {
            return Wanted::List;
        }
        let places: Vec<u16> = self.missing().take(ASKED_AT_ONCE).collect();
        // The list may be lost on its way; it is not waited for any longer.
        self.is_list_over = true;
        self.asked.clone_from(&places);
        if places.is_empty() { Wanted::Nothing } else { Wanted::Places(places) }
    }

    /// The list, if it is complete.
    pub fn finish(self) -> Option<Vec<Parameter>> {
        self.found.into_iter().collect::<Option<Vec<_>>>().filter(|list| !list.is_empty())
    }
}

#[cfg(test)]
mod tests {
    use adit_protocol::mavlink::Name;
    use proptest::prelude::*;

    use super::*;

    fn answer(index: u16, count: u16) -> Incoming {
        let name = Name::try_from(format!("P{index}").as_str()).ok();
        let value = Value::Whole(i32::from(index)).write(Encoding::Bytewise);
        Incoming::ParameterValue { name, value, count, index }
    }

    #[test]
    fn what_is_missing_is_asked_for_by_its_place() {
        let mut fetch = ParameterFetch::new(Encoding::Bytewise);
        assert_eq!(fetch.wanted(), Wanted::List);
        for index in [0, 1, 4] {
            assert!(fetch.hear(&answer(index, 5)));
        }
        assert!(!fetch.hear(&answer(4, 5)), "twice is no news");
        assert_eq!(fetch.wanted(), Wanted::Places(vec![2, 3]));
        assert!(fetch.hear(&answer(3, 5)) && !fetch.is_answered());
        assert!(fetch.hear(&answer(2, 5)) && fetch.is_answered() && fetch.is_complete());
        assert_eq!(fetch.wanted(), Wanted::Nothing);
        let names: Vec<_> = fetch.finish().unwrap().into_iter().map(|parameter| parameter.name).collect();
        assert_eq!(names, ["P0", "P1", "P2", "P3", "P4"]);
    }

    #[test]
    fn answers_without_a_place_and_of_absurd_lists_are_left_aside() {
        let mut fetch = ParameterFetch::new(Encoding::Bytewise);
        assert!(!fetch.hear(&answer(u16::MAX, 5)) && !fetch.hear(&answer(3, u16::MAX)) && !fetch.hear(&answer(0, 0)));
        assert_eq!(fetch.progress(), (0, 0));
    }

    #[test]
    fn a_list_of_another_length_begins_anew() {
        let mut fetch = ParameterFetch::new(Encoding::Bytewise);
        fetch.hear(&answer(0, 2));
        fetch.hear(&answer(1, 3));
        assert_eq!(fetch.progress(), (1, 3));
        assert_eq!(fetch.missing().collect::<Vec<_>>(), [0, 2]);
    }

    proptest! {
        #[test]
        fn any_loss_and_order_ends_complete(seen in proptest::collection::vec(0..40_u16, 0..80)) {
            let mut fetch = ParameterFetch::new(Encoding::Bytewise);
            fetch.hear(&answer(7, 40));
            for index in seen {
                fetch.hear(&answer(index, 40));
            }
            while let Wanted::Places(places) = fetch.wanted() {
                prop_assert!(places.len() <= ASKED_AT_ONCE);
                for index in places {
                    prop_assert!(fetch.hear(&answer(index, 40)));
                }
            }
            prop_assert_eq!(fetch.finish().map(|list| list.len()), Some(40));
        }
    }
}
