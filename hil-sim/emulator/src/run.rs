//! One run of the microcontroller, from power-up to power-down, on a thread of its own.
//!
//! The runtime's `run` keeps the thread it is called on until the run ends. So it gets one, and host and run talk in pairs:
//! a [`Step`] goes in, the run goes on to its instant, a [`Reading`] comes out. Nothing else crosses.

use std::sync::mpsc::{Receiver, SyncSender, sync_channel};
use std::thread::JoinHandle;

use rigless::emulator::{self, Driver, Finished, Host, Settled, Start, Stop};
use rigless::image::Image;
use rigless::session::Session;
use rigless::time::VirtualNanos;

use crate::machine::{CardDefects, Chips, LINES, Machine, Pins, Sabotage, Sensed, SerialLine};
use crate::mend::mend;
use crate::report::Accounts;

/// Registers of I2C1 and USART2, RM0090 rev 21 table 1, in one stretch.
const SABOTAGED: core::ops::Range<u64> = 0x4000_4400..0x4000_5800;
/// All peripherals of the part.
const PERIPHERALS: (u64, u64) = (0x4000_0000, 0x6000_0000);

/// What the host asks for.
#[derive(Clone, Debug, Default)]
pub(crate) struct Step {
    /// Where to go on to, from power-up.
    pub(crate) until_ns: u64,
    /// What the equipment senses meanwhile.
    pub(crate) sensed: Sensed,
    /// What the far end of each serial line says.
    pub(crate) said: [Vec<u8>; LINES],
    /// What is wrong with the board meanwhile.
    pub(crate) broken: Broken,
    /// What happens to the board at the step's beginning.
    pub(crate) blows: Vec<Blow>,
}

/// What is wrong with the board during a step.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Broken {
    /// Broken registers.
    pub(crate) sabotage: Sabotage,
    /// Nothing is in the card's slot.
    pub(crate) card_pulled: bool,
    /// The card is broken.
    pub(crate) card: CardDefects,
}

/// What happens to the board at once.
#[derive(Clone, Debug)]
pub(crate) enum Blow {
    /// The card is full.
    FillCard,
    /// The FRAM's bytes change by these masks.
    CorruptFram(Vec<u8>),
    /// The core stands still until it is restarted.
    Hang,
    /// The core's next access to a peripheral fails.
    Crash,
}

/// What the run answers.
#[derive(Clone, Debug, Default)]
pub(crate) struct Reading {
    /// The pins.
    pub(crate) pins: Pins,
    /// What the board said on each serial line.
    pub(crate) heard: [Vec<u8>; LINES],
}

/// What a run leaves behind.
pub(crate) struct Remains {
    /// The chips as they are.
    pub(crate) chips: Chips,
    /// What the run has to say about itself.
    pub(crate) accounts: Accounts,
}

