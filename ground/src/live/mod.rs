//! During the flight: what the board says, shown to the pilot and to who helps, on a terminal and on a page.
//!
//! ```text
//! link::Session --(broadcast, bounded)--> feed: State::hear --(watch: the newest only)--> screen (a thread), page (a socket)
//!       |                                   ^
//!       `--> record (.tlog)                 `-- replay (.tlog)
//! ```
//! Everything that is shown comes out of [`State`], a function of times and messages. Recording happens where frames are heard
//! and waits for nobody; who shows takes the newest [`Frame`] whenever ready for it, so that a slow terminal or tablet costs
//! pictures, not messages.

mod captures;
#[cfg(test)]
mod enactment;
mod feed;
mod picture;
mod quality;
mod reading;
mod replay;
mod screen;
mod setting;
mod state;
mod strip;
mod view;
mod warnings;
mod web;

pub use feed::{Ending, Frame, Live, follow, replay};
pub use picture::{Picture, Stretch};
pub use reading::Reading;
pub use replay::{Replay, ReplayError};
pub use screen::{Screen, run as run_screen};
pub use setting::{Setting, SettingError};
pub use state::State;
pub use strip::{Block, Cell, Strip};
pub use view::*;
pub use web::{Page, Token};
