//! The Pixracer as the rotator board: the microcontroller, what its pins are wired to, and where to read them.
//!
//! One file per chip; `pins` is the table of wires.

mod bootloader;
mod card;
mod encoder;
mod fram;
mod pins;
mod ranger;
mod serial;
mod volume;

use std::num::{NonZeroU32, NonZeroU64};

use adit_protocol::beams::{Beam, Beams};
use adit_protocol::parameters::{Parameters, RangeBus};
use nalgebra::Vector3;
use rigless::chip::icm20608::Icm20608;
use rigless::chip::mpu9250::Mpu9250;
use rigless::device::Level;
use rigless::edge::Pulse;
use rigless::machine::armv7m::{Core, Fpu, MpuRegions, Variant};
use rigless::machine::{Board, Target};
use rigless::mcu::{Mcu, Operate};
use rigless::snapshot::Store;
use rigless::soc::stm32f427::Stm32f427;
use rigless::soc::stm32f427::generated::{i2c3, sdio, usart6};
use rigless::soc::stm32f427::peripherals::gpio::Gpio;
use rigless::time::VirtualNanos;

pub(crate) use bootloader::{APPLICATION_START, FLASH_START, IMAGE as BOOTLOADER};
pub use card::BlockWrite;
pub(crate) use card::{CardDefects, SdCard};
pub(crate) use encoder::ShaftEncoder;
pub(crate) use fram::Fram;
pub use fram::{FRAM_BYTES, FramWrite};
use pins::Wire;
pub(crate) use ranger::Ranger;
pub use ranger::RangerMisuse;
pub(crate) use serial::SerialLine;
pub use volume::{BlockImage, VolumeError};

/// The crystal on the board (`ArduPilot` `hwdef/Pixracer/hwdef.dat`, `OSCILLATOR_HZ`).
const CRYSTAL_HZ: u64 = 24_000_000;
/// The board's rail.
const SUPPLY_MV: u32 = 3300;
/// Clock of the core as the firmware sets it, and one instruction per cycle: the emulator counts instructions.
const CLOCK_HZ: NonZeroU64 = NonZeroU64::new(168_000_000).expect("a running clock");
/// Three serial lines: TELEM1, TELEM2, Hub.
pub(crate) const LINES: usize = 3;
/// Standard gravity, m/s^2.
const GRAVITY_MPS2: f64 = 9.80665;

/// The chips that keep something while the board is without power.
#[derive(Clone, Debug)]
pub(crate) struct Chips {
    /// Parameters and what the board remembers.
    pub(crate) fram: Fram,
    /// The card in the slot.
    pub(crate) card: SdCard,
    /// The four range sensors on I2C, where they are fitted, and the one on the head.
    pub(crate) rangers: Vec<(Seat, Ranger)>,
    /// The shaft's encoder, where it is fitted.
    pub(crate) encoder: Option<ShaftEncoder>,
}

/// Where a range sensor sits.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Seat {
    /// Fixed to the body.
    Body(Beam),
    /// On the rotating head.
    Head,
}

impl Chips {
    /// The chips that these parameters fit, with the FRAM and the card given.
    pub(crate) fn fitted(parameters: &Parameters, fram: &[u8], card: BlockImage) -> Self {
        let ranges = &parameters.ranges;
        let mut rangers = Vec::new();
        if ranges.bus == RangeBus::I2c {
            let on_body = Beam::ALL.into_iter().filter(|beam| *ranges.fitted.get(*beam));
            rangers.extend(on_body.map(|beam| (Seat::Body(beam), *ranges.port.get(beam))));
            rangers.extend(ranges.head_fitted.then_some((Seat::Head, ranges.head_port)));
        }
        Self {
            fram: Fram::holding(fram),
            card: SdCard::new(card),
            rangers: rangers.into_iter().map(|(seat, port)| (seat, Ranger::new(ranges.family, port))).collect(),
            encoder: parameters.shaft.encoder.then(ShaftEncoder::default),
        }
    }
}

