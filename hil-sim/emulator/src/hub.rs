//! A `TeraRanger` Hub on UART4: streams the ranges of up to eight sensors, and obeys the commands that start it.
//!
//! Evo: 'T' 'H', eight distances (millimetres, big endian), a mask of sensors, CRC-8; silent until it is enabled, every
//! command acknowledged. One: the same without mask, streaming from power-up, commands without acknowledgement. Sources:
//! Terabee `teraranger_array`, `teraranger_evo.h` (`RANGES_FRAME_LENGTH` 20) and `teraranger_one.h` (`BUFFER_SIZE` 19).

use adit_protocol::beams::Beam;
use adit_protocol::parameters::{RangeFamily, RangeParameters};
use crc::{CRC_8_SMBUS, Crc};

use crate::machine::Sensed;

/// Frames come this far apart: 50 a second.
const PERIOD_US: u64 = 20_000;
const SENSORS: usize = 8;
/// A channel with nothing on it.
const NOTHING: u16 = 0xFFFF;
const ENABLE: [u8; 4] = [0x52, 0x02, 0x01, 0xDF];
const DISABLE: [u8; 4] = [0x52, 0x02, 0x00, 0xD8];
const ADDRESS: u8 = 0x00;
const ACKNOWLEDGED: u8 = 0x30;
const HUB_CRC: Crc<u8> = Crc::<u8>::new(&CRC_8_SMBUS);

/// The Hub.
#[derive(Clone, Debug)]
pub(crate) struct Hub {
    parameters: RangeParameters,
    streaming: bool,
    due_us: u64,
    heard: Vec<u8>,
    acknowledgements: Vec<u8>,
}

impl Hub {
    pub(crate) fn new(parameters: &RangeParameters) -> Self {
        Self {
            parameters: *parameters,
            streaming: parameters.family != RangeFamily::Evo,
            due_us: 0,
            heard: Vec::new(),
            acknowledgements: Vec::new(),
        }
    }

    /// Hears what the board says.
    pub(crate) fn hear(&mut self, bytes: &[u8]) {
        if self.parameters.family != RangeFamily::Evo {
            return;
        }
        self.heard.extend(bytes);
        while let Some(start) = self.heard.iter().position(|byte| *byte == ADDRESS) {
            self.heard.drain(..start);
            // 00, a byte whose low nibble counts what follows it before the CRC, then those, then the CRC.
            let Some(length) = self.heard.get(1).map(|byte| 3 + usize::from(byte & 0x0F)) else { return };
            let Some(command) = self.heard.get(..length) else { return };
            if HUB_CRC.checksum(command) != 0 {
                self.heard.drain(..1);
                continue;
            }
            match &command[1..] {
                rest if *rest == ENABLE => self.streaming = true,
                rest if *rest == DISABLE => self.streaming = false,
                _ => {}
            }
            let answered = command[1] & 0xF0;
            let mut answer = vec![ACKNOWLEDGED, answered, 0x00];
            answer.push(HUB_CRC.checksum(&answer));
            self.acknowledgements.extend(answer);
            self.heard.drain(..length);
        }
    }

    /// What the Hub says now.
    pub(crate) fn say(&mut self, now_us: u64, sensed: &Sensed) -> Vec<u8> {
        let mut bytes = std::mem::take(&mut self.acknowledgements);
        if self.streaming && now_us >= self.due_us {
            self.due_us = now_us + PERIOD_US;
            bytes.extend(self.frame(sensed));
        }
        bytes
    }

    fn frame(&self, sensed: &Sensed) -> Vec<u8> {
        let mut channels = [None; SENSORS];
        let on_body = Beam::ALL.into_iter().filter(|beam| *self.parameters.fitted.get(*beam));
        let mut places: Vec<(u8, Option<u16>)> =
            on_body.map(|beam| (*self.parameters.port.get(beam), *sensed.ranges_mm.get(beam))).collect();
        places.extend(self.parameters.head_fitted.then_some((self.parameters.head_port, sensed.head_mm)));
        for (port, raw_mm) in places {
            if let Some(channel) = channels.get_mut(usize::from(port)) {
                *channel = raw_mm;
            }
        }
        let mut frame = b"TH".to_vec();
        frame.extend(channels.iter().flat_map(|raw_mm| raw_mm.unwrap_or(NOTHING).to_be_bytes()));
        if self.parameters.family == RangeFamily::Evo {
            let bits = channels.iter().enumerate().map(|(nth, raw_mm)| u8::from(raw_mm.is_some()) << nth);
            frame.push(bits.sum());
        }
        frame.push(HUB_CRC.checksum(&frame));
        frame
    }
}

#[cfg(test)]
mod tests {
    use adit_protocol::beams::Beams;

    use super::*;

    fn parameters(family: RangeFamily) -> RangeParameters {
        let port = Beams { up: 0, right: 2, down: 4, left: 6 };
        RangeParameters { family, port, ..RangeParameters::default() }
    }

    fn sensed() -> Sensed {
        let ranges_mm = Beams { up: Some(1000), right: Some(2000), down: None, left: Some(0x5448) };
        Sensed { ranges_mm, ..Sensed::default() }
    }

    #[test]
    fn an_evo_hub_streams_once_it_is_enabled() {
        let mut hub = Hub::new(&parameters(RangeFamily::Evo));
        assert!(hub.say(0, &sensed()).is_empty());
        hub.hear(&[0xAA, 0x00]);
        hub.hear(&ENABLE);
        let said = hub.say(0, &sensed());
        assert_eq!(said[..3], [0x30, 0x50, 0x00], "acknowledged");
        let frame = &said[4..];
        assert_eq!((frame.len(), &frame[..4], frame[18]), (20, &[b'T', b'H', 0x03, 0xE8][..], 0b0100_0101));
        assert_eq!(HUB_CRC.checksum(frame), 0);
        assert!(hub.say(19_999, &sensed()).is_empty());
        assert_eq!(hub.say(20_000, &sensed()).len(), 20);
    }

    #[test]
    fn a_one_hub_streams_by_itself_without_mask() {
        let frame = Hub::new(&parameters(RangeFamily::OneHub)).say(0, &sensed());
        assert_eq!((frame.len(), &frame[10..12]), (19, &[0xFF, 0xFF][..]), "nothing on channel 4");
    }
}
