//! Which frame goes where: an autopilot passes on what is not for it alone.
//!
//! As `ArduPilot` does it (mavlink.io, "Routing"): a message without a target, or for everybody, goes to all; one for a component
//! goes to the line on which that component is. Of the target's offset in each message nobody tells but `common.xml`.

use adit_protocol::mavlink::{AUTOPILOT_COMPONENT, FrameDecoder, RawFrame};

use super::SYSTEM;

/// Messages that name whom they are for, and where system and component stand.
const TARGETS: [(u32, usize); 30] = [
    (4, 12),
    (20, 2),
    (21, 0),
    (23, 4),
    (40, 2),
    (43, 0),
    (44, 2),
    (45, 0),
    (47, 0),
    (51, 2),
    (66, 2),
    (70, 16),
    (73, 32),
    (75, 30),
    (76, 30),
    (77, 8),
    (84, 50),
    (86, 50),
    (110, 1),
    (111, 16),
    (117, 4),
    (119, 10),
    (121, 0),
    (122, 0),
    (256, 8),
    (320, 2),
    (321, 0),
    (323, 0),
    (354, 12),
    (385, 2),
];
/// `SET_MODE` names a system only.
const SET_MODE: (u32, usize) = (11, 4);

/// System and component that a frame is for; zeros for everybody.
fn target(frame: &RawFrame) -> [u8; 2] {
    if frame.message == SET_MODE.0 {
        return [frame.u8(SET_MODE.1), AUTOPILOT_COMPONENT];
    }
    TARGETS.iter().find(|(message, _)| *message == frame.message).map_or([0; 2], |(_, offset)| frame.bytes(*offset))
}

/// Whether a frame is to be seen on the board's line.
pub fn is_for_board(frame: &RawFrame) -> bool {
    let [system, component] = target(frame);
    matches!(system, 0 | SYSTEM) && component != AUTOPILOT_COMPONENT
}

/// Whether a frame is to be seen on the ground station's line.
pub fn is_for_ground(frame: &RawFrame) -> bool {
    let [system, component] = target(frame);
    system != SYSTEM || component == 0
}

/// Whole frames out of bytes, those that are to be passed on.
#[derive(Clone, Debug, Default)]
pub struct Sieve(FrameDecoder);

impl Sieve {
    /// The bytes of the frames that pass.
    pub fn pass(&mut self, bytes: &[u8], passes: impl Fn(&RawFrame) -> bool) -> Vec<u8> {
        let frames = bytes.iter().filter_map(|byte| self.0.push(*byte));
        frames.filter(|frame| passes(frame)).flat_map(|frame| frame.wire().to_vec()).collect()
    }
}

#[cfg(test)]
mod tests {
    use adit_protocol::mavlink::{CommandResult, Sender};

    use super::*;

    /// Board and ground: who sees it?
    fn seen(frame: &[u8]) -> [bool; 2] {
        let passes = |passes: fn(&RawFrame) -> bool| !Sieve::default().pass(frame, passes).is_empty();
        [passes(is_for_board), passes(is_for_ground)]
    }

    #[test]
    fn what_is_for_everybody_goes_to_all() {
        let mut ground = Sender::new(255, 190);
        assert_eq!(seen(&ground.ground_heartbeat()), [true, true]);
        assert_eq!(seen(&ground.parameter_list([SYSTEM, 0])), [true, true]);
        assert_eq!(seen(&ground.tunnel([0, 0], 1, &[1])), [true, true]);
    }

    #[test]
    fn what_is_for_one_goes_to_that_one() {
        let mut sender = Sender::new(255, 190);
        for (component, to_board) in [(1, false), (191, true), (100, true)] {
            let to = [SYSTEM, component];
            let frames = [
                sender.command(to, 400, 0, &[0.0; 7]),
                sender.parameter_read(to, "A"),
                sender.parameter_list(to),
                sender.parameter_set(
                    to,
                    "A",
                    adit_protocol::mavlink::Value::Real(1.0).write(adit_protocol::mavlink::Encoding::Cast),
                ),
                sender.log_list(to),
                sender.log_request(to, 1, 2, 3),
                sender.log_end(to),
                sender.velocity_limits(to, 0.4),
                sender.tunnel(to, 1, &[1]),
                sender.command_ack(400, CommandResult::Accepted, to),
            ];
            for frame in frames {
                assert_eq!(seen(&frame), [to_board, false], "{frame:?}");
            }
        }
        assert_eq!(seen(&sender.command_ack(400, CommandResult::Accepted, [255, 190])), [false, true]);
    }
}
