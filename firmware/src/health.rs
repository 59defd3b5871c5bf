//! Who must report how often, so that the watchdog is fed only while every task lives.
//!
//! | task | runs | reports at the latest after |
//! |---|---|---|
//! | control | every 5 ms, above all others; a node of the table of the speed law takes 20 ms while booting | 100 ms |
//! | sensors | every 5 ms; a sick bus is made anew within 60 ms | 300 ms |
//! | imu | every 5 ms | 300 ms |
//! | link | at the latest every 10 ms; a frame at 9,600 baud takes 300 ms | 500 ms |
//! | store | at the latest every 100 ms | 500 ms |
//! | log | at the latest every 20 ms; a slow card may take 250 ms for each block (SD specification) | 2 s |
//!
//! The supervisor looks every 50 ms. A task that is overdue is named in the note that the board leaves for its next start;
//! then the watchdog is no longer fed.

use core::sync::atomic::{AtomicU32, Ordering};

/// A task of the board.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Task {
    /// The controller's tick.
    Control,
    /// Range sensors and encoder.
    Sensors,
    /// The inertial unit.
    Imu,
    /// The link to the autopilot.
    Link,
    /// What must survive a loss of power.
    Store,
    /// The log on the card.
    Log,
}

impl Task {
    /// All of them.
    pub const ALL: [Self; 6] = [Self::Control, Self::Sensors, Self::Imu, Self::Link, Self::Store, Self::Log];

    /// The word for people.
    pub fn name(self) -> &'static str {
        match self {
            Self::Control => "control",
            Self::Sensors => "sensors",
            Self::Imu => "imu",
            Self::Link => "link",
            Self::Store => "store",
            Self::Log => "log",
        }
    }

    /// The longest it may be silent.
    pub fn deadline_ms(self) -> u32 {
        match self {
            Self::Control => 100,
            Self::Sensors | Self::Imu => 300,
            Self::Link | Self::Store => 500,
            Self::Log => 2000,
        }
    }
}

/// The book of reports. Shared between tasks: each writes its own place only.
#[derive(Debug, Default)]
pub struct CheckIns {
    last_ms: [AtomicU32; Task::ALL.len()],
}

impl CheckIns {
    /// Everybody counts as having reported at time zero.
    pub const fn new() -> Self {
        Self { last_ms: [const { AtomicU32::new(0) }; Task::ALL.len()] }
    }

    /// A task reports.
    pub fn report(&self, task: Task, now_us: u64) {
        if let Some(last_ms) = self.last_ms.get(task as usize) {
            last_ms.store(millis(now_us), Ordering::Relaxed);
        }
    }

    /// The first task that is overdue, and for how long it has been silent.
    pub fn overdue(&self, now_us: u64) -> Option<(Task, u32)> {
        Task::ALL.into_iter().zip(&self.last_ms).find_map(|(task, last_ms)| {
            // A report that comes between the reading of the clock and this line lies ahead: no silence.
            let silent_ms = millis(now_us).wrapping_sub(last_ms.load(Ordering::Relaxed));
            (silent_ms > task.deadline_ms() && silent_ms < u32::MAX / 2).then_some((task, silent_ms))
        })
    }
}

/// Milliseconds, wrapping after 49 days.
fn millis(now_us: u64) -> u32 {
    (now_us / 1000) as u32
}

#[cfg(test)]
mod tests {
    use super::*;

    fn all_report(book: &CheckIns, now_us: u64) {
        for task in Task::ALL {
            book.report(task, now_us);
        }
    }

    #[test]
    fn a_silent_task_is_named_after_its_deadline() {
        let book = CheckIns::new();
        all_report(&book, 1_000_000);
        assert_eq!(book.overdue(1_100_000), None);
        assert_eq!(book.overdue(1_101_000), Some((Task::Control, 101)));
        book.report(Task::Control, 1_301_000);
        assert_eq!(book.overdue(1_301_000), Some((Task::Sensors, 301)));
    }

    #[test]
    fn the_book_survives_the_wrap_of_its_clock() {
        let book = CheckIns::new();
        let wrap_us = u64::from(u32::MAX) * 1000;
        all_report(&book, wrap_us);
        assert_eq!(book.overdue(wrap_us + 50_000), None);
        assert!(book.overdue(wrap_us + 150_000).is_some());
    }

    #[test]
    fn a_report_from_a_moment_ahead_is_no_silence() {
        let book = CheckIns::new();
        all_report(&book, 5_000_000);
        assert_eq!(book.overdue(4_999_000), None);
    }
}
