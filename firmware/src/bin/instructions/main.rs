//! What the controller costs on the chip: instructions in the emulator, cycles on a board.
//!
//! Runs each piece of work many times against the core's own timer and leaves `[longest, mean]` per row in a table that the
//! emulator reads by the symbol `COST`; rows are named in the emulator's test. The
//! chip runs on its internal oscillator, no interrupt is on, nothing else is touched.
#![no_std]
#![no_main]
#![allow(unsafe_code, reason = "a symbol that the emulator finds by its name must not be mangled")]

use core::hint::black_box;
use core::sync::atomic::{AtomicU32, Ordering};

use adit_firmware::controller::Controller;
use adit_firmware::io::{CameraStatus, Command, Inputs, Outputs, RangeReading, RangeSample};
use adit_geometry::centring::general::{Beam as SolverBeam, Search};
use adit_geometry::profile::ProfileSpec;
use adit_geometry::single::{advance, locate_near};
use adit_protocol::beams::Beams;
use adit_protocol::parameters::{CaptureWiring, Parameters};
use adit_protocol::record::Mode;
use cortex_m::Peripherals;
use cortex_m::peripheral::SYST;
use cortex_m::peripheral::syst::SystClkSource;
use defmt_rtt as _;
use embassy_stm32 as _;
use nalgebra::{UnitQuaternion, Vector2, Vector3};

/// Rows of the table, in this order; the emulator's test has the same list.
const ROWS: usize = 8;

/// `[longest, mean]` per row, and a last word that says that all is done.
#[unsafe(no_mangle)]
static COST: [AtomicU32; ROWS * 2 + 1] = [const { AtomicU32::new(0) }; ROWS * 2 + 1];

/// Counts down from here: 24 bits.
const RELOAD: u32 = 0x00FF_FFFF;

/// One row while it is measured.
#[derive(Default)]
struct Row {
    longest: u32,
    sum: u64,
    count: u32,
}

impl Row {
    fn measure<T>(&mut self, work: impl FnOnce() -> T) -> T {
        let before = SYST::get_current();
        let result = black_box(work());
        let took = before.wrapping_sub(SYST::get_current()) & RELOAD;
        self.longest = self.longest.max(took);
        self.sum += u64::from(took);
        self.count += 1;
        result
    }

    fn file(&self, row: usize) {
        let mean = self.sum.checked_div(u64::from(self.count)).unwrap_or(0) as u32;
        for (place, value) in COST.iter().skip(row * 2).zip([self.longest, mean]) {
            place.store(value, Ordering::Relaxed);
        }
    }
}

/// A generator of a line (Knuth's MMIX constants) for noise on the readings.
struct Dice(u64);

impl Dice {
    fn noise_m(&mut self) -> f32 {
        self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        ((self.0 >> 40) as f32 / 8_388_608.0 - 1.0) * 0.03
    }
}

#[cortex_m_rt::entry]
fn main() -> ! {
    if let Some(mut peripherals) = Peripherals::take() {
        let timer = &mut peripherals.SYST;
        timer.set_clock_source(SystClkSource::Core);
        timer.set_reload(RELOAD);
        timer.clear_current();
        timer.enable_counter();
    }
    let circle = ProfileSpec::Circle { radius_m: 1.5 };
    let underpass = ProfileSpec::Underpass { width_m: 5.0, wall_m: 2.5, rise_m: 1.0, axis_height_m: 1.7 };
    solve(&circle, Some(Vector2::new(0.12, -0.06)), 0);
    solve(&circle, None, 1);
    solve(&underpass, Some(Vector2::new(0.12, -0.06)), 2);
    solve(&underpass, None, 3);
    fly(circle, 4);
    if let Some(done) = COST.last() {
        done.store(1, Ordering::Release);
    }
    loop {
        cortex_m::asm::wfe();
    }
}

/// Centring from the beams up, right and left: near the last place, or a piece of a search of the whole section.
fn solve(spec: &ProfileSpec<f32>, hint_m: Option<Vector2<f32>>, row: usize) {
    let Ok(profile) = spec.build() else { return };
    let mut dice = Dice(1);
    let mut cost = Row::default();
    let level = UnitQuaternion::identity();
    let place_m = Vector2::new(0.1_f32, -0.05);
    for _ in 0..20 {
        let beams = [[0.0, -1.0], [1.0, 0.0], [-1.0, 0.0_f32]].map(|[y, z]| {
            let direction = Vector2::new(y, z);
            let range_m = profile.ray_cast(place_m, direction).map(|hit| hit.distance + dice.noise_m());
            SolverBeam {
                origin_in_body_m: Vector3::zeros(),
                direction_in_body: Vector3::new(0.0, y, z),
                range_m,
                sigma_m: 0.02,
            }
        });
        if let Some(hint_m) = hint_m {
            cost.measure(|| locate_near(&profile, &beams, &level, hint_m));
            continue;
        }
        let mut search = Search::new(&profile, &beams, &level, None);
        while cost.measure(|| advance(&mut search, &profile)).is_none() {}
    }
    cost.file(row);
}

/// A scan in a world of a few lines: the shaft is where it shall be, the camera takes every photo. Rows: computing a node of
/// the table, a step without new samples, one with new samples, one that writes a tag.
fn fly(profile: ProfileSpec<f32>, first_row: usize) {
    let mut parameters = Parameters { profile, ..Parameters::default() };
    parameters.shutter.wiring = CaptureWiring::Confirm;
    let mut controller = Controller::new(parameters);
    let mut outputs = Outputs::default();
    let mut rows: [Row; 4] = Default::default();
    let mut dice = Dice(2);
    let (mut count, mut busy_until_us, mut stored, mut shutter_was) = (0, 0, 0, false);
    for tick in 0..4000_u64 {
        let now_us = tick * 5000;
        if outputs.shutter && !shutter_was {
            busy_until_us = now_us + 600_000;
            stored += 1;
        }
        shutter_was = outputs.shutter;
        let fresh = tick % 4 == 0;
        count += u32::from(fresh);
        let inputs = Inputs {
            ranges: Beams::from_fn(|_| RangeSample { reading: RangeReading::Measured(1.5 + dice.noise_m()), count }),
            shaft_encoder_rad: Some(outputs.shaft_setpoint_rad),
            attitude_rad: Some([0.01, -0.02, 0.03]),
            odometer_m: Some(tick as f32 * 0.0005),
            speed_mps: Some(0.1),
            camera: CameraStatus { busy: now_us < busy_until_us, photos_stored: stored },
            command: match outputs.mode {
                Mode::Idle => Some(Command::Arm),
                Mode::Ready => Some(Command::Start),
                _ => None,
            },
            autopilot_alive: true,
            ..Inputs::default()
        };
        let mut cost = Row::default();
        let before = outputs.mode;
        outputs = cost.measure(|| controller.step(now_us, &inputs));
        let tagged = outputs.entries.iter().any(|entry| matches!(entry, adit_protocol::record::Entry::Tag(_)));
        let row = match () {
            () if before == Mode::Boot => 0,
            () if tagged => 3,
            () => 1 + usize::from(fresh),
        };
        if let Some(row) = rows.get_mut(row) {
            row.longest = row.longest.max(cost.longest);
            row.sum += cost.sum;
            row.count += 1;
        }
    }
    for (index, row) in rows.iter().enumerate() {
        row.file(first_row + index);
    }
}

#[panic_handler]
fn panic(_: &core::panic::PanicInfo<'_>) -> ! {
    if let Some(done) = COST.last() {
        done.store(u32::MAX, Ordering::Release);
    }
    loop {
        cortex_m::asm::wfe();
    }
}
