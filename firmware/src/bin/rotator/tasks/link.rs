//! The autopilot's line and the service line: MAVLink in, MAVLink out.

use adit_firmware::health::Task;
use adit_firmware::link::{Diagnosis, Link, Port, measured_m};
use adit_protocol::beams::Beam;
use adit_protocol::mavlink::{OutFrame, Severity};
use embassy_futures::select::{Either, select};
use embassy_stm32::mode::Async;
use embassy_stm32::usart::{self, RingBufferedUartRx, Uart, UartTx};
use embassy_sync::blocking_mutex::raw::CriticalSectionRawMutex;
use embassy_sync::channel::Channel;
use embassy_time::{Duration, Instant, Timer, with_timeout};
use static_cell::ConstStaticCell;

use crate::blackboard::{CAPTURES, CHECK_INS, KEEP, KEPT, Keep, LOG_ANSWERS, LOG_WISHES, NOTICES, newest, now_us};
use crate::crash;
use crate::pins::{Irqs, LinkParts};
use crate::stack;
use crate::statistics::STEP;

/// Something may be due this often even when nothing comes in.
const PERIOD: Duration = Duration::from_millis(5);
/// What comes in gathers for so long: at the full rate there is always another byte, and whoever took them one by one would leave
/// the sensors and the log no time.
const GATHER: Duration = Duration::from_millis(1);
/// Room for what comes in while a frame goes out: both run at the same rate, and a frame has 280 bytes at most.
static RING: ConstStaticCell<[u8; 2048]> = ConstStaticCell::new([0; 2048]);
/// The rate if the parameter's is impossible.
const FALLBACK_BAUD: u32 = 57_600;
/// What was said last is on the line for no longer than this.
const FAREWELL: Duration = Duration::from_millis(50);
/// How deep the stack has been is looked up this often: it takes a look at every word of it.
const STACK_PERIOD: Duration = Duration::from_secs(1);

/// Frames on their way to the service line, which another task writes: neither line waits for the other.
static SERVICE_FRAMES: Channel<CriticalSectionRawMutex, OutFrame, 4> = Channel::new();

/// The service line's incoming half; in the `hil` build a simulator has its pins.
pub(crate) type ServiceRx = Option<RingBufferedUartRx<'static>>;

/// Opens the service line.
#[cfg(not(feature = "hil"))]
pub(crate) fn open_service(parts: crate::pins::ServiceParts) -> (UartTx<'static, Async>, RingBufferedUartRx<'static>) {
    static RING: ConstStaticCell<[u8; 1024]> = ConstStaticCell::new([0; 1024]);
    let mut config = usart::Config::default();
    config.baudrate = adit_firmware::link::SERVICE_BAUD;
    let uart = Uart::new(parts.uart, parts.rx, parts.tx, parts.tx_dma, parts.rx_dma, Irqs, config);
    let (tx, rx) = uart.expect("the rate is possible with these clocks").split();
    (tx, rx.into_ring_buffered(RING.take()))
}

/// Writes to the service line for ever.
#[cfg(not(feature = "hil"))]
#[embassy_executor::task]
pub(crate) async fn write_service(mut tx: UartTx<'static, Async>) -> ! {
    loop {
        let frame = SERVICE_FRAMES.receive().await;
        // The line's faults show at the other end.
        let _ = tx.write(&frame).await;
    }
}

