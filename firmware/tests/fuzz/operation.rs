//! What can happen to the link, one thing after the other, and its bytes in the corpus.

/// How the board is set up.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct Setup(pub(crate) u8);

impl Setup {
    /// Is there a key?
    pub(crate) const KEY: u8 = 1;
    /// Must telemetry be signed?
    pub(crate) const SIGNED_TELEMETRY: u8 = 1 << 1;
    /// Does the board lead?
    pub(crate) const LEADS: u8 = 1 << 2;
    /// Is the axis a parameter?
    pub(crate) const AXIS: u8 = 1 << 3;
    /// Two bits: what a run before has borrowed, 0 is nothing.
    pub(crate) const BORROWED: u8 = 4;
    /// Two bits: what the camera tells.
    pub(crate) const WIRING: u8 = 6;

    /// Whether a bit is set.
    pub(crate) fn has(self, bit: u8) -> bool {
        self.0 & bit != 0
    }
}

/// One thing.
#[derive(Clone, Debug, PartialEq)]
pub(crate) enum Operation {
    /// Bytes come in at port 0, the autopilot's, or 1.
    Receive { port: u8, bytes: Vec<u8> },
    /// Time goes by.
    Wait { us: u64 },
    /// The controller has stepped; numbers by their bits, the mode by its place.
    Note { mode: u8, limit: Option<u32>, offset: Option<u32>, captures: u32 },
    /// Something goes into the log.
    Entry { kind: u8, capture: u32, state: u8 },
    /// Everything that is due goes out.
    Drain,
    /// What is to be kept is kept, or not.
    Kept { ok: bool },
    /// The card answers: 0 well, 1 briefly, 2 nothing, 3 what was not asked, 4 beyond the end.
    Logs { kind: u8, length: u16 },
    /// A parameter is set, past the link.
    Set { index: u8, whole: bool, bits: u32 },
}

impl Operation {
    /// Does it count as an input?
    pub(crate) fn is_input(&self) -> bool {
        matches!(self, Self::Receive { .. } | Self::Set { .. })
    }
}

/// A run of the link from its start.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct Case {
    pub(crate) setup: Setup,
    pub(crate) operations: Vec<Operation>,
}

impl Case {
    /// As it lies in the corpus.
    pub(crate) fn write(&self) -> Vec<u8> {
        let mut out = vec![self.setup.0];
        for operation in &self.operations {
            write(operation, &mut out);
        }
        out
    }

    /// As it came from the corpus; what makes no sense ends it.
    pub(crate) fn read(bytes: &[u8]) -> Self {
        let mut reader = Reader(bytes);
        let setup = Setup(reader.u8().unwrap_or_default());
        let operations = core::iter::from_fn(|| reader.operation()).collect();
        Self { setup, operations }
    }
}

fn write(operation: &Operation, out: &mut Vec<u8>) {
    let optional = |out: &mut Vec<u8>, bits: Option<u32>| {
        out.push(u8::from(bits.is_some()));
        out.extend_from_slice(&bits.unwrap_or_default().to_le_bytes());
    };
    match operation {
        Operation::Receive { port, bytes } => {
            out.extend_from_slice(&[0, *port]);
            out.extend_from_slice(&(bytes.len() as u16).to_le_bytes());
            out.extend_from_slice(bytes);
        }
        Operation::Wait { us } => {
            out.push(1);
            out.extend_from_slice(&us.to_le_bytes());
        }
        Operation::Note { mode, limit, offset, captures } => {
            out.extend_from_slice(&[2, *mode]);
            optional(out, *limit);
            optional(out, *offset);
            out.extend_from_slice(&captures.to_le_bytes());
        }
        Operation::Entry { kind, capture, state } => {
            out.extend_from_slice(&[3, *kind, *state]);
            out.extend_from_slice(&capture.to_le_bytes());
        }
        Operation::Drain => out.push(4),
        Operation::Kept { ok } => out.extend_from_slice(&[5, u8::from(*ok)]),
        Operation::Logs { kind, length } => {
            out.extend_from_slice(&[6, *kind]);
            out.extend_from_slice(&length.to_le_bytes());
        }
        Operation::Set { index, whole, bits } => {
            out.extend_from_slice(&[7, *index, u8::from(*whole)]);
            out.extend_from_slice(&bits.to_le_bytes());
        }
    }
}

/// A number that may be missing.
struct Bits(Option<u32>);

struct Reader<'a>(&'a [u8]);

impl Reader<'_> {
    fn take(&mut self, count: usize) -> Option<&[u8]> {
        let (taken, rest) = self.0.split_at_checked(count)?;
        self.0 = rest;
        Some(taken)
    }

    fn array<const N: usize>(&mut self) -> Option<[u8; N]> {
        self.take(N)?.try_into().ok()
    }

    fn u8(&mut self) -> Option<u8> {
        self.array().map(u8::from_le_bytes)
    }

    fn u16(&mut self) -> Option<u16> {
        self.array().map(u16::from_le_bytes)
    }

    fn u32(&mut self) -> Option<u32> {
        self.array().map(u32::from_le_bytes)
    }

    /// `None` where the case ends.
    fn optional(&mut self) -> Option<Bits> {
        let is_there = self.u8()? != 0;
        self.u32().map(|bits| Bits(is_there.then_some(bits)))
    }

    fn operation(&mut self) -> Option<Operation> {
        Some(match self.u8()? {
            0 => {
                let (port, length) = (self.u8()?, self.u16()?);
                Operation::Receive { port, bytes: self.take(length.into())?.to_vec() }
            }
            1 => Operation::Wait { us: u64::from_le_bytes(self.array()?) },
            2 => Operation::Note {
                mode: self.u8()?,
                limit: self.optional()?.0,
                offset: self.optional()?.0,
                captures: self.u32()?,
            },
            3 => Operation::Entry { kind: self.u8()?, state: self.u8()?, capture: self.u32()? },
            4 => Operation::Drain,
            5 => Operation::Kept { ok: self.u8()? != 0 },
            6 => Operation::Logs { kind: self.u8()?, length: self.u16()? },
            7 => Operation::Set { index: self.u8()?, whole: self.u8()? != 0, bits: self.u32()? },
            _ => return None,
        })
    }
}
