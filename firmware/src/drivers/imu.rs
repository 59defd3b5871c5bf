//! The board's two inertial units, ICM-20608-G and MPU-9250, on SPI (mode 3, at most 1 MHz: the MPU-9250's limit for
//! its configuration registers).
//!
//! Both share the registers used here. They are set to +-500 degrees per second and +-4 g behind filters of about 41 Hz
//! and sample at 1 kHz; read them at 100 Hz or faster, whenever it suits: a reading is at most a millisecond old.
//!
//! A sample is in the body frame (x front, y right, z down). Its acceleration is the specific force, what an
//! accelerometer feels: on a level vehicle at rest it is `[0, 0, -9.81]`, the floor pushing upwards.
//!
//! Sources: ICM-20608-G register map RM-000030 rev 1.0 and datasheet DS-000081 rev 1.0; MPU-9250 register map
//! RM-MPU-9250A-00 rev 1.4 and product specification PS-MPU-9250A-01 rev 1.1.

use core::fmt::Debug;

use embedded_hal_async::delay::DelayNs;
use embedded_hal_async::spi::SpiDevice;
use nalgebra::{Matrix3, Vector3};

/// How the Pixracer carries its inertial units.
///
/// `ArduPilot` turns them by `ROTATION_ROLL_180_YAW_90` (`hwdef/Pixracer/hwdef.dat`), which swaps x with y and reverses
/// z, after its Invensense driver has done the same to every sample (`AP_InertialSensor_Invensense.cpp`). The two
/// cancel: the chips' own axes already are front, right and down.
pub const PIXRACER_BODY_FROM_CHIP: Matrix3<f32> = Matrix3::new(1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0);

/// Standard gravity (CGPM 1901).
pub(crate) const GRAVITY_MPS2: f32 = 9.80665;
/// Full scales for the settings below, at 32768 counts (DS 3.1 and 3.2; PS 3.1 and 3.2).
const RATE_FULL_SCALE_DPS: f32 = 500.0;
const ACCELERATION_FULL_SCALE_G: f32 = 4.0;
const COUNTS: f32 = 32768.0;

/// Registers, the same on both chips (RM 2; RM 3).
const SMPLRT_DIV: u8 = 0x19;
const CONFIG: u8 = 0x1A;
const GYRO_CONFIG: u8 = 0x1B;
const ACCEL_CONFIG: u8 = 0x1C;
const ACCEL_CONFIG_2: u8 = 0x1D;
const ACCEL_XOUT_H: u8 = 0x3B;
const USER_CTRL: u8 = 0x6A;
const PWR_MGMT_1: u8 = 0x6B;
const PWR_MGMT_2: u8 = 0x6C;
const WHO_AM_I: u8 = 0x75;
/// First bit of the first byte: read (DS 6.5; PS 7.5).
const READ: u8 = 0x80;
/// `PWR_MGMT_1`: everything back to its reset value.
const RESET: u8 = 0x80;
/// `PWR_MGMT_1`: awake, on the best clock there is.
const AWAKE: u8 = 0x01;
/// `USER_CTRL`: no I2C on these pins. The bit reads as zero on the MPU-9250.
const I2C_OFF: u8 = 0x10;
/// What is set once the chip is awake, and read back: while it sleeps, most registers ignore writes (RM 2).
const SETTINGS: [(u8, u8); 6] = [
    (PWR_MGMT_2, 0x00),     // all six axes on
    (SMPLRT_DIV, 0x00),     // 1 kHz
    (CONFIG, 0x03),         // DLPF_CFG: gyroscope 41 Hz
    (GYRO_CONFIG, 0x08),    // FS_SEL 1: 500 degrees per second
    (ACCEL_CONFIG, 0x08),   // ACCEL_FS_SEL 1: 4 g
    (ACCEL_CONFIG_2, 0x03), // A_DLPF_CFG: accelerometer 41 Hz (MPU-9250) or 45 Hz (ICM-20608)
];

/// From a reset until registers can be used, milliseconds (DS 3.1: 11 ms; PS 3.4: 100 ms).
const RESET_MS: u32 = 100;
/// From sleep until registers can be used, milliseconds (DS 3.3.3: 5 ms).
const WAKE_MS: u32 = 10;
/// From sleep until the gyroscope is right, milliseconds (DS 3.1, PS 3.1: 35 ms).
const GYRO_START_MS: u32 = 50;
const SAMPLE_BYTES: usize = 14;

/// Which chip it is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ImuModel {
    /// ICM-20608-G.
    Icm20608,
    /// MPU-9250; its magnetometer is not used, for there is too much iron in tunnels.
    Mpu9250,
}

