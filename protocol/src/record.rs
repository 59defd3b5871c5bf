//! What the board writes down: modes, events, samples, tags. The bytes are in [`crate::log`].

use serde::{Deserialize, Serialize};

use crate::beams::{Beam, Beams};
use crate::parameters::Parameters;
use crate::tag::{CaptureState, CaptureTag};

/// The board's mode.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub enum Mode {
    /// The tables of the speed law are being computed.
    #[default]
    Boot,
    /// Disarmed.
    Idle,
    /// Sensors, shaft and camera are being tried.
    SelfTest,
    /// Armed, waiting for the start.
    Ready,
    /// Taking photos, everything works.
    Scanning,
    /// Taking photos without position, encoder, autopilot or log; where the position is unknown, the speed limit is that of the
    /// worst place allowed.
    Degraded,
    /// Something needed has failed: no photos, speed limit zero.
    Fault,
}

/// Why a capture's photo counts as missed.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum MissReason {
    /// The camera never went busy.
    NeverBusy,
    /// The count of stored photos never went up.
    NeverConfirmed,
    /// The scan was stopped before the camera answered.
    Abandoned,
}

/// What is wrong with a range sensor.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum RangeFault {
    /// Not connected, or no new sample.
    Silent,
    /// Samples come, the value does not move.
    Frozen,
    /// A run of exact zeros.
    Zeros,
    /// The value jumps as no vehicle can.
    Jumping,
    /// Values that are no numbers or outside the sensor's range.
    Implausible,
}

/// What the self-test or the scan found broken.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum Failure {
    /// The parameters make no sense; the profile cannot be built or no step covers the wall.
    Parameters,
    /// The position in the section cannot be solved.
    Centring,
    /// The encoder is fitted but silent.
    Encoder,
    /// The shaft does not reach its angles.
    Shaft,
    /// The camera stays busy or takes no photos.
    Camera,
    /// The log cannot be written.
    Log,
}

impl Failure {
    /// All of them.
    pub const ALL: [Self; 6] = [Self::Parameters, Self::Centring, Self::Encoder, Self::Shaft, Self::Camera, Self::Log];

    /// The word that the board tells the pilot, behind [`FAILED`].
    pub fn word(self) -> &'static str {
        match self {
            Self::Parameters => "parameters",
            Self::Centring => "centring",
            Self::Encoder => "encoder",
            Self::Shaft => "shaft",
            Self::Camera => "camera",
            Self::Log => "log",
        }
    }
}

/// What a notice of a failure begins with.
pub const FAILED: &str = "failed: ";

/// Something that happened.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum EventKind {
    /// The mode changed.
    Mode {
        /// Before.
        from: Mode,
        /// After.
        to: Mode,
    },
    /// The self-test or the scan ended for this reason.
    Failed(Failure),
    /// A range sensor became faulty.
    RangeFault {
        /// Which.
        beam: Beam,
        /// How.
        fault: RangeFault,
    },
    /// A range sensor recovered.
    RangeRecovered(Beam),
    /// The position in the section can no longer be solved.
    CentringLost,
    /// It can again.
    CentringRegained,
    /// The encoder fell silent.
    EncoderLost,
    /// It is back.
    EncoderRegained,
    /// A turn did not settle in time.
    ShaftLate {
        /// The capture it was meant for.
        capture: u32,
    },
    /// A capture's photo is missing.
    Missed {
        /// The capture.
        capture: u32,
        /// Why.
        reason: MissReason,
        /// Will it be repeated at the same angle?
        retry: bool,
    },
    /// The camera stored more photos than were commanded.
    SurplusPhotos {
        /// How many.
        count: u32,
        /// The last capture commanded before.
        after_capture: u32,
    },
    /// The measured speed rose above the limit.
    OverspeedBegan,
    /// It is below again.
    OverspeedEnded,
    /// No heartbeat of the autopilot.
    AutopilotLost,
    /// It is back.
    AutopilotRegained,
    /// The log can no longer be written: the card is full, pulled or broken.
    LogLost,
    /// It can again.
    LogRegained,
    /// The board started, for this reason.
    Started(StartCause),
    /// Log entries were dropped because too many came at once.
    EntriesDropped {
        /// How many.
        count: u32,
    },
}

/// Why the board started.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum StartCause {
    /// Power was switched on.
    PowerOn,
    /// The supply had dropped too low.
    BrownOut,
    /// The reset pin, as a probe or a button pulls it.
    Pin,
    /// The program asked for it, after a panic or a command.
    Software,
    /// A task had not reported in time.
    Watchdog,
    /// None that is known.
    Other,
}

/// Words for people, such as what the board said when it panicked.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Message {
    /// Since the board's start.
    pub time_us: u64,
    /// The words.
    pub text: heapless::String<MESSAGE_BYTES>,
}

/// The longest message.
pub const MESSAGE_BYTES: usize = 160;

/// An event and when it happened.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Event {
    /// Since the board's start.
    pub time_us: u64,
    /// What.
    pub kind: EventKind,
}

/// A capture's state moved on after its tag was written.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct TagUpdate {
    /// Which capture.
    pub capture: u32,
    /// Its new state.
    pub state: CaptureState,
    /// When this became known.
    pub time_us: u64,
}

/// A periodic sample of centring.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct CentringSample {
    /// Since the board's start.
    pub time_us: u64,
    /// Solved position `[y, z]` in the section.
    pub offset_m: Option<[f32; 2]>,
    /// One standard deviation of it, per axis.
    pub sigma_m: Option<[f32; 2]>,
    /// Which beams took part.
    pub used: Beams<bool>,
    /// Level above the floor of whatever the downward beam met: expected minus measured range; water or sludge.
    pub water_level_m: Option<f32>,
}

/// A periodic sample of the speed limit.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct SpeedSample {
    /// Since the board's start.
    pub time_us: u64,
    /// The limit asked for.
    pub limit_mps: Option<f32>,
    /// The speed measured.
    pub speed_mps: Option<f32>,
    /// The largest step per image that the bound allows here.
    pub step_m: Option<f32>,
    /// Time per image that the limit reckons with.
    pub image_period_s: f32,
}

/// The first record of every log file.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Header {
    /// Version of the log's format, [`crate::log::FORMAT`].
    pub format: u16,
    /// Version of the program that wrote it.
    pub program: heapless::String<24>,
    /// Hash of the parameters, [`crate::log::parameters_hash`].
    pub parameters_hash: u64,
    /// The parameters in force.
    pub parameters: Parameters,
}

/// What the controller asks to be written; never the header.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub enum Entry {
    /// A capture's tag; exactly one per capture.
    Tag(CaptureTag),
    /// A capture's state moved on.
    TagUpdate(TagUpdate),
    /// Something happened.
    Event(Event),
    /// A periodic sample.
    Centring(CentringSample),
    /// A periodic sample.
    Speed(SpeedSample),
}

/// Any record of a log.
#[derive(Clone, Debug, PartialEq)]
#[expect(
    clippy::large_enum_variant,
    reason = "no allocation on the board; the board itself passes entries, not records"
)]
pub enum Record {
    /// The first of a file.
    Header(Header),
    /// Words for people.
    Message(Message),
    /// All others.
    Entry(Entry),
}
