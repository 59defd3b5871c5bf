//! `adit-emulator`.
fn main() {}
