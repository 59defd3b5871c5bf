//! The measured wall on disk, and the stretch of it that a caller asks for in memory.

use std::fs::{self, File};
use std::io::{BufWriter, Read, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};

use adit_geometry::profile::{Profile, ProfileSpec};
use nalgebra::{Point3, Vector3};
use serde::{Deserialize, Serialize};

use super::error::{SurfaceError, at_path};
use super::ring::Rings;
use crate::texture::Lattice;

/// The heights: per row of the lattice, from low x, the relief of all cells in metres and then their confidence.
const HEIGHTS: &str = "heights.f32";
/// Numbers per cell in [`HEIGHTS`].
const PLANES: u64 = 2;

/// What surface.json says.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub(super) struct Description {
    pub(super) format: u32,
    /// The section over which heights are counted.
    pub(super) profile: ProfileSpec<f64>,
    pub(super) lattice: Lattice,
    pub(super) rings: Rings,
}

/// The wall as a height over the section's profile: `profile.at(s)` moved inwards along its normal by
/// `height_m(s, x)`. Either flat, or what the surface stage left in a folder.
#[derive(Debug)]
pub struct SurfaceStore {
    profile: Profile<f64>,
    measured: Option<(Description, PathBuf)>,
}

/// A stretch of the wall in memory.
#[derive(Clone, Debug)]
pub struct SurfaceWindow<'a> {
    profile: &'a Profile<f64>,
    cells: Option<Cells>,
}

/// Rows of the lattice, cell by cell around.
#[derive(Clone, Debug)]
struct Cells {
    lattice: Lattice,
    row0: usize,
    rows: usize,
    /// Ring part and relief together.
    height_m: Vec<f32>,
    relief_m: Vec<f32>,
    confidence: Vec<f32>,
}

/// One line around the wall, for looking up many heights of the same station.
#[derive(Clone, Debug)]
pub(crate) struct HeightLine {
    step_s_m: f64,
    /// Per column of cells; empty on a flat wall.
    height_m: Vec<f32>,
}

/// A place of the wall in space.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct WallPlace {
    /// In the tunnel frame, metres.
    pub position: Point3<f64>,
    /// Unit normal in the tunnel frame, inwards.
    pub normal: Vector3<f64>,
}

impl SurfaceStore {
    /// The profile itself, without any height.
    ///
    /// # Errors
    /// If `profile` is no closed section.
    pub fn flat(profile: &ProfileSpec<f64>) -> Result<Self, SurfaceError> {
        Ok(Self { profile: profile.build()?, measured: None })
    }

    /// Opens what the surface stage left in `out/surface/`.
    ///
    /// # Errors
    /// [`SurfaceError`] if it is not there, not whole, or not readable.
    pub fn open(out: &Path) -> Result<Self, SurfaceError> {
        let path = out.join("surface/surface.json");
        let json = fs::read(&path).map_err(at_path(&path))?;
        let description: Description =
            serde_json::from_slice(&json).map_err(|source| SurfaceError::Json { path, source })?;
        let heights = out.join("surface").join(HEIGHTS);
        let found = fs::metadata(&heights).map_err(at_path(&heights))?.len();
        let expected = row_bytes(&description.lattice) * description.lattice.rows as u64;
        if found != expected {
            return Err(SurfaceError::Length { path: heights, found, expected });
        }
        Ok(Self { profile: description.profile.build()?, measured: Some((description, heights)) })
    }

    /// The section over which heights are counted.
    pub fn profile(&self) -> &Profile<f64> {
        &self.profile
    }

