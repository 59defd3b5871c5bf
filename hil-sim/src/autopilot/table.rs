//! The parameters of an autopilot: what it flies with, and what its permanent memory holds.

use std::collections::BTreeMap;

use adit_protocol::mavlink::{Encoding, OutFrame, RawValue, Sender, Value};

/// `MAV_PARAM_TYPE` of PX4's two types.
const INT32: u8 = 6;
const REAL32: u8 = 9;

/// One of them.
#[derive(Clone, Debug)]
struct Parameter {
    name: &'static str,
    value: Value,
    saved: Value,
    /// When what was changed goes to the permanent memory.
    saves_s: Option<f64>,
    read_only: bool,
}

/// What came of a wish to change one.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Change {
    /// There is no such parameter, or this is no value for it: nothing is said.
    Dropped,
    /// It may not be changed; its place in the table.
    Denied(usize),
    /// It has this value now; its place in the table.
    Taken(usize),
}

/// All of them, in the order in which they are listed.
#[derive(Clone, Debug)]
pub(super) struct Table {
    parameters: Vec<Parameter>,
    /// From a change to the permanent memory.
    save_delay_s: f64,
    saves: u32,
}

impl Table {
    /// A table with the values of the factory. What is changed is saved after `save_delay_s`.
    pub(super) fn new(values: &[(&'static str, Value)], read_only: &[&str], save_delay_s: f64) -> Self {
        let parameter = |&(name, value): &(&'static str, Value)| Parameter {
            name,
            value,
            saved: value,
            saves_s: None,
            read_only: read_only.contains(&name),
        };
        Self { parameters: values.iter().map(parameter).collect(), save_delay_s, saves: 0 }
    }

    fn find(&self, name: &str) -> Option<usize> {
        self.parameters.iter().position(|parameter| parameter.name == name)
    }

    /// A value as a real number; zero if there is none of that name.
    pub(super) fn real(&self, name: &str) -> f64 {
        self.find(name).map_or(0.0, |index| f64::from(self.parameters[index].value.real()))
    }

    /// As its owner sets it up before the flight; false if there is none of that name.
    pub(super) fn set_up(&mut self, name: &str, value: f32) -> bool {
        let Some(index) = self.find(name) else { return false };
        let parameter = &mut self.parameters[index];
        parameter.value = alike(parameter.value, value);
        parameter.saved = parameter.value;
        true
    }

    /// Changes one by its own decision, as PX4 does.
    pub(super) fn change(&mut self, now_s: f64, name: &str, value: f64) {
        if let Some(index) = self.find(name) {
            let value = alike(self.parameters[index].value, value as f32);
            self.take(now_s, index, value);
        }
    }

    /// `PARAM_SET`. `ArduPilot` takes the field for a single whatever its type, PX4 wants the very type.
    pub(super) fn set(&mut self, now_s: f64, name: &str, raw: RawValue, encoding: Encoding) -> Change {
        let Some(index) = self.find(name) else { return Change::Dropped };
        let parameter = &self.parameters[index];
        let kind = if matches!(parameter.value, Value::Real(_)) { REAL32 } else { INT32 };
        let value = match encoding {
            Encoding::Cast => {
                let single = f32::from_le_bytes(raw.bytes);
                if !single.is_finite() {
                    return Change::Dropped;
                }
                alike(parameter.value, single)
            }
            Encoding::Bytewise if raw.kind == kind => match Value::read(raw, encoding) {
                Some(value) => value,
                None => return Change::Dropped,
            },
            Encoding::Bytewise => return Change::Dropped,
        };
        if parameter.read_only {
            return Change::Denied(index);
        }
        self.take(now_s, index, value);
        Change::Taken(index)
    }

    fn take(&mut self, now_s: f64, index: usize, value: Value) {
        let parameter = &mut self.parameters[index];
        if parameter.value != value {
            parameter.value = value;
            parameter.saves_s = Some(now_s + self.save_delay_s);
            self.save_due(now_s);
        }
    }

    /// Saves what is due.
    pub(super) fn save_due(&mut self, now_s: f64) {
        for parameter in &mut self.parameters {
            if parameter.saves_s.is_some_and(|at_s| at_s <= now_s) {
                (parameter.saves_s, parameter.saved) = (None, parameter.value);
                self.saves += 1;
            }
        }
    }

    /// As after a loss of power.
    pub(super) fn reload(&mut self, now_s: f64) {
        self.save_due(now_s);
        for parameter in &mut self.parameters {
            (parameter.value, parameter.saves_s) = (parameter.saved, None);
        }
    }

    /// Changes that went to the permanent memory.
    pub(super) fn saves(&self) -> u32 {
        self.saves
    }

    /// How many there are.
    pub(super) fn len(&self) -> usize {
        self.parameters.len()
    }

    /// The one with this place or, where the place is negative, this name.
    pub(super) fn asked(&self, index: i16, name: Option<&str>) -> Option<usize> {
        match usize::try_from(index) {
            Ok(index) => (index < self.len()).then_some(index),
            Err(_) => self.find(name?),
        }
    }

    /// `PARAM_VALUE` of one.
    pub(super) fn tell(&self, sender: &mut Sender, index: usize, encoding: Encoding) -> OutFrame {
        let parameter = &self.parameters[index];
        sender.parameter_value(parameter.name, parameter.value.write(encoding), [index as u16, self.len() as u16])
    }

    /// All values, for comparing.
    pub(super) fn snapshot(&self) -> BTreeMap<&'static str, f64> {
        self.parameters.iter().map(|parameter| (parameter.name, f64::from(parameter.value.real()))).collect()
    }
}

/// A number as a value of the same type.
fn alike(like: Value, number: f32) -> Value {
    match like {
        Value::Real(_) => Value::Real(number),
        Value::Whole(_) => Value::Whole(number.round() as i32),
    }
}
