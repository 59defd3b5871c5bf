//! The table of docs/security.md, row by row, as far as the link itself answers for it.

use adit_protocol::mavlink::signing::UNITS_PER_S;

use super::*;

const KEY: Key = Key([0x5A; 32]);
/// A ground station's clock.
const NOW: u64 = 40_000_000 * UNITS_PER_S;

fn locked() -> Link {
    let streams = Streams::starting_at(NOW - 10 * UNITS_PER_S);
    let mut link = link_with(&parameters(), Memory { key: Some(KEY), streams, ..Memory::default() });
    step(&mut link, 0, Mode::Ready, None);
    link
}

fn signing(key: Key, time: u64) -> Sender {
    let mut sender = ground();
    sender.signer = Some(Signer { key, link: 3, time });
    sender
}

fn start(sender: &mut Sender) -> OutFrame {
    sender.command(BOARD, 2000, 0, &[0.0; 7])
}

/// Whether bytes on the autopilot's port make the board start; it says nothing to who may not.
fn starts(link: &mut Link, bytes: &[u8]) -> bool {
    link.receive(1_000, Port::Autopilot, bytes);
    let started = link.take_command().is_some();
    let answers = results(&said(link, 1_000));
    assert_eq!(answers.len(), usize::from(started), "who may not gets no answer");
    started
}

#[test]
fn with_a_key_only_its_owner_commands() {
    let mut link = locked();
    assert!(!starts(&mut link, &start(&mut ground())), "unsigned");
    assert!(!starts(&mut link, &start(&mut signing(Key([1; 32]), NOW))), "forged key");
    assert!(starts(&mut link, &start(&mut signing(KEY, NOW))), "its owner");
}

#[test]
fn a_frame_that_is_sent_again_or_was_changed_or_is_old_has_no_effect() {
    let mut link = locked();
    let frame = start(&mut signing(KEY, NOW));
    assert!(starts(&mut link, &frame));
    assert!(!starts(&mut link, &frame), "replay");
    assert!(!starts(&mut link, &start(&mut signing(KEY, NOW - 10))), "rollback of the clock");
    let mut other = ground();
    other.signer = Some(Signer { key: KEY, link: 4, time: NOW - 61 * UNITS_PER_S });
    assert!(!starts(&mut link, &start(&mut other)), "a new stream more than a minute late");
    assert!(starts(&mut link, &start(&mut signing(KEY, NOW + 10))));
}

#[test]
fn what_was_heard_before_a_restart_is_not_heard_again() {
    let mut link = locked();
    let frame = start(&mut signing(KEY, NOW));
    assert!(starts(&mut link, &frame));
    let Some(Keep::Streams(streams)) = link.take_keep(1_000_000) else { panic!("nothing kept") };
    // Heard after the last time that anything was kept.
    let later = start(&mut signing(KEY, NOW + UNITS_PER_S / 2));
    assert!(starts(&mut link, &later));
    let mut again = link_with(&parameters(), Memory { key: Some(KEY), streams, ..Memory::default() });
    step(&mut again, 0, Mode::Ready, None);
    assert!(!starts(&mut again, &frame) && !starts(&mut again, &later));
    assert!(starts(&mut again, &start(&mut signing(KEY, NOW + 3 * UNITS_PER_S))));
}

#[test]
fn an_unsigned_change_of_a_parameter_has_no_effect() {
    let mut link = locked();
    let change =
        |sender: &mut Sender| sender.parameter_set(BOARD, "SPD_MARGIN", Value::Real(0.1).write(Encoding::Cast));
    link.receive(0, Port::Autopilot, &change(&mut ground()));
    assert!(!matches!(link.take_keep(0), Some(Keep::Parameters(_))));
    link.kept(true);
    assert!(texts(&said(&mut link, 0)).contains(&"refused request of 255/190: unsigned".to_owned()));
    link.receive(0, Port::Autopilot, &change(&mut signing(KEY, NOW)));
    assert!(matches!(link.take_keep(0), Some(Keep::Parameters(_))));
}

