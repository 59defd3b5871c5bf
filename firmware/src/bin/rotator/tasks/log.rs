//! The log on the card.

use adit_firmware::health::Task;
use adit_firmware::recorder::{Recorder, RecorderError};
use adit_protocol::log::{self, Frame};
use adit_protocol::parameters::Parameters;
use adit_protocol::record::{Entry, Event, EventKind, Header, Message, Record};
use embassy_stm32::sdmmc::sd::{CmdBlock, DataBlock, StorageDevice};
use embassy_time::{Duration, Timer};

use crate::blackboard::{self, CHECK_INS, newest, notify, now_us};
use crate::card::{self, CardDevice, CardError};
use crate::pins::{CardParts, Held};
use crate::{PROGRAM, Start};

/// A card that is missing or full is looked at again after this.
const RETRY: Duration = Duration::from_millis(500);
/// Pause when there is nothing to write: what a loss of power may cost besides the record being written.
const PAUSE: Duration = Duration::from_millis(10);

/// The log's first record.
pub(crate) fn header(parameters: &Parameters) -> Frame {
    // Parameters fit a frame: the store that they came from is smaller.
    let header = Header::new(parameters, PROGRAM).and_then(|header| log::encode_header(&header));
    header.unwrap_or_default()
}

/// Writes for ever; whenever the card fails, on a new file as soon as there is a card again.
#[embassy_executor::task]
pub(crate) async fn write(mut parts: CardParts, header: Frame, start: Start, log_number: u32, _held: Held) -> ! {
    let mut first = Some(start);
    let mut said = false;
    loop {
        let lost = session(&mut parts, &header, &mut first, log_number).await;
        newest(|newest| newest.log_lost = true);
        if !core::mem::replace(&mut said, true) {
            notify(format_args!("log lost: {lost}"));
        }
        for _ in 0..RETRY.as_millis() / 20 {
            CHECK_INS.report(Task::Log, now_us());
            Timer::after_millis(20).await;
        }
    }
}

/// One card's time: returns why it ended.
async fn session(
    parts: &mut CardParts,
    header: &Frame,
    first: &mut Option<Start>,
    log_number: u32,
) -> RecorderError<CardError> {
    let mut command = CmdBlock::new();
    let mut buffer = DataBlock::new();
    let mut driver = card::driver(parts);
    let card = match StorageDevice::new_sd_card(&mut driver, &mut command, card::CLOCK).await {
        Ok(card) => card,
        Err(error) => return RecorderError::Device(CardError(error)),
    };
    let mut recorder = match Recorder::open(CardDevice::new(card, &mut buffer), header, log_number) {
        Ok(recorder) => recorder,
        Err(error) => return error,
    };
    newest(|newest| newest.log_lost = false);
    loop {
        let step = match first.take() {
            Some(start) => write_start(&mut recorder, &start),
            None => write_queue(&mut recorder),
        };
        if let Err(error) = step.and_then(|()| recorder.commit()) {
            return error;
        }
        CHECK_INS.report(Task::Log, now_us());
        Timer::after(PAUSE).await;
    }
}

type Log<'a, 'b> = Recorder<CardDevice<'a, 'b>>;

/// Why the board started, and the words that its last run left.
fn write_start(recorder: &mut Log<'_, '_>, start: &Start) -> Result<(), RecorderError<CardError>> {
    let time_us = now_us();
    let event = Entry::Event(Event { time_us, kind: EventKind::Started(start.cause) });
    recorder.append(&log::encode_entry(&event).unwrap_or_default())?;
    if let Some(text) = start.note.clone() {
        let message = Record::Message(Message { time_us, text });
        recorder.append(&log::encode(&message).unwrap_or_default())?;
    }
    Ok(())
}

/// Everything that waits.
fn write_queue(recorder: &mut Log<'_, '_>) -> Result<(), RecorderError<CardError>> {
    while let Some(entry) = blackboard::log(|queue| queue.pop(now_us())) {
        recorder.append(&log::encode_entry(&entry).unwrap_or_default())?;
    }
    Ok(())
}
