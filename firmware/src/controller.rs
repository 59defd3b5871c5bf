//! The controller: the board's logic behind one function.
//!
//! A step runs in this order: sensors, shaft and position; what changed is noted; the mode; the photos; the limit; the
//! outputs. Time never runs backwards: an earlier `now` counts as the latest one seen.

use adit_geometry::profile::Profile;
use adit_protocol::beams::Beam;
use adit_protocol::parameters::{CaptureWiring, Parameters};
use adit_protocol::record::{CentringSample, Entry, EventKind, Failure, Mode, SpeedSample};
use adit_protocol::tag::TagFlags;

use crate::capture::{Sequencer, Surroundings};
use crate::io::{Display, Inputs, Outputs};
use crate::journal::StepJournal;
use crate::limit::{Limit, SpeedLimiter};
use crate::modes::{self, Circumstances, Test};
use crate::moment::Moment;
use crate::position::Position;
use crate::ranges::RangeChange;
use crate::self_test::{SelfTest, Vitals};
use crate::shaft::Shaft;
use crate::table::StepTable;
use crate::time::has_passed;

/// The measured speed must exceed the limit by this share and by [`OVERSPEED_MPS`] to be called too fast.
const OVERSPEED_SHARE: f32 = 0.05;
/// Noise of a speed estimate.
const OVERSPEED_MPS: f32 = 0.02;
/// It must do so for this long, and be within the limit again for this long: a gust's push is over by then.
const OVERSPEED_DWELL_S: f32 = 0.5;

/// The rotator board's logic.
#[derive(Clone, Debug)]
pub struct Controller {
    parameters: Parameters,
    profile: Option<Profile<f32>>,
    table: StepTable,
    mode: Mode,
    now_us: u64,
    position: Position,
    shaft: Shaft,
    sequencer: Sequencer,
    limiter: SpeedLimiter,
    self_test: SelfTest,
    journal: StepJournal,
    watched: Watched,
    limit: Option<Limit>,
    sampled_us: Option<u64>,
    /// Since when the speed has been on the other side of the limit.
    differs_since_us: Option<u64>,
}

/// States whose changes are events. `None` before the first step.
#[derive(Clone, Copy, Debug, Default)]
struct Watched {
    position: Option<bool>,
    encoder: Option<bool>,
    autopilot: Option<bool>,
    log: Option<bool>,
    overspeed: Option<bool>,
}

/// Inputs that are numbers, or absent.
#[derive(Clone, Copy, Debug)]
struct Navigation {
    attitude_rad: Option<[f32; 3]>,
    odometer_m: Option<f32>,
    speed_mps: Option<f32>,
}

impl Controller {
    /// A controller in mode Boot that computes its own table, one node per step.
    pub fn new(parameters: Parameters) -> Self {
        let table = StepTable::new(&parameters);
        Self::with_table(parameters, table)
    }

    /// A controller that is given the table of these very parameters, to save the time of computing it.
    pub fn with_table(parameters: Parameters, table: StepTable) -> Self {
        let images_per_turn = parameters.rig.images_per_turn;
        Self {
            profile: parameters.profile.build().ok(),
            table,
            mode: Mode::Boot,
            now_us: 0,
            position: Position::new(parameters.ranges),
            shaft: Shaft::new(parameters.shaft, images_per_turn),
            sequencer: Sequencer::new(parameters.shutter, parameters.shaft.late_turns_to_fault, 0),
            limiter: SpeedLimiter::new(parameters.speed, images_per_turn),
            self_test: SelfTest::default(),
            journal: StepJournal::new(),
            watched: Watched::default(),
            limit: None,
            sampled_us: None,
            differs_since_us: None,
            parameters,
        }
    }

    /// Continues the numbers of captures after a restart in flight.
    #[must_use]
    pub fn continuing_after(mut self, last_capture: u32) -> Self {
        let parameters = &self.parameters;
        self.sequencer = Sequencer::new(parameters.shutter, parameters.shaft.late_turns_to_fault, last_capture);
        self
    }

    /// The parameters in force.
    pub fn parameters(&self) -> &Parameters {
        &self.parameters
    }

    /// Takes the inputs of this moment and returns what shall be done. `now_us` since the board's start.
    pub fn step(&mut self, now_us: u64, inputs: &Inputs) -> Outputs {
        self.now_us = self.now_us.max(now_us);
        let now_us = self.now_us;
        let navigation = Navigation::from(inputs);
        self.shaft.observe(now_us, inputs.shaft_encoder_rad);
        self.sense(inputs);
        self.decide(inputs);
        let moment = self.moment(&navigation);
        let mut surroundings = Surroundings {
            moment: &moment,
            camera: inputs.camera,
            shaft: &mut self.shaft,
            limiter: &mut self.limiter,
            journal: &mut self.journal,
        };
        self.sequencer.step(&mut surroundings);
        self.limit = modes::is_scan(self.mode)
            .then(|| self.limiter.update(now_us, &self.table, self.position.status(), navigation.speed_mps));
        self.judge_speed(&navigation);
        self.sample(&navigation);
        self.outputs(&navigation)
    }