/// What the board's equipment senses during a step.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Sensed {
    /// Raw value of each range sensor on the body; `None`: unplugged.
    pub(crate) ranges_mm: Beams<Option<u16>>,
    /// The same on the head.
    pub(crate) head_mm: Option<u16>,
    /// The encoder's steps; `None`: silent.
    pub(crate) encoder_steps: Option<u16>,
    /// How the body moves.
    pub(crate) motion: Motion,
    /// Level of the camera's busy line.
    pub(crate) camera_busy: bool,
    /// Level of the camera's confirm line.
    pub(crate) camera_confirm: bool,
    /// Whether the safety switch is on.
    pub(crate) safety_switch: bool,
}

/// What inertial units feel, in the body frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Motion {
    /// Angular velocity.
    pub(crate) turning_rad_per_s: Vector3<f64>,
    /// Specific force: acceleration without gravity.
    pub(crate) force_mps2: Vector3<f64>,
}

impl Default for Motion {
    /// At rest: the ground pushes up, and body z points down.
    fn default() -> Self {
        Self { turning_rad_per_s: Vector3::zeros(), force_mps2: Vector3::new(0.0, 0.0, -GRAVITY_MPS2) }
    }
}

/// What the board's pins carry at the end of a step.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Pins {
    /// Width of the servo's pulse; `None` while no pulse is driven.
    pub servo_pulse_us: Option<f32>,
    /// Duty of the light's dimmer, 0 to 1.
    pub light_level: f32,
    /// Level of the shutter's opto-coupler.
    pub shutter: bool,
    /// Which of the red, green and blue lamp are on.
    pub lamps: [bool; 3],
}

/// What is wrong inside the microcontroller, set again at each access to it.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct Sabotage {
    /// I2C1 finds its bus busy, as when a chip holds SDA or SCL low.
    pub(crate) bus_held: bool,
    /// USART2 never finishes sending.
    pub(crate) telemetry_stuck: bool,
}

/// The board.
#[derive(Debug)]
pub(crate) struct Machine {
    pub(crate) mcu: Stm32f427,
    seats: Vec<Seat>,
    encoder_at: Option<usize>,
    sensor_bus_slot: usize,
    telemetry_slot: usize,
}

impl Machine {
    /// The board with these chips, as its supply comes on at `epoch_ns` of the flight.
    pub(crate) fn new(chips: Chips, epoch_ns: u64) -> Result<Self, rigless::soc::Error> {
        let mut mcu = Stm32f427::new()?;
        mcu.rcc.attach_crystals(CRYSTAL_HZ, 0);
        mcu.set_supply(SUPPLY_MV);
        for converter in &mut mcu.adc {
            converter.set_reference(SUPPLY_MV);
        }
        let Chips { mut fram, mut card, rangers, encoder } = chips;
        fram.power_up(epoch_ns);
        card.power_up(epoch_ns);
        mcu.spi[pins::FRAM_BUS].attach_selected(fram, pins::FRAM_SELECT);
        mcu.spi[pins::INERTIAL_BUS].attach_selected(Mpu9250::new(), pins::MPU9250_SELECT);
        mcu.spi[pins::INERTIAL_BUS].attach_selected(Icm20608::new(), pins::ICM20608_SELECT);
        mcu.sdio.attach(card);
        let mut seats = Vec::new();
        for (seat, mut ranger) in rangers {
            ranger.power_up();
            mcu.i2c[pins::SENSOR_BUS].attach(ranger);
            seats.push(seat);
        }
        let encoder_at = encoder.is_some().then_some(seats.len());
        if let Some(encoder) = encoder {
            mcu.i2c[pins::SENSOR_BUS].attach(encoder);
        }
        for port in pins::SERIAL_PORTS {
            mcu.usart[port].attach(SerialLine::default());
        }
        let (sensor_bus_slot, telemetry_slot) = (mcu.bus().slot("I2C1")?, mcu.bus().slot("USART2")?);
        Ok(Self { mcu, seats, encoder_at, sensor_bus_slot, telemetry_slot })
    }

