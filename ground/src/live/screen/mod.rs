//! The terminal screen: what is shown, from 80 columns and 24 rows up.
//!
//! Colours say how bad it is, and never alone: a word or a sign says it too. The section is seen looking forward, so right is
//! the pilot's right; arrows say which way to steer.

mod figures;
mod section;
mod wall;

use std::io;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

use ratatui::crossterm::event::{self, Event, KeyCode, KeyEventKind, KeyModifiers};
use ratatui::layout::{Constraint, Layout, Rect};
use ratatui::style::{Color, Style, Stylize};
use ratatui::text::{Line, Span};
use ratatui::widgets::{Block, Clear, Paragraph};
use tokio::sync::watch;

use super::feed::Frame;
use super::view::{Level, LinkStatus, View};

/// A key is answered, and the picture renewed, after this at the latest.
const WAIT: Duration = Duration::from_millis(150);
/// Columns and rows that everything fits into.
const LEAST: [u16; 2] = [80, 24];
/// Rows of the strip with its heading on the smallest screen, and of warnings.
const STRIP_ROWS: u16 = 6;
const WARNING_ROWS: u16 = 3;

pub(super) const QUIET: Style = Style::new().fg(Color::DarkGray);
pub(super) const GOOD: Style = Style::new().fg(Color::Green);
pub(super) const WARN: Style = Style::new().fg(Color::Yellow);
pub(super) const BAD: Style = Style::new().fg(Color::Red);

/// The screen's own state.
#[derive(Clone, Debug, Default)]
pub struct Screen {
    /// Where the page is, if there is one.
    pub page: Option<String>,
    /// The keys are explained.
    pub is_help: bool,
}

/// Shows what there is on this terminal until somebody presses q or `stop` is set. Blocks: it wants a thread of its own.
///
/// # Errors
/// If this is no terminal, or it is gone.
pub fn run(shown: &watch::Receiver<Arc<Frame>>, mut screen: Screen, stop: &AtomicBool) -> io::Result<()> {
    let mut terminal = ratatui::try_init()?;
    let ended = loop {
        let frame = Arc::clone(&shown.borrow());
        if let Err(error) = terminal.draw(|target| screen.draw(target, &frame)) {
            break Err(error);
        }
        match next_key() {
            Ok(Some(Key::Quit)) => break Ok(()),
            Ok(Some(Key::Help)) => screen.is_help = !screen.is_help,
            Ok(None) => {}
            Err(error) => break Err(error),
        }
        if stop.load(Ordering::Relaxed) {
            break Ok(());
        }
    };
    ratatui::try_restore()?;
    ended
}

enum Key {
    Quit,
    Help,
}

fn next_key() -> io::Result<Option<Key>> {
    if !event::poll(WAIT)? {
        return Ok(None);
    }
    let Event::Key(key) = event::read()? else { return Ok(None) };
    Ok(match key.code {
        _ if key.kind == KeyEventKind::Release => None,
        KeyCode::Char('c') if key.modifiers.contains(KeyModifiers::CONTROL) => Some(Key::Quit),
        KeyCode::Char('q' | 'Q') => Some(Key::Quit),
        KeyCode::Char('?' | 'h') => Some(Key::Help),
        _ => None,
    })
}

impl Screen {
    /// Draws everything.
    pub fn draw(&self, target: &mut ratatui::Frame<'_>, frame: &Frame) {
        let area = target.area();
        if area.width < LEAST[0] || area.height < LEAST[1] {
            let words =
                format!("This terminal has {} x {}; {} x {} are needed.", area.width, area.height, LEAST[0], LEAST[1]);
            target.render_widget(Paragraph::new(words).style(WARN.bold()), area);
            return;
        }
        let view = &frame.view;
        let [head, body, strip, warnings, foot] = Layout::vertical([
            Constraint::Length(1),
            Constraint::Fill(1),
            Constraint::Length(STRIP_ROWS.max(area.height / 4)),
            Constraint::Length(WARNING_ROWS),
            Constraint::Length(1),
        ])
        .areas(area);
        // A cell is twice as high as it is wide.
        let [section, figures] =
            Layout::horizontal([Constraint::Length((2 * body.height + 4).min(area.width / 2)), Constraint::Fill(1)])
                .areas(body);
        target.render_widget(Paragraph::new(head_line(view, head.width)), head);
        section::draw(target, section, view);
        figures::draw(target, figures, view);
        wall::draw(target, strip, frame);
        target.render_widget(Paragraph::new(warning_lines(view)), warnings);
        target.render_widget(Paragraph::new(self.foot_line()), foot);
        if self.is_help {
            help(target, area);
        }
    }

    fn foot_line(&self) -> Line<'_> {
        let mut spans = vec![" q".bold(), Span::styled(" quit  ", QUIET), "?".bold(), Span::styled(" help", QUIET)];
        if let Some(page) = &self.page {
            spans.extend([Span::styled("   page ", QUIET), page.as_str().into()]);
        }
        Line::from(spans)
    }
}

