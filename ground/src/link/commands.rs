//! Commands, and the key, which is given to the board by a message of its own.

use std::fmt;

use adit_protocol::mavlink::{Incoming, Key, Target, command};
use tokio::sync::broadcast::error::RecvError;
use tokio::time::{Instant, timeout_at};

use super::error::{LinkError, Question};
use super::session::{Dialogue, GROUND, Session, Step, Turn};
use super::trust::{Trust, Verifier};
use super::version::Board;

/// What became of a command, `MAV_RESULT`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum CommandOutcome {
    /// It is done, or will be.
    Accepted,
    /// Not now; ask again later.
    TemporarilyRejected,
    /// Not like this.
    Denied,
    /// Nobody there knows it.
    Unsupported,
    /// It was tried and did not work.
    Failed,
    /// Another outcome, by its number.
    Other(u8),
}

/// `MAV_RESULT_IN_PROGRESS`.
const IN_PROGRESS: u8 = 5;

impl From<u8> for CommandOutcome {
    fn from(number: u8) -> Self {
        match number {
            0 => Self::Accepted,
            1 => Self::TemporarilyRejected,
            2 => Self::Denied,
            3 => Self::Unsupported,
            4 => Self::Failed,
            other => Self::Other(other),
        }
    }
}

impl fmt::Display for CommandOutcome {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Accepted => write!(out, "accepted"),
            Self::TemporarilyRejected => write!(out, "rejected for now (is the board idle?)"),
            Self::Denied => write!(out, "denied"),
            Self::Unsupported => write!(out, "not supported"),
            Self::Failed => write!(out, "failed"),
            Self::Other(number) => write!(out, "answered with result {number}"),
        }
    }
}

struct CommandDialogue {
    whom: Target,
    number: u16,
    parameters: [f32; 7],
    is_in_progress: bool,
}

impl Dialogue for CommandDialogue {
    type Answer = CommandOutcome;

    fn turn(&mut self, attempt: u32) -> Turn<CommandOutcome> {
        if self.is_in_progress {
            // It was heard; asking again might begin it anew.
            return Turn::Send(Vec::new());
        }
        let (whom, number, parameters) = (self.whom, self.number, self.parameters);
        let confirmation = u8::try_from(attempt).unwrap_or(u8::MAX);
        Turn::Send(vec![Box::new(move |sender| sender.command(whom, number, confirmation, &parameters))])
    }

    fn hear(&mut self, incoming: &Incoming) -> Step<CommandOutcome> {
        let Incoming::CommandAck { command, result, target } = incoming else { return Step::Nothing };
        let is_for_us = *target == [0, 0] || *target == GROUND;
        match *result {
            _ if *command != self.number || !is_for_us => Step::Nothing,
            IN_PROGRESS => {
                self.is_in_progress = true;
                Step::Progress
            }
            result => Step::Done(result.into()),
        }
    }
}

impl Session {
    /// Gives a command and waits for its outcome; repeats carry their count, so that it is obeyed once.
    ///
    /// # Errors
    /// [`LinkError::NoAnswer`], [`LinkError::Ended`].
    pub async fn command(&self, whom: Target, number: u16, parameters: [f32; 7]) -> Result<CommandOutcome, LinkError> {
        let mut dialogue = CommandDialogue { whom, number, parameters, is_in_progress: false };
        self.lead(whom, Question::Command(number), &mut dialogue).await
    }

    /// Restarts the board, which it does only at rest.
    ///
    /// # Errors
    /// As [`Session::command`].
    pub async fn restart(&self, board: &Board) -> Result<CommandOutcome, LinkError> {
        // The second parameter is for onboard computers.
        self.command(board.target, command::REBOOT, [0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0]).await
    }

    /// Gives the board a key and waits until it signs with it. Must come in by the board's service port.
    ///
    /// # Errors
    /// [`LinkError::KeyRefused`], [`LinkError::NoAnswer`].
    pub async fn install_key(&self, board: &Board, key: Key, time: u64) -> Result<(), LinkError> {
        self.change_key(board, key, time, true).await
    }

    /// Takes the board's key away and waits until it says so. Must come in by the board's service port.
    ///
    /// # Errors
    /// As [`Session::install_key`].
    pub async fn remove_key(&self, board: &Board) -> Result<(), LinkError> {
        self.change_key(board, Key([0; 32]), 0, false).await
    }

    async fn change_key(&self, board: &Board, key: Key, time: u64, installs: bool) -> Result<(), LinkError> {
        let whom = board.target;
        let mut heard = self.listen();
        let deadline = Instant::now() + self.patience().silence;
        let mut said = None;
        while Instant::now() < deadline {
            self.send(move |sender| sender.setup_signing(whom, &key, time)).await?;
            let again = deadline.min(Instant::now() + self.patience().answer);
            while Instant::now() < again {
                let message = match timeout_at(again, heard.recv()).await {
                    Ok(Ok(message)) => message,
                    Ok(Err(RecvError::Lagged(_))) => continue,
                    Ok(Err(RecvError::Closed)) => return Err(LinkError::Ended),
                    Err(_) => break,
                };
                if [message.frame.system, message.frame.component] != whom {
                    continue;
                }
                // What it signs with says more than words that may be lost.
                if installs && Verifier::default().judge(Some(&key), &message.frame) == Trust::Verified {
                    return Ok(());
                }
                // Whether the words are believed does not matter: the key in use is what changes.
                if let Some(Incoming::Text { text, .. }) = &message.incoming {
                    if text.starts_with("key refused") {
                        return Err(LinkError::KeyRefused { said: Some(text.to_string()) });
                    }
                    if !installs && text.starts_with("key removed") {
                        return Ok(());
                    }
                    said = Some(text.to_string());
                }
            }
        }
        Err(LinkError::NoAnswer { question: Question::Key, within: self.patience().silence, said })
    }
}