    /// Puts what is sensed onto the chips and the input pins.
    pub(crate) fn sense(&mut self, sensed: &Sensed, at: VirtualNanos) {
        for (nth, seat) in self.seats.iter().enumerate() {
            let raw_mm = match seat {
                Seat::Body(beam) => *sensed.ranges_mm.get(*beam),
                Seat::Head => sensed.head_mm,
            };
            if let Some(ranger) = self.mcu.i2c[pins::SENSOR_BUS].chip_mut::<Ranger>(nth) {
                ranger.raw_mm = raw_mm;
            }
        }
        if let Some(nth) = self.encoder_at
            && let Some(encoder) = self.mcu.i2c[pins::SENSOR_BUS].chip_mut::<ShaftEncoder>(nth)
        {
            encoder.steps = sensed.encoder_steps;
        }
        self.move_body(&sensed.motion);
        self.drive(pins::CAMERA_BUSY, sensed.camera_busy, at);
        self.drive(pins::CAMERA_CONFIRM, sensed.camera_confirm, at);
        self.drive(pins::SAFETY_SWITCH, sensed.safety_switch, at);
        // The lamps hang on the rail: a pin that lets go is pulled up through them.
        for lamp in pins::LAMPS {
            self.drive(lamp, true, at);
        }
    }

    fn move_body(&mut self, motion: &Motion) {
        let rate = motion.turning_rad_per_s.map(|rate| (rate.to_degrees() * 1e3) as i32);
        let force = motion.force_mps2.map(|force| (force / GRAVITY_MPS2 * 1e6) as i32);
        let bus = &mut self.mcu.spi[pins::INERTIAL_BUS];
        if let Some(unit) = bus.chip_mut::<Mpu9250>(0) {
            unit.set_rate(rate.x, rate.y, rate.z);
            unit.set_acceleration(force.x, force.y, force.z);
        }
        if let Some(unit) = bus.chip_mut::<Icm20608>(1) {
            unit.set_rate(rate.x, rate.y, rate.z);
            unit.set_acceleration(force.x, force.y, force.z);
        }
    }

    fn drive(&mut self, wire: Wire, high: bool, at: VirtualNanos) {
        let level = if high { Level::High } else { Level::Low };
        self.mcu.drive_port(at, wire.port, |port, registers, context| {
            port.drive(wire.pin, Some(level), registers, context);
        });
    }

    /// Reads the output pins.
    pub(crate) fn pins(&mut self) -> Pins {
        let (timer, registers) = self.mcu.advanced_timer(pins::SERVO_TIMER);
        let servo = timer.pulse(pins::SERVO.channel, registers);
        let (timer, registers) = self.mcu.timer(pins::LIGHT_TIMER);
        let light = timer.pulse(pins::LIGHT.channel, registers);
        let servo = servo.filter(|pulse| pulse.width.0 > 0 && self.carries(&pins::SERVO));
        let light = light.filter(|pulse| pulse.period.0 > 0 && self.carries(&pins::LIGHT));
        Pins {
            servo_pulse_us: servo.map(|Pulse { width, .. }| width.0 as f32 / 1e3),
            light_level: light.map_or(0.0, |Pulse { width, period }| width.0 as f32 / period.0 as f32),
            shutter: self.is_high(pins::SHUTTER),
            lamps: pins::LAMPS.map(|lamp| !self.is_high(lamp) && self.is_output(lamp)),
        }
    }

    /// Whether the pin is given to the timer: the timer's model does not look.
    fn carries(&mut self, pulsed: &pins::Pulsed) -> bool {
        let (_, registers) = self.mcu.port(pulsed.wire.port);
        Gpio::function(pulsed.wire.pin, registers) == Some(pulsed.function)
    }

    fn is_high(&mut self, wire: Wire) -> bool {
        let (port, registers) = self.mcu.port(wire.port);
        port.level(wire.pin, registers) == Level::High
    }

    fn is_output(&mut self, wire: Wire) -> bool {
        use rigless::soc::stm32f427::generated::gpioa::Register;
        let (_, registers) = self.mcu.port(wire.port);
        (registers.get(Register::Moder) >> (2 * wire.pin.index())) & 0b11 == 0b01
    }

    /// The far end of a serial line.
    pub(crate) fn line(&mut self, nth: usize) -> Option<&mut SerialLine> {
        self.mcu.usart[*pins::SERIAL_PORTS.get(nth)?].chip_mut::<SerialLine>()
    }

