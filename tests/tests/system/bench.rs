//! A vehicle on the bench: the board's own logic and link in the simulator's world, an autopilot by name, a card, and a TCP
//! line on which a ground station is awaited. It keeps to the clock on the wall, for ground stations do.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::{JoinHandle, sleep};
use std::time::{Duration, Instant};

use adit_firmware::controller::Controller;
use adit_firmware::io::{Inputs, Outputs};
use adit_firmware::link::{Diagnosis, Keep, Link, LogAnswer, LogWish, Memory, Port, READ_BYTES, measured_m};
use adit_hil_sim::autopilot::routing::Sieve;
use adit_hil_sim::autopilot::wire::Wire;
use adit_hil_sim::autopilot::{Kind, NamedAutopilot, SYSTEM, Seen};
use adit_hil_sim::config::Simulation;
use adit_hil_sim::faults::{Fault, FaultKind};
use adit_hil_sim::flight::watcher::Watcher;
use adit_hil_sim::peer::Peer;
use adit_hil_sim::scene::Wall;
use adit_hil_sim::world::{PilotAction, World};
use adit_protocol::beams::Beam;
use adit_protocol::log::{encode_entry, encode_header};
use adit_protocol::mavlink::{Sender, command};
use adit_protocol::mission::Mission;
use adit_protocol::parameters::Parameters;
use adit_protocol::record::Header;

/// From a command to restart until the board is gone: its answer has to get through.
const FAREWELL_S: f64 = 0.2;
const TIMESYNC: u32 = 111;

/// What stands on the bench.
#[derive(Clone)]
pub(crate) struct Setup {
    pub(crate) mission: Mission,
    /// As the board's memory has them.
    pub(crate) parameters: Parameters,
    pub(crate) autopilot: Kind,
    pub(crate) mode: &'static str,
    pub(crate) armed: bool,
    /// Where in the section it hovers, right and down.
    pub(crate) hold_m: [f64; 2],
    pub(crate) faults: Vec<FaultKind>,
    pub(crate) has_card: bool,
    /// Does the board answer questions for its time?
    pub(crate) tells_time: bool,
    /// How fast its clock runs.
    pub(crate) clock_rate: f64,
}

impl Setup {
    /// A vehicle without fault, disarmed, in a mode that takes the limit.
    pub(crate) fn good(mission: &Mission) -> Self {
        Self {
            mission: mission.clone(),
            parameters: mission.parameters(),
            autopilot: Kind::ArduPilot47,
            mode: "AUTO",
            armed: false,
            hold_m: [0.0; 2],
            faults: Vec::new(),
            has_card: true,
            tells_time: true,
            clock_rate: 1.0,
        }
    }
}

/// The bench; it is cleared when dropped.
pub(crate) struct Bench {
    connection: String,
    stops: Arc<AtomicBool>,
    thread: Option<JoinHandle<()>>,
}

impl Bench {
    pub(crate) fn start(setup: Setup) -> Self {
        let (port, peer) = (0..100).find_map(|_| awaited()).expect("a port that nobody else takes");
        let stops = Arc::new(AtomicBool::new(false));
        let flag = Arc::clone(&stops);
        let thread = std::thread::spawn(move || {
            let mut vehicle = Vehicle::new(setup, peer);
            let began = Instant::now();
            while !flag.load(Ordering::Relaxed) {
                let now_s = vehicle.step();
                sleep(Duration::from_secs_f64(now_s).saturating_sub(began.elapsed()));
            }
        });
        Self { connection: format!("tcpout:127.0.0.1:{port}"), stops, thread: Some(thread) }
    }

    /// Where a ground station finds it.
    pub(crate) fn connection(&self) -> &str {
        &self.connection
    }
}

impl Drop for Bench {
    fn drop(&mut self) {
        self.stops.store(true, Ordering::Relaxed);
        let ended = self.thread.take().map(JoinHandle::join);
        // A failing test says more than a bench that broke with it.
        assert!(std::thread::panicking() || !matches!(ended, Some(Err(_))), "the bench broke");
    }
}

/// A free port, and a ground station awaited there; `None` if somebody else was quicker.
fn awaited() -> Option<(u16, Peer)> {
    let port = std::net::TcpListener::bind("127.0.0.1:0").and_then(|probe| probe.local_addr()).ok()?.port();
    let connection = format!("tcpin:127.0.0.1:{port}").parse().ok()?;
    Some((port, Peer::open(&connection).ok()?))
}

/// What runs between two starts of the board.
struct Board {
    controller: Controller,
    link: Link,
    began_s: f64,
    is_keeping: bool,
    restarts_at_s: Option<f64>,
}

impl Board {
    fn start(parameters: &Parameters, began_s: f64) -> Self {
        Self {
            controller: Controller::new(parameters.clone()),
            link: Link::new(parameters, Memory::default(), 1),
            began_s,
            is_keeping: false,
            restarts_at_s: None,
        }
    }
}

struct Vehicle {
    setup: Setup,
    world: World,
    inputs: Inputs,
    board: Board,
    autopilot: NamedAutopilot,
    wire: Wire,
    ground: Watcher,
    from_board: Sieve,
    logs: Vec<Vec<u8>>,
}

