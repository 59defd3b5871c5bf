//! The pilot: arms, starts, flies forward, stops at the end, and tries again after a fault, a few times.

use adit_firmware::io::Command;
use adit_protocol::record::Mode;

use crate::config::PilotConfig;
use crate::world::PilotAction;

/// A command that brought no change is repeated after this.
const REPEAT_S: f64 = 1.0;
/// After the scan the pilot hovers this long, so that the camera can store its last photo.
const LINGER_S: f64 = 3.0;
/// Attempts to arm per restart: a self-test may fail for a passing reason.
const ARM_ATTEMPTS: u32 = 5;

/// Why the pilot ended the flight.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Ending {
    /// The end of the tunnel was reached.
    Completed,
    /// The board went into Fault, or would not arm, once too often.
    GaveUp,
}

/// The pilot.
#[derive(Clone, Debug)]
pub(super) struct Pilot {
    config: PilotConfig,
    end_x_m: f64,
    last_command_s: f64,
    arm_attempts: u32,
    restarts: u32,
    fault_since_s: Option<f64>,
    at_end_since_s: Option<f64>,
}

impl Pilot {
    pub(super) fn new(config: &PilotConfig, end_x_m: f64) -> Self {
        Self {
            config: *config,
            end_x_m,
            last_command_s: 0.0,
            arm_attempts: 0,
            restarts: 0,
            fault_since_s: None,
            at_end_since_s: None,
        }
    }

    /// Decides what to do at `now_s`, seeing the board's mode and where the vehicle is; `Err` ends the flight.
    pub(super) fn decide(&mut self, now_s: f64, mode: Mode, x_m: f64) -> Result<PilotAction, Ending> {
        if x_m >= self.end_x_m && self.at_end_since_s.is_none() {
            self.at_end_since_s = Some(now_s);
        }
        if mode != Mode::Fault {
            self.fault_since_s = None;
        }
        let at_end = self.at_end_since_s.is_some();
        let command = match mode {
            Mode::Idle | Mode::Ready | Mode::Fault if at_end => {
                self.linger(now_s)?;
                None
            }
            Mode::Idle => self.arm(now_s)?,
            Mode::Ready => self.say(now_s, Command::Start),
            Mode::Scanning | Mode::Degraded if at_end => self.say(now_s, Command::Stop),
            Mode::Boot | Mode::SelfTest | Mode::Scanning | Mode::Degraded => None,
            Mode::Fault => self.wait_out(now_s)?,
        };
        let flying = matches!(mode, Mode::Scanning | Mode::Degraded) && !at_end;
        Ok(PilotAction { command, cruise_mps: if flying { self.config.cruise_mps } else { 0.0 } })
    }

    fn say(&mut self, now_s: f64, command: Command) -> Option<Command> {
        let due = now_s - self.last_command_s >= REPEAT_S;
        if due {
            self.last_command_s = now_s;
        }
        due.then_some(command)
    }

    fn arm(&mut self, now_s: f64) -> Result<Option<Command>, Ending> {
        let command = self.say(now_s, Command::Arm);
        if command.is_some() {
            self.arm_attempts += 1;
            if self.arm_attempts > ARM_ATTEMPTS * (self.restarts + 1) {
                return Err(Ending::GaveUp);
            }
        }
        Ok(command)
    }

    fn wait_out(&mut self, now_s: f64) -> Result<Option<Command>, Ending> {
        let since_s = *self.fault_since_s.get_or_insert(now_s);
        if now_s - since_s < self.config.restart_wait_s {
            return Ok(None);
        }
        let command = self.say(now_s, Command::Disarm);
        if command.is_some() {
            self.restarts += 1;
            if self.restarts > self.config.restarts {
                return Err(Ending::GaveUp);
            }
        }
        Ok(command)
    }

    fn linger(&self, now_s: f64) -> Result<(), Ending> {
        match self.at_end_since_s {
            Some(since_s) if now_s - since_s >= LINGER_S => Err(Ending::Completed),
            _ => Ok(()),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_pilot_arms_starts_flies_stops_and_ends() {
        let mut pilot = Pilot::new(&PilotConfig::default(), 10.0);
        let mut decide = |now_s, mode, x_m| pilot.decide(now_s, mode, x_m);
        assert_eq!(decide(0.0, Mode::Boot, 0.0).unwrap().command, None);
        assert_eq!(decide(1.0, Mode::Idle, 0.0).unwrap().command, Some(Command::Arm));
        assert_eq!(decide(2.0, Mode::Ready, 0.0).unwrap().command, Some(Command::Start));
        let flying = decide(3.0, Mode::Scanning, 1.0).unwrap();
        assert_eq!((flying.command, flying.cruise_mps), (None, PilotConfig::default().cruise_mps));
        let stopping = decide(50.0, Mode::Scanning, 10.0).unwrap();
        assert_eq!((stopping.command, stopping.cruise_mps), (Some(Command::Stop), 0.0));
        assert_eq!(decide(51.0, Mode::Ready, 10.1).unwrap().command, None);
        assert_eq!(decide(54.0, Mode::Ready, 10.1), Err(Ending::Completed));
    }

    #[test]
    fn the_pilot_gives_up_after_too_many_faults() {
        let config = PilotConfig { restarts: 2, restart_wait_s: 1.0, ..PilotConfig::default() };
        let mut pilot = Pilot::new(&config, 10.0);
        let (mut disarmed, mut gave_up) = (0, false);
        for step in 0..10_000 {
            match pilot.decide(f64::from(step) * 0.01, Mode::Fault, 1.0) {
                Ok(action) => disarmed += u32::from(action.command == Some(Command::Disarm)),
                Err(ending) => {
                    assert_eq!(ending, Ending::GaveUp);
                    gave_up = true;
                    break;
                }
            }
        }
        assert!(gave_up && disarmed == 2);
    }
}
