//! The SD card in the slot: a high-capacity card of a given size, its blocks in memory, every write in a journal.
//!
//! Commands and states follow the SD Physical Layer Simplified Specification 6.00, chapter 4 (4.3 for the states, 4.10 for
//! the status word, 5.1 to 5.6 for the registers), as far as a driver of the SD bus uses them: identification with CMD8
//! and ACMD41 (CCS set: addresses count blocks), SCR and SD status, single and multiple blocks. The runtime's own card
//! answers neither CMD8 nor ACMD51 and ACMD13, and leaves CCS clear, so a driver of today refuses it or mistakes its
//! addresses. Left out: erase, locks, lower voltages, high speed (CMD6 says so).
//!
//! Power that fails leaves whole blocks: a block is written when its last byte has crossed.

use rigless::chip::sd::{Answer, BLOCK, Busy, Outcome, command};
use rigless::chip::{Timeline, sd};
use rigless::snapshot::Store;
use rigless::time::VirtualNanos;

use super::volume::BlockImage;

/// Time that a card takes to program what it was given: the short end of what cards take, so that a driver that does not
/// wait is caught and one that polls is not slow to emulate.
const PROGRAMMING_NS: u64 = 100_000;
/// The address the card takes.
const RELATIVE_ADDRESS: u32 = 0x0001;
/// ACMD41: powered up, high capacity, 2.7 to 3.6 V.
const OPERATING_CONDITIONS: u32 = 0xC0FF_8000;
/// Maker "AD", product "ADITS", some serial number.
const IDENTIFICATION: [u32; 4] = [0x0141_4441, 0x4449_5453, 0x1000_0000, 0x0101_8901];
/// SCR: version 2.00, no security, one and four lines.
const CONFIGURATION: [u8; 8] = [0x02, 0x35, 0x80, 0x00, 0x00, 0x00, 0x00, 0x00];
/// Status word: ready for data.
const READY: u32 = 1 << 8;
/// Status word: an application command comes next.
const APPLICATION: u32 = 1 << 5;
/// Status word: the address is beyond the card.
const OUT_OF_RANGE: u32 = 1 << 31;
/// Commands that the runtime's list leaves out.
const SWITCH_FUNCTION: u8 = 6;
const SD_STATUS: u8 = 13;
const SEND_CONFIGURATION: u8 = 51;

/// A block that the firmware wrote.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize)]
pub struct BlockWrite {
    /// Virtual time since the flight's start at which the write command came.
    pub at_ns: u64,
    /// Which block.
    pub block: u32,
    /// What was written.
    #[serde(skip)]
    pub data: [u8; BLOCK],
}

/// What is wrong with the card now.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct CardDefects {
    /// Blocks read fail their check.
    pub(crate) bad_reads: bool,
    /// Blocks written are not taken.
    pub(crate) bad_writes: bool,
}

/// States of section 4.10, as the status word has them.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum State {
    Idle = 0,
    Ready = 1,
    Identification = 2,
    Standby = 3,
    Transfer = 4,
    Sending = 5,
    Receiving = 6,
    Programming = 7,
}

/// The card.
#[derive(Clone, Debug)]
pub(crate) struct SdCard {
    pub(crate) image: BlockImage,
    pub(crate) journal: Vec<BlockWrite>,
    pub(crate) defects: CardDefects,
    /// When the present power-up was, in flight time.
    pub(crate) epoch_ns: u64,
    state: State,
    application: bool,
    /// The next block of a transfer, and whether more follow.
    streaming: Option<(u32, bool)>,
    /// A register about to be read as data.
    register: Option<Vec<u8>>,
    programmed_ns: u64,
    now_ns: u64,
}

impl SdCard {
    pub(crate) fn new(image: BlockImage) -> Self {
        Self {
            image,
            journal: Vec::new(),
            defects: CardDefects::default(),
            epoch_ns: 0,
            state: State::Idle,
            application: false,
            streaming: None,
            register: None,
            programmed_ns: 0,
            now_ns: 0,
        }
    }

