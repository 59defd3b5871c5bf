//! What a flight of the flash image leaves, for tests and for people.

use std::collections::BTreeMap;

use rigless::device::ResetCause;
use rigless::emulator::Stop;
use rigless::session::Session;

use crate::machine::{BlockImage, BlockWrite, Chips, FramWrite, LINES, Machine, RangerMisuse, VolumeError};

/// Why the microcontroller restarted.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum RestartCause {
    /// The firmware asked for it.
    Firmware,
    /// The independent watchdog.
    Watchdog,
    /// The reset pin.
    Pin,
    /// The supply came back.
    PowerOn,
    /// Something else in the part.
    Other,
}

/// A restart.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize)]
pub struct Restart {
    /// From the flight's start.
    pub at_ns: u64,
    /// Why.
    pub cause: RestartCause,
}

/// What one run from power-up to power-down has to say about itself.
#[derive(Clone, Debug, Default)]
pub(crate) struct Accounts {
    restarts: Vec<Restart>,
    instructions: u64,
    gaps: Vec<String>,
}

impl Accounts {
    pub(crate) fn of(session: &Session<Machine>, stop: Option<Stop>, epoch_ns: u64) -> Self {
        let restart = |reset: &rigless::session::Reset| Restart {
            at_ns: epoch_ns + reset.at.0,
            cause: match reset.cause {
                ResetCause::Core => RestartCause::Firmware,
                ResetCause::Model("IWDG") => RestartCause::Watchdog,
                ResetCause::Pin => RestartCause::Pin,
                ResetCause::PowerOn => RestartCause::PowerOn,
                _ => RestartCause::Other,
            },
        };
        let mut gaps = Vec::new();
        gaps.extend(session.unmapped().iter().map(ToString::to_string));
        gaps.extend(session.refused().iter().map(|(at, fault)| format!("refused at={at:#010x}: {fault}")));
        gaps.extend(session.unimplemented().iter().map(|(at, access)| {
            let (instance, register, pc) = (access.instance, access.register, access.program_counter);
            format!("unimplemented {instance}.{register} at={at:#010x} pc={pc:#010x}")
        }));
        gaps.extend(session.unrouted().iter().map(|(instance, number)| format!("unrouted {instance} {number}")));
        gaps.extend(session.told().map(|told| format!("told {told:?}")));
        Self {
            restarts: session.resets().iter().map(restart).collect(),
            instructions: stop.map_or(0, |stop| stop.instruction_count),
            gaps,
        }
    }
}

/// What a flight leaves.
#[derive(Clone, Debug)]
pub struct Report {
    /// Every restart, power-ups after a cut included, in order of time; the first power-up is none.
    pub restarts: Vec<Restart>,
    /// Instructions that the core has executed.
    pub instructions: u64,
    /// Accesses that the emulated part could not answer as silicon does: unmapped, refused, not modelled. Empty if the
    /// flight is worth anything.
    pub gaps: Vec<String>,
    /// What the FRAM holds.
    pub fram: Vec<u8>,
    /// Every byte that was written to it.
    pub fram_writes: Vec<FramWrite>,
    /// The card.
    pub card: BlockImage,
    /// Every block that was written to it.
    pub card_writes: Vec<BlockWrite>,
    /// How often range sensors were used against their manual, all together.
    pub ranger_misuse: RangerMisuse,
    /// All bytes that the board sent on TELEM1, TELEM2 and to the Hub.
    pub sent: [Vec<u8>; LINES],
}

impl Report {
    pub(crate) fn new(chips: Chips, sent: [Vec<u8>; LINES]) -> Self {
        let mut ranger_misuse = RangerMisuse::default();
        for (_, ranger) in &chips.rangers {
            ranger_misuse.early_reads += ranger.misuse.early_reads;
            ranger_misuse.untriggered_reads += ranger.misuse.untriggered_reads;
            ranger_misuse.combined += ranger.misuse.combined;
        }
        Self {
            restarts: Vec::new(),
            instructions: 0,
            gaps: Vec::new(),
            fram: chips.fram.contents().to_vec(),
            fram_writes: chips.fram.journal,
            card: chips.card.image,
            card_writes: chips.card.journal,
            ranger_misuse,
            sent,
        }
    }

    pub(crate) fn add(&mut self, accounts: &Accounts) {
        self.restarts.extend(&accounts.restarts);
        self.instructions += accounts.instructions;
        self.gaps.extend(accounts.gaps.iter().filter(|gap| !self.gaps.contains(gap)).cloned().collect::<Vec<_>>());
    }

    /// The files in the root of the card, by name.
    ///
    /// # Errors
    /// [`VolumeError`] if the volume is damaged.
    pub fn files(&self) -> Result<BTreeMap<String, Vec<u8>>, VolumeError> {
        self.card.root_files()
    }
}
