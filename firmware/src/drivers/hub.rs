//! `TeraRanger` Hub One and Hub Evo: up to eight sensors in one stream of bytes (UART or USB).
//!
//! A frame is `'T' 'H'`, eight distances in millimetres (big endian), on the Evo hub a mask, and the checksum of all
//! that (maker's `teraranger_one.h`, `teraranger_evo.h`).
//!
//! The parser looks, after every byte, whether the last bytes are a whole frame with the right letters and the right
//! checksum. So there is no state to lose: whatever stands around a frame, acknowledgements of commands among it, and
//! wherever 'T' occurs in its data, an intact frame is found. Parsers that start over at each 'T' lose every frame with
//! a distance of 84 mm modulo 256. The price is that bytes which only look like a frame pass with a chance of 1 in 256;
//! in an undisturbed stream they look like one only where a range is 18.4 m or more ("TH" as a number is 21.576 m).

use super::TERABEE_CRC;

/// Sensors on a hub.
pub const SENSORS: usize = 8;

const ONE_FRAME_BYTES: usize = 2 + 2 * SENSORS + 1;
const EVO_FRAME_BYTES: usize = ONE_FRAME_BYTES + 1;

/// Commands of the Evo hub: the last byte is the checksum of those before (helper headers of the maker's ROS driver).
pub mod evo {
    /// Distances come as binary frames, not as text.
    pub const BINARY: &[u8] = &[0x00, 0x11, 0x02, 0x4C];
    /// The stream begins.
    pub const STREAM_ON: &[u8] = &[0x00, 0x52, 0x02, 0x01, 0xDF];
    /// The stream ends.
    pub const STREAM_OFF: &[u8] = &[0x00, 0x52, 0x02, 0x00, 0xD8];
    /// Sensors fire one after another, so that none sees another's light.
    pub const FIRE_IN_TURN: &[u8] = &[0x00, 0x31, 0x02, 0xE2];
    /// Fifty frames a second.
    pub const RATE_50_HZ: &[u8] = &[0x00, 0x52, 0x03, 0x02, 0xC3];
    /// A hundred frames a second.
    pub const RATE_100_HZ: &[u8] = &[0x00, 0x52, 0x03, 0x03, 0xC4];
    /// The hub's own inertial unit stays silent.
    pub const IMU_OFF: &[u8] = &[0x00, 0x41, 0x01, 0x49];
    /// What to send after power-up, in this order: the stream begins only when all else is set.
    pub const START_UP: &[&[u8]] = &[STREAM_OFF, BINARY, FIRE_IN_TURN, RATE_100_HZ, IMU_OFF, STREAM_ON];
}

/// Commands of the One hub: three letters each (maker's `teraranger_one.h`).
pub mod one {
    /// Distances come as binary frames, not as text.
    pub const BINARY: &[u8] = b"BBB";
    /// Precise mode: 600 readings a second, 40 mm.
    pub const PRECISE: &[u8] = b"PPP";
    /// All eight sensors, connected or not.
    pub const EIGHT_SENSORS: &[u8] = b"CFF";
    /// What to send after each power-up, for the hub forgets it.
    pub const START_UP: &[&[u8]] = &[BINARY, PRECISE, EIGHT_SENSORS];
}

/// Which hub it is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum HubKind {
    /// Hub One: frames of 19 bytes at 115200 baud.
    One,
    /// Hub Evo: frames of 20 bytes, with a mask.
    Evo,
}

impl HubKind {
    /// The commands to send after power-up, in this order.
    pub fn start_up(self) -> &'static [&'static [u8]] {
        match self {
            Self::One => one::START_UP,
            Self::Evo => evo::START_UP,
        }
    }

    fn frame_bytes(self) -> usize {
        match self {
            Self::One => ONE_FRAME_BYTES,
            Self::Evo => EVO_FRAME_BYTES,
        }
    }
}

/// A frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct HubFrame {
    /// Raw distances, special values included, in the order of the hub's sockets.
    pub ranges_mm: [u16; SENSORS],
    /// The mask of an Evo hub.
    pub mask: Option<u8>,
}