    pub(crate) fn power_up(&mut self, epoch_ns: u64) {
        let (image, journal) = (std::mem::take(&mut self.image), std::mem::take(&mut self.journal));
        *self = Self { journal, epoch_ns, defects: self.defects, ..Self::new(image) };
    }

    /// The card after it was put into the slot: it knows nothing of what it was told before.
    pub(crate) fn insert(&mut self) {
        self.power_up(self.epoch_ns);
    }

    /// Leaves no room on the card; one without volume takes nothing any more.
    pub(crate) fn fill(&mut self) {
        if self.image.fill().is_err() {
            self.image = BlockImage::empty(0);
        }
    }

    fn answer(&mut self, index: u8, argument: u32, now_ns: u64) -> Answer {
        self.now_ns = now_ns;
        if self.state == State::Programming && now_ns >= self.programmed_ns {
            self.state = State::Transfer;
        }
        // A single block goes out whether or not anyone takes it.
        if self.state == State::Sending && self.streaming.is_none_or(|(_, multiple)| !multiple) {
            self.streaming = None;
            self.state = State::Transfer;
        }
        let application = std::mem::take(&mut self.application);
        if application && let Some(answer) = self.answer_application(index) {
            return answer;
        }
        self.answer_standard(index, argument)
    }

    fn answer_standard(&mut self, index: u8, argument: u32) -> Answer {
        match (index, self.state) {
            (command::GO_IDLE_STATE, _) => {
                self.state = State::Idle;
                self.streaming = None;
                self.register = None;
                Answer::None
            }
            (command::SEND_IF_COND, _) => Answer::Short(argument & 0xFFF),
            (command::ALL_SEND_CID, State::Ready) => {
                self.state = State::Identification;
                Answer::Long(IDENTIFICATION)
            }
            (command::SET_RELATIVE_ADDR, State::Identification | State::Standby) => {
                self.state = State::Standby;
                Answer::Short(RELATIVE_ADDRESS << 16)
            }
            (command::SEND_CSD, State::Standby) => Answer::Long(self.card_specific_data()),
            (command::SELECT_DESELECT_CARD, State::Standby | State::Transfer) => {
                let chosen = argument >> 16 == RELATIVE_ADDRESS;
                self.state = if chosen { State::Transfer } else { State::Standby };
                self.status()
            }
            (command::APP_CMD, _) => {
                self.application = true;
                self.status()
            }
            // Without high speed: no function group has more than its default.
            (SWITCH_FUNCTION, State::Transfer) => self.send(vec![0; 64]),
            (command::READ_SINGLE_BLOCK, State::Transfer) => self.stream(argument, State::Sending, false),
            (command::READ_MULTIPLE_BLOCK, State::Transfer) => self.stream(argument, State::Sending, true),
            (command::WRITE_BLOCK, State::Transfer) => self.stream(argument, State::Receiving, false),
            (command::WRITE_MULTIPLE_BLOCK, State::Transfer) => self.stream(argument, State::Receiving, true),
            (command::STOP_TRANSMISSION, State::Sending | State::Receiving | State::Transfer) => {
                let written = self.state == State::Receiving;
                self.streaming = None;
                self.state = State::Transfer;
                if written {
                    self.program();
                }
                self.status()
            }
            _ => self.status(),
        }
    }

    fn answer_application(&mut self, index: u8) -> Option<Answer> {
        match (index, self.state) {
            (command::SD_SEND_OP_COND, State::Idle | State::Ready) => {
                self.state = State::Ready;
                Some(Answer::Short(OPERATING_CONDITIONS))
            }
            (command::SET_BUS_WIDTH, State::Transfer) => Some(self.status()),
            (SEND_CONFIGURATION, State::Transfer) => Some(self.send(CONFIGURATION.to_vec())),
            (SD_STATUS, State::Transfer) => Some(self.send(vec![0; 64])),
            _ => None,
        }
    }

    fn send(&mut self, register: Vec<u8>) -> Answer {
        self.register = Some(register);
        self.status()
    }

    fn stream(&mut self, block: u32, state: State, multiple: bool) -> Answer {
        if block >= self.image.blocks() {
            return Answer::Short(self.status_word() | OUT_OF_RANGE);
        }
        let answer = self.status();
        self.streaming = Some((block, multiple));
        self.state = state;
        answer
    }