    /// Reads the stretch `[from, to]` along the axis, metres; outside of what was measured the wall goes on as at the
    /// nearest measured place.
    ///
    /// # Errors
    /// If the file of heights cannot be read.
    pub fn window(&self, x_m: [f64; 2]) -> Result<SurfaceWindow<'_>, SurfaceError> {
        let Some((description, path)) = &self.measured else {
            return Ok(SurfaceWindow { profile: &self.profile, cells: None });
        };
        let lattice = description.lattice;
        let row = |x_m: f64| (x_m - lattice.x0_m) / lattice.step_x_m - 0.5;
        // A cell more on either side, for slopes.
        let row0 = ((row(x_m[0]).floor() - 1.0).max(0.0) as usize).min(lattice.rows - 1);
        let end = ((row(x_m[1]).ceil() + 2.0).max(0.0) as usize).clamp(row0 + 1, lattice.rows);
        let mut file = File::open(path).map_err(at_path(path))?;
        file.seek(SeekFrom::Start(row_bytes(&lattice) * row0 as u64)).map_err(at_path(path))?;
        let mut bytes = vec![0; row_bytes(&lattice) as usize * (end - row0)];
        file.read_exact(&mut bytes).map_err(at_path(path))?;
        let numbers: Vec<f32> = bytes.as_chunks::<4>().0.iter().map(|number| f32::from_le_bytes(*number)).collect();
        let planes = |plane: usize| -> Vec<f32> {
            let rows = numbers.chunks_exact(lattice.columns * PLANES as usize);
            rows.flat_map(|row| row[plane * lattice.columns..][..lattice.columns].iter().copied()).collect()
        };
        let relief_m = planes(0);
        let mut height_m = description.rings.heights(&self.profile, &lattice, row0, end - row0);
        for (height, relief) in height_m.iter_mut().zip(&relief_m) {
            *height += relief;
        }
        let cells = Cells { lattice, row0, rows: end - row0, height_m, relief_m, confidence: planes(1) };
        Ok(SurfaceWindow { profile: &self.profile, cells: Some(cells) })
    }
}

impl SurfaceWindow<'_> {
    /// Height of the wall over the profile in metres, positive inwards; 0 on a flat wall.
    ///
    /// Bilinear between cells; where the wall is not known it is carried on smoothly from what is.
    pub fn height_m(&self, s_m: f64, x_m: f64) -> f64 {
        self.cells.as_ref().map_or(0.0, |cells| cells.sample(&cells.height_m, s_m, x_m))
    }

    /// The heights at one station.
    pub(crate) fn line(&self, x_m: f64) -> HeightLine {
        let Some(cells) = &self.cells else { return HeightLine { step_s_m: 1.0, height_m: Vec::new() } };
        let row = (x_m - cells.lattice.x0_m) / cells.lattice.step_x_m - 0.5;
        let share = (row - row.floor()) as f32;
        let line = |row: f64| &cells.height_m[cells.row(row) * cells.lattice.columns..][..cells.lattice.columns];
        let lines = line(row.floor()).iter().zip(line(row.floor() + 1.0));
        HeightLine {
            step_s_m: cells.lattice.step_s_m,
            height_m: lines.map(|(upper, lower)| upper + share * (lower - upper)).collect(),
        }
    }

    /// The section over which heights are counted.
    pub(crate) fn profile(&self) -> &Profile<f64> {
        self.profile
    }

    /// The part of the height that is not the ring's, metres, positive inwards; `None` where it is not known.
    pub fn relief_m(&self, s_m: f64, x_m: f64) -> Option<f64> {
        let cells = self.cells.as_ref()?;
        (self.confidence(s_m, x_m) > 0.0).then(|| cells.sample(&cells.relief_m, s_m, x_m))
    }

    /// How well the height is known: 0 = not at all (or flat by decree), 1 = as well as photos can tell.
    pub fn confidence(&self, s_m: f64, x_m: f64) -> f64 {
        self.cells.as_ref().map_or(0.0, |cells| f64::from(cells.nearest(&cells.confidence, s_m, x_m)))
    }

    /// The wall in the tunnel frame at arc length `s_m` of the profile and station `x_m`.
    ///
    /// # Method
    /// Normal of a displaced profile `n - h_s t - h_x e_x`, normalised, slopes by central differences over a cell.
    /// The factor `1 / (1 - h k)` on `h_s` (k: the profile's curvature) is left out: 3 % of a slope at 0.1 m of 3 m.
    pub fn point(&self, s_m: f64, x_m: f64) -> WallPlace {
        let Some(surface) = self.profile.at(s_m) else {
            return WallPlace { position: Point3::new(x_m, 0.0, 0.0), normal: Vector3::y() };
        };
        let height_m = self.height_m(s_m, x_m);
        let section = surface.point + surface.normal * height_m;
        let (slope_s, slope_x) = self.slopes(s_m, x_m);
        let tangent = nalgebra::Vector2::new(surface.normal.y, -surface.normal.x);
        let turned = surface.normal - tangent * slope_s;
        WallPlace {
            position: Point3::new(x_m, section.x, section.y),
            normal: Vector3::new(-slope_x, turned.x, turned.y).normalize(),
        }
    }

    fn slopes(&self, s_m: f64, x_m: f64) -> (f64, f64) {
        let Some(cells) = &self.cells else { return (0.0, 0.0) };
        let half = [cells.lattice.step_s_m, cells.lattice.step_x_m];
        let at = |s_m: f64, x_m: f64| cells.sample(&cells.height_m, s_m, x_m);
        (
            (at(s_m + half[0], x_m) - at(s_m - half[0], x_m)) / (2.0 * half[0]),
            (at(s_m, x_m + half[1]) - at(s_m, x_m - half[1])) / (2.0 * half[1]),
        )
    }
}

