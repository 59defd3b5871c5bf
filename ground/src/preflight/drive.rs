//! The order of things: listen, ask, move, put back.

use std::sync::Arc;
use std::time::Duration;

use adit_protocol::mavlink::{VehicleBeat, command};
use adit_protocol::record::{Header, Mode};
use tokio::sync::broadcast::Receiver;
use tokio::sync::broadcast::error::RecvError;
use tokio::time::{Instant, timeout_at};

use super::watch::Watch;
use super::{Options, Preflight, Subject, Verdict, checks};
use crate::link::{Board, ClockReading, CommandOutcome, Heard, LinkError, LogEntry, Session};

/// An autopilot that does not tell its version is not waited for longer.
const VERSION: Duration = Duration::from_secs(3);
/// Between two looks at a board that restarts.
const RESTART_PAUSE: Duration = Duration::from_millis(300);

/// A listener on the link.
struct Ear<'s> {
    session: &'s Session,
    heard: Receiver<Arc<Heard>>,
    watch: Watch,
}

/// What was read of the board's card.
struct Card {
    logs: Option<Vec<LogEntry>>,
    header: Option<Header>,
}

/// Goes through the list. `say` is told before something moves.
///
/// # Errors
/// [`LinkError`] if the link itself ends; a board that does not answer is a no, not an error.
pub async fn preflight(
    session: &Session,
    options: &Options<'_>,
    say: &mut dyn FnMut(&str),
) -> Result<Preflight, LinkError> {
    let mut list = Preflight::default();
    let board = match session.board().await {
        Ok(board) => board,
        Err(error @ (LinkError::NoBoard { .. } | LinkError::NoAnswer { .. })) => {
            list.note(Subject::Link, Verdict::No, error.to_string());
            return Ok(list);
        }
        Err(error) => return Err(error),
    };
    let [system, component] = board.target;
    list.note(Subject::Link, Verdict::Yes, format!("board {system}/{component} answers"));
    checks::firmware(&mut list, &board);
    let mut ear = Ear { session, heard: session.listen(), watch: Watch::new(system) };
    let first = answered(session.clock(&board).await)?;
    ear.listen(options.timing.listen, |_| false).await?;
    let rests = rest(&mut list, &mut ear, &board).await?;
    let version = tokio::time::timeout(VERSION, session.autopilot_version(&board)).await;
    let version = version.ok().map(answered).transpose()?.flatten().flatten();
    checks::autopilot(&mut list, &ear.watch, version, options.mission);
    let told = answered(session.parameters(&board, &mut |_, _| {}).await)?.unwrap_or_default();
    let card = look_at_card(session, &board).await?;
    checks::parameters(&mut list, &told, card.header.as_ref(), options.mission);
    checks::card(&mut list, card.logs.as_deref(), card.header.as_ref());
    let second = answered(session.clock(&board).await)?;
    checks::clock(&mut list, first.zip(second).map(<[ClockReading; 2]>::from));
    checks::sensors(&mut list, &ear.watch, &told);
    let armed = ear.watch.vehicle.is_some_and(VehicleBeat::is_armed);
    if options.still || armed || !rests {
        let why = match (options.still, armed) {
            (true, _) => "not tried, as asked (--still)",
            (false, true) => "not tried: the vehicle is armed",
            (false, false) => "not tried: the board is not at rest",
        };
        let verdict = if options.still { Verdict::Unknown } else { Verdict::No };
        for subject in [Subject::SelfTest, Subject::Camera, Subject::Enforcement] {
            list.note(subject, verdict, why);
        }
    } else {
        say("now the shaft turns, the light goes on and the camera fires; propellers stay still");
        move_things(&mut list, &mut ear, &board, options, &told).await?;
    }
    let words = "the board cannot know: look at the camera's display";
    list.note(Subject::CameraSupplies, Verdict::Unknown, words);
    Ok(list)
}

/// What a question brought; `None` where nobody answers.
fn answered<T>(answer: Result<T, LinkError>) -> Result<Option<T>, LinkError> {
    match answer {
        Ok(answer) => Ok(Some(answer)),
        Err(LinkError::NoAnswer { .. }) => Ok(None),
        Err(error) => Err(error),
    }
}