    fn status_word(&self) -> u32 {
        let ready = if self.state == State::Programming { 0 } else { READY };
        ((self.state as u32) << 9) | ready | if self.application { APPLICATION } else { 0 }
    }

    fn status(&self) -> Answer {
        Answer::Short(self.status_word())
    }

    fn program(&mut self) {
        self.state = State::Programming;
        self.programmed_ns = self.now_ns + PROGRAMMING_NS;
    }

    /// Version 2 of the structure: the size in half megabytes less one in bits 69 to 48 (5.3.3).
    fn card_specific_data(&self) -> [u32; 4] {
        let size = (self.image.blocks() / 1024).saturating_sub(1);
        [0x400E_0032, 0x5B59_0000 | (size >> 16), (size & 0xFFFF) << 16, 0x0A40_0001]
    }

    fn give(&mut self, block: &mut [u8]) -> Outcome {
        if let Some(register) = self.register.take() {
            for (to, from) in block.iter_mut().zip(register) {
                *to = from;
            }
            return Outcome::Whole;
        }
        let Some((at, multiple)) = self.streaming.filter(|(at, _)| *at < self.image.blocks()) else {
            return Outcome::Ended;
        };
        if self.state != State::Sending {
            return Outcome::Ended;
        }
        block.copy_from_slice(&self.image.block(at)[..block.len()]);
        self.go_on(at, multiple);
        if self.defects.bad_reads { Outcome::Corrupt } else { Outcome::Whole }
    }

    fn take(&mut self, block: &[u8]) -> Outcome {
        let Some((at, multiple)) = self.streaming.filter(|(at, _)| *at < self.image.blocks()) else {
            return Outcome::Ended;
        };
        let Ok(data) = <[u8; BLOCK]>::try_from(block) else { return Outcome::Ended };
        if self.state != State::Receiving {
            return Outcome::Ended;
        }
        self.go_on(at, multiple);
        if self.defects.bad_writes {
            return Outcome::Corrupt;
        }
        self.image.set_block(at, &data);
        self.journal.push(BlockWrite { at_ns: self.epoch_ns + self.now_ns, block: at, data });
        if !multiple {
            self.program();
        }
        Outcome::Whole
    }

    fn go_on(&mut self, at: u32, multiple: bool) {
        self.streaming = multiple.then_some((at + 1, true));
        if !multiple {
            self.state = State::Transfer;
        }
    }
}

impl Store for SdCard {}

impl sd::Card for SdCard {
    fn command(&mut self, index: u8, argument: u32, context: &mut Timeline<'_, '_>) -> Answer {
        self.answer(index, argument, context.now().0)
    }

    fn busy(&self) -> Busy {
        if self.state == State::Programming { Busy::Until(VirtualNanos(self.programmed_ns)) } else { Busy::Ready }
    }

    fn read(&mut self, block: &mut [u8]) -> Outcome {
        self.give(block)
    }