impl HeightLine {
    /// As [`SurfaceWindow::height_m`].
    pub(crate) fn at(&self, s_m: f64) -> f64 {
        if self.height_m.is_empty() {
            return 0.0;
        }
        let column = s_m / self.step_s_m - 0.5;
        let left = column.floor();
        let wrap = |column: i64| f64::from(self.height_m[column.rem_euclid(self.height_m.len() as i64) as usize]);
        let (a, b) = (wrap(left as i64), wrap(left as i64 + 1));
        a + (column - left) * (b - a)
    }
}

impl Cells {
    fn row(&self, row: f64) -> usize {
        (row.max(self.row0 as f64) as usize).min(self.row0 + self.rows - 1) - self.row0
    }

    fn sample(&self, values: &[f32], s_m: f64, x_m: f64) -> f64 {
        let lattice = &self.lattice;
        let (column, row) = (s_m / lattice.step_s_m - 0.5, (x_m - lattice.x0_m) / lattice.step_x_m - 0.5);
        let (left, upper) = (column.floor(), row.floor());
        let (right_share, lower_share) = (column - left, row - upper);
        let columns = [left as i64, left as i64 + 1].map(|column| lattice.wrap(column));
        let line = |row: f64| {
            let line = &values[self.row(row) * lattice.columns..][..lattice.columns];
            let [a, b] = columns.map(|column| f64::from(line[column]));
            a + right_share * (b - a)
        };
        let (a, b) = (line(upper), line(upper + 1.0));
        a + lower_share * (b - a)
    }

    fn nearest(&self, values: &[f32], s_m: f64, x_m: f64) -> f32 {
        let column = self.lattice.wrap((s_m / self.lattice.step_s_m).floor() as i64);
        values[self.row((x_m - self.lattice.x0_m) / self.lattice.step_x_m) * self.lattice.columns + column]
    }
}

fn row_bytes(lattice: &Lattice) -> u64 {
    lattice.columns as u64 * PLANES * 4
}

/// Writes the heights row by row; the description comes last, so that where it is the rest is whole.
pub(super) struct StoreWriter {
    folder: PathBuf,
    heights: BufWriter<File>,
}

impl StoreWriter {
    pub(super) fn create(out: &Path) -> Result<Self, SurfaceError> {
        let folder = out.join("surface");
        fs::create_dir_all(&folder).map_err(at_path(&folder))?;
        let description = folder.join("surface.json");
        if description.exists() {
            fs::remove_file(&description).map_err(at_path(&description))?;
        }
        let path = folder.join(HEIGHTS);
        let file = File::create(&path).map_err(at_path(&path))?;
        Ok(Self { folder, heights: BufWriter::new(file) })
    }

    pub(super) fn push_row(&mut self, relief_m: &[f32], confidence: &[f32]) -> Result<(), SurfaceError> {
        let bytes: Vec<u8> = relief_m.iter().chain(confidence).flat_map(|number| number.to_le_bytes()).collect();
        self.heights.write_all(&bytes).map_err(at_path(&self.folder.join(HEIGHTS)))
    }

