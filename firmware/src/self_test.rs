//! The self-test: position known, shaft moves and comes to rest, encoder heard, camera not stuck, log written.

use adit_protocol::record::Failure;

use crate::modes::Test;
use crate::shaft::{Shaft, Turn};
use crate::time::has_passed;

/// Everything must be well within this: sensors start in one second, a turn takes another.
const TIME_S: f32 = 5.0;

/// What the self-test looks at.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Vitals {
    pub(crate) position_known: bool,
    pub(crate) camera_busy: bool,
    pub(crate) log_lost: bool,
}

/// The self-test.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct SelfTest {
    began_us: u64,
    shaft_is_good: bool,
}

impl SelfTest {
    /// Begins: the shaft turns by one step.
    pub(crate) fn begin(&mut self, now_us: u64, shaft: &mut Shaft) {
        *self = Self { began_us: now_us, shaft_is_good: false };
        shaft.begin_scan(now_us);
        shaft.turn_to(now_us, 1);
    }

    /// How far it has come.
    pub(crate) fn step(&mut self, now_us: u64, shaft: &mut Shaft, vitals: Vitals) -> Test {
        self.shaft_is_good |= shaft.turn(now_us) == Turn::Still;
        let lacking = if shaft.encoder_is_lost() {
            Some(Failure::Encoder)
        } else if !self.shaft_is_good {
            Some(Failure::Shaft)
        } else if vitals.camera_busy {
            Some(Failure::Camera)
        } else if !vitals.position_known {
            Some(Failure::Centring)
        } else if vitals.log_lost {
            Some(Failure::Log)
        } else {
            None
        };
        match lacking {
            None => Test::Passed,
            Some(failure) if has_passed(self.began_us, now_us, TIME_S) => Test::Failed(failure),
            Some(_) => Test::Running,
        }
    }
}
