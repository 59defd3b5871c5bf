//! A session with whoever is at the other end of a connection.

use std::fmt;
use std::path::PathBuf;
use std::sync::Arc;
use std::time::{Duration, SystemTime};

use adit_protocol::connection::Connection;
use adit_protocol::mavlink::{
    AUTOPILOT_COMPONENT, BOARD_COMPONENT, CAMERA_COMPONENT, Counters, Incoming, OutFrame, RawFrame, Sender, Target,
};
use tokio::sync::broadcast::error::RecvError;
use tokio::sync::{broadcast, mpsc, watch};
use tokio::task::JoinHandle;
use tokio::time::{Instant, timeout_at};

use super::error::{LinkError, Question};
use super::key::KeyFile;
use super::pump::{Build, Outlets, Pump};
use super::record::Recorder;
use super::transport::Line;
use super::trust::Trust;

/// System of ground stations, by custom.
const GROUND_SYSTEM: u8 = 255;
/// `MAV_COMP_ID_MISSIONPLANNER`: what ground stations call themselves.
const GROUND_COMPONENT: u8 = 190;
/// Us, as answers name us.
pub(super) const GROUND: Target = [GROUND_SYSTEM, GROUND_COMPONENT];
/// Frames that a listener may be behind before it loses some.
const BACKLOG: usize = 2048;
/// So many bytes without a frame are noise: more than a start in the middle of a frame, or a boot loader's words.
const NOISE_BYTES: u32 = 600;
/// Requests that wait for the task.
const REQUESTS: usize = 64;
/// The mildest notice that explains why something was not done, `MAV_SEVERITY_WARNING`.
const WARNING: u8 = 4;

/// How long answers are waited for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Patience {
    /// Before a question is asked again.
    pub answer: Duration,
    /// Without any answer before a question is given up.
    pub silence: Duration,
}

impl Default for Patience {
    /// A telemetry radio may need half a second there and back; ten seconds are a stretch of bad reception.
    fn default() -> Self {
        Self { answer: Duration::from_millis(800), silence: Duration::from_secs(10) }
    }
}

/// What a session is to do.
#[derive(Debug, Default)]
pub struct Config {
    /// The vehicle's number, if not that of the first board heard.
    pub system: Option<u8>,
    /// Signs what is sent, and believes only what is signed with it.
    pub key: Option<KeyFile>,
    /// Where every frame is recorded.
    pub record: Option<PathBuf>,
    /// How long answers are waited for.
    pub patience: Patience,
}

/// A frame that was heard.
#[derive(Clone, Debug)]
pub struct Heard {
    /// When.
    pub at: SystemTime,
    /// The frame.
    pub frame: RawFrame,
    /// What it says, if anybody here has a use for it.
    pub incoming: Option<Incoming>,
    /// What its signature is worth.
    pub trust: Trust,
}

/// Somebody whose heartbeat was heard.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Peer {
    /// Which vehicle.
    pub system: u8,
    /// Which part of it.
    pub component: u8,
    /// `MAV_TYPE`.
    pub kind: u8,
    /// `MAV_AUTOPILOT`.
    pub autopilot: u8,
    /// Its own number of its mode.
    pub mode: u32,
    /// What its last heartbeat's signature is worth.
    pub trust: Trust,
}

impl fmt::Display for Peer {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        let name = match self.component {
            AUTOPILOT_COMPONENT => "autopilot",
            BOARD_COMPONENT => "board",
            CAMERA_COMPONENT => "camera",
            _ if self.kind == 6 => "ground station",
            _ => "component",
        };
        write!(out, "{name} {}/{}", self.system, self.component)?;
        if let Trust::Refused(error) = self.trust {
            write!(out, " (not believed: {error})")?;
        }
        Ok(())
    }
}

/// How the link is.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct LinkState {
    /// The peer at the line's other end, or why there is none.
    pub line: Result<String, String>,
    /// Whose heartbeats were heard.
    pub peers: Vec<Peer>,
    /// Frames and damage so far.
    pub counters: Counters,
    /// The record could not go on.
    pub record_failed: bool,
}

