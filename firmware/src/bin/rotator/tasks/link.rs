//! The autopilot's line: MAVLink in, MAVLink out.

use adit_firmware::health::Task;
use adit_firmware::link::{Diagnosis, Link, measured_m};
use adit_protocol::beams::Beam;
use adit_protocol::mavlink::Severity;
use adit_protocol::parameters::Parameters;
use embassy_stm32::mode::Async;
use embassy_stm32::usart::{self, RingBufferedUartRx, Uart, UartTx};
use embassy_time::{Duration, Instant, with_timeout};
use static_cell::ConstStaticCell;

use crate::blackboard::{CHECK_INS, NOTICES, newest, now_us};
use crate::pins::{Irqs, LinkParts};
use crate::stack;
use crate::statistics::STEP;

/// Something may be due this often even when nothing comes in.
const PERIOD: Duration = Duration::from_millis(5);
/// Room for what comes in while a frame goes out: both run at the same rate, and a frame has 280 bytes at most.
static RING: ConstStaticCell<[u8; 2048]> = ConstStaticCell::new([0; 2048]);
/// The rate if the parameter's is impossible.
const FALLBACK_BAUD: u32 = 57_600;
/// How deep the stack has been is looked up this often: it takes a look at every word of it.
const STACK_PERIOD: Duration = Duration::from_secs(1);

/// Talks for ever.
#[embassy_executor::task]
pub(crate) async fn talk(mut parts: LinkParts, parameters: Parameters) -> ! {
    let (mut tx, mut rx) = open(&mut parts, parameters.link.baud);
    let mut link = Link::new(&parameters);
    let mut bytes = [0; 256];
    let mut stack_bytes = (0, Instant::MIN);
    loop {
        // An overrun or a broken byte loses bytes; the decoder finds the next frame by itself.
        if let Ok(Ok(count)) = with_timeout(PERIOD, rx.read(&mut bytes)).await {
            link.receive(now_us(), bytes.get(..count).unwrap_or_default());
        }
        if stack_bytes.1.elapsed() >= STACK_PERIOD {
            stack_bytes = (stack::high_water_bytes(), Instant::now());
        }
        exchange(&mut link, Diagnosis { step_us: STEP.us(), stack_bytes: stack_bytes.0 });
        CHECK_INS.report(Task::Link, now_us());
        while let Some(frame) = link.next_frame(now_us()) {
            // The line's faults show at the other end.
            let _ = tx.write(&frame).await;
        }
    }
}

/// The line, at the fallback rate if it cannot run at the wanted one.
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
    let vehicle = link.vehicle(now_us);
    let command = link.take_command();
    let readdressing = link.take_readdressing();
    newest(|newest| {
        newest.vehicle = vehicle;
        newest.command = command.or(newest.command);
        newest.readdressing = readdressing.or(newest.readdressing);
        let ranges_m = measured_m(Beam::ALL.map(|beam| newest.ranges.get(beam).reading));
        link.note(now_us, &newest.outputs, ranges_m, diagnosis);
    });
}
