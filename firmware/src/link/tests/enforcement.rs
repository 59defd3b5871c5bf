//! The limit against autopilots of a few lines; `hil-sim/tests/enforcement` flies against whole ones.

use adit_protocol::telemetry::Enforcement;

use super::*;

/// An autopilot whose speed follows what it is told, or does not.
struct Toy {
    sender: Sender,
    beat: VehicleBeat,
    speed_mps: f32,
    told_mps: f32,
    obeys: bool,
    answer: u8,
}

impl Toy {
    fn new(custom_mode: u32) -> Self {
        let beat = VehicleBeat { custom_mode, ..AUTO };
        Self { sender: autopilot(), beat, speed_mps: 1.5, told_mps: 1.5, obeys: true, answer: 0 }
    }

    /// Runs both sides; returns the speeds asked for by command, and the texts.
    fn run(&mut self, link: &mut Link, from_s: u64, to_s: u64, limit_mps: Option<f32>) -> (Vec<f32>, Vec<String>) {
        let (mut asked, mut heard) = (Vec::new(), Vec::new());
        for now_us in (from_s * 1_000_000..to_s * 1_000_000).step_by(5_000) {
            if now_us % 500_000 == 0 {
                link.receive(now_us, Port::Autopilot, &self.sender.vehicle_heartbeat(self.beat));
            }
            if now_us % 50_000 == 0 {
                let aim_mps = if self.obeys { self.told_mps.min(1.5) } else { 1.5 };
                self.speed_mps += (aim_mps - self.speed_mps).clamp(-0.05, 0.05);
                let velocity_mps = [self.speed_mps, 0.0, 0.0];
                let position = self.sender.local_position((now_us / 1000) as u32, [0.0; 3], velocity_mps);
                link.receive(now_us, Port::Autopilot, &position);
            }
            let mode = if limit_mps.is_some() { Mode::Scanning } else { Mode::Ready };
            step(link, now_us, mode, limit_mps);
            let said = said(link, now_us);
            heard.extend(texts(&said).into_iter().filter(|text| !text.starts_with("rotator:")));
            for incoming in said {
                if let Incoming::Command { command: 178, parameters: [_, speed_mps, ..], .. } = incoming {
                    asked.push(speed_mps);
                    self.told_mps = speed_mps;
                    let answer = adit_protocol::mavlink::CommandResult::Accepted;
                    let mut frame = self.sender.command_ack(178, answer, [3, 191]);
                    if self.answer != 0 {
                        frame = self.sender.command_ack(178, adit_protocol::mavlink::CommandResult::Failed, [3, 191]);
                    }
                    link.receive(now_us, Port::Autopilot, &frame);
                }
            }
        }
        (asked, heard)
    }
}

#[test]
fn a_limit_is_repeated_told_soon_when_it_changes_and_proven_by_the_speed() {
    let (mut link, mut toy) = (link(), Toy::new(3));
    let (asked, heard) = toy.run(&mut link, 0, 5, Some(0.3));
    assert!((5..=7).contains(&asked.len()) && asked.iter().all(|asked| *asked == 0.3), "{asked:?}");
    assert_eq!(heard, ["limit 0.30 m/s in force in AUTO"]);
    assert_eq!(link.enforcement(), Enforcement::Enforced);
    let (asked, _) = toy.run(&mut link, 5, 6, Some(0.15));
    assert_eq!(asked.first(), Some(&0.15));
    let (asked, _) = toy.run(&mut link, 6, 8, None);
    assert_eq!((asked.len(), link.enforcement()), (0, Enforcement::Idle));
}

