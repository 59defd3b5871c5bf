//! The strip: the wall unrolled around the vehicle, crown above and below, looking the way of the flight to the right.

use ratatui::layout::Rect;
use ratatui::style::{Color, Style};
use ratatui::text::{Line, Span};
use ratatui::widgets::Paragraph;

use super::QUIET;
use crate::live::feed::Frame;
use crate::live::picture::Picture;
use crate::live::strip::{BLOCK_ROWS, Cell};

/// Cells along the axis per column of the terminal.
const ROWS_PER_COLUMN: i64 = 2;
/// Columns for the clock's hours.
const MARGIN: u16 = 4;

/// A cell's sign, which tells the same as its colour.
pub(super) fn key(cell: Cell) -> Span<'static> {
    match cell {
        Cell::Ahead => Span::raw(" "),
        Cell::Gap => Span::styled("!", Style::new().fg(Color::White).bg(Color::Red).bold()),
        Cell::Thin => Span::styled("▒", Style::new().fg(Color::Yellow)),
        Cell::Begun => Span::styled("░", Style::new().fg(Color::LightBlue)),
        Cell::Seen => Span::styled("█", Style::new().fg(Color::Green)),
    }
}

pub(super) fn draw(target: &mut ratatui::Frame<'_>, area: Rect, frame: &Frame) {
    let (strip, view) = (&frame.strip, &frame.view);
    let columns = i64::from(area.width.saturating_sub(MARGIN));
    if strip.columns == 0 || strip.cell_m <= 0.0 {
        target.render_widget(Paragraph::new(" WALL    not shown: no section known").style(QUIET), area);
        return;
    }
    let column_m = strip.cell_m * ROWS_PER_COLUMN as f64;
    // The vehicle flies to the right; what is behind it matters more than what is ahead.
    let vehicle = (view.odometer_m.value.unwrap_or(0.0) / column_m).floor() as i64;
    let first = vehicle - columns * 3 / 4;
    let rows = i64::from(area.height) - 1;
    let mut lines = vec![scale(columns, first, vehicle, column_m)];
    for row in 0..rows {
        // The hour that the row holds, if it begins within.
        let hours = [(0, "12 "), (3, " 3 "), (6, " 6 "), (9, " 9 ")];
        let begins = |hour: i64| hour * rows >= row * 12 && hour * rows < (row + 1) * 12;
        let clock = hours.into_iter().find(|(hour, _)| begins(*hour)).map_or("   ", |(_, words)| words);
        let mut spans = vec![Span::styled(clock, QUIET)];
        spans.extend((first..first + columns).map(|column| key(worst(strip, column, [row, rows]))));
        lines.push(Line::from(spans));
    }
    target.render_widget(Paragraph::new(lines), area);
}

/// Metres along the axis, and where the vehicle is.
fn scale(columns: i64, first: i64, vehicle: i64, column_m: f64) -> Line<'static> {
    let mut text: Vec<char> = " ".repeat((columns + i64::from(MARGIN)) as usize).chars().collect();
    let mut write = |column: i64, words: &str| {
        let at = usize::try_from(column - first + 3).unwrap_or(usize::MAX);
        for (letter, place) in words.chars().zip(text.iter_mut().skip(at)) {
            *place = letter;
        }
    };
    for column in first..first + columns - 4 {
        let metre = (column as f64 * column_m).ceil();
        if metre >= 0.0 && metre < (column + 1) as f64 * column_m {
            write(column, &format!("{metre:.0}m"));
        }
    }
    write(vehicle, "▼");
    Line::from(Span::styled(text.into_iter().collect::<String>(), QUIET))
}

/// The worst of the cells behind a cell of the terminal: row `[which, of how many]` around the wall.
fn worst(strip: &Picture, column: i64, [row, rows]: [i64; 2]) -> Cell {
    let around = |row: i64| (row * strip.columns as i64 / rows) as usize;
    let rank = |cell: &Cell| match cell {
        Cell::Ahead => 0,
        Cell::Seen => 1,
        Cell::Begun => 2,
        Cell::Thin => 3,
        Cell::Gap => 4,
    };
    let along = column * ROWS_PER_COLUMN..(column + 1) * ROWS_PER_COLUMN;
    let cells = along.flat_map(|at| {
        let stretch = strip.stretches.get(&at.div_euclid(BLOCK_ROWS));
        let start = at.rem_euclid(BLOCK_ROWS) as usize * strip.columns;
        let cells = stretch.and_then(|stretch| stretch.cells.get(start + around(row)..start + around(row + 1)));
        cells.unwrap_or_default()
    });
    cells.copied().max_by_key(rank).unwrap_or(Cell::Ahead)
}
