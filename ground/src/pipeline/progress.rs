//! Progress on the terminal: a bar per stage on standard error, a plain line where there is no terminal.

use std::time::{Duration, Instant};

use indicatif::{ProgressBar, ProgressStyle};

/// Where progress goes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Verbosity {
    /// Bars and lines on standard error.
    Talk,
    /// Nothing (tests, library use).
    Quiet,
}

/// One stage under way.
#[derive(Debug)]
pub struct StageProgress {
    name: &'static str,
    bar: ProgressBar,
    started: Instant,
    verbosity: Verbosity,
}

impl StageProgress {
    /// Starts a stage of `total` items (photos, pairs, tiles ...).
    pub fn start(verbosity: Verbosity, name: &'static str, total: usize) -> Self {
        let bar = match verbosity {
            Verbosity::Talk => ProgressBar::new(total as u64),
            Verbosity::Quiet => ProgressBar::hidden(),
        };
        if let Ok(style) = ProgressStyle::with_template("{prefix:>10} [{bar:30}] {pos}/{len} {msg} {eta}") {
            bar.set_style(style.progress_chars("=> "));
        }
        bar.set_prefix(name);
        Self { name, bar, started: Instant::now(), verbosity }
    }

    /// Counts one item as done. May be called from any thread.
    pub fn tick(&self) {
        self.bar.inc(1);
    }

    /// Starts counting anew, towards another total.
    pub fn restart(&self, total: usize) {
        self.bar.set_position(0);
        self.bar.set_length(total as u64);
    }

    /// Sets how many items are done.
    pub fn set(&self, done: usize) {
        self.bar.set_position(done as u64);
    }

    /// Ends the stage with a line that says what came out.
    pub fn finish(self, result: &str) -> Duration {
        let took = self.started.elapsed();
        self.bar.finish_and_clear();
        if self.verbosity == Verbosity::Talk {
            eprintln!("{:>10}  {result} ({:.1} s)", self.name, took.as_secs_f64());
        }
        took
    }
}
