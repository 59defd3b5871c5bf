//! The table `[board]` with `[board.shaft]`, `[board.shutter]`, `[board.ranges]`, `[board.link]` and `[board.log]`, all optional.

use super::quantity::{Quantity, Unit};
use super::reader::Section;
use super::{BoardPlan, SurveyConfig};
use crate::beams::Beams;
use crate::parameters::{
    CaptureWiring, LinkParameters, LogParameters, RangeBus, RangeFamily, RangeParameters, ServoParameters,
    ShaftParameters, ShutterParameters, Trigger,
};

const DURATION: Quantity = Quantity::new(Unit::Second, 0.0, 30.0);
const LENGTH: Quantity = Quantity::new(Unit::Metre, 0.0, 100.0);
const LEVER: Quantity = Quantity::new(Unit::Metre, -3.0, 3.0);
const LEVEL: Quantity = Quantity::new(Unit::Ratio, 0.0, 1.0);

/// Reads the table. The ranges' sigma defaults to the survey's.
pub(super) fn read(mut section: Section<'_>, survey: Option<&SurveyConfig>) -> BoardPlan {
    let plan = BoardPlan {
        shaft: shaft(section.section_or_empty("shaft")),
        shutter: shutter(section.section_or_empty("shutter")),
        ranges: ranges(section.section_or_empty("ranges"), survey),
        link: link(section.section_or_empty("link")),
        log: log(section.section_or_empty("log")),
    };
    if plan.shutter.trigger == Trigger::HeroBus && (plan.ranges.bus != RangeBus::Hub || plan.shaft.encoder) {
        section.complain("shutter.trigger", "hero-bus", "ranges.bus = \"hub\" and shaft.encoder = false beside it");
    }
    section.finish();
    plan
}

fn shaft(mut section: Section<'_>) -> ShaftParameters {
    let default = ShaftParameters::default();
    let slew = Quantity::new(Unit::DegreePerSecond, 5.0, 3600.0);
    let tolerance = Quantity::new(Unit::Degree, 0.05, 45.0);
    let shaft = ShaftParameters {
        encoder: section.flag_or("encoder", default.encoder),
        servo: servo(section.section_or_empty("servo")),
        slew_radps: section.maybe_number("slew_deg_per_s", slew).map_or(default.slew_radps, radians),
        settle_tolerance_rad: section
            .maybe_number("settle_tolerance_deg", tolerance)
            .map_or(default.settle_tolerance_rad, radians),
        settle_dwell_s: section.single_or("settle_dwell_s", DURATION, default.settle_dwell_s),
        turn_timeout_s: section.single_or("turn_timeout_s", DURATION, default.turn_timeout_s),
        late_turns_to_fault: byte(&mut section, "late_turns_to_fault", 1, default.late_turns_to_fault),
    };
    section.finish();
    shaft
}

fn servo(mut section: Section<'_>) -> ServoParameters {
    let default = ServoParameters::default();
    let pulse = Quantity::new(Unit::Microsecond, 500.0, 2500.0);
    let span = Quantity::new(Unit::Microsecond, -1000.0, 1000.0);
    let acceleration = Quantity::new(Unit::DegreePerSecondSquared, 50.0, 100_000.0);
    let slowest = Quantity::new(Unit::DegreePerSecond, 0.0, 90.0);
    let servo = ServoParameters {
        neutral_us: section.single_or("neutral_us", pulse, default.neutral_us),
        full_us: section.single_or("full_us", span, default.full_us),
        acceleration_radps2: section
            .maybe_number("acceleration_deg_per_s2", acceleration)
            .map_or(default.acceleration_radps2, radians),
        slowest_radps: section.maybe_number("slowest_deg_per_s", slowest).map_or(default.slowest_radps, radians),
    };
    if servo.full_us == 0.0 {
        section.complain("full_us", "0", "a pulse that turns the servo");
    }
    section.finish();
    servo
}

fn shutter(mut section: Section<'_>) -> ShutterParameters {
    let default = ShutterParameters::default();
    let wirings = [("none", CaptureWiring::None), ("busy", CaptureWiring::Busy), ("confirm", CaptureWiring::Confirm)];
    let triggers = [("contact", Trigger::Contact), ("hero-bus", Trigger::HeroBus)];
    let shutter = ShutterParameters {
        trigger: section.choice_or("trigger", &triggers, default.trigger),
        wiring: section.choice_or("wiring", &wirings, default.wiring),
        trigger_latency_s: section.single_or("trigger_latency_s", DURATION, default.trigger_latency_s),
        trigger_latency_max_s: section.single_or("trigger_latency_max_s", DURATION, default.trigger_latency_max_s),
        exposure_s: section.single_or("exposure_s", DURATION, default.exposure_s),
        pulse_s: section.single_or("pulse_s", DURATION, default.pulse_s),
        busy_marks_exposure: section.flag_or("busy_marks_exposure", default.busy_marks_exposure),
        min_interval_s: section.single_or("min_interval_s", DURATION, default.min_interval_s),
        busy_timeout_s: section.single_or("busy_timeout_s", DURATION, default.busy_timeout_s),
        confirm_timeout_s: section.single_or("confirm_timeout_s", DURATION, default.confirm_timeout_s),
        confirm_grace_s: section.single_or("confirm_grace_s", DURATION, default.confirm_grace_s),
        retries: byte(&mut section, "retries", 0, default.retries),
        misses_to_fault: byte(&mut section, "misses_to_fault", 1, default.misses_to_fault),
        light_level: section.single_or("light_level", LEVEL, default.light_level),
        light_lead_s: section.single_or("light_lead_s", DURATION, default.light_lead_s),
    };
    if shutter.trigger_latency_max_s < shutter.trigger_latency_s {
        section.complain(
            "trigger_latency_max_s",
            format!("{}", shutter.trigger_latency_max_s),
            format!("at least trigger_latency_s = {}", shutter.trigger_latency_s),
        );
    }
    section.finish();
    shutter
}

