//! Commands to the board: what they mean, whether they can be obeyed now, and what is answered.

use adit_protocol::mavlink::{CAMERA_COMPONENT, CommandResult, Target, command, message};
use adit_protocol::record::Mode;

use super::camera::Captures;
use super::{Port, Readdressing, Timed};
use crate::io::Command;
use crate::time::has_passed;

/// A command that is repeated within this is the same one.
const REPEATED_S: f32 = 1.0;
/// Addresses that the I2C specification does not keep for itself.
const ADDRESS_MIN: u8 = 0x08;
const ADDRESS_MAX: u8 = 0x77;

/// A command as it came.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Order {
    /// Where it came in.
    pub(super) port: Port,
    /// Who gave it.
    pub(super) from: Target,
    /// Which of our components it is for.
    pub(super) component: u8,
    /// Which it is.
    pub(super) command: u16,
    /// How often it was repeated.
    pub(super) confirmation: u8,
    /// Its parameters.
    pub(super) parameters: [f32; 7],
}

/// What is answered.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Reply {
    /// To a command.
    Ack {
        /// By whom.
        component: u8,
        /// Which command.
        number: u16,
        /// What became of it.
        result: CommandResult,
        /// Who had given it.
        to: Target,
    },
    /// The time.
    TimeSync {
        /// The asking clock.
        asked_ns: i64,
    },
    /// What the component is.
    Version {
        /// Which.
        component: u8,
    },
    /// What the camera is.
    CameraInformation,
    /// What it is set to.
    CameraSettings,
    /// Where its photos go.
    Storage,
    /// What it does.
    CaptureStatus,
}

/// What was commanded and is to be answered.
#[derive(Clone, Debug, Default)]
pub(super) struct Commands {
    command: Option<Command>,
    readdressing: Option<Readdressing>,
    restart: bool,
    last: Timed<u16>,
    replies: heapless::Deque<(Port, Reply), 8>,
}

/// Whether a command only asks.
pub(super) fn is_question(number: u16) -> bool {
    matches!(
        number,
        command::REQUEST_MESSAGE
            | command::REQUEST_CAPABILITIES
            | command::REQUEST_CAMERA_INFORMATION
            | command::REQUEST_CAMERA_SETTINGS
            | command::REQUEST_STORAGE_INFORMATION
            | command::REQUEST_CAPTURE_STATUS
    )
}

impl Commands {
    pub(super) fn take_command(&mut self) -> Option<Command> {
        self.command.take()
    }

    pub(super) fn take_readdressing(&mut self) -> Option<Readdressing> {
        self.readdressing.take()
    }

    pub(super) fn take_restart(&mut self) -> bool {
        core::mem::take(&mut self.restart)
    }

    pub(super) fn take_reply(&mut self) -> Option<(Port, Reply)> {
        self.replies.pop_front()
    }

    /// Queues an answer; who gets none asks again.
    pub(super) fn reply(&mut self, port: Port, reply: Reply) {
        let _ = self.replies.push_back((port, reply));
    }

    /// Obeys, and answers. Returns the command if it is given to the controller now.
    pub(super) fn obey(&mut self, now_us: u64, mode: Mode, order: Order, captures: &mut Captures) -> Option<Command> {
        let Order { port, from: to, component, command: number, .. } = order;
        if is_question(number) {
            let asked = asked(&order);
            let known = asked == message::IMAGE_CAPTURED && captures.tell_again(order.parameters[1] as i32);
            let reply = reply(asked, component);
            let result = if known || reply.is_some() { CommandResult::Accepted } else { CommandResult::Unsupported };
            self.reply(port, Reply::Ack { component, number, result, to });
            if let Some(reply) = reply {
                self.reply(port, reply);
            }
            return None;
        }
        let (result, wanted) = judge(mode, &order);
        self.reply(port, Reply::Ack { component, number, result, to });
        let repeated = self.last.is_some_and(|(last, at_us)| {
            order.confirmation > 0 && last == number && !has_passed(at_us, now_us, REPEATED_S)
        });
        self.last = Some((number, now_us));
        if repeated || result != CommandResult::Accepted {
            return None;
        }
        match number {
            command::READDRESS => self.readdressing = readdressing(&order).or(self.readdressing),
            command::REBOOT => self.restart = true,
            _ => self.command = wanted.or(self.command),
        }
        wanted
    }
}

/// What a command would do now, and its answer.
fn judge(mode: Mode, order: &Order) -> (CommandResult, Option<Command>) {
    let [first, second, third, ..] = order.parameters;
    let rests = matches!(mode, Mode::Idle | Mode::Fault);
    let now_if = |may: bool| if may { CommandResult::Accepted } else { CommandResult::TemporarilyRejected };
    match order.command {
        command::ARM_DISARM if first == 1.0 => {
            (now_if(matches!(mode, Mode::Idle | Mode::SelfTest | Mode::Ready)), Some(Command::Arm))
        }
        command::ARM_DISARM if first == 0.0 => (CommandResult::Accepted, Some(Command::Disarm)),
        // A single photo is no scan.
        command::START_CAPTURE if order.component == CAMERA_COMPONENT && third == 1.0 => (CommandResult::Denied, None),
        command::START_CAPTURE => {
            (now_if(matches!(mode, Mode::Ready | Mode::Scanning | Mode::Degraded)), Some(Command::Start))
        }
        command::STOP_CAPTURE => (CommandResult::Accepted, Some(Command::Stop)),
        command::READDRESS if readdressing(order).is_none() => (CommandResult::Denied, None),
        command::READDRESS => (now_if(rests), None),
        // The second parameter is for onboard computers; 1 restarts.
        command::REBOOT if second == 1.0 => (now_if(rests), None),
        command::REBOOT | command::ARM_DISARM => (CommandResult::Denied, None),
        _ => (CommandResult::Unsupported, None),
    }
}

/// The message that a question asks for.
fn asked(order: &Order) -> u32 {
    match order.command {
        command::REQUEST_CAPABILITIES => message::VERSION,
        command::REQUEST_CAMERA_INFORMATION => message::CAMERA_INFORMATION,
        command::REQUEST_CAMERA_SETTINGS => message::CAMERA_SETTINGS,
        command::REQUEST_STORAGE_INFORMATION => message::STORAGE_INFORMATION,
        command::REQUEST_CAPTURE_STATUS => message::CAPTURE_STATUS,
        _ => order.parameters[0] as u32,
    }
}

/// The answer, if it is one message.
fn reply(asked: u32, component: u8) -> Option<Reply> {
    Some(match asked {
        message::VERSION => Reply::Version { component },
        message::CAMERA_INFORMATION => Reply::CameraInformation,
        message::CAMERA_SETTINGS => Reply::CameraSettings,
        message::STORAGE_INFORMATION => Reply::Storage,
        message::CAPTURE_STATUS => Reply::CaptureStatus,
        _ => return None,
    })
}

/// Two addresses that a sensor may have, or `None`.
fn readdressing(order: &Order) -> Option<Readdressing> {
    let [from, to, ..] = order.parameters;
    let address = |value: f32| {
        let address = value as u8;
        (f32::from(address) == value && (ADDRESS_MIN..=ADDRESS_MAX).contains(&address)).then_some(address)
    };
    Some(Readdressing { from: address(from)?, to: address(to)? })
}
