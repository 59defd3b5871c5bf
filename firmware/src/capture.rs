//! Step and shoot: turn, wait until the shaft is still, light, trigger, wait for the exposure, tag, next.
//!
//! | phase | until | then |
//! |---|---|---|
//! | Turning | the shaft is still, or late | Waiting |
//! | Waiting | the camera is free (not busy, shortest interval over, last photo's fate known) | Lit |
//! | Lit | the light's lead is over | the shutter is commanded, Exposing |
//! | Exposing | the latest end of the exposure | Turning to the next angle |
//!
//! Beside the phases runs the fate of the last capture: its tag is written at the exposure's best-known time, its state moves
//! from commanded to busy to confirmed as far as the camera is wired, and in the end it is good or missed. A
//! missed one is repeated at its angle while retries are left.

use adit_protocol::parameters::{CaptureWiring, ShutterParameters};
use adit_protocol::record::{Entry, EventKind, Failure, MissReason, TagUpdate};
use adit_protocol::tag::{CaptureState, TagFlags};

use crate::io::CameraStatus;
use crate::journal::StepJournal;
use crate::limit::SpeedLimiter;
use crate::moment::Moment;
use crate::shaft::{Shaft, Turn};
use crate::time::{has_passed, micros};

/// More photos at once than any camera stores between two steps: its count has begun anew.
const COUNT_RESTARTED: u32 = 1000;

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Phase {
    Rest,
    Turning,
    Waiting { since_us: u64 },
    Lit { since_us: u64 },
    Exposing,
}

/// A capture whose fate is not known yet.
#[derive(Clone, Copy, Debug)]
struct Open {
    capture: u32,
    index: u32,
    commanded_us: u64,
    busy_us: Option<u64>,
    /// When the camera was last seen busy with it.
    last_busy_us: Option<u64>,
    state: CaptureState,
    flags: TagFlags,
    tagged: bool,
    /// The camera has said all that it is wired for: the photo is good.
    good: bool,
    /// Its scan has ended; it counts for no limit and is not repeated.
    abandoned: bool,
}

/// What the sequencer works on besides itself.
pub(crate) struct Surroundings<'a> {
    pub(crate) moment: &'a Moment,
    pub(crate) camera: CameraStatus,
    pub(crate) shaft: &'a mut Shaft,
    pub(crate) limiter: &'a mut SpeedLimiter,
    pub(crate) journal: &'a mut StepJournal,
}

/// Takes the photos.
#[derive(Clone, Debug)]
pub(crate) struct Sequencer {
    parameters: ShutterParameters,
    late_turns_to_fault: u8,
    phase: Phase,
    /// The last capture's number.
    last_capture: u32,
    /// Which image of the scan is next, counted from 0.
    index: u32,
    /// Repetitions of this image so far.
    attempt: u8,
    is_late: bool,
    late_turns: u8,
    misses: u8,
    missed: u32,
    open: Option<Open>,
    commanded_us: Option<u64>,
    photos_stored: Option<u32>,
    trouble: Option<Failure>,
}

impl Sequencer {
    pub(crate) fn new(parameters: ShutterParameters, late_turns_to_fault: u8, last_capture: u32) -> Self {
        Self {
            parameters,
            late_turns_to_fault,
            phase: Phase::Rest,
            last_capture,
            index: 0,
            attempt: 0,
            is_late: false,
            late_turns: 0,
            misses: 0,
            missed: 0,
            open: None,
            commanded_us: None,
            photos_stored: None,
            trouble: None,
        }
    }

    /// Captures commanded so far.
    pub(crate) fn last_capture(&self) -> u32 {
        self.last_capture
    }

    /// Captures whose photo is missing.
    pub(crate) fn missed(&self) -> u32 {
        self.missed
    }

    /// Why the scan cannot go on.
    pub(crate) fn trouble(&self) -> Option<Failure> {
        self.trouble
    }

    /// Level of the shutter line.
    pub(crate) fn shutter(&self, now_us: u64) -> bool {
        self.phase == Phase::Exposing
            && self.commanded_us.is_some_and(|since_us| !has_passed(since_us, now_us, self.parameters.pulse_s))
    }

    /// Level of the light.
    pub(crate) fn light_level(&self) -> f32 {
        let on = matches!(self.phase, Phase::Lit { .. } | Phase::Exposing);
        // Written so that NaN is dark.
        if on && self.parameters.light_level > 0.0 { self.parameters.light_level.min(1.0) } else { 0.0 }
    }

    /// Begins a scan. The shaft has been told where image 0 is.
    pub(crate) fn begin(&mut self) {
        self.phase = Phase::Turning;
        (self.index, self.attempt) = (0, 0);
        (self.is_late, self.late_turns, self.misses) = (false, 0, 0);
        self.trouble = None;
    }

