//! EXPERIMENTAL: triggering a GoPro HERO4 through the connector on its back (the `HeroBus`), as an accessory on its
//! I2C bus.
//!
//! Nobody but the maker has the protocol; this is what the `MewPro4` project found out, and it has been tried here
//! against a scripted camera only. Set the mode (single photo) and auto-off (never) on the camera beforehand. Firmware
//! 03.00 is complete, 01.x has no such protocol, 04.00 and 05.00 fail when settings are transferred in bulk, which is
//! not done here.
//!
//! The camera is the bus's master and the board answers at two addresses: an EEPROM that says which accessory it is,
//! and a device that is written and read in frames. To send, the board prepares a frame, waits, and pulls the interrupt
//! line low until the camera reads. [`HeroBus`] is sans-I/O: the board's task hands in what the camera writes and asks,
//! and sets the lines that [`HeroBus::step`] returns.
//!
//! A frame is its length (of what follows), two letters ("YY" functions, "ZZ" system, zeros in replies), a session
//! (zero will do), what it is (reply or command, system or function), and from byte 5 on
//! - in a function: the camera's boot id, group, command, number of arguments (16 bits), arguments;
//! - in a reply with status: a byte of unknown use, the camera's status, then as in a function.
//!
//! Whether a photo is done is seen in that status. `MewPro4` reads it from the Omni firmware; other firmwares may
//! reply without, and then [`HeroBus::status`] stays unknown and no photo is ever counted as stored.
//!
//! Sources: `MewPro4`'s `c_I2C.ino`, `b_Parser.ino`, `startup.h`; lines and levels: gist 285b0849e699af62ccdc of the
//! same author.

use heapless::{Deque, Vec};

use crate::io::CameraStatus;

/// Address at which the accessory's EEPROM answers.
pub const EEPROM_ADDRESS: u8 = 0x50;
/// Address at which frames are exchanged.
pub const DEVICE_ADDRESS: u8 = 0x60;
/// The longest answer to a read.
pub const MAX_ANSWER_BYTES: usize = 16;

/// What the EEPROM holds: slave of a Dual Hero pair, version 5.1 (`rom_dual_hero_1`); the rest is as erased.
const EEPROM: [u8; MAX_ANSWER_BYTES] =
    [0x05, 0x05, 0x01, 0x0B, 0xFF, 0xFF, 0xFF, 0xFF, 0xFF, 0xFF, 0xFF, 0xFF, 0xFF, 0xFF, 0xFF, 0xFF];

/// How long the power button is held (`powerOn`).
const POWER_BUTTON_US: u64 = 500_000;
/// From a frame being ready to the interrupt.
const SETTLING_US: u64 = 3_000;
/// A camera that does not read a frame within this has gone. It reads within milliseconds while it is on (assumed).
const READING_MAX_US: u64 = 1_000_000;
/// How often the camera is asked for its status while a photo is under way; a photo takes it half a second or more.
const POLL_US: u64 = 100_000;
/// A photo that is not done after this will not be: the longest exposure by night, 30 s, and the writing.
const PHOTO_MAX_US: u64 = 40_000_000;
/// Frames that can wait to be sent.
const QUEUE: usize = 8;

/// Values of byte 4: what a frame is. Bit 1 tells functions from system.
const SYSTEM_REPLY: u8 = 0x00;
const FUNCTION_REPLY: u8 = 0x02;
const SYSTEM: u8 = 0x04;
const FUNCTION: u8 = 0x06;

/// What the camera says it does.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Status {
    /// Starting.
    PowerOn,
    /// Recording or exposing.
    Recording,
    /// Writing, or otherwise not ready.
    Busy,
    /// Ready.
    Idle,
}

impl Status {
    fn from_byte(byte: u8) -> Option<Self> {
        match byte {
            0x00 => Some(Self::PowerOn),
            0x08 => Some(Self::Recording),
            0x10 => Some(Self::Busy),
            0x30 => Some(Self::Idle),
            _ => None,
        }
    }

    fn is_working(self) -> bool {
        matches!(self, Self::Recording | Self::Busy)
    }
}

/// Levels of the lines to the camera; all are open drain and rest high.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Lines {
    /// Backpack-ready: low says that there is an accessory.
    pub backpack_ready_low: bool,
    /// I2C interrupt: low asks the camera to read.
    pub interrupt_low: bool,
    /// The power button.
    pub power_button_low: bool,
}

/// Why the shutter was not pressed.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum HeroBusError {
    /// The camera has not recognised the board, or has stopped talking.
    #[error("the camera does not talk to the board; it has been lost {losses} times")]
    NotConnected {
        /// How often it has stopped reading so far.
        losses: u32,
    },
    /// Frames wait and the camera does not fetch them fast enough.
    #[error("{waiting} frames already wait for the camera")]
    QueueFull {
        /// How many.
        waiting: usize,
    },
}

