//! What the board is: where it is, what runs on it, how it writes whole numbers.

use adit_protocol::mavlink::{
    AUTOPILOT_COMPONENT, Autopilot, Encoding, Incoming, NO_AUTOPILOT, Target, command, message,
};

use super::commands::CommandOutcome;
use super::error::{LinkError, Question};
use super::session::{Dialogue, GROUND, Session, Step, Turn};

/// `MAV_PROTOCOL_CAPABILITY_PARAM_ENCODE_BYTEWISE`.
const BYTEWISE: u64 = 16;
/// `MAV_PROTOCOL_CAPABILITY_PARAM_ENCODE_C_CAST`.
const C_CAST: u64 = 131_072;

/// The board at the other end.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Board {
    /// Its system and component.
    pub target: Target,
    /// Its mode, as its heartbeat numbers it.
    pub mode: u32,
    /// How it writes whole numbers.
    pub encoding: Encoding,
    /// Major, minor, patch and kind of its program; `None` if it does not tell.
    pub version: Option<[u8; 4]>,
    /// Its chip's number.
    pub uid: Option<u64>,
    /// The autopilot of its vehicle, if one is heard.
    pub autopilot: Option<Autopilot>,
}

/// Capabilities, version, chip's number; `None` if the question is not understood.
type Answer = Option<(u64, [u8; 4], u64)>;

struct VersionDialogue {
    whom: Target,
}

impl Dialogue for VersionDialogue {
    type Answer = Answer;

    fn turn(&mut self, attempt: u32) -> Turn<Answer> {
        let whom = self.whom;
        let confirmation = u8::try_from(attempt).unwrap_or(u8::MAX);
        let parameters = [message::VERSION as f32, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0];
        Turn::Send(vec![Box::new(move |sender| {
            sender.command(whom, command::REQUEST_MESSAGE, confirmation, &parameters)
        })])
    }

    fn hear(&mut self, incoming: &Incoming) -> Step<Answer> {
        match incoming {
            Incoming::Version { capabilities, uid, version } => Step::Done(Some((*capabilities, *version, *uid))),
            Incoming::CommandAck { command: command::REQUEST_MESSAGE, result, target }
                if *target == GROUND && CommandOutcome::from(*result) != CommandOutcome::Accepted =>
            {
                Step::Done(None)
            }
            _ => Step::Nothing,
        }
    }
}

impl Session {
    /// Waits for the board's heartbeat and asks what it is.
    ///
    /// # Errors
    /// [`LinkError::NoBoard`], [`LinkError::NoAnswer`], [`LinkError::Ended`].
    pub async fn board(&self) -> Result<Board, LinkError> {
        let peer = self.wait_for_board().await?;
        let target = [peer.system, peer.component];
        let answer = self.lead(target, Question::Version, &mut VersionDialogue { whom: target }).await?;
        let is_autopilot = |other: &super::Peer| {
            other.system == peer.system && other.component == AUTOPILOT_COMPONENT && other.autopilot != NO_AUTOPILOT
        };
        let autopilot = self.heard().into_iter().find(is_autopilot).map(|other| Autopilot::from(other.autopilot));
        Ok(Board {
            target,
            mode: peer.mode,
            encoding: encoding(answer.map(|(capabilities, ..)| capabilities), autopilot),
            version: answer.map(|(_, version, _)| version),
            uid: answer.map(|(.., uid)| uid),
            autopilot,
        })
    }
}

impl Session {
    /// Major, minor, patch and kind of the program of the board's autopilot; `None` if it does not tell.
    ///
    /// # Errors
    /// [`LinkError::NoAnswer`], [`LinkError::Ended`].
    pub async fn autopilot_version(&self, board: &Board) -> Result<Option<[u8; 4]>, LinkError> {
        let whom = [board.target[0], AUTOPILOT_COMPONENT];
        let answer = self.lead(whom, Question::Version, &mut VersionDialogue { whom }).await?;
        Ok(answer.map(|(_, version, _)| version))
    }
}

/// What the board says itself goes before what its system's kind of autopilot suggests.
fn encoding(capabilities: Option<u64>, autopilot: Option<Autopilot>) -> Encoding {
    match capabilities {
        Some(bits) if bits & BYTEWISE != 0 => Encoding::Bytewise,
        Some(bits) if bits & C_CAST != 0 => Encoding::Cast,
        _ => Encoding::of(autopilot),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_the_board_says_of_its_numbers_goes_before_its_autopilot() {
        let ardupilot = Some(Autopilot::ArduPilot);
        assert_eq!(encoding(Some(BYTEWISE), ardupilot), Encoding::Bytewise);
        assert_eq!(encoding(Some(C_CAST), None), Encoding::Cast);
        assert_eq!(encoding(Some(0), ardupilot), Encoding::Cast);
        assert_eq!(encoding(None, None), Encoding::Bytewise);
    }
}