    /// Ends the scan. A capture under way is tagged at once; its fate is still followed.
    pub(crate) fn end(&mut self, around: &mut Surroundings<'_>) {
        self.phase = Phase::Rest;
        if let Some(mut open) = self.open.take() {
            let exposure_us = self.exposure_us(&open);
            tag(&mut open, exposure_us, around);
            open.abandoned = true;
            self.open = Some(open);
        }
    }

    /// One step of scan and fate.
    pub(crate) fn step(&mut self, around: &mut Surroundings<'_>) {
        self.follow(around);
        let now_us = around.moment.now_us;
        match self.phase {
            Phase::Rest => {}
            Phase::Turning => match around.shaft.turn(now_us) {
                Turn::Turning => {}
                Turn::Still => {
                    (self.is_late, self.late_turns) = (false, 0);
                    self.phase = Phase::Waiting { since_us: now_us };
                }
                Turn::Late => self.be_late(around),
            },
            Phase::Waiting { since_us } => {
                if self.camera_is_free(around.camera, now_us) {
                    self.phase = Phase::Lit { since_us: now_us };
                } else if has_passed(since_us, now_us, self.parameters.busy_timeout_s)
                    && self.open.is_none()
                    && self.is_busy(around.camera)
                {
                    self.trouble = Some(Failure::Camera);
                }
            }
            Phase::Lit { since_us } => {
                if has_passed(since_us, now_us, self.parameters.light_lead_s) {
                    self.command(now_us);
                }
            }
            Phase::Exposing => {
                let ends_us = self.open.as_ref().map(|open| self.ends_us(open));
                if ends_us.is_none_or(|ends_us| now_us >= ends_us) {
                    self.turn_to(self.index.saturating_add(1), around);
                }
            }
        }
    }

    fn be_late(&mut self, around: &mut Surroundings<'_>) {
        let now_us = around.moment.now_us;
        self.late_turns = self.late_turns.saturating_add(1);
        around.journal.event(now_us, EventKind::ShaftLate { capture: self.last_capture.saturating_add(1) });
        if self.late_turns >= self.late_turns_to_fault {
            self.trouble = Some(Failure::Shaft);
        }
        self.is_late = true;
        self.phase = Phase::Waiting { since_us: now_us };
    }

    fn turn_to(&mut self, index: u32, around: &mut Surroundings<'_>) {
        self.index = index;
        self.phase = Phase::Turning;
        around.shaft.turn_to(around.moment.now_us, index);
    }

    fn is_busy(&self, camera: CameraStatus) -> bool {
        self.parameters.wiring != CaptureWiring::None && camera.busy
    }

    fn camera_is_free(&self, camera: CameraStatus, now_us: u64) -> bool {
        let rested =
            self.commanded_us.is_none_or(|since_us| has_passed(since_us, now_us, self.parameters.min_interval_s));
        rested && self.open.is_none() && !self.is_busy(camera)
    }

    fn command(&mut self, now_us: u64) {
        let Some(capture) = self.last_capture.checked_add(1) else {
            self.trouble = Some(Failure::Camera);
            return;
        };
        self.last_capture = capture;
        self.commanded_us = Some(now_us);
        let mut flags = TagFlags::default();
        if self.is_late {
            flags = flags.with(TagFlags::SHAFT_MOVING);
        }
        if self.attempt > 0 {
            flags = flags.with(TagFlags::RETRY);
        }
        self.open = Some(Open {
            capture,
            index: self.index,
            commanded_us: now_us,
            busy_us: None,
            last_busy_us: None,
            state: CaptureState::Commanded,
            flags,
            tagged: false,
            good: false,
            abandoned: false,
        });
        self.phase = Phase::Exposing;
    }

    /// Best-known time of the exposure's middle.
    fn exposure_us(&self, open: &Open) -> u64 {
        let start_us = match open.busy_us {
            Some(busy_us) if self.parameters.busy_marks_exposure => busy_us,
            _ => open.commanded_us.saturating_add(micros(self.parameters.trigger_latency_s)),
        };
        start_us.saturating_add(micros(self.parameters.exposure_s) / 2)
    }

    /// When the exposure is over at the latest, and the shutter line released.
    fn ends_us(&self, open: &Open) -> u64 {
        let parameters = &self.parameters;
        let exposure_us = micros(parameters.exposure_s);
        let over_us = match open.busy_us {
            Some(busy_us) if parameters.busy_marks_exposure => busy_us.saturating_add(exposure_us),
            _ => {
                let latency_s = parameters.trigger_latency_max_s.max(parameters.trigger_latency_s);
                open.commanded_us.saturating_add(micros(latency_s)).saturating_add(exposure_us)
            }
        };
        over_us.max(open.commanded_us.saturating_add(micros(parameters.pulse_s)))
    }

