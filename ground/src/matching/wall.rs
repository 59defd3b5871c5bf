//! The wall as a grid of texels in (s, x), and what part of it a photo sees.

use adit_geometry::camera::Camera;
use adit_geometry::profile::Profile;
use fixedbitset::FixedBitSet;
use nalgebra::{Isometry3, Point3, Vector2, Vector3};

/// Texels per side of a block; footprints are known by block, windows are whole blocks.
pub(super) const BLOCK: usize = 16;

/// Rays across the photo's width and height that find the footprint's extent.
const PROBES: [usize; 2] = [32, 24];

/// The lining, unrolled on a grid: texel (column, row) lies at `s = column * step`, `x = row * step`.
///
/// The number of columns once around is a multiple of [`BLOCK`], so that everything computed on a window of the grid
/// looks the same wherever the window starts. Columns count on beyond one turn: column `n + columns` is column `n`.
#[derive(Clone, Debug)]
pub(super) struct WallGrid<'a> {
    pub(super) profile: &'a Profile<f64>,
    pub(super) camera: &'a Camera<f64>,
    pub(super) step_m: f64,
    pub(super) columns: i64,
    cos_max_incidence: f64,
    /// Viewing directions, camera frame, of probes all over a photo, the first in its middle.
    probes: Vec<Vector3<f64>>,
}

/// A point of the wall with its axes.
#[derive(Clone, Copy, Debug)]
pub(super) struct WallPoint {
    pub(super) position: Point3<f64>,
    /// Inwards.
    pub(super) normal: Vector3<f64>,
}

impl WallPoint {
    /// Unit vector along growing s.
    pub(super) fn along_s(&self) -> Vector3<f64> {
        // Clockwise looking forward: the inward normal turned by a quarter, (ty, tz) = (nz, -ny).
        Vector3::new(0.0, self.normal.z, -self.normal.y)
    }
}

impl<'a> WallGrid<'a> {
    pub(super) fn new(profile: &'a Profile<f64>, camera: &'a Camera<f64>, grid_m: f64, max_incidence_rad: f64) -> Self {
        let perimeter_m = profile.perimeter_m();
        let blocks = (perimeter_m / grid_m / BLOCK as f64).round().max(1.0);
        let columns = blocks as i64 * BLOCK as i64;
        let step_m = perimeter_m / columns as f64;
        let place = |column: f64, row: f64| {
            Vector2::new(column * f64::from(camera.width_px), row * f64::from(camera.height_px))
        };
        let places = spread(PROBES[1]).flat_map(|row| spread(PROBES[0]).map(move |column| place(column, row)));
        let probes = places.filter_map(|pixel| camera.unproject(&pixel)).collect();
        Self { profile, camera, step_m, columns, cos_max_incidence: max_incidence_rad.cos(), probes }
    }

    /// The wall at a place given in texels, fractions allowed.
    pub(super) fn point(&self, column: f64, row: f64) -> Option<WallPoint> {
        let surface = self.profile.at(column * self.step_m)?;
        Some(WallPoint {
            position: Point3::new(row * self.step_m, surface.point.x, surface.point.y),
            normal: Vector3::new(0.0, surface.normal.x, surface.normal.y),
        })
    }

    /// Exact pixel at which a camera sees a place given in texels.
    pub(super) fn pixel(&self, tunnel_from_cam: &Isometry3<f64>, column: f64, row: f64) -> Option<Vector2<f64>> {
        let point = self.point(column, row)?;
        self.camera.project(&tunnel_from_cam.inverse_transform_point(&point.position).coords)
    }

    /// Tells whether the wall faces the camera steeply enough to be matched.
    pub(super) fn faces(&self, point: &WallPoint, centre: &Point3<f64>) -> bool {
        let to_camera = centre - point.position;
        to_camera.dot(&point.normal) >= self.cos_max_incidence * to_camera.norm()
    }

    /// Tells whether nothing of the lining stands between a camera and column `column`.
    ///
    /// The tunnel is a prism, so this does not depend on x.
    pub(super) fn is_open(&self, column: f64, centre: &Point3<f64>) -> bool {
        let Some(surface) = self.profile.at(column * self.step_m) else { return false };
        let origin = Vector2::new(centre.y, centre.z);
        let to_wall = surface.point - origin;
        self.profile.ray_cast(origin, to_wall).is_some_and(|hit| hit.distance > 1.0 - 1e-3)
    }
}

/// The blocks of the wall that a photo sees.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Footprint {
    /// First block's column and row, in blocks; the column may be negative or beyond one turn.
    pub(super) block0: [i64; 2],
    /// Blocks along s and along x.
    pub(super) size: [usize; 2],
    /// Row by row.
    pub(super) seen: FixedBitSet,
    pub(super) count: usize,
    /// Mean distance of the wall that is seen, metres.
    pub(super) distance_m: f64,
}

