//! What this board keeps, and where in its 16 KiB.
//!
//! ```text
//! 0x0000  2 x 1024  parameters
//! 0x0800  2 x 64    flight state
//! 0x0880  2 x 64    value borrowed from the autopilot
//! 0x0900  2 x 64    key
//! 0x0980  2 x 256   signatures heard
//! 0x0B80            free
//! ```

use core::marker::PhantomData;

use adit_protocol::log::parameters_hash;
use adit_protocol::mavlink::{Key, Streams};
use adit_protocol::parameters::Parameters;
use serde::{Deserialize, Serialize};

use super::{Place, StoreError, Stored};
use crate::drivers::memory::Memory;
use crate::link;

/// The longest parameters (a chain of 24 vertices) take about 530 bytes.
const PARAMETERS: Place<Parameters, 1024> = Place { mark: *b"adPa", version: 2, address: 0, value: PhantomData };

const FLIGHT: Place<FlightState, 64> = Place { mark: *b"adFl", version: 1, address: 0x0800, value: PhantomData };

const BORROWED: Place<Option<link::Borrowed>, 64> =
    Place { mark: *b"adBo", version: 1, address: 0x0880, value: PhantomData };

const KEY: Place<Option<Key>, 64> = Place { mark: *b"adKy", version: 1, address: 0x0900, value: PhantomData };

/// Twelve streams of 13 bytes at most, and the newest time.
const STREAMS: Place<Streams, 256> = Place { mark: *b"adSt", version: 1, address: 0x0980, value: PhantomData };

/// Parameters with the hash that goes into log and telemetry.
#[derive(Clone, Debug, PartialEq)]
pub struct HashedParameters {
    /// The parameters.
    pub parameters: Parameters,
    /// [`parameters_hash`] of them.
    pub hash: u64,
}

/// The board's parameters in its memory.
#[derive(Clone, Copy, Debug)]
pub struct ParameterStore;

impl ParameterStore {
    /// Reads the newest parameters.
    ///
    /// # Errors
    /// [`StoreError::Memory`] if the memory does not answer.
    pub fn load<M: Memory>(memory: &mut M) -> Result<Stored<HashedParameters>, StoreError<M::Error>> {
        Ok(match PARAMETERS.load(memory)? {
            Stored::Loaded { value: parameters, sequence, address, other_damaged } => {
                match parameters_hash(&parameters) {
                    Ok(hash) => Stored::Loaded {
                        value: HashedParameters { parameters, hash },
                        sequence,
                        address,
                        other_damaged,
                    },
                    // Parameters that came out of this place fit a frame of the log.
                    Err(_) => Stored::Corrupt,
                }
            }
            Stored::Empty => Stored::Empty,
            Stored::Corrupt => Stored::Corrupt,
            Stored::OtherVersion { found, known } => Stored::OtherVersion { found, known },
        })
    }

    /// Keeps these parameters.
    ///
    /// # Errors
    /// Any [`StoreError`]; the old parameters survive.
    pub fn save<M: Memory>(memory: &mut M, parameters: &Parameters) -> Result<(), StoreError<M::Error>> {
        PARAMETERS.save(memory, parameters)
    }
}

/// What must go on counting over a loss of power, so that numbers never repeat.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct FlightState {
    /// Starts of the board.
    pub starts: u32,
    /// Number of the last capture commanded.
    pub last_capture: u32,
    /// Number of the last log file.
    pub log_number: u32,
}

/// The flight state in the board's memory; saved at every capture.
#[derive(Clone, Copy, Debug)]
pub struct FlightStore;

impl FlightStore {
    /// Reads the newest state.
    ///
    /// # Errors
    /// [`StoreError::Memory`] if the memory does not answer.
    pub fn load<M: Memory>(memory: &mut M) -> Result<Stored<FlightState>, StoreError<M::Error>> {
        FLIGHT.load(memory)
    }

