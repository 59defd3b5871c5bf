//! How deep the stack has been: painted at the start, looked at now and then.
#![allow(unsafe_code, reason = "the stack's free part is no Rust object; it is read and painted by address")]

/// Unlikely as data.
const PAINT: u32 = 0xA5C3_5A3C;
/// Left alone below the stack pointer while painting: this function's own frame.
const KEEP_BYTES: usize = 256;

unsafe extern "C" {
    static mut _stack_end: u32;
    static _stack_start: u32;
}

/// Paints what is free. Runs once, before interrupts are on.
pub(crate) fn paint() {
    let floor = &raw mut _stack_end;
    let top = cortex_m::register::msp::read() as usize - KEEP_BYTES;
    let mut word = floor;
    while (word as usize) < top {
        // SAFETY: between the stack's floor (memory.x) and the stack pointer, less this frame, lies nothing in use.
        unsafe {
            word.write_volatile(PAINT);
            word = word.add(1);
        }
    }
}

/// The most bytes of stack that were ever in use.
pub(crate) fn high_water_bytes() -> u32 {
    let mut word = &raw const _stack_end;
    let top = &raw const _stack_start;
    while word < top {
        // SAFETY: the words from the floor to the top of the stack are memory; their values are only compared.
        if unsafe { word.read_volatile() } != PAINT {
            break;
        }
        // SAFETY: stays at or below the top.
        word = unsafe { word.add(1) };
    }
    (top as usize - word as usize) as u32
}
