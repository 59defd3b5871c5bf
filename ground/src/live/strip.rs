//! The wall that the photos so far show, from their tags alone: where it has a gap one can still fly back to.
//!
//! # Model
//! Each photo is posed by its tag: odometer, place in the section, attitude, shaft angle, mounting. A cell of the wall counts
//! as seen by it if the cell's centre falls into the image and nothing of the section hides it. A cell is *behind* if the
//! vehicle has been so far beyond it that no photo from where it is now shows it. A photo counts once the board has told that
//! it was taken: nothing that is missing looks seen meanwhile. Cells that too few photos show are marked once they are behind,
//! and those of a missed photo at once, until another shows them; what is marked and behind is a gap to fly back to.
//! # Limits
//! Centimetres of odometer and degrees of attitude are not known better here than the tag says: the strip tells where to
//! look again, the reconstruction tells what was seen. Memory grows by 4 KB per metre of a 3 m pipe, up to [`MOST_BLOCKS`].

use std::collections::{BTreeMap, VecDeque};
use std::ops::RangeInclusive;
use std::sync::Arc;

use adit_geometry::SectionVector;
use adit_geometry::coverage::Scene;
use adit_geometry::profile::SurfacePoint;
use adit_geometry::rig::attitude;
use adit_protocol::tag::CaptureTag;
use nalgebra::{Isometry3, Point3, Translation3};

use super::setting::{Setting, SettingError};
use crate::texture::{Hole, Lattice, measure};

/// Side of a cell.
const CELL_M: f64 = 0.05;
/// Rows of a block, the unit in which the strip grows and is sent.
pub(super) const BLOCK_ROWS: i64 = 64;
/// More than six kilometres.
pub(super) const MOST_BLOCKS: usize = 2048;
/// Farther from its zero no odometer of a survey counts.
const FARTHEST_M: f64 = 100_000.0;
/// Photos whose fate may still be told.
const REMEMBERED: usize = 64;
/// Gaps are sought over this length behind the vehicle: farther back nobody flies for one.
const SOUGHT_M: f64 = 30.0;
/// Slivers with fewer cells come from the cells themselves.
const LEAST_GAP_CELLS: f64 = 4.0;
/// What attitude and offset add to a photo's reach along the axis.
const REACH_FACTOR: f64 = 1.1;

const COUNT: u8 = 0x3F;
const MISSED: u8 = 0x80;

/// How well a cell is seen.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Cell {
    /// Not yet.
    Ahead,
    /// By no photo, and left behind or meant to be seen by a photo that is missing.
    Gap,
    /// Likewise by fewer than needed.
    Thin,
    /// By fewer than needed so far.
    Begun,
    /// By enough.
    Seen,
}

/// A stretch of the strip.
#[derive(Debug)]
pub struct Block {
    /// The strip's count of changes at the block's last.
    revision: u64,
    /// Views and marks, row by row from the crown clockwise.
    cells: Vec<u8>,
}

impl Block {
    /// The strip's count of changes at the block's last.
    pub(super) fn revision(&self) -> u64 {
        self.revision
    }
}

/// A column of cells along the axis.
#[derive(Clone, Copy, Debug)]
struct Column {
    wall: SurfacePoint<f64>,
    /// A photo at x shows the column at most this far ahead and behind.
    reach_m: f64,
}

#[derive(Clone, Copy, Debug)]
struct Photo {
    capture: u32,
    tunnel_from_cam: Isometry3<f64>,
    /// Whether its fate was told.
    is_told: bool,
}

/// The strip.
#[derive(Debug)]
pub struct Strip {
    setting: Arc<Setting>,
    columns: Vec<Column>,
    is_convex: bool,
    cell_m: f64,
    blocks: BTreeMap<i64, Block>,
    revision: u64,
    /// Where the camera was, lowest and highest x.
    flown_m: Option<[f64; 2]>,
    offset_m: [f64; 2],
    photos: VecDeque<Photo>,
    unplaced: u64,
    gaps: Vec<Hole>,
}

impl Strip {
    /// Nothing is seen yet.
    ///
    /// # Errors
    /// [`SettingError::Coverage`] for an impossible number of images per turn.
    pub fn new(setting: Arc<Setting>) -> Result<Self, SettingError> {
        let scene = Scene::new(&setting.profile, &setting.footprint, &setting.rig, SectionVector::zeros(), 0.0)?;
        let around = Lattice::coarse(setting.profile.perimeter_m(), CELL_M / 4.0, 0.0, 0.0);
        let columns = (0..around.columns).filter_map(|column| {
            let line = scene.wall_line(around.s_m(column as i64))?;
            let reach_m = line.views.iter().map(|view| view.to_m.max(-view.from_m)).fold(0.0, f64::max);
            Some(Column { wall: line.surface, reach_m: reach_m * REACH_FACTOR + CELL_M })
        });
        let columns = columns.collect();
        let (is_convex, cell_m) = (setting.profile.is_convex(), around.step_s_m);
        Ok(Self {
            setting,
            columns,
            is_convex,
            cell_m,
            blocks: BTreeMap::new(),
            revision: 0,
            flown_m: None,
            offset_m: [0.0; 2],
            photos: VecDeque::new(),
            unplaced: 0,
            gaps: Vec::new(),
        })
    }

