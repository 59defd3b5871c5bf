//! Every pin that the image uses, once.
//!
//! | net | pin | peripheral | connector | direction |
//! |---|---|---|---|---|
//! | `SERVO` | PE14 | TIM1 channel 4 | servo rail, PWM 1 | out: pulse, speed of the shaft |
//! | `LIGHT` | PD13 | TIM4 channel 2 | servo rail, PWM 5 | out: duty, brightness |
//! | `SHUTTER` | PD14 | GPIO | servo rail, PWM 6 | out: high closes the opto-coupler on the camera's button |
//! | `CAM_BUSY` | PE11 | GPIO, pull-down | servo rail, PWM 3 | in: high while the camera is busy |
//! | `CAM_STORED` | PE9 | GPIO, pull-down | servo rail, PWM 4 | in: a pulse of at least 20 ms for each photo stored |
//! | `RANGE_SCL`, `RANGE_SDA` | PB8, PB9 | I2C1, DMA1 streams 7 and 0 | GPS | range sensors and AS5600 |
//! | `HERO_READY`, `HERO_INT`, `HERO_POWER` | PE13, PE1, PE0 | GPIO, open drain | PWM 2; `FrSky` | out: a HERO4's bus instead of I2C sensors |
//! | `HUB_TX`, `HUB_RX` | PA0, PA1 | UART4, DMA1 streams 4 and 2 | GPS | `TeraRanger` Hub instead of I2C sensors |
//! | `TELEM1_TX`, `TELEM1_RX` | PD5, PD6 | USART2, DMA1 streams 6 and 5 | TELEM1 | MAVLink to the autopilot |
//! | `TELEM2_TX`, `TELEM2_RX` | PD8, PD9 | USART3, DMA1 streams 3 and 1 | TELEM2 | MAVLink by cable, for service; in the `hil` build a simulator |
//! | `IMU_SCK`, `IMU_MISO`, `IMU_MOSI`, `IMU_CS` | PA5, PA6, PA7, PC15 | SPI1, DMA2 streams 5 and 0 | on board | ICM-20608 |
//! | `FRAM_SCK`, `FRAM_MISO`, `FRAM_MOSI`, `FRAM_CS` | PB10, PB14, PB15, PD10 | SPI2 | on board | FM25V02 |
//! | `SD_D0` to `SD_D3`, `SD_CK`, `SD_CMD` | PC8 to PC11, PC12, PD2 | SDIO, DMA2 stream 6 | slot | microSD |
//! | `SAFETY` | PC4 | GPIO, pull-down | GPS, safety switch | in: high forbids servo and shutter |
//! | `LED_RED`, `LED_GREEN`, `LED_BLUE` | PB11, PB1, PB3 | GPIO, open drain | on board | out: low is on |
//! | `SENSORS_EN`, `PERIPH_EN` | PE3, PC5 | GPIO | on board | out: high powers inertial units, and the connectors |
//! | `MPU_CS`, `MAG_CS`, `BARO_CS` | PC2, PE15, PD7 | GPIO | on board | out: high, so that these chips leave the buses alone |
//!
//! Sources: ArduPilot's `hwdef/Pixracer/hwdef.dat`; DS9405 rev 13, table 12 (alternate functions); RM0090 rev 21, tables 42
//! and 43 (DMA requests). TIM5 is the time driver's.

use embassy_stm32::gpio::{AnyPin, Input, Level, Output, OutputOpenDrain, OutputType, Pull, Speed};
use embassy_stm32::i2c;
use embassy_stm32::peripherals::{
    DMA1_CH0, DMA1_CH1, DMA1_CH2, DMA1_CH3, DMA1_CH4, DMA1_CH5, DMA1_CH6, DMA1_CH7, DMA2_CH0, DMA2_CH5, DMA2_CH6, I2C1,
    PA0, PA1, PB8, PB9, PC8, PC9, PC10, PC11, PC12, PD2, PD5, PD6, PD8, PD9, SDIO, TIM1, TIM4, UART4, USART2, USART3,
};
use embassy_stm32::time::{Hertz, hz, khz, mhz};
use embassy_stm32::timer::low_level::CountingMode;
use embassy_stm32::timer::simple_pwm::{PwmPin, SimplePwm};
use embassy_stm32::{Peri, Peripherals, bind_interrupts, dma, mode, peripherals, sdmmc, spi, usart};
use embassy_time::Delay;
use embedded_hal_bus::spi::ExclusiveDevice;

