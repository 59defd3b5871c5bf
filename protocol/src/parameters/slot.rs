//! Where one figure of the parameters lies, and how it goes in and out as a number.

use adit_geometry::camera::Distortion;
use adit_geometry::rig::ImageUp;

use super::{CaptureWiring, RangeBus, RangeFamily, SpeedBound, Trigger};
use crate::mavlink::Value;

/// A place among the parameters.
pub(super) enum Slot<'a> {
    /// A real number.
    Real(&'a mut f32),
    /// An angle, kept in radians, said in degrees.
    Degrees(&'a mut f32),
    /// A yaw in degrees from 0 to 360, or -1 for none.
    Yaw(&'a mut Option<f32>),
    /// A whole number.
    Byte(&'a mut u8),
    /// A whole number.
    Half(&'a mut u16),
    /// A whole number.
    Word(&'a mut u32),
    /// 0 or 1.
    Switch(&'a mut bool),
    /// One of a few.
    Choice(&'a mut dyn Choice),
    /// The section's kind or one of its sizes.
    Section(SectionFigure),
    /// A coefficient that the chosen model does not have.
    Absent,
}

/// A figure of the section.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum SectionFigure {
    /// Its kind.
    Shape,
    /// One of [`super::table::Sizes`].
    Size(usize),
}

impl Slot<'_> {
    /// The figure as it goes onto the wire; `None` for those of the section.
    pub(super) fn get(&self) -> Option<Value> {
        Some(match self {
            Self::Real(value) => Value::Real(**value),
            Self::Degrees(value) => Value::Real(value.to_degrees()),
            Self::Yaw(value) => Value::Real(value.map_or(-1.0, f32::to_degrees)),
            Self::Byte(value) => Value::Whole(i32::from(**value)),
            Self::Half(value) => Value::Whole(i32::from(**value)),
            Self::Word(value) => Value::Whole(value.cast_signed()),
            Self::Switch(value) => Value::Whole(i32::from(**value)),
            Self::Choice(choice) => Value::Whole(i32::from(choice.number())),
            Self::Absent => Value::Real(0.0),
            Self::Section(_) => return None,
        })
    }

    /// Whether it is a whole number.
    pub(super) fn is_whole(&self) -> bool {
        matches!(self.get(), Some(Value::Whole(_))) || matches!(self, Self::Section(SectionFigure::Shape))
    }

    /// Takes a value that lies within the row's bounds, whole where it must be; false if there is no such choice.
    pub(super) fn set(self, value: Value) -> bool {
        let (real, whole) = (value.real(), value.whole().unwrap_or_default());
        match self {
            Self::Real(place) => *place = real,
            Self::Degrees(place) => *place = real.to_radians(),
            Self::Yaw(place) => *place = (real >= 0.0).then(|| real.to_radians()),
            Self::Byte(place) => *place = whole as u8,
            Self::Half(place) => *place = whole as u16,
            Self::Word(place) => *place = whole.cast_unsigned(),
            Self::Switch(place) => *place = whole != 0,
            Self::Choice(choice) => return choice.choose(whole as u8),
            Self::Absent => return real == 0.0,
            Self::Section(_) => return false,
        }
        true
    }
}

/// One of a few, by number in the order of their declaration.
pub(super) trait Choice {
    /// Which it is.
    fn number(&self) -> u8;
    /// Makes it another; false if there is none of that number.
    fn choose(&mut self, number: u8) -> bool;
}

macro_rules! choices {
    ($($kind:ty: $($one:ident),+;)+) => {$(
        impl Choice for $kind {
            fn number(&self) -> u8 {
                *self as u8
            }

            fn choose(&mut self, number: u8) -> bool {
                let found = [$(Self::$one),+].into_iter().find(|one| *one as u8 == number);
                *self = found.unwrap_or(*self);
                found.is_some()
            }
        }
    )+};
}

choices! {
    SpeedBound: Paper, OneView, TwoViews;
    CaptureWiring: None, Busy, Confirm;
    Trigger: Contact, HeroBus;
    RangeFamily: Evo, One, OneHub;
    RangeBus: I2c, Hub;
    ImageUp: Forward, Backward, Clockwise, Counterclockwise;
}

impl Choice for Distortion<f32> {
    fn number(&self) -> u8 {
        match self {
            Self::BrownConrady(_) => 0,
            Self::KannalaBrandt(_) => 1,
        }
    }

    /// Another model begins without distortion: coefficients of one mean nothing in the other.
    fn choose(&mut self, number: u8) -> bool {
        if number != self.number() {
            *self = match number {
                0 => Self::BrownConrady([0.0; 5]),
                1 => Self::KannalaBrandt([0.0; 4]),
                _ => return false,
            };
        }
        true
    }
}