    /// The FRAM.
    pub(crate) fn fram(&mut self) -> Option<&mut Fram> {
        self.mcu.spi[pins::FRAM_BUS].chip_mut::<Fram>(0)
    }

    /// The card.
    pub(crate) fn card(&mut self) -> Option<&mut SdCard> {
        self.mcu.sdio.card_mut::<SdCard>()
    }

    /// Pulls the card out of its slot, or puts it back.
    pub(crate) fn pull_card(&mut self, pulled: bool) {
        // It answers whether there is a card to silence, and there is.
        let _ = self.mcu.sdio.silence(pulled);
    }

    /// The card interface's data path as it was enabled, if it is to read and no word has come yet.
    pub(crate) fn card_path_waiting(&mut self) -> Option<u64> {
        let (_, registers) = self.mcu.cards();
        let reading = sdio::sta::RXACT.is_set(registers.get(sdio::Register::Sta));
        let untouched = registers.get(sdio::Register::Dcount) == registers.get(sdio::Register::Dlen);
        (reading && untouched).then(|| registers.get(sdio::Register::Dctrl))
    }

    /// Breaks registers, as [`Sabotage`] says.
    pub(crate) fn sabotage(&mut self, sabotage: Sabotage) {
        if sabotage.bus_held {
            let registers = self.mcu.bus_mut().slot_mut(self.sensor_bus_slot).registers_mut();
            let status = registers.get(i2c3::Register::Sr2);
            registers.set(i2c3::Register::Sr2, i2c3::sr2::BUSY.set(status, 1));
        }
        if sabotage.telemetry_stuck {
            let registers = self.mcu.bus_mut().slot_mut(self.telemetry_slot).registers_mut();
            let control = registers.get(usart6::Register::Cr3);
            registers.set(usart6::Register::Cr3, usart6::cr3::DMAT.set(control, 0));
            let control = registers.get(usart6::Register::Cr1);
            let control = usart6::cr1::TCIE.set(usart6::cr1::TXEIE.set(control, 0), 0);
            registers.set(usart6::Register::Cr1, control);
        }
    }

    /// The chips as they are now; `None` if one is missing, which none ever is.
    pub(crate) fn chips(&mut self) -> Option<Chips> {
        let mut rangers = Vec::new();
        for (nth, seat) in self.seats.iter().enumerate() {
            rangers.push((*seat, self.mcu.i2c[pins::SENSOR_BUS].chip_mut::<Ranger>(nth)?.clone()));
        }
        let encoder = match self.encoder_at {
            Some(nth) => Some(self.mcu.i2c[pins::SENSOR_BUS].chip_mut::<ShaftEncoder>(nth)?.clone()),
            None => None,
        };
        let (fram, card) = (self.fram()?.clone(), self.card()?.clone());
        Some(Chips { fram, card, rangers, encoder })
    }
}

impl Store for Machine {}

impl Board for Machine {
    fn name(&self) -> &'static str {
        "adit-pixracer"
    }

    fn target_names(&self) -> Vec<&'static str> {
        vec!["stm32f427"]
    }

    fn mcu(&mut self, target: usize) -> Option<&mut dyn Mcu> {
        (target == 0).then_some(&mut self.mcu)
    }

    fn targets(&mut self) -> Vec<Target<'_>> {
        let interrupt_lines = NonZeroU32::new(u32::from(Operate::cpu(&self.mcu).interrupt_lines));
        let core = Core {
            variant: Variant::M4,
            clock_hz: CLOCK_HZ,
            interrupt_lines: interrupt_lines.unwrap_or(NonZeroU32::MIN),
            // PM0214 rev 10, sections 4.3 and 4.5.
            priority_bits: 4,
            refclk_divider: NonZeroU32::new(8).unwrap_or(NonZeroU32::MIN),
            instructions_per_second: CLOCK_HZ,
            boot: "flash",
        };
        let windows = rigless::cpu::armv7m::windows(self.mcu.bus());
        let spec = core.spec_with_parts(&windows, Fpu::FpV4Sp, MpuRegions::Eight);
        vec![Target::new("stm32f427", &mut self.mcu, spec)]
    }
}
