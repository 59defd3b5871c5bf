//! The mode machine: which mode follows from what.
//!
//! | from | when | to |
//! |---|---|---|
//! | Boot | the table of the speed law is computed | Idle |
//! | Boot | the parameters allow no scan | Fault |
//! | Idle | Arm | `SelfTest` |
//! | `SelfTest` | passed | Ready |
//! | `SelfTest` | failed | Fault |
//! | `SelfTest` | Stop, Disarm | Idle |
//! | Ready | Start, nothing impaired | Scanning |
//! | Ready | Start, something impaired | Degraded |
//! | Ready | Disarm | Idle |
//! | Scanning | something impaired | Degraded |
//! | Degraded | nothing impaired | Scanning |
//! | Scanning, Degraded | trouble | Fault |
//! | Scanning, Degraded | Stop | Ready |
//! | Scanning, Degraded | Disarm | Idle |
//! | Fault | Disarm, the parameters allow a scan | Idle |
//!
//! All else stays as it is. A command that makes no sense in a mode is ignored. Impaired: position unknown, encoder fitted
//! but silent, no heartbeat of the autopilot, or a log that cannot be written. Trouble: the shaft is stalled or the camera dead.

use adit_protocol::record::{Failure, Mode};

use crate::io::Command;

/// How far a test has come.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Test {
    /// Not known yet.
    Running,
    /// Good.
    Passed,
    /// Not good.
    Failed(Failure),
}

/// All that the next mode depends on.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Circumstances {
    /// Do the parameters allow a scan?
    pub(crate) boot: Test,
    /// The self-test, as far as it runs.
    pub(crate) self_test: Test,
    /// Why a scan cannot go on.
    pub(crate) trouble: Option<Failure>,
    /// Whether something is missing that a scan can do without.
    pub(crate) impaired: bool,
    /// What the pilot wants.
    pub(crate) command: Option<Command>,
}

/// Whether photos are taken in this mode.
pub(crate) fn is_scan(mode: Mode) -> bool {
    matches!(mode, Mode::Scanning | Mode::Degraded)
}

/// Whether the servo is driven in this mode. Elsewhere a hand must be able to turn the shaft, and a fault must not grind on.
pub(crate) fn drives_shaft(mode: Mode) -> bool {
    matches!(mode, Mode::SelfTest | Mode::Ready | Mode::Scanning | Mode::Degraded)
}

/// Returns the next mode, and the failure that led to Fault.
pub(crate) fn next(mode: Mode, around: Circumstances) -> (Mode, Option<Failure>) {
    let scan = if around.impaired { Mode::Degraded } else { Mode::Scanning };
    let next = match (mode, around.command) {
        (Mode::Boot, _) => match around.boot {
            Test::Running => Mode::Boot,
            Test::Passed => Mode::Idle,
            Test::Failed(failure) => return (Mode::Fault, Some(failure)),
        },
        (Mode::Fault, Some(Command::Disarm)) if around.boot == Test::Passed => Mode::Idle,
        (Mode::Fault, _) => Mode::Fault,
        (Mode::Idle, Some(Command::Arm)) => Mode::SelfTest,
        (_, Some(Command::Disarm)) | (Mode::SelfTest, Some(Command::Stop)) | (Mode::Idle, _) => Mode::Idle,
        (Mode::SelfTest, _) => match around.self_test {
            Test::Running => Mode::SelfTest,
            Test::Passed => Mode::Ready,
            Test::Failed(failure) => return (Mode::Fault, Some(failure)),
        },
        (Mode::Ready, Some(Command::Start)) => scan,
        (Mode::Ready, _) | (Mode::Scanning | Mode::Degraded, Some(Command::Stop)) => Mode::Ready,
        (Mode::Scanning | Mode::Degraded, _) => match around.trouble {
            Some(failure) => return (Mode::Fault, Some(failure)),
            None => scan,
        },
    };
    (next, None)
}

#[cfg(test)]
mod tests {
    use super::*;

    const QUIET: Circumstances =
        Circumstances { boot: Test::Passed, self_test: Test::Running, trouble: None, impaired: false, command: None };

    #[test]
    fn every_row_of_the_table_holds() {
        let with = |command| Circumstances { command: Some(command), ..QUIET };
        let failed = Test::Failed(Failure::Shaft);
        let impaired = Circumstances { impaired: true, ..QUIET };
        let trouble = Circumstances { trouble: Some(Failure::Camera), ..QUIET };
        let rows = [
            (Mode::Boot, Circumstances { boot: Test::Running, ..QUIET }, Mode::Boot),
            (Mode::Boot, QUIET, Mode::Idle),
            (Mode::Boot, Circumstances { boot: failed, ..QUIET }, Mode::Fault),
            (Mode::Idle, QUIET, Mode::Idle),
            (Mode::Idle, with(Command::Arm), Mode::SelfTest),
            (Mode::Idle, with(Command::Start), Mode::Idle),
            (Mode::SelfTest, QUIET, Mode::SelfTest),
            (Mode::SelfTest, Circumstances { self_test: Test::Passed, ..QUIET }, Mode::Ready),
            (Mode::SelfTest, Circumstances { self_test: failed, ..QUIET }, Mode::Fault),
            (Mode::SelfTest, with(Command::Stop), Mode::Idle),
            (Mode::SelfTest, with(Command::Disarm), Mode::Idle),
            (Mode::Ready, with(Command::Start), Mode::Scanning),
            (Mode::Ready, Circumstances { impaired: true, ..with(Command::Start) }, Mode::Degraded),
            (Mode::Ready, with(Command::Disarm), Mode::Idle),
            (Mode::Ready, trouble, Mode::Ready),
            (Mode::Scanning, QUIET, Mode::Scanning),
            (Mode::Scanning, impaired, Mode::Degraded),
            (Mode::Degraded, QUIET, Mode::Scanning),
            (Mode::Scanning, trouble, Mode::Fault),
            (Mode::Degraded, trouble, Mode::Fault),
            (Mode::Scanning, with(Command::Stop), Mode::Ready),
            (Mode::Degraded, with(Command::Disarm), Mode::Idle),
            (Mode::Scanning, with(Command::Arm), Mode::Scanning),
            (Mode::Fault, QUIET, Mode::Fault),
            (Mode::Fault, with(Command::Disarm), Mode::Idle),
            (Mode::Fault, Circumstances { boot: failed, ..with(Command::Disarm) }, Mode::Fault),
        ];
        for (from, around, to) in rows {
            assert_eq!(next(from, around).0, to, "from {from:?} with {around:?}");
        }
    }
}
