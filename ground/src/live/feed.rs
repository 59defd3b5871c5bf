//! From the link, or a record, to the newest frame: the only place that keeps time.

use std::future::Future;
use std::sync::Arc;
use std::time::Duration;

use adit_protocol::mavlink::{command, message};
use adit_protocol::parameters::{ParameterTable, Parameters};
use tokio::sync::broadcast::error::{RecvError, TryRecvError};
use tokio::sync::watch;
use tokio::time::{Instant, MissedTickBehavior, interval, sleep};
use tracing::warn;

use super::picture::Picture;
use super::replay::{Replay, ReplayError};
use super::setting::Setting;
use super::state::State;
use super::view::{RecordView, ReplayView, View, WallView};
use crate::link::{Heard, LinkError, Session};

/// Time between two pictures.
const TICK: Duration = Duration::from_millis(200);
/// Messages that are understood before it is looked whether a picture is due.
const BATCH: usize = 256;
/// Ticks between two questions for a capture's fate.
const ASK_TICKS: u64 = 5;
/// Before the board's parameters are asked for again.
const SETTING_RETRY: Duration = Duration::from_secs(5);

/// Everything that is shown at one moment.
#[derive(Clone, Debug, Default)]
pub struct Frame {
    /// Figures and words.
    pub view: View,
    /// The wall as far as it was seen.
    pub strip: Arc<Picture>,
}

/// Why it ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Ending {
    /// Whoever watched wanted no more.
    Stopped,
    /// The record is over.
    RecordOver,
}

/// What is common to flights and records: the state, and who shows it.
#[derive(Debug)]
pub struct Live {
    state: State,
    frames: watch::Sender<Arc<Frame>>,
    strip: Arc<Picture>,
    strip_revision: u64,
    wall: Option<WallView>,
    record: Option<RecordView>,
    replay: Option<ReplayView>,
}

impl Live {
    /// Shows what `state` becomes.
    pub fn new(state: State) -> (Self, watch::Receiver<Arc<Frame>>) {
        let (frames, shown) = watch::channel(Arc::default());
        let strip = Arc::default();
        (Self { state, frames, strip, strip_revision: 0, wall: None, record: None, replay: None }, shown)
    }

    fn show(&mut self, now: Duration) {
        if let Some(strip) = self.state.strip()
            && (strip.revision() != self.strip_revision || self.strip.columns == 0)
        {
            self.strip_revision = strip.revision();
            self.strip = Arc::new(Picture::of(strip, &self.strip));
            self.wall = self.strip.wall();
        }
        let shown = self.state.show(now);
        let view = View { record: self.record.clone(), replay: self.replay, wall: self.wall, ..shown };
        self.frames.send_replace(Arc::new(Frame { view, strip: Arc::clone(&self.strip) }));
    }
}

/// Follows a flight until `stop` completes; without a setting it asks the board for its parameters.
///
/// Must be called within a tokio runtime. `record`: the file's name, for display.
///
/// # Errors
/// [`LinkError`] if the session ends, or its record is incomplete.
pub async fn follow(
    session: Session,
    mut live: Live,
    record: Option<String>,
    stop: impl Future<Output = ()>,
) -> Result<Ending, LinkError> {
    live.record = record.map(|file| RecordView { file, has_failed: false });
    let followed = attend(&session, &mut live, stop).await;
    let closed = session.close().await;
    followed?;
    closed.map(|_| Ending::Stopped)
}

async fn attend(session: &Session, live: &mut Live, stop: impl Future<Output = ()>) -> Result<(), LinkError> {
    let started = Instant::now();
    let (mut heard, link) = (session.listen(), session.state());
    let mut ticks = interval(TICK);
    ticks.set_missed_tick_behavior(MissedTickBehavior::Skip);
    let mut ticked = 0_u64;
    let mut is_set = live.state.setting().is_some();
    let asking = ask_setting(session);
    tokio::pin!(asking, stop);
    loop {
        tokio::select! {
            message = heard.recv() => match message {
                Ok(message) => {
                    live.state.hear(started.elapsed(), &message);
                    catch_up(&mut heard, live, started);
                }
                Err(RecvError::Lagged(messages)) => live.state.leave_out(messages),
                Err(RecvError::Closed) => return Err(LinkError::Ended),
            },
            _ = ticks.tick() => {
                let now = started.elapsed();
                let (line, counters, record_failed) = {
                    let link = link.borrow();
                    (link.line.clone(), link.counters, link.record_failed)
                };
                let line = session.noise().map_or(line, |noise| Err(noise.to_string()));
                live.state.line(line, counters);
                if let Some(record) = &mut live.record {
                    record.has_failed = record_failed;
                }
                live.show(now);
                ticked += 1;
                if let (true, Some((camera, index))) = (ticked.is_multiple_of(ASK_TICKS), live.state.missing_report(now)) {
                    let wanted = [message::IMAGE_CAPTURED as f32, index as f32, 0.0, 0.0, 0.0, 0.0, 0.0];
                    session.send(move |sender| sender.command(camera, command::REQUEST_MESSAGE, 0, &wanted)).await?;
                }
            }
            setting = &mut asking, if !is_set => {
                is_set = true;
                if let Err(error) = live.state.set(setting) {
                    warn!("the board's parameters: {error}");
                }
            }
            () = &mut stop => return Ok(()),
        }
    }
}