/// Pulses of the servo: digital servos take 100 a second, and the loop over the encoder gains from it.
pub(crate) const SERVO_HZ: u32 = 100;
/// Above what eye and rolling shutter see.
const LIGHT_HZ: Hertz = khz(1);
/// ICM-20608 data sheet rev 1.0: registers at up to 1 MHz, samples at up to 8 MHz.
const IMU_CLOCK: Hertz = mhz(1);
/// FM25V02 takes 40 MHz.
const FRAM_CLOCK: Hertz = mhz(10);

bind_interrupts!(pub(crate) struct Irqs {
    I2C1_EV => i2c::EventInterruptHandler<peripherals::I2C1>;
    I2C1_ER => i2c::ErrorInterruptHandler<peripherals::I2C1>;
    USART2 => usart::InterruptHandler<peripherals::USART2>;
    USART3 => usart::InterruptHandler<peripherals::USART3>;
    UART4 => usart::InterruptHandler<peripherals::UART4>;
    SDIO => sdmmc::InterruptHandler<peripherals::SDIO>;
    DMA1_STREAM0 => dma::InterruptHandler<peripherals::DMA1_CH0>;
    DMA1_STREAM1 => dma::InterruptHandler<peripherals::DMA1_CH1>;
    DMA1_STREAM2 => dma::InterruptHandler<peripherals::DMA1_CH2>;
    DMA1_STREAM3 => dma::InterruptHandler<peripherals::DMA1_CH3>;
    DMA1_STREAM4 => dma::InterruptHandler<peripherals::DMA1_CH4>;
    DMA1_STREAM5 => dma::InterruptHandler<peripherals::DMA1_CH5>;
    DMA1_STREAM6 => dma::InterruptHandler<peripherals::DMA1_CH6>;
    DMA1_STREAM7 => dma::InterruptHandler<peripherals::DMA1_CH7>;
    DMA2_STREAM0 => dma::InterruptHandler<peripherals::DMA2_CH0>;
    DMA2_STREAM5 => dma::InterruptHandler<peripherals::DMA2_CH5>;
    DMA2_STREAM6 => dma::InterruptHandler<peripherals::DMA2_CH6>;
});

/// The inertial unit behind its chip select.
pub(crate) type ImuSpi = ExclusiveDevice<spi::Spi<'static, mode::Async, spi::mode::Master>, Output<'static>, Delay>;
/// The parameter memory behind its chip select.
pub(crate) type FramSpi = ExclusiveDevice<spi::Spi<'static, mode::Blocking, spi::mode::Master>, Output<'static>, Delay>;

/// What the controller moves, lights and fires, and the switch that forbids it.
pub(crate) struct Rig {
    pub(crate) servo: SimplePwm<'static, TIM1>,
    pub(crate) light: SimplePwm<'static, TIM4>,
    pub(crate) shutter: Output<'static>,
    pub(crate) safety: Input<'static>,
}

/// What the camera says.
#[cfg(not(feature = "hil"))]
pub(crate) struct CameraPins {
    pub(crate) busy: Input<'static>,
    pub(crate) photo_stored: Input<'static>,
}

/// The parts of the sensors' bus, from which it is made anew when it is stuck.
pub(crate) struct RangeBusParts {
    pub(crate) i2c: Peri<'static, I2C1>,
    pub(crate) scl: Peri<'static, PB8>,
    pub(crate) sda: Peri<'static, PB9>,
    pub(crate) tx_dma: Peri<'static, DMA1_CH7>,
    pub(crate) rx_dma: Peri<'static, DMA1_CH0>,
}

