//! An emulated board whose flight a ground station sees, through the autopilot that it is plugged into.

use std::time::{Duration, Instant};

use adit_firmware::io::{Inputs, Outputs};
use adit_hil_sim::flight::watcher::Watcher;
use adit_hil_sim::flight::{Board, BoardError};
use adit_hil_sim::peer::Peer;
use adit_hil_sim::plant::vehicle::VehicleState;

use crate::EmulatedBoard;

/// The board and who watches.
pub struct Watched {
    /// The board.
    pub board: EmulatedBoard,
    watcher: Option<Watcher>,
    started: Option<Instant>,
}

impl Watched {
    /// A board that flies by itself, or seen by a peer, and as fast as it can, or in the time that a real one takes.
    pub fn new(board: EmulatedBoard, peer: Option<Peer>, in_real_time: bool) -> Self {
        Self { board, watcher: peer.map(Watcher::new), started: in_real_time.then(Instant::now) }
    }
}

impl Board for Watched {
    fn feel(&mut self, now_us: u64, vehicle: &VehicleState) {
        self.board.feel(now_us, vehicle);
    }

    fn step(&mut self, now_us: u64, inputs: &Inputs) -> Result<Outputs, BoardError> {
        let outputs = self.board.step(now_us, inputs)?;
        if let Some(watcher) = &mut self.watcher {
            watcher.tell(self.board.vehicle_said(), self.board.heard()[0]).map_err(BoardError::Peer)?;
            let asked = watcher.ask().map_err(BoardError::Peer)?;
            self.board.say_on_telem1(&asked.for_board);
        }
        if let Some(started) = self.started {
            std::thread::sleep(Duration::from_micros(now_us).saturating_sub(started.elapsed()));
        }
        Ok(outputs)
    }
}
