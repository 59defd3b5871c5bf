//! Range sensors and the shaft's encoder.
//!
//! On I2C every 5 ms the encoder; of every four such rounds the first triggers all range sensors and the next reads them, so
//! that each measures 50 times a second and has 5 ms for the half millisecond that it needs. On a Hub the frames come by
//! themselves; the encoder stays on I2C.
//!
//! A device that does not answer is left out of the round and its readings grow old; the controller judges that. A bus on
//! which an exchange does not end is sick: it is freed by clocking it by hand (NXP UM10204 rev 7, 3.1.16) and made anew.

use adit_firmware::drivers::as5600::As5600;
use adit_firmware::drivers::hub::{HubKind, HubParser};
use adit_firmware::drivers::teraranger::TeraRanger;
use adit_firmware::health::Task;
use adit_firmware::io::{RangeReading, RangeSample};
use adit_firmware::link::Readdressing;
use adit_protocol::beams::{Beam, Beams};
use adit_protocol::parameters::{RangeBus, RangeFamily, RangeParameters};
use embassy_stm32::gpio::{Level, OutputOpenDrain, Speed};
use embassy_stm32::i2c::{self, I2c, Master};
use embassy_stm32::mode::Async;
use embassy_stm32::pac;
use embassy_stm32::time::khz;
use embassy_stm32::usart::{self, Uart};
use embassy_time::{Duration, Instant, Timer, with_timeout};
use static_cell::ConstStaticCell;

use crate::blackboard::{CHECK_INS, newest, notify, now_us};
use crate::pins::{HubParts, Irqs, RangeBusParts};

/// The encoder's period.
const ROUND: Duration = Duration::from_millis(5);
/// Between two rounds at least: a sensor's half millisecond, and as much again.
const LEAST_PAUSE: Duration = Duration::from_millis(1);
/// The longest exchange takes 0.2 ms at 400 kHz; a slave that stretches the clock this long holds the bus.
const EXCHANGE: Duration = Duration::from_millis(2);
/// Exchanges in a row that did not end, after which the bus is made anew.
const UNENDED_TO_RESET: u8 = 2;
/// Polls until a stop is over: it takes a byte's 23 us at most, and a poll some ten cycles.
const STOP_POLLS: u32 = 1000;
/// Half a period of the clock with which a stuck bus is freed: 100 kHz.
const HALF_CLOCK: Duration = Duration::from_micros(5);

/// The sensors' bus.
pub(crate) type Bus<'d> = I2c<'d, Async, Master>;

/// The five range sensors, the head's last.
struct Rangers {
    body: Beams<Option<TeraRanger>>,
    head: Option<TeraRanger>,
    parameters: RangeParameters,
}

/// Measures on I2C for ever: encoder and, unless they are on a Hub, range sensors.
#[embassy_executor::task]
pub(crate) async fn measure(mut parts: RangeBusParts, parameters: RangeParameters) -> ! {
    let rangers = Rangers::new(&parameters, parameters.bus == RangeBus::I2c);
    loop {
        // A bus that stays stuck is no reason to restart the board: the controller knows that the readings grow old.
        CHECK_INS.report(Task::Sensors, now_us());
        free(&mut parts).await;
        rounds(&mut bus(&mut parts), &rangers).await;
        defmt::warn!("sensor bus is stuck: made anew");
    }
}

impl Rangers {
    fn new(parameters: &RangeParameters, on_i2c: bool) -> Self {
        let sensor = |fitted: bool, port: u8| (on_i2c && fitted).then_some(TeraRanger { address: port });
        Self {
            body: Beams::from_fn(|beam| sensor(*parameters.fitted.get(beam), *parameters.port.get(beam))),
            head: sensor(parameters.head_fitted, parameters.head_port),
            parameters: *parameters,
        }
    }

    fn all(&self) -> impl Iterator<Item = (Option<Beam>, &TeraRanger)> {
        let body = Beam::ALL.into_iter().filter_map(|beam| self.body.get(beam).as_ref().map(|it| (Some(beam), it)));
        body.chain(self.head.as_ref().map(|it| (None, it)))
    }
}

/// The bus, anew.
pub(crate) fn bus(parts: &mut RangeBusParts) -> Bus<'_> {
    let mut config = i2c::Config::default();
    config.frequency = khz(400);
    I2c::new(
        parts.i2c.reborrow(),
        parts.scl.reborrow(),
        parts.sda.reborrow(),
        parts.tx_dma.reborrow(),
        parts.rx_dma.reborrow(),
        Irqs,
        config,
    )
}

/// Clocks whatever a slave still wants to say out of it, and ends with a stop.
async fn free(parts: &mut RangeBusParts) {
    let mut scl = OutputOpenDrain::new(parts.scl.reborrow(), Level::High, Speed::Low);
    let mut sda = OutputOpenDrain::new(parts.sda.reborrow(), Level::High, Speed::Low);
    for _ in 0..9 {
        if sda.is_high() {
            break;
        }
        scl.set_low();
        Timer::after(HALF_CLOCK).await;
        scl.set_high();
        Timer::after(HALF_CLOCK).await;
    }
    sda.set_low();
    Timer::after(HALF_CLOCK).await;
    sda.set_high();
    Timer::after(HALF_CLOCK).await;
}