/// A frame, on its way to the camera.
type Frame = Vec<u8, MAX_ANSWER_BYTES>;

/// What the board has to say.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Message {
    Capabilities,
    PoweredOn,
    HeartbeatHeard,
    SyncState(u8),
    Standalone,
    GetMode,
    Shutter,
}

impl Message {
    fn encode(self, boot_id: u8) -> Frame {
        let content: &[u8] = match self {
            Self::Capabilities => &[0, 0, 0, SYSTEM_REPLY, 0, 0, 0x01, 0x03, 0x01, 0x00, 0x00],
            Self::PoweredOn => &[0, 0, 0, SYSTEM_REPLY, 0, 0, 0x02, 0x00],
            Self::HeartbeatHeard => &[0, 0, 0, SYSTEM_REPLY, 0, 0, 0x00, 0x02, 0x00],
            Self::SyncState(state) => &[0, 0, 0, SYSTEM_REPLY, 0, 0, 0x00, 0x01, 0x01, state],
            Self::Standalone => &[b'Z', b'Z', 0, SYSTEM, 0x00, 0x00, 0x01, 0x01, 0x00],
            Self::GetMode => &[b'Y', b'Y', 0, FUNCTION, boot_id, 0x01, 0x00, 0x00, 0x00],
            Self::Shutter => &[b'Y', b'Y', 0, FUNCTION, boot_id, 0x03, 0x17, 0x00, 0x00],
        };
        [content.len() as u8].iter().chain(content).copied().take(MAX_ANSWER_BYTES).collect()
    }
}

/// Where the current frame is.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
enum Sending {
    #[default]
    Nothing,
    Settling {
        since_us: u64,
    },
    Offered {
        since_us: u64,
    },
}

/// A photo under way.
#[derive(Clone, Copy, Debug)]
struct Photo {
    fired_us: u64,
    asked_us: u64,
    has_worked: bool,
}

/// The accessory.
#[derive(Debug, Default)]
pub struct HeroBus {
    attached: bool,
    connected: bool,
    boot_id: u8,
    eeprom_pointer: u8,
    power_button_until_us: Option<u64>,
    queue: Deque<Message, QUEUE>,
    sending: Sending,
    /// The frame being sent, or sent last: a camera that reads again gets it again.
    frame: Frame,
    /// Whether the current frame presses the shutter.
    fires: bool,
    photo: Option<Photo>,
    status: Option<Status>,
    photos_stored: u32,
    losses: u32,
}

impl HeroBus {
    /// An accessory that is not attached.
    pub fn new() -> Self {
        Self::default()
    }

    /// Shows the camera that there is an accessory. The slave must be answering at both addresses by then.
    pub fn attach(&mut self) {
        self.attached = true;
    }

    /// Presses the power button for half a second, which switches the camera on (and one that is on to its next mode).
    pub fn power_on(&mut self, now_us: u64) {
        self.power_button_until_us = Some(now_us.saturating_add(POWER_BUTTON_US));
    }

    /// Asks the camera for a photo; it fires when it has read the frame, some milliseconds later.
    ///
    /// # Errors
    /// [`HeroBusError`]: nothing was asked.
    pub fn shutter(&mut self) -> Result<(), HeroBusError> {
        if !self.connected {
            return Err(HeroBusError::NotConnected { losses: self.losses });
        }
        let waiting = self.queue.len();
        self.queue.push_back(Message::Shutter).map_err(|_| HeroBusError::QueueFull { waiting })
    }

    /// Lets time pass; call it every millisecond or so. Returns the levels of the lines.
    pub fn step(&mut self, now_us: u64) -> Lines {
        self.power_button_until_us = self.power_button_until_us.filter(|until_us| now_us < *until_us);
        self.photo = self.photo.filter(|photo| now_us.saturating_sub(photo.fired_us) < PHOTO_MAX_US);
        self.poll(now_us);
        self.send(now_us);
        Lines {
            backpack_ready_low: self.attached,
            interrupt_low: matches!(self.sending, Sending::Offered { .. }),
            power_button_low: self.power_button_until_us.is_some(),
        }
    }

    /// Takes what the camera has written to one of the two addresses.
    pub fn written(&mut self, address: u8, bytes: &[u8]) {
        match (address, bytes) {
            (EEPROM_ADDRESS, [pointer, ..]) => self.eeprom_pointer = *pointer,
            (DEVICE_ADDRESS, [length, content @ ..]) => {
                // Shorter than announced: torn, and what it says is not to be trusted.
                if let Some(content) = content.get(..usize::from(*length)) {
                    self.received(content);
                }
            }
            _ => {}
        }
    }

