//! A peer outside the simulation that sees the vehicle as a ground station does: autopilot and board side by side.

use adit_protocol::mavlink::RawFrame;

use crate::autopilot::routing::{Sieve, is_for_board, is_for_ground};
use crate::peer::Peer;

/// The peer and what of its talk is for whom.
pub struct Watcher {
    peer: Peer,
    to_peer: [Sieve; 2],
    from_peer: [Sieve; 2],
}

/// What the peer said.
pub struct Asked {
    /// As far as the autopilot sees it.
    pub for_autopilot: Vec<u8>,
    /// As far as the autopilot passes it on.
    pub for_board: Vec<u8>,
}

impl Watcher {
    /// For a peer at an open connection.
    pub fn new(peer: Peer) -> Self {
        Self { peer, to_peer: Default::default(), from_peer: Default::default() }
    }

    /// Tells the peer what autopilot and board say.
    ///
    /// # Errors
    /// If the line broke.
    pub fn tell(&mut self, autopilot: &[u8], board: &[u8]) -> std::io::Result<()> {
        for (sieve, said) in self.to_peer.iter_mut().zip([autopilot, board]) {
            let bytes = sieve.pass(said, is_for_ground);
            if !bytes.is_empty() {
                self.peer.write(&bytes)?;
            }
        }
        Ok(())
    }

    /// What the peer says; the autopilot itself knows what is not for it.
    ///
    /// # Errors
    /// If the line broke.
    pub fn ask(&mut self) -> std::io::Result<Asked> {
        let bytes = self.peer.read()?;
        let [for_autopilot, for_board] = &mut self.from_peer;
        let all = |_: &RawFrame| true;
        Ok(Asked { for_autopilot: for_autopilot.pass(&bytes, all), for_board: for_board.pass(&bytes, is_for_board) })
    }
}