/// What came of a session.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Summary {
    /// Frames in the record.
    pub recorded: u64,
    /// Frames and damage since the line was up.
    pub counters: Counters,
}

/// A session. Its task runs until [`Session::close`], or until it is dropped.
#[derive(Debug)]
pub struct Session {
    requests: mpsc::Sender<Build>,
    /// Never read: new listeners begin at its end.
    heard: broadcast::Receiver<Arc<Heard>>,
    state: watch::Receiver<LinkState>,
    task: JoinHandle<Result<Summary, LinkError>>,
    connection: Connection,
    system: Option<u8>,
    patience: Patience,
}

/// What a dialogue does when it is its turn.
pub(super) enum Turn<T> {
    /// Asks.
    Send(Vec<Build>),
    /// Ends.
    Done(T),
}

/// What a message means to a dialogue.
pub(super) enum Step<T> {
    /// Nothing.
    Nothing,
    /// Part of the answer.
    Progress,
    /// Part of the answer, and there is something new to be asked.
    Ask,
    /// The answer.
    Done(T),
}

/// A question and what it takes to understand the answer; it knows neither sockets nor clocks.
pub(super) trait Dialogue {
    /// What it ends with.
    type Answer;
    /// Asks, for the first time or again: `attempt` counts from 0 since the last progress.
    fn turn(&mut self, attempt: u32) -> Turn<Self::Answer>;
    /// Hears a believed message of whom it asks.
    fn hear(&mut self, incoming: &Incoming) -> Step<Self::Answer>;
}

impl Session {
    /// Opens a connection. Must be called within a tokio runtime.
    ///
    /// # Errors
    /// [`LinkError::Serial`], [`LinkError::Open`], [`LinkError::Key`], [`LinkError::Record`].
    pub async fn open(connection: &Connection, config: Config) -> Result<Self, LinkError> {
        let line = Line::open(connection, config.patience.silence).await?;
        if let Some(file) = &config.key {
            // What cannot be kept must be known before anything is signed.
            file.keep(file.time(SystemTime::now()), file.heard(), true)?;
        }
        let recorder = config.record.as_deref().map(Recorder::create).transpose()?;
        let (requests, inbox) = mpsc::channel(REQUESTS);
        let (heard, listener) = broadcast::channel(BACKLOG);
        let nothing = LinkState {
            line: Err("nobody was there yet".to_owned()),
            peers: Vec::new(),
            counters: Counters::default(),
            record_failed: false,
        };
        let (state, watcher) = watch::channel(nothing);
        let sender = Sender::new(GROUND_SYSTEM, GROUND_COMPONENT);
        let pump = Pump::new(line, sender, config.key, recorder, Outlets { heard, state });
        let task = tokio::spawn(pump.run(inbox));
        let (connection, system, patience) = (connection.clone(), config.system, config.patience);
        Ok(Self { requests, heard: listener, state: watcher, task, connection, system, patience })
    }

    /// Everything that is heard from now on. Who falls far behind is told how much was lost.
    pub fn listen(&self) -> broadcast::Receiver<Arc<Heard>> {
        self.heard.resubscribe()
    }

    /// How the link is, and every change of it.
    pub fn state(&self) -> watch::Receiver<LinkState> {
        self.state.clone()
    }

    /// Whose heartbeats were heard so far.
    pub fn heard(&self) -> Vec<Peer> {
        self.state.borrow().peers.clone()
    }

    /// Whether what comes in is noise: [`LinkError::Noise`].
    pub fn noise(&self) -> Option<LinkError> {
        let Counters { good, dropped_bytes, .. } = self.state.borrow().counters;
        (good == 0 && dropped_bytes >= NOISE_BYTES)
            .then(|| LinkError::Noise { connection: self.connection.clone(), bytes: dropped_bytes })
    }

    /// How long answers are waited for.
    pub fn patience(&self) -> Patience {
        self.patience
    }

    /// Sends a frame; the session gives it its number and signature.
    ///
    /// # Errors
    /// [`LinkError::Ended`].
    pub async fn send(&self, build: impl FnOnce(&mut Sender) -> OutFrame + Send + 'static) -> Result<(), LinkError> {
        self.send_boxed(Box::new(build)).await
    }

