//! One value for each of the four body-fixed range sensors.

use serde::{Deserialize, Serialize};

/// One value per body-fixed range sensor, named by where the sensor looks in the `body` frame.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Beams<T> {
    /// Body -z.
    pub up: T,
    /// Body +y.
    pub right: T,
    /// Body +z.
    pub down: T,
    /// Body -y.
    pub left: T,
}

/// The direction a body-fixed range sensor looks in.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum Beam {
    /// Body -z.
    Up,
    /// Body +y.
    Right,
    /// Body +z.
    Down,
    /// Body -y.
    Left,
}

impl Beam {
    /// All four, in the order of the fields of [`Beams`].
    pub const ALL: [Self; 4] = [Self::Up, Self::Right, Self::Down, Self::Left];

    /// Unit vector `[y, z]` of the beam in the body frame.
    pub fn direction(self) -> [f32; 2] {
        match self {
            Self::Up => [0.0, -1.0],
            Self::Right => [1.0, 0.0],
            Self::Down => [0.0, 1.0],
            Self::Left => [-1.0, 0.0],
        }
    }
}

impl<T> Beams<T> {
    /// Builds the four values from a function of the direction.
    pub fn from_fn(mut value: impl FnMut(Beam) -> T) -> Self {
        Self { up: value(Beam::Up), right: value(Beam::Right), down: value(Beam::Down), left: value(Beam::Left) }
    }

    /// The value of one sensor.
    pub fn get(&self, beam: Beam) -> &T {
        match beam {
            Beam::Up => &self.up,
            Beam::Right => &self.right,
            Beam::Down => &self.down,
            Beam::Left => &self.left,
        }
    }

    /// The value of one sensor, to be changed.
    pub fn get_mut(&mut self, beam: Beam) -> &mut T {
        match beam {
            Beam::Up => &mut self.up,
            Beam::Right => &mut self.right,
            Beam::Down => &mut self.down,
            Beam::Left => &mut self.left,
        }
    }
}
