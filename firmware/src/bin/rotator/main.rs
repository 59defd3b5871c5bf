//! The rotator board's flash image.
#![no_std]
#![no_main]
