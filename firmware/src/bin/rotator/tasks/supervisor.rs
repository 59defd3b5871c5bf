//! Feeds the watchdog while every task reports in time, and shows on the lights how the board is.

use adit_firmware::health::Task;
use adit_protocol::record::Mode;
use embassy_stm32::Peri;
use embassy_stm32::peripherals::IWDG;
use embassy_stm32::wdg::IndependentWatchdog;
use embassy_time::{Duration, Timer};

use crate::blackboard::{CHECK_INS, newest, now_us};
use crate::crash;
use crate::pins::Leds;

/// The supervisor's period.
const PERIOD: Duration = Duration::from_millis(50);
/// The watchdog bites after this by its nominal clock; that clock errs by half (DS9405 rev 13, table 42), so between 0.34 s
/// and 0.95 s.
const WATCHDOG_US: u32 = 500_000;

/// Starts the watchdog.
pub(crate) fn unleash(peripheral: Peri<'static, IWDG>) -> IndependentWatchdog<'static, IWDG> {
    let mut watchdog = IndependentWatchdog::new(peripheral, WATCHDOG_US);
    watchdog.unleash();
    watchdog
}

/// Looks after the others for ever, or until one is overdue; then it stops what moves and waits for the watchdog.
#[embassy_executor::task]
pub(crate) async fn supervise(mut watchdog: IndependentWatchdog<'static, IWDG>, mut leds: Leds) -> ! {
    for task in Task::ALL {
        CHECK_INS.report(task, now_us());
    }
    let mut beat: u32 = 0;
    loop {
        if let Some((task, silent_ms)) = CHECK_INS.overdue(now_us()) {
            // From here on nobody may undo what is made safe, nor feed the watchdog.
            cortex_m::interrupt::disable();
            crash::make_safe();
            crash::leave_note(format_args!("task {} silent for {silent_ms} ms", task.name()));
            loop {
                cortex_m::asm::nop();
            }
        }
        watchdog.pet();
        show(&mut leds, newest(|newest| newest.outputs.mode), beat);
        beat = beat.wrapping_add(1);
        Timer::after(PERIOD).await;
    }
}

/// Green: works (slow blinking idle, steady ready, quick blinking scanning). Red: fault; with green: degraded. Blue: starting.
fn show(leds: &mut Leds, mode: Mode, beat: u32) {
    let slow = beat % 20 < 10;
    let quick = beat % 4 < 2;
    let (red, green, blue) = match mode {
        Mode::Boot | Mode::SelfTest => (false, false, quick),
        Mode::Idle => (false, slow, false),
        Mode::Ready => (false, true, false),
        Mode::Scanning => (false, quick, false),
        Mode::Degraded => (quick, quick, false),
        Mode::Fault => (quick, false, false),
    };
    for (led, on) in [(&mut leds.red, red), (&mut leds.green, green), (&mut leds.blue, blue)] {
        // Low is on.
        if on { led.set_low() } else { led.set_high() }
    }
}
