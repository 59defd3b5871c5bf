use adit_geometry::profile::{ChainVertex, MAX_PIECES, ProfileSpec};
use adit_protocol::log::parameters_hash;
use adit_protocol::parameters::Parameters;
use proptest::prelude::*;

use super::*;

/// The power is gone.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct PowerGone;

/// 16 KiB that take `bytes_left` more bytes before the power goes.
#[derive(Clone)]
pub(super) struct Fram {
    bytes: Vec<u8>,
    bytes_left: usize,
}

impl Fram {
    pub(super) fn filled_with(byte: u8) -> Self {
        Self { bytes: vec![byte; 16 * 1024], bytes_left: usize::MAX }
    }

    /// The same memory when power is back.
    fn again(&self) -> Self {
        Self { bytes: self.bytes.clone(), bytes_left: usize::MAX }
    }
}

impl Memory for Fram {
    type Error = PowerGone;

    fn read(&mut self, address: u16, bytes: &mut [u8]) -> Result<(), PowerGone> {
        bytes.copy_from_slice(&self.bytes[usize::from(address)..][..bytes.len()]);
        Ok(())
    }

    fn write(&mut self, address: u16, bytes: &[u8]) -> Result<(), PowerGone> {
        for (byte, place) in bytes.iter().zip(&mut self.bytes[usize::from(address)..]) {
            self.bytes_left = self.bytes_left.checked_sub(1).ok_or(PowerGone)?;
            *place = *byte;
        }
        Ok(())
    }
}

fn parameters(latency_s: f32, vertices: usize) -> Parameters {
    let mut parameters = Parameters::default();
    parameters.speed.latency_s = latency_s;
    if vertices > 0 {
        let vertex = ChainVertex { y_m: latency_s, z_m: -1.0, bulge: 0.5 };
        parameters.profile = ProfileSpec::Chain { vertices: core::iter::repeat_n(vertex, vertices).collect() };
    }
    parameters
}

fn stored_parameters(fram: &mut Fram) -> Parameters {
    ParameterStore::load(fram).unwrap().value().expect("something was saved").parameters
}

#[test]
fn parameters_come_back_with_their_hash() {
    let mut fram = Fram::filled_with(0xFF);
    let longest = parameters(0.25, MAX_PIECES);
    ParameterStore::save(&mut fram, &longest).unwrap();
    let hash = parameters_hash(&longest).unwrap();
    let value = HashedParameters { parameters: longest, hash };
    assert_eq!(
        ParameterStore::load(&mut fram).unwrap(),
        Stored::Loaded { value, sequence: 0, address: 0, other_damaged: false }
    );
}

#[test]
fn blank_memory_is_empty_and_rubbish_is_corrupt() {
    for byte in [0x00, 0xFF] {
        let mut fram = Fram::filled_with(byte);
        assert_eq!(ParameterStore::load(&mut fram).unwrap(), Stored::Empty);
        assert_eq!(FlightStore::load(&mut fram).unwrap(), Stored::Empty);
    }
    let mut fram = Fram::filled_with(0xA5);
    assert_eq!(ParameterStore::load(&mut fram).unwrap(), Stored::Corrupt);
    FlightStore::save(&mut fram, &FlightState::default()).unwrap();
    assert_eq!(FlightStore::load(&mut fram).unwrap().value(), Some(FlightState::default()));
}

#[test]
fn power_may_fail_at_any_byte_of_saving_parameters() {
    // Values of different lengths, so that the new one lies on the rest of a longer or shorter one.
    let values = [parameters(0.1, 0), parameters(0.2, MAX_PIECES), parameters(0.3, 3), parameters(0.4, 0)];
    for blank in [0x00, 0xFF] {
        let mut fram = Fram::filled_with(blank);
        ParameterStore::save(&mut fram, &values[0]).unwrap();
        for pair in values.windows(2) {
            let mut cut = 0;
            loop {
                let mut torn = Fram { bytes_left: cut, ..fram.clone() };
                let done = ParameterStore::save(&mut torn, &pair[1]).is_ok();
                let found = stored_parameters(&mut torn.again());
                assert!(found == pair[1] || !done && found == pair[0], "cut after {cut} bytes");
                // The next save after a torn one must work as well.
                let mut later = torn.again();
                ParameterStore::save(&mut later, &values[0]).unwrap();
                assert_eq!(stored_parameters(&mut later), values[0], "after a cut at {cut} bytes");
                if done {
                    break;
                }
                cut += 1;
            }
            assert!(cut > 100, "cut at {cut} places only");
            ParameterStore::save(&mut fram, &pair[1]).unwrap();
        }
    }
}

#[test]
fn power_may_fail_at_any_byte_of_saving_the_flight_state_many_times_over() {
    let state = |capture| FlightState { starts: 300, last_capture: capture, log_number: 299 };
    let mut fram = Fram::filled_with(0);
    FlightStore::save(&mut fram, &state(0)).unwrap();
    let mut known = state(0);
    // Every save is cut once, one byte further each time, and what is found then is what counts.
    for capture in 1..2000 {
        let cut = capture as usize % 40;
        fram.bytes_left = cut;
        let done = FlightStore::save(&mut fram, &state(capture)).is_ok();
        fram = fram.again();
        let found = FlightStore::load(&mut fram).unwrap().value().expect("never none");
        // Cut before the last byte, the new value is whole if that byte lay there already.
        assert!(
            found == state(capture) || !done && found == known,
            "capture {capture} cut after {cut} bytes: {found:?}"
        );
        known = found;
    }
    assert!(known.last_capture > 1900);
}