#[test]
fn a_key_is_given_by_cable_at_rest_only() {
    let setup = ground().setup_signing(BOARD, &KEY, NOW);
    let mut link = link();
    step(&mut link, 0, Mode::Idle, None);
    link.receive(0, Port::Autopilot, &setup);
    assert_eq!(link.take_keep(0), None, "by radio");
    step(&mut link, 0, Mode::Scanning, None);
    link.receive(0, Port::Service, &setup);
    assert_eq!(link.take_keep(0), None, "in flight");
    step(&mut link, 0, Mode::Idle, None);
    link.receive(0, Port::Service, &setup);
    assert_eq!(link.take_keep(0), Some(Keep::Key(Some(KEY))));
    link.kept(true);
    step(&mut link, 0, Mode::Ready, None);
    assert!(!starts(&mut link, &start(&mut ground())));
    assert!(starts(&mut link, &start(&mut signing(KEY, NOW + 1))));
    step(&mut link, 0, Mode::Idle, None);
    link.receive(0, Port::Service, &ground().setup_signing(BOARD, &Key([0; 32]), 0));
    step(&mut link, 0, Mode::Ready, None);
    assert!(starts(&mut link, &start(&mut ground())), "taken away");
}

#[test]
fn a_key_whose_time_no_clock_shows_is_taken_without_it() {
    let mut link = locked();
    step(&mut link, 0, Mode::Idle, None);
    link.receive(0, Port::Service, &ground().setup_signing(BOARD, &KEY, u64::MAX));
    step(&mut link, 2_000_000, Mode::Ready, None);
    assert!(!frames(&mut link, 2_000_000).is_empty());
    link.receive(2_000_000, Port::Autopilot, &start(&mut signing(KEY, NOW + 300 * UNITS_PER_S)));
    assert_eq!(link.take_command(), Some(Command::Start), "its owner's clock counts");
}

#[test]
fn the_times_of_what_the_board_signs_grow_over_a_change_of_its_key() {
    let mut link = locked();
    let mut streams = Streams::default();
    for _ in 0..2 {
        step(&mut link, 0, Mode::Idle, None);
        link.receive(0, Port::Service, &ground().parameter_list(BOARD));
        for frame in frames(&mut link, 0) {
            assert_eq!(streams.accept(&KEY, &frame), Ok(()), "message {}", frame.message);
        }
        link.receive(0, Port::Service, &ground().setup_signing(BOARD, &KEY, 0));
    }
}

#[test]
fn the_service_port_needs_no_signature() {
    let mut link = locked();
    link.receive(0, Port::Service, &start(&mut ground()));
    assert_eq!(link.take_command(), Some(Command::Start));
}

#[test]
fn what_the_board_says_is_signed_with_times_that_grow() {
    let mut link = locked();
    let mut streams = Streams::default();
    let mut signed = 0;
    for tick in 0..400_u64 {
        step(&mut link, tick * 5_000, Mode::Ready, None);
        for frame in frames(&mut link, tick * 5_000) {
            assert_eq!(streams.accept(&KEY, &frame), Ok(()), "message {}", frame.message);
            signed += 1;
        }
    }
    assert!(signed > 20);
    assert!(streams.newest >= NOW - 10 * UNITS_PER_S, "it goes on from what was kept");
}

#[test]
fn telemetry_must_be_signed_only_if_that_is_wanted() {
    for (wanted, unsigned_counts) in [(false, true), (true, false)] {
        let mut parameters = parameters();
        parameters.link.signed_telemetry = wanted;
        let mut link = Link::new(&parameters, Memory { key: Some(KEY), ..Memory::default() }, 7);
        link.receive(0, Port::Autopilot, &autopilot().vehicle_heartbeat(AUTO));
        assert_eq!(link.vehicle(0).alive, unsigned_counts);
        let mut signed = autopilot();
        signed.signer = Some(Signer { key: KEY, link: 0, time: NOW });
        link.receive(0, Port::Autopilot, &signed.vehicle_heartbeat(AUTO));
        assert!(link.vehicle(0).alive);
    }
}

#[test]
fn a_flood_of_what_has_no_effect_does_not_starve_the_owner() {
    let mut link = locked();
    let (mut forged, mut owner) = (signing(Key([9; 32]), NOW), signing(KEY, NOW));
    for round in 0..20 {
        for _ in 0..200 {
            link.receive(1_000, Port::Autopilot, &start(&mut ground()));
            link.receive(1_000, Port::Autopilot, &start(&mut forged));
            link.receive(1_000, Port::Autopilot, &ground().parameter_list(BOARD));
        }
        link.receive(1_000, Port::Autopilot, &start(&mut owner));
        assert_eq!(link.take_command(), Some(Command::Start), "round {round}");
        said(&mut link, 1_000);
    }
}