/// Lines to a HERO4 beside its I2C.
pub(crate) struct HeroBusPins {
    pub(crate) backpack_ready: OutputOpenDrain<'static>,
    pub(crate) interrupt: OutputOpenDrain<'static>,
    pub(crate) power_button: OutputOpenDrain<'static>,
}

/// The parts of the Hub's line.
pub(crate) struct HubParts {
    pub(crate) uart: Peri<'static, UART4>,
    pub(crate) tx: Peri<'static, PA0>,
    pub(crate) rx: Peri<'static, PA1>,
    pub(crate) tx_dma: Peri<'static, DMA1_CH4>,
    pub(crate) rx_dma: Peri<'static, DMA1_CH2>,
}

/// The parts of the autopilot's line; its baud rate is a parameter.
pub(crate) struct LinkParts {
    pub(crate) uart: Peri<'static, USART2>,
    pub(crate) tx: Peri<'static, PD5>,
    pub(crate) rx: Peri<'static, PD6>,
    pub(crate) tx_dma: Peri<'static, DMA1_CH6>,
    pub(crate) rx_dma: Peri<'static, DMA1_CH5>,
}

/// The parts of the service line, or the simulator's.
pub(crate) struct ServiceParts {
    pub(crate) uart: Peri<'static, USART3>,
    pub(crate) tx: Peri<'static, PD8>,
    pub(crate) rx: Peri<'static, PD9>,
    pub(crate) tx_dma: Peri<'static, DMA1_CH3>,
    pub(crate) rx_dma: Peri<'static, DMA1_CH1>,
}

/// The parts of the card's slot, from which the driver is made anew when the card was changed.
pub(crate) struct CardParts {
    pub(crate) sdio: Peri<'static, SDIO>,
    pub(crate) dma: Peri<'static, DMA2_CH6>,
    pub(crate) clk: Peri<'static, PC12>,
    pub(crate) cmd: Peri<'static, PD2>,
    pub(crate) d0: Peri<'static, PC8>,
    pub(crate) d1: Peri<'static, PC9>,
    pub(crate) d2: Peri<'static, PC10>,
    pub(crate) d3: Peri<'static, PC11>,
}

/// The three lights on the board.
pub(crate) struct Leds {
    pub(crate) red: OutputOpenDrain<'static>,
    pub(crate) green: OutputOpenDrain<'static>,
    pub(crate) blue: OutputOpenDrain<'static>,
}

/// The board, taken apart.
pub(crate) struct Board {
    pub(crate) rig: Rig,
    #[cfg(not(feature = "hil"))]
    pub(crate) camera: CameraPins,
    pub(crate) range_bus: RangeBusParts,
    pub(crate) hub: HubParts,
    pub(crate) hero_bus: HeroBusPins,
    pub(crate) link: LinkParts,
    pub(crate) service: ServiceParts,
    pub(crate) card: CardParts,
    pub(crate) imu: ImuSpi,
    pub(crate) leds: Leds,
}

/// What is needed before the tasks.
pub(crate) struct Early {
    pub(crate) fram: FramSpi,
    pub(crate) watchdog: Peri<'static, peripherals::IWDG>,
}