/// Why a run failed.
#[derive(Debug, thiserror::Error)]
pub enum RunError {
    /// The emulator.
    #[error("the emulator: {0}")]
    Emulator(#[from] emulator::Error),
    /// The part or the image.
    #[error("the emulated microcontroller: {0}")]
    Part(#[from] rigless::soc::Error),
    /// The thread of the run.
    #[error("the emulator's thread: {0}")]
    Thread(#[from] std::io::Error),
    /// The run ended by itself.
    #[error("the emulator's run ended by itself")]
    Ended,
}

/// A run under way.
#[derive(Debug)]
pub(crate) struct Run {
    steps: SyncSender<Step>,
    readings: Receiver<Reading>,
    thread: JoinHandle<Result<Finished<Machine, Lockstep>, emulator::Error>>,
    epoch_ns: u64,
}

impl Run {
    /// Powers a board with these chips up at `epoch_ns` of the flight.
    pub(crate) fn start(images: Vec<Image>, chips: Chips, epoch_ns: u64) -> Result<Self, RunError> {
        let session = Session::new(Box::new(Machine::new(chips, epoch_ns)?), 0, VirtualNanos(0))?;
        let (steps, step) = sync_channel(1);
        let (reading, readings) = sync_channel(1);
        let driver =
            Lockstep { steps: step, readings: reading, broken: Broken::default(), hanging_since: None, started: false };
        let thread = std::thread::Builder::new()
            .name("emulator".to_owned())
            .spawn(move || emulator::run(session, &Start::new(&images), driver))?;
        Ok(Self { steps, readings, thread, epoch_ns })
    }

    /// Goes on by a step.
    pub(crate) fn step(&self, step: Step) -> Result<Reading, RunError> {
        self.steps.send(step).map_err(|_| RunError::Ended)?;
        self.readings.recv().map_err(|_| RunError::Ended)
    }

    /// Ends the run where it stands.
    pub(crate) fn end(self) -> Result<Remains, RunError> {
        drop(self.steps);
        let mut finished = self.thread.join().map_err(|_| RunError::Ended)??;
        let accounts = Accounts::of(&finished.session, finished.stop, self.epoch_ns);
        let chips = finished.session.board_mut().chips().ok_or(RunError::Ended)?;
        Ok(Remains { chips, accounts })
    }
}

/// The run's side of the talk.
#[derive(Debug)]
struct Lockstep {
    steps: Receiver<Step>,
    readings: SyncSender<Reading>,
    broken: Broken,
    /// While the core is made to hang: restarts so far.
    hanging_since: Option<usize>,
    started: bool,
}

impl Lockstep {
    /// Puts a step's news onto the board.
    fn apply(&mut self, step: Step, session: &mut Session<Machine>, host: &mut dyn Host, at: VirtualNanos) {
        let machine = session.board_mut();
        machine.sense(&step.sensed, at);
        for (nth, bytes) in step.said.iter().enumerate() {
            if let Some(line) = machine.line(nth) {
                line.say(bytes);
            }
        }
        machine.pull_card(step.broken.card_pulled);
        machine.sabotage(step.broken.sabotage);
        if let Some(card) = machine.card() {
            card.defects = step.broken.card;
            if self.broken.card_pulled && !step.broken.card_pulled {
                card.insert();
            }
        }
        for blow in step.blows {
            self.strike(blow, session, host);
        }
        self.broken = step.broken;
    }

    fn strike(&mut self, blow: Blow, session: &mut Session<Machine>, host: &mut dyn Host) {
        match blow {
            Blow::FillCard => {
                if let Some(card) = session.board_mut().card() {
                    card.fill();
                }
            }
            Blow::CorruptFram(masks) => {
                if let Some(fram) = session.board_mut().fram() {
                    fram.corrupt(&masks);
                }
            }
            Blow::Hang => {
                self.hanging_since = Some(session.resets().len());
                host.hold(true);
            }
            Blow::Crash => session.fail_next(PERIPHERALS.0, PERIPHERALS.1),
        }
    }
}

impl Driver<Machine> for Lockstep {
    fn on_settled(&mut self, session: &mut Session<Machine>, host: &mut dyn Host, settled: Settled) {
        match settled {
            Settled::Access { access, value } => {
                mend(session, host, access, value);
                if SABOTAGED.contains(&access.address) {
                    session.board_mut().sabotage(self.broken.sabotage);
                }
            }
            // The watchdog has bitten: the core goes on from its reset vector.
            Settled::Stop(_) if self.hanging_since.is_some_and(|resets| session.resets().len() > resets) => {
                self.hanging_since = None;
                host.hold(false);
            }
            _ => {}
        }
    }

    fn on_stop(&mut self, session: &mut Session<Machine>, stop: Stop, host: &mut dyn Host) -> Option<VirtualNanos> {
        if std::mem::replace(&mut self.started, true) {
            let machine = session.board_mut();
            let heard = std::array::from_fn(|nth| machine.line(nth).map(SerialLine::take).unwrap_or_default());
            self.readings.send(Reading { pins: machine.pins(), heard }).ok()?;
        }
        let step = self.steps.recv().ok()?;
        let until = VirtualNanos(step.until_ns);
        self.apply(step, session, host, stop.at);
        Some(until)
    }
}
