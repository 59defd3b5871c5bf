//! Which corner of the board each corner of a grid is.

use std::collections::BTreeMap;

use nalgebra::Vector2;

use super::super::Board;
use super::grid::{Cell, Grid};

/// Corners by their number on the board, in samples of the image they were found in.
pub(super) type Named = BTreeMap<usize, Vector2<f64>>;

/// The grid's corners that are on the board if the cell `origin` is its first corner.
pub(super) fn named(grid: &Grid, origin: Cell, board: &Board) -> Named {
    let number = |cell: &Cell| {
        let [column, row] = [cell[0] - origin[0], cell[1] - origin[1]];
        let on = (0..board.columns as i32).contains(&column) && (0..board.rows as i32).contains(&row);
        on.then(|| row as usize * board.columns + column as usize)
    };
    grid.corners.iter().filter_map(|(cell, at)| Some((number(cell)?, *at))).collect()
}

/// The corners of a chessboard, which looks the same everywhere: its first corner is nearer to the photo's upper left than its
/// last. `None` unless all its columns and rows are there, a hole or two allowed, and nothing else could be meant.
pub(super) fn on_chessboard(grid: &Grid, board: &Board) -> Option<Named> {
    let size = [board.columns as i32, board.rows as i32];
    let mut best: Vec<Named> = Vec::new();
    for turns in 0..2 {
        let grid = grid.turned(turns);
        let [low, high] = grid.bounds();
        let origins = |axis: usize| low[axis]..=high[axis] - size[axis] + 1;
        for x in origins(0) {
            for y in origins(1) {
                let found = named(&grid, [x, y], board);
                if !is_spanned(&found, board) || best.first().is_some_and(|best| best.len() > found.len()) {
                    continue;
                }
                if best.first().is_some_and(|best| best.len() < found.len()) {
                    best.clear();
                }
                best.push(found);
            }
        }
    }
    let places = |named: &Named| {
        let mut places: Vec<[f64; 2]> = named.values().map(|at| (*at).into()).collect();
        places.sort_by(|a, b| a[0].total_cmp(&b[0]).then(a[1].total_cmp(&b[1])));
        places
    };
    let first = best.pop()?;
    let same = places(&first);
    // A square board fits both ways.
    if best.iter().any(|other| places(other) != same) {
        return None;
    }
    Some(if is_upside_down(&first, board) { half_turned(&first, board) } else { first })
}

/// Whether first and last columns and rows have corners.
fn is_spanned(corners: &Named, board: &Board) -> bool {
    let has = |axis: fn(usize, usize) -> usize, place: usize| {
        corners.keys().any(|number| axis(*number, board.columns) == place)
    };
    let column = |number, columns| number % columns;
    let row = |number, columns| number / columns;
    has(column, 0) && has(column, board.columns - 1) && has(row, 0) && has(row, board.rows - 1)
}

fn is_upside_down(corners: &Named, board: &Board) -> bool {
    let along = |number: usize| (number % board.columns + number / board.columns) as f64;
    let count = corners.len() as f64;
    let middle = corners.keys().map(|number| along(*number)).sum::<f64>() / count;
    corners.iter().map(|(number, at)| (along(*number) - middle) * at.sum()).sum::<f64>() < 0.0
}

fn half_turned(corners: &Named, board: &Board) -> Named {
    corners.iter().map(|(number, at)| (board.corners() - 1 - number, *at)).collect()
}
