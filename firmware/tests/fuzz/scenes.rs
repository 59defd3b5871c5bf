//! Real exchanges, written down for the corpus: every message that board, autopilot and ground station have for each other.

use adit_protocol::mavlink::{
    BOARD_COMPONENT, CAMERA_COMPONENT, CommandResult, Encoding, Key, OutFrame, Sender, Severity, Signer, Target, Value,
    VehicleBeat, command,
};

use crate::operation::{Case, Operation, Setup};
use crate::rig::{KEY, NEWEST};
use crate::speech::SYSTEM;

const BOARD: Target = [SYSTEM, BOARD_COMPONENT];
const CAMERA: Target = [SYSTEM, CAMERA_COMPONENT];
const ARDUPILOT: u8 = 3;
const PX4: u8 = 12;
/// Places of the modes in a `Note`.
const IDLE: u8 = 1;
const READY: u8 = 3;
const SCANNING: u8 = 4;

/// A scene in the making.
struct Scene {
    case: Case,
    autopilot: Sender,
    ground: Sender,
}

impl Scene {
    fn new(setup: u8) -> Self {
        let (mut autopilot, mut ground) = (Sender::new(SYSTEM, 1), Sender::new(255, 190));
        if Setup(setup).has(Setup::KEY) {
            let signer = |link| Some(Signer { key: Key(KEY), link, time: NEWEST + 300_000 });
            (autopilot.signer, ground.signer) = (signer(0), signer(1));
        }
        Self { case: Case { setup: Setup(setup), operations: Vec::new() }, autopilot, ground }
    }

    fn then(mut self, operation: Operation) -> Self {
        self.case.operations.push(operation);
        self
    }

    fn receive(self, port: u8, frame: &OutFrame) -> Self {
        self.then(Operation::Receive { port, bytes: frame.to_vec() })
    }

    /// The autopilot says something.
    fn autopilot(mut self, say: impl FnOnce(&mut Sender) -> OutFrame) -> Self {
        let frame = say(&mut self.autopilot);
        self.receive(0, &frame)
    }

    /// The ground station says something, by radio.
    fn ground(mut self, say: impl FnOnce(&mut Sender) -> OutFrame) -> Self {
        let frame = say(&mut self.ground);
        self.receive(0, &frame)
    }

    /// The same by cable.
    fn cable(mut self, say: impl FnOnce(&mut Sender) -> OutFrame) -> Self {
        let frame = say(&mut self.ground);
        self.receive(1, &frame)
    }

    fn beat(self, autopilot: u8, custom_mode: u32) -> Self {
        self.autopilot(|sender| sender.vehicle_heartbeat(VehicleBeat { autopilot, base_mode: 0x81, custom_mode }))
    }

    fn wait(self, ms: u64) -> Self {
        self.then(Operation::Wait { us: ms * 1000 })
    }

    fn note(self, mode: u8, limit_mps: Option<f32>) -> Self {
        let limit = limit_mps.map(f32::to_bits);
        self.then(Operation::Note { mode, limit, offset: Some(0.1_f32.to_bits()), captures: 1 })
    }

    fn drain(self) -> Self {
        self.then(Operation::Drain)
    }

    fn kept(self, ok: bool) -> Self {
        self.then(Operation::Kept { ok })
    }

    /// Some seconds of a scan, in which the autopilot tells a parameter whenever it may have been asked.
    fn scan(
        mut self,
        [autopilot, seconds]: [u8; 2],
        custom_mode: u32,
        limit_mps: f32,
        told: Option<(&str, f32)>,
    ) -> Self {
        for tick in 0..u32::from(seconds) * 2 {
            self = self.wait(500).beat(autopilot, custom_mode).note(SCANNING, Some(limit_mps)).drain();
            self = self.autopilot(|sender| sender.local_position(tick * 500, [0.0; 3], [limit_mps, 0.0, 0.0]));
            if let Some((name, value)) = told {
                self = self.tell(name, value);
            }
        }
        self
    }

    /// A flight along the axis at this speed, which is heard ten times a second.
    fn fly(mut self, ticks: u32, speed_mps: f32, limit_mps: f32) -> Self {
        for tick in 0..ticks {
            if tick % 10 == 0 {
                self = self.beat(ARDUPILOT, 3);
            }
            let velocity_mps = [speed_mps * 0.5_f32.cos(), speed_mps * 0.5_f32.sin(), 0.0];
            self = self.autopilot(|sender| sender.local_position(tick * 100, [0.0; 3], velocity_mps));
            self = self.note(SCANNING, Some(limit_mps)).drain().wait(100);
        }
        self
    }

