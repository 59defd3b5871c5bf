//! The controller's step when a simulator asks for it: the `hil` build's stand-in for the control task.

use adit_firmware::controller::Controller;
use adit_firmware::health::Task;
use adit_firmware::hil::{self, Answer, Decoder, Question};
use adit_protocol::log::parameters_hash;
use embassy_stm32::mode::Async;
use embassy_stm32::usart::{self, Uart, UartTx};
use embassy_time::{Duration, Instant, with_timeout};
use static_cell::ConstStaticCell;

use crate::blackboard::{CHECK_INS, now_us};
use crate::pins::{Irqs, Rig, SimulatorParts};
use crate::statistics::STEP;
use crate::tasks::control::{apply, publish};

/// It reports at least this often.
const PERIOD: Duration = Duration::from_millis(20);
/// Room for two questions.
static RING: ConstStaticCell<[u8; 4096]> = ConstStaticCell::new([0; 4096]);

/// Answers for ever.
#[embassy_executor::task]
pub(crate) async fn answer(parts: SimulatorParts, controller: &'static mut Controller, mut rig: Rig) -> ! {
    let mut config = usart::Config::default();
    config.baudrate = hil::BAUD;
    let uart = Uart::new(parts.uart, parts.rx, parts.tx, parts.tx_dma, parts.rx_dma, Irqs, config);
    let (mut tx, rx) = uart.expect("the rate is possible with these clocks").split();
    let mut rx = rx.into_ring_buffered(RING.take());
    let mut decoder = Decoder::default();
    let mut bytes = [0; 256];
    loop {
        CHECK_INS.report(Task::Control, now_us());
        let Ok(Ok(count)) = with_timeout(PERIOD, rx.read(&mut bytes)).await else { continue };
        for byte in bytes.iter().take(count) {
            if let Some(question) = decoder.push(*byte) {
                reply(question, controller, &mut rig, &mut tx).await;
            }
        }
    }
}

async fn reply(question: Question, controller: &mut Controller, rig: &mut Rig, tx: &mut UartTx<'static, Async>) {
    let answer = match question {
        Question::Begin(parameters) => {
            let parameters_hash = parameters_hash(&parameters).unwrap_or_default();
            *controller = Controller::new(parameters);
            Answer::Ready { parameters_hash }
        }
        Question::Step { now_us, inputs } => {
            let began = Instant::now();
            let outputs = controller.step(now_us, &inputs);
            STEP.note(outputs.mode, began.elapsed());
            apply(rig, &outputs);
            publish(outputs.clone());
            Answer::Done { now_us, outputs }
        }
    };
    if let Some(bytes) = hil::encode(&answer) {
        // The line's faults show at the other end: no answer comes.
        let _ = tx.write(&bytes).await;
    }
}