#[test]
fn an_answer_is_no_proof_when_the_vehicle_flies_on() {
    let (mut link, mut toy) = (link(), Toy::new(3));
    toy.obeys = false;
    let (_, heard) = toy.run(&mut link, 0, 3, Some(0.3));
    assert_eq!((heard, link.enforcement()), (vec![], Enforcement::Requested));
    let (_, heard) = toy.run(&mut link, 3, 4, Some(0.3));
    assert_eq!(heard, ["TOO FAST: 1.50 m/s, limit 0.30 ignored"]);
    assert_eq!(link.enforcement(), Enforcement::Ineffective);
    // Obeying ends it.
    toy.obeys = true;
    toy.run(&mut link, 4, 9, Some(0.3));
    assert_eq!(link.enforcement(), Enforcement::Enforced);
}

#[test]
fn a_refusal_is_told() {
    let (mut link, mut toy) = (link(), Toy::new(3));
    (toy.answer, toy.speed_mps, toy.obeys) = (4, 0.2, false);
    let (_, heard) = toy.run(&mut link, 0, 1, Some(0.3));
    assert_eq!(heard, ["autopilot refuses 0.30 m/s in AUTO"]);
}

#[test]
fn a_mode_that_takes_no_limit_and_a_limit_below_its_floor_are_told_at_once() {
    for (mode, limit_mps, words) in [
        (2, 0.3, "ALT_HOLD takes no limit: keep below 0.30 m/s"),
        (3, 0.05, "AUTO takes 0.10 at least: keep below 0.05"),
    ] {
        let (mut link, mut toy) = (link(), Toy::new(mode));
        let (_, heard) = toy.run(&mut link, 0, 1, Some(limit_mps));
        assert_eq!(heard, [words]);
        assert_eq!(link.enforcement(), Enforcement::NotPossible);
        // Said again only after a while.
        let (_, heard) = toy.run(&mut link, 1, 7, Some(limit_mps));
        assert_eq!(heard, [words]);
    }
}

#[test]
fn without_an_autopilot_the_pilot_is_told() {
    let mut link = Link::new(&parameters(), Memory::default(), 7);
    step(&mut link, 0, Mode::Scanning, Some(0.3));
    assert_eq!(texts(&said(&mut link, 0)), ["limit 0.30 m/s: no autopilot heard"]);
}

#[test]
fn a_change_of_mode_is_answered_at_once() {
    let (mut link, mut toy) = (link(), Toy::new(3));
    toy.run(&mut link, 0, 4, Some(0.3));
    // The autopilot forgets the limit when it changes its mode.
    (toy.beat.custom_mode, toy.told_mps) = (6, 1.5);
    link.receive(4_000_000, Port::Autopilot, &toy.sender.vehicle_heartbeat(toy.beat));
    step(&mut link, 4_000_000, Mode::Scanning, Some(0.3));
    let asks = said(&mut link, 4_000_000);
    assert!(asks.iter().any(|ask| matches!(ask, Incoming::Command { command: 178, .. })));
}

#[test]
fn the_board_leads_no_faster_than_the_limit_and_back_to_the_axis() {
    let mut parameters = parameters();
    parameters.link.lead_mps = 0.5;
    let mut link = link_with(&parameters, Memory::default());
    let guided = VehicleBeat { custom_mode: 4, ..AUTO };
    link.receive(0, Port::Autopilot, &autopilot().vehicle_heartbeat(guided));
    let mut scan = outputs(Mode::Scanning, Some(0.3));
    scan.centring = Some(crate::io::CentringStatus {
        offset_m: [0.2, -1.0],
        sigma_m: [0.01; 2],
        used: adit_protocol::beams::Beams { up: true, right: true, down: false, left: true },
    });
    link.note(0, &scan, [None; 4], Diagnosis::default());
    // SET_POSITION_TARGET_LOCAL_NED: velocity at 16, the mask at 48.
    let sent = frames(&mut link, 0);
    let setpoint = sent.iter().find(|frame| frame.message == 84).expect("a setpoint");
    let velocity_mps = [16, 20, 24].map(|offset| setpoint.f32(offset));
    assert!((velocity_mps[1] + 0.08).abs() < 1e-6, "{velocity_mps:?}");
    assert_eq!((velocity_mps[0], velocity_mps[2], setpoint.u16(48) & 0x38), (0.3, 0.15, 0));
}