#[test]
fn one_flipped_bit_costs_at_most_the_newest_value() {
    let states = [1, 2].map(|starts| FlightState { starts, last_capture: 70_000, log_number: 5 });
    let mut fram = Fram::filled_with(0xFF);
    for state in &states {
        FlightStore::save(&mut fram, state).unwrap();
    }
    let mut old = 0;
    for bit in 0..128 * 8 {
        let mut flipped = fram.again();
        flipped.bytes[0x0800 + bit / 8] ^= 1 << (bit % 8);
        let Stored::Loaded { value, other_damaged, .. } = FlightStore::load(&mut flipped).unwrap() else {
            panic!("bit {bit}: nothing found");
        };
        assert!(states.contains(&value), "bit {bit}: {value:?}");
        assert!(value == states[1] || other_damaged, "bit {bit}: an old value without a word");
        old += usize::from(value == states[0]);
    }
    assert!(old > 100, "only {old} bits of the newest copy matter");
}

#[test]
fn both_copies_broken_is_corrupt() {
    let mut fram = Fram::filled_with(0xFF);
    for starts in 0..2 {
        FlightStore::save(&mut fram, &FlightState { starts, ..FlightState::default() }).unwrap();
    }
    fram.bytes[0x0800 + 12] ^= 1;
    fram.bytes[0x0840 + 12] ^= 1;
    assert_eq!(FlightStore::load(&mut fram).unwrap(), Stored::Corrupt);
}

const OLD: Place<u32, 32> = Place { mark: *b"test", version: 1, address: 0, value: PhantomData };
const NEW: Place<u32, 32> = Place { version: 2, ..OLD };

#[test]
fn a_newer_version_is_reported_and_not_written_over() {
    let mut fram = Fram::filled_with(0);
    OLD.save(&mut fram, &1).unwrap();
    NEW.save(&mut fram, &2).unwrap();
    assert_eq!(OLD.load(&mut fram).unwrap(), Stored::OtherVersion { found: 2, known: 1 });
    assert_eq!(NEW.load(&mut fram).unwrap().value(), Some(2));
    // An old program that saves writes over the old copy, not over the new program's.
    fram.bytes_left = 5;
    OLD.save(&mut fram, &3).unwrap_err();
    assert_eq!(NEW.load(&mut fram.again()).unwrap().value(), Some(2));
    OLD.save(&mut fram.again(), &3).unwrap();
}

#[test]
fn another_mark_is_never_read() {
    let mut fram = Fram::filled_with(0);
    OLD.save(&mut fram, &1).unwrap();
    let other = Place { mark: *b"else", ..OLD };
    assert_eq!(other.load(&mut fram).unwrap(), Stored::Corrupt);
}

#[test]
fn the_sequence_number_wraps() {
    let mut fram = Fram::filled_with(0);
    let bytes = {
        let mut bytes = header(OLD.mark, OLD.version, 1, u32::MAX - 1).to_vec();
        bytes.push(7);
        bytes.extend(COPY_CRC.checksum(&bytes).to_le_bytes());
        bytes
    };
    fram.write(0, &bytes).unwrap();
    for value in 8..16 {
        OLD.save(&mut fram, &value).unwrap();
        let Stored::Loaded { value: found, sequence, .. } = OLD.load(&mut fram).unwrap() else {
            panic!("{value} is lost");
        };
        assert_eq!((found, sequence), (value, (u32::MAX - 8).wrapping_add(value)));
    }
}

#[test]
fn a_value_too_long_is_refused_and_the_old_one_stays() {
    let place: Place<heapless::Vec<u8, 64>, 32> = Place { mark: *b"long", version: 1, address: 0, value: PhantomData };
    let mut fram = Fram::filled_with(0);
    let fits = heapless::Vec::from_slice(&[7; 15]).unwrap();
    place.save(&mut fram, &fits).unwrap();
    let long = heapless::Vec::from_slice(&[7; 16]).unwrap();
    assert_eq!(place.save(&mut fram, &long), Err(StoreError::TooLong { room_bytes: 16 }));
    assert_eq!(place.load(&mut fram).unwrap().value(), Some(fits));
}

/// Takes every write and keeps none, as a write-protected or missing chip does.
struct Deaf;

impl Memory for Deaf {
    type Error = PowerGone;

    fn read(&mut self, _address: u16, bytes: &mut [u8]) -> Result<(), PowerGone> {
        bytes.fill(0xFF);
        Ok(())
    }

    fn write(&mut self, _address: u16, _bytes: &[u8]) -> Result<(), PowerGone> {
        Ok(())
    }
}

#[test]
fn a_memory_that_keeps_nothing_is_noticed() {
    let saved = FlightStore::save(&mut Deaf, &FlightState::default());
    assert_eq!(saved, Err(StoreError::NotKept { address: 0x0800 }));
}

proptest! {
    #[test]
    fn any_bytes_give_an_answer(bytes in proptest::collection::vec(any::<u8>(), 128)) {
        let mut fram = Fram::filled_with(0);
        fram.bytes[0x0800..0x0880].copy_from_slice(&bytes);
        prop_assert_eq!(FlightStore::load(&mut fram).unwrap(), Stored::Corrupt);
    }

    #[test]
    fn saves_and_cuts_in_any_order_never_lose_a_value(cuts in proptest::collection::vec(0usize..80, 1..60)) {
        let mut fram = Fram::filled_with(0xFF);
        let mut known = None;
        for (starts, cut) in (0..).zip(cuts) {
            let state = FlightState { starts, last_capture: starts * 1000, log_number: 1 };
            fram.bytes_left = cut;
            let done = FlightStore::save(&mut fram, &state).is_ok();
            fram = fram.again();
            let found = FlightStore::load(&mut fram).unwrap().value();
            // Cut before the last byte, the new value is whole if that byte lay there already.
            prop_assert!(found == Some(state) || !done && found == known, "{:?} after {:?}", found, known);
            known = found;
        }
    }
}
