//! Values of the parameter protocol: a name, a type, and four bytes that mean different things to different autopilots.
//!
//! The field is a single by its type. `ArduPilot` converts whole numbers to it, PX4 puts their bytes there
//! (mavlink.io, "Parameter Encoding"); a reader must know which, from the kind of autopilot that the system has.

use super::Autopilot;

/// Letters of a name.
pub const NAME_BYTES: usize = 16;
/// A parameter's name.
pub type Name = heapless::String<NAME_BYTES>;

/// `MAV_PARAM_TYPE` of whole numbers: bytes and signedness, in order of their numbers from 1 on.
const WHOLE: [(u8, bool); 6] = [(1, false), (1, true), (2, false), (2, true), (4, false), (4, true)];
const INT32: u8 = 6;
const REAL32: u8 = 9;

/// What the four bytes are.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Encoding {
    /// Whole numbers are converted to a single: `ArduPilot`.
    Cast,
    /// Whole numbers lie there byte by byte: PX4, and the protocol's first choice.
    Bytewise,
}

impl Encoding {
    /// The encoding of a system with this autopilot.
    pub fn of(autopilot: Option<Autopilot>) -> Self {
        match autopilot {
            Some(Autopilot::ArduPilot) => Self::Cast,
            _ => Self::Bytewise,
        }
    }
}

/// A value with its bytes not yet understood.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct RawValue {
    /// The field's bytes.
    pub bytes: [u8; 4],
    /// `MAV_PARAM_TYPE`.
    pub kind: u8,
}

/// A parameter's value.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Value {
    /// A real number.
    Real(f32),
    /// A whole number.
    Whole(i32),
}

impl Value {
    /// Understands a value; `None` if its type has no place in four bytes, or a converted whole number is none.
    pub fn read(raw: RawValue, encoding: Encoding) -> Option<Self> {
        let single = f32::from_le_bytes(raw.bytes);
        if raw.kind == REAL32 {
            return Some(Self::Real(single));
        }
        let (bytes, signed) = *WHOLE.get(usize::from(raw.kind.checked_sub(1)?))?;
        if encoding == Encoding::Cast {
            return whole(single);
        }
        let [b0, b1, ..] = raw.bytes;
        Some(Self::Whole(match (bytes, signed) {
            (1, false) => i32::from(b0),
            (1, true) => i32::from(b0.cast_signed()),
            (2, false) => i32::from(u16::from_le_bytes([b0, b1])),
            (2, true) => i32::from(i16::from_le_bytes([b0, b1])),
            // What is beyond the signed range is no value that anybody here has.
            (_, false) => i32::try_from(u32::from_le_bytes(raw.bytes)).ok()?,
            (_, true) => i32::from_le_bytes(raw.bytes),
        }))
    }

    /// The four bytes and their type.
    pub fn write(self, encoding: Encoding) -> RawValue {
        match (self, encoding) {
            (Self::Real(value), _) => RawValue { bytes: value.to_le_bytes(), kind: REAL32 },
            (Self::Whole(value), Encoding::Cast) => RawValue { bytes: (value as f32).to_le_bytes(), kind: INT32 },
            (Self::Whole(value), Encoding::Bytewise) => RawValue { bytes: value.to_le_bytes(), kind: INT32 },
        }
    }

    /// As a single.
    pub fn real(self) -> f32 {
        match self {
            Self::Real(value) => value,
            Self::Whole(value) => value as f32,
        }
    }

    /// As a whole number; `None` if it is none.
    pub fn whole(self) -> Option<i32> {
        match self {
            Self::Whole(value) => Some(value),
            Self::Real(value) => match whole(value)? {
                Self::Whole(value) => Some(value),
                Self::Real(_) => None,
            },
        }
    }
}

fn whole(value: f32) -> Option<Value> {
    let converted = value as i32;
    (converted as f32 == value).then_some(Value::Whole(converted))
}

/// The name in a field of 16 bytes, which a zero ends unless it is full; `None` unless it is of printable ASCII.
pub(super) fn name(field: [u8; NAME_BYTES]) -> Option<Name> {
    let length = field.iter().position(|byte| *byte == 0).unwrap_or(NAME_BYTES);
    let letters = core::str::from_utf8(field.get(..length)?).ok()?;
    let sound = !letters.is_empty() && letters.bytes().all(|byte| byte.is_ascii_graphic());
    Name::try_from(letters).ok().filter(|_| sound)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_encoding_reads_what_it_writes() {
        for encoding in [Encoding::Cast, Encoding::Bytewise] {
            for value in [Value::Real(-0.25), Value::Whole(921_600), Value::Whole(-3), Value::Real(f32::INFINITY)] {
                assert_eq!(Value::read(value.write(encoding), encoding), Some(value), "{encoding:?}");
            }
        }
    }

    #[test]
    fn types_of_a_byte_and_a_half_word_are_read() {
        let raw = |kind, bytes| Value::read(RawValue { bytes, kind }, Encoding::Bytewise);
        assert_eq!(raw(1, [200, 9, 9, 9]), Some(Value::Whole(200)));
        assert_eq!(raw(2, [200, 9, 9, 9]), Some(Value::Whole(-56)));
        assert_eq!(raw(4, [0xFE, 0xFF, 9, 9]), Some(Value::Whole(-2)));
        assert_eq!(raw(5, [0xFF; 4]), None);
        assert_eq!((raw(0, [0; 4]), raw(7, [0; 4]), raw(10, [0; 4]), raw(200, [0; 4])), (None, None, None, None));
    }

    #[test]
    fn a_converted_fraction_is_no_whole_number() {
        let raw = RawValue { bytes: 1.5_f32.to_le_bytes(), kind: INT32 };
        assert_eq!(Value::read(raw, Encoding::Cast), None);
        assert_eq!(Value::Real(f32::NAN).whole(), None);
        assert_eq!(Value::Real(3e9).whole(), None);
    }

    #[test]
    fn names_are_of_printable_letters() {
        let field = |letters: &[u8]| {
            let mut field = [0; NAME_BYTES];
            field[..letters.len()].copy_from_slice(letters);
            name(field)
        };
        assert_eq!(field(b"LOIT_SPEED").as_deref(), Some("LOIT_SPEED"));
        assert_eq!(field(b"SIXTEEN_LETTERS_").as_deref(), Some("SIXTEEN_LETTERS_"));
        assert_eq!((field(b""), field(b"A B"), field(&[0xC3, 0x28])), (None, None, None));
    }
}
