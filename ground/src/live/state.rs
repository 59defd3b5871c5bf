//! From messages to what is shown: a pure function of times and messages.
//!
//! It reads no clock and opens no port: whoever hears a message says when, by any clock that does not go backwards. Every
//! quantity remembers when it was heard, and is shown as stale when that is too long ago; nothing in it grows without bound
//! but the strip, which has its own.

use std::collections::VecDeque;
use std::sync::Arc;
use std::time::Duration;

use adit_protocol::beams::Beam;
use adit_protocol::mavlink::{
    AUTOPILOT_COMPONENT, Autopilot, BOARD_COMPONENT, CAMERA_COMPONENT, Counters, Incoming, Instrument, NO_AUTOPILOT,
    Target, VehicleBeat,
};
use adit_protocol::parameters::CaptureWiring;
use adit_protocol::record::Mode;
use adit_protocol::tag::CaptureTag;
use adit_protocol::telemetry::{Enforcement, Telemetry, Tunnelled};

use super::captures::Captures;
use super::quality::Quality;
use super::reading::Aged;
use super::setting::{Setting, SettingError};
use super::strip::Strip;
use super::view::{AutopilotView, BatteryView, LinkStatus, LinkView, Notice, RangeState, RangeView, View};
use super::warnings::{Circumstances, warnings};
use crate::link::Heard;
use crate::view::scene::section;

/// A silence of the board for so long is a loss of the link: it speaks twenty times a second.
const LINK_LASTS: Duration = Duration::from_millis(1300);
/// The board tells a range five times a second, and that there is none twice a second.
const RANGE_LASTS: Duration = Duration::from_millis(800);
/// Figures come twice a second.
const FIGURE_LASTS: Duration = Duration::from_millis(1600);
/// Battery, radio and heartbeats come about once a second.
const SLOW_LASTS: Duration = Duration::from_secs(5);
/// Notices that are kept.
const NOTICES: usize = 50;

/// The flight as far as it was heard.
#[derive(Debug, Default)]
pub struct State {
    system: Option<u8>,
    setting: Option<Arc<Setting>>,
    outline_m: Vec<[f64; 2]>,
    strip: Option<Strip>,
    captures: Captures,
    quality: Quality,
    line: Option<Result<String, String>>,
    counters: Counters,
    refused: u64,
    left_out: u64,
    board_heard: Option<Duration>,
    board_us: Option<u64>,
    mode: Aged<Mode>,
    autopilot: Aged<AutopilotView>,
    telemetry: Telemetry,
    offset_m: Aged<[f64; 2]>,
    roll_rad: Aged<f64>,
    ranges_m: [Aged<f64>; 4],
    odometer_m: Aged<f64>,
    speed_mps: Aged<f64>,
    limit_mps: Aged<f64>,
    enforcement: Aged<Enforcement>,
    shaft_rad: Aged<f64>,
    commanded: Aged<u32>,
    missed: Aged<u32>,
    water_level_m: Aged<f64>,
    battery: Aged<BatteryView>,
    radio: Aged<[Option<u8>; 3]>,
    notices: VecDeque<Notice>,
}

impl State {
    /// Nothing was heard. `system`: the vehicle, if not that of the first board heard.
    pub fn new(system: Option<u8>) -> Self {
        Self { system, ..Self::default() }
    }

    /// What is known of the flight: with it the section and the strip are shown.
    ///
    /// # Errors
    /// [`SettingError`]
    pub fn set(&mut self, setting: Setting) -> Result<(), SettingError> {
        let setting = Arc::new(setting);
        self.strip = Some(Strip::new(Arc::clone(&setting))?);
        let polyline = section(&setting.profile);
        self.outline_m = polyline.y_m.iter().zip(&polyline.z_m).map(|(y_m, z_m)| [*y_m, *z_m]).collect();
        self.setting = Some(setting);
        Ok(())
    }

    /// What is known of the flight.
    pub fn setting(&self) -> Option<&Arc<Setting>> {
        self.setting.as_ref()
    }

