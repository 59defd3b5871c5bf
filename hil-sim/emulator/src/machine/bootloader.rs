//! A stand-in for the bootloader that a Pixracer carries in its first 16 KiB of flash.
//!
//! It does what the real one does when nobody wants to update the board: it points the core at the application's vector
//! table and enters it (`ArduPilot` `Tools/AP_Bootloader/support.cpp`, `jump_to_app`). Written by hand, so that the
//! emulator needs no binary that is not ours.

/// Where flash begins, and with it the bootloader.
pub(crate) const FLASH_START: u64 = 0x0800_0000;
/// Where the application is linked: behind the bootloader's 16 KiB.
pub(crate) const APPLICATION_START: u32 = 0x0800_4000;

/// Vector table and code (Thumb; halfwords in the processor's byte order).
pub(crate) const IMAGE: [u8; 32] = [
    0x00, 0x00, 0x02, 0x20, // initial stack pointer 0x2002_0000: within SRAM, and never used
    0x09, 0x00, 0x00, 0x08, // reset: 0x0800_0008, Thumb
    0x03, 0x48, //             ldr r0, [pc, #12]   ; 0x0800_4000, the application's vector table
    0x04, 0x49, //             ldr r1, [pc, #16]   ; 0xE000_ED08, SCB VTOR
    0x08, 0x60, //             str r0, [r1]        ; its exceptions from here on
    0x01, 0x68, //             ldr r1, [r0]        ; its stack
    0x8D, 0x46, //             mov sp, r1
    0x41, 0x68, //             ldr r1, [r0, #4]    ; its reset handler
    0x08, 0x47, //             bx r1
    0x00, 0xBF, //             nop                 ; literals are word-aligned
    0x00, 0x40, 0x00, 0x08, // literal at 0x0800_0018
    0x08, 0xED, 0x00, 0xE0, // literal at 0x0800_001C
];

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_literals_are_where_the_loads_look() {
        // `ldr rt, [pc, #imm]`: pc reads as the instruction's address plus four, word-aligned.
        for (at, literal) in [(8_usize, APPLICATION_START), (10, 0xE000_ED08)] {
            let literal_at = ((at + 4) & !3) + usize::from(IMAGE[at]) * 4;
            let bytes: [u8; 4] = IMAGE[literal_at..literal_at + 4].try_into().expect("four bytes");
            assert_eq!(u32::from_le_bytes(bytes), literal, "the load at {at}");
        }
    }
}
