//! The rotator board's flash image: embassy tasks around [`adit_firmware`]'s controller, on the STM32F427 of a Pixracer.
//!
//! Start: safe pins, why the board started, clocks, watchdog, parameters from the FRAM, then the tasks.
#![no_std]
#![no_main]

mod actuators;
mod blackboard;
mod card;
mod clocks;
mod crash;
mod descriptor;
mod executors;
mod pins;
mod stack;
mod statistics;
mod tasks;

use adit_firmware::controller::Controller;
use adit_firmware::drivers::fram::Fram;
use adit_firmware::link::Link;
use adit_protocol::record::StartCause;
use defmt_rtt as _;
use static_cell::StaticCell;

use clocks::ClockSource;
use pins::Board;

/// Name and version, as log and link say them.
const PROGRAM: &str = concat!("rotator ", env!("CARGO_PKG_VERSION"));

static CONTROLLER: StaticCell<Controller> = StaticCell::new();
static LINK: StaticCell<Link> = StaticCell::new();

/// What the log's first records say about this start.
pub(crate) struct Start {
    pub(crate) cause: StartCause,
    pub(crate) note: Option<heapless::String<{ adit_protocol::record::MESSAGE_BYTES }>>,
    pub(crate) clock: ClockSource,
}

#[cortex_m_rt::entry]
fn main() -> ! {
    stack::paint();
    let start = Start { cause: crash::start_cause(), note: crash::take_note(), clock: clocks::find_source() };
    let (early, board) = Board::new(executors::init_clocks(start.clock));
    let mut watchdog = tasks::supervisor::unleash(early.watchdog);
    let mut store = tasks::store::Store::new(Fram::new(early.fram));
    let (parameters, flight) = store.load();
    defmt::info!("{=str}: start {=u32}, last capture {=u32}", PROGRAM, flight.starts, flight.last_capture);
    announce(&start);
    let controller = Controller::new(parameters.clone()).continuing_after(flight.last_capture);
    let controller = CONTROLLER.init(controller);
    actuators::boot(controller, &mut watchdog);
    let link = LINK.init_with(|| Link::new(&parameters, store.load_link(), uid()));
    let ready = executors::Ready { watchdog, store, link, start, log_number: flight.log_number };
    executors::run(board, ready, controller, &parameters)
}

/// The chip's number, shortened: lot, wafer and place on it stay apart.
fn uid() -> u64 {
    embassy_stm32::uid::uid().iter().fold(0, |number: u64, byte| number.rotate_left(8) ^ u64::from(*byte))
}

/// Tells the pilot why the board started, where that is no news he expects.
fn announce(start: &Start) {
    if start.cause != StartCause::PowerOn {
        blackboard::notify(format_args!("rotator restarted: {:?}", start.cause));
    }
    if let Some(note) = &start.note {
        blackboard::notify(format_args!("{note}"));
    }
    if start.clock == ClockSource::Internal {
        blackboard::notify(format_args!("crystal dead, times are 1 % off"));
    }
}