fn ranges(mut section: Section<'_>, survey: Option<&SurveyConfig>) -> RangeParameters {
    let default = RangeParameters::default();
    let families = [("evo", RangeFamily::Evo), ("one", RangeFamily::One), ("one-hub", RangeFamily::OneHub)];
    let mut lever = |key| -> [f32; 2] {
        let pair = section.numbers(key, LEVER, Some(2)).and_then(|pair| <[f64; 2]>::try_from(pair).ok());
        pair.unwrap_or_default().map(|value| value as f32)
    };
    let lever_m = Beams {
        up: lever("lever_up_m"),
        right: lever("lever_right_m"),
        down: lever("lever_down_m"),
        left: lever("lever_left_m"),
    };
    let fitted = Beams {
        up: section.flag_or("up", true),
        right: section.flag_or("right", true),
        down: section.flag_or("down", true),
        left: section.flag_or("left", true),
    };
    let buses = [("i2c", RangeBus::I2c), ("hub", RangeBus::Hub)];
    let bus = section.choice_or("bus", &buses, default.bus);
    // Addresses below 8 and above 0x77 are reserved by the I2C specification; a Hub has eight channels.
    let (least, most, ports) = match bus {
        RangeBus::I2c => (0x08, 0x77, [default.port.up, default.port.right, default.port.down, default.port.left]),
        RangeBus::Hub => (0, 7, [0, 1, 2, 3]),
    };
    let head = if bus == RangeBus::I2c { default.head_port } else { 4 };
    let mut port =
        |key, default| u8::try_from(section.integer_or(key, least, most, u32::from(default))).unwrap_or(default);
    let [up, right, down, left] = ports;
    let port_of = Beams {
        up: port("port_up", up),
        right: port("port_right", right),
        down: port("port_down", down),
        left: port("port_left", left),
    };
    let head_port = port("port_head", head);
    let sigma = survey.map_or(default.sigma_m, |survey| survey.sigma.range_m as f32);
    let count = |value: u32| u16::try_from(value).unwrap_or(u16::MAX);
    let ranges = RangeParameters {
        family: section.choice_or("family", &families, default.family),
        fitted,
        head_fitted: section.flag_or("head", default.head_fitted),
        bus,
        port: port_of,
        head_port,
        lever_m,
        min_m: section.single_or("min_m", LENGTH, default.min_m),
        max_m: section.single_or("max_m", LENGTH, default.max_m),
        sigma_m: section.single_or("sigma_m", Quantity::new(Unit::Metre, 0.0005, 1.0), sigma),
        stale_s: section.single_or("stale_s", DURATION, default.stale_s),
        frozen_s: section.single_or("frozen_s", DURATION, default.frozen_s),
        zero_run: count(section.integer_or("zero_run", 2, 60_000, u32::from(default.zero_run))),
        jump_m: section.single_or("jump_m", Quantity::new(Unit::Metre, 0.01, 100.0), default.jump_m),
        good_run: count(section.integer_or("good_run", 1, 60_000, u32::from(default.good_run))),
    };
    if ranges.max_m <= ranges.min_m {
        section.complain("max_m", format!("{}", ranges.max_m), format!("more than min_m = {}", ranges.min_m));
    }
    section.finish();
    ranges
}

fn link(mut section: Section<'_>) -> LinkParameters {
    let default = LinkParameters::default();
    let yaw = Quantity::new(Unit::Degree, -360.0, 360.0);
    let link = LinkParameters {
        baud: section.integer_or("baud", 9600, 3_000_000, default.baud),
        axis_yaw_rad: section.maybe_number("axis_yaw_deg", yaw).map(radians),
        signed_telemetry: section.flag_or("signed_telemetry", default.signed_telemetry),
        lead_mps: section.single_or("lead_mps", Quantity::new(Unit::MetrePerSecond, 0.0, 10.0), default.lead_mps),
    };
    section.finish();
    link
}

fn log(mut section: Section<'_>) -> LogParameters {
    let default = LogParameters::default();
    let period = Quantity::new(Unit::Second, 0.01, 60.0);
    let log = LogParameters { sample_period_s: section.single_or("sample_period_s", period, default.sample_period_s) };
    section.finish();
    log
}

fn byte(section: &mut Section<'_>, key: &'static str, low: u32, default: u8) -> u8 {
    u8::try_from(section.integer_or(key, low, 255, u32::from(default))).unwrap_or(default)
}

fn radians(degrees: f64) -> f32 {
    degrees.to_radians() as f32
}