/// Rounds until the bus is sick.
async fn rounds(bus: &mut Bus<'_>, rangers: &Rangers) {
    let mut next = Instant::now();
    let mut unended: u8 = 0;
    for round in 0_u32.. {
        let mut exchanges = Exchanges { bus, unended: &mut unended };
        exchanges.read_encoder().await;
        match round % 4 {
            0 => exchanges.trigger(rangers).await,
            1 => exchanges.read(rangers).await,
            _ => {}
        }
        if let Some(readdressing) = newest(|newest| newest.readdressing.take()) {
            exchanges.readdress(readdressing).await;
        }
        if unended >= UNENDED_TO_RESET {
            return;
        }
        CHECK_INS.report(Task::Sensors, now_us());
        // A round that was late must not bring the next one close: sensors need their time between trigger and reading.
        next = (next + ROUND).max(Instant::now() + LEAST_PAUSE);
        Timer::at(next).await;
    }
}

/// Exchanges on the bus, each within its time.
struct Exchanges<'a, 'd> {
    bus: &'a mut Bus<'d>,
    unended: &'a mut u8,
}

impl<'d> Exchanges<'_, 'd> {
    /// `None` if the device did not answer, or answered nonsense, or the exchange did not end.
    async fn within<T, E>(&mut self, exchange: impl AsyncFnOnce(&mut Bus<'d>) -> Result<T, E>) -> Option<T> {
        make_ready();
        let ended = with_timeout(EXCHANGE, exchange(self.bus)).await;
        *self.unended = if ended.is_ok() { 0 } else { self.unended.saturating_add(1) };
        ended.ok()?.ok()
    }

    async fn read_encoder(&mut self) {
        let angle = self.within(async |bus| As5600.read(bus).await).await;
        newest(|newest| newest.encoder_rad = angle.map(|angle| angle.angle_rad));
    }

    async fn readdress(&mut self, Readdressing { from, to }: Readdressing) {
        let sensor = TeraRanger { address: from };
        let done = self.within(async |bus| sensor.readdress(bus, to).await).await.is_some();
        let word = if done { "is now" } else { "does not answer to become" };
        notify(format_args!("range sensor {from:#04x} {word} {to:#04x}"));
    }

    async fn trigger(&mut self, rangers: &Rangers) {
        for (_, sensor) in rangers.all() {
            self.within(async |bus| sensor.trigger(bus).await).await;
        }
    }

    async fn read(&mut self, rangers: &Rangers) {
        for (beam, sensor) in rangers.all() {
            if let Some(raw_mm) = self.within(async |bus| sensor.read_raw_mm(bus).await).await {
                note(beam, RangeReading::from_raw(rangers.parameters.family, raw_mm));
            }
        }
    }
}

/// Makes the peripheral ready for the next exchange.
fn make_ready() {
    // While a stop is on its way nobody may write the register that asks for the next start (RM0090 rev 21, 27.6.1), which
    // the driver does not wait for.
    for _ in 0..STOP_POLLS {
        if !pac::I2C1.cr1().read().stop() {
            break;
        }
    }
    // A byte that was clocked in beyond the last read must not begin the next one.
    if pac::I2C1.sr1().read().rxne() {
        let _ = pac::I2C1.dr().read();
    }
}

/// Notes a sample; `None` is the head's.
fn note(beam: Option<Beam>, reading: RangeReading) {
    newest(|newest| {
        let sample = match beam {
            Some(beam) => newest.ranges.get_mut(beam),
            None => &mut newest.head,
        };
        *sample = RangeSample { reading, count: sample.count.wrapping_add(1) };
    });
}

/// A Hub of One sensors (maker's driver `teraranger_one`), and a Hub of Evo sensors through its UART board.
const HUB_ONE_BAUD: u32 = 115_200;
const HUB_EVO_BAUD: u32 = 921_600;
/// Room for what a Hub says in 10 ms at 921,600 baud.
static HUB_RING: ConstStaticCell<[u8; 1024]> = ConstStaticCell::new([0; 1024]);

/// Takes the frames of a Hub for ever.
#[embassy_executor::task]
pub(crate) async fn listen(parts: HubParts, parameters: RangeParameters) -> ! {
    let mut config = usart::Config::default();
    let (kind, baud) = match parameters.family {
        RangeFamily::OneHub | RangeFamily::One => (HubKind::One, HUB_ONE_BAUD),
        RangeFamily::Evo => (HubKind::Evo, HUB_EVO_BAUD),
    };
    config.baudrate = baud;
    let uart = Uart::new(parts.uart, parts.rx, parts.tx, parts.tx_dma, parts.rx_dma, Irqs, config);
    let (mut tx, rx) = uart.expect("both rates are possible with these clocks").split();
    let mut rx = rx.into_ring_buffered(HUB_RING.take());
    for command in kind.start_up() {
        let _ = tx.write(command).await;
        Timer::after(Duration::from_millis(100)).await;
    }
    let mut parser = HubParser::new(kind);
    let mut bytes = [0; 64];
    loop {
        // An overrun loses bytes; the parser finds the next frame by itself.
        let count = rx.read(&mut bytes).await.unwrap_or(0);
        for frame in bytes.iter().take(count).filter_map(|byte| parser.push(*byte)) {
            let at = |port: u8| frame.ranges_mm.get(usize::from(port)).copied();
            for beam in Beam::ALL.into_iter().filter(|beam| *parameters.fitted.get(*beam)) {
                if let Some(raw_mm) = at(*parameters.port.get(beam)) {
                    note(Some(beam), RangeReading::from_raw(parameters.family, raw_mm));
                }
            }
            if let Some(raw_mm) = at(parameters.head_port).filter(|_| parameters.head_fitted) {
                note(None, RangeReading::from_raw(parameters.family, raw_mm));
            }
        }
    }
}
