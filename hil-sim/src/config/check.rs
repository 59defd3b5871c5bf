//! Range checks of the mission file's values, with the path of the key.

use std::fmt;

/// A value that cannot be.
#[derive(Clone, Debug, PartialEq)]
pub struct Violation {
    /// Path of the key in the mission file.
    pub key: Vec<&'static str>,
    /// What was found, in the file's unit.
    pub found: f64,
    /// Smallest value allowed.
    pub low: f64,
    /// Largest value allowed.
    pub high: f64,
}

impl fmt::Display for Violation {
    fn fmt(&self, to: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { key, found, low, high } = self;
        write!(to, "simulation.{} is {found}; expected a value from {low} to {high}", key.join("."))
    }
}

/// Collects violations while tables are walked.
#[derive(Debug, Default)]
pub(super) struct Checker {
    table: Vec<&'static str>,
    pub(super) found: Vec<Violation>,
}

impl Checker {
    /// Checks the keys of a table.
    pub(super) fn table(&mut self, name: &'static str, check: impl FnOnce(&mut Self)) {
        self.table.push(name);
        check(self);
        self.table.pop();
    }

    pub(super) fn within(&mut self, name: &'static str, found: f64, low: f64, high: f64) {
        if !(found >= low && found <= high) {
            let key = self.table.iter().copied().chain([name]).collect();
            self.found.push(Violation { key, found, low, high });
        }
    }

    pub(super) fn finite(&mut self, name: &'static str, found: f64) {
        self.within(name, found, -1e6, 1e6);
    }

    pub(super) fn share(&mut self, name: &'static str, found: f64) {
        self.within(name, found, 0.0, 1.0);
    }

    /// Checks a size of an angle; the limit is in degrees, as the message is.
    pub(super) fn angle(&mut self, name: &'static str, found_rad: f64, high_deg: f64) {
        self.within(name, found_rad.to_degrees(), 0.0, high_deg);
    }
}
