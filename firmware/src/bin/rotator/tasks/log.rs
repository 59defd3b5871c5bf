//! The log on the card.

use adit_firmware::health::Task;
use adit_firmware::link::{LogAnswer, LogBytes, LogWish, READ_BYTES};
use adit_firmware::recorder::{Doing, Offer, Recorder, RecorderError, logs, offered_parameters, read_log};
use adit_protocol::log::{self, Frame, PARAMETERS_FILE};
use adit_protocol::parameters::Parameters;
use adit_protocol::record::{Entry, Event, EventKind, Header, Message, Mode, Record};
use embassy_stm32::sdmmc::sd::{CmdBlock, DataBlock, StorageDevice};
use embassy_time::{Duration, Timer, with_timeout};
use embedded_sdmmc::{TimeSource, Timestamp};

use crate::blackboard::{self, CHECK_INS, KEEP, Keep, LOG_ANSWERS, LOG_WISHES, newest, notify, now_us};
use crate::card::{self, CardDevice, CardError};
use crate::pins::CardParts;
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
pub(crate) async fn write(mut parts: CardParts, header: Frame, start: Start, mut log_number: u32) -> ! {
    let mut first = Some(start);
    let mut said = false;
    loop {
        let lost = session(&mut parts, &header, &mut first, &mut log_number).await;
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
    log_number: &mut u32,
) -> RecorderError<CardError> {
    let mut command = CmdBlock::new();
    let mut buffer = DataBlock::new();
    let mut driver = card::driver(parts);
    let card = match StorageDevice::new_sd_card(&mut driver, &mut command, card::CLOCK).await {
        Ok(card) => card,
        Err(error) => return RecorderError::Device { doing: Doing::Examining, error: CardError(error) },
    };
    let device = CardDevice::new(card, &mut buffer);
    if let Err(error) = look_for_parameters(&device, header) {
        return error;
    }
    let mut recorder = match Recorder::open(&device, NoClock, header, *log_number + 1) {
        Ok(recorder) => recorder,
        Err(error) => return error,
    };
    *log_number = u32::from(recorder.number());
    let _ = KEEP.try_send(Keep::LogFile(*log_number));
    newest(|newest| newest.log_lost = false);
    loop {
        let step = match first.take() {
            Some(start) => write_start(&mut recorder, &start),
            None => write_queue(&mut recorder),
        };
        if let Err(error) = step.and_then(|()| lend(&device)) {
            return error;
        }
        CHECK_INS.report(Task::Log, now_us());
        // Whoever fetches a log wants thousands of stretches; the pause is for when nobody does.
        let _ = with_timeout(PAUSE, LOG_WISHES.ready_to_receive()).await;
    }
}

type Log<'a, 'c, 'b> = Recorder<'a, CardDevice<'c, 'b>, NoClock>;

/// The board has no calendar: files carry the FAT's first day, and their numbers tell their order.
struct NoClock;

impl TimeSource for NoClock {
    fn get_timestamp(&self) -> Timestamp {
        Timestamp { year_since_1970: 10, zero_indexed_month: 0, zero_indexed_day: 0, hours: 0, minutes: 0, seconds: 0 }
    }
}

/// Takes over parameters that the card offers, unless they are those in force or the board is at work.
fn look_for_parameters(device: &CardDevice<'_, '_>, header: &Frame) -> Result<(), RecorderError<CardError>> {
    let offered = match offered_parameters(device, NoClock)? {
        Offer::None => return Ok(()),
        Offer::Unreadable => {
            notify(format_args!("{PARAMETERS_FILE} is damaged or of another version"));
            return Ok(());
        }
        Offer::Parameters(offered) => offered,
    };
    let in_force = self::header(&offered) == *header;
    if !in_force && newest(|newest| newest.outputs.mode) == Mode::Idle {
        let _ = KEEP.try_send(Keep::Parameters(offered));
    }
    Ok(())
}

/// Why the board started, and the words that its last run left.
fn write_start(recorder: &mut Log<'_, '_, '_>, start: &Start) -> Result<(), RecorderError<CardError>> {
    let time_us = now_us();
    let event = Entry::Event(Event { time_us, kind: EventKind::Started(start.cause) });
    recorder.append(&log::encode_entry(&event).unwrap_or_default())?;
    if let Some(text) = start.note.clone() {
        let message = Record::Message(Message { time_us, text });
        recorder.append(&log::encode(&message).unwrap_or_default())?;
    }
    recorder.commit()
}

/// Reads from the card's logs what the link wants. A card that fails is told too: the link asks one question at a time, and an
/// answer that never came would be its last.
fn lend(device: &CardDevice<'_, '_>) -> Result<(), RecorderError<CardError>> {
    let Ok(wish) = LOG_WISHES.try_receive() else { return Ok(()) };
    let (answer, outcome) = match look_up(device, wish) {
        Ok(answer) => (answer, Ok(())),
        Err(error) => (LogAnswer::Failed, Err(error)),
    };
    let _ = LOG_ANSWERS.try_send((wish, answer));
    outcome
}

fn look_up(device: &CardDevice<'_, '_>, wish: LogWish) -> Result<LogAnswer, RecorderError<CardError>> {
    match wish {
        LogWish::List => logs(device, NoClock).map(LogAnswer::List),
        LogWish::Read { number, offset } => {
            let mut bytes = LogBytes::new();
            // There is room for just that many.
            let _ = bytes.resize_default(READ_BYTES);
            let count = read_log(device, NoClock, number, offset, &mut bytes)?;
            bytes.truncate(count);
            Ok(LogAnswer::Read(bytes))
        }
    }
}

/// Everything that waits; when nothing does, the file is made longer ahead of need.
fn write_queue(recorder: &mut Log<'_, '_, '_>) -> Result<(), RecorderError<CardError>> {
    loop {
        let entries = blackboard::log(|queue| queue.drain(now_us()));
        if entries.is_empty() {
            return recorder.make_room().map(drop);
        }
        let append = |entry: &Entry| recorder.append(&log::encode_entry(entry).unwrap_or_default());
        let written = entries.iter().try_for_each(append).and_then(|()| recorder.commit());
        if let Err(error) = written {
            blackboard::log(|queue| queue.give_back(&entries));
            return Err(error);
        }
    }
}
