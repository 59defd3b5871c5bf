//! Reads keys out of TOML tables, checks them, and collects every violation instead of stopping at the first.

use std::cell::RefCell;
use std::collections::BTreeMap;

use toml::Spanned;
use toml::de::{DeTable, DeValue};

use super::problem::{MissionError, Problem};
use super::quantity::Quantity;

/// Collects violations of one text.
pub(super) struct Collector<'t> {
    text: &'t str,
    problems: RefCell<Vec<Problem>>,
}

impl<'t> Collector<'t> {
    pub(super) fn new(text: &'t str) -> Self {
        Self { text, problems: RefCell::new(Vec::new()) }
    }

    pub(super) fn add(&self, place: Option<usize>, key: &str, found: impl Into<String>, expected: impl Into<String>) {
        let line = place.map(|offset| self.text.bytes().take(offset).filter(|byte| *byte == b'\n').count() + 1);
        let problem = Problem { line, key: key.to_owned(), found: found.into(), expected: expected.into() };
        self.problems.borrow_mut().push(problem);
    }

    /// The value if nothing was wrong, otherwise everything that was.
    pub(super) fn conclude<T>(self, value: Option<T>) -> Result<T, MissionError> {
        let mut problems = self.problems.into_inner();
        problems.sort_by_key(|problem| problem.line.unwrap_or(usize::MAX));
        match value {
            Some(value) if problems.is_empty() => Ok(value),
            _ => Err(MissionError { problems }),
        }
    }
}

/// One table: keys are taken out one by one, what remains is unknown.
pub(super) struct Section<'t> {
    collector: &'t Collector<'t>,
    path: String,
    place: Option<usize>,
    entries: BTreeMap<&'t str, (usize, &'t DeValue<'t>)>,
    known: Vec<&'static str>,
    /// Where the keys taken so far stand.
    places: BTreeMap<&'static str, usize>,
}

impl<'t> Section<'t> {
    pub(super) fn new(
        collector: &'t Collector<'t>,
        path: &str,
        place: Option<usize>,
        table: Option<&'t DeTable<'t>>,
    ) -> Self {
        let entries = table.into_iter().flat_map(DeTable::iter).map(|(key, value)| {
            let key: &'t Spanned<_> = key;
            (key.get_ref().as_ref(), (key.span().start, value.get_ref()))
        });
        Self {
            collector,
            path: path.to_owned(),
            place,
            entries: entries.collect(),
            known: Vec::new(),
            places: BTreeMap::new(),
        }
    }

    /// Full path of a key.
    pub(super) fn path_of(&self, key: &str) -> String {
        if self.path.is_empty() { key.to_owned() } else { format!("{}.{key}", self.path) }
    }

    /// Reports something about a key, at its line, or at the section's if it is not there.
    pub(super) fn complain(&self, key: &str, found: impl Into<String>, expected: impl Into<String>) {
        let place = self.places.get(key).copied().or(self.place);
        self.collector.add(place, &self.path_of(key), found, expected);
    }

    fn complain_at(&self, place: usize, key: &str, found: impl Into<String>, expected: impl Into<String>) {
        self.collector.add(Some(place), &self.path_of(key), found, expected);
    }

    fn take(&mut self, key: &'static str) -> Option<(usize, &'t DeValue<'t>)> {
        self.known.push(key);
        let taken = self.entries.remove(key);
        if let Some((place, _)) = taken {
            self.places.insert(key, place);
        }
        taken
    }

    fn take_required(&mut self, key: &'static str, expected: &str) -> Option<(usize, &'t DeValue<'t>)> {
        let taken = self.take(key);
        if taken.is_none() {
            self.complain(key, "nothing", expected);
        }
        taken
    }

    /// A number that must be there.
    pub(super) fn number(&mut self, key: &'static str, quantity: Quantity) -> Option<f64> {
        let (place, value) = self.take_required(key, &quantity.describe())?;
        self.checked_number(place, key, value, quantity)
    }

    /// A number that need not be there.
    pub(super) fn maybe_number(&mut self, key: &'static str, quantity: Quantity) -> Option<f64> {
        let (place, value) = self.take(key)?;
        self.checked_number(place, key, value, quantity)
    }

