//! The emulated board as the simulator's loop sees it: inputs in, outputs out, five milliseconds at a time.
//!
//! At each step the microcontroller first runs up to this instant on the inputs of the step before; then its pins and
//! messages are read, and the new inputs are put on its chips. So the board sees the world a step late, never early, and
//! the world sees the board at the instant it asks. The mode, the speed limit and the estimate come over the link, as an
//! autopilot gets them.

use std::path::Path;

use adit_firmware::io::{CentringStatus, Inputs, Outputs};
use adit_hil_sim::flight::{Board, BoardError};
use adit_hil_sim::plant::vehicle::VehicleState;
use adit_hil_sim::seed::{Random, Stream};
use adit_protocol::beams::Beams;
use adit_protocol::parameters::{Parameters, RangeBus};
use rigless::image::Image;

use crate::equipment::Equipment;
use crate::faults::{BoardFault, BoardFaultKind, BoardFaults};
use crate::flood::Flood;
use crate::hub::Hub;
use crate::machine::{
    APPLICATION_START, BOOTLOADER, BlockImage, CardDefects, Chips, FLASH_START, FRAM_BYTES, LINES, Pins, Sabotage,
    VolumeError,
};
use crate::report::{Accounts, Report, Restart, RestartCause};
use crate::run::{Blow, Broken, Reading, Remains, Run, RunError, Step};
use crate::vehicle_link::VehicleLink;

/// Blocks of the card that is in the slot unless another is given: 1 GB.
const CARD_BLOCKS: u32 = 1 << 21;
/// Positions of the serial lines.
const TELEM1: usize = 0;
const TELEM2: usize = 1;
const HUB: usize = 2;
/// Bits on the line per byte: start, eight, stop.
const BITS_PER_BYTE: u64 = 10;
/// Where this file's draws stand among those of [`Stream::Faults`].
const GARBAGE_DRAWS: u64 = 2000;

