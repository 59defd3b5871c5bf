//! A symmetric positive definite matrix in block envelope (skyline) storage.
//!
//! The reduced camera system of a tunnel is banded (a photo couples only to photos within one footprint's length) with a few
//! dense rows at the end (unknowns that all photos share). The envelope holds both and Cholesky creates no fill outside it,
//! so the cost is linear in the tunnel's length. George & Liu, "Computer Solution of Large Sparse Positive Definite
//! Systems", 1981, section 4.
//!
//! Rows come in blocks (a camera, the shared unknowns) whose heights are multiples of [`TILE`]; all rows of a block start at
//! the same column, itself the start of a block, and end with the block's own square, so that kernels work on whole tiles.

use std::ops::Range;

/// Heights of blocks are multiples of this: 6 and 9 unknowns per camera are.
pub(super) const TILE: usize = 3;
/// A kernel may write zeros to so many values beyond a row.
pub(super) const SLACK: usize = 16;

/// Lower triangle, block by block, each row from its block's first column to the end of its block.
#[derive(Clone, Debug, Default)]
pub(crate) struct Envelope {
    blocks: Vec<Block>,
    values: Vec<f64>,
}

/// Rows that share their first column.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Block {
    /// First row, which is also the first column of the block's own square.
    pub(super) row: usize,
    /// Number of rows.
    pub(super) height: usize,
    /// First stored block column.
    pub(super) first: usize,
    /// First stored column.
    column: usize,
    /// Where the values start.
    start: usize,
}

impl Block {
    fn width(&self) -> usize {
        self.row + self.height - self.column
    }

    /// Where the values of a row from `column` on lie among all values.
    pub(super) fn at(&self, offset: usize, column: usize) -> usize {
        self.start + offset * self.width() + column - self.column
    }

    /// First stored column.
    pub(super) fn column(&self) -> usize {
        self.column
    }
}

impl Envelope {
    /// A zero matrix of blocks `(height, first stored block)`.
    pub(crate) fn new(shape: impl IntoIterator<Item = (usize, usize)>) -> Self {
        let mut envelope = Self::default();
        envelope.reset(shape);
        envelope
    }

    /// Makes it [`Self::new`] of a shape, in the memory that there is.
    pub(super) fn reset(&mut self, shape: impl IntoIterator<Item = (usize, usize)>) {
        let Self { blocks, values } = self;
        blocks.clear();
        let (mut row, mut start) = (0, 0);
        for (height, first) in shape {
            debug_assert!(height % TILE == 0 && first <= blocks.len(), "block of {height} rows from block {first}");
            let column = blocks.get(first).map_or(row, |block| block.row);
            let block = Block { row, height, first, column, start };
            row += height;
            start += height * block.width();
            blocks.push(block);
        }
        values.clear();
        values.resize(start + SLACK, 0.0);
    }

    pub(super) fn size(&self) -> usize {
        self.blocks.last().map_or(0, |block| block.row + block.height)
    }

    pub(super) fn blocks(&self) -> &[Block] {
        &self.blocks
    }

    pub(super) fn clear(&mut self) {
        self.values.fill(0.0);
    }

    /// Values of row `offset` of a block, from the block's first stored column to the end of its own square.
    pub(super) fn row(&self, block: usize, offset: usize) -> &[f64] {
        let width = self.blocks[block].width();
        let start = self.blocks[block].start + offset * width;
        &self.values[start..start + width]
    }

    /// The stored columns `columns` of a row.
    pub(super) fn part(&self, block: usize, offset: usize, columns: Range<usize>) -> &[f64] {
        let start = self.blocks[block].at(offset, columns.start);
        &self.values[start..start + columns.len()]
    }

    /// See [`Self::part`].
    pub(super) fn part_mut(&mut self, block: usize, offset: usize, columns: Range<usize>) -> &mut [f64] {
        let start = self.blocks[block].at(offset, columns.start);
        &mut self.values[start..start + columns.len()]
    }

    /// The values from `(row, column)` on for a kernel, and the distance between rows.
    pub(super) fn corner_mut(&mut self, block: usize, column: usize) -> (&mut [f64], usize) {
        let block = &self.blocks[block];
        (&mut self.values[block.at(0, column)..], block.width())
    }

    /// Splits the values before a block from the block's own and all later ones.
    pub(super) fn split_at(&mut self, block: usize) -> (&[Block], &[f64], &mut [f64]) {
        let (done, rest) = self.values.split_at_mut(self.blocks[block].start);
        (&self.blocks, done, rest)
    }

    /// Splits the values before a run of blocks from each block's own.
    pub(super) fn split_run(&mut self, run: Range<usize>) -> (&[Block], &[f64], Vec<&mut [f64]>) {
        let (blocks, done, mut rest) = self.split_at(run.start);
        let own = blocks[run].iter().map(|block| {
            let (own, after) = std::mem::take(&mut rest).split_at_mut(block.height * block.width());
            rest = after;
            own
        });
        (blocks, done, own.collect())
    }

    /// The block that holds a row, and the row's offset in it.
    pub(super) fn locate(&self, row: usize) -> (usize, usize) {
        let block = self.blocks.partition_point(|block| block.row <= row) - 1;
        (block, row - self.blocks[block].row)
    }

    /// Multiplies the diagonal.
    pub(crate) fn scale_diagonal(&mut self, factor: f64) {
        for block in &self.blocks {
            for offset in 0..block.height {
                self.values[block.at(offset, block.row + offset)] *= factor;
            }
        }
    }

    /// Adds to an entry of the lower triangle, which must lie in the envelope.
    pub(crate) fn add(&mut self, row: usize, column: usize, value: f64) {
        let (block, offset) = self.locate(row);
        self.part_mut(block, offset, column..column + 1)[0] += value;
    }
}
