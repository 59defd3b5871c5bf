//! The one table of wires between the Pixracer's pins and the rotator's equipment.
//!
//! The flash image has the same list. Sources: `ArduPilot`'s board description `hwdef/Pixracer/hwdef.dat` for what the
//! connectors carry; what hangs on them is ours.
//!
//! | Signal | Pin | Direction | Meaning |
//! |---|---|---|---|
//! | servo | PE14, `TIM1_CH4` | out | pulse of 1000 to 2000 us, 50 to 200 Hz |
//! | light | PD13, `TIM4_CH2` | out | duty 0 to 1 is the brightness |
//! | shutter | PD14 | out | high: button pressed (opto-coupler) |
//! | camera busy | PE11 | in | high: busy; pulled down |
//! | camera confirm | PE9 | in | a pulse per stored photo; pulled down |
//! | safety switch | PC4 | in | high: no servo, no shutter; pulled down |
//! | lamp red, green, blue | PB11, PB1, PB3 | out | low: on |
//! | FRAM select | PD10 | out | low: selected (SPI2) |
//! | MPU9250, ICM20608 select | PC2, PC15 | out | low: selected (SPI1) |

use rigless::device::Level;
use rigless::soc::stm32f427::peripherals::gpio::Pin;
use rigless::soc::stm32f427::peripherals::spi::Select;
use rigless::soc::stm32f427::peripherals::tim::Channel;

/// A pin of a port; ports count from A = 0.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Wire {
    /// Which port.
    pub(crate) port: usize,
    /// Which of its sixteen pins.
    pub(crate) pin: Pin,
}

/// A timer's channel and the pin it comes out at.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Pulsed {
    /// Where it comes out.
    pub(crate) wire: Wire,
    /// The channel.
    pub(crate) channel: Channel,
    /// The alternate function that joins the two (datasheet DS9405 rev 13, table 12).
    pub(crate) function: u8,
}

const B: usize = 1;
const C: usize = 2;
const D: usize = 3;
const E: usize = 4;

const fn wire(port: usize, pin: u8) -> Wire {
    Wire { port, pin: Pin::new(pin).expect("a port has sixteen pins") }
}

const fn low(port: &'static str, pin: u8) -> Select {
    Select { port, pin: Pin::new(pin).expect("a port has sixteen pins"), active: Level::Low }
}

const fn channel(number: u8) -> Channel {
    Channel::new(number).expect("a timer has four channels")
}

/// Position of TIM1 among the advanced timers.
pub(crate) const SERVO_TIMER: usize = 0;
/// `TIM1_CH4`.
pub(crate) const SERVO: Pulsed = Pulsed { wire: wire(E, 14), channel: channel(4), function: 1 };
/// Position of TIM4 among the general-purpose timers TIM2 to TIM5.
pub(crate) const LIGHT_TIMER: usize = 2;
/// `TIM4_CH2`.
pub(crate) const LIGHT: Pulsed = Pulsed { wire: wire(D, 13), channel: channel(2), function: 2 };
/// The opto-coupler on the camera's shutter button.
pub(crate) const SHUTTER: Wire = wire(D, 14);
/// The camera's busy line.
pub(crate) const CAMERA_BUSY: Wire = wire(E, 11);
/// The camera's line that pulses once per stored photo.
pub(crate) const CAMERA_CONFIRM: Wire = wire(E, 9);
/// The safety switch.
pub(crate) const SAFETY_SWITCH: Wire = wire(C, 4);
/// Red, green, blue.
pub(crate) const LAMPS: [Wire; 3] = [wire(B, 11), wire(B, 1), wire(B, 3)];
/// Position of SPI2, which carries the FRAM.
pub(crate) const FRAM_BUS: usize = 1;
/// Its chip select.
pub(crate) const FRAM_SELECT: Select = low("GPIOD", 10);
/// Position of SPI1, which carries both inertial units.
pub(crate) const INERTIAL_BUS: usize = 0;
/// Chip select of the MPU9250, the first on the bus.
pub(crate) const MPU9250_SELECT: Select = low("GPIOC", 2);
/// Chip select of the ICM20608, the second on the bus.
pub(crate) const ICM20608_SELECT: Select = low("GPIOC", 15);
/// Position of I2C1, which carries range sensors and encoder.
pub(crate) const SENSOR_BUS: usize = 0;
/// Positions of USART2 (TELEM1), USART3 (TELEM2) and UART4 (Hub) among the serial ports.
pub(crate) const SERIAL_PORTS: [usize; 3] = [1, 2, 6];
