//! The unrolled wall as grids: texels of the panorama, and the coarser lattices on which blending is decided.

use adit_geometry::SectionVector;
use adit_geometry::profile::{Profile, ProfileSpec};
use serde::{Deserialize, Serialize};
use serde_json::{Value, json};

/// Mid-lattice cells along the side of a coarse-lattice cell.
pub(super) const MID_PER_COARSE: usize = 4;

/// The geometry of a panorama, as in `panorama.json`.
///
/// Column u, row v, pixel centres at +0.5: arc length from the crown, clockwise looking forward,
/// `s = s0_m + u * mm_per_px / 1000`; along the axis `x = x0_m + v * mm_per_px / 1000`.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct PanoramaGrid {
    /// Size of a texel. The width is a whole number of texels around the wall.
    pub mm_per_px: f64,
    /// Columns, once around.
    pub width_px: usize,
    /// Rows, along the axis.
    pub height_px: usize,
    /// Where the first row's upper edge lies along the axis.
    pub x0_m: f64,
    /// Where the first column's left edge lies around the wall.
    pub s0_m: f64,
    /// Once around the wall.
    pub perimeter_m: f64,
}

impl PanoramaGrid {
    /// Returns the grid with texels nearest to `mm_per_px` of which a whole number goes around, over `[x0_m, x1_m]`.
    pub fn new(perimeter_m: f64, mm_per_px: f64, x0_m: f64, x1_m: f64) -> Self {
        let width_px = (perimeter_m * 1000.0 / mm_per_px).round().max(1.0);
        let mm_per_px = perimeter_m * 1000.0 / width_px;
        let height_px = ((x1_m - x0_m) * 1000.0 / mm_per_px).ceil().max(1.0);
        Self { mm_per_px, width_px: width_px as usize, height_px: height_px as usize, x0_m, s0_m: 0.0, perimeter_m }
    }

    /// Size of a texel in metres.
    pub fn texel_m(&self) -> f64 {
        self.mm_per_px / 1000.0
    }

    /// Arc length of column position `u` (0.5 = centre of the first column).
    pub fn s_m(&self, u: f64) -> f64 {
        self.s0_m + u * self.texel_m()
    }

    /// Place along the axis of row position `v` (0.5 = centre of the first row).
    pub fn x_m(&self, v: f64) -> f64 {
        self.x0_m + v * self.texel_m()
    }

    /// The content of `panorama.json`.
    pub fn to_json(&self, profile: &ProfileSpec<f64>) -> Value {
        json!({
            "format": 1,
            "mm_per_px": self.mm_per_px,
            "width_px": self.width_px,
            "height_px": self.height_px,
            "x0_m": self.x0_m,
            "s0_m": self.s0_m,
            "perimeter_m": self.perimeter_m,
            "profile": profile_json(profile),
        })
    }
}

/// A profile with the keys of `survey.toml`'s `[tunnel]`.
pub fn profile_json(profile: &ProfileSpec<f64>) -> Value {
    match profile {
        ProfileSpec::Circle { radius_m } => json!({"profile": "circle", "radius_m": radius_m}),
        ProfileSpec::Rectangle { width_m, height_m, axis_height_m } => json!({
            "profile": "rectangle", "width_m": width_m, "height_m": height_m, "axis_height_m": axis_height_m,
        }),
        ProfileSpec::Underpass { width_m, wall_m, rise_m, axis_height_m } => json!({
            "profile": "underpass", "width_m": width_m, "wall_m": wall_m, "rise_m": rise_m,
            "axis_height_m": axis_height_m,
        }),
        ProfileSpec::Horseshoe { width_m, wall_m, axis_height_m } => json!({
            "profile": "horseshoe", "width_m": width_m, "wall_m": wall_m, "axis_height_m": axis_height_m,
        }),
        ProfileSpec::Chain { vertices } => json!({
            "profile": "chain",
            "points": vertices.iter().map(|vertex| [vertex.y_m, vertex.z_m]).collect::<Vec<_>>(),
            "bulges": vertices.iter().map(|vertex| vertex.bulge).collect::<Vec<_>>(),
        }),
    }
}

/// Square cells over the unrolled wall; a whole number of cells goes around, columns wrap.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub(crate) struct Lattice {
    /// Width of a cell around the wall.
    pub(crate) step_s_m: f64,
    /// Height of a cell along the axis.
    pub(crate) step_x_m: f64,
    /// Cells around.
    pub(crate) columns: usize,
    /// Cells along the axis.
    pub(crate) rows: usize,
    /// Upper edge of the first row.
    pub(crate) x0_m: f64,
}

