//! The board's own attitude, for tags when the autopilot's is missing.

use adit_firmware::attitude::AttitudeFilter;
use adit_firmware::drivers::imu::{Imu, ImuModel, PIXRACER_BODY_FROM_CHIP};
use adit_firmware::health::Task;
use embassy_time::{Delay, Duration, Instant, Ticker, Timer};

use crate::blackboard::{CHECK_INS, newest, now_us};
use crate::pins::ImuSpi;

/// Sampling period.
const PERIOD: Duration = Duration::from_millis(5);
/// A unit that does not answer is tried again after this.
const RETRY: Duration = Duration::from_millis(100);
/// Failed samples in a row after which the unit is set up anew.
const FAILURES_TO_RESET: u8 = 10;

/// Watches the unit for ever.
#[embassy_executor::task]
pub(crate) async fn watch(spi: ImuSpi) -> ! {
    let mut imu = Imu::new(spi, ImuModel::Icm20608, PIXRACER_BODY_FROM_CHIP);
    loop {
        CHECK_INS.report(Task::Imu, now_us());
        if imu.start(&mut Delay).await.is_ok() {
            follow(&mut imu).await;
        }
        newest(|newest| newest.attitude_rad = None);
        Timer::after(RETRY).await;
    }
}

/// Follows the unit until it falls silent.
async fn follow(imu: &mut Imu<ImuSpi>) {
    let mut filter = AttitudeFilter::default();
    let mut ticker = Ticker::every(PERIOD);
    let mut last = Instant::now();
    let mut failures: u8 = 0;
    while failures < FAILURES_TO_RESET {
        ticker.next().await;
        CHECK_INS.report(Task::Imu, now_us());
        match imu.read().await {
            Ok(sample) => {
                failures = 0;
                let now = Instant::now();
                let elapsed_s = (now - last).as_micros() as f32 * 1e-6;
                last = now;
                let attitude_rad = filter.update(elapsed_s, &sample);
                newest(|newest| newest.attitude_rad = attitude_rad);
            }
            Err(_) => failures += 1,
        }
    }
}
