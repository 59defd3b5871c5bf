//! The board's own parameters, for editors: listed, read, changed.
//!
//! A change is answered when it is kept; it takes effect at the board's next start. While the board scans nothing is changed.

use adit_protocol::mavlink::{Encoding, Name, OutFrame, RawValue, Sender, Value};
use adit_protocol::parameters::{ParameterTable, Parameters};

use super::Port;

/// Questions that wait for their answers.
const WAITING: usize = 16;

/// The parameters.
#[derive(Clone, Debug)]
pub(super) struct ParameterServer {
    table: ParameterTable,
    /// As the memory has them.
    stored: Parameters,
    /// A list under way: to whom, and which is next.
    list: Option<(Port, usize)>,
    answers: heapless::Deque<(Port, usize), WAITING>,
    /// Changed, and not kept yet; the oldest first.
    unkept: heapless::Vec<(Port, usize), WAITING>,
    /// Handed out to be kept, and how many of the changes are in it: more may come before the answer.
    keeping: Option<(Parameters, usize)>,
}

/// What became of a change.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Change {
    /// It will be kept, and answered then; or there was nothing to change.
    Taken,
    /// There is no such parameter: no answer.
    Unknown,
    /// It is refused; the old value is the answer.
    Refused,
}

impl ParameterServer {
    pub(super) fn new(parameters: &Parameters) -> Self {
        Self {
            table: ParameterTable::new(parameters.clone()),
            stored: parameters.clone(),
            list: None,
            answers: heapless::Deque::new(),
            unkept: heapless::Vec::new(),
            keeping: None,
        }
    }

    /// Begins a list; one under way begins anew.
    pub(super) fn list(&mut self, port: Port) {
        self.list = Some((port, 0));
    }

    /// One is asked for.
    pub(super) fn read(&mut self, port: Port, index: i16, name: Option<&Name>) {
        let by_name = || name.and_then(|name| ParameterTable::find(name));
        let index = usize::try_from(index).ok().or_else(by_name);
        if let Some(index) = index.filter(|index| *index < ParameterTable::rows().len()) {
            // Who gets no answer asks again.
            let _ = self.answers.push_back((port, index));
        }
    }

    /// One is to be changed.
    pub(super) fn set(
        &mut self,
        port: Port,
        name: Option<&Name>,
        raw: RawValue,
        encoding: Encoding,
        may: bool,
    ) -> Change {
        let Some(index) = name.and_then(|name| ParameterTable::find(name)) else { return Change::Unknown };
        let before = self.table.get(index);
        let taken = may
            && !self.unkept.is_full()
            && Value::read(raw, encoding).is_some_and(|value| self.table.set(index, value).is_ok());
        if taken && self.table.get(index) != before {
            let _ = self.unkept.push((port, index));
            return Change::Taken;
        }
        let _ = self.answers.push_back((port, index));
        if taken { Change::Taken } else { Change::Refused }
    }

    /// Parameters to be kept.
    pub(super) fn take_keep(&mut self) -> Option<Parameters> {
        if self.unkept.is_empty() || self.keeping.is_some() {
            return None;
        }
        let parameters = self.table.parameters().clone();
        self.keeping = Some((parameters.clone(), self.unkept.len()));
        Some(parameters)
    }

    /// They are kept, or cannot be; then the old ones stay.
    pub(super) fn kept(&mut self, ok: bool) {
        let Some((parameters, count)) = self.keeping.take() else { return };
        if ok {
            self.stored = parameters;
        } else {
            self.table = ParameterTable::new(self.stored.clone());
        }
        for (place, answer) in core::mem::take(&mut self.unkept).into_iter().enumerate() {
            if ok && place >= count {
                // It came after what is kept now was handed out, and is kept next.
                let _ = self.unkept.push(answer);
            } else {
                let _ = self.answers.push_back(answer);
            }
        }
    }

    /// To whom the next answer goes.
    pub(super) fn next_port(&self) -> Option<Port> {
        self.answers.front().map(|(port, _)| *port).or(self.list.map(|(port, _)| port))
    }

    /// The next answer.
    pub(super) fn next_frame(&mut self, sender: &mut Sender, encoding: Encoding) -> Option<OutFrame> {
        let rows = ParameterTable::rows();
        let index = if let Some((_, index)) = self.answers.pop_front() {
            index
        } else {
            let (port, index) = self.list?;
            self.list = (index + 1 < rows.len()).then_some((port, index + 1));
            index
        };
        let (row, value) = (rows.get(index)?, self.table.get(index)?);
        Some(sender.parameter_value(row.name, value.write(encoding), [index as u16, rows.len() as u16]))
    }
}