    fn write(&mut self, block: &[u8]) -> Outcome {
        self.take(block)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// What a driver sends until it may transfer.
    fn selected(blocks: u32) -> SdCard {
        let mut card = SdCard::new(BlockImage::empty(blocks));
        assert_eq!(card.answer(command::GO_IDLE_STATE, 0, 0), Answer::None);
        assert_eq!(card.answer(command::SEND_IF_COND, 0x1AA, 0), Answer::Short(0x1AA));
        card.answer(command::APP_CMD, 0, 0);
        let Answer::Short(conditions) = card.answer(command::SD_SEND_OP_COND, 0x40FF_8000, 0) else { panic!() };
        assert_eq!(conditions >> 30, 0b11, "powered up, high capacity");
        assert!(matches!(card.answer(command::ALL_SEND_CID, 0, 0), Answer::Long(_)));
        let Answer::Short(address) = card.answer(command::SET_RELATIVE_ADDR, 0, 0) else { panic!() };
        card.answer(command::SELECT_DESELECT_CARD, address, 0);
        card
    }

    #[test]
    fn the_size_a_driver_computes_is_the_cards() {
        let card = SdCard::new(BlockImage::empty(1 << 21));
        let [_, high, low, _] = card.card_specific_data();
        let size = ((high & 0x3F) << 16) | (low >> 16);
        assert_eq!((size + 1) * 1024, 1 << 21);
    }

    #[test]
    fn registers_are_read_as_data() {
        let mut card = selected(8192);
        card.answer(command::APP_CMD, 1 << 16, 0);
        card.answer(SEND_CONFIGURATION, 0, 0);
        let mut register = [0; 8];
        assert_eq!(card.give(&mut register), Outcome::Whole);
        assert_eq!(register, CONFIGURATION);
        card.answer(command::APP_CMD, 1 << 16, 0);
        card.answer(SD_STATUS, 0, 0);
        assert_eq!(card.give(&mut [0; 64]), Outcome::Whole);
    }

    #[test]
    fn a_block_written_is_read_back_and_stands_in_the_journal() {
        let mut card = selected(8192);
        card.answer(command::WRITE_BLOCK, 5, 1_000);
        assert_eq!(card.take(&[7; BLOCK]), Outcome::Whole);
        let status = |card: &mut SdCard, now_ns| match card.answer(command::SEND_STATUS, 1 << 16, now_ns) {
            Answer::Short(word) => (word >> 9) & 0xF,
            other => panic!("{other:?}"),
        };
        assert_eq!(status(&mut card, 2_000), State::Programming as u32);
        assert_eq!(status(&mut card, 1_000 + PROGRAMMING_NS), State::Transfer as u32);
        card.answer(command::READ_SINGLE_BLOCK, 5, 200_000);
        let mut block = [0; BLOCK];
        assert_eq!(card.give(&mut block), Outcome::Whole);
        assert_eq!(block, [7; BLOCK]);
        assert_eq!(card.journal, [BlockWrite { at_ns: 1_000, block: 5, data: [7; BLOCK] }]);
    }

    #[test]
    fn several_blocks_go_on_until_they_are_stopped() {
        let mut card = selected(8192);
        card.answer(command::WRITE_MULTIPLE_BLOCK, 10, 0);
        assert_eq!([card.take(&[1; BLOCK]), card.take(&[2; BLOCK])], [Outcome::Whole; 2]);
        card.answer(command::STOP_TRANSMISSION, 0, 0);
        assert_eq!(card.take(&[3; BLOCK]), Outcome::Ended);
        assert_eq!([10, 11, 12].map(|block| card.image.block(block)[0]), [1, 2, 0]);
    }

    #[test]
    fn a_block_beyond_the_card_is_refused() {
        let mut card = selected(8192);
        let Answer::Short(word) = card.answer(command::READ_SINGLE_BLOCK, 8192, 0) else { panic!() };
        assert_ne!(word & OUT_OF_RANGE, 0);
        assert_eq!(card.give(&mut [0; BLOCK]), Outcome::Ended);
    }

    #[test]
    fn a_card_put_back_must_be_identified_again() {
        let mut card = selected(8192);
        card.answer(command::WRITE_BLOCK, 5, 0);
        card.take(&[7; BLOCK]);
        card.insert();
        card.answer(command::READ_SINGLE_BLOCK, 5, 1_000_000);
        assert_eq!(card.give(&mut [0; BLOCK]), Outcome::Ended);
        assert_eq!((card.image.block(5)[0], card.journal.len()), (7, 1), "what is on it stays");
    }

    #[test]
    fn a_broken_card_says_so_by_its_checks() {
        let mut card = selected(8192);
        card.defects = CardDefects { bad_reads: true, bad_writes: true };
        card.answer(command::WRITE_BLOCK, 5, 0);
        assert_eq!(card.take(&[7; BLOCK]), Outcome::Corrupt);
        assert!(card.journal.is_empty() && card.image.block(5) == [0; BLOCK]);
        card.answer(command::READ_SINGLE_BLOCK, 5, 0);
        assert_eq!(card.give(&mut [0; BLOCK]), Outcome::Corrupt);
    }
}