    fn tell(self, name: &str, value: f32) -> Self {
        let raw = Value::Real(value).write(Encoding::Cast);
        self.autopilot(|sender| sender.parameter_value(name, raw, [7, 900]))
    }

    fn command(self, to: Target, number: u16, parameters: [f32; 7]) -> Self {
        self.ground(|sender| sender.command(to, number, 0, &parameters))
    }
}

const fn first(first: f32) -> [f32; 7] {
    [first, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0]
}

/// All scenes by name.
pub(crate) fn all() -> Vec<(String, Case)> {
    let mut all: Vec<(String, Case)> = Vec::new();
    for (suffix, setup) in [("", 0), ("-signed", Setup::KEY), ("-all-signed", Setup::KEY | Setup::SIGNED_TELEMETRY)] {
        let named = |(name, scene): (&str, Scene)| (format!("{name}{suffix}"), scene.case);
        all.extend(vehicle(setup).into_iter().chain(commands(setup)).chain(services(setup)).map(named));
    }
    all.extend(memory().into_iter().map(|(name, scene)| (name.into(), scene.case)));
    all
}

/// Limits in each way that an autopilot takes them.
fn vehicle(setup: u8) -> Vec<(&'static str, Scene)> {
    let leads = setup | Setup::LEADS | Setup::AXIS;
    vec![
        (
            "auto",
            Scene::new(setup)
                .scan([ARDUPILOT, 4], 3, 0.5, None)
                .autopilot(|sender| sender.command_ack(command::CHANGE_SPEED, CommandResult::Denied, BOARD)),
        ),
        // The axis lies at a yaw of half a radian.
        ("enforced", Scene::new(setup | Setup::AXIS).fly(20, 0.5, 0.5)),
        ("too-fast", Scene::new(setup | Setup::AXIS).fly(36, 0.9, 0.5)),
        ("guided", Scene::new(leads).scan([ARDUPILOT, 3], 4, 0.3, None)),
        (
            "loiter",
            Scene::new(setup)
                .scan([ARDUPILOT, 4], 5, 0.5, Some(("LOIT_SPEED", 1250.0)))
                .kept(true)
                .scan([ARDUPILOT, 3], 5, 0.4, Some(("LOIT_SPEED", 50.0)))
                .note(IDLE, None)
                .tell("LOIT_SPEED", 50.0)
                .wait(500)
                .drain()
                .tell("LOIT_SPEED", 1250.0)
                .kept(true),
        ),
        ("loiter-not-kept", Scene::new(setup).scan([ARDUPILOT, 4], 5, 0.5, Some(("LOIT_SPEED_MS", 12.5))).kept(false)),
        (
            "position",
            Scene::new(setup).scan([PX4, 3], 3 << 16, 0.5, Some(("MPC_VEL_MANUAL", 10.0))).kept(true).scan(
                [PX4, 3],
                3 << 16 | 2 << 24,
                0.2,
                Some(("MPC_VEL_MANUAL", 10.0)),
            ),
        ),
        (
            "telemetry",
            Scene::new(setup)
                .beat(PX4, 4 << 16 | 4 << 24)
                .autopilot(|sender| sender.attitude(1, [0.1, 0.2, 0.3]))
                .autopilot(|sender| sender.local_position(2, [1.0; 3], [0.3; 3]))
                .autopilot(|sender| sender.head_up(0.4))
                .note(SCANNING, Some(0.3))
                .drain()
                .wait(3_000)
                .note(SCANNING, Some(0.3))
                .drain(),
        ),
    ]
}

