//! Where the runtime's models leave silicon behind in ways that drivers meet, and what is done about it from outside.
//!
//! Each mend makes, in the firmware's name, an access that silicon would not need. All were found by drivers of
//! embassy-stm32 0.6 on rigless 0.4.0, which waited for ever or read a byte too late; a runtime without the fault is not disturbed by them.

use rigless::emulator::{Access, AccessKind, Host};
use rigless::session::Session;
use rigless::soc::Width;

use crate::machine::Machine;

/// `SDIO_CMD` and `SDIO_DCTRL`.
const CARD_COMMAND: u64 = 0x4001_2C0C;
const CARD_PATH: u64 = 0x4001_2C2C;
/// `I2C1_CR1`, `I2C1_DR`, `I2C1_SR1`.
const SENSOR_BUS_CONTROL: u64 = 0x4000_5400;
const SENSOR_BUS_DATA: u64 = 0x4000_5410;
const SENSOR_BUS_STATUS: u64 = 0x4000_5414;
/// `SR1`: a start was sent; a byte was received.
const STARTED: u64 = 1 << 0;
const RECEIVED: u64 = 1 << 6;

/// Mends what this access left broken.
pub(crate) fn mend(session: &mut Session<Machine>, host: &mut dyn Host, access: Access, value: u64) {
    let mut make = |session: &mut Session<Machine>, kind, address, value| {
        let made = Access::new(kind, address, Width::W32, value);
        session.access(made.at(access.instruction_count, access.virtual_time), host)
    };
    match (access.kind, access.address) {
        // The card's data path asks for data a word's time after it was enabled, and stalls for good if the command comes
        // later; drivers enable the path first. On silicon it waits (RM0090 rev 21, 31.3.2, `Wait_R`). So the path begins
        // again with the command.
        (AccessKind::Write, CARD_COMMAND) => {
            if let Some(control) = session.board_mut().card_path_waiting() {
                make(session, AccessKind::Write, CARD_PATH, 0);
                make(session, AccessKind::Write, CARD_PATH, control);
            }
        }
        // A start that had to wait for the byte before it stays remembered as written once it is carried out, and the next
        // start is taken for the same one. Writing back what is read is what the model needs to look again; a driver reads
        // the register before it sets a bit in it.
        (AccessKind::Read, SENSOR_BUS_CONTROL) => {
            make(session, AccessKind::Write, SENSOR_BUS_CONTROL, value);
        }
        // Under DMA the last byte is not refused (CR2 `LAST` is not modelled), so one byte too many is clocked and lies in
        // the data register when the next transaction has begun. Silicon has refused it.
        (AccessKind::Read, SENSOR_BUS_STATUS) if value & (STARTED | RECEIVED) == STARTED | RECEIVED => {
            make(session, AccessKind::Read, SENSOR_BUS_DATA, 0);
        }
        _ => {}
    }
}
