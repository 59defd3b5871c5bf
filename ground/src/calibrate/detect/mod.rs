//! Finds a chessboard's inner corners in a photo, markers in its white squares or not.
//!
//! Saddles of brightness (`saddle`) are joined to a grid (`grid`), at full resolution first and then coarser, because near
//! boards are blurred and large; each of its corners is found on the board (`place`, `markers`) and then placed to a few
//! hundredths of a pixel (`refine`).

mod grid;
mod markers;
mod place;
mod refine;
mod saddle;

use nalgebra::{Matrix2, Vector2};

use super::{Board, Corner, Pattern};
use crate::features::{blurred, halved};
use crate::raster::{Grey, Luma};
use grid::{Grid, largest_grid};
use place::Named;
use refine::{Surroundings, refined};
use saddle::Field;

/// Photos are halved until no side is longer than this; corners are placed at full resolution in the end.
const LONGEST: usize = 1700;
/// So many times halved again, if the whole board is not found before.
const COARSER: usize = 2;
/// Blur before halving, samples.
const HALVING_BLUR: f32 = 1.0;
/// Fewer corners in a row and column than this are a pattern of the background, not a board.
const LEAST_SIDE: usize = 3;
/// Fewer corners than this say little more than where the board is.
pub(super) const LEAST_CORNERS: usize = 8;
/// Blur before corners are placed, pixels: with it, sums over pixels are as good as integrals.
const PLACING_BLUR: f32 = 0.8;
/// Half the window that a corner is placed in, in squares; nearer to it are the edges of markers.
const SHARE: f64 = 0.3;
const SHARE_BETWEEN_MARKERS: f64 = 0.14;
/// Rounds of placing: the second knows the bending of the lines from the first.
const ROUNDS: usize = 2;

/// Why a photo shows no board that can be used.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum NoBoard {
    /// No part of a chessboard.
    #[error("no chessboard found ({saddles} places look like a corner, none belong together)")]
    NotFound {
        /// Places that look like a corner.
        saddles: usize,
    },
    /// A chessboard of another size, or a part of one: which of its corners these are cannot be told.
    #[error(
        "{corners} corners found, in {columns} x {rows}; expected {wanted_columns} x {wanted_rows}, and which part of a chessboard is \
         in view cannot be told"
    )]
    OtherSize {
        /// Corners.
        corners: usize,
        /// Columns of the box around them.
        columns: usize,
        /// Rows.
        rows: usize,
        /// Columns asked for.
        wanted_columns: usize,
        /// Rows asked for.
        wanted_rows: usize,
    },
    /// A chessboard, but not the markers asked for.
    #[error(
        "a chessboard of {corners} corners found, but in it no marker of this dictionary and board, or several that disagree"
    )]
    NoMarkers {
        /// Corners.
        corners: usize,
    },
    /// Too little of the board.
    #[error("only {corners} of the board's corners found; {LEAST_CORNERS} at least are needed")]
    Few {
        /// Corners.
        corners: usize,
    },
}

/// Returns the board's inner corners that are in view, by their numbers.
///
/// Of a plain chessboard all columns and rows must be in view, a corner or two may be hidden; corner 0 is nearer to the photo's
/// upper left than the last, columns and rows in the sense of a board seen from its front. Of a `ChArUco` board any part will do.
///
/// # Errors
/// [`NoBoard`] says what was found instead.
pub fn find_corners(photo: &Luma, board: &Board) -> Result<Vec<Corner>, NoBoard> {
    let full = Grey {
        width: photo.width,
        height: photo.height,
        data: photo.data.iter().map(|value| f32::from(*value)).collect(),
    };
    let found = placed(&full, &searched(&full, board)?, board);
    if found.len() < LEAST_CORNERS {
        return Err(NoBoard::Few { corners: found.len() });
    }
    Ok(found)
}