impl ImuModel {
    /// The content of `WHO_AM_I` (RM 3.28; RM 3).
    pub fn identity(self) -> u8 {
        match self {
            Self::Icm20608 => 0xAF,
            Self::Mpu9250 => 0x71,
        }
    }

    /// Die temperature from its word (DS 3.3.3; PS 3.4.2).
    fn temperature_c(self, counts: f32) -> f32 {
        match self {
            Self::Icm20608 => counts / 326.8 + 25.0,
            Self::Mpu9250 => counts / 333.87 + 21.0,
        }
    }
}

/// One sample, in the body frame: front, right, down.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct ImuSample {
    /// Turning rate about each axis, right-handed: roll to the right, nose up and turn to the right are positive.
    pub rate_radps: [f32; 3],
    /// Specific force along each axis: acceleration less gravity.
    pub acceleration_mps2: [f32; 3],
    /// Temperature of the die, degrees Celsius.
    pub temperature_c: f32,
}

/// Why there is no sample.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum ImuError<E: Debug> {
    /// The bus failed.
    #[error("inertial unit: the bus failed: {0:?}")]
    Bus(E),
    /// Something else answers, or nothing (0x00 or 0xff).
    #[error("inertial unit: it says it is {found:#04x}; expected {expected:#04x}")]
    WrongChip {
        /// `WHO_AM_I` as it came.
        found: u8,
        /// What the chip would say.
        expected: u8,
    },
    /// A setting did not arrive, so the scale of the samples is not known.
    #[error("inertial unit: register {register:#04x} holds {found:#04x} instead of {expected:#04x}")]
    NotSet {
        /// The register's address.
        register: u8,
        /// What it holds.
        found: u8,
        /// What was written.
        expected: u8,
    },
    /// All bytes of a sample are the same 0x00 or 0xff: nobody drives the line.
    #[error("inertial unit: the whole sample reads {byte:#04x}")]
    Lifeless {
        /// The byte.
        byte: u8,
    },
}

/// An inertial unit.
#[derive(Debug)]
pub struct Imu<S> {
    spi: S,
    model: ImuModel,
    body_from_chip: Matrix3<f32>,
}

impl<S: SpiDevice> Imu<S> {
    /// The chip behind `spi`, mounted as `body_from_chip` says (a rotation).
    pub fn new(spi: S, model: ImuModel, body_from_chip: Matrix3<f32>) -> Self {
        Self { spi, model, body_from_chip }
    }

    /// Resets the chip, checks what it is, and sets it up; takes 160 ms. Also brings it back after it has been lost.
    ///
    /// # Errors
    /// [`ImuError`]; then no sample is to be trusted.
    pub async fn start(&mut self, delay: &mut impl DelayNs) -> Result<(), ImuError<S::Error>> {
        self.set(PWR_MGMT_1, RESET).await?;
        delay.delay_ms(RESET_MS).await;
        let (found, expected) = (self.get(WHO_AM_I).await?, self.model.identity());
        if found != expected {
            return Err(ImuError::WrongChip { found, expected });
        }
        self.set(PWR_MGMT_1, AWAKE).await?;
        delay.delay_ms(WAKE_MS).await;
        self.check(PWR_MGMT_1, AWAKE).await?;
        self.set(USER_CTRL, I2C_OFF).await?;
        for (register, value) in SETTINGS {
            self.set(register, value).await?;
            self.check(register, value).await?;
        }
        delay.delay_ms(GYRO_START_MS).await;
        Ok(())
    }

    /// Reads the latest sample.
    ///
    /// # Errors
    /// [`ImuError::Bus`] or [`ImuError::Lifeless`].
    pub async fn read(&mut self) -> Result<ImuSample, ImuError<S::Error>> {
        let mut frame = [0; 1 + SAMPLE_BYTES];
        frame[0] = READ | ACCEL_XOUT_H;
        self.spi.transfer_in_place(&mut frame).await.map_err(ImuError::Bus)?;
        let [_, bytes @ ..] = frame;
        let byte = bytes[0];
        if (byte == 0x00 || byte == 0xFF) && bytes.iter().all(|other| *other == byte) {
            return Err(ImuError::Lifeless { byte });
        }
        Ok(self.sample(bytes))
    }

    /// Three words of acceleration, one of temperature, three of rate; big endian (RM 3.19, 3.20; RM 4.22-4.24).
    fn sample(&self, bytes: [u8; SAMPLE_BYTES]) -> ImuSample {
        let mut words = [0.0; SAMPLE_BYTES / 2];
        for (word, pair) in words.iter_mut().zip(bytes.as_chunks::<2>().0) {
            *word = f32::from(i16::from_be_bytes(*pair));
        }
        let [ax, ay, az, temperature, gx, gy, gz] = words;
        let acceleration = self.body_from_chip * Vector3::new(ax, ay, az);
        let rate = self.body_from_chip * Vector3::new(gx, gy, gz);
        ImuSample {
            rate_radps: (rate * (RATE_FULL_SCALE_DPS.to_radians() / COUNTS)).into(),
            acceleration_mps2: (acceleration * (ACCELERATION_FULL_SCALE_G * GRAVITY_MPS2 / COUNTS)).into(),
            temperature_c: self.model.temperature_c(temperature),
        }
    }