    /// The wall as far as it was seen.
    pub fn strip(&self) -> Option<&Strip> {
        self.strip.as_ref()
    }

    /// The line's other end, or why there is none; what came in over it so far.
    pub fn line(&mut self, line: Result<String, String>, counters: Counters) {
        self.line = Some(line);
        self.counters = counters;
    }

    /// So many messages came too fast to be shown.
    pub fn leave_out(&mut self, messages: u64) {
        self.left_out += messages;
        // They were not lost on the link.
        self.quality.skip();
    }

    /// A message was heard.
    pub fn hear(&mut self, now: Duration, heard: &Heard) {
        let frame = &heard.frame;
        self.quality.hear(now, (frame.system, frame.component), frame.sequence);
        if !heard.trust.is_believed() {
            self.refused += 1;
            return;
        }
        if self.system.is_none() && frame.component == BOARD_COMPONENT {
            self.system = Some(frame.system);
        }
        if self.system != Some(frame.system) {
            return;
        }
        if frame.component == BOARD_COMPONENT {
            self.board_heard = Some(now);
        }
        if let Some(incoming) = &heard.incoming {
            self.understand(now, frame.component, incoming);
        } else if let Some(instrument) = Instrument::read(frame) {
            self.read(now, frame.component, instrument);
        }
    }

    fn understand(&mut self, now: Duration, component: u8, incoming: &Incoming) {
        match (component, incoming) {
            (BOARD_COMPONENT, Incoming::Heartbeat { custom_mode, .. }) => {
                self.mode.set(now, mode(*custom_mode));
            }
            (AUTOPILOT_COMPONENT, &Incoming::Heartbeat { autopilot, base_mode, custom_mode, .. })
                if autopilot != NO_AUTOPILOT =>
            {
                let is_armed = VehicleBeat { autopilot, base_mode, custom_mode }.is_armed();
                let autopilot = Autopilot::from(autopilot);
                let name = autopilot.name().unwrap_or("autopilot");
                let mode = autopilot.mode_name(custom_mode);
                self.autopilot.set(now, Some(AutopilotView { name, mode, is_armed }));
            }
            (AUTOPILOT_COMPONENT, Incoming::Attitude { angles_rad: [roll_rad, ..] }) => {
                self.roll_rad.set(now, finite(*roll_rad));
            }
            (BOARD_COMPONENT, Incoming::Tunnel { kind, payload, .. }) => match Tunnelled::read(*kind, payload) {
                Some(Tunnelled::Telemetry(telemetry)) => self.board(now, &telemetry),
                Some(Tunnelled::Tag(tag)) => self.tag(now, &tag),
                None => {}
            },
            (BOARD_COMPONENT, Incoming::NamedValue { name, value }) => self.figure(now, name, *value),
            (CAMERA_COMPONENT, Incoming::ImageCaptured { index, result, .. }) => {
                let (capture, is_taken) = (index.wrapping_add(1).cast_unsigned(), *result == 1);
                self.captures.tell(capture, is_taken);
                if let Some(strip) = &mut self.strip {
                    strip.tell(capture, is_taken);
                }
            }
            (_, Incoming::Text { severity, text }) => self.note(now, component, *severity, text.to_string()),
            _ => {}
        }
    }

    fn read(&mut self, now: Duration, component: u8, instrument: Instrument) {
        match instrument {
            Instrument::Range { beam: Some(beam), range_m } if component == BOARD_COMPONENT => {
                if let Some(range) = self.ranges_m.get_mut(place(beam)) {
                    range.set(now, finite(range_m));
                }
            }
            Instrument::Battery { voltage_v, remaining } if component == AUTOPILOT_COMPONENT => {
                let wide = |value: Option<f32>| value.map(f64::from);
                self.battery.set(now, Some(BatteryView { voltage_v: wide(voltage_v), remaining: wide(remaining) }));
            }
            Instrument::Radio { signal, far_signal, noise } => self.radio.set(now, Some([signal, far_signal, noise])),
            _ => {}
        }
    }

