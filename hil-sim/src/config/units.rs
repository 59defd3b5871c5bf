//! Units of the mission file: degrees and millimetres outside, radians and metres inside.
#![expect(clippy::trivially_copy_pass_by_ref, reason = "serde hands values over by reference")]

/// Degrees in the file, radians in memory.
pub(super) mod degrees {
    use serde::{Deserialize, Deserializer, Serialize, Serializer};

    pub(in crate::config) fn serialize<S: Serializer>(value: &f64, to: S) -> Result<S::Ok, S::Error> {
        value.to_degrees().serialize(to)
    }

    pub(in crate::config) fn deserialize<'de, D: Deserializer<'de>>(from: D) -> Result<f64, D::Error> {
        f64::deserialize(from).map(f64::to_radians)
    }
}

/// Millimetres in the file, metres in memory.
pub(super) mod millimetres {
    use serde::{Deserialize, Deserializer, Serialize, Serializer};

    pub(in crate::config) fn serialize<S: Serializer>(value: &f64, to: S) -> Result<S::Ok, S::Error> {
        (value * 1000.0).serialize(to)
    }

    pub(in crate::config) fn deserialize<'de, D: Deserializer<'de>>(from: D) -> Result<f64, D::Error> {
        f64::deserialize(from).map(|mm| mm / 1000.0)
    }
}