/// Is the board at rest? One in fault is brought to rest.
async fn rest(list: &mut Preflight, ear: &mut Ear<'_>, board: &Board) -> Result<bool, LinkError> {
    let in_fault = ear.watch.is_in(Mode::Fault);
    if in_fault {
        answered(ear.session.command(board.target, command::ARM_DISARM, [0.0; 7]).await)?;
        ear.listen(Duration::from_secs(2), |watch| watch.is_in(Mode::Idle)).await?;
    }
    let idle = ear.watch.is_in(Mode::Idle);
    let (verdict, words) = match (idle, in_fault) {
        (true, false) => (Verdict::Yes, "at rest"),
        (true, true) => (Verdict::Yes, "was in fault, now at rest"),
        (false, true) => (Verdict::No, "in fault, and stays so: its parameters allow no scan"),
        (false, false) => (Verdict::No, "not at rest: it starts, is armed, or scans; stop and disarm it"),
    };
    list.note(Subject::Board, verdict, words);
    Ok(idle)
}

async fn look_at_card(session: &Session, board: &Board) -> Result<Card, LinkError> {
    let logs = answered(session.logs(board).await)?;
    let header = match logs.as_deref() {
        Some([.., last]) => answered(session.log_header(board, *last).await)?.flatten(),
        _ => None,
    };
    Ok(Card { logs, header })
}

/// Self-test, test photos, speed limit; then everything as it was.
async fn move_things(
    list: &mut Preflight,
    ear: &mut Ear<'_>,
    board: &Board,
    options: &Options<'_>,
    told: &[crate::link::Parameter],
) -> Result<(), LinkError> {
    let (session, timing) = (ear.session, options.timing);
    let command = async |number, first| {
        let parameters = [first, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0];
        answered(session.command(board.target, number, parameters).await)
    };
    ear.watch.begin();
    command(command::ARM_DISARM, 1.0).await?;
    let ended = |watch: &Watch| watch.is_in(Mode::Ready) || watch.is_in(Mode::Fault);
    ear.listen(timing.self_test, ended).await?;
    let passed = ear.watch.is_in(Mode::Ready);
    if !passed {
        // The words come right behind the heartbeat.
        ear.listen(Duration::from_secs(1), |watch| watch.failure.is_some()).await?;
    }
    checks::self_test(list, passed, &ear.watch);
    if passed {
        ear.watch.begin();
        command(command::START_CAPTURE, 0.0).await?;
        ear.listen(timing.scan_least, |_| false).await?;
        ear.listen(timing.scan_most.saturating_sub(timing.scan_least), |watch| watch.taken + watch.missed > 0).await?;
        checks::camera(list, &ear.watch, told);
        checks::enforcement(list, &ear.watch);
        command(command::STOP_CAPTURE, 0.0).await?;
    } else {
        for subject in [Subject::Camera, Subject::Enforcement] {
            list.note(subject, Verdict::No, "not tried: the self-test failed");
        }
    }
    command(command::ARM_DISARM, 0.0).await?;
    ear.listen(Duration::from_secs(2), |watch| watch.is_in(Mode::Idle)).await?;
    if passed { restart(list, ear, board, timing.restart).await } else { Ok(()) }
}

/// The flight gets a log of its own.
async fn restart(list: &mut Preflight, ear: &mut Ear<'_>, board: &Board, patience: Duration) -> Result<(), LinkError> {
    let session = ear.session;
    let before = look_at_card(session, board).await?.logs.and_then(|logs| logs.last().copied());
    if session.restart(board).await? != CommandOutcome::Accepted {
        list.note(Subject::Restart, Verdict::No, "refused: the test photos are in the flight's log; restart the board");
        return Ok(());
    }
    let until = Instant::now() + patience;
    ear.watch.begin();
    while Instant::now() < until {
        ear.listen(RESTART_PAUSE, |_| false).await?;
        let last = look_at_card(session, board).await?.logs.and_then(|logs| logs.last().copied());
        if let Some(last) = last.filter(|last| before.is_none_or(|before| last.number > before.number))
            && ear.watch.is_in(Mode::Idle)
        {
            let words = format!(
                "the test photos are in the log before; the flight's is {}",
                crate::link::log_name(last.number)
            );
            list.note(Subject::Restart, Verdict::Yes, words);
            return Ok(());
        }
    }
    list.note(Subject::Restart, Verdict::No, "the board did not come back with a new log");
    Ok(())
}

impl Ear<'_> {
    /// Takes in what is said until `enough`, for so long at most.
    async fn listen(&mut self, most: Duration, enough: impl Fn(&Watch) -> bool) -> Result<(), LinkError> {
        let until = Instant::now() + most;
        while !enough(&self.watch) {
            match timeout_at(until, self.heard.recv()).await {
                Ok(Ok(message)) => self.watch.hear(&message),
                Ok(Err(RecvError::Lagged(_))) => {}
                Ok(Err(RecvError::Closed)) => return Err(LinkError::Ended),
                Err(_) => return Ok(()),
            }
        }
        Ok(())
    }
}