    /// The board tells everything at once.
    fn board(&mut self, now: Duration, telemetry: &Telemetry) {
        if self.board_us.is_some_and(|before| telemetry.time_us < before) {
            self.captures = Captures::default();
            if let Some(strip) = &mut self.strip {
                strip.forget_captures();
            }
            self.note(now, BOARD_COMPONENT, 4, "the board has started again".to_owned());
        }
        self.board_us = Some(telemetry.time_us);
        self.telemetry = *telemetry;
        self.mode.set(now, Some(telemetry.mode));
        self.offset_m.set(now, telemetry.offset_m.and_then(|[y_m, z_m]| Some([finite(y_m)?, finite(z_m)?])));
        for (range, range_m) in self.ranges_m.iter_mut().zip(telemetry.ranges_m) {
            range.set(now, range_m.and_then(finite));
        }
        self.odometer_m.set(now, telemetry.odometer_m.and_then(finite));
        self.speed_mps.set(now, telemetry.speed_mps.and_then(finite));
        self.limit_mps.set(now, telemetry.limit_mps.and_then(finite));
        self.enforcement.set(now, Some(telemetry.enforcement));
        self.shaft_rad
            .set(now, finite(telemetry.shaft_rad).map(|shaft_rad| shaft_rad.rem_euclid(std::f64::consts::TAU)));
        self.commanded.set(now, Some(telemetry.captures));
        self.missed.set(now, Some(telemetry.missed));
        self.water_level_m.set(now, telemetry.water_level_m.and_then(finite).map(above_floor));
    }

    /// The board tells figures one by one, for displays that know no better: a link may carry these and nothing else.
    fn figure(&mut self, now: Duration, name: &str, value: f32) {
        let Some(value) = finite(value) else { return };
        match name {
            "off_y" | "off_z" => {
                let [y_m, z_m] = self.offset_m.last().copied().unwrap_or_default();
                self.offset_m.set(now, Some(if name == "off_y" { [value, z_m] } else { [y_m, value] }));
            }
            "limit" => self.limit_mps.set(now, Some(value)),
            "speed" => self.speed_mps.set(now, Some(value)),
            "captures" => self.commanded.set(now, Some(value as u32)),
            "missed" => self.missed.set(now, Some(value as u32)),
            "water" => self.water_level_m.set(now, Some(above_floor(value))),
            "enforce" => {
                let states = [
                    Enforcement::Idle,
                    Enforcement::Requested,
                    Enforcement::Enforced,
                    Enforcement::Ineffective,
                    Enforcement::NotPossible,
                ];
                self.enforcement.set(now, states.get(value as usize).copied());
            }
            _ => {}
        }
    }

    fn tag(&mut self, now: Duration, tag: &CaptureTag) {
        self.captures.add(now, tag.capture);
        let Some(strip) = &mut self.strip else { return };
        strip.add(tag);
        if let Some(is_taken) = self.captures.fate(tag.capture) {
            strip.tell(tag.capture, is_taken);
        }
    }

    fn note(&mut self, now: Duration, component: u8, severity: u8, text: String) {
        let from = match component {
            BOARD_COMPONENT => "board".to_owned(),
            AUTOPILOT_COMPONENT => "autopilot".to_owned(),
            other => format!("component {other}"),
        };
        self.notices.truncate(NOTICES - 1);
        self.notices.push_front(Notice { at_s: now.as_secs_f64(), severity, from, text });
    }

    /// A capture whose fate was not heard though it must be known by now: whom to ask, and for which image.
    pub fn missing_report(&self, now: Duration) -> Option<(Target, u32)> {
        let capture = self.captures.unanswered(now)?;
        Some(([self.system?, CAMERA_COMPONENT], capture.saturating_sub(1)))
    }

