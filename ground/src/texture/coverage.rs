//! How often the wall was seen, and where it was not.

use adit_geometry::profile::Profile;
use serde::{Deserialize, Serialize};
use serde_json::{Value, json};

use super::grid::{Lattice, wall_at};
use super::tiles::Rgba8;

/// The largest holes are listed, so many at most.
const MOST_HOLES: usize = 1000;

/// A box of wall that no photo shows.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Hole {
    /// Along the axis.
    pub x_from_m: f64,
    /// Along the axis.
    pub x_to_m: f64,
    /// Clock position (12 = crown, clockwise looking forward) where the box starts; it runs clockwise from here.
    pub clock_from: f64,
    /// Clock position where it ends.
    pub clock_to: f64,
    /// Area of the cells in the box that are not seen.
    pub area_m2: f64,
}

/// Coverage of the surveyed stretch.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Coverage {
    /// Side of the cells that were counted.
    pub cell_m: f64,
    /// Where the first row of the map's cells begins along the axis.
    pub x0_m: f64,
    /// The stretch that is judged: from the first to the last place at which a photo was aimed.
    pub x_from_m: f64,
    /// End of the stretch.
    pub x_to_m: f64,
    /// Wall area of the stretch.
    pub area_m2: f64,
    /// Share of that area seen by at least 1, 2 and 3 photos.
    pub seen_share: [f64; 3],
    /// Area seen by at least one photo, beyond the stretch too.
    pub seen_area_m2: f64,
    /// Number of holes, listed or not.
    pub hole_count: usize,
    /// The holes, largest first.
    pub holes: Vec<Hole>,
}

impl Coverage {
    /// The content of `coverage.json`.
    pub fn to_json(&self) -> Value {
        json!({
            "format": 1,
            "cell_m": self.cell_m,
            "x0_m": self.x0_m,
            "stretch": {"x_from_m": self.x_from_m, "x_to_m": self.x_to_m, "area_m2": self.area_m2},
            "share_seen_by_at_least": {"1": self.seen_share[0], "2": self.seen_share[1], "3": self.seen_share[2]},
            "seen_area_m2": self.seen_area_m2,
            "hole_count": self.hole_count,
            "holes": self.holes,
        })
    }
}

/// Measures coverage from the number of photos per cell of the lattice. `stretch`: the x range that is judged.
pub(crate) fn measure(counts: &[u16], lattice: &Lattice, profile: &Profile<f64>, stretch: [f64; 2]) -> Coverage {
    let cell_area_m2 = lattice.step_s_m * lattice.step_x_m;
    let judged = |row: usize| (stretch[0]..=stretch[1]).contains(&lattice.x_m(row as i64));
    let mut cells = 0_usize;
    let mut seen = [0_usize; 3];
    for (row, line) in counts.chunks_exact(lattice.columns).enumerate().filter(|(row, _)| judged(*row)) {
        debug_assert!(row < lattice.rows);
        cells += line.len();
        for (views, seen) in seen.iter_mut().enumerate() {
            *seen += line.iter().filter(|&&count| usize::from(count) > views).count();
        }
    }
    let mut holes = holes(counts, lattice, profile, judged);
    let hole_count = holes.len();
    holes.sort_by(|a, b| b.area_m2.total_cmp(&a.area_m2));
    holes.truncate(MOST_HOLES);
    Coverage {
        cell_m: lattice.step_s_m,
        x0_m: lattice.x0_m,
        x_from_m: stretch[0],
        x_to_m: stretch[1],
        area_m2: cells as f64 * cell_area_m2,
        seen_share: seen.map(|seen| if cells > 0 { seen as f64 / cells as f64 } else { 0.0 }),
        seen_area_m2: counts.iter().filter(|&&count| count > 0).count() as f64 * cell_area_m2,
        hole_count,
        holes,
    }
}