    pub(super) fn finish(mut self, description: &Description) -> Result<(), SurfaceError> {
        self.heights.flush().map_err(at_path(&self.folder.join(HEIGHTS)))?;
        let path = self.folder.join("surface.json");
        let json = serde_json::to_vec_pretty(description)
            .map_err(|source| SurfaceError::Json { path: path.clone(), source })?;
        crate::files::write_whole(&path, &json).map_err(at_path(&path))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const PROFILE: ProfileSpec<f64> = ProfileSpec::Circle { radius_m: 3.0 };

    /// A stored wall of 20 rows from x = 1 m: an oval of 30 mm with a relief of `relief(column, row)`; row 0 unknown.
    fn stored(relief: impl Fn(usize, usize) -> f32) -> (tempfile::TempDir, Lattice) {
        let columns = 100;
        let step_m = 6.0 * std::f64::consts::PI / columns as f64;
        let lattice = Lattice { step_s_m: step_m, step_x_m: step_m, columns, rows: 20, x0_m: 1.0 };
        let out = tempfile::tempdir().unwrap();
        let mut writer = StoreWriter::create(out.path()).unwrap();
        for row in 0..lattice.rows {
            let line: Vec<f32> = (0..columns).map(|column| relief(column, row)).collect();
            writer.push_row(&line, &vec![if row == 0 { 0.0 } else { 0.75 }; columns]).unwrap();
        }
        let rings = Rings { x0_m: 0.0, step_m: 0.5, terms: vec![vec![0.0, 0.0, 0.0, 0.03, 0.0]; 2] };
        writer.finish(&Description { format: 1, profile: PROFILE, lattice, rings }).unwrap();
        (out, lattice)
    }

    #[test]
    fn a_window_gives_ring_and_relief_of_its_stretch() {
        let (out, lattice) = stored(|column, row| 0.001 * row as f32 + if column == 0 { 0.01 } else { 0.0 });
        let store = SurfaceStore::open(out.path()).unwrap();
        let x_m = lattice.x_m(12);
        let window = store.window([x_m, x_m + 0.1]).unwrap();
        let ring_m = |s_m: f64| 0.03 * (2.0 * s_m / 3.0).cos();
        let (s_m, seam_m) = (lattice.s_m(40), lattice.s_m(0));
        assert!((window.height_m(s_m, x_m) - ring_m(s_m) - 0.012).abs() < 1e-6);
        assert!((window.relief_m(s_m, x_m).unwrap() - 0.012).abs() < 1e-6);
        assert!((window.relief_m(seam_m, x_m).unwrap() - 0.022).abs() < 1e-6);
        // Halfway over the seam, from either side.
        for s_m in [0.0, store.profile().perimeter_m()] {
            assert!((window.relief_m(s_m, x_m).unwrap() - 0.017).abs() < 1e-6);
        }
        assert!((window.confidence(s_m, x_m) - 0.75).abs() < 1e-6);
        assert!((window.line(x_m).at(s_m) - window.height_m(s_m, x_m)).abs() < 1e-7);
    }

    #[test]
    fn what_is_not_known_has_no_relief_but_a_height() {
        let (out, lattice) = stored(|_, _| 0.004);
        let store = SurfaceStore::open(out.path()).unwrap();
        let window = store.window([0.0, 9.0]).unwrap();
        assert_eq!(window.relief_m(2.0, lattice.x_m(0)), None);
        assert!((window.height_m(0.0, -5.0) - 0.034).abs() < 1e-3);
    }

    #[test]
    fn normals_lean_with_the_wall() {
        let (out, lattice) = stored(|_, row| 0.01 * row as f32);
        let store = SurfaceStore::open(out.path()).unwrap();
        let x_m = lattice.x_m(10);
        let place = store.window([x_m, x_m]).unwrap().point(0.0, x_m);
        let slope = 0.01 / lattice.step_x_m;
        assert!((place.position - Point3::new(x_m, 0.0, -2.87)).norm() < 1e-3, "{place:?}");
        // At the crown inwards is down (z); the wall comes down as x grows, so it faces back.
        let expected = Vector3::new(-slope, 0.0, 1.0).normalize();
        assert!((place.normal - expected).norm() < 1e-3, "{place:?}");
    }

    #[test]
    fn a_flat_wall_is_the_profile() {
        let store = SurfaceStore::flat(&PROFILE).unwrap();
        let window = store.window([0.0, 1.0]).unwrap();
        let place = window.point(0.0, 0.5);
        assert!((place.position - Point3::new(0.5, 0.0, -3.0)).norm() < 1e-9 && (place.normal.z - 1.0).abs() < 1e-9);
        assert_eq!((window.relief_m(0.0, 0.5), window.height_m(0.0, 0.5)), (None, 0.0));
    }

    #[test]
    fn a_file_cut_off_is_refused() {
        let (out, _) = stored(|_, _| 0.0);
        let path = out.path().join("surface").join(HEIGHTS);
        let bytes = fs::read(&path).unwrap();
        fs::write(&path, &bytes[..bytes.len() - 4]).unwrap();
        assert!(matches!(SurfaceStore::open(out.path()), Err(SurfaceError::Length { .. })));
    }
}
