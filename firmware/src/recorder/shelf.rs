//! The logs that are on the card already: what there is, and stretches of them, for whoever fetches them over the link.
//!
//! Each call reads the card anew, beside a recorder that has its own file open: a log that is being written can be read up to
//! where the directory knows it.

use core::ops::ControlFlow;

use embedded_sdmmc::{BlockDevice, Error, Mode, TimeSource, VolumeIdx, VolumeManager};

use super::card::layout_of;
use super::error::{Doing, RecorderError};
use super::guard::{Guard, Refused};
use super::number::{name_of, number_of};

/// One volume, one directory, one file at a time.
pub(super) type Volumes<'d, D, T> = VolumeManager<Guard<'d, D>, T, 1, 1, 1>;

/// Number and length of the logs, the oldest first; of more than fit the newest.
///
/// # Errors
/// [`RecorderError::Device`], [`RecorderError::Format`] or [`RecorderError::FileSystem`].
pub fn logs<D: BlockDevice, T: TimeSource, const N: usize>(
    device: &D,
    time: T,
) -> Result<heapless::Vec<(u16, u32), N>, RecorderError<D::Error>> {
    let volumes = open(device, time)?;
    let mut found = heapless::Vec::<(u16, u32), N>::new();
    let listed =
        volumes.open_raw_volume(VolumeIdx(0)).and_then(|volume| volumes.open_root_dir(volume)).and_then(|root| {
            volumes.iterate_dir(root, |entry| {
                if let Some(number) = number_of(&entry.name) {
                    put(&mut found, (number, entry.size));
                }
                ControlFlow::Continue(())
            })
        });
    listed.map_err(|error| failed(&volumes, Doing::Listing, error))?;
    Ok(found)
}

/// Keeps the list in order, and the newest.
fn put<const N: usize>(list: &mut heapless::Vec<(u16, u32), N>, log: (u16, u32)) {
    if list.is_full() {
        if list.first().is_some_and(|oldest| oldest.0 > log.0) {
            return;
        }
        list.remove(0);
    }
    let place = list.iter().position(|other| other.0 > log.0).unwrap_or(list.len());
    // There is room now.
    let _ = list.insert(place, log);
}

/// Reads a stretch of a log; fewer bytes than there is room for come at its end only, none from a log that is not there.
///
/// # Errors
/// As [`logs`].
pub fn read_log<D: BlockDevice, T: TimeSource>(
    device: &D,
    time: T,
    number: u16,
    offset: u32,
    bytes: &mut [u8],
) -> Result<usize, RecorderError<D::Error>> {
    let volumes = open(device, time)?;
    let root = volumes.open_raw_volume(VolumeIdx(0)).and_then(|volume| volumes.open_root_dir(volume));
    let root = root.map_err(|error| failed(&volumes, Doing::Listing, error))?;
    let file = match volumes.open_file_in_dir(root, name_of(number).as_str(), Mode::ReadOnly) {
        Ok(file) => file,
        Err(Error::NotFound) => return Ok(0),
        Err(error) => return Err(failed(&volumes, Doing::Listing, error)),
    };
    let read = (|| {
        if volumes.file_length(file)? <= offset {
            return Ok(0);
        }
        volumes.file_seek_from_start(file, offset)?;
        volumes.read(file, bytes)
    })();
    read.map_err(|error| failed(&volumes, Doing::Listing, error))
}

fn open<D: BlockDevice, T: TimeSource>(device: &D, time: T) -> Result<Volumes<'_, D, T>, RecorderError<D::Error>> {
    let layout = layout_of(device).map_err(|error| RecorderError::Device { doing: Doing::Examining, error })??;
    Ok(VolumeManager::new_with_limits(Guard::new(device, layout), time, 1))
}

/// Tells whether the device failed or the library found something wrong.
pub(super) fn failed<D: BlockDevice, T: TimeSource>(
    volumes: &Volumes<'_, D, T>,
    doing: Doing,
    error: Error<Refused>,
) -> RecorderError<D::Error> {
    match volumes.device(|guard| guard.take_error()) {
        Some(error) => RecorderError::Device { doing, error },
        None => RecorderError::FileSystem { doing, error },
    }
}