/// Connected cells (four neighbours, around the seam) that no photo shows, as boxes.
fn holes(counts: &[u16], lattice: &Lattice, profile: &Profile<f64>, judged: impl Fn(usize) -> bool) -> Vec<Hole> {
    let mut left: Vec<bool> = counts
        .chunks_exact(lattice.columns)
        .enumerate()
        .flat_map(|(row, line)| {
            let judged = judged(row);
            line.iter().map(move |&count| judged && count == 0)
        })
        .collect();
    let mut holes = Vec::new();
    for start in 0..left.len() {
        if !left[start] {
            continue;
        }
        left[start] = false;
        let (row, column) = ((start / lattice.columns) as i64, (start % lattice.columns) as i64);
        // Columns are unrolled from the start, so that a hole over the seam stays one box.
        let mut stack = vec![(row, column)];
        let (mut rows, mut columns, mut cells) = ([row, row], [column, column], 0_usize);
        while let Some((row, column)) = stack.pop() {
            cells += 1;
            rows = [rows[0].min(row), rows[1].max(row)];
            columns = [columns[0].min(column), columns[1].max(column)];
            for (r, c) in [(row - 1, column), (row + 1, column), (row, column - 1), (row, column + 1)] {
                if r >= 0 && (r as usize) < lattice.rows {
                    let at = r as usize * lattice.columns + lattice.wrap(c);
                    if left[at] {
                        left[at] = false;
                        stack.push((r, c));
                    }
                }
            }
        }
        let s_m = |column: i64| column as f64 * lattice.step_s_m;
        let around = (columns[1] - columns[0] + 1) as usize >= lattice.columns;
        let clock = |column: i64| clock_position(profile, s_m(column));
        let (clock_from, clock_to) = if around { (0.0, 12.0) } else { (clock(columns[0]), clock(columns[1] + 1)) };
        holes.push(Hole {
            x_from_m: lattice.x0_m + rows[0] as f64 * lattice.step_x_m,
            x_to_m: lattice.x0_m + (rows[1] + 1) as f64 * lattice.step_x_m,
            clock_from,
            clock_to,
            area_m2: cells as f64 * lattice.step_s_m * lattice.step_x_m,
        });
    }
    holes
}

/// Clock position in `[0, 12)` of the wall at arc length `s_m`: its direction from the axis, clockwise looking forward.
pub fn clock_position(profile: &Profile<f64>, s_m: f64) -> f64 {
    let point = wall_at(profile, s_m).point;
    let hours = point.x.atan2(-point.y) / std::f64::consts::TAU * 12.0;
    let hours = hours.rem_euclid(12.0);
    if hours > 12.0 - 1e-9 { 0.0 } else { hours }
}

/// Colours of the coverage map: none, one, two, three and four or more photos.
pub(crate) const COVERAGE_COLOURS: [[u8; 3]; 5] =
    [[178, 34, 52], [240, 150, 60], [250, 220, 110], [150, 200, 120], [50, 130, 90]];

/// Paints the counts, one pixel per cell.
pub(crate) fn picture(counts: &[u16], lattice: &Lattice, stretch: [f64; 2]) -> Rgba8 {
    let mut picture = Rgba8::new(lattice.columns, lattice.rows);
    for row in 0..lattice.rows {
        let judged = (stretch[0]..=stretch[1]).contains(&lattice.x_m(row as i64));
        for column in 0..lattice.columns {
            let count = usize::from(counts[row * lattice.columns + column]);
            let [r, g, b] = COVERAGE_COLOURS[count.min(COVERAGE_COLOURS.len() - 1)];
            let alpha = if judged || count > 0 { 255 } else { 0 };
            picture.set(column, row, [r, g, b, alpha]);
        }
    }
    picture
}

#[cfg(test)]
mod tests {
    use adit_geometry::profile::ProfileSpec;

    use super::*;

    fn setting() -> (Profile<f64>, Lattice) {
        let profile = ProfileSpec::Circle { radius_m: 3.0 }.build().unwrap();
        let lattice = Lattice::coarse(profile.perimeter_m(), 0.0125, 0.0, 4.0);
        (profile, lattice)
    }

    #[test]
    fn a_hole_over_the_crown_is_one_box_around_twelve_o_clock() {
        let (profile, lattice) = setting();
        let mut counts = vec![2; lattice.columns * lattice.rows];
        for row in 10..20 {
            for column in -15..15 {
                counts[row * lattice.columns + lattice.wrap(column)] = 0;
            }
        }
        let coverage = measure(&counts, &lattice, &profile, [0.0, 4.0]);
        assert_eq!(coverage.hole_count, 1);
        let hole = coverage.holes[0];
        assert!((hole.clock_from - 11.5).abs() < 0.05 && (hole.clock_to - 0.5).abs() < 0.05, "{hole:?}");
        assert!((hole.x_from_m - 0.5).abs() < 0.01 && (hole.x_to_m - 1.0).abs() < 0.01, "{hole:?}");
        assert!((coverage.seen_share[0] - (1.0 - hole.area_m2 / coverage.area_m2)).abs() < 1e-9);
        assert_eq!(coverage.seen_share[2], 0.0);
    }

    #[test]
    fn three_o_clock_is_on_the_right() {
        let (profile, _) = setting();
        let quarter = profile.perimeter_m() / 4.0;
        for (turns, clock) in [(0.0, 0.0), (1.0, 3.0), (2.0, 6.0), (3.0, 9.0)] {
            assert!((clock_position(&profile, quarter * turns) - clock).abs() < 1e-9);
        }
    }

    #[test]
    fn what_lies_beyond_the_stretch_is_no_hole() {
        let (profile, lattice) = setting();
        let counts = vec![0; lattice.columns * lattice.rows];
        let coverage = measure(&counts, &lattice, &profile, [1.0, 2.0]);
        assert_eq!(coverage.hole_count, 1);
        assert!(coverage.holes[0].x_from_m > 0.94 && coverage.holes[0].x_to_m < 2.06);
    }
}