    /// Takes the sensors in and notes what changed.
    fn sense(&mut self, inputs: &Inputs) {
        let now_us = self.now_us;
        let changes = self.position.update(now_us, inputs, self.profile.as_ref());
        for beam in Beam::ALL {
            match *changes.get(beam) {
                Some(RangeChange::Faulty(fault)) => self.journal.event(now_us, EventKind::RangeFault { beam, fault }),
                Some(RangeChange::Recovered) => self.journal.event(now_us, EventKind::RangeRecovered(beam)),
                None => {}
            }
        }
        let known = self.position.status().is_some();
        // Not having found a position yet is not losing it.
        if self.watched.position.is_some() || known {
            let events = [EventKind::CentringLost, EventKind::CentringRegained];
            self.note(|watched| &mut watched.position, known, events);
        }
        if self.parameters.shaft.encoder && (self.watched.encoder.is_some() || self.shaft.is_measured()) {
            let events = [EventKind::EncoderLost, EventKind::EncoderRegained];
            self.note(|watched| &mut watched.encoder, self.shaft.is_measured(), events);
        }
        let events = [EventKind::AutopilotLost, EventKind::AutopilotRegained];
        self.note(|watched| &mut watched.autopilot, inputs.autopilot_alive, events);
        let events = [EventKind::LogLost, EventKind::LogRegained];
        self.note(|watched| &mut watched.log, !inputs.log_lost, events);
    }

    /// Notes a change of a watched state as an event: the first if it fell, the second if it rose.
    fn note(&mut self, state: impl Fn(&mut Watched) -> &mut Option<bool>, value: bool, [fell, rose]: [EventKind; 2]) {
        if state(&mut self.watched).replace(value).is_some_and(|before| before != value) {
            self.journal.event(self.now_us, if value { rose } else { fell });
        }
    }

    /// Moves the mode machine by one step.
    fn decide(&mut self, inputs: &Inputs) {
        let now_us = self.now_us;
        let boot = self.boot();
        let camera_busy = self.parameters.shutter.wiring != CaptureWiring::None && inputs.camera.busy;
        let vitals =
            Vitals { position_known: self.position.status().is_some(), camera_busy, log_lost: inputs.log_lost };
        let self_test = match self.mode {
            Mode::SelfTest => self.self_test.step(now_us, &mut self.shaft, vitals),
            _ => Test::Running,
        };
        let impaired =
            !vitals.position_known || self.shaft.encoder_is_lost() || !inputs.autopilot_alive || inputs.log_lost;
        let trouble = self.sequencer.trouble();
        let circumstances = Circumstances { boot, self_test, trouble, impaired, command: inputs.command };
        let (next, failure) = modes::next(self.mode, circumstances);
        if let Some(failure) = failure {
            self.journal.event(now_us, EventKind::Failed(failure));
        }
        if next != self.mode {
            self.enter(next, inputs);
        }
    }

    /// Computes one node of the table while booting.
    fn boot(&mut self) -> Test {
        if !self.table.is_complete() {
            self.table.advance(&self.parameters, self.profile.as_ref());
            return Test::Running;
        }
        if self.table.central_m() > 0.0 { Test::Passed } else { Test::Failed(Failure::Parameters) }
    }

    fn enter(&mut self, next: Mode, inputs: &Inputs) {
        let now_us = self.now_us;
        let before = core::mem::replace(&mut self.mode, next);
        self.journal.event(now_us, EventKind::Mode { from: before, to: next });
        if next == Mode::SelfTest {
            self.self_test.begin(now_us, &mut self.shaft);
        }
        match (modes::is_scan(before), modes::is_scan(next)) {
            (false, true) => {
                self.shaft.begin_scan(now_us);
                self.limiter.begin(now_us);
                self.sequencer.begin();
            }
            (true, false) => {
                let moment = self.moment(&Navigation::from(inputs));
                self.sequencer.end(&mut Surroundings {
                    moment: &moment,
                    camera: inputs.camera,
                    shaft: &mut self.shaft,
                    limiter: &mut self.limiter,
                    journal: &mut self.journal,
                });
            }
            _ => {}
        }
    }