impl Vehicle {
    fn new(setup: Setup, peer: Peer) -> Self {
        let mut simulation = Simulation {
            faults: setup.faults.iter().map(|kind| Fault { kind: *kind, at_s: 0.0, for_s: None }).collect(),
            ..Simulation::default()
        };
        simulation.autopilot.hold_m = setup.hold_m;
        let profile = setup.mission.survey.profile.build().expect("a profile");
        let wall = Wall::new(profile, &simulation.wall, 1).expect("a wall");
        let world = World::new(wall, &setup.mission.survey.rig, &setup.mission.parameters(), &simulation, 1);
        let mut autopilot = NamedAutopilot::new(setup.autopilot);
        autopilot.set_mode(setup.autopilot.mode(setup.mode).expect("a mode"));
        if !setup.armed {
            let disarm = Sender::new(255, 190).command([SYSTEM, 1], command::ARM_DISARM, 0, &[0.0; 7]);
            autopilot.hear(0.0, &disarm);
        }
        let board = Board::start(&setup.parameters, 0.0);
        let mut vehicle = Self {
            world,
            inputs: Inputs::default(),
            board,
            autopilot,
            wire: Wire::new(0.005, &[]),
            ground: Watcher::new(peer),
            from_board: Sieve::default(),
            logs: Vec::new(),
            setup,
        };
        vehicle.begin_log();
        vehicle
    }

    fn begin_log(&mut self) {
        let header = Header::new(&self.setup.parameters, "bench").and_then(|header| encode_header(&header));
        self.logs.push(header.expect("a header").to_vec());
    }

    /// Goes on by one step of the world; returns its time.
    fn step(&mut self) -> f64 {
        let now_s = self.world.now_s();
        if self.board.restarts_at_s.is_some_and(|at_s| now_s >= at_s) {
            self.board = Board::start(&self.setup.parameters, now_s);
            self.begin_log();
        }
        let now_us = ((now_s - self.board.began_s) * 1e6 * self.setup.clock_rate) as u64;
        self.carry(now_s);
        let arrived = self.wire.at_board(now_s);
        let link = &mut self.board.link;
        link.receive(now_us, Port::Autopilot, &arrived);
        let mut inputs = self.inputs;
        link.vehicle(now_us).fill(&mut inputs);
        (inputs.command, inputs.log_lost) = (link.take_command(), !self.setup.has_card);
        let outputs = self.board.controller.step(now_us, &inputs);
        self.publish(now_s, now_us, &outputs);
        self.inputs = self.world.step(&outputs, PilotAction::default());
        now_s
    }

    /// Carries what was said to whom it is for.
    fn carry(&mut self, now_s: f64) {
        let seen = seen(&self.inputs);
        let said = self.autopilot.say(now_s, seen.as_ref());
        self.wire.from_autopilot(now_s, &said);
        let heard = self.wire.at_autopilot(now_s);
        self.autopilot.hear(now_s, &heard);
        // A ground station that has gone may come back.
        let _ = self.ground.tell(&said, &heard);
        if let Ok(asked) = self.ground.ask() {
            self.autopilot.hear(now_s, &asked.for_autopilot);
            self.wire.from_autopilot(now_s, &asked.for_board);
        }
    }

    fn publish(&mut self, now_s: f64, now_us: u64, outputs: &Outputs) {
        let Self { board, setup, logs, wire, from_board, .. } = self;
        for entry in &outputs.entries {
            board.link.note_entry(entry);
            if let (Some(log), Ok(frame)) = (logs.last_mut(), encode_entry(entry)) {
                log.extend_from_slice(&frame);
            }
        }
        let readings = Beam::ALL.map(|beam| self.inputs.ranges.get(beam).reading);
        board.link.note(now_us, outputs, measured_m(readings), Diagnosis::default());
        if std::mem::take(&mut board.is_keeping) {
            board.link.kept(true);
        }
        if let Some(keep) = board.link.take_keep(now_us) {
            board.is_keeping = true;
            if let Keep::Parameters(parameters) = keep {
                setup.parameters = parameters;
            }
        }
        if let Some(wish) = board.link.take_log_wish() {
            board.link.hear_logs(wish, if setup.has_card { answer(logs, wish) } else { nothing(wish) });
        }
        if board.link.take_restart() {
            board.restarts_at_s = Some(now_s + FAREWELL_S);
        }
        while let Some((ports, frame)) = board.link.next_frame(now_us) {
            if ports.contains(Port::Autopilot) {
                let passed = from_board.pass(&frame, |frame| setup.tells_time || frame.message != TIMESYNC);
                wire.from_board(now_s, &passed);
            }
        }
    }
}

/// What the card says. Logs are numbered from 1.
fn answer(logs: &[Vec<u8>], wish: LogWish) -> LogAnswer {
    match wish {
        LogWish::List => LogAnswer::List((1..).zip(logs.iter().map(|log| log.len() as u32)).collect()),
        LogWish::Read { number, offset } => {
            let log = usize::from(number).checked_sub(1).and_then(|index| logs.get(index));
            let rest = log.and_then(|log| log.get(offset as usize..)).unwrap_or_default();
            LogAnswer::Read(rest.iter().copied().take(READ_BYTES).collect())
        }
    }
}

fn nothing(wish: LogWish) -> LogAnswer {
    answer(&[], wish)
}

/// What the vehicle's estimator tells its autopilot.
fn seen(inputs: &Inputs) -> Option<Seen> {
    Some(Seen {
        attitude_rad: inputs.attitude_rad?.map(f64::from),
        place_m: f64::from(inputs.odometer_m?),
        speed_mps: f64::from(inputs.speed_mps?),
        axis_yaw_rad: 0.7,
    })
}