    /// Side of a cell.
    pub fn cell_m(&self) -> f64 {
        self.cell_m
    }

    /// Cells around the wall.
    pub fn columns(&self) -> usize {
        self.columns.len()
    }

    /// Counts the strip's changes.
    pub fn revision(&self) -> u64 {
        self.revision
    }

    /// The stretches that are there, by their number: block `n` begins at `x = n * 64 * cell_m`.
    pub fn blocks(&self) -> impl Iterator<Item = (i64, &Block)> {
        self.blocks.iter().map(|(number, block)| (*number, block))
    }

    /// Photos that have no place along the axis, or one beyond the strip.
    pub fn unplaced(&self) -> u64 {
        self.unplaced
    }

    /// Gaps behind the vehicle, largest first.
    pub fn gaps(&self) -> &[Hole] {
        &self.gaps
    }

    /// A photo's tag was heard; false if it has no place or is known already.
    pub fn add(&mut self, tag: &CaptureTag) -> bool {
        if self.photos.iter().any(|photo| photo.capture == tag.capture) {
            return false;
        }
        let Some(tunnel_from_cam) = self.pose(tag) else {
            self.unplaced += 1;
            return false;
        };
        if self.photos.len() == REMEMBERED {
            self.photos.pop_front();
        }
        self.photos.push_back(Photo { capture: tag.capture, tunnel_from_cam, is_told: false });
        true
    }

    /// A photo's fate was heard: taken, it counts; else what it would have shown is a gap until another shows it. False if its
    /// tag was not heard, or its fate before.
    pub fn tell(&mut self, capture: u32, is_taken: bool) -> bool {
        let Some(photo) = self.photos.iter_mut().find(|photo| photo.capture == capture && !photo.is_told) else {
            return false;
        };
        photo.is_told = true;
        let tunnel_from_cam = photo.tunnel_from_cam;
        // What shows it now takes the place of what was missed.
        self.change(&tunnel_from_cam, |cell| {
            *cell = if is_taken { ((*cell & COUNT) + 1).min(COUNT) } else { *cell | MISSED };
        });
        self.reach(tunnel_from_cam.translation.x);
        self.seek_gaps();
        true
    }

    /// The board starts to count anew; what was seen stays seen.
    pub fn forget_captures(&mut self) {
        self.photos.clear();
    }

    /// How well a block's cells are seen, row by row.
    pub fn seen_of(&self, number: i64, block: &Block) -> Vec<Cell> {
        let columns = self.columns.len();
        let rows = block.cells.chunks_exact(columns).zip(number * BLOCK_ROWS..);
        rows.flat_map(|(cells, row)| {
            let x_m = self.x_m(row);
            cells.iter().zip(&self.columns).map(move |(cell, column)| self.judge(*cell, x_m, column))
        })
        .collect()
    }

    fn is_behind(&self, x_m: f64, column: &Column) -> bool {
        self.flown_m.is_some_and(|[from_m, to_m]| (from_m + column.reach_m..=to_m - column.reach_m).contains(&x_m))
    }

    fn judge(&self, cell: u8, x_m: f64, column: &Column) -> Cell {
        let is_left = cell & MISSED != 0 || self.is_behind(x_m, column);
        match cell & COUNT {
            count if count >= self.setting.views => Cell::Seen,
            0 if is_left => Cell::Gap,
            0 => Cell::Ahead,
            _ if is_left => Cell::Thin,
            _ => Cell::Begun,
        }
    }

    /// Where the tag puts the photo; the place in the section is the last known one where it has none.
    fn pose(&mut self, tag: &CaptureTag) -> Option<Isometry3<f64>> {
        let x_m = f64::from(tag.odometer_m?);
        self.offset_m = tag.offset_m.map_or(self.offset_m, |offset_m| offset_m.map(f64::from));
        let [roll, pitch, yaw] = tag.attitude_rad.unwrap_or_default().map(f64::from);
        let [y_m, z_m] = self.offset_m;
        let numbers = [x_m, y_m, z_m, roll, pitch, yaw, f64::from(tag.shaft_rad)];
        let is_sound = x_m.abs() <= FARTHEST_M && numbers.iter().all(|number| number.is_finite());
        let body = Translation3::new(x_m, y_m, z_m);
        let tunnel_from_body = Isometry3::from_parts(body, attitude(roll, pitch, yaw));
        is_sound.then(|| tunnel_from_body * self.setting.rig.body_from_cam(f64::from(tag.shaft_rad)))
    }

    fn farthest_m(&self) -> f64 {
        self.columns.iter().map(|column| column.reach_m).fold(0.0, f64::max)
    }

