//! What happens when: the scan with its limits, and the troubles.

use adit_hil_sim::autopilot::wire::{COMMAND_ACK, PARAM_VALUE, WireFault};

/// Everything goes on by this.
pub(crate) const STEP_S: f64 = 0.005;
/// The scan: times from which the limits stand.
pub(crate) const LIMITS: [(f64, f64); 3] = [(5.0, 0.4), (20.0, 0.25), (35.0, 0.6)];
/// The scan is over.
pub(crate) const SCAN_ENDS_S: f64 = 50.0;
/// By then everything must be as it was.
pub(crate) const END_S: f64 = 60.0;

/// Which of the limits stands.
pub(crate) fn limit_index(now_s: f64) -> Option<usize> {
    LIMITS.iter().rposition(|(from_s, _)| now_s >= *from_s).filter(|_| now_s < SCAN_ENDS_S)
}

/// What goes wrong.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Trouble {
    /// Nothing.
    Nothing,
    /// No answer to a command ever comes, nor the first two values of parameters.
    AnswersLost,
    /// The first two requests for a limit are accepted without effect.
    IgnoredTwice,
    /// The autopilot loses its power in flight.
    AutopilotReset,
    /// The pilot turns the mode switch and turns it back.
    ModeAndBack,
    /// The board loses its power in flight.
    BoardReset,
    /// The board loses its power in the very moment in which the scan ends.
    BoardResetAtEnd,
    /// Nothing comes through for ten seconds, and a new limit begins to stand meanwhile.
    LineCut,
    /// The same, and the scan ends meanwhile.
    LineCutAtEnd,
}

impl Trouble {
    /// All of them.
    pub(crate) const ALL: [Self; 9] = [
        Self::Nothing,
        Self::AnswersLost,
        Self::IgnoredTwice,
        Self::AutopilotReset,
        Self::ModeAndBack,
        Self::BoardReset,
        Self::BoardResetAtEnd,
        Self::LineCut,
        Self::LineCutAtEnd,
    ];

    pub(crate) fn name(self) -> &'static str {
        match self {
            Self::Nothing => "-",
            Self::AnswersLost => "answers lost",
            Self::IgnoredTwice => "ignored twice",
            Self::AutopilotReset => "autopilot reset",
            Self::ModeAndBack => "mode and back",
            Self::BoardReset => "board reset",
            Self::BoardResetAtEnd => "board reset at end",
            Self::LineCut => "line cut",
            Self::LineCutAtEnd => "line cut at end",
        }
    }

    /// What is wrong with the line.
    pub(crate) fn wire(self) -> Vec<WireFault> {
        match self {
            Self::AnswersLost => vec![
                WireFault::Lost { message: COMMAND_ACK, count: u32::MAX },
                WireFault::Lost { message: PARAM_VALUE, count: 2 },
            ],
            Self::IgnoredTwice => vec![WireFault::Ignored { count: 2 }],
            Self::LineCut => vec![WireFault::Cut { from_s: 14.0, for_s: 10.0 }],
            Self::LineCutAtEnd => vec![WireFault::Cut { from_s: 44.0, for_s: 10.0 }],
            _ => Vec::new(),
        }
    }

    /// When the autopilot loses its power.
    pub(crate) fn autopilot_reset_s(self) -> Option<f64> {
        (self == Self::AutopilotReset).then_some(25.0)
    }

    /// When the board does.
    pub(crate) fn board_reset_s(self) -> Option<f64> {
        match self {
            Self::BoardReset => Some(25.0),
            Self::BoardResetAtEnd => Some(SCAN_ENDS_S - 0.1),
            _ => None,
        }
    }

    /// Is the mode switch turned away?
    pub(crate) fn is_away(self, now_s: f64) -> bool {
        self == Self::ModeAndBack && (24.0..30.0).contains(&now_s)
    }
}