    /// A number with a default.
    pub(super) fn number_or(&mut self, key: &'static str, quantity: Quantity, default: f64) -> f64 {
        self.maybe_number(key, quantity).unwrap_or(default)
    }

    /// A number for the board with a default.
    pub(super) fn single_or(&mut self, key: &'static str, quantity: Quantity, default: f32) -> f32 {
        self.maybe_number(key, quantity).map_or(default, |value| value as f32)
    }

    fn checked_number(&self, place: usize, key: &str, value: &DeValue<'_>, quantity: Quantity) -> Option<f64> {
        let Some(number) = number(value) else {
            self.complain_at(place, key, describe(value), quantity.describe());
            return None;
        };
        if quantity.admits(number) {
            return Some(number);
        }
        self.complain_at(place, key, describe(value), quantity.expectation(number));
        None
    }

    /// An integer that must be there.
    pub(super) fn integer(&mut self, key: &'static str, low: u32, high: u32) -> Option<u32> {
        let (place, value) = self.take_required(key, &format!("an integer from {low} to {high}"))?;
        self.checked_integer(place, key, value, low, high)
    }

    /// An integer with a default.
    pub(super) fn integer_or(&mut self, key: &'static str, low: u32, high: u32, default: u32) -> u32 {
        let taken = self.take(key);
        taken.and_then(|(place, value)| self.checked_integer(place, key, value, low, high)).unwrap_or(default)
    }

    fn checked_integer(&self, place: usize, key: &str, value: &DeValue<'_>, low: u32, high: u32) -> Option<u32> {
        let integer = value.as_integer().and_then(|text| i64::from_str_radix(text.as_str(), text.radix()).ok());
        let checked = integer.and_then(|value| u32::try_from(value).ok()).filter(|value| (low..=high).contains(value));
        if checked.is_none() {
            self.complain_at(place, key, describe(value), format!("an integer from {low} to {high}"));
        }
        checked
    }

    /// true or false, with a default.
    pub(super) fn flag_or(&mut self, key: &'static str, default: bool) -> bool {
        let Some((place, value)) = self.take(key) else { return default };
        let flag = value.as_bool();
        if flag.is_none() {
            self.complain_at(place, key, describe(value), "true or false");
        }
        flag.unwrap_or(default)
    }

    /// One of several names, which must be there.
    pub(super) fn choice<T: Copy>(&mut self, key: &'static str, names: &[(&str, T)]) -> Option<T> {
        let (place, value) = self.take_required(key, &one_of(names))?;
        self.checked_choice(place, key, value, names)
    }

    /// One of several names, with a default.
    pub(super) fn choice_or<T: Copy>(&mut self, key: &'static str, names: &[(&str, T)], default: T) -> T {
        let taken = self.take(key);
        taken.and_then(|(place, value)| self.checked_choice(place, key, value, names)).unwrap_or(default)
    }

    fn checked_choice<T: Copy>(&self, place: usize, key: &str, value: &DeValue<'_>, names: &[(&str, T)]) -> Option<T> {
        let chosen = value.as_str().and_then(|text| names.iter().find(|(name, _)| *name == text));
        if chosen.is_none() {
            self.complain_at(place, key, describe(value), one_of(names));
        }
        chosen.map(|(_, choice)| *choice)
    }

    /// A list of numbers. `None` if absent or wrong (then reported); `count` is the length it must have, if any.
    pub(super) fn numbers(&mut self, key: &'static str, quantity: Quantity, count: Option<usize>) -> Option<Vec<f64>> {
        let (place, value) = self.take(key)?;
        self.checked_numbers(place, key, value, quantity, count)
    }

    fn checked_numbers(
        &self,
        place: usize,
        key: &str,
        value: &DeValue<'_>,
        quantity: Quantity,
        count: Option<usize>,
    ) -> Option<Vec<f64>> {
        let expected = match count {
            Some(count) => format!("a list of {count} numbers"),
            None => "a list of numbers".to_owned(),
        };
        let Some(items) = value.as_array() else {
            self.complain_at(place, key, describe(value), expected);
            return None;
        };
        if count.is_some_and(|count| count != items.len()) {
            self.complain_at(place, key, format!("a list of {}", items.len()), expected);
            return None;
        }
        let checked = items.iter().enumerate().map(|(index, item)| {
            self.checked_number(item.span().start, &format!("{key}[{index}]"), item.get_ref(), quantity)
        });
        // Collected first, so that every wrong item is reported.
        checked.collect::<Vec<_>>().into_iter().collect()
    }

