//! The controller's tick.

use adit_firmware::controller::Controller;
use adit_firmware::health::Task;
use adit_firmware::io::{CameraStatus, Inputs, Outputs};
use embassy_stm32::timer::simple_pwm::SimplePwm;
use embassy_stm32::timer::GeneralInstance4Channel;
use embassy_time::{Duration, Instant, Timer};

use crate::blackboard::{CHECK_INS, COUNTED, Counted, log, newest};
use crate::pins::{Rig, SERVO_HZ};
use crate::statistics::STEP;

/// The tick.
const TICK: Duration = Duration::from_millis(5);
/// Left to the others even while a step takes longer than the tick, as computing the table does.
const LEAST_PAUSE: Duration = Duration::from_millis(2);

/// Counts what the camera says over its wires.
#[derive(Default)]
struct Camera {
    stored_was_high: bool,
    photos_stored: u32,
}

impl Camera {
    fn look(&mut self, rig: &Rig) -> CameraStatus {
        let stored = rig.photo_stored.is_high();
        if stored && !self.stored_was_high {
            self.photos_stored = self.photos_stored.wrapping_add(1);
        }
        self.stored_was_high = stored;
        CameraStatus { busy: rig.camera_busy.is_high(), photos_stored: self.photos_stored }
    }
}

/// Runs the controller for ever.
#[embassy_executor::task]
pub(crate) async fn control(controller: &'static mut Controller, mut rig: Rig) -> ! {
    let mut camera = Camera::default();
    let mut last_capture = None;
    let mut next = Instant::now();
    loop {
        let inputs = gather(camera.look(&rig));
        let began = Instant::now();
        let outputs = controller.step(began.as_micros(), &inputs);
        STEP.note(outputs.mode, began.elapsed());
        apply(&mut rig, &outputs);
        if last_capture.replace(outputs.display.captures) != Some(outputs.display.captures) {
            // A full channel: the next capture brings the next number.
            let _ = COUNTED.try_send(Counted::Capture(outputs.display.captures));
        }
        publish(outputs);
        CHECK_INS.report(Task::Control, began.as_micros());
        next = (next + TICK).max(Instant::now() + LEAST_PAUSE);
        Timer::at(next).await;
    }
}

/// What is known at this moment.
fn gather(camera: CameraStatus) -> Inputs {
    newest(|newest| Inputs {
        ranges: newest.ranges,
        head: newest.head,
        shaft_encoder_rad: newest.encoder_rad,
        attitude_rad: newest.vehicle.attitude_rad.or(newest.attitude_rad),
        odometer_m: newest.vehicle.odometer_m,
        speed_mps: newest.vehicle.speed_mps,
        camera,
        command: newest.command.take(),
        autopilot_alive: newest.vehicle.alive,
        log_lost: newest.log_lost,
    })
}

/// Sets the pins.
fn apply(rig: &mut Rig, outputs: &Outputs) {
    // The safety switch forbids what moves or fires, whatever the controller wants.
    let allowed = rig.safety.is_low();
    match outputs.servo_pulse_us.filter(|_| allowed) {
        Some(pulse_us) => {
            let period_us = 1e6 / SERVO_HZ as f32;
            set_duty(&mut rig.servo, Wire::Servo, pulse_us / period_us);
        }
        None => rig.servo.ch4().disable(),
    }
    set_duty(&mut rig.light, Wire::Light, outputs.light_level);
    rig.shutter.set_level((allowed && outputs.shutter).into());
}

#[derive(Clone, Copy)]
enum Wire {
    Servo,
    Light,
}

/// Sets the share of the period in which the wire is high.
fn set_duty<T: GeneralInstance4Channel>(timer: &mut SimplePwm<'static, T>, wire: Wire, share: f32) {
    let mut channel = match wire {
        Wire::Servo => timer.ch4(),
        Wire::Light => timer.ch2(),
    };
    let most = channel.max_duty_cycle();
    // The cast saturates, and takes NaN for zero.
    channel.set_duty_cycle(((share * most as f32 + 0.5) as u32).min(most));
    channel.enable();
}

/// Hands the outputs on.
fn publish(outputs: Outputs) {
    log(|queue| outputs.entries.iter().for_each(|entry| queue.entry(*entry)));
    newest(|newest| newest.outputs = outputs);
}
