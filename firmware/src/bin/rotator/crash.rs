//! What happens when nothing goes any more: the shaft stops, the shutter opens, the light goes out, a note is left in memory
//! that survives a reset, and the chip restarts. The next start reads the note and writes it to log and link.
#![allow(
    unsafe_code,
    reason = "the note lies at a fixed place outside of what the start-up code clears; a fault handler is unsafe by type"
)]

use core::fmt::{self, Write};
use core::mem::MaybeUninit;
use core::panic::PanicInfo;
use core::ptr::{addr_of, addr_of_mut};

use adit_protocol::record::{MESSAGE_BYTES, StartCause};
use embassy_stm32::pac;

/// "ADIT", so that random memory is no note.
const MAGIC: u32 = 0x5449_4441;

/// The note.
#[repr(C)]
struct Note {
    magic: u32,
    length: u32,
    check: u32,
    text: [u8; MESSAGE_BYTES],
}

#[unsafe(link_section = ".crash")]
static mut NOTE: MaybeUninit<Note> = MaybeUninit::uninit();

/// Collects words up to the note's length; what is too long is cut.
struct Words {
    text: [u8; MESSAGE_BYTES],
    length: usize,
}

impl Write for Words {
    fn write_str(&mut self, words: &str) -> fmt::Result {
        for letter in words.chars().map(|letter| if letter.is_ascii() { letter as u8 } else { b'?' }) {
            if let Some(place) = self.text.get_mut(self.length) {
                *place = letter;
                self.length += 1;
            }
        }
        Ok(())
    }
}

fn check(length: u32, text: &[u8; MESSAGE_BYTES]) -> u32 {
    // FNV-1a: a note half written must not be read.
    text.iter().fold(0x811C_9DC5 ^ length, |hash, byte| (hash ^ u32::from(*byte)).wrapping_mul(0x0100_0193))
}

/// Leaves a note for the next start.
pub(crate) fn leave_note(words: fmt::Arguments<'_>) {
    let mut note = Words { text: [0; MESSAGE_BYTES], length: 0 };
    // Cutting is no error.
    let _ = note.write_fmt(words);
    let length = note.length as u32;
    let note = Note { magic: MAGIC, length, check: check(length, &note.text), text: note.text };
    // SAFETY: single core; callers are the panic and fault handlers and the supervisor on its way to a reset, which do not
    // interrupt each other while writing: whoever comes later only replaces the note.
    unsafe { addr_of_mut!(NOTE).write_volatile(MaybeUninit::new(note)) };
}

/// Takes the note that the last run left, if it left one.
pub(crate) fn take_note() -> Option<heapless::String<MESSAGE_BYTES>> {
    // SAFETY: any bytes are a valid `Note`, which holds nothing but integers; nobody else looks at it during the start.
    let note = unsafe { addr_of!(NOTE).read_volatile().assume_init() };
    // SAFETY: as above.
    unsafe { addr_of_mut!(NOTE).write_volatile(MaybeUninit::zeroed()) };
    if note.magic != MAGIC || note.check != check(note.length, &note.text) {
        return None;
    }
    let text = note.text.get(..note.length as usize)?;
    heapless::String::try_from(core::str::from_utf8(text).ok()?).ok()
}

/// Stops everything that moves or shines, by the registers alone: no driver is trusted any more.
pub(crate) fn make_safe() {
    // Servo (TIM1): no output at all, so that it lets go. Light (TIM4 channel 2): duty zero. Shutter (PD14): released.
    pac::TIM1.bdtr().modify(|w| w.set_moe(false));
    pac::TIM4.ccr(1).write(|w| w.set_ccr(0));
    pac::GPIOD.bsrr().write(|w| w.set_br(14, true));
}

/// Why the chip was reset last; clears the chip's memory of it.
pub(crate) fn start_cause() -> StartCause {
    let flags = pac::RCC.csr().read();
    pac::RCC.csr().modify(|w| w.set_rmvf(true));
    // Every reset also pulls the pin, and power-on also sets the brown-out flag: the more telling flag comes first.
    match () {
        () if flags.wdgrstf() || flags.wwdgrstf() => StartCause::Watchdog,
        () if flags.sftrstf() => StartCause::Software,
        () if flags.porrstf() => StartCause::PowerOn,
        () if flags.borrstf() => StartCause::BrownOut,
        () if flags.padrstf() => StartCause::Pin,
        () => StartCause::Other,
    }
}

#[panic_handler]
fn panic(info: &PanicInfo<'_>) -> ! {
    cortex_m::interrupt::disable();
    make_safe();
    match info.location() {
        Some(place) => leave_note(format_args!("panic at {}:{}: {}", place.file(), place.line(), info.message())),
        None => leave_note(format_args!("panic: {}", info.message())),
    }
    cortex_m::peripheral::SCB::sys_reset()
}

#[cortex_m_rt::exception]
unsafe fn HardFault(frame: &cortex_m_rt::ExceptionFrame) -> ! {
    make_safe();
    leave_note(format_args!("hard fault at {:08x}, called from {:08x}", frame.pc(), frame.lr()));
    cortex_m::peripheral::SCB::sys_reset()
}
