//! The emulated board in lockstep, with a firmware of fifty bytes in place of the flash image.

use adit_emulator::{BoardFault, BoardFaultKind, EmulatedBoard, Report, Restart, RestartCause, Setup};
use adit_firmware::io::{CameraStatus, Inputs, Outputs};
use adit_hil_sim::flight::Board;
use adit_protocol::parameters::Parameters;

/// Presses the shutter (PD14) while the camera is busy (PE11), and feeds the watchdog every 50 us or so.
///
/// Assembled by hand from Thumb; halfwords. The listing is beside it.
#[rustfmt::skip]
const FOLLOWER: [u16; 50] = [
    // Vector table: stack, reset at 0x0800_4010, NMI and hard fault at 0x0800_4052.
    0x0000, 0x2002, 0x4011, 0x0800, 0x4053, 0x0800, 0x4053, 0x0800,
    // Clock of ports D and E on (RCC_AHB1ENR); PD14 an output.
    0x4810, 0x2118, 0x6001, 0x6801, 0x480F, 0xF04F, 0x5180, 0x6001,
    // r3: port E; r4: watchdog; registers open, 250 counts of 125 us, start.
    0x4B0E, 0x4C0F, 0xF245, 0x5155, 0x6021, 0x21FA, 0x60A1, 0xF64C, 0x41CC, 0x6021,
    // r5: the word that feeds it; r6: the mask of pin 11.
    0xF64A, 0x25AA, 0x2601, 0x02F6,
    // loop: feed; PD14 = PE11; wait 4080 turns.
    0x6025, 0x6919, 0x4031, 0x00C9, 0x6141, 0x22FF, 0x0112, 0x1E52, 0xD1FD, 0xE7F5,
    // nop; stuck: branch to itself.
    0xBF00, 0xE7FE,
    // Literals: RCC_AHB1ENR, GPIOD, GPIOE, IWDG.
    0x3830, 0x4002, 0x0C00, 0x4002, 0x1000, 0x4002, 0x3000, 0x4000,
];

const STEP_US: u64 = 5_000;

fn board(faults: &[BoardFault]) -> EmulatedBoard {
    let code: Vec<u8> = FOLLOWER.iter().flat_map(|halfword| halfword.to_le_bytes()).collect();
    let setup = Setup { faults: faults.to_vec(), ..Setup::new(1).expect("a card") };
    EmulatedBoard::from_code(&code, &Parameters::default(), setup).expect("a board")
}

/// Flies `steps` steps with the camera busy in every second tenth of a second; returns the outputs and the report.
fn fly(faults: &[BoardFault], steps: u64) -> (Vec<Outputs>, Report) {
    let mut board = board(faults);
    let outputs = (0..steps).map(|step| board.step(step * STEP_US, &busy_inputs(step)).expect("a step")).collect();
    (outputs, board.finish().expect("a report"))
}

fn busy_inputs(step: u64) -> Inputs {
    Inputs { camera: CameraStatus { busy: is_busy(step), photos_stored: 0 }, ..Inputs::default() }
}

fn is_busy(step: u64) -> bool {
    step / 20 % 2 == 1
}

fn fault(kind: BoardFaultKind, at_s: f64, for_s: Option<f64>) -> BoardFault {
    BoardFault { kind, at_s, for_s }
}

#[test]
fn the_board_answers_each_step_with_what_it_saw_in_the_step_before() {
    let (outputs, report) = fly(&[], 100);
    for (step, outputs) in outputs.iter().enumerate().skip(2) {
        assert_eq!(outputs.shutter, is_busy(step as u64 - 1), "step {step}");
    }
    assert_eq!(report.gaps, Vec::<String>::new());
    assert_eq!(report.restarts, []);
    // 99 steps of 5 ms at 168 million instructions a second.
    assert!(report.instructions.abs_diff(83_160_000) < 10, "{} instructions", report.instructions);
}

#[test]
fn the_same_flight_twice_is_the_same() {
    let runs = [(); 2].map(|()| fly(&[fault(BoardFaultKind::PowerCut, 0.1017, Some(0.05))], 60));
    assert_eq!(runs[0].0, runs[1].0);
    assert_eq!(runs[0].1.instructions, runs[1].1.instructions);
}

#[test]
fn a_board_without_power_drives_nothing_and_starts_again() {
    let (outputs, report) = fly(&[fault(BoardFaultKind::PowerCut, 0.12, Some(0.03))], 100);
    let high: Vec<usize> = (20..40).filter(|step| outputs[*step].shutter).collect();
    assert_eq!(high, (21..24).chain(31..40).collect::<Vec<_>>());
    assert_eq!(report.restarts, [Restart { at_ns: 150_000_000, cause: RestartCause::PowerOn }]);
}

#[test]
fn power_that_stays_away_leaves_what_the_chips_held() {
    let (outputs, report) = fly(&[fault(BoardFaultKind::PowerCut, 0.1, None)], 60);
    assert!(outputs[22..].iter().all(|outputs| !outputs.shutter));
    assert!(report.files().expect("a volume").is_empty());
}

#[test]
fn the_watchdog_ends_a_core_that_hangs_or_crashes() {
    for kind in [BoardFaultKind::CoreHang, BoardFaultKind::CoreCrash] {
        let (outputs, report) = fly(&[fault(kind, 0.1, None)], 100);
        let [restart] = report.restarts[..] else { panic!("{kind:?}: {:?}", report.restarts) };
        assert_eq!(restart.cause, RestartCause::Watchdog, "{kind:?}");
        // 251 counts of 125 us.
        let bitten_ms = (restart.at_ns - 100_000_000) as f64 / 1e6;
        assert!((31.0..31.5).contains(&bitten_ms), "{kind:?}: bitten after {bitten_ms} ms");
        assert!(outputs[62..80].iter().all(|outputs| outputs.shutter), "{kind:?}: the firmware runs again");
    }
}

#[test]
fn a_card_that_fills_up_holds_nothing_more() {
    let (_, report) = fly(&[fault(BoardFaultKind::CardFull, 0.01, None)], 10);
    let mut card = report.card;
    assert!(card.put_file("ANY.LOG", &[1; 10_000]).is_err());
}

#[test]
fn a_corrupt_fram_has_other_bytes() {
    let (_, report) = fly(&[fault(BoardFaultKind::FramCorrupt, 0.01, None)], 10);
    let changed = report.fram.iter().filter(|byte| **byte != 0).count();
    assert!((3500..4700).contains(&changed), "{changed} of 32768 bytes");
}
