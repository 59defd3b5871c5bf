//! Temporary.
#![no_std]
#![no_main]
mod clocks;
mod crash;
mod descriptor;
mod pins;
mod stack;
mod statistics;
use defmt_rtt as _;
use embassy_time as _;

#[cortex_m_rt::entry]
fn main() -> ! {
    stack::paint();
    let _ = (crash::start_cause(), crash::take_note());
    let source = clocks::find_source();
    let board = pins::Board::new(embassy_stm32::init(clocks::config(source)));
    let _ = board;
    defmt::info!("{=u32}", stack::high_water_bytes());
    loop {
        cortex_m::asm::wfe();
    }
}
