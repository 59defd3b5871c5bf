//! Counts instructions: runs the image `instructions`, which measures the controller's work against the core's own timer,
//! and reads its table out of the memory. The core's timer counts one for each instruction.

use std::path::Path;

use adit_protocol::parameters::Parameters;
use rigless::emulator::{self, Driver, Host, Start, Stop};
use rigless::image::Image;
use rigless::session::Session;
use rigless::soc::Width;
use rigless::symbols::Symbols;
use rigless::time::VirtualNanos;

use crate::machine::{BOOTLOADER, BlockImage, Chips, FLASH_START, Machine};

/// Rows of the table, in the order of `firmware/src/bin/instructions`.
pub const ROWS: [&str; 8] = [
    "centring_near_circle",
    "centring_search_piece_circle",
    "centring_near_underpass",
    "centring_search_piece_underpass",
    "boot_piece",
    "step_without_sample",
    "step_with_samples",
    "step_with_tag",
];

/// The image is asked this often whether it is done.
const LOOK_NS: u64 = 10_000_000;
/// It is done in two seconds.
const GIVE_UP_NS: u64 = 60_000_000_000;

/// What one piece of work costs.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Cost {
    /// The most instructions.
    pub longest: u64,
    /// Their mean.
    pub mean: u64,
}

/// Why nothing was measured.
#[derive(Debug, thiserror::Error)]
pub enum CostError {
    /// The file.
    #[error("cannot read {0}: {1}; build it with: cargo xtask flash --build-only")]
    Read(std::path::PathBuf, std::io::Error),
    /// The image.
    #[error("flash image: {0}")]
    Image(#[from] rigless::image::Error),
    /// The emulator.
    #[error("the emulator: {0}")]
    Emulator(#[from] emulator::Error),
    /// The part.
    #[error("the emulated microcontroller: {0}")]
    Part(#[from] rigless::soc::Error),
    /// It is another image.
    #[error("the image has no table COST")]
    NoTable,
    /// It panicked or hung.
    #[error("the image did not end its work")]
    NotDone,
}

/// Runs the image and returns the costs, in the order of [`ROWS`].
///
/// # Errors
/// [`CostError`].
pub fn measure(elf: &Path) -> Result<[Cost; ROWS.len()], CostError> {
    let bytes = std::fs::read(elf).map_err(|error| CostError::Read(elf.to_owned(), error))?;
    let symbols = Symbols::read(&bytes, |address| address & !1).ok();
    let table = symbols.and_then(|symbols| symbols.get("COST").ok()).ok_or(CostError::NoTable)?;
    let images =
        [Image::new(Path::new("bootloader"), BOOTLOADER.to_vec(), Some(FLASH_START))?, Image::new(elf, bytes, None)?];
    let chips = Chips::fitted(&Parameters::default(), &[], BlockImage::empty(0));
    let session = Session::new(Box::new(Machine::new(chips, 0)?), 0, VirtualNanos(0))?;
    let finished = emulator::run(session, &Start::new(&images), Reader { table, costs: None })?;
    finished.driver.costs.ok_or(CostError::NotDone)
}

#[derive(Debug)]
struct Reader {
    table: u64,
    costs: Option<[Cost; ROWS.len()]>,
}

impl Driver<Machine> for Reader {
    fn on_stop(&mut self, _session: &mut Session<Machine>, stop: Stop, host: &mut dyn Host) -> Option<VirtualNanos> {
        let mut word = |index: usize| host.read(self.table + index as u64 * 4, Width::W32).unwrap_or_default();
        match word(ROWS.len() * 2) {
            0 if stop.at.0 < GIVE_UP_NS => Some(VirtualNanos(stop.at.0 + LOOK_NS)),
            1 => {
                self.costs = Some(std::array::from_fn(|row| Cost { longest: word(row * 2), mean: word(row * 2 + 1) }));
                None
            }
            _ => None,
        }
    }
}
