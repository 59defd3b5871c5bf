//! Finds a chessboard's inner corners in a photo.
//!
//! Saddles of brightness (`saddle`) are joined to a grid (`grid`), at full resolution first and then coarser, because near
//! boards are blurred and large; corners are then placed to a few hundredths of a pixel (`refine`).

mod grid;
mod refine;
mod saddle;

use nalgebra::Vector2;

use super::Board;
use crate::features::{blurred, halved};
use crate::raster::{Grey, Luma};
use grid::{Grid, largest_grid};
use saddle::Field;

/// Photos are halved until no side is longer than this; corners are placed at full resolution in the end.
const LONGEST: usize = 1700;
/// So many times halved again, if the whole board is not found before.
const COARSER: usize = 2;
/// Blur before halving, samples.
const HALVING_BLUR: f32 = 1.0;
/// Fewer corners in a row and column than this are a pattern of the background, not a board.
const LEAST_SIDE: usize = 3;

/// Why a photo shows no board that can be used.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum NoBoard {
    /// No part of a chessboard.
    #[error("no chessboard found ({saddles} places look like a corner, none belong together)")]
    NotFound {
        /// Places that look like a corner.
        saddles: usize,
    },
    /// A board of another size, or one that is partly hidden or out of view.
    #[error("{corners} corners found, in {columns} x {rows}; expected all {wanted_columns} x {wanted_rows}")]
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
    /// A corner cannot be placed.
    #[error("a corner near pixel ({x_px}, {y_px}) cannot be placed exactly")]
    Unsteady {
        /// Its column.
        x_px: u32,
        /// Its row.
        y_px: u32,
    },
}

/// Returns a board's inner corners in row order, pixels: first the row that starts nearest to the photo's upper left, columns
/// and rows in the sense of a board seen from its front.
///
/// # Errors
/// [`NoBoard`] says what was found instead.
pub fn find_corners(photo: &Luma, board: &Board) -> Result<Vec<Vector2<f64>>, NoBoard> {
    let full = Grey {
        width: photo.width,
        height: photo.height,
        data: photo.data.iter().map(|value| f32::from(*value)).collect(),
    };
    let wanted = [board.columns, board.rows];
    let mut best = (Grid::default(), 1.0);
    let mut saddles_found = 0;
    let mut level = full.clone();
    let mut step_px = 1.0;
    let mut searched = 0;
    while searched <= COARSER && level.width.min(level.height) > 32 {
        if level.width.max(level.height) <= LONGEST {
            let field = Field::new(&level);
            let saddles = field.saddles();
            saddles_found = saddles_found.max(saddles.len());
            let grid = largest_grid(&field, &saddles, board.corners());
            if let Some(corners) = grid.window(wanted) {
                return placed(&full, &corners, step_px, board);
            }
            if grid.corners.len() > best.0.corners.len() {
                best = (grid, step_px);
            }
            searched += 1;
        }
        level = halved(&blurred(&level, HALVING_BLUR));
        step_px *= 2.0;
    }
    let [columns, rows] = best.0.size();
    if columns.min(rows) < LEAST_SIDE {
        return Err(NoBoard::NotFound { saddles: saddles_found });
    }
    Err(NoBoard::OtherSize {
        corners: best.0.corners.len(),
        columns: columns.max(rows),
        rows: columns.min(rows),
        wanted_columns: wanted[0],
        wanted_rows: wanted[1],
    })
}

/// Corners at full resolution, in the order that [`find_corners`] promises.
fn placed(full: &Grey, coarse: &[Vector2<f64>], step_px: f64, board: &Board) -> Result<Vec<Vector2<f64>>, NoBoard> {
    let coarse: Vec<Vector2<f64>> = coarse.iter().map(|corner| corner * step_px).collect();
    let mut corners = Vec::with_capacity(coarse.len());
    for (index, corner) in coarse.iter().enumerate() {
        let nearest_px = neighbours(index, board).map(|other| (coarse[other] - corner).norm()).fold(f64::MAX, f64::min);
        let place = refine::refined(full, *corner, nearest_px)
            .ok_or(NoBoard::Unsteady { x_px: corner.x.max(0.0) as u32, y_px: corner.y.max(0.0) as u32 })?;
        // From samples to pixels: the first sample is the pixel with its centre at (0.5, 0.5).
        corners.push(place.add_scalar(0.5));
    }
    Ok(in_order(corners, board))
}

/// Indices of the corners beside one.
fn neighbours(index: usize, board: &Board) -> impl Iterator<Item = usize> {
    let (column, row) = (index % board.columns, index / board.columns);
    let left = (column > 0).then(|| index - 1);
    let right = (column + 1 < board.columns).then(|| index + 1);
    let above = (row > 0).then(|| index - board.columns);
    let below = (row + 1 < board.rows).then(|| index + board.columns);
    [left, right, above, below].into_iter().flatten()
}

fn in_order(mut corners: Vec<Vector2<f64>>, board: &Board) -> Vec<Vector2<f64>> {
    let along = corners[board.columns - 1] - corners[0];
    let down = corners[corners.len() - board.columns] - corners[0];
    if along.perp(&down) < 0.0 {
        corners.chunks_exact_mut(board.columns).for_each(<[_]>::reverse);
    }
    if corners[0].sum() > corners[corners.len() - 1].sum() {
        corners.reverse();
    }
    corners
}

#[cfg(test)]
mod tests;