    /// Follows the fate of the last capture.
    fn follow(&mut self, around: &mut Surroundings<'_>) {
        let stored = self.count_photos(around.camera);
        let Some(mut open) = self.open.take() else {
            self.report_surplus(stored, around);
            return;
        };
        let now_us = around.moment.now_us;
        let mut state = open.state;
        if self.is_busy(around.camera) {
            open.last_busy_us = Some(now_us);
            if state == CaptureState::Commanded {
                open.busy_us = Some(now_us);
                state = CaptureState::Busy;
            }
        }
        if stored > 0 && state != CaptureState::Confirmed {
            state = CaptureState::Confirmed;
            self.report_surplus(stored - 1, around);
        } else {
            self.report_surplus(stored, around);
        }
        let changed = state != open.state;
        open.state = state;
        if changed && open.tagged {
            let update = TagUpdate { capture: open.capture, state, time_us: now_us };
            around.journal.entry(Entry::TagUpdate(update));
        }
        let ends_us = self.ends_us(&open);
        // A camera that marks the exposure is waited for; the latest end is late enough to say it never did.
        let exposure_us = self.exposure_us(&open);
        let is_due = if self.parameters.busy_marks_exposure && open.busy_us.is_none() {
            now_us >= ends_us
        } else {
            now_us >= exposure_us
        };
        if is_due {
            tag(&mut open, exposure_us, around);
        }
        if open.tagged && !open.good && self.has_said_all(open.state) {
            open.good = true;
            if !open.abandoned {
                (self.attempt, self.misses) = (0, 0);
                around.limiter.photo_good(now_us, open.index);
            }
        }
        let reason = match open.state {
            CaptureState::Commanded => Some(MissReason::NeverBusy),
            _ if self.has_waited_long_enough(&open, now_us) => Some(MissReason::NeverConfirmed),
            _ => None,
        };
        match reason {
            // Nothing is done before the exposure is over.
            _ if !open.tagged || now_us < ends_us => self.open = Some(open),
            _ if open.good => {}
            Some(reason) => self.miss(&open, reason, around),
            None => self.open = Some(open),
        }
    }

    /// Whether a photo that has not been counted by now will not be counted any more.
    fn has_waited_long_enough(&self, open: &Open, now_us: u64) -> bool {
        let since_busy =
            open.last_busy_us.is_some_and(|at_us| has_passed(at_us, now_us, self.parameters.confirm_grace_s));
        since_busy || has_passed(open.commanded_us, now_us, self.parameters.confirm_timeout_s)
    }

    /// Whether a camera with this wiring can say no more.
    fn has_said_all(&self, state: CaptureState) -> bool {
        match self.parameters.wiring {
            CaptureWiring::None => true,
            CaptureWiring::Busy => state != CaptureState::Commanded,
            CaptureWiring::Confirm => state == CaptureState::Confirmed,
        }
    }

    fn miss(&mut self, open: &Open, reason: MissReason, around: &mut Surroundings<'_>) {
        let retry = !open.abandoned && self.attempt < self.parameters.retries;
        let reason = if open.abandoned { MissReason::Abandoned } else { reason };
        self.missed = self.missed.saturating_add(1);
        around.journal.event(around.moment.now_us, EventKind::Missed { capture: open.capture, reason, retry });
        if open.abandoned {
            return;
        }
        around.limiter.photo_missed(open.index);
        self.misses = self.misses.saturating_add(1);
        if self.misses >= self.parameters.misses_to_fault {
            self.trouble = Some(Failure::Camera);
        }
        let index = if retry { open.index } else { open.index.saturating_add(1) };
        self.attempt = if retry { self.attempt.saturating_add(1) } else { 0 };
        if self.phase == Phase::Exposing || self.index != index {
            self.turn_to(index, around);
        }
    }

    /// How many photos have been stored since the last step.
    fn count_photos(&mut self, camera: CameraStatus) -> u32 {
        if self.parameters.wiring != CaptureWiring::Confirm {
            return 0;
        }
        let before = self.photos_stored.replace(camera.photos_stored);
        let stored = before.map_or(0, |before| camera.photos_stored.wrapping_sub(before));
        if stored < COUNT_RESTARTED { stored } else { 0 }
    }

    fn report_surplus(&self, count: u32, around: &mut Surroundings<'_>) {
        if count > 0 {
            let kind = EventKind::SurplusPhotos { count, after_capture: self.last_capture };
            around.journal.event(around.moment.now_us, kind);
        }
    }
}

/// Writes the capture's tag, once.
fn tag(open: &mut Open, exposure_us: u64, around: &mut Surroundings<'_>) {
    if !open.tagged {
        open.tagged = true;
        let tag = around.moment.tag(open.capture, open.state, exposure_us, open.flags);
        around.journal.entry(Entry::Tag(tag));
        around.limiter.photo_exposed(exposure_us);
    }
}
