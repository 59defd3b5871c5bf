//! The clock tree: 168 MHz from the board's 24 MHz crystal, or from the chip's own oscillator where the crystal is dead.
//!
//! Both ways give 168 MHz core, 84 MHz timers of APB1, and 48 MHz for the SD card. The internal oscillator errs by 1 % over
//! temperature (DS9405 rev 13, table 41): serial lines still work, times in the log are that much off, and the log says so.

use embassy_stm32::pac;
use embassy_stm32::rcc::{
    AHBPrescaler, APBPrescaler, Hse, HseMode, Pll, PllMul, PllPDiv, PllPreDiv, PllQDiv, PllSource, Sysclk,
};
use embassy_stm32::time::Hertz;

/// The crystal on the Pixracer.
const CRYSTAL: Hertz = Hertz(24_000_000);
/// Polls until a crystal counts as dead. It starts within 2 ms (DS9405 rev 13, table 39); at 16 MHz and some ten cycles a
/// poll this is 30 ms.
const CRYSTAL_POLLS: u32 = 50_000;

/// What the clocks are made from.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum ClockSource {
    /// The crystal.
    Crystal,
    /// The internal oscillator, because the crystal did not start.
    Internal,
}

/// Tries the crystal. Runs on the internal oscillator, before anything else is set up.
pub(crate) fn find_source() -> ClockSource {
    pac::RCC.cr().modify(|w| w.set_hseon(true));
    for _ in 0..CRYSTAL_POLLS {
        if pac::RCC.cr().read().hserdy() {
            return ClockSource::Crystal;
        }
    }
    pac::RCC.cr().modify(|w| w.set_hseon(false));
    ClockSource::Internal
}

/// The configuration for this source.
pub(crate) fn config(source: ClockSource) -> embassy_stm32::Config {
    let mut config = embassy_stm32::Config::default();
    let rcc = &mut config.rcc;
    let prediv = match source {
        ClockSource::Crystal => {
            rcc.hse = Some(Hse { freq: CRYSTAL, mode: HseMode::Oscillator });
            rcc.pll_src = PllSource::HSE;
            PllPreDiv::DIV24
        }
        ClockSource::Internal => {
            rcc.pll_src = PllSource::HSI;
            PllPreDiv::DIV16
        }
    };
    // 1 MHz times 336: 168 MHz for the core, 48 MHz for the card.
    rcc.pll =
        Some(Pll { prediv, mul: PllMul::MUL336, divp: Some(PllPDiv::DIV2), divq: Some(PllQDiv::DIV7), divr: None });
    rcc.sys = Sysclk::PLL1_P;
    rcc.ahb_pre = AHBPrescaler::DIV1;
    rcc.apb1_pre = APBPrescaler::DIV4;
    rcc.apb2_pre = APBPrescaler::DIV2;
    config
}
