//! The far end of a serial line: what the host says and what the board said, as bytes.

use std::collections::VecDeque;

use rigless::chip::{Timeline, uart};
use rigless::snapshot::Store;
use rigless::time::VirtualNanos;

/// The far end.
#[derive(Debug, Default)]
pub(crate) struct SerialLine {
    to_board: VecDeque<u8>,
    from_board: Vec<u8>,
}

impl SerialLine {
    /// Says `bytes`, each as soon as the line is free.
    pub(crate) fn say(&mut self, bytes: &[u8]) {
        self.to_board.extend(bytes);
    }

    /// What the board said since the last call.
    pub(crate) fn take(&mut self) -> Vec<u8> {
        std::mem::take(&mut self.from_board)
    }
}

impl Store for SerialLine {}

impl uart::Peer for SerialLine {
    fn receive(&mut self, word: u16, _context: &mut Timeline<'_, '_>) {
        self.from_board.push(word as u8);
    }

    fn transmit(&mut self, _now: VirtualNanos) -> Option<u16> {
        self.to_board.pop_front().map(u16::from)
    }
}

#[cfg(test)]
mod tests {
    use rigless::chip::uart::Peer as _;

    use super::*;

    #[test]
    fn bytes_leave_in_the_order_they_were_said() {
        let mut line = SerialLine::default();
        line.say(&[1, 2]);
        let said: Vec<u16> = std::iter::from_fn(|| line.transmit(VirtualNanos(0))).collect();
        assert_eq!(said, [1, 2]);
    }
}