    /// Keeps this state.
    ///
    /// # Errors
    /// Any [`StoreError`]; the old state survives.
    pub fn save<M: Memory>(memory: &mut M, state: &FlightState) -> Result<(), StoreError<M::Error>> {
        FLIGHT.save(memory, state)
    }
}

/// What the link must know from before the board's start, in the board's memory.
#[derive(Clone, Copy, Debug)]
pub struct LinkStore;

impl LinkStore {
    /// Reads what there is.
    ///
    /// # Errors
    /// [`StoreError::Memory`] if the memory does not answer. Without its memory a board has no key, and says so.
    pub fn load<M: Memory>(memory: &mut M) -> Result<link::Memory, StoreError<M::Error>> {
        Ok(link::Memory {
            borrowed: BORROWED.load(memory)?.value().flatten(),
            key: KEY.load(memory)?.value().flatten(),
            streams: STREAMS.load(memory)?.value().unwrap_or_default(),
        })
    }

    /// Keeps one thing.
    ///
    /// # Errors
    /// Any [`StoreError`]; the old value survives.
    pub fn save<M: Memory>(memory: &mut M, keep: &link::Keep) -> Result<(), StoreError<M::Error>> {
        match keep {
            link::Keep::Borrowed(borrowed) => BORROWED.save(memory, borrowed),
            link::Keep::Key(key) => KEY.save(memory, key),
            link::Keep::Streams(streams) => STREAMS.save(memory, streams),
            link::Keep::Parameters(parameters) => ParameterStore::save(memory, parameters),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Bytes of the default parameters in version 2 of the layout.
    const DEFAULT_BYTES: usize = 251;
    /// Bytes of a flight state of ones in version 1 of the layout.
    const ONES_BYTES: usize = 3;

    #[test]
    fn a_new_layout_has_a_new_version() {
        let mut buffer = [0; 1024];
        let bytes = postcard::to_slice(&Parameters::default(), &mut buffer).unwrap().len();
        assert_eq!((PARAMETERS.version, bytes), (2, DEFAULT_BYTES), "raise the version if a field came or went");
        let ones = FlightState { starts: 1, last_capture: 1, log_number: 1 };
        let bytes = postcard::to_slice(&ones, &mut buffer).unwrap().len();
        assert_eq!((FLIGHT.version, bytes), (1, ONES_BYTES), "raise the version if a field came or went");
    }

    #[test]
    fn places_do_not_overlap() {
        assert!(usize::from(PARAMETERS.address) + Place::<Parameters, 1024>::BYTES <= usize::from(FLIGHT.address));
        assert!(usize::from(FLIGHT.address) + Place::<FlightState, 64>::BYTES <= usize::from(BORROWED.address));
        assert!(usize::from(BORROWED.address) + Place::<Option<link::Borrowed>, 64>::BYTES <= usize::from(KEY.address));
        assert!(usize::from(KEY.address) + Place::<Option<Key>, 64>::BYTES <= usize::from(STREAMS.address));
        assert!(usize::from(STREAMS.address) + Place::<Streams, 256>::BYTES <= 16 * 1024);
    }

    #[test]
    fn the_link_finds_what_it_left() {
        let mut memory = crate::store::tests::Fram::filled_with(0);
        let borrowed = link::Borrowed { parameter: link::LimitParameter::LoiterMetres, value: 12.5 };
        let streams = Streams::starting_at(u64::MAX >> 16);
        for keep in [
            link::Keep::Borrowed(Some(borrowed)),
            link::Keep::Key(Some(Key([9; 32]))),
            link::Keep::Streams(streams.clone()),
        ] {
            LinkStore::save(&mut memory, &keep).unwrap();
        }
        let found = LinkStore::load(&mut memory).unwrap();
        assert_eq!((found.borrowed, found.key, found.streams), (Some(borrowed), Some(Key([9; 32])), streams));
        LinkStore::save(&mut memory, &link::Keep::Borrowed(None)).unwrap();
        assert_eq!(LinkStore::load(&mut memory).unwrap().borrowed, None);
    }
}
