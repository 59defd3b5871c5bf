//! Clocks on, then the three places where tasks run: control above bus and link, and the log in thread mode below all.
#![allow(unsafe_code, reason = "an interrupt executor is driven from a vector, which embassy marks as unsafe")]

use adit_firmware::controller::Controller;
use adit_firmware::link::Link;
use adit_protocol::parameters::{Parameters, RangeBus, Trigger};
use embassy_executor::{Executor, InterruptExecutor};
use embassy_stm32::interrupt::{self, InterruptExt, Priority};
use embassy_stm32::peripherals::IWDG;
use embassy_stm32::wdg::IndependentWatchdog;
use embassy_stm32::{Peripherals, pac};
use static_cell::StaticCell;

use crate::Start;
use crate::clocks::{self, ClockSource};
use crate::pins::Board;
use crate::tasks;
use crate::tasks::store::Store;

/// On the vector of a peripheral that the board does not use: the camera interface.
static ABOVE: InterruptExecutor = InterruptExecutor::new();
/// On the vector of another: the second CAN's errors.
static MIDDLE: InterruptExecutor = InterruptExecutor::new();
static BELOW: StaticCell<Executor> = StaticCell::new();

#[embassy_stm32::interrupt]
unsafe fn DCMI() {
    // SAFETY: called from the vector that the executor was started with, and from nowhere else.
    unsafe { ABOVE.on_interrupt() }
}

#[embassy_stm32::interrupt]
unsafe fn CAN2_SCE() {
    // SAFETY: as above.
    unsafe { MIDDLE.on_interrupt() }
}

/// Sets the clocks up and takes the peripherals.
pub(crate) fn init_clocks(source: ClockSource) -> Peripherals {
    let config = clocks::config(source);
    cortex_m::interrupt::free(|_| {
        let peripherals = embassy_stm32::init(config);
        // The time driver leaves compare flags set that rose while its counter stood at zero; taken for a wrapped half
        // period they would put the clock two seconds ahead and undo its guard against reading it at the wrap.
        pac::TIM5.sr().write_value(pac::timer::regs::SrGp16::default());
        cortex_m::peripheral::NVIC::unpend(pac::Interrupt::TIM5);
        peripherals
    })
}

/// What was ready before the tasks.
pub(crate) struct Ready {
    pub(crate) watchdog: IndependentWatchdog<'static, IWDG>,
    pub(crate) store: Store,
    pub(crate) link: &'static mut Link,
    pub(crate) start: Start,
    pub(crate) log_number: u32,
}

/// Starts all tasks and stays in the lowest of the executors.
pub(crate) fn run(board: Board, ready: Ready, controller: &'static mut Controller, parameters: &Parameters) -> ! {
    interrupt::DCMI.set_priority(Priority::P6);
    interrupt::CAN2_SCE.set_priority(Priority::P7);
    let header = tasks::log::header(parameters);

    let middle = MIDDLE.start(interrupt::CAN2_SCE);
    middle.spawn(tasks::supervisor::supervise(ready.watchdog, board.leds).unwrap());
    middle.spawn(tasks::store::keep(ready.store).unwrap());
    middle.spawn(tasks::imu::watch(board.imu).unwrap());
    #[cfg(not(feature = "hil"))]
    let service = {
        let (tx, rx) = tasks::link::open_service(board.service);
        middle.spawn(tasks::link::write_service(tx).unwrap());
        Some(rx)
    };
    #[cfg(feature = "hil")]
    let service = None;
    middle.spawn(tasks::link::talk(board.link, service, ready.link, parameters.link.baud).unwrap());
    if parameters.shutter.trigger == Trigger::HeroBus {
        middle.spawn(tasks::herobus::answer(board.range_bus, board.hero_bus).unwrap());
        middle.spawn(tasks::sensors::listen(board.hub, parameters.ranges).unwrap());
    } else {
        middle.spawn(tasks::sensors::measure(board.range_bus, parameters.ranges).unwrap());
        if parameters.ranges.bus == RangeBus::Hub {
            middle.spawn(tasks::sensors::listen(board.hub, parameters.ranges).unwrap());
        }
    }
    let above = ABOVE.start(interrupt::DCMI);
    #[cfg(not(feature = "hil"))]
    above.spawn(tasks::control::control(controller, board.rig, board.camera).unwrap());
    #[cfg(feature = "hil")]
    above.spawn(tasks::simulated::answer(board.service, controller, board.rig).unwrap());
    let below = BELOW.init(Executor::new());
    below.run(|spawner| {
        spawner.spawn(tasks::log::write(board.card, header, ready.start, ready.log_number).unwrap());
    })
}