fn head_line(view: &View, width: u16) -> Line<'static> {
    let mode = view.mode.value.map_or_else(|| "NO BOARD".to_owned(), |mode| format!("{mode:?}").to_uppercase());
    let mut left = vec![" ADIT ".reversed().bold(), Span::raw(" "), styled(mode, view.mode.is_stale).bold()];
    if let Some(autopilot) = view.autopilot.value {
        let armed = if autopilot.is_armed { "armed" } else { "disarmed" };
        let words = [autopilot.name, autopilot.mode.unwrap_or_default(), armed];
        let words = words.into_iter().filter(|word| !word.is_empty()).collect::<Vec<_>>().join(" ");
        left.push(styled(format!("  {words}"), view.autopilot.is_stale));
    }
    let mut right = Vec::new();
    if let Some(replay) = view.replay {
        let words = if replay.is_over { "REPLAY, END".to_owned() } else { format!("REPLAY x{}", replay.speed) };
        right.extend([Span::styled(words, WARN), Span::raw("  ")]);
    }
    let (word, style) = match view.link.status {
        LinkStatus::Up => ("LINK up", GOOD),
        LinkStatus::Lost => ("LINK LOST", BAD.reversed()),
        LinkStatus::Waiting => ("LINK none", BAD),
    };
    right.push(Span::styled(word, style.bold()));
    let lost = view.link.lost.map(|lost| format!(" {:.0}% lost", lost * 100.0)).unwrap_or_default();
    right.push(Span::raw(format!(" {:.0}/s{lost}", view.link.rate_hz)));
    if let [Some(signal), ..] = view.link.radio.fresh().unwrap_or_default() {
        right.push(Span::raw(format!(" rssi {signal}")));
    }
    if let Some(record) = &view.record {
        let style = if record.has_failed { BAD.reversed().bold() } else { BAD.bold() };
        right.extend([Span::raw("  "), Span::styled(if record.has_failed { "NOT RECORDING" } else { "● REC" }, style)]);
    }
    right.push(Span::raw(" "));
    let used: usize = left.iter().chain(&right).map(Span::width).sum();
    left.push(Span::raw(" ".repeat(usize::from(width).saturating_sub(used))));
    left.extend(right);
    Line::from(left)
}

/// Text that is grey where it is old.
pub(super) fn styled(text: String, is_stale: bool) -> Span<'static> {
    if is_stale { Span::styled(text, QUIET) } else { Span::raw(text) }
}

/// Warnings first, and where there is room, what the board said last.
fn warning_lines(view: &View) -> Vec<Line<'static>> {
    let warnings = view.warnings.iter().map(|warning| {
        let style = match warning.level {
            Level::Alarm => BAD.reversed().bold(),
            Level::Warning => WARN.bold(),
            Level::Note => QUIET,
        };
        Line::from(vec![Span::raw(" "), Span::styled(warning.text.clone(), style)])
    });
    let notices = view.notices.iter().map(|notice| {
        let style = if notice.severity <= 4 { WARN } else { Style::new() };
        let from = format!(" {:>6.0} s {}: ", view.time_s - notice.at_s, notice.from);
        Line::from(vec![Span::styled(from, QUIET), Span::styled(notice.text.clone(), style)])
    });
    // Of three rows one is for the board's words, if it has any.
    let room = usize::from(WARNING_ROWS) - usize::from(!view.notices.is_empty());
    let mut lines: Vec<_> = warnings.take(room).collect();
    lines.extend(notices.take(usize::from(WARNING_ROWS) - lines.len()));
    lines
}

fn help(target: &mut ratatui::Frame<'_>, area: Rect) {
    let lines = vec![
        Line::from("The section is seen looking forward: the dot is the vehicle,"),
        Line::from("its ellipse two standard deviations, the yellow line the camera."),
        Line::from("STEER says which way to fly to the centre."),
        Line::from(""),
        Line::from("Grey is old: not heard for a second and more."),
        Line::from("A range of ---- is invalid: the sensor cannot measure."),
        Line::from(""),
        Line::from("Below is the wall unrolled: 12 o'clock above and below, 6 in"),
        Line::from("the middle, the way of the flight to the right, vehicle at ▼."),
        Line::from(vec![
            wall::key(super::Cell::Seen),
            " seen by enough photos  ".into(),
            wall::key(super::Cell::Begun),
            " not yet enough".into(),
        ]),
        Line::from(vec![
            wall::key(super::Cell::Gap),
            " GAP: by none  ".into(),
            wall::key(super::Cell::Thin),
            " left with too few".into(),
        ]),
        Line::from(""),
        Line::from("q, Ctrl-C   quit          ?   close this"),
    ];
    let [width, height] = [68, lines.len() as u16 + 2];
    let popup = Rect {
        x: area.x + area.width.saturating_sub(width) / 2,
        y: area.y + area.height.saturating_sub(height) / 2,
        width: width.min(area.width),
        height: height.min(area.height),
    };
    target.render_widget(Clear, popup);
    target.render_widget(Paragraph::new(lines).block(Block::bordered().title(" Help ")), popup);
}

#[cfg(test)]
mod tests;
