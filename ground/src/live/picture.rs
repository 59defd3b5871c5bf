//! The strip as it is shown: a copy that shares what has not changed with the copies before.

use std::collections::BTreeMap;
use std::sync::Arc;

use super::strip::{Cell, Strip};
use super::view::WallView;

/// A stretch of it: 64 rows along the axis.
#[derive(Debug)]
pub struct Stretch {
    /// The strip's count of changes at the last of this stretch.
    pub revision: u64,
    /// Row by row along the axis, each from the crown clockwise.
    pub cells: Vec<Cell>,
}

/// The strip at one moment.
#[derive(Clone, Debug, Default)]
pub struct Picture {
    /// Side of a cell.
    pub cell_m: f64,
    /// Cells around the wall.
    pub columns: usize,
    /// By their number: stretch `n` begins at `x = n * 64 * cell_m`.
    pub stretches: BTreeMap<i64, Arc<Stretch>>,
}

impl Picture {
    /// The strip now; stretches that have not changed are those of the picture before.
    pub(super) fn of(strip: &Strip, before: &Self) -> Self {
        let stretches = strip.blocks().map(|(number, block)| {
            let known = before.stretches.get(&number).filter(|known| known.revision == block.revision());
            let anew = || Arc::new(Stretch { revision: block.revision(), cells: strip.seen_of(number, block) });
            (number, known.map_or_else(anew, Arc::clone))
        });
        Self { cell_m: strip.cell_m(), columns: strip.columns(), stretches: stretches.collect() }
    }

    /// How much of it is seen.
    pub(super) fn wall(&self) -> Option<WallView> {
        let of = |wanted: fn(&Cell) -> bool| {
            let cells: usize =
                self.stretches.values().map(|stretch| stretch.cells.iter().filter(|cell| wanted(cell)).count()).sum();
            cells as f64 * self.cell_m * self.cell_m
        };
        (self.columns > 0).then(|| WallView {
            seen_m2: of(|cell| *cell == Cell::Seen),
            marked_m2: of(|cell| matches!(cell, Cell::Gap | Cell::Thin)),
        })
    }
}
