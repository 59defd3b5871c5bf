//! Reads the markers of a `ChArUco` board between the corners of a grid.
//!
//! Corners come first, markers second: a grid of saddles is there for any chessboard, and each of its cells says exactly where a
//! marker's cells lie, however the lens bends the whole. (The usual way, from markers to corners, has to find squares in a
//! photo first, and loses the corners beside a marker that is partly out of view.)

use std::collections::BTreeMap;

use adit_geometry::charuco::{Dictionary, marker_in};
use nalgebra::{Matrix3, Vector2};

use super::super::Board;
use super::super::fit::homography;
use super::grid::{Cell, Grid, add};
use super::place::{Named, named};
use super::saddle::bilinear;
use crate::raster::Grey;

/// Sides of markers tried, as shares of a square's: whoever prints a board chooses it.
const SIDES: [f64; 9] = [0.5, 0.55, 0.6, 0.65, 0.7, 0.75, 0.8, 0.85, 0.9];
/// Least difference between the brightest and the darkest cell, grey levels.
const LEAST_CONTRAST: f64 = 12.0;
/// More than so many times the markers that say otherwise must agree on where the board lies.
const MAJORITY: usize = 2;

/// The board's corners among the grid's by its markers; `None` if none is read or they disagree.
pub(super) fn on_charuco(grid: &Grid, image: &Grey, board: &Board, dictionary: Dictionary) -> Option<Named> {
    let cells: Vec<(Cell, Matrix3<f64>)> =
        grid.corners.keys().filter_map(|cell| Some((*cell, image_from_square(grid, *cell)?))).collect();
    let votes = SIDES.map(|side| {
        let mut votes: BTreeMap<(u8, Cell), usize> = BTreeMap::new();
        for (cell, image_from_square) in &cells {
            let seen = code(image, image_from_square, side, dictionary).and_then(|code| dictionary.find(code));
            let Some((marker, turns)) = seen else { continue };
            let Some(square) = square_of(marker, board) else { continue };
            // A marker turned clockwise in the grid stands upright in the grid turned back.
            let turns = (4 - turns) % 4;
            *votes.entry((turns, origin(*cell, turns, square))).or_default() += 1;
        }
        let mut ranked: Vec<(usize, (u8, Cell))> = votes.into_iter().map(|(place, count)| (count, place)).collect();
        ranked.sort_unstable_by(|a, b| b.cmp(a));
        ranked.truncate(2);
        ranked
    });
    let ranked = votes.into_iter().max_by_key(|ranked| ranked.first().map_or(0, |(count, _)| *count))?;
    let (count, (turns, origin)) = *ranked.first()?;
    let second = ranked.get(1).map_or(0, |(count, _)| *count);
    (count > MAJORITY * second).then(|| named(&grid.turned(turns), origin, board))
}

/// The cell that is the board's first corner in the grid turned so, if this cell's square is that one of the board.
fn origin(cell: Cell, turns: u8, square: Cell) -> Cell {
    // Upper left corner of the square after the turn: the least of its four.
    let corners = [[0, 0], [1, 0], [0, 1], [1, 1]].map(|step| Grid::turned_cell(add(cell, step), turns));
    let upper_left = [0, 1].map(|axis| corners.iter().map(|corner| corner[axis]).fold(i32::MAX, i32::min));
    // The board's first corner is the lower right one of its first square.
    [upper_left[0] - (square[0] - 1), upper_left[1] - (square[1] - 1)]
}

/// Column and row of a marker's square.
fn square_of(marker: usize, board: &Board) -> Option<Cell> {
    let columns = board.columns + 1;
    let mut squares = (0..=board.rows).flat_map(|row| (0..columns).map(move |column| (column, row)));
    let (column, row) = squares.find(|(column, row)| marker_in(*column, *row, columns) == Some(marker))?;
    Some([column as i32, row as i32])
}

/// From a square whose corners are (0, 0) to (1, 1), the first one the grid's `cell`, to the image.
fn image_from_square(grid: &Grid, cell: Cell) -> Option<Matrix3<f64>> {
    const STEPS: [Cell; 4] = [[0, 0], [1, 0], [0, 1], [1, 1]];
    let square = STEPS.map(|[x, y]| Vector2::new(f64::from(x), f64::from(y)));
    let mut image = [Vector2::zeros(); 4];
    for (at, step) in image.iter_mut().zip(STEPS) {
        *at = *grid.corners.get(&add(cell, step))?;
    }
    homography(&square, &image)
}

/// The cells of a marker in a square; `None` without its black frame.
fn code(image: &Grey, image_from_square: &Matrix3<f64>, side: f64, dictionary: Dictionary) -> Option<u64> {
    let cells = dictionary.side() + 2;
    let level = |column: usize, row: usize| {
        // Four samples around the cell's middle.
        let samples = [[-0.2, -0.2], [0.2, -0.2], [-0.2, 0.2], [0.2, 0.2]].map(|[x, y]| {
            let place = |cell: usize, off: f64| 0.5 - 0.5 * side + side * (cell as f64 + 0.5 + off) / cells as f64;
            let at = image_from_square * Vector2::new(place(column, x), place(row, y)).push(1.0);
            bilinear(image, at.xy() / at.z)
        });
        samples.iter().sum::<f64>() / 4.0
    };
    let levels: Vec<f64> = (0..cells * cells).map(|cell| level(cell % cells, cell / cells)).collect();
    let (dark, bright) = levels.iter().fold((f64::MAX, f64::MIN), |(low, high), v| (low.min(*v), high.max(*v)));
    if bright - dark < LEAST_CONTRAST {
        return None;
    }
    let mut code = 0;
    for (cell, level) in levels.iter().enumerate() {
        let is_white = *level > f64::midpoint(dark, bright);
        let on_frame = [cell % cells, cell / cells].iter().any(|place| *place == 0 || *place == cells - 1);
        if on_frame && is_white {
            return None;
        }
        if !on_frame {
            code = code << 1 | u64::from(is_white);
        }
    }
    Some(code)
}
