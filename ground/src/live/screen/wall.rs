//! The strip: the wall unrolled around the vehicle, crown above and below, looking the way of the flight to the right.

use ratatui::layout::Rect;
use ratatui::style::{Color, Style, Stylize};
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

/// A sign of the legend.
pub(super) fn key(cell: Cell) -> Span<'static> {
    Span::styled("▄▄", Style::new().fg(colour(cell)))
}

fn colour(cell: Cell) -> Color {
    match cell {
        Cell::Ahead => Color::Black,
        Cell::Gap => Color::LightRed,
        Cell::Thin => Color::Yellow,
        Cell::Begun => Color::Blue,
        Cell::Seen => Color::Green,
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
        let clock = match row * 4 {
            0 => "12 ",
            at if at / rows == 1 && (at - 4) / rows == 0 => " 3 ",
            at if at / rows == 2 && (at - 4) / rows == 1 => " 6 ",
            at if at / rows == 3 && (at - 4) / rows == 2 => " 9 ",
            _ => "   ",
        };
        let mut spans = vec![Span::styled(clock, QUIET)];
        spans.extend((first..first + columns).map(|column| {
            let half = |half: i64| worst(strip, column, [row * 2 + half, rows * 2]);
            Span::raw("▀").fg(colour(half(0))).bg(colour(half(1)))
        }));
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

/// The worst of the cells behind a half cell of the terminal: `half` is `[which, of how many]` around the wall.
fn worst(strip: &Picture, column: i64, [half, halves]: [i64; 2]) -> Cell {
    let around = |half: i64| (half * strip.columns as i64 / halves) as usize;
    let rank = |cell: &Cell| match cell {
        Cell::Ahead => 0,
        Cell::Seen => 1,
        Cell::Begun => 2,
        Cell::Thin => 3,
        Cell::Gap => 4,
    };
    let rows = column * ROWS_PER_COLUMN..(column + 1) * ROWS_PER_COLUMN;
    let cells = rows.flat_map(|row| {
        let stretch = strip.stretches.get(&row.div_euclid(BLOCK_ROWS));
        let start = row.rem_euclid(BLOCK_ROWS) as usize * strip.columns;
        let cells = stretch.and_then(|stretch| stretch.cells.get(start + around(half)..start + around(half + 1)));
        cells.unwrap_or_default()
    });
    cells.copied().max_by_key(rank).unwrap_or(Cell::Ahead)
}