impl Lattice {
    /// Returns the coarse lattice whose cells divide into [`MID_PER_COARSE`] cells of about `mid_m` per side.
    pub(crate) fn coarse(perimeter_m: f64, mid_m: f64, x0_m: f64, x1_m: f64) -> Self {
        let columns = (perimeter_m / (mid_m * MID_PER_COARSE as f64)).round().max(8.0);
        let step_s_m = perimeter_m / columns;
        let rows = ((x1_m - x0_m) / step_s_m).ceil().max(1.0);
        Self { step_s_m, step_x_m: step_s_m, columns: columns as usize, rows: rows as usize, x0_m }
    }

    /// Returns the lattice of [`MID_PER_COARSE`] times finer cells.
    pub(crate) fn finer(&self) -> Self {
        let factor = MID_PER_COARSE as f64;
        Self {
            step_s_m: self.step_s_m / factor,
            step_x_m: self.step_x_m / factor,
            columns: self.columns * MID_PER_COARSE,
            rows: self.rows * MID_PER_COARSE,
            x0_m: self.x0_m,
        }
    }

    /// Arc length of a column's centre; `column` may be outside `0..columns`.
    pub(crate) fn s_m(&self, column: i64) -> f64 {
        (column as f64 + 0.5) * self.step_s_m
    }

    /// Place of a row's centre along the axis.
    pub(crate) fn x_m(&self, row: i64) -> f64 {
        self.x0_m + (row as f64 + 0.5) * self.step_x_m
    }

    /// The column's index in `0..columns`.
    pub(crate) fn wrap(&self, column: i64) -> usize {
        column.rem_euclid(self.columns as i64) as usize
    }
}

/// A box of coarse-lattice cells. Columns may run over the seam at the crown: wrap them before use as an index.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Region {
    pub(super) column0: i64,
    pub(super) columns: usize,
    pub(super) row0: usize,
    pub(super) rows: usize,
}

impl Region {
    /// The same box in cells of the finer lattice.
    pub(super) fn finer(&self) -> Self {
        Self {
            column0: self.column0 * MID_PER_COARSE as i64,
            columns: self.columns * MID_PER_COARSE,
            row0: self.row0 * MID_PER_COARSE,
            rows: self.rows * MID_PER_COARSE,
        }
    }

    /// Number of cells.
    pub(super) fn len(&self) -> usize {
        self.columns * self.rows
    }

    /// First row below the box.
    pub(super) fn row_end(&self) -> usize {
        self.row0 + self.rows
    }
}

/// One place around the wall.
#[derive(Clone, Copy, Debug)]
pub(crate) struct WallPoint {
    /// `[y, z]`.
    pub(crate) point: SectionVector<f64>,
    /// Unit vector along growing arc length.
    pub(crate) tangent: SectionVector<f64>,
    /// Unit normal, inwards.
    pub(crate) normal: SectionVector<f64>,
}

/// Returns the wall at arc length `s_m`.
pub(crate) fn wall_at(profile: &Profile<f64>, s_m: f64) -> WallPoint {
    let (point, normal) = profile
        .at(s_m)
        .map_or((SectionVector::zeros(), SectionVector::new(0.0, 1.0)), |surface| (surface.point, surface.normal));
    // A piece's normal is its tangent turned by +90 degrees in [y, z].
    WallPoint { point, tangent: SectionVector::new(normal.y, -normal.x), normal }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_whole_number_of_texels_goes_around() {
        let grid = PanoramaGrid::new(18.849_555_921_538_76, 2.0, -1.5, 6.4);
        assert_eq!(grid.width_px, 9425);
        assert!((grid.s_m(9425.0) - grid.perimeter_m).abs() < 1e-9);
        assert_eq!(grid.height_px, 3951);
    }

    #[test]
    fn the_tangent_points_along_growing_arc_length() {
        let profile =
            ProfileSpec::Underpass { width_m: 4.0, wall_m: 2.5, rise_m: 1.0, axis_height_m: 1.4 }.build().unwrap();
        for s_m in [0.3, 2.0, 4.0, 6.9, 9.0, 12.0] {
            let wall = wall_at(&profile, s_m);
            let step = wall_at(&profile, s_m + 1e-4).point - wall.point;
            assert!((step / 1e-4 - wall.tangent).norm() < 1e-3, "at {s_m} m");
        }
    }

    #[test]
    fn the_coarse_lattice_goes_around_and_divides_into_the_fine_one() {
        let coarse = Lattice::coarse(13.6, 0.0128, -2.0, 3.0);
        let mid = coarse.finer();
        assert!((coarse.step_s_m * coarse.columns as f64 - 13.6).abs() < 1e-9);
        assert!((mid.s_m(3) - coarse.step_s_m + mid.step_s_m * 0.5).abs() < 1e-12);
        assert_eq!(coarse.wrap(-1), coarse.columns - 1);
    }
}