/// The most corners of the board that are found at one of the resolutions, in pixels.
fn searched(full: &Grey, board: &Board) -> Result<Named, NoBoard> {
    let (mut best, mut largest) = (Named::new(), Grid::default());
    let (mut saddles_found, mut searched) = (0, 0);
    let (mut level, mut step_px) = (full.clone(), 1.0);
    while searched <= COARSER && level.width.min(level.height) > 32 && best.len() < board.corners() {
        if level.width.max(level.height) <= LONGEST {
            let field = Field::new(&level, board.pattern);
            let saddles = field.saddles();
            saddles_found = saddles_found.max(saddles.len());
            let grid = largest_grid(&field, &saddles, board);
            let named = match board.pattern {
                _ if grid.size().iter().min() < Some(&least_side(board)) => None,
                Pattern::Chessboard => place::on_chessboard(&grid, board),
                Pattern::Charuco(dictionary) => markers::on_charuco(&grid, &level, board, dictionary),
            };
            if let Some(named) = named.filter(|named| named.len() > best.len()) {
                best = named.into_iter().map(|(number, at)| (number, at * step_px)).collect();
            }
            if grid.corners.len() > largest.corners.len() {
                largest = grid;
            }
            searched += 1;
        }
        level = halved(&blurred(&level, HALVING_BLUR));
        step_px *= 2.0;
    }
    if !best.is_empty() {
        return Ok(best);
    }
    let [columns, rows] = largest.size();
    let corners = largest.corners.len();
    Err(match board.pattern {
        _ if columns.min(rows) < least_side(board) => NoBoard::NotFound { saddles: saddles_found },
        Pattern::Charuco(_) => NoBoard::NoMarkers { corners },
        Pattern::Chessboard => NoBoard::OtherSize {
            corners,
            columns: columns.max(rows),
            rows: columns.min(rows),
            wanted_columns: board.columns,
            wanted_rows: board.rows,
        },
    })
}

/// Columns and rows that a part of the board must have: what markers name is no pattern of the background.
fn least_side(board: &Board) -> usize {
    match board.pattern {
        Pattern::Chessboard => LEAST_SIDE,
        Pattern::Charuco(_) => 2,
    }
}

/// Corners placed exactly; those are left out that cannot be.
fn placed(full: &Grey, found: &Named, board: &Board) -> Vec<Corner> {
    let image = blurred(full, PLACING_BLUR);
    let share = match board.pattern {
        Pattern::Chessboard => SHARE,
        Pattern::Charuco(_) => SHARE_BETWEEN_MARKERS,
    };
    let mut places = found.clone();
    for round in 0..ROUNDS {
        let around = |number: &usize| surroundings(&places, *number, board, round > 0);
        let moved =
            |(number, at): (&usize, &Vector2<f64>)| Some((*number, refined(&image, *at, &around(number)?, share)?));
        places = places.iter().filter_map(moved).collect();
    }
    // From samples to pixels: the first sample is the pixel with its centre at (0.5, 0.5).
    places.into_iter().map(|(number, at)| Corner { number, pixel: at.add_scalar(0.5) }).collect()
}

/// `None` where a corner has no other beside it in its row or column. Bends are zero unless asked for, and where only two corners
/// are seen.
fn surroundings(places: &Named, number: usize, board: &Board, bent: bool) -> Option<Surroundings> {
    let (column, row) = (number % board.columns, number / board.columns);
    let along = |place: usize, count: usize, stride: usize| {
        let near = |steps: i64| {
            let on = (0..count as i64).contains(&(place as i64 + steps));
            on.then(|| places.get(&((number as i64 + steps * stride as i64) as usize)).copied()).flatten()
        };
        let (step, bend) = derivatives(near)?;
        Some((step, if bent { bend } else { Vector2::zeros() }))
    };
    let (right, right_bend) = along(column, board.columns, 1)?;
    let (down, down_bend) = along(row, board.rows, board.columns)?;
    let steps = Matrix2::from_columns(&[right, down]);
    // Of a bend, what leads away from its line. What stretches the line itself moves no crossing, and taken off it would make the
    // blur, which is even in the photo, uneven.
    let in_steps = steps.try_inverse()?;
    Some(Surroundings { steps, bends: [down * (in_steps * right_bend).y, right * (in_steps * down_bend).x] })
}

/// First and second derivative by squares of the places along a line, where `near` knows those so many squares away: central
/// differences, else one-sided ones of as many corners as there are (Fornberg, "Generation of finite difference formulas on
/// arbitrarily spaced grids", 1988, table 3).
fn derivatives(near: impl Fn(i64) -> Option<Vector2<f64>>) -> Option<(Vector2<f64>, Vector2<f64>)> {
    let here = near(0)?;
    let way = match (near(-1), near(1)) {
        (Some(before), Some(after)) => return Some(((after - before) * 0.5, after + before - here * 2.0)),
        (Some(_), None) => -1,
        (None, _) => 1,
    };
    let first = near(way)?;
    let sign = way as f64;
    Some(match (near(2 * way), near(3 * way)) {
        (Some(second), Some(third)) => (
            (first * 18.0 - here * 11.0 - second * 9.0 + third * 2.0) * (sign / 6.0),
            here * 2.0 - first * 5.0 + second * 4.0 - third,
        ),
        (Some(second), None) => ((first * 4.0 - here * 3.0 - second) * (sign / 2.0), second - first * 2.0 + here),
        (None, _) => ((first - here) * sign, Vector2::zeros()),
    })
}

#[cfg(test)]
mod tests;