/// Talks for ever.
#[embassy_executor::task]
pub(crate) async fn talk(mut parts: LinkParts, mut service: ServiceRx, link: &'static mut Link, baud: u32) -> ! {
    let (mut tx, mut rx) = open(&mut parts, baud);
    let mut bytes = [[0; 256]; 2];
    let mut stack_bytes = (0, Instant::MIN);
    loop {
        let [autopilot_bytes, service_bytes] = &mut bytes;
        // An overrun or a broken byte loses bytes; the decoder finds the next frame by itself.
        let heard = match &mut service {
            Some(service) => with_timeout(PERIOD, select(rx.read(autopilot_bytes), service.read(service_bytes))).await,
            None => with_timeout(PERIOD, rx.read(autopilot_bytes)).await.map(Either::First),
        };
        let (port, count) = match heard {
            Ok(Either::First(Ok(count))) => (Port::Autopilot, count),
            Ok(Either::Second(Ok(count))) => (Port::Service, count),
            _ => (Port::Autopilot, 0),
        };
        let heard = bytes.get(port as usize).and_then(|bytes| bytes.get(..count)).unwrap_or_default();
        link.receive(now_us(), port, heard);
        if stack_bytes.1.elapsed() >= STACK_PERIOD {
            stack_bytes = (stack::high_water_bytes(), Instant::now());
        }
        exchange(link, Diagnosis { step_us: STEP.us(), stack_bytes: stack_bytes.0 });
        CHECK_INS.report(Task::Link, now_us());
        while let Some((ports, frame)) = link.next_frame(now_us()) {
            if service.is_some() && ports.contains(Port::Service) {
                // A line takes what it is given, so this waits for a few milliseconds at most.
                SERVICE_FRAMES.send(frame.clone()).await;
            }
            if ports.contains(Port::Autopilot) {
                // The line's faults show at the other end.
                let _ = tx.write(&frame).await;
            }
        }
        if count > 0 {
            Timer::after(GATHER).await;
        }
        if link.take_restart() {
            // The answer has to get through first.
            Timer::after(FAREWELL).await;
            crash::make_safe();
            crash::leave_note(format_args!("restart by command"));
            cortex_m::peripheral::SCB::sys_reset()
        }
    }
}

/// The autopilot's line, at the fallback rate if it cannot run at the wanted one.
fn open(parts: &mut LinkParts, baud: u32) -> (UartTx<'_, Async>, RingBufferedUartRx<'_>) {
    let mut config = usart::Config::default();
    config.baudrate = if (1200..=2_625_000).contains(&baud) { baud } else { FALLBACK_BAUD };
    let uart = Uart::new(
        parts.uart.reborrow(),
        parts.rx.reborrow(),
        parts.tx.reborrow(),
        parts.tx_dma.reborrow(),
        parts.rx_dma.reborrow(),
        Irqs,
        config,
    );
    // 42 MHz over 16 is the fastest that USART2 runs, and the slowest is far below.
    let (tx, rx) = uart.expect("the rate was checked").split();
    (tx, rx.into_ring_buffered(RING.take()))
}

/// Tells the others what the vehicle says, and the link what the others want.
fn exchange(link: &mut Link, diagnosis: Diagnosis) {
    let now_us = now_us();
    while let Ok(text) = NOTICES.try_receive() {
        link.say(Severity::Warning, text);
    }
    while let Ok(entry) = CAPTURES.try_receive() {
        link.note_entry(&entry);
    }
    let vehicle = link.vehicle(now_us);
    let command = link.take_command();
    let readdressing = link.take_readdressing();
    // What the link makes of it takes longer than interrupts may be off.
    let (outputs, readings) = newest(|newest| {
        newest.vehicle = vehicle;
        newest.command = command.or(newest.command);
        newest.readdressing = readdressing.or(newest.readdressing);
        (newest.outputs.clone(), Beam::ALL.map(|beam| newest.ranges.get(beam).reading))
    });
    link.note(now_us, &outputs, measured_m(readings), diagnosis);
    lend(link);
    keep(link, now_us);
}

/// Logs of the card, for whoever fetches them.
fn lend(link: &mut Link) {
    if let Ok((wish, answer)) = LOG_ANSWERS.try_receive() {
        link.hear_logs(wish, answer);
    }
    if let Some(wish) = link.take_log_wish() {
        // One at a time: there is room.
        let _ = LOG_WISHES.try_send(wish);
    }
}

/// What must outlive the power.
fn keep(link: &mut Link, now_us: u64) {
    if let Ok(ok) = KEPT.try_receive() {
        link.kept(ok);
    }
    if let Some(wish) = link.take_keep(now_us)
        && KEEP.try_send(Keep::Link(wish)).is_err()
    {
        link.kept(false);
    }
}
