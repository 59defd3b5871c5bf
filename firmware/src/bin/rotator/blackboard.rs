//! What tasks tell each other: the newest of everything, and bounded queues.
//!
//! | what | from | to | when full |
//! |---|---|---|---|
//! | newest readings | sensors, imu, link, log | control | replaced |
//! | newest outputs | control | link, supervisor | replaced |
//! | log entries | control | log | [`LogQueue`]'s policy: tags win, drops are counted |
//! | what is to be kept | control, log, link | store | the newest is dropped; the next number is larger, and the link tries again |
//! | whether it is | store | link | waits: one at a time |
//! | tags and what becomes of them | control | link | the newest is dropped; programs on the ground have the log |
//! | wishes for logs, and bytes of them | link, log | log, link | waits: one at a time |
//! | notices | anyone | link | the newest is dropped: the first trouble tells most |
//!
//! Every access is short and happens with interrupts off; nothing is computed there.

use core::cell::RefCell;

use adit_firmware::health::CheckIns;
use adit_firmware::io::{CameraStatus, Command, Outputs, RangeSample};
use adit_firmware::journal::LogQueue;
use adit_firmware::link::{self, LogAnswer, LogWish, Readdressing, VehicleView};
use adit_protocol::beams::Beams;
use adit_protocol::parameters::Parameters;
use adit_protocol::record::Entry;
use embassy_sync::blocking_mutex::Mutex;
use embassy_sync::blocking_mutex::raw::CriticalSectionRawMutex;
use embassy_sync::channel::Channel;

/// A notice for the pilot.
pub(crate) type Notice = heapless::String<50>;

/// The newest of everything.
#[derive(Debug, Default)]
pub(crate) struct Newest {
    pub(crate) ranges: Beams<RangeSample>,
    pub(crate) head: RangeSample,
    /// The encoder's angle and how often it was read.
    pub(crate) encoder_rad: Option<f32>,
    /// Attitude of our own.
    pub(crate) attitude_rad: Option<[f32; 3]>,
    /// What the link knows.
    pub(crate) vehicle: VehicleView,
    /// The next command of pilot or operator.
    pub(crate) command: Option<Command>,
    /// A change of a range sensor's address.
    pub(crate) readdressing: Option<Readdressing>,
    /// What a camera on `HeroBus` says.
    pub(crate) hero: Option<CameraStatus>,
    pub(crate) log_lost: bool,
    pub(crate) outputs: Outputs,
}

static NEWEST: Mutex<CriticalSectionRawMutex, RefCell<Option<Newest>>> = Mutex::new(RefCell::new(None));
static LOG: Mutex<CriticalSectionRawMutex, RefCell<LogQueue>> = Mutex::new(RefCell::new(LogQueue::new()));

/// What is to be kept over a loss of power.
pub(crate) enum Keep {
    /// The last capture's number.
    Capture(u32),
    /// The last log file's number.
    LogFile(u32),
    /// New parameters; the board restarts with them.
    Parameters(Parameters),
    /// What the link wants to find after the next start; it waits for [`KEPT`].
    Link(link::Keep),
}

/// What is to be kept.
pub(crate) static KEEP: Channel<CriticalSectionRawMutex, Keep, 4> = Channel::new();
/// Whether the link's last wish is kept.
pub(crate) static KEPT: Channel<CriticalSectionRawMutex, bool, 1> = Channel::new();
/// What the link shall tell of captures.
pub(crate) static CAPTURES: Channel<CriticalSectionRawMutex, Entry, 8> = Channel::new();
/// What is wanted of the card's logs.
pub(crate) static LOG_WISHES: Channel<CriticalSectionRawMutex, LogWish, 1> = Channel::new();
/// What the card says.
pub(crate) static LOG_ANSWERS: Channel<CriticalSectionRawMutex, (LogWish, LogAnswer), 1> = Channel::new();
/// What the pilot shall read.
pub(crate) static NOTICES: Channel<CriticalSectionRawMutex, Notice, 4> = Channel::new();
/// Who has reported when.
pub(crate) static CHECK_INS: CheckIns = CheckIns::new();

/// Looks at the newest, or changes it.
pub(crate) fn newest<R>(with: impl FnOnce(&mut Newest) -> R) -> R {
    NEWEST.lock(|newest| with(newest.borrow_mut().get_or_insert_default()))
}

/// Looks at the log's queue, or changes it.
pub(crate) fn log<R>(with: impl FnOnce(&mut LogQueue) -> R) -> R {
    LOG.lock(|queue| with(&mut queue.borrow_mut()))
}

/// Tells the pilot.
pub(crate) fn notify(words: core::fmt::Arguments<'_>) {
    let mut notice = Notice::new();
    // What is too long is cut at a whole piece; a full queue keeps the first notices.
    let _ = core::fmt::Write::write_fmt(&mut notice, words);
    let _ = NOTICES.try_send(notice);
}

/// Now, since the board's start.
pub(crate) fn now_us() -> u64 {
    embassy_time::Instant::now().as_micros()
}
