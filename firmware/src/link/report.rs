//! What the pilot sees: ranges and figures in turn, words when something changes, and everything in one message for programs of
//! our own kind.
//!
//! | name | figure |
//! |---|---|
//! | `off_y`, `off_z` | place in the section, m, right and down |
//! | `limit`, `speed` | m/s |
//! | `enforce` | 0 no limit, 1 requested, 2 enforced, 3 ineffective, 4 not possible |
//! | `captures`, `missed` | counts |
//! | `water` | m above the floor |
//! | `step_us`, `stack_b` | longest step of the controller, depth of the stack |

use adit_protocol::beams::{Beam, Beams};
use adit_protocol::mavlink::{OutFrame, RangeReport, Sender, Severity, TEXT_BYTES};
use adit_protocol::record::Mode;
use adit_protocol::telemetry::{Enforcement, TELEMETRY_KIND, Telemetry, tunnelled};

use super::enforce::is_due;
use super::{Diagnosis, VehicleView};
use crate::io::Outputs;

const RANGE_S: f32 = 0.05;
const FIGURE_S: f32 = 0.05;
const TELEMETRY_S: f32 = 0.5;
/// Figures of the display, in turn; a name has ten letters at most.
const FIGURES: [&str; 10] =
    ["off_y", "off_z", "limit", "speed", "captures", "missed", "water", "step_us", "stack_b", "enforce"];

/// Words of at most fifty letters.
pub(super) type Text = heapless::String<TEXT_BYTES>;

/// A speed in words, with two decimals. The core library's way of writing a single takes 12 KiB of flash.
#[derive(Clone, Copy, Debug)]
pub(super) struct Speed(pub(super) f32);

impl core::fmt::Display for Speed {
    fn fmt(&self, formatter: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        // The cast saturates and takes NaN for zero.
        let hundredths = (self.0 * 100.0 + 0.5) as u16;
        write!(formatter, "{}.{:02}", hundredths / 100, hundredths % 100)
    }
}

/// The newest of what is to be shown, and whose turn it is.
#[derive(Clone, Debug, Default)]
pub(super) struct Report {
    telemetry: Telemetry,
    figures: [Option<f32>; FIGURES.len()],
    limits_m: [f32; 2],
    range_faults: Beams<bool>,
    notices: heapless::Deque<(Severity, Text), 6>,
    range_us: Option<u64>,
    range: usize,
    figure_us: Option<u64>,
    figure: usize,
    telemetry_us: Option<u64>,
}

impl Report {
    pub(super) fn new(limits_m: [f32; 2]) -> Self {
        Self { limits_m, ..Self::default() }
    }

    /// Tells the pilot. What does not fit is dropped: the first trouble tells most.
    pub(super) fn say(&mut self, severity: Severity, text: Text) {
        let _ = self.notices.push_back((severity, text));
    }

    /// Tells the pilot words that are put together here.
    pub(super) fn say_words(&mut self, severity: Severity, words: core::fmt::Arguments<'_>) {
        let mut text = Text::new();
        // What is too long is cut at a whole piece.
        let _ = core::fmt::Write::write_fmt(&mut text, words);
        self.say(severity, text);
    }

    /// The next words.
    pub(super) fn take_notice(&mut self) -> Option<(Severity, Text)> {
        self.notices.pop_front()
    }

    /// A change of mode is news.
    pub(super) fn announce(&mut self, mode: Mode) {
        let (severity, words) = match mode {
            Mode::Boot => (Severity::Info, "rotator: starting"),
            Mode::Idle => (Severity::Info, "rotator: idle"),
            Mode::SelfTest => (Severity::Info, "rotator: self-test"),
            Mode::Ready => (Severity::Info, "rotator: ready"),
            Mode::Scanning => (Severity::Info, "rotator: scanning"),
            Mode::Degraded => (Severity::Warning, "rotator: scanning, degraded"),
            Mode::Fault => (Severity::Error, "rotator: fault, no photos"),
        };
        self.say_words(severity, format_args!("{words}"));
    }

    /// Takes what there is to show.
    pub(super) fn note(
        &mut self,
        now_us: u64,
        outputs: &Outputs,
        ranges_m: [Option<f32>; 4],
        vehicle: &VehicleView,
        enforcement: Enforcement,
        diagnosis: Diagnosis,
    ) {
        let display = &outputs.display;
        if display.range_faults != self.range_faults {
            self.range_faults = display.range_faults;
            // A sensor that fails is told at once, not in half a second.
            self.telemetry_us = None;
        }
        // A silent or frozen sensor's last reading is none.
        let mut ranges_m = ranges_m;
        for (range_m, beam) in ranges_m.iter_mut().zip(Beam::ALL) {
            *range_m = range_m.filter(|_| !display.range_faults.get(beam));
        }
        self.telemetry = Telemetry {
            time_us: now_us,
            mode: outputs.mode,
            shaft_rad: outputs.shaft_setpoint_rad,
            offset_m: outputs.centring.map(|centring| centring.offset_m),
            sigma_m: outputs.centring.map(|centring| centring.sigma_m),
            ranges_m,
            odometer_m: vehicle.odometer_m,
            speed_mps: vehicle.speed_mps,
            limit_mps: outputs.speed_limit_mps,
            enforcement,
            overspeed: display.overspeed,
            gap_open: display.gap_open,
            captures: display.captures,
            missed: display.missed,
            water_level_m: display.water_level_m,
        };
        let [offset_y_m, offset_z_m] = outputs.centring.map_or([None; 2], |centring| centring.offset_m.map(Some));
        self.figures = [
            offset_y_m,
            offset_z_m,
            outputs.speed_limit_mps,
            display.speed_mps,
            Some(display.captures as f32),
            Some(display.missed as f32),
            display.water_level_m,
            Some(diagnosis.step_us as f32),
            Some(diagnosis.stack_bytes as f32),
            Some(f32::from(enforcement as u8)),
        ];
    }

    /// The next picture that is due.
    pub(super) fn next_frame(&mut self, now_us: u64, sender: &mut Sender) -> Option<OutFrame> {
        let time_ms = (now_us / 1000) as u32;
        if is_due(&mut self.range_us, now_us, RANGE_S) {
            let index = self.range;
            self.range = (index + 1) % Beam::ALL.len();
            if let (Some(beam), Some(Some(range_m))) = (Beam::ALL.get(index), self.telemetry.ranges_m.get(index)) {
                return Some(
                    sender.range(time_ms, &RangeReport { beam: *beam, range_m: *range_m, limits_m: self.limits_m }),
                );
            }
        }
        if is_due(&mut self.figure_us, now_us, FIGURE_S) {
            let index = self.figure;
            self.figure = (index + 1) % FIGURES.len();
            if let (Some(name), Some(Some(value))) = (FIGURES.get(index), self.figures.get(index)) {
                return Some(sender.named_value(time_ms, name, *value));
            }
        }
        if is_due(&mut self.telemetry_us, now_us, TELEMETRY_S) {
            let payload = tunnelled(&self.telemetry)?;
            return Some(sender.tunnel([0, 0], TELEMETRY_KIND, &payload));
        }
        None
    }
}
