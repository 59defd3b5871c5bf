//! Why the log cannot be written.

use super::card::CardFormat;
use super::guard::Refused;

/// What the recorder was doing.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Doing {
    /// Reading partition table, boot sector and FAT.
    Examining,
    /// Looking through the root directory.
    Listing,
    /// Making the new file.
    Creating,
    /// Making the file longer.
    Extending,
    /// Writing records.
    Writing,
}

impl core::fmt::Display for Doing {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        f.write_str(match self {
            Self::Examining => "examining the card",
            Self::Listing => "listing the card's files",
            Self::Creating => "creating the log file",
            Self::Extending => "extending the log file",
            Self::Writing => "writing records",
        })
    }
}

/// Why the log cannot be written. After any of these the recorder is of no more use; a new one may be opened.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum RecorderError<E: core::error::Error + 'static> {
    /// The card was pulled or is broken.
    #[error("{doing}: the card does not answer")]
    Device {
        /// What was being done.
        doing: Doing,
        /// What the driver says.
        #[source]
        error: E,
    },
    /// The card is not formatted for this.
    #[error(transparent)]
    Format(#[from] CardFormat),
    /// The card is full.
    #[error("the card is full: {free_bytes} bytes are free where {wanted_bytes} are wanted")]
    Full {
        /// What is free.
        free_bytes: u64,
        /// What is wanted.
        wanted_bytes: u64,
    },
    /// The file has reached its limit; a new one may be opened.
    #[error("the log file has reached {bytes} bytes; the log goes on in another")]
    FileFull {
        /// Its size.
        bytes: u32,
    },
    /// The root directory of a FAT16 has no entry left.
    #[error("the card's directory is full; remove old logs or format the card with FAT32")]
    DirectoryFull,
    /// All log files that there can be are there.
    #[error("the card holds all log files from ADIT0001.LOG to ADIT9999.LOG; remove old ones")]
    NumbersTaken,
    /// The file system contradicts itself.
    #[error("{doing}: the card's file system is broken")]
    FileSystem {
        /// What was being done.
        doing: Doing,
        /// What the library says.
        #[source]
        error: embedded_sdmmc::Error<Refused>,
    },
}
