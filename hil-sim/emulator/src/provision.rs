//! Puts parameters into a FRAM and reads them out of it, with the firmware's own store, as a bench would over the link.

use adit_firmware::drivers::memory::Memory;
use adit_firmware::link::Keep;
use adit_firmware::store::{LinkStore, ParameterStore, StoreError};
use adit_protocol::mavlink::Key;
use adit_protocol::parameters::Parameters;

use crate::machine::FRAM_BYTES;

/// The FRAM does not reach that far.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error("the FRAM has {FRAM_BYTES} bytes")]
pub struct BeyondFram;

/// A FRAM on the bench.
struct BenchFram(Vec<u8>);

impl Memory for BenchFram {
    type Error = BeyondFram;

    fn read(&mut self, address: u16, bytes: &mut [u8]) -> Result<(), BeyondFram> {
        let place = usize::from(address)..usize::from(address) + bytes.len();
        bytes.copy_from_slice(self.0.get(place).ok_or(BeyondFram)?);
        Ok(())
    }

    fn write(&mut self, address: u16, bytes: &[u8]) -> Result<(), BeyondFram> {
        let place = usize::from(address)..usize::from(address) + bytes.len();
        self.0.get_mut(place).ok_or(BeyondFram)?.copy_from_slice(bytes);
        Ok(())
    }
}

/// What a FRAM holds into which these parameters have been loaded.
///
/// # Errors
/// [`StoreError::TooLong`] if they do not fit their place.
pub fn provisioned_fram(parameters: &Parameters) -> Result<Vec<u8>, StoreError<BeyondFram>> {
    let mut fram = BenchFram(vec![0; FRAM_BYTES]);
    ParameterStore::save(&mut fram, parameters)?;
    Ok(fram.0)
}

/// As [`provisioned_fram`], with a key installed.
///
/// # Errors
/// As [`provisioned_fram`].
pub fn keyed_fram(parameters: &Parameters, key: Key) -> Result<Vec<u8>, StoreError<BeyondFram>> {
    let mut fram = BenchFram(provisioned_fram(parameters)?);
    LinkStore::save(&mut fram, &Keep::Key(Some(key)))?;
    Ok(fram.0)
}

/// The parameters in a FRAM, if they are whole.
///
/// # Errors
/// [`StoreError::Memory`] if `fram` is shorter than the store's places.
pub fn parameters_in(fram: &[u8]) -> Result<Option<Parameters>, StoreError<BeyondFram>> {
    let stored = ParameterStore::load(&mut BenchFram(fram.to_vec()))?;
    Ok(stored.value().map(|hashed| hashed.parameters))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn parameters_come_out_of_the_fram_as_they_went_in() {
        let mut parameters = Parameters::default();
        parameters.rig.images_per_turn = 7;
        let fram = provisioned_fram(&parameters).expect("room");
        assert_eq!(parameters_in(&fram), Ok(Some(parameters)));
        assert_eq!(parameters_in(&vec![0; FRAM_BYTES]), Ok(None));
        assert!(matches!(parameters_in(&[]), Err(StoreError::Memory { error: BeyondFram, .. })));
    }
}
