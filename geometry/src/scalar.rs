//! The scalar that every formula here is generic over.

use nalgebra::RealField;

/// `f32` on the board, `f64` on hosts.
pub trait Real: RealField + Copy {
    /// The scalar nearest to `value`.
    fn of(value: f64) -> Self {
        nalgebra::convert(value)
    }

    /// The scalar nearest to a count. (Never through `f64`, which the board computes in software.)
    fn count(value: u32) -> Self;

    /// The whole part as an index; zero for negative values and NaN.
    fn to_index(self) -> usize;

    /// The value as `f64`, for reports.
    fn to_f64(self) -> f64;
}

impl Real for f32 {
    fn of(value: f64) -> Self {
        value as Self
    }

    fn count(value: u32) -> Self {
        value as Self
    }

    fn to_index(self) -> usize {
        self as usize
    }

    fn to_f64(self) -> f64 {
        f64::from(self)
    }
}

impl Real for f64 {
    fn of(value: f64) -> Self {
        value
    }

    fn count(value: u32) -> Self {
        Self::from(value)
    }

    fn to_index(self) -> usize {
        self as usize
    }

    fn to_f64(self) -> f64 {
        self
    }
}