impl Footprint {
    /// What a photo sees of the wall; `None` if nothing.
    pub(super) fn new(grid: &WallGrid<'_>, tunnel_from_cam: &Isometry3<f64>) -> Option<Self> {
        let (low, high) = extent(grid, tunnel_from_cam)?;
        let block_m = grid.step_m * BLOCK as f64;
        let block0 = low.map(|edge_m| (edge_m / block_m).floor() as i64 - 1);
        let end = high.map(|edge_m| (edge_m / block_m).ceil() as i64 + 1);
        let around = grid.columns / BLOCK as i64;
        let size = [(end[0] - block0[0]).min(around) as usize, (end[1] - block0[1]) as usize];
        let centre = Point3::from(tunnel_from_cam.translation.vector);
        let mut seen = FixedBitSet::with_capacity(size[0] * size[1]);
        let (mut count, mut distance_sum_m) = (0, 0.0);
        for i in 0..size[0] {
            let column = block_middle(block0[0] + i as i64);
            if !grid.is_open(column, &centre) {
                continue;
            }
            for j in 0..size[1] {
                let row = block_middle(block0[1] + j as i64);
                let Some(point) = grid.point(column, row) else { continue };
                let inside = grid.faces(&point, &centre)
                    && grid.pixel(tunnel_from_cam, column, row).is_some_and(|pixel| grid.camera.contains(&pixel, 0.0));
                if inside {
                    seen.insert(j * size[0] + i);
                    count += 1;
                    distance_sum_m += (point.position - centre).norm();
                }
            }
        }
        (count > 0).then(|| Self { block0, size, seen, count, distance_m: distance_sum_m / count as f64 })
    }

    /// The multiple of a whole turn, in blocks, to add to the other's columns so that it lies nearest to this one.
    pub(super) fn turns_to(&self, other: &Self, blocks_around: i64) -> i64 {
        let middle = |footprint: &Self| footprint.block0[0] as f64 + 0.5 * footprint.size[0] as f64;
        ((middle(self) - middle(other)) / blocks_around as f64).round() as i64 * blocks_around
    }

    /// Part of the smaller footprint that both share.
    pub(super) fn overlap(&self, other: &Self, blocks_around: i64) -> f64 {
        let shift = [self.turns_to(other, blocks_around), 0];
        let range = |axis: usize| {
            let other0 = other.block0[axis] + shift[axis];
            let low = self.block0[axis].max(other0);
            let high = (self.block0[axis] + self.size[axis] as i64).min(other0 + other.size[axis] as i64);
            low..high
        };
        let mut shared = 0_usize;
        for row in range(1) {
            for column in range(0) {
                shared += usize::from(self.sees([column, row]) && other.sees([column - shift[0], row]));
            }
        }
        shared as f64 / self.count.min(other.count).max(1) as f64
    }

    /// Tells whether a block of the window, or one beside it, is seen.
    pub(super) fn sees_around(&self, [column, row]: [usize; 2]) -> bool {
        let mut rows = row.saturating_sub(1)..(row + 2).min(self.size[1]);
        let columns = column.saturating_sub(1)..(column + 2).min(self.size[0]);
        rows.any(|row| columns.clone().any(|column| self.seen[row * self.size[0] + column]))
    }

    fn sees(&self, block: [i64; 2]) -> bool {
        let (i, j) = (block[0] - self.block0[0], block[1] - self.block0[1]);
        let inside = i >= 0 && j >= 0 && (i as usize) < self.size[0] && (j as usize) < self.size[1];
        inside && self.seen[j as usize * self.size[0] + i as usize]
    }
}

fn block_middle(block: i64) -> f64 {
    (block as f64 + 0.5) * BLOCK as f64 - 0.5
}

/// The box `[s, x]` of the wall, metres, that rays through the photo meet; s is unrolled around the first hit.
fn extent(grid: &WallGrid<'_>, tunnel_from_cam: &Isometry3<f64>) -> Option<([f64; 2], [f64; 2])> {
    let centre = Point3::from(tunnel_from_cam.translation.vector);
    let perimeter_m = grid.profile.perimeter_m();
    let (mut low, mut high) = ([f64::INFINITY; 2], [f64::NEG_INFINITY; 2]);
    let mut reference_s_m = None;
    for ray_in_cam in &grid.probes {
        let Some((s_m, x_m, normal)) = wall_hit(grid.profile, tunnel_from_cam, ray_in_cam) else { continue };
        let surface = grid.profile.at(s_m)?;
        let position = Point3::new(x_m, surface.point.x, surface.point.y);
        if !grid.faces(&WallPoint { position, normal }, &centre) {
            continue;
        }
        let reference = *reference_s_m.get_or_insert(s_m);
        let unrolled = s_m - ((s_m - reference) / perimeter_m).round() * perimeter_m;
        low = [low[0].min(unrolled), low[1].min(x_m)];
        high = [high[0].max(unrolled), high[1].max(x_m)];
    }
    (low[0] <= high[0]).then_some((low, high))
}

/// Where a viewing direction meets the wall: `(s, x, inward normal)`.
pub(super) fn wall_hit(
    profile: &Profile<f64>,
    tunnel_from_cam: &Isometry3<f64>,
    ray_in_cam: &Vector3<f64>,
) -> Option<(f64, f64, Vector3<f64>)> {
    let centre = tunnel_from_cam.translation.vector;
    let ray = tunnel_from_cam.rotation * ray_in_cam;
    let hit = profile.ray_cast(centre.yz(), ray.yz())?;
    let surface = hit.surface;
    let x_m = centre.x + hit.distance * ray.x;
    x_m.is_finite().then_some((surface.s_m, x_m, Vector3::new(0.0, surface.normal.x, surface.normal.y)))
}

/// `count` values from 0 to 1, middle first so that the reference lies in the middle of the photo.
fn spread(count: usize) -> impl Iterator<Item = f64> {
    std::iter::once(0.5).chain((0..=count).map(move |index| index as f64 / count as f64))
}