    /// What to answer the camera that reads from one of the two addresses; it may stop before the end.
    pub fn read(&mut self, now_us: u64, address: u8) -> Vec<u8, MAX_ANSWER_BYTES> {
        if address == EEPROM_ADDRESS {
            // A read that names no place begins at zero (MewPro4: the camera's own one-byte writes fail at times).
            let from = usize::from(core::mem::take(&mut self.eeprom_pointer)) % EEPROM.len();
            return EEPROM.iter().cycle().skip(from).take(EEPROM.len()).copied().collect();
        }
        if address == DEVICE_ADDRESS && matches!(self.sending, Sending::Offered { .. }) {
            self.sending = Sending::Nothing;
            if core::mem::take(&mut self.fires) {
                self.photo = Some(Photo { fired_us: now_us, asked_us: now_us, has_worked: false });
            }
        }
        if address == DEVICE_ADDRESS && self.sending == Sending::Nothing && !self.frame.is_empty() {
            self.frame.clone()
        } else {
            // Nothing on offer: a frame of no length.
            core::iter::once(0).collect()
        }
    }

    /// What the camera last said it does; `None` while that is not known.
    pub fn status(&self) -> Option<Status> {
        self.status
    }

    /// Whether the camera has recognised the board and reads what it is sent.
    pub fn is_connected(&self) -> bool {
        self.connected
    }

    /// For the controller: busy as last said; a photo counts as stored when the camera has been busy after the shutter
    /// and is idle again.
    pub fn camera_status(&self) -> CameraStatus {
        CameraStatus { busy: self.status.is_some_and(Status::is_working), photos_stored: self.photos_stored }
    }

    fn received(&mut self, content: &[u8]) {
        match content {
            [_, _, _, SYSTEM, command @ ..] => self.command(command),
            [_, _, _, FUNCTION, boot_id, ..] => self.boot_id = *boot_id,
            // A group (1 to 9, never 8) is no status, so the two kinds of reply cannot be taken for each other.
            [_, _, _, FUNCTION_REPLY, first, second, third, ..] => {
                if let Some(status) = Status::from_byte(*second) {
                    self.boot_id = *third;
                    self.take_status(status);
                } else {
                    self.boot_id = *first;
                }
            }
            _ => {}
        }
    }

    /// Answers a system command of the camera: one that gets no answer drops its accessory.
    fn command(&mut self, command: &[u8]) {
        match command {
            [0x01, 0x00, ..] => {
                self.connected = true;
                self.say(Message::Capabilities);
                self.say(Message::Standalone);
                self.say(Message::GetMode);
            }
            [0x02, 0x01, ..] => {
                self.status = Some(Status::PowerOn);
                self.say(Message::PoweredOn);
            }
            [0x00, 0x02, ..] => {
                self.connected = true;
                self.say(Message::HeartbeatHeard);
            }
            [0x00, 0x01, 0x01, state @ (0 | 1), ..] => self.say(Message::SyncState(*state)),
            _ => {}
        }
    }

    fn take_status(&mut self, status: Status) {
        self.status = Some(status);
        let Some(photo) = &mut self.photo else { return };
        if status.is_working() {
            photo.has_worked = true;
        } else if status == Status::Idle && photo.has_worked {
            self.photos_stored = self.photos_stored.wrapping_add(1);
            self.photo = None;
        }
    }

    /// Queues a message. Where the queue is full, the camera has stopped reading, and [`Self::send`] will find that
    /// out.
    fn say(&mut self, message: Message) {
        let _ = self.queue.push_back(message);
    }

    /// Asks for the status while a photo is under way: every reply carries it, and asking for the mode changes nothing.
    fn poll(&mut self, now_us: u64) {
        let quiet = self.queue.is_empty() && self.sending == Sending::Nothing;
        let Some(photo) = self.photo.as_mut().filter(|_| quiet) else { return };
        if now_us.saturating_sub(photo.asked_us) >= POLL_US {
            photo.asked_us = now_us;
            self.say(Message::GetMode);
        }
    }

    fn send(&mut self, now_us: u64) {
        match self.sending {
            Sending::Nothing => {
                if let Some(message) = self.queue.pop_front() {
                    self.frame = message.encode(self.boot_id);
                    self.fires = message == Message::Shutter;
                    self.sending = Sending::Settling { since_us: now_us };
                }
            }
            Sending::Settling { since_us } if now_us.saturating_sub(since_us) >= SETTLING_US => {
                self.sending = Sending::Offered { since_us: now_us };
            }
            Sending::Offered { since_us } if now_us.saturating_sub(since_us) >= READING_MAX_US => self.lose(),
            Sending::Settling { .. } | Sending::Offered { .. } => {}
        }
    }

    /// The camera has gone: what was to be said to it is void, an unfired shutter above all.
    fn lose(&mut self) {
        self.queue.clear();
        self.sending = Sending::Nothing;
        self.frame.clear();
        self.fires = false;
        self.connected = false;
        self.photo = None;
        self.status = None;
        self.losses = self.losses.wrapping_add(1);
    }
}

#[cfg(test)]
mod tests;