    fn moment(&self, navigation: &Navigation) -> Moment {
        let status = self.position.status();
        let circumstances = [
            (self.watched.overspeed == Some(true), TagFlags::OVERSPEED),
            (status.is_none(), TagFlags::CENTRING_LOST),
            (self.position.any_fault(), TagFlags::SENSOR_FAULT),
            (!self.shaft.is_measured(), TagFlags::ANGLE_COMMANDED),
        ];
        let flags = circumstances
            .into_iter()
            .filter(|(holds, _)| *holds)
            .fold(TagFlags::default(), |flags, (_, flag)| flags.with(flag));
        Moment {
            now_us: self.now_us,
            ranges: self.position.ranges(),
            range_head_m: self.position.head_m(),
            odometer_m: navigation.odometer_m,
            attitude_rad: navigation.attitude_rad,
            offset_m: status.map(|status| status.offset_m),
            speed_mps: navigation.speed_mps,
            speed_limit_mps: self.limit.map(|limit| limit.speed_mps),
            shaft_rad: self.shaft.angle_rad(),
            flags,
        }
    }

    /// Is the vehicle faster than allowed?
    fn judge_speed(&mut self, navigation: &Navigation) {
        let was = *self.watched.overspeed.get_or_insert(false);
        let over = self.limit.zip(navigation.speed_mps).is_some_and(|(limit, speed_mps)| {
            let begins_mps = limit.speed_mps * (1.0 + OVERSPEED_SHARE) + OVERSPEED_MPS;
            speed_mps > begins_mps || was && speed_mps > limit.speed_mps
        });
        if over == was {
            self.differs_since_us = None;
            return;
        }
        let since_us = *self.differs_since_us.get_or_insert(self.now_us);
        if self.limit.is_none() || has_passed(since_us, self.now_us, OVERSPEED_DWELL_S) {
            self.differs_since_us = None;
            let events = [EventKind::OverspeedEnded, EventKind::OverspeedBegan];
            self.note(|watched| &mut watched.overspeed, over, events);
        }
    }

    /// Writes the periodic samples.
    fn sample(&mut self, navigation: &Navigation) {
        let now_us = self.now_us;
        let period_s = self.parameters.log.sample_period_s;
        let due = self.sampled_us.is_none_or(|at_us| has_passed(at_us, now_us, period_s));
        if !due || self.mode == Mode::Boot {
            return;
        }
        self.sampled_us = Some(now_us);
        let status = self.position.status();
        let centring = CentringSample {
            time_us: now_us,
            offset_m: status.map(|status| status.offset_m),
            sigma_m: status.map(|status| status.sigma_m),
            used: status.map(|status| status.used).unwrap_or_default(),
            water_level_m: self.position.water_level_m(),
        };
        self.journal.entry(Entry::Centring(centring));
        if let Some(limit) = self.limit {
            self.journal.entry(Entry::Speed(SpeedSample {
                time_us: now_us,
                limit_mps: Some(limit.speed_mps),
                speed_mps: navigation.speed_mps,
                step_m: Some(limit.step_m),
                image_period_s: limit.period_s,
            }));
        }
    }

    /// Turns the shaft, or lets it go.
    fn drive_shaft(&mut self) -> Option<f32> {
        if modes::drives_shaft(self.mode) {
            return self.shaft.drive(self.now_us);
        }
        self.shaft.release();
        None
    }

    fn outputs(&mut self, navigation: &Navigation) -> Outputs {
        let servo_pulse_us = self.drive_shaft();
        // In Fault the vehicle shall stand until the pilot has seen it.
        let speed_limit_mps = match self.mode {
            Mode::Fault => Some(0.0),
            _ => self.limit.map(|limit| limit.speed_mps),
        };
        Outputs {
            mode: self.mode,
            shaft_setpoint_rad: self.shaft.setpoint_rad(),
            servo_pulse_us,
            shutter: self.sequencer.shutter(self.now_us),
            light_level: self.sequencer.light_level(),
            speed_limit_mps,
            centring: self.position.status().copied(),
            display: Display {
                captures: self.sequencer.last_capture(),
                missed: self.sequencer.missed(),
                water_level_m: self.position.water_level_m(),
                speed_mps: navigation.speed_mps,
                overspeed: self.watched.overspeed == Some(true),
                gap_open: self.limiter.gap_is_open(),
                range_faults: self.position.faults(),
            },
            entries: self.journal.drain(self.now_us),
        }
    }
}

impl From<&Inputs> for Navigation {
    fn from(inputs: &Inputs) -> Self {
        let finite = |value: &f32| value.is_finite();
        Self {
            attitude_rad: inputs.attitude_rad.filter(|angles_rad| angles_rad.iter().all(finite)),
            odometer_m: inputs.odometer_m.filter(finite),
            speed_mps: inputs.speed_mps.filter(finite),
        }
    }
}
