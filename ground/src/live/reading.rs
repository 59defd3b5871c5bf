//! A quantity, and how old what is known of it is.

use std::time::Duration;

use serde::Serialize;

/// The newest of a quantity.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Aged<T> {
    newest: Option<(Option<T>, Duration)>,
}

/// A quantity as it is shown.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Reading<T> {
    /// What was said last; `None` if nothing, or that there is nothing to be had.
    pub value: Option<T>,
    /// How long ago.
    pub age_s: Option<f64>,
    /// Too long ago to be believed.
    pub is_stale: bool,
}

impl<T> Default for Aged<T> {
    fn default() -> Self {
        Self { newest: None }
    }
}

impl<T> Default for Reading<T> {
    fn default() -> Self {
        Self { value: None, age_s: None, is_stale: false }
    }
}

impl<T: Clone> Aged<T> {
    pub(super) fn set(&mut self, now: Duration, value: Option<T>) {
        self.newest = Some((value, now));
    }

    /// What was said last, however long ago.
    pub(super) fn last(&self) -> Option<&T> {
        self.newest.as_ref().and_then(|(value, _)| value.as_ref())
    }

    pub(super) fn show(&self, now: Duration, lasts: Duration) -> Reading<T> {
        let Some((value, at)) = &self.newest else { return Reading::default() };
        let age = now.saturating_sub(*at);
        Reading { value: value.clone(), age_s: Some(age.as_secs_f64()), is_stale: age > lasts }
    }
}

impl<T: Clone> Reading<T> {
    /// The value, if it can be believed.
    pub fn fresh(&self) -> Option<T> {
        self.value.clone().filter(|_| !self.is_stale)
    }
}