fn commands(setup: u8) -> Vec<(&'static str, Scene)> {
    let flight = Scene::new(setup)
        .beat(ARDUPILOT, 3)
        .note(IDLE, None)
        .autopilot(|sender| sender.attitude(1, [0.0, 0.0, 1.0]))
        .command(BOARD, command::ARM_DISARM, first(1.0))
        .note(READY, None)
        .command(CAMERA, command::START_CAPTURE, first(0.0))
        .note(SCANNING, Some(0.4))
        .then(Operation::Entry { kind: 0, capture: 1, state: 2 })
        .drain()
        .command(CAMERA, command::STOP_CAPTURE, first(0.0))
        .command(BOARD, command::ARM_DISARM, first(0.0));
    let mut questions = Scene::new(setup).beat(ARDUPILOT, 3).note(IDLE, None);
    for asked in [148.0, 259.0, 260.0, 261.0, 262.0, 263.0] {
        questions = questions.command(CAMERA, command::REQUEST_MESSAGE, first(asked)).drain();
    }
    vec![
        ("flight", flight),
        ("questions", questions),
        (
            "readdress",
            Scene::new(setup)
                .beat(ARDUPILOT, 3)
                .note(IDLE, None)
                .command(BOARD, command::READDRESS, [49.0, 50.0, 0.0, 0.0, 0.0, 0.0, 0.0])
                .command(BOARD, command::REBOOT, [0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0]),
        ),
        (
            "board-s-own-words",
            Scene::new(setup)
                .beat(ARDUPILOT, 3)
                .autopilot(|sender| {
                    sender.text(Severity::Info, &heapless::String::try_from("hello").unwrap_or_default())
                })
                .autopilot(|sender| sender.named_value(1, "speed", 0.1))
                .ground(Sender::ground_heartbeat)
                .ground(|sender| sender.tunnel(BOARD, 44_001, &[1, 2, 3]))
                .ground(|sender| sender.velocity_limits(BOARD, 1.0))
                .ground(|sender| sender.velocity_setpoint(BOARD, 1, [1.0; 3]))
                .ground(|sender| sender.time_sync(0, 77))
                .note(IDLE, None)
                .drain(),
        ),
    ]
}

fn services(setup: u8) -> Vec<(&'static str, Scene)> {
    let real = |value: f32| Value::Real(value).write(Encoding::Cast);
    vec![
        (
            "parameters",
            Scene::new(setup)
                .beat(ARDUPILOT, 3)
                .note(IDLE, None)
                .ground(|sender| sender.parameter_set(BOARD, "SPD_MARGIN", real(0.5)))
                .kept(true)
                .ground(|sender| sender.parameter_set(BOARD, "TUN_SHAPE", real(1.0)))
                .ground(|sender| sender.parameter_set(BOARD, "TUN_AXIS_M", real(7.0)))
                .kept(false)
                .ground(|sender| sender.parameter_list(BOARD))
                .ground(|sender| sender.parameter_read(BOARD, "SPD_MARGIN"))
                .ground(|sender| sender.parameter_read_at(BOARD, 3))
                .drain(),
        ),
        (
            "logs",
            Scene::new(setup)
                .beat(ARDUPILOT, 3)
                .note(IDLE, None)
                .cable(|sender| sender.log_list(BOARD))
                .then(Operation::Logs { kind: 0, length: 20 })
                .drain()
                .cable(|sender| sender.log_request(BOARD, 3, 0, 1000))
                .then(Operation::Logs { kind: 0, length: 0 })
                .drain()
                .wait(200)
                .then(Operation::Logs { kind: 1, length: 100 })
                .drain()
                .cable(|sender| sender.log_end(BOARD)),
        ),
        (
            "key",
            Scene::new(setup)
                .beat(ARDUPILOT, 3)
                .note(IDLE, None)
                .cable(|sender| sender.setup_signing(BOARD, &Key(KEY), NEWEST))
                .kept(true)
                .command(BOARD, command::ARM_DISARM, first(1.0))
                .drain()
                .cable(|sender| sender.setup_signing(BOARD, &Key([0; 32]), 0))
                .drain(),
        ),
        (
            "log-entries",
            Scene::new(setup)
                .autopilot(|sender| sender.log_entry([1, 2, 3], 4))
                .autopilot(|sender| sender.log_data(1, 2, &[3; 90])),
        ),
    ]
}

/// What a run before has borrowed, given back.
fn memory() -> Vec<(&'static str, Scene)> {
    let returned = |place: u8, autopilot: u8, name: &str, old: f32| {
        Scene::new(place << Setup::BORROWED)
            .beat(autopilot, 3)
            .note(IDLE, None)
            .drain()
            .tell(name, 20.0)
            .wait(500)
            .drain()
            .tell(name, old)
            .kept(true)
    };
    vec![
        ("returned-centimetres", returned(1, ARDUPILOT, "LOIT_SPEED", 1250.0)),
        ("returned-metres", returned(2, ARDUPILOT, "LOIT_SPEED_MS", 12.5)),
        ("returned-px4", returned(3, PX4, "MPC_VEL_MANUAL", 10.0)),
    ]
}
