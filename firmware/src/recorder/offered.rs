//! Parameters that a file on the card offers: how a mission gets to the board without any link.
//!
//! The file is a log that ends after its header ([`adit_protocol::log::encode_header`]), as `adit plan` writes it; so a log of
//! an earlier flight, renamed, offers what that flight flew with.

use adit_protocol::log::{Decoder, FORMAT, MAX_FRAME_BYTES, PARAMETERS_FILE, parameters_hash};
use adit_protocol::parameters::Parameters;
use adit_protocol::record::Record;
use embedded_sdmmc::{BlockDevice, Mode, TimeSource, VolumeIdx, VolumeManager};

use super::card::layout_of;
use super::error::{Doing, RecorderError};
use super::guard::Guard;

/// What the card offers.
#[derive(Clone, Debug, PartialEq)]
#[expect(clippy::large_enum_variant, reason = "no allocation on the board, which holds one at a time")]
pub enum Offer {
    /// There is no such file.
    None,
    /// These.
    Parameters(Parameters),
    /// The file is damaged, or of another version.
    Unreadable,
}

/// Looks for offered parameters.
///
/// # Errors
/// [`RecorderError::Device`] or [`RecorderError::Format`] if the card cannot be read at all.
pub fn offered_parameters<D: BlockDevice, T: TimeSource>(
    device: &D,
    time: T,
) -> Result<Offer, RecorderError<D::Error>> {
    let layout = layout_of(device).map_err(|error| RecorderError::Device { doing: Doing::Examining, error })??;
    let volumes: VolumeManager<_, T, 1, 1, 1> = VolumeManager::new_with_limits(Guard::new(device, layout), time, 1);
    let mut bytes = [0; MAX_FRAME_BYTES];
    let read = (|| {
        let root = volumes.open_root_dir(volumes.open_raw_volume(VolumeIdx(0))?)?;
        let file = volumes.open_file_in_dir(root, PARAMETERS_FILE, Mode::ReadOnly)?;
        volumes.read(file, &mut bytes)
    })();
    Ok(match read {
        Ok(length) => offer_in(bytes.get(..length).unwrap_or_default()),
        // A card that answers no more is found out by whoever writes to it next.
        Err(_) => Offer::None,
    })
}

fn offer_in(bytes: &[u8]) -> Offer {
    match Decoder::new(bytes).next().and_then(Result::ok).map(|located| located.record) {
        Some(Record::Header(header))
            if header.format == FORMAT && parameters_hash(&header.parameters) == Ok(header.parameters_hash) =>
        {
            Offer::Parameters(header.parameters)
        }
        _ => Offer::Unreadable,
    }
}

#[cfg(test)]
mod tests {
    use adit_protocol::log::encode_header;
    use adit_protocol::record::Header;

    use super::*;

    #[test]
    fn a_header_offers_its_parameters_whatever_follows() {
        let parameters = Parameters::default();
        let mut bytes = encode_header(&Header::new(&parameters, "adit").unwrap()).unwrap().to_vec();
        assert_eq!(offer_in(&bytes), Offer::Parameters(parameters.clone()));
        bytes.extend_from_slice(&[0xA5; 40]);
        assert_eq!(offer_in(&bytes), Offer::Parameters(parameters));
    }

    #[test]
    fn damage_and_other_files_offer_nothing() {
        let mut bytes = encode_header(&Header::new(&Parameters::default(), "adit").unwrap()).unwrap().to_vec();
        bytes[20] ^= 1;
        assert_eq!(offer_in(&bytes), Offer::Unreadable);
        assert_eq!(offer_in(b"radius_m = 1.5"), Offer::Unreadable);
        assert_eq!(offer_in(&[]), Offer::Unreadable);
    }
}
