//! The self-test: position known, shaft moves and comes to rest, encoder heard, camera not stuck, log written.
//!
//! The shaft goes home slowly, then by one step, for a shaft that was left at home need not move to get there.

use adit_protocol::record::Failure;

use crate::modes::Test;
use crate::shaft::{Shaft, Turn};
use crate::time::has_passed;

/// Everything must be well within this: sensors start in one second, homing and a turn take one each.
const TIME_S: f32 = 5.0;

/// What the self-test looks at.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Vitals {
    pub(crate) position_known: bool,
    pub(crate) camera_busy: bool,
    pub(crate) log_lost: bool,
}

/// How far the shaft has come.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
enum Stage {
    #[default]
    Homing,
    Stepping,
    Good,
}

/// The self-test.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct SelfTest {
    began_us: u64,
    stage: Stage,
}

impl SelfTest {
    /// Begins: the shaft goes home.
    pub(crate) fn begin(&mut self, now_us: u64, shaft: &mut Shaft) {
        *self = Self { began_us: now_us, stage: Stage::Homing };
        shaft.home(now_us);
    }

    /// Moves the shaft; one that was late is tried again, for a hand may have held it.
    fn turn(&mut self, now_us: u64, shaft: &mut Shaft) {
        match (self.stage, shaft.turn(now_us)) {
            (Stage::Good, _) | (_, Turn::Turning) => {}
            (Stage::Homing, Turn::Still) => {
                shaft.turn_to(now_us, 1);
                self.stage = Stage::Stepping;
            }
            (Stage::Stepping, Turn::Still) => self.stage = Stage::Good,
            (Stage::Homing | Stage::Stepping, Turn::Late) => {
                shaft.home(now_us);
                self.stage = Stage::Homing;
            }
        }
    }

    /// How far it has come.
    pub(crate) fn step(&mut self, now_us: u64, shaft: &mut Shaft, vitals: Vitals) -> Test {
        self.turn(now_us, shaft);
        let lacking = if shaft.encoder_is_lost() {
            Some(Failure::Encoder)
        } else if self.stage != Stage::Good {
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
