//! What happens when: the scan with its limits, and the troubles.

use adit_hil_sim::autopilot::wire::{COMMAND_ACK, PARAM_VALUE, WireFault};
use adit_hil_sim::seed::Random;

/// Everything goes on by this.
pub(crate) const STEP_S: f64 = 0.005;
/// The scan: times from which the limits stand.
pub(crate) const LIMITS: [(f64, f64); 4] = [(5.0, 0.4), (20.0, 0.25), (35.0, 0.09), (50.0, 0.6)];
/// The scan is over.
pub(crate) const SCAN_ENDS_S: f64 = 65.0;
/// By then everything must be as it was.
pub(crate) const END_S: f64 = 75.0;

/// So much is left after the last trouble.
const LEFT_S: f64 = 5.0;

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

    /// When it begins, and how long it lasts.
    fn span_s(self) -> [f64; 2] {
        match self {
            Self::Nothing | Self::AnswersLost | Self::IgnoredTwice => [0.0, f64::INFINITY],
            Self::AutopilotReset | Self::BoardReset => [25.0, 0.0],
            Self::BoardResetAtEnd => [SCAN_ENDS_S - 0.1, 0.0],
            Self::ModeAndBack => [24.0, 6.0],
            Self::LineCut => [14.0, 10.0],
            Self::LineCutAtEnd => [SCAN_ENDS_S - 6.0, 10.0],
        }
    }
}

/// A trouble at its time.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Timed {
    pub(crate) trouble: Trouble,
    pub(crate) from_s: f64,
}

impl Timed {
    /// At the time at which it matters most.
    pub(crate) fn usual(trouble: Trouble) -> Self {
        Self { trouble, from_s: trouble.span_s()[0] }
    }

    /// At any time that leaves some seconds for putting things in order.
    pub(crate) fn any(trouble: Trouble, random: &mut Random) -> Self {
        let latest_s = END_S - LEFT_S - trouble.span_s()[1];
        let from_s = random.uniform(0.0, latest_s);
        if latest_s.is_finite() { Self { trouble, from_s } } else { Self::usual(trouble) }
    }

    /// What is wrong with the line.
    pub(crate) fn wire(self) -> Vec<WireFault> {
        match self.trouble {
            Trouble::AnswersLost => vec![
                WireFault::Lost { message: COMMAND_ACK, count: u32::MAX },
                WireFault::Lost { message: PARAM_VALUE, count: 2 },
            ],
            Trouble::IgnoredTwice => vec![WireFault::Ignored { count: 2 }],
            Trouble::LineCut | Trouble::LineCutAtEnd => {
                vec![WireFault::Cut { from_s: self.from_s, for_s: self.trouble.span_s()[1] }]
            }
            _ => Vec::new(),
        }
    }

    /// When the autopilot loses its power.
    pub(crate) fn autopilot_reset_s(self) -> Option<f64> {
        (self.trouble == Trouble::AutopilotReset).then_some(self.from_s)
    }

    /// When the board does.
    pub(crate) fn board_reset_s(self) -> Option<f64> {
        matches!(self.trouble, Trouble::BoardReset | Trouble::BoardResetAtEnd).then_some(self.from_s)
    }

    /// Is the mode switch turned away?
    pub(crate) fn is_away(self, now_s: f64) -> bool {
        let until_s = self.from_s + self.trouble.span_s()[1];
        self.trouble == Trouble::ModeAndBack && (self.from_s..until_s).contains(&now_s)
    }
}
