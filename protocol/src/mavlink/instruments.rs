//! What instruments tell ground stations, read like [`super::Incoming`]: the board has no use for it, and no room.

use super::RawFrame;
use crate::beams::Beam;

/// A reading for people.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Instrument {
    /// A range sensor's reading, `DISTANCE_SENSOR`.
    Range {
        /// Where it looks, if along one of the body's four directions across the tunnel.
        beam: Option<Beam>,
        /// The reading, whole centimetres on the wire.
        range_m: f32,
    },
    /// The vehicle's battery, `SYS_STATUS`.
    Battery {
        /// Its voltage.
        voltage_v: Option<f32>,
        /// Share that is left.
        remaining: Option<f32>,
    },
    /// A telemetry radio, `RADIO_STATUS`: signal and noise as the radio counts them, 0 to 254.
    Radio {
        /// Signal here.
        signal: Option<u8>,
        /// Signal at the far end.
        far_signal: Option<u8>,
        /// Noise here.
        noise: Option<u8>,
    },
}

impl Instrument {
    /// Reads a frame; `None` if it is of another kind.
    pub fn read(frame: &RawFrame) -> Option<Self> {
        let known = |value: u8| Some(value).filter(|value| *value != u8::MAX);
        Some(match frame.message {
            // SYS_STATUS: three sets of sensors, load, voltage, current, seven counts, remaining.
            1 => Self::Battery {
                voltage_v: Some(frame.u16(14))
                    .filter(|mv| ![0, u16::MAX].contains(mv))
                    .map(|mv| f32::from(mv) / 1000.0),
                remaining: Some(frame.u8(30))
                    .filter(|percent| *percent <= 100)
                    .map(|percent| f32::from(percent) / 100.0),
            },
            // RADIO_STATUS: receive errors, corrected, signal, far signal, buffer, noise, far noise.
            109 => {
                Self::Radio { signal: known(frame.u8(4)), far_signal: known(frame.u8(5)), noise: known(frame.u8(7)) }
            }
            // DISTANCE_SENSOR: time, least, most, current, type, id, orientation, ...
            132 => Self::Range {
                range_m: f32::from(frame.u16(8)) / 100.0,
                beam: match frame.u8(12) {
                    24 => Some(Beam::Up),
                    2 => Some(Beam::Right),
                    25 => Some(Beam::Down),
                    6 => Some(Beam::Left),
                    _ => None,
                },
            },
            _ => return None,
        })
    }
}

#[cfg(test)]
mod tests {
    use mavlink::dialects::common::{RADIO_STATUS_DATA, SYS_STATUS_DATA};

    use super::*;
    use crate::mavlink::{FrameDecoder, RangeReport, Sender};

    fn read(bytes: &[u8]) -> Option<Instrument> {
        let mut decoder = FrameDecoder::default();
        Instrument::read(&bytes.iter().find_map(|byte| decoder.push(*byte)).expect("a frame"))
    }

    #[test]
    fn a_range_is_read_as_the_board_says_it() {
        for beam in Beam::ALL {
            let report = RangeReport { beam, range_m: 1.47, limits_m: [0.2, 14.0] };
            let frame = Sender::new(1, 191).range(5, &report);
            assert_eq!(read(&frame), Some(Instrument::Range { beam: Some(beam), range_m: 1.47 }));
        }
    }

    #[test]
    fn battery_and_radio_are_read_as_the_crate_writes_them() {
        let battery = Instrument::Battery { voltage_v: Some(15.2), remaining: Some(0.63) };
        assert_eq!(read(&Sender::new(1, 1).battery(15.2, 0.63)), Some(battery));
        let radio = RADIO_STATUS_DATA { rssi: 180, remrssi: 170, noise: 40, ..Default::default() };
        let expected = Instrument::Radio { signal: Some(180), far_signal: Some(170), noise: Some(40) };
        assert_eq!(read(&Sender::new(1, 1).frame(&radio)), Some(expected));
    }

    #[test]
    fn what_is_not_known_is_no_reading() {
        let status = SYS_STATUS_DATA { voltage_battery: u16::MAX, battery_remaining: -1, ..Default::default() };
        let unknown = Instrument::Battery { voltage_v: None, remaining: None };
        assert_eq!(read(&Sender::new(1, 1).frame(&status)), Some(unknown));
    }
}