    async fn send_boxed(&self, build: Build) -> Result<(), LinkError> {
        self.requests.send(build).await.map_err(|_| LinkError::Ended)
    }

    /// Waits for a heartbeat of the board, of the system asked for if there is one.
    ///
    /// # Errors
    /// [`LinkError::NoBoard`] with who was heard instead; [`LinkError::Noise`].
    pub(super) async fn wait_for_board(&self) -> Result<Peer, LinkError> {
        let mut state = self.state.clone();
        let is_board = |peer: &&Peer| {
            peer.component == BOARD_COMPONENT
                && peer.trust.is_believed()
                && self.system.is_none_or(|system| peer.system == system)
        };
        let deadline = Instant::now() + self.patience.silence;
        loop {
            let found = state.borrow_and_update().peers.iter().find(is_board).copied();
            if let Some(peer) = found {
                return Ok(peer);
            }
            match timeout_at(deadline, state.changed()).await {
                Ok(Ok(())) => {}
                Ok(Err(_)) => return Err(LinkError::Ended),
                Err(_) => {
                    if let Some(noise) = self.noise() {
                        return Err(noise);
                    }
                    let others = self.heard().iter().map(ToString::to_string).collect();
                    return Err(LinkError::NoBoard { within: self.patience.silence, others });
                }
            }
        }
    }

    /// Leads a dialogue to its end: asks, hears, asks again.
    ///
    /// # Errors
    /// [`LinkError::NoAnswer`] when nothing of the answer was heard for [`Patience::silence`]; [`LinkError::Ended`].
    pub(super) async fn lead<D: Dialogue>(
        &self,
        whom: Target,
        question: Question,
        dialogue: &mut D,
    ) -> Result<D::Answer, LinkError> {
        let mut heard = self.listen();
        let Patience { answer, silence } = self.patience;
        let mut said = None;
        let mut attempt = 0;
        let mut progress = Instant::now();
        'turn: loop {
            match dialogue.turn(attempt) {
                Turn::Done(answer) => return Ok(answer),
                Turn::Send(builds) => {
                    for build in builds {
                        self.send_boxed(build).await?;
                    }
                }
            }
            attempt += 1;
            let mut again = Instant::now() + answer;
            loop {
                let next = timeout_at(again.min(progress + silence), heard.recv()).await;
                let now = Instant::now();
                match next {
                    Ok(Ok(message)) => match hear(dialogue, whom, &message, &mut said) {
                        Step::Done(answer) => return Ok(answer),
                        Step::Progress => (progress, again) = (now, now + answer),
                        Step::Ask => {
                            (progress, attempt) = (now, 0);
                            continue 'turn;
                        }
                        Step::Nothing => {}
                    },
                    // What was missed is asked for again.
                    Ok(Err(RecvError::Lagged(_))) | Err(_) => {}
                    Ok(Err(RecvError::Closed)) => return Err(LinkError::Ended),
                }
                if now >= progress + silence {
                    return Err(LinkError::NoAnswer { question, within: silence, said });
                }
                if now >= again {
                    continue 'turn;
                }
            }
        }
    }

    /// Ends the session: what was sent goes out, the record and what belongs to the key are complete.
    ///
    /// # Errors
    /// [`LinkError::Record`] if the record is not complete; [`LinkError::Key`].
    pub async fn close(self) -> Result<Summary, LinkError> {
        let Self { requests, task, .. } = self;
        drop(requests);
        task.await.unwrap_or(Err(LinkError::Ended))
    }
}

/// Hands a message to a dialogue if it is of whom it asks, and keeps what may explain a missing answer.
fn hear<D: Dialogue>(dialogue: &mut D, whom: Target, message: &Heard, said: &mut Option<String>) -> Step<D::Answer> {
    let from = [message.frame.system, message.frame.component];
    let (Some(incoming), true) = (&message.incoming, from == whom && message.trust.is_believed()) else {
        return Step::Nothing;
    };
    if let Incoming::Text { severity, text } = incoming
        && *severity <= WARNING
    {
        *said = Some(text.to_string());
    }
    dialogue.hear(incoming)
}