/// Why an emulated board could not be built or did not run to its end.
#[derive(Debug, thiserror::Error)]
pub enum EmulatorError {
    /// The flash image.
    #[error("flash image: {0}")]
    Image(#[from] rigless::image::Error),
    /// The card.
    #[error(transparent)]
    Volume(#[from] VolumeError),
    /// The run.
    #[error(transparent)]
    Run(#[from] RunError),
}

/// What is built into the board before it is switched on.
#[derive(Clone, Debug)]
pub struct Setup {
    /// What the FRAM holds; shorter contents are filled up with zeros.
    pub fram: Vec<u8>,
    /// The card in the slot.
    pub card: BlockImage,
    /// What goes wrong with the board.
    pub faults: Vec<BoardFault>,
    /// The secret with which the pilot signs his commands, if he does.
    pub key: Option<[u8; 32]>,
    /// Seed of what is random in it.
    pub seed: u64,
}

impl Setup {
    /// A FRAM without parameters, an empty formatted card, no faults.
    ///
    /// # Errors
    /// [`VolumeError`] if the card cannot be formatted.
    pub fn new(seed: u64) -> Result<Self, VolumeError> {
        Ok(Self { fram: Vec::new(), card: BlockImage::formatted(CARD_BLOCKS)?, faults: Vec::new(), key: None, seed })
    }
}

/// Whether the board has power, and what it is then.
#[derive(Debug)]
enum Power {
    On(Run),
    Off(Box<Chips>),
    /// The emulator failed; why is kept until the end.
    Failed(RunError),
    /// Only while power changes.
    Changing,
}

/// An emulated board.
#[derive(Debug)]
pub struct EmulatedBoard {
    images: Vec<Image>,
    power: Power,
    baud: u64,
    faults: BoardFaults,
    random: Random,
    equipment: Equipment,
    link: VehicleLink,
    flood: Flood,
    hub: Option<Hub>,
    said: [Vec<u8>; LINES],
    sent: [Vec<u8>; LINES],
    heard_now: [Vec<u8>; LINES],
    /// What the vehicle said on TELEM1 in the last step.
    vehicle_said: Vec<u8>,
    inputs: Inputs,
    pins: Pins,
    now_ns: u64,
    epoch_ns: u64,
    accounts: Vec<Accounts>,
    power_ups: Vec<Restart>,
}

impl EmulatedBoard {
    /// A board with `elf` (the flash image, linked behind the bootloader) in its flash, fitted as `parameters` say.
    ///
    /// # Errors
    /// [`EmulatorError`] if the image cannot be read or the emulator cannot start.
    pub fn new(elf: &Path, parameters: &Parameters, setup: Setup) -> Result<Self, EmulatorError> {
        let application = Image::read(elf, None)?;
        Self::with_image(application, parameters, setup)
    }

    /// As [`Self::new`], with bare code that goes to where the application is linked.
    ///
    /// # Errors
    /// As [`Self::new`].
    pub fn from_code(code: &[u8], parameters: &Parameters, setup: Setup) -> Result<Self, EmulatorError> {
        let application = Image::new(Path::new("code"), code.to_vec(), Some(u64::from(APPLICATION_START)))?;
        Self::with_image(application, parameters, setup)
    }

    fn with_image(application: Image, parameters: &Parameters, setup: Setup) -> Result<Self, EmulatorError> {
        let bootloader = Image::new(Path::new("bootloader"), BOOTLOADER.to_vec(), Some(FLASH_START))?;
        let images = vec![bootloader, application];
        let chips = Chips::fitted(parameters, &setup.fram, setup.card);
        Ok(Self {
            power: Power::On(Run::start(images.clone(), chips, 0)?),
            images,
            baud: u64::from(parameters.link.baud),
            faults: BoardFaults::new(&setup.faults),
            random: Random::numbered(setup.seed, Stream::Faults, GARBAGE_DRAWS),
            equipment: Equipment::new(parameters.ranges.family),
            link: VehicleLink::new(parameters.link.axis_yaw_rad.unwrap_or(0.0), setup.key),
            flood: Flood::new(),
            hub: (parameters.ranges.bus == RangeBus::Hub).then(|| Hub::new(&parameters.ranges)),
            said: Default::default(),
            sent: Default::default(),
            heard_now: Default::default(),
            vehicle_said: Vec::new(),
            inputs: Inputs::default(),
            pins: Pins::default(),
            now_ns: 0,
            epoch_ns: 0,
            accounts: Vec::new(),
            power_ups: Vec::new(),
        })
    }

    /// The pins as they were at the last step.
    pub fn pins(&self) -> Pins {
        self.pins
    }

    /// What the vehicle said on TELEM1 in the last step.
    pub fn vehicle_said(&self) -> &[u8] {
        &self.vehicle_said
    }

    /// What the board has sent on TELEM1 and TELEM2 during the last step.
    pub fn heard(&self) -> [&[u8]; 2] {
        [&self.heard_now[TELEM1], &self.heard_now[TELEM2]]
    }

    /// Says `bytes` to the board on TELEM1, beside what the vehicle says.
    pub fn say_on_telem1(&mut self, bytes: &[u8]) {
        self.said[TELEM1].extend(bytes);
    }

    /// Says `bytes` to the board on TELEM2.
    pub fn say_on_telem2(&mut self, bytes: &[u8]) {
        self.said[TELEM2].extend(bytes);
    }

    /// Switches the board off and says how it went.
    ///
    /// # Errors
    /// [`EmulatorError::Run`] if the emulator failed on the way.
    pub fn finish(mut self) -> Result<Report, EmulatorError> {
        let chips = match std::mem::replace(&mut self.power, Power::Changing) {
            Power::On(run) => {
                let Remains { chips, accounts } = run.end()?;
                self.accounts.push(accounts);
                chips
            }
            Power::Off(chips) => *chips,
            Power::Failed(error) => return Err(error.into()),
            Power::Changing => return Err(RunError::Ended.into()),
        };
        let mut report = Report::new(chips, self.sent);
        for accounts in &self.accounts {
            report.add(accounts);
        }
        report.restarts.extend(&self.power_ups);
        report.restarts.sort_by_key(|restart| restart.at_ns);
        Ok(report)
    }

    /// Runs the microcontroller up to `until_ns` of the flight, over every change of its supply.
    fn advance(&mut self, until_ns: u64) {
        while self.now_ns < until_ns {
            self.switch();
            let next_ns = self.faults.power_edge(self.now_ns, until_ns).unwrap_or(until_ns);
            let safety_switch = self.faults.holds(BoardFaultKind::SafetySwitch, self.now_ns);
            let mut step = Step {
                until_ns: next_ns.saturating_sub(self.epoch_ns),
                sensed: self.equipment.sense(self.now_ns / 1000, &self.inputs, safety_switch),
                ..Step::default()
            };
            if let Power::On(run) = &self.power {
                step.broken = broken(&self.faults, self.now_ns);
                step.blows = blows(&mut self.faults, &mut self.random, self.now_ns);
                step.said = std::mem::take(&mut self.said);
                if self.faults.holds(BoardFaultKind::TelemetryGarbage, self.now_ns) {
                    let bytes = (next_ns - self.now_ns) * self.baud / BITS_PER_BYTE / 1_000_000_000;
                    step.said[TELEM1] = (0..bytes).map(|_| self.random.index(256) as u8).collect();
                }
                if self.faults.holds(BoardFaultKind::TelemetryFlood, self.now_ns) {
                    let room = (next_ns - self.now_ns) * self.baud / BITS_PER_BYTE / 1_000_000_000;
                    let room = (room as usize).saturating_sub(step.said[TELEM1].len());
                    step.said[TELEM1].extend(self.flood.say(room, self.link.commanded()));
                }
                if let Some(hub) = &mut self.hub {
                    step.said[HUB].extend(hub.say(self.now_ns / 1000, &step.sensed));
                }
                match run.step(step) {
                    Ok(reading) => self.read(reading),
                    Err(error) => self.fail(error),
                }
            }
            self.now_ns = next_ns;
        }
        self.switch();
    }

    fn read(&mut self, reading: Reading) {
        self.pins = reading.pins;
        for (nth, bytes) in reading.heard.into_iter().enumerate() {
            self.sent[nth].extend(&bytes);
            self.heard_now[nth].extend(bytes);
        }
    }

    /// Switches the supply as the faults have it at this instant.
    fn switch(&mut self) {
        let cut = self.faults.holds(BoardFaultKind::PowerCut, self.now_ns);
        self.power = match std::mem::replace(&mut self.power, Power::Changing) {
            Power::On(run) if cut => match run.end() {
                Ok(Remains { chips, accounts }) => {
                    self.accounts.push(accounts);
                    self.pins = Pins::default();
                    self.link.forget();
                    Power::Off(Box::new(chips))
                }
                Err(error) => Power::Failed(error),
            },
            Power::Off(chips) if !cut => match Run::start(self.images.clone(), *chips, self.now_ns) {
                Ok(run) => {
                    self.epoch_ns = self.now_ns;
                    self.power_ups.push(Restart { at_ns: self.now_ns, cause: RestartCause::PowerOn });
                    Power::On(run)
                }
                Err(error) => Power::Failed(error),
            },
            power => power,
        };
    }

    /// Keeps why the run failed; what its thread says goes before what the talk says.
    fn fail(&mut self, error: RunError) {
        self.power = match std::mem::replace(&mut self.power, Power::Changing) {
            Power::On(run) => Power::Failed(run.end().err().unwrap_or(error)),
            power => power,
        };
    }

    fn outputs(&self) -> Outputs {
        let heard = &self.link.heard;
        let unknown = CentringStatus { offset_m: [0.0; 2], sigma_m: [0.0; 2], used: Beams::default() };
        Outputs {
            mode: heard.mode,
            servo_pulse_us: self.pins.servo_pulse_us,
            shutter: self.pins.shutter,
            light_level: self.pins.light_level,
            speed_limit_mps: heard.speed_limit_mps(),
            centring: heard.offset_m().map(|offset_m| CentringStatus { offset_m, ..unknown }),
            ..Outputs::default()
        }
    }
}

impl Board for EmulatedBoard {
    fn feel(&mut self, now_us: u64, vehicle: &VehicleState) {
        self.equipment.feel(now_us, vehicle);
    }

    fn step(&mut self, now_us: u64, inputs: &Inputs) -> Result<Outputs, BoardError> {
        let until_ns = now_us * 1000;
        self.heard_now = Default::default();
        self.advance(until_ns);
        self.link.hear(&self.heard_now[TELEM1]);
        if let Some(hub) = &mut self.hub {
            hub.hear(&self.heard_now[HUB]);
        }
        self.inputs = *inputs;
        self.vehicle_said = self.link.say(now_us, inputs);
        self.said[TELEM1].extend(&self.vehicle_said);
        Ok(self.outputs())
    }
}

/// What is wrong with the board from `now_ns` on.
fn broken(faults: &BoardFaults, now_ns: u64) -> Broken {
    let holds = |kind| faults.holds(kind, now_ns);
    Broken {
        sabotage: Sabotage {
            bus_held: holds(BoardFaultKind::BusHeld),
            telemetry_stuck: holds(BoardFaultKind::TelemetryStuck),
        },
        card_pulled: holds(BoardFaultKind::CardPulled),
        card: CardDefects {
            bad_reads: holds(BoardFaultKind::CardReadErrors),
            bad_writes: holds(BoardFaultKind::CardWriteErrors),
        },
    }
}

/// What happens to the board at `now_ns`.
fn blows(faults: &mut BoardFaults, random: &mut Random, now_ns: u64) -> Vec<Blow> {
    let mut blows = Vec::new();
    if faults.begins(BoardFaultKind::CardFull, now_ns) {
        blows.push(Blow::FillCard);
    }
    if faults.begins(BoardFaultKind::FramCorrupt, now_ns) {
        let mut mask = || if random.chance(0.125) { random.index(256) as u8 } else { 0 };
        blows.push(Blow::CorruptFram((0..FRAM_BYTES).map(|_| mask()).collect()));
    }
    if faults.begins(BoardFaultKind::CoreHang, now_ns) {
        blows.push(Blow::Hang);
    }
    if faults.begins(BoardFaultKind::CoreCrash, now_ns) {
        blows.push(Blow::Crash);
    }
    blows
}