    fn x_m(&self, row: i64) -> f64 {
        (row as f64 + 0.5) * self.cell_m
    }

    fn row_at(&self, x_m: f64) -> i64 {
        (x_m / self.cell_m).floor() as i64
    }

    fn block_at(&self, x_m: f64) -> i64 {
        self.row_at(x_m).div_euclid(BLOCK_ROWS)
    }

    /// The camera was at `x_m`: cells may be behind it now.
    fn reach(&mut self, x_m: f64) {
        let [from_m, to_m] = self.flown_m.unwrap_or([x_m; 2]);
        self.flown_m = Some([from_m.min(x_m), to_m.max(x_m)]);
        let (low_m, high_m) = (x_m.min(to_m), x_m.max(from_m));
        let reach_m = self.farthest_m();
        for (_, block) in self.blocks.range_mut(self.block_at(low_m - reach_m)..=self.block_at(high_m + reach_m)) {
            block.revision = self.revision;
        }
    }

    /// Changes every cell that a photo from there shows.
    fn change(&mut self, tunnel_from_cam: &Isometry3<f64>, mut change: impl FnMut(&mut u8)) {
        self.revision += 1;
        let columns = self.columns.len();
        for (row, column) in self.shown(tunnel_from_cam) {
            let number = row.div_euclid(BLOCK_ROWS);
            if !self.blocks.contains_key(&number) && self.blocks.len() >= MOST_BLOCKS {
                continue;
            }
            let block = self
                .blocks
                .entry(number)
                .or_insert_with(|| Block { revision: 0, cells: vec![0; columns * BLOCK_ROWS as usize] });
            block.revision = self.revision;
            if let Some(cell) = block.cells.get_mut(row.rem_euclid(BLOCK_ROWS) as usize * columns + column) {
                change(cell);
            }
        }
    }

    /// Row and column of every cell that a photo shows.
    fn shown(&self, tunnel_from_cam: &Isometry3<f64>) -> Vec<(i64, usize)> {
        let (camera, cam_from_tunnel) = (&self.setting.camera, tunnel_from_cam.inverse());
        let centre = tunnel_from_cam.translation.vector;
        let from = SectionVector::new(centre.y, centre.z);
        // The offset may bring a wall nearer and another farther than it is from the axis.
        let reach_m = 2.0 * self.farthest_m();
        let rows: RangeInclusive<i64> = self.row_at(centre.x - reach_m)..=self.row_at(centre.x + reach_m);
        let mut shown = Vec::new();
        for (number, column) in self.columns.iter().enumerate().filter(|(_, column)| self.is_in_sight(from, column)) {
            let point = column.wall.point;
            let visible = rows.clone().filter(|row| {
                let in_cam = cam_from_tunnel * Point3::new(self.x_m(*row), point.x, point.y);
                camera.project(&in_cam.coords).is_some_and(|pixel| camera.contains(&pixel, 0.0))
            });
            shown.extend(visible.map(|row| (row, number)));
        }
        shown
    }

    fn is_in_sight(&self, from: SectionVector<f64>, column: &Column) -> bool {
        let to_wall = column.wall.point - from;
        let hidden = || {
            let first = self.setting.profile.ray_cast(from, to_wall);
            first.is_some_and(|hit| hit.distance < 1.0 - 1e-3)
        };
        to_wall.dot(&column.wall.normal) < 0.0 && (self.is_convex || !hidden())
    }

    fn seek_gaps(&mut self) {
        let Some([from_m, to_m]) = self.flown_m else { return };
        let first = self.row_at(from_m.max(to_m - SOUGHT_M) - self.farthest_m());
        let rows = self.row_at(to_m + self.farthest_m()) - first + 1;
        let columns = self.columns.len();
        let lattice = Lattice {
            step_s_m: self.cell_m,
            step_x_m: self.cell_m,
            columns,
            rows: rows.max(0) as usize,
            x0_m: first as f64 * self.cell_m,
        };
        let mut counts = vec![1_u16; columns * lattice.rows];
        for (row, counts) in (first..).zip(counts.chunks_exact_mut(columns)) {
            let number = row.div_euclid(BLOCK_ROWS);
            let within = row.rem_euclid(BLOCK_ROWS) as usize * columns;
            let cells = self.blocks.get(&number).and_then(|block| block.cells.get(within..within + columns));
            for ((index, count), column) in counts.iter_mut().enumerate().zip(&self.columns) {
                let views = cells.and_then(|cells| cells.get(index)).copied().unwrap_or(0) & COUNT;
                *count = u16::from(views >= self.setting.views || !self.is_behind(self.x_m(row), column));
            }
        }
        let stretch = [lattice.x0_m, lattice.x_m(rows)];
        let mut gaps = measure(&counts, &lattice, &self.setting.profile, stretch).holes;
        gaps.retain(|gap| gap.area_m2 > (LEAST_GAP_CELLS - 0.5) * self.cell_m * self.cell_m);
        self.gaps = gaps;
    }
}

#[cfg(test)]
mod tests;
