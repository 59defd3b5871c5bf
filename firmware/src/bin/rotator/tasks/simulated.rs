//! The controller's step when a simulator asks for it: the `hil` build's stand-in for the control task.

use adit_firmware::controller::Controller;
use adit_firmware::health::Task;
use adit_firmware::hil::{self, Answer, Decoder, Question};
use adit_protocol::log::parameters_hash;
use embassy_stm32::usart::{self, Uart};
use embassy_time::{Duration, Instant, with_timeout};
use static_cell::ConstStaticCell;

use crate::actuators::{apply, publish};
use crate::blackboard::{CHECK_INS, now_us};
use crate::pins::{Irqs, Rig, ServiceParts};
use crate::statistics::STEP;

/// It reports at least this often.
const PERIOD: Duration = Duration::from_millis(20);
/// Room for two questions.
static RING: ConstStaticCell<[u8; 4096]> = ConstStaticCell::new([0; 4096]);

/// Answers for ever.
#[embassy_executor::task]
pub(crate) async fn answer(parts: ServiceParts, controller: &'static mut Controller, mut rig: Rig) -> ! {
    let mut config = usart::Config::default();
    config.baudrate = hil::BAUD;
    let uart = Uart::new(parts.uart, parts.rx, parts.tx, parts.tx_dma, parts.rx_dma, Irqs, config);
    let (mut tx, rx) = uart.expect("the rate is possible with these clocks").split();
    let mut rx = rx.into_ring_buffered(RING.take());
    let mut decoder = Decoder::default();
    let mut last = Last { now_us: None, bytes: heapless::Vec::new() };
    let mut bytes = [0; 256];
    loop {
        CHECK_INS.report(Task::Control, now_us());
        let Ok(Ok(count)) = with_timeout(PERIOD, rx.read(&mut bytes)).await else { continue };
        for byte in bytes.iter().take(count) {
            if let Some(question) = decoder.push(*byte) {
                let bytes = last.answer_to(question, controller, &mut rig);
                // The line's faults show at the other end: no answer comes.
                let _ = tx.write(bytes).await;
            }
        }
    }
}

/// The last answer: who asks again, because it was lost or late, gets the same one and no second step.
struct Last {
    now_us: Option<u64>,
    bytes: heapless::Vec<u8, { hil::MAX_BYTES }>,
}

impl Last {
    fn answer_to(&mut self, question: Question, controller: &mut Controller, rig: &mut Rig) -> &[u8] {
        let answer = match question {
            Question::Begin(parameters) => {
                let parameters_hash = parameters_hash(&parameters).unwrap_or_default();
                *controller = Controller::new(parameters);
                self.now_us = None;
                Answer::Ready { parameters_hash }
            }
            Question::Step { now_us, .. } if self.now_us == Some(now_us) => return &self.bytes,
            Question::Step { now_us, inputs } => {
                let began = Instant::now();
                let outputs = controller.step(now_us, &inputs);
                STEP.note(began.elapsed());
                apply(rig, &outputs);
                publish(outputs.clone());
                self.now_us = Some(now_us);
                Answer::Done { now_us, outputs }
            }
        };
        self.bytes = hil::encode(&answer).unwrap_or_default();
        &self.bytes
    }
}
