//! The controller's tick.

use adit_firmware::controller::Controller;
use adit_firmware::health::Task;
use adit_firmware::io::{CameraStatus, Inputs};
use embassy_time::{Duration, Instant, Timer};

use crate::actuators::{apply, publish};
use crate::blackboard::{CHECK_INS, newest};
use crate::pins::{CameraPins, Rig};
use crate::statistics::STEP;

/// The tick.
const TICK: Duration = Duration::from_millis(5);
/// Left to the others even if a step should take longer than the tick.
const LEAST_PAUSE: Duration = Duration::from_millis(1);

/// Counts what the camera says over its wires.
struct Camera {
    pins: CameraPins,
    stored_was_high: bool,
    photos_stored: u32,
}

impl Camera {
    fn look(&mut self) -> CameraStatus {
        let stored = self.pins.photo_stored.is_high();
        if stored && !self.stored_was_high {
            self.photos_stored = self.photos_stored.wrapping_add(1);
        }
        self.stored_was_high = stored;
        CameraStatus { busy: self.pins.busy.is_high(), photos_stored: self.photos_stored }
    }
}

/// Runs the controller for ever.
#[embassy_executor::task]
pub(crate) async fn control(controller: &'static mut Controller, mut rig: Rig, pins: CameraPins) -> ! {
    let mut camera = Camera { pins, stored_was_high: false, photos_stored: 0 };
    let mut next = Instant::now();
    loop {
        let inputs = gather(camera.look());
        let began = Instant::now();
        let outputs = controller.step(began.as_micros(), &inputs);
        STEP.note(began.elapsed());
        apply(&mut rig, &outputs);
        publish(outputs);
        CHECK_INS.report(Task::Control, began.as_micros());
        next = (next + TICK).max(Instant::now() + LEAST_PAUSE);
        Timer::at(next).await;
    }
}

/// What is known at this moment.
fn gather(camera: CameraStatus) -> Inputs {
    newest(|newest| {
        let mut inputs = Inputs {
            ranges: newest.ranges,
            head: newest.head,
            shaft_encoder_rad: newest.encoder_rad,
            camera: newest.hero.unwrap_or(camera),
            command: newest.command.take(),
            log_lost: newest.log_lost,
            ..Inputs::default()
        };
        newest.vehicle.fill(&mut inputs);
        inputs.attitude_rad = inputs.attitude_rad.or(newest.attitude_rad);
        inputs
    })
}
