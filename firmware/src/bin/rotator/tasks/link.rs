//! The autopilot's line: MAVLink in, MAVLink out.

use adit_firmware::health::Task;
use adit_firmware::link::Link;
use adit_protocol::parameters::Parameters;
use embassy_stm32::usart::{self, RingBufferedUartRx, Uart, UartTx};
use embassy_stm32::mode::Async;
use embassy_time::{Duration, with_timeout};
use static_cell::ConstStaticCell;

use crate::blackboard::{CHECK_INS, NOTICES, Vehicle, newest, now_us};
use crate::pins::{Irqs, LinkParts};
use crate::stack;
use crate::statistics::STEP;

/// Something may be due this often even when nothing comes in.
const PERIOD: Duration = Duration::from_millis(5);
/// Room for what comes in while a frame goes out: both run at the same rate, and a frame has 280 bytes at most.
static RING: ConstStaticCell<[u8; 2048]> = ConstStaticCell::new([0; 2048]);
/// The rate if the parameter's is impossible.
const FALLBACK_BAUD: u32 = 57_600;

/// Talks for ever.
#[embassy_executor::task]
pub(crate) async fn talk(parts: LinkParts, parameters: Parameters) -> ! {
    let mut config = usart::Config::default();
    config.baudrate = parameters.link.baud;
    let (mut tx, mut rx) = open(parts, config);
    let mut link = Link::new(&parameters);
    let mut bytes = [0; 256];
    loop {
        // An overrun or a broken byte loses bytes; the decoder finds the next frame by itself.
        if let Ok(Ok(count)) = with_timeout(PERIOD, rx.read(&mut bytes)).await {
            link.receive(now_us(), bytes.get(..count).unwrap_or_default());
        }
        exchange(&mut link);
        send(&mut link, &mut tx).await;
        CHECK_INS.report(Task::Link, now_us());
    }
}
