//! What a bootloader looks for in the image: the application descriptor of ArduPilot's `AP_CheckFirmware.h`.
//!
//! `cargo xtask flash` fills in checksums and size. PX4's bootloader does not ask for it.

/// The descriptor as the bootloader finds it by its signature.
#[repr(C)]
struct Descriptor {
    signature: [u8; 8],
    /// CRC of what lies before, CRC of what lies behind, length, hash of the sources: filled in after linking.
    filled_in: [u32; 4],
    version: [u8; 2],
    /// The bootloader's number for this board: PX4 FMU v4.
    board: u16,
    reserved: [u8; 8],
}

#[used]
static DESCRIPTOR: Descriptor = Descriptor {
    signature: [0x40, 0xA2, 0xE4, 0xF1, 0x64, 0x68, 0x91, 0x06],
    filled_in: [0; 4],
    version: [0, 1],
    board: 11,
    reserved: [0xFF; 8],
};
