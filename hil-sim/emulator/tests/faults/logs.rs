//! Logs are fetched through the service port while the card fails.

use adit_emulator::{BoardFaultKind, EmulatedBoard, Setup, provisioned_fram};
use adit_firmware::io::Inputs;
use adit_hil_sim::flight::Board as _;
use adit_protocol::mavlink::{FrameDecoder, Incoming, Sender};

use crate::common::{board, image, parameters};

const STEP_MS: u64 = 5;
const TELEM2: usize = 1;

#[test]
fn after_a_card_that_failed_in_a_fetch_logs_are_told_again() {
    let fram = provisioned_fram(&parameters()).expect("parameters fit");
    let faults = vec![board(BoardFaultKind::CardReadErrors, 3.0, 5.0)];
    let setup = Setup { fram, faults, ..Setup::new(1).expect("a card") };
    let mut board = EmulatedBoard::new(&image(), &parameters(), setup).expect("a board");
    let (mut ground, mut decoder) = (Sender::new(255, 190), FrameDecoder::default());
    // Before the card's reads fail, while they do, and when there is a log again.
    let asked_ms = [2500, 3100, 8000];
    let mut answers = [0; 3];
    for now_ms in (0..9000).step_by(STEP_MS as usize) {
        if asked_ms.contains(&now_ms) {
            board.say_on_telem2(&ground.log_list([1, 191]));
        }
        board.step(now_ms * 1000, &Inputs::default()).expect("a step");
        let frames = board.heard()[TELEM2].iter().filter_map(|byte| decoder.push(*byte));
        let entries = frames.filter(|frame| matches!(Incoming::read(frame), Some(Incoming::LogEntry { .. }))).count();
        if let Some(question) = asked_ms.iter().rposition(|at_ms| *at_ms <= now_ms) {
            answers[question] += entries;
        }
    }
    // The one that the card failed is not answered with a list that it has not; the two logs are of before and after.
    assert_eq!(answers, [1, 0, 2]);
    assert_eq!(board.finish().expect("a report").restarts, []);
}