    /// What is shown at `now`.
    pub fn show(&self, now: Duration) -> View {
        let fresh = FIGURE_LASTS;
        let wiring = self.setting.as_ref().map(|setting| setting.wiring);
        let offset_m = self.offset_m.show(now, fresh);
        let mut view = View {
            time_s: now.as_secs_f64(),
            board_s: self.board_us.map(|us| us as f64 * 1e-6),
            link: self.show_link(now),
            mode: self.mode.show(now, SLOW_LASTS),
            autopilot: self.autopilot.show(now, SLOW_LASTS),
            sigma_m: offset_m.fresh().and(self.telemetry.sigma_m).map(|sigma_m| sigma_m.map(f64::from)),
            offset_m,
            roll_rad: self.roll_rad.show(now, fresh),
            ranges: Beam::ALL.map(|beam| self.show_range(now, beam)),
            odometer_m: self.odometer_m.show(now, fresh),
            speed_mps: self.speed_mps.show(now, fresh),
            limit_mps: self.limit_mps.show(now, fresh),
            enforcement: self.enforcement.show(now, fresh),
            is_overspeed: self.telemetry.overspeed,
            shaft_rad: self.shaft_rad.show(now, fresh),
            captures: self.commanded.show(now, fresh),
            confirmed: (wiring != Some(CaptureWiring::None)).then(|| self.captures.confirmed()),
            missed: self.missed.show(now, fresh),
            water_level_m: self.water_level_m.show(now, fresh),
            battery: self.battery.show(now, SLOW_LASTS),
            gaps: self.strip.as_ref().map(|strip| strip.gaps().to_vec()).unwrap_or_default(),
            notices: self.notices.iter().cloned().collect(),
            outline_m: self.outline_m.clone(),
            ..View::default()
        };
        view.warnings = warnings(
            &view,
            &Circumstances {
                setting: self.setting.as_deref(),
                is_gap_open: self.telemetry.gap_open,
                unplaced: self.strip.as_ref().map_or(0, Strip::unplaced),
                first_capture: self.captures.first(),
            },
        );
        view
    }

    fn show_range(&self, now: Duration, beam: Beam) -> RangeView {
        let reading = self.ranges_m.get(place(beam)).map(|range| range.show(now, RANGE_LASTS)).unwrap_or_default();
        let is_fitted = self.setting.as_ref().is_none_or(|setting| *setting.fitted.get(beam));
        let state = match reading {
            _ if !is_fitted => RangeState::Unfitted,
            reading if reading.age_s.is_none() => RangeState::Unknown,
            reading if reading.is_stale => RangeState::Stale,
            reading if reading.value.is_none() => RangeState::Invalid,
            _ => RangeState::Valid,
        };
        RangeView { state, range_m: reading.value.filter(|_| state == RangeState::Valid), age_s: reading.age_s }
    }

    fn show_link(&self, now: Duration) -> LinkView {
        let silent = self.board_heard.map(|at| now.saturating_sub(at));
        let status = match (silent, &self.line) {
            (None, _) => LinkStatus::Waiting,
            (Some(silent), Some(Ok(_)) | None) if silent <= LINK_LASTS => LinkStatus::Up,
            _ => LinkStatus::Lost,
        };
        let (rate_hz, lost) = self.quality.show(now);
        LinkView {
            status,
            words: match &self.line {
                Some(Ok(words) | Err(words)) => words.clone(),
                None => String::new(),
            },
            silent_s: silent.map(|silent| silent.as_secs_f64()),
            rate_hz,
            lost,
            damaged: self.counters.bad,
            refused: self.refused,
            left_out: self.left_out,
            radio: self.radio.show(now, SLOW_LASTS),
        }
    }
}

/// A level, which is none below the floor: there it is the range sensor's noise.
fn above_floor(level_m: f64) -> f64 {
    level_m.max(0.0)
}

fn finite(value: f32) -> Option<f64> {
    Some(f64::from(value)).filter(|value| value.is_finite())
}

/// Where a beam's range stands: up, right, down, left.
fn place(beam: Beam) -> usize {
    Beam::ALL.iter().position(|other| *other == beam).unwrap_or_default()
}

fn mode(number: u32) -> Option<Mode> {
    let modes = [Mode::Boot, Mode::Idle, Mode::SelfTest, Mode::Ready, Mode::Scanning, Mode::Degraded, Mode::Fault];
    modes.into_iter().find(|mode| *mode as u32 == number)
}

#[cfg(test)]
mod tests;