/// Understands what is there already, up to a batch.
fn catch_up(heard: &mut tokio::sync::broadcast::Receiver<Arc<Heard>>, live: &mut Live, started: Instant) {
    for _ in 0..BATCH {
        match heard.try_recv() {
            Ok(message) => live.state.hear(started.elapsed(), &message),
            Err(TryRecvError::Lagged(messages)) => live.state.leave_out(messages),
            // That it is closed is told where it is waited for.
            Err(TryRecvError::Empty | TryRecvError::Closed) => return,
        }
    }
}

/// Asks the board until it answers.
async fn ask_setting(session: &Session) -> Setting {
    loop {
        let answer = async {
            let board = session.board().await?;
            session.parameters(&board, &mut |_, _| {}).await
        };
        match answer.await {
            Ok(list) => {
                let mut table = ParameterTable::new(Parameters::default());
                for parameter in list {
                    // A parameter that is unknown here, or out of range, says nothing about section and camera.
                    let _ = ParameterTable::find(&parameter.name).map(|index| table.set(index, parameter.value));
                }
                match Setting::of_board(table.parameters()) {
                    Ok(setting) => return setting,
                    Err(error) => warn!("the board's parameters: {error}"),
                }
            }
            Err(error) => warn!("cannot ask the board for its parameters: {error}"),
        }
        sleep(SETTING_RETRY).await;
    }
}

/// Shows a record, `speed` times as fast as it was, until it is over or `stop` completes.
///
/// Must be called within a tokio runtime.
///
/// # Errors
/// [`ReplayError::Read`]
pub async fn replay(
    mut record: Replay,
    mut live: Live,
    speed: f64,
    stop: impl Future<Output = ()>,
) -> Result<Ending, ReplayError> {
    live.replay = Some(ReplayView { speed, is_over: false });
    live.state.line(Ok(format!("record {}", record.name())), adit_protocol::mavlink::Counters::default());
    let started = Instant::now();
    let mut ticks = interval(TICK);
    ticks.set_missed_tick_behavior(MissedTickBehavior::Skip);
    let mut next = record.read()?;
    tokio::pin!(stop);
    loop {
        tokio::select! {
            _ = ticks.tick() => {}
            () = &mut stop => return Ok(Ending::Stopped),
        }
        let now = started.elapsed().mul_f64(speed);
        while let Some((at, heard)) = &next
            && *at <= now
        {
            live.state.hear(*at, heard);
            next = record.read()?;
        }
        let Some(_) = next else {
            live.replay = Some(ReplayView { speed, is_over: true });
            // As it was at the end, not as it grows old.
            live.show(record.lasted());
            return Ok(Ending::RecordOver);
        };
        live.show(now);
    }
}

#[cfg(test)]
mod tests {
    use adit_protocol::mavlink::Value;

    use super::super::view::RangeState;
    use super::*;
    use crate::link::tests::{Script, config, over_tcp};

    #[tokio::test]
    async fn without_a_mission_section_and_sensors_are_the_boards() {
        let (session, _board) = over_tcp(Script::default(), config()).await;
        let board = session.board().await.unwrap();
        for (name, value) in [("TUN_RADIUS_M", Value::Real(1.25)), ("RNG_DOWN_FIT", Value::Whole(0))] {
            session.set_parameter(&board, name, value).await.unwrap();
        }
        let (live, mut shown) = Live::new(State::new(None));
        assert!(live.state.setting().is_none());
        let (stop, stopped) = tokio::sync::oneshot::channel::<()>();
        let stop_of_follow = async {
            let _ = stopped.await;
        };
        let looking = async {
            let frame = shown.wait_for(|frame| !frame.view.outline_m.is_empty()).await.unwrap().clone();
            stop.send(()).unwrap();
            frame
        };
        let (ended, frame) = tokio::join!(follow(session, live, None, stop_of_follow), looking);
        assert_eq!(ended.unwrap(), Ending::Stopped);
        let widest_m = frame.view.outline_m.iter().fold(0.0, |widest: f64, [y_m, _]| widest.max(y_m.abs()));
        assert!((widest_m - 1.25).abs() < 1e-3, "{widest_m}");
        let fitted = frame.view.ranges.map(|range| range.state != RangeState::Unfitted);
        assert_eq!(fitted, [true, true, false, true], "up, right, down, left");
        assert!(frame.view.wall.is_some());
    }
}
