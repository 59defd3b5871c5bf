//! The controller's outputs: on the pins, and to the other tasks.

use adit_firmware::controller::Controller;
use adit_firmware::io::{Inputs, Outputs};
use adit_protocol::record::{Entry, Event, EventKind, Mode};
use embassy_stm32::peripherals::IWDG;
use embassy_stm32::timer::GeneralInstance4Channel;
use embassy_stm32::timer::simple_pwm::SimplePwmChannel;
use embassy_stm32::wdg::IndependentWatchdog;
use embassy_time::Instant;

use crate::blackboard::{CAPTURES, KEEP, Keep, log, newest};
use crate::pins::{Rig, SERVO_HZ};

/// Lets the controller compute its tables, before anything else runs: a piece of them takes longer than any bus may wait.
pub(crate) fn boot(controller: &mut Controller, watchdog: &mut IndependentWatchdog<'static, IWDG>) {
    loop {
        let outputs = controller.step(Instant::now().as_micros(), &Inputs::default());
        let mode = outputs.mode;
        publish(outputs);
        watchdog.pet();
        if mode != Mode::Boot {
            return;
        }
    }
}

/// Sets the pins.
pub(crate) fn apply(rig: &mut Rig, outputs: &Outputs) {
    // The safety switch forbids what moves or fires, whatever the controller wants.
    let allowed = rig.safety.is_low();
    let mut servo = rig.servo.ch4();
    match outputs.servo_pulse_us.filter(|_| allowed) {
        Some(pulse_us) => set_duty(&mut servo, pulse_us * SERVO_HZ as f32 * 1e-6),
        None => servo.disable(),
    }
    set_duty(&mut rig.light.ch2(), outputs.light_level);
    rig.shutter.set_level((allowed && outputs.shutter).into());
}

/// Sets the share of the period in which the pin is high.
fn set_duty<T: GeneralInstance4Channel>(channel: &mut SimplePwmChannel<'_, T>, share: f32) {
    let most = channel.max_duty_cycle();
    // The cast saturates, and takes NaN for zero.
    channel.set_duty_cycle(((share * most as f32 + 0.5) as u32).min(most));
    channel.enable();
}

/// Hands the outputs on.
pub(crate) fn publish(outputs: Outputs) {
    log(|queue| outputs.entries.iter().for_each(|entry| queue.entry(*entry)));
    for entry in &outputs.entries {
        if matches!(
            entry,
            Entry::Tag(_)
                | Entry::TagUpdate(_)
                | Entry::Event(Event { kind: EventKind::Missed { .. } | EventKind::Failed(_), .. })
        ) {
            let _ = CAPTURES.try_send(*entry);
        }
    }
    let captures = outputs.display.captures;
    let before = newest(|newest| core::mem::replace(&mut newest.outputs, outputs));
    if before.display.captures != captures {
        // A full channel: the next capture brings the next number.
        let _ = KEEP.try_send(Keep::Capture(captures));
    }
}