    /// A list of `[a, b]` pairs, which must be there.
    pub(super) fn pairs(&mut self, key: &'static str, quantity: Quantity) -> Option<Vec<[f64; 2]>> {
        let (place, value) = self.take_required(key, "a list of [y, z] pairs")?;
        let Some(items) = value.as_array() else {
            self.complain_at(place, key, describe(value), "a list of [y, z] pairs");
            return None;
        };
        let checked = items.iter().enumerate().map(|(index, item)| {
            let name = format!("{key}[{index}]");
            let pair = self.checked_numbers(item.span().start, &name, item.get_ref(), quantity, Some(2))?;
            <[f64; 2]>::try_from(pair).ok()
        });
        checked.collect::<Vec<_>>().into_iter().collect()
    }

    /// A table below this one; `None` if it is absent (reported if `required`) or no table (always reported).
    pub(super) fn section(&mut self, key: &'static str, required: bool) -> Option<Section<'t>> {
        let taken = if required { self.take_required(key, &format!("a table [{key}]"))? } else { self.take(key)? };
        let (place, value) = taken;
        let Some(table) = value.as_table() else {
            self.complain_at(place, key, describe(value), "a table");
            return None;
        };
        Some(Section::new(self.collector, &self.path_of(key), Some(place), Some(table)))
    }

    /// A table that may be absent, in which case it is empty and every key has its default.
    pub(super) fn section_or_empty(&mut self, key: &'static str) -> Section<'t> {
        let empty = Section::new(self.collector, &self.path_of(key), self.place, None);
        self.section(key, false).unwrap_or(empty)
    }

    /// Takes a key without looking at it.
    pub(super) fn skip(&mut self, key: &'static str) {
        let _ = self.take(key);
    }

    /// Reports what is left: keys that nobody asked for.
    pub(super) fn finish(self) {
        for (key, (place, _)) in &self.entries {
            let close = self.known.iter().find(|known| stem(known) == stem(key) || differ_by_one(known, key));
            let expected = match close {
                Some(known) => format!("a known key; did you mean {known}?"),
                None => format!("one of {}", self.known.join(", ")),
            };
            self.complain_at(*place, key, "an unknown key", expected);
        }
    }
}

fn number(value: &DeValue<'_>) -> Option<f64> {
    match value {
        DeValue::Float(text) => text.as_str().parse().ok(),
        DeValue::Integer(text) => i64::from_str_radix(text.as_str(), text.radix()).ok().map(|value| value as f64),
        _ => None,
    }
}

fn describe(value: &DeValue<'_>) -> String {
    match value {
        DeValue::String(text) => format!("\"{text}\""),
        DeValue::Integer(text) => text.as_str().to_owned(),
        DeValue::Float(text) => text.as_str().to_owned(),
        DeValue::Boolean(flag) => flag.to_string(),
        DeValue::Datetime(time) => format!("the time {time}"),
        DeValue::Array(items) => format!("a list of {}", items.len()),
        DeValue::Table(_) => "a table".to_owned(),
    }
}

fn one_of<T>(names: &[(&str, T)]) -> String {
    let quoted: Vec<String> = names.iter().map(|(name, _)| format!("\"{name}\"")).collect();
    format!("one of {}", quoted.join(", "))
}

/// A key's name without its unit.
fn stem(key: &str) -> &str {
    key.rsplit_once('_').map_or(key, |(stem, _)| stem)
}

/// Tells whether one inserted, dropped or changed character makes one key the other.
fn differ_by_one(a: &str, b: &str) -> bool {
    let (a, b) = (a.as_bytes(), b.as_bytes());
    let prefix = a.iter().zip(b).take_while(|(x, y)| x == y).count();
    let suffix = a.iter().rev().zip(b.iter().rev()).take_while(|(x, y)| x == y).count();
    let longest = a.len().max(b.len());
    a.len().abs_diff(b.len()) <= 1 && prefix + suffix + 1 >= longest
}
