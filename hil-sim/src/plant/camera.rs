//! The action camera as seen from its shutter contact: latency, busy time, confirmation, missed and surplus shots.
//!
//! Model: a closing contact is taken if the camera is idle; the exposure follows after a latency with a spread
//! (a shifted log-normal: never earlier than its minimum, now and then much later), the camera stays busy while it
//! writes, then counts the photo. A missed shot is either a contact that was not felt (nothing at all happens) or a photo that was
//! not written (busy, but neither counted nor filed). A double shot writes a second file that nobody asked for.
//! Sources: facts on the HERO4 know no measured latency of single shots; both latency and spread are configuration.

use crate::config::ShutterConfig;
use crate::seed::{Random, Stream};

/// Share of the missed shots at which the camera still looks busy.
const MISSED_BUT_BUSY_SHARE: f64 = 0.2;
/// From the contact to the busy line.
const BUSY_DELAY_S: f64 = 0.02;

/// One photo that the camera took.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Shot {
    /// Middle of the exposure, in seconds of the world.
    pub time_s: f64,
    /// Which closing of the contact it answers, counted from 1.
    pub press: u32,
    /// Whether nobody asked for it.
    pub surplus: bool,
}

/// What the camera tells over its wires.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Answer {
    /// The busy line: high while the camera takes or writes a photo.
    pub busy: bool,
    /// Photos stored since the camera was switched on.
    pub photos_stored: u32,
}

/// The camera's shutter and what hangs on it.
#[derive(Clone, Debug)]
pub struct Shutter {
    config: ShutterConfig,
    contact_was_closed: bool,
    presses: u32,
    busy_from_s: f64,
    busy_until_s: f64,
    due: Vec<Shot>,
    /// When photos that were taken will have been stored.
    storing: Vec<f64>,
    photos_stored: u32,
    random: Random,
}

impl Shutter {
    /// An idle camera.
    pub fn new(config: &ShutterConfig, seed: u64) -> Self {
        Self {
            config: *config,
            contact_was_closed: false,
            presses: 0,
            busy_from_s: f64::INFINITY,
            busy_until_s: f64::NEG_INFINITY,
            due: Vec::new(),
            storing: Vec::new(),
            photos_stored: 0,
            random: Random::new(seed, Stream::Camera),
        }
    }

    /// Feels the shutter contact at `now_s`. `deaf` is a camera that feels nothing (switched off, cable out).
    pub fn feel(&mut self, now_s: f64, contact_closed: bool, deaf: bool) {
        let pressed = contact_closed && !self.contact_was_closed;
        self.contact_was_closed = contact_closed;
        if !pressed {
            return;
        }
        self.presses += 1;
        let press = self.presses;
        // All draws of a press are made whatever happens, so that one shot's fate does not shift the next one's.
        let spread_s = self.config.latency_spread_s * self.random.gauss(0.5).exp();
        let missed = self.random.chance(self.config.missed_share);
        let missed_but_busy = self.random.chance(MISSED_BUT_BUSY_SHARE);
        let double = self.random.chance(self.config.double_share);
        let write_s = self.config.busy_s * self.random.uniform(0.9, 1.1);
        if deaf || now_s < self.busy_until_s || (missed && !missed_but_busy) {
            return;
        }
        let exposure_s = now_s + self.config.latency_s + spread_s;
        self.busy_from_s = now_s + BUSY_DELAY_S;
        self.busy_until_s = exposure_s + write_s;
        if missed {
            return;
        }
        self.due.push(Shot { time_s: exposure_s, press, surplus: false });
        self.storing.push(self.busy_until_s);
        if double {
            let again_s = exposure_s + self.config.double_gap_s;
            self.due.push(Shot { time_s: again_s, press, surplus: true });
            self.busy_until_s = again_s + write_s;
            self.storing.push(self.busy_until_s);
        }
    }

    /// What the wires show at `now_s`; time must not run backwards.
    pub fn answer(&mut self, now_s: f64) -> Answer {
        let before = self.storing.len();
        self.storing.retain(|&stored_s| stored_s > now_s);
        self.photos_stored += (before - self.storing.len()) as u32;
        let busy = now_s >= self.busy_from_s && now_s < self.busy_until_s;
        Answer { busy, photos_stored: self.photos_stored }
    }

    /// Takes the shots whose exposure falls before `until_s`, in order of time.
    pub fn take(&mut self, until_s: f64) -> Vec<Shot> {
        let (mut taken, left): (Vec<Shot>, Vec<Shot>) = self.due.iter().partition(|shot| shot.time_s < until_s);
        self.due = left;
        taken.sort_by(|a, b| a.time_s.total_cmp(&b.time_s));
        taken
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn press(config: &ShutterConfig, presses: usize) -> (Vec<Shot>, u32) {
        let mut shutter = Shutter::new(config, 4);
        let (mut shots, mut stored) = (Vec::new(), 0);
        for step in 0..presses * 400 {
            let now_s = step as f64 * 0.005;
            shutter.feel(now_s, step % 400 < 20, false);
            shots.extend(shutter.take(now_s + 0.005));
            stored = shutter.answer(now_s).photos_stored;
        }
        (shots, stored)
    }

    #[test]
    fn a_good_camera_takes_and_stores_one_photo_for_each_press() {
        let config = ShutterConfig { missed_share: 0.0, double_share: 0.0, ..ShutterConfig::default() };
        let (shots, stored) = press(&config, 50);
        assert_eq!((shots.len(), stored), (50, 50));
        for (index, shot) in shots.iter().enumerate() {
            let latency_s = shot.time_s - index as f64 * 2.0;
            assert!(latency_s >= config.latency_s && latency_s < config.latency_s + 10.0 * config.latency_spread_s);
        }
    }

    #[test]
    fn missed_and_double_shots_come_in_their_share() {
        let config = ShutterConfig { missed_share: 0.2, double_share: 0.1, ..ShutterConfig::default() };
        let (shots, stored) = press(&config, 2000);
        let surplus = shots.iter().filter(|shot| shot.surplus).count();
        assert_eq!(shots.len(), stored as usize);
        assert!((1500..1700).contains(&(shots.len() - surplus)), "{} of 2000", shots.len() - surplus);
        assert!((120..200).contains(&surplus), "{surplus}");
    }

    #[test]
    fn a_busy_camera_does_not_feel_the_contact() {
        let config = ShutterConfig { missed_share: 0.0, double_share: 0.0, ..ShutterConfig::default() };
        let mut shutter = Shutter::new(&config, 4);
        shutter.feel(0.0, true, false);
        shutter.feel(0.05, false, false);
        assert!(shutter.answer(0.1).busy);
        shutter.feel(0.1, true, false);
        assert_eq!(shutter.take(100.0).len(), 1);
    }
}