/// Finds frames in a stream of bytes.
#[derive(Clone, Copy, Debug)]
pub struct HubParser {
    kind: HubKind,
    /// The latest bytes, the newest last.
    window: [u8; EVO_FRAME_BYTES],
}

impl HubParser {
    /// A parser that has seen nothing.
    pub fn new(kind: HubKind) -> Self {
        Self { kind, window: [0; EVO_FRAME_BYTES] }
    }

    /// Takes the next byte; returns the frame that it completes.
    pub fn push(&mut self, byte: u8) -> Option<HubFrame> {
        self.window.rotate_left(1);
        *self.window.last_mut()? = byte;
        let frame = self.window.get(EVO_FRAME_BYTES - self.kind.frame_bytes()..)?;
        let (checksum, content) = frame.split_last()?;
        let [b'T', b'H', data @ ..] = content else { return None };
        if TERABEE_CRC.checksum(content) != *checksum {
            return None;
        }
        let (ranges, rest) = data.as_chunks::<2>();
        let mut ranges_mm = [0; SENSORS];
        for (range_mm, bytes) in ranges_mm.iter_mut().zip(ranges) {
            *range_mm = u16::from_be_bytes(*bytes);
        }
        Some(HubFrame { ranges_mm, mask: rest.first().copied() })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn encode(frame: &HubFrame) -> Vec<u8> {
        let mut bytes = b"TH".to_vec();
        bytes.extend(frame.ranges_mm.iter().flat_map(|range_mm| range_mm.to_be_bytes()));
        bytes.extend(frame.mask);
        bytes.push(TERABEE_CRC.checksum(&bytes));
        bytes
    }

    /// Every frame found, with the index of its last byte.
    fn parse(kind: HubKind, bytes: &[u8]) -> Vec<(usize, HubFrame)> {
        let mut parser = HubParser::new(kind);
        bytes.iter().enumerate().filter_map(|(index, byte)| parser.push(*byte).map(|frame| (index, frame))).collect()
    }

    fn frames(kind: HubKind, bytes: &[u8]) -> Vec<HubFrame> {
        parse(kind, bytes).into_iter().map(|(_, frame)| frame).collect()
    }

    fn frame(kind: HubKind, ranges_mm: [u16; SENSORS]) -> HubFrame {
        HubFrame { ranges_mm, mask: (kind == HubKind::Evo).then_some(0x55) }
    }

    #[test]
    fn frames_have_the_length_of_their_hub() {
        let ranges_mm = [1, 200, 3000, 0xFFFF, 0, 5, 6, 7];
        for (kind, length) in [(HubKind::One, 19), (HubKind::Evo, 20)] {
            let frame = frame(kind, ranges_mm);
            let bytes = encode(&frame);
            assert_eq!(bytes.len(), length);
            assert_eq!(parse(kind, &bytes), [(length - 1, frame)]);
        }
    }

    #[test]
    fn a_known_stream_decodes() {
        // By hand: eight times 1000 mm (03 E8); the checksums by an implementation bit by bit.
        let mut bytes = b"TH".to_vec();
        for _ in 0..8 {
            bytes.extend([0x03, 0xE8]);
        }
        let bitwise = |bytes: &[u8]| {
            bytes.iter().fold(0_u8, |crc, byte| {
                (0..8).fold(crc ^ byte, |crc, _| if crc & 0x80 == 0 { crc << 1 } else { crc << 1 ^ 0x07 })
            })
        };
        bytes.push(bitwise(&bytes));
        assert_eq!(frames(HubKind::One, &bytes), [HubFrame { ranges_mm: [1000; 8], mask: None }]);
    }

    #[test]
    fn a_t_in_the_data_loses_no_frame() {
        // 0x54 is 'T': as low byte, as high byte, and "TH" itself in the last place.
        for kind in [HubKind::One, HubKind::Evo] {
            let sent: Vec<_> = (0..50)
                .map(|index| frame(kind, [0x0054, 0x5400, 0x0154, 0x0054, 0x5454, 0x0254, 3000 + index, 0x5448]))
                .collect();
            let bytes: Vec<u8> = sent.iter().flat_map(encode).collect();
            let found = parse(kind, &bytes);
            for (index, frame) in sent.iter().enumerate() {
                let end = (index + 1) * kind.frame_bytes() - 1;
                assert!(found.contains(&(end, *frame)), "{kind:?}: frame {index} is lost");
            }
        }
    }

    #[test]
    fn a_frame_with_a_wrong_byte_is_dropped_and_the_next_one_found() {
        let good = frame(HubKind::Evo, [1234; 8]);
        for place in 0..EVO_FRAME_BYTES {
            let mut bytes = encode(&frame(HubKind::Evo, [4321; 8]));
            bytes[place] ^= 0x10;
            bytes.extend(encode(&good));
            assert_eq!(frames(HubKind::Evo, &bytes), [good], "byte {place}");
        }
    }

    #[test]
    fn a_frame_cut_short_does_not_swallow_the_next_one() {
        let good = frame(HubKind::One, [84; 8]);
        for kept in 0..ONE_FRAME_BYTES {
            let mut bytes = encode(&frame(HubKind::One, [4321; 8]));
            bytes.truncate(kept);
            bytes.extend(encode(&good));
            assert!(parse(HubKind::One, &bytes).contains(&(bytes.len() - 1, good)), "{kept} bytes kept");
        }
    }

    #[test]
    fn acknowledgements_between_frames_are_skipped() {
        let frame = frame(HubKind::Evo, [2500; 8]);
        let mut bytes = Vec::new();
        for (command, answer) in [(0x10, 0x00), (0x50, 0xFF), (0x30, 0x00)] {
            let mut acknowledgement = vec![0x30, command, answer];
            acknowledgement.push(TERABEE_CRC.checksum(&acknowledgement));
            bytes.extend(acknowledgement);
            bytes.extend(encode(&frame));
        }
        assert_eq!(frames(HubKind::Evo, &bytes), [frame; 3]);
    }

    #[test]
    fn commands_of_the_evo_hub_end_in_their_checksum() {
        for command in evo::START_UP.iter().chain(&[evo::RATE_50_HZ]) {
            let (checksum, content) = command.split_last().unwrap();
            assert_eq!(TERABEE_CRC.checksum(content), *checksum, "{command:x?}");
        }
        assert_eq!(evo::START_UP.last(), Some(&evo::STREAM_ON));
        assert!(one::START_UP.iter().all(|command| command.len() == 3));
    }

    /// A range, often one with 'T' or 'H' in it.
    fn any_range() -> impl Strategy<Value = u16> {
        prop_oneof![
            any::<u16>(),
            Just(0x5448),
            Just(0x0054),
            Just(0x5400),
            (0_u16..60).prop_map(|high| high << 8 | 0x54)
        ]
    }

    /// Garbage, rich in letters that begin frames and acknowledgements.
    fn any_garbage() -> impl Strategy<Value = Vec<u8>> {
        let byte = prop_oneof![any::<u8>(), Just(b'T'), Just(b'H'), Just(0x30), Just(0)];
        prop::collection::vec(byte, 0..60)
    }

    proptest! {
        #[test]
        fn every_intact_frame_is_found_in_any_garbage(
            evo in any::<bool>(),
            parts in prop::collection::vec((any_garbage(), prop::array::uniform8(any_range()), any::<u8>()), 1..12),
        ) {
            let kind = if evo { HubKind::Evo } else { HubKind::One };
            let mut bytes = Vec::new();
            let mut sent = Vec::new();
            for (garbage, ranges_mm, mask) in parts {
                let frame = HubFrame { ranges_mm, mask: evo.then_some(mask) };
                bytes.extend(garbage);
                bytes.extend(encode(&frame));
                sent.push((bytes.len() - 1, frame));
            }
            let found = parse(kind, &bytes);
            for frame in sent {
                prop_assert!(found.contains(&frame), "lost: {:?}", frame);
            }
        }

        #[test]
        fn what_is_found_was_in_the_stream(bytes in prop::collection::vec(any::<u8>(), 0..200)) {
            for kind in [HubKind::One, HubKind::Evo] {
                for (end, frame) in parse(kind, &bytes) {
                    let encoded = encode(&frame);
                    prop_assert_eq!(&bytes[end + 1 - encoded.len()..=end], &encoded[..]);
                }
            }
        }
    }
}
