//! EXPERIMENTAL, tried on no camera: a HERO4 on its `HeroBus`, for rigs whose ranges come from a Hub, so that I2C1 is free to
//! be the camera's slave. What is said there: [`adit_firmware::drivers::herobus`].

use adit_firmware::drivers::herobus::{DEVICE_ADDRESS, EEPROM_ADDRESS, HeroBus, Lines};
use adit_firmware::health::Task;
use embassy_stm32::i2c::{AddrMask, Address, OA2, OwnAddresses, SlaveAddrConfig, SlaveCommand, SlaveCommandKind};
use embassy_time::{Duration, with_timeout};

use crate::blackboard::{CHECK_INS, newest, notify, now_us};
use crate::pins::{HeroBusPins, RangeBusParts};
use crate::tasks::sensors::bus;

/// The state machine is stepped this often.
const PERIOD: Duration = Duration::from_millis(1);
/// The longest frame.
const FRAME_BYTES: usize = 64;

/// Answers the camera for ever.
#[embassy_executor::task]
pub(crate) async fn answer(mut parts: RangeBusParts, mut pins: HeroBusPins) -> ! {
    let addresses = OwnAddresses::Both {
        oa1: Address::SevenBit(EEPROM_ADDRESS),
        oa2: OA2 { addr: DEVICE_ADDRESS, mask: AddrMask::NOMASK },
    };
    let config = SlaveAddrConfig { addr: addresses, general_call: false };
    let mut slave = bus(&mut parts).into_slave_multimaster(config);
    let mut camera = HeroBus::new();
    camera.attach();
    let mut shutter_was_held = false;
    loop {
        CHECK_INS.report(Task::Sensors, now_us());
        if let Ok(Ok(SlaveCommand { kind, address })) = with_timeout(PERIOD, slave.listen()).await {
            let address = address.addr() as u8;
            match kind {
                SlaveCommandKind::Write => {
                    let mut bytes = [0; FRAME_BYTES];
                    if let Ok(length) = slave.respond_to_write(&mut bytes).await {
                        camera.written(address, bytes.get(..length).unwrap_or_default());
                    }
                }
                SlaveCommandKind::Read => {
                    let answer = camera.read(now_us(), address);
                    // A camera that stops reading early has what it wants.
                    let _ = slave.respond_to_read(&answer).await;
                }
            }
        }
        let held = newest(|newest| newest.outputs.shutter);
        if held && !core::mem::replace(&mut shutter_was_held, held) && camera.shutter().is_err() {
            notify(format_args!("HeroBus: camera not connected"));
        }
        shutter_was_held = held;
        set(&mut pins, camera.step(now_us()));
        newest(|newest| newest.hero = Some(camera.camera_status()));
    }
}

/// Sets the lines, which are open drain and rest high.
fn set(pins: &mut HeroBusPins, lines: Lines) {
    let rows = [
        (&mut pins.backpack_ready, lines.backpack_ready_low),
        (&mut pins.interrupt, lines.interrupt_low),
        (&mut pins.power_button, lines.power_button_low),
    ];
    for (pin, low) in rows {
        if low { pin.set_low() } else { pin.set_high() }
    }
}