    async fn set(&mut self, register: u8, value: u8) -> Result<(), ImuError<S::Error>> {
        self.spi.write(&[register, value]).await.map_err(ImuError::Bus)
    }

    async fn get(&mut self, register: u8) -> Result<u8, ImuError<S::Error>> {
        let mut frame = [READ | register, 0];
        self.spi.transfer_in_place(&mut frame).await.map_err(ImuError::Bus)?;
        let [_, value] = frame;
        Ok(value)
    }

    async fn check(&mut self, register: u8, expected: u8) -> Result<(), ImuError<S::Error>> {
        let found = self.get(register).await?;
        if found == expected { Ok(()) } else { Err(ImuError::NotSet { register, found, expected }) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::drivers::scripted::block_on;
    use embedded_hal_async::spi::{ErrorKind, ErrorType, Operation};

    /// A chip written from the register maps: asleep after a reset, deaf for most registers while asleep.
    struct Chip {
        registers: [u8; 128],
        identity: u8,
        /// A register that keeps its value whatever is written.
        stuck: Option<u8>,
        /// What the line reads instead of the chip's answer.
        line: Option<u8>,
        broken: bool,
        slept_ns: u64,
    }

    impl Chip {
        fn new(identity: u8) -> Self {
            let mut chip = Self { registers: [0; 128], identity, stuck: None, line: None, broken: false, slept_ns: 0 };
            chip.registers[0x19] = 0xEE;
            chip
        }

        fn set(&mut self, register: u8, value: u8) {
            let awake = self.registers[0x6B] & 0x40 == 0;
            if register == 0x6B && value & 0x80 != 0 {
                self.registers = [0; 128];
                self.registers[0x6B] = 0x40;
                self.registers[0x75] = self.identity;
            } else if (awake || register == 0x6B || register == 0x6C) && self.stuck != Some(register) {
                self.registers[usize::from(register)] = value;
            }
        }

        /// Puts a sample into the data registers: acceleration, temperature, rate.
        fn measure(&mut self, words: [i16; 7]) {
            for (place, byte) in words.iter().flat_map(|word| word.to_be_bytes()).enumerate() {
                self.registers[0x3B + place] = byte;
            }
        }
    }

    impl ErrorType for Chip {
        type Error = ErrorKind;
    }

    impl SpiDevice for Chip {
        async fn transaction(&mut self, operations: &mut [Operation<'_, u8>]) -> Result<(), ErrorKind> {
            if self.broken {
                return Err(ErrorKind::Overrun);
            }
            match operations {
                [Operation::Write([register, value])] => self.set(*register, *value),
                [Operation::TransferInPlace([first, answer @ ..])] if *first & 0x80 != 0 => {
                    let from = usize::from(*first & 0x7F);
                    answer.copy_from_slice(&self.registers[from..from + answer.len()]);
                    if let Some(byte) = self.line {
                        answer.fill(byte);
                    }
                }
                _ => panic!("not a register access: {operations:x?}"),
            }
            Ok(())
        }
    }

    struct Slept<'a>(&'a mut u64);

    impl DelayNs for Slept<'_> {
        async fn delay_ns(&mut self, duration_ns: u32) {
            *self.0 += u64::from(duration_ns);
        }
    }

    fn start(chip: Chip, model: ImuModel, mounting: Matrix3<f32>) -> (Imu<Chip>, Result<(), ImuError<ErrorKind>>) {
        let mut slept_ns = 0;
        let mut imu = Imu::new(chip, model, mounting);
        let outcome = block_on(imu.start(&mut Slept(&mut slept_ns)));
        imu.spi.slept_ns = slept_ns;
        (imu, outcome)
    }

    fn started() -> Imu<Chip> {
        let (imu, outcome) = start(Chip::new(0xAF), ImuModel::Icm20608, PIXRACER_BODY_FROM_CHIP);
        assert_eq!(outcome, Ok(()));
        imu
    }

    fn assert_near(found: [f32; 3], expected: [f32; 3]) {
        let near = found.iter().zip(expected).all(|(found, expected)| (found - expected).abs() < 1e-3);
        assert!(near, "found {found:?}, expected {expected:?}");
    }

    #[test]
    fn both_chips_start_awake_and_set_up() {
        for (model, identity) in [(ImuModel::Icm20608, 0xAF), (ImuModel::Mpu9250, 0x71)] {
            let (imu, outcome) = start(Chip::new(identity), model, PIXRACER_BODY_FROM_CHIP);
            assert_eq!(outcome, Ok(()));
            let expected =
                [(0x6B, 0x01), (0x6C, 0), (0x19, 0), (0x1A, 3), (0x1B, 0x08), (0x1C, 0x08), (0x1D, 3), (0x6A, 0x10)];
            for (register, value) in expected {
                assert_eq!(imu.spi.registers[register], value, "{model:?}: register {register:#04x}");
            }
            assert_eq!(imu.spi.slept_ns, 160_000_000);
        }
    }

    #[test]
    fn a_wrong_or_missing_chip_is_found_out() {
        for found in [0x71, 0x00, 0xFF] {
            let (_, outcome) = start(Chip::new(found), ImuModel::Icm20608, PIXRACER_BODY_FROM_CHIP);
            assert_eq!(outcome, Err(ImuError::WrongChip { found, expected: 0xAF }));
        }
        let broken = Chip { broken: true, ..Chip::new(0xAF) };
        let (_, outcome) = start(broken, ImuModel::Icm20608, PIXRACER_BODY_FROM_CHIP);
        assert_eq!(outcome, Err(ImuError::Bus(ErrorKind::Overrun)));
    }

    #[test]
    fn a_setting_that_does_not_arrive_is_an_error() {
        let chip = Chip { stuck: Some(0x1B), ..Chip::new(0xAF) };
        let (_, outcome) = start(chip, ImuModel::Icm20608, PIXRACER_BODY_FROM_CHIP);
        assert_eq!(outcome, Err(ImuError::NotSet { register: 0x1B, found: 0x00, expected: 0x08 }));
    }

    #[test]
    fn a_level_vehicle_at_rest_feels_the_floor_push_upwards() {
        let mut imu = started();
        imu.spi.measure([0, 0, -8192, 0, 0, 0, 0]);
        let sample = block_on(imu.read()).unwrap();
        assert_near(sample.acceleration_mps2, [0.0, 0.0, -9.80665]);
        assert_near(sample.rate_radps, [0.0; 3]);
        assert!((sample.temperature_c - 25.0).abs() < 1e-3);
    }

    #[test]
    fn every_axis_has_its_own_place_sign_and_scale() {
        let mut imu = started();
        // 1 g, 2 g, -1 g; 35 degrees; 100, -200 and 250 degrees per second.
        imu.spi.measure([8192, 16384, -8192, 3268, 6554, -13107, 16384]);
        let sample = block_on(imu.read()).unwrap();
        assert_near(sample.acceleration_mps2, [9.80665, 19.6133, -9.80665]);
        assert_near(sample.rate_radps, [100.0_f32, -200.0, 250.0].map(f32::to_radians));
        assert!((sample.temperature_c - 35.0).abs() < 1e-3);
    }

    #[test]
    fn the_scales_reach_to_their_ends() {
        let mut imu = started();
        imu.spi.measure([i16::MIN, i16::MAX, 0, 0, i16::MIN, i16::MAX, 0]);
        let sample = block_on(imu.read()).unwrap();
        assert_near(sample.acceleration_mps2, [-39.2266, 39.2254, 0.0]);
        assert_near(sample.rate_radps, [-8.72665, 8.72638, 0.0]);
    }

    #[test]
    fn the_mounting_turns_both_rate_and_acceleration() {
        // Turned by 90 degrees to the right: the chip's x points to the body's right, its y to the rear.
        let mounting = Matrix3::new(0.0, -1.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0);
        let (mut imu, outcome) = start(Chip::new(0x71), ImuModel::Mpu9250, mounting);
        assert_eq!(outcome, Ok(()));
        imu.spi.measure([8192, 0, -8192, 0, 0, 16384, 0]);
        let sample = block_on(imu.read()).unwrap();
        assert_near(sample.acceleration_mps2, [0.0, 9.80665, -9.80665]);
        assert_near(sample.rate_radps, [(-250.0_f32).to_radians(), 0.0, 0.0]);
        assert!((sample.temperature_c - 21.0).abs() < 1e-3);
    }

    #[test]
    fn a_dead_line_is_no_sample() {
        for byte in [0x00, 0xFF] {
            let mut imu = started();
            imu.spi.line = Some(byte);
            assert_eq!(block_on(imu.read()), Err(ImuError::Lifeless { byte }));
        }
        let mut imu = started();
        imu.spi.broken = true;
        assert_eq!(block_on(imu.read()), Err(ImuError::Bus(ErrorKind::Overrun)));
    }
}
