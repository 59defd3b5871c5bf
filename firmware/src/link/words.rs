//! Words for the pilot about the limit: changes in how far it is in force are news.

use adit_protocol::mavlink::Severity;
use adit_protocol::telemetry::Enforcement;
use nalgebra::ComplexField;

use super::enforce::Cause;
use super::modes::Row;
use super::report::Speed;
use super::{Link, VehicleView, hold};
use crate::io::Outputs;
use crate::time::has_passed;

/// The same words about the limit come no more often than this.
const SAY_AGAIN_S: f32 = 5.0;

impl Link {
    /// A change in how far the limit is in force is news.
    pub(super) fn say_enforcement(&mut self, now_us: u64, row: Option<Row>, outputs: &Outputs, vehicle: &VehicleView) {
        let mode = row.map_or("", |row| row.name);
        let (state, cause) = self.enforcer.state();
        let news = (state, cause, mode);
        if matches!(state, Enforcement::Idle | Enforcement::Requested) {
            // Being asked is no news, but what comes after is, even if it was said before.
            if state == Enforcement::Idle {
                self.said = None;
            }
            return;
        }
        if self
            .said
            .is_some_and(|(said, at_us)| said == news && (cause.is_none() || !has_passed(at_us, now_us, SAY_AGAIN_S)))
        {
            return;
        }
        self.said = Some((news, now_us));
        let limit = Speed(outputs.speed_limit_mps.unwrap_or_default());
        let speed = Speed(vehicle.speed_mps.map_or(0.0, ComplexField::abs));
        let report = &mut self.report;
        match cause {
            None => report.say_words(Severity::Info, format_args!("limit {limit} m/s in force in {mode}")),
            Some(Cause::NoAutopilot) => {
                report.say_words(Severity::Warning, format_args!("limit {limit} m/s: no autopilot heard"));
            }
            Some(Cause::Mode) => {
                report.say_words(Severity::Warning, format_args!("{mode} takes no limit: keep below {limit} m/s"));
            }
            Some(Cause::Floor) => {
                let floor = Speed(row.map_or(0.0, |row| row.floor_mps));
                report.say_words(Severity::Warning, format_args!("{mode} takes {floor} at least: keep below {limit}"));
            }
            Some(Cause::Refused(refusal)) => {
                let why = match refusal {
                    hold::Refusal::Unknown => "has no speed parameter",
                    hold::Refusal::Ambiguous => "has two speed parameters",
                    hold::Refusal::Implausible => "speed parameter odd",
                    hold::Refusal::NotKept => "FRAM keeps no value",
                };
                report.say_words(Severity::Warning, format_args!("{mode}: {why}, keep below {limit} m/s"));
            }
            Some(Cause::Denied) => {
                report.say_words(Severity::Error, format_args!("autopilot refuses {limit} m/s in {mode}"));
            }
            Some(Cause::TooFast) => {
                report.say_words(Severity::Error, format_args!("TOO FAST: {speed} m/s, limit {limit} ignored"));
            }
        }
    }
}