impl Board {
    /// Sets every pin as the table says.
    pub(crate) fn new(p: Peripherals) -> (Early, Self) {
        let high = |pin: Peri<'static, AnyPin>| Output::new(pin, Level::High, Speed::Low);
        // Set once and held: a pin whose driver is dropped lets go.
        for line in [p.PE3.into(), p.PC5.into(), p.PC2.into(), p.PE15.into(), p.PD7.into()] {
            core::mem::forget(high(line));
        }
        let open_drain = |pin: Peri<'static, AnyPin>| OutputOpenDrain::new(pin, Level::High, Speed::Low);
        let early = Early { fram: fram(p.SPI2, p.PB10, p.PB15, p.PB14, p.PD10), watchdog: p.IWDG };
        let board = Self {
            rig: Rig {
                servo: SimplePwm::new(
                    p.TIM1,
                    None,
                    None,
                    None,
                    Some(PwmPin::new(p.PE14, OutputType::PushPull)),
                    hz(SERVO_HZ),
                    CountingMode::EdgeAlignedUp,
                ),
                light: SimplePwm::new(
                    p.TIM4,
                    None,
                    Some(PwmPin::new(p.PD13, OutputType::PushPull)),
                    None,
                    None,
                    LIGHT_HZ,
                    CountingMode::EdgeAlignedUp,
                ),
                shutter: Output::new(p.PD14, Level::Low, Speed::Low),
                safety: Input::new(p.PC4, Pull::Down),
            },
            #[cfg(not(feature = "hil"))]
            camera: CameraPins { busy: Input::new(p.PE11, Pull::Down), photo_stored: Input::new(p.PE9, Pull::Down) },
            range_bus: RangeBusParts { i2c: p.I2C1, scl: p.PB8, sda: p.PB9, tx_dma: p.DMA1_CH7, rx_dma: p.DMA1_CH0 },
            hub: HubParts { uart: p.UART4, tx: p.PA0, rx: p.PA1, tx_dma: p.DMA1_CH4, rx_dma: p.DMA1_CH2 },
            hero_bus: HeroBusPins {
                backpack_ready: open_drain(p.PE13.into()),
                interrupt: open_drain(p.PE1.into()),
                power_button: open_drain(p.PE0.into()),
            },
            link: LinkParts { uart: p.USART2, tx: p.PD5, rx: p.PD6, tx_dma: p.DMA1_CH6, rx_dma: p.DMA1_CH5 },
            service: ServiceParts { uart: p.USART3, tx: p.PD8, rx: p.PD9, tx_dma: p.DMA1_CH3, rx_dma: p.DMA1_CH1 },
            card: CardParts {
                sdio: p.SDIO,
                dma: p.DMA2_CH6,
                clk: p.PC12,
                cmd: p.PD2,
                d0: p.PC8,
                d1: p.PC9,
                d2: p.PC10,
                d3: p.PC11,
            },
            imu: imu(p.SPI1, p.PA5, p.PA7, p.PA6, p.DMA2_CH5, p.DMA2_CH0, p.PC15),
            leds: Leds {
                red: open_drain(p.PB11.into()),
                green: open_drain(p.PB1.into()),
                blue: open_drain(p.PB3.into()),
            },
        };
        (early, board)
    }
}

fn spi_config(clock: Hertz) -> spi::Config {
    let mut config = spi::Config::default();
    config.frequency = clock;
    config.mode = spi::MODE_3;
    config
}

fn imu(
    spi: Peri<'static, peripherals::SPI1>,
    sck: Peri<'static, peripherals::PA5>,
    mosi: Peri<'static, peripherals::PA7>,
    miso: Peri<'static, peripherals::PA6>,
    tx_dma: Peri<'static, DMA2_CH5>,
    rx_dma: Peri<'static, DMA2_CH0>,
    select: Peri<'static, peripherals::PC15>,
) -> ImuSpi {
    let bus = spi::Spi::new(spi, sck, mosi, miso, tx_dma, rx_dma, Irqs, spi_config(IMU_CLOCK));
    let select = Output::new(select, Level::High, Speed::Medium);
    ExclusiveDevice::new(bus, select, Delay).unwrap_or_else(|never| match never {})
}

fn fram(
    spi: Peri<'static, peripherals::SPI2>,
    sck: Peri<'static, peripherals::PB10>,
    mosi: Peri<'static, peripherals::PB15>,
    miso: Peri<'static, peripherals::PB14>,
    select: Peri<'static, peripherals::PD10>,
) -> FramSpi {
    let bus = spi::Spi::new_blocking(spi, sck, mosi, miso, spi_config(FRAM_CLOCK));
    let select = Output::new(select, Level::High, Speed::Medium);
    ExclusiveDevice::new(bus, select, Delay).unwrap_or_else(|never| match never {})
}
