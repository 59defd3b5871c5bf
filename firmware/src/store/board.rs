//! What this board keeps, and where in its 16 KiB.
//!
//! ```text
//! 0x0000  2 x 1024  parameters
//! 0x0800  2 x 64    flight state
//! 0x0880            free
//! ```

use core::marker::PhantomData;

use adit_protocol::log::parameters_hash;
use adit_protocol::parameters::Parameters;
use serde::{Deserialize, Serialize};

use super::{Place, StoreError, Stored};
use crate::drivers::memory::Memory;

/// The longest parameters (a chain of 24 vertices) take about 530 bytes.
const PARAMETERS: Place<Parameters, 1024> = Place { mark: *b"adPa", version: 2, address: 0, value: PhantomData };

const FLIGHT: Place<FlightState, 64> = Place { mark: *b"adFl", version: 1, address: 0x0800, value: PhantomData };

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
        assert!(usize::from(FLIGHT.address) + Place::<FlightState, 64>::BYTES <= 16 * 1024);
    }
}
