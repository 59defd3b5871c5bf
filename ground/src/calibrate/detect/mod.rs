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
    #[error("a chessboard of {corners} corners found, but in it no marker of this dictionary and board, or several that disagree")]
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
    let (mut best, mut best_step_px) = (Named::new(), 1.0);
    let mut largest = Grid::default();
    let mut saddles_found = 0;
    let mut level = full.clone();
    let mut step_px = 1.0;
    let mut searched = 0;
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
                (best, best_step_px) = (named, step_px);
            }
            if grid.corners.len() > largest.corners.len() {
                largest = grid;
            }
            searched += 1;
        }
        level = halved(&blurred(&level, HALVING_BLUR));
        step_px *= 2.0;
    }
    let [columns, rows] = largest.size();
    if columns.min(rows) < least_side(board) {
        return Err(NoBoard::NotFound { saddles: saddles_found });
    }
    let corners = largest.corners.len();
    if best.is_empty() {
        return Err(match board.pattern {
            Pattern::Chessboard => NoBoard::OtherSize {
                corners,
                columns: columns.max(rows),
                rows: columns.min(rows),
                wanted_columns: board.columns,
                wanted_rows: board.rows,
            },
            Pattern::Charuco(_) => NoBoard::NoMarkers { corners },
        });
    }
    let found = placed(&full, &best, best_step_px, board);
    if found.len() < LEAST_CORNERS {
        return Err(NoBoard::Few { corners: found.len() });
    }
    Ok(found)
}

/// Columns and rows that a part of the board must have: what markers name is no pattern of the background.
fn least_side(board: &Board) -> usize {
    match board.pattern {
        Pattern::Chessboard => LEAST_SIDE,
        Pattern::Charuco(_) => 2,
    }
}

/// Corners at full resolution; those are left out that cannot be placed.
fn placed(full: &Grey, coarse: &Named, step_px: f64, board: &Board) -> Vec<Corner> {
    let image = blurred(full, PLACING_BLUR);
    let share = match board.pattern {
        Pattern::Chessboard => 0.3,
        Pattern::Charuco(_) => 0.14,
    };
    let mut places: Named = coarse.iter().map(|(number, at)| (*number, at * step_px)).collect();
    for round in 0..ROUNDS {
        let around = |number: &usize| surroundings(&places, *number, board, round > 0);
        let moved = |(number, at): (&usize, &Vector2<f64>)| Some((*number, refined(&image, *at, &around(number)?, share)?));
        places = places.iter().filter_map(moved).collect();
    }
    // From samples to pixels: the first sample is the pixel with its centre at (0.5, 0.5).
    places.into_iter().map(|(number, at)| Corner { number, pixel: at.add_scalar(0.5) }).collect()
}

/// `None` where a corner stands alone in its row or column. Bends are zero unless asked for, and where only two corners are seen.
fn surroundings(places: &Named, number: usize, board: &Board, bent: bool) -> Option<Surroundings> {
    let [column, row] = [number % board.columns, number / board.columns].map(|place| place as i64);
    let at = |column: i64, row: i64| {
        let on = (0..board.columns as i64).contains(&column) && (0..board.rows as i64).contains(&row);
        on.then(|| places.get(&(row as usize * board.columns + column as usize)).copied()).flatten()
    };
    let along = |[x, y]: [i64; 2]| {
        // The first and second derivative by squares, from as many corners as there are: central, else to this side or that.
        let near = |steps: i64| at(column + steps * x, row + steps * y);
        let one_sided = |way: i64| {
            let [here, first] = [near(0)?, near(way)?];
            let way = way as f64;
            Some(match (near(2 * way as i64), near(3 * way as i64)) {
                (Some(second), Some(third)) => (
                    (first * 18.0 - here * 11.0 - second * 9.0 + third * 2.0) * (way / 6.0),
                    here * 2.0 - first * 5.0 + second * 4.0 - third,
                ),
                (Some(second), None) => ((first * 4.0 - here * 3.0 - second) * (way / 2.0), second - first * 2.0 + here),
                _ => ((first - here) * way, Vector2::zeros()),
            })
        };
        let here = near(0)?;
        let (step, bend) = match (near(-1), near(1)) {
            (Some(before), Some(after)) => ((after - before) * 0.5, after + before - here * 2.0),
            (before, _) => one_sided(if before.is_some() { -1 } else { 1 })?,
        };
        Some((step, if bent { bend } else { Vector2::zeros() }))
    };
    let [(right, right_bend), (down, down_bend)] = [along([1, 0])?, along([0, 1])?];
    let steps = Matrix2::from_columns(&[right, down]);
    let in_steps = steps.try_inverse()?;
    Some(Surroundings { steps, bends: [down * (in_steps * right_bend).y, right * (in_steps * down_bend).x] })
}

#[cfg(test)]
mod tests;
