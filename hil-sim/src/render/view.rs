//! The state of one photo while its pixels are made.
//!
//! The image is cut into blocks of 4 x 4 pixels. Where a block's corner rays meet one smooth face and its middle ray
//! confirms the interpolation to a small part of a pixel, the wall between them is interpolated; elsewhere every pixel
//! corner gets its ray, and pixels at edges one per sample.

use nalgebra::{Isometry3, Point3, Vector3};

use super::cell::{Cell, Corner, Window};
use super::light::Lamp;
use super::photo::{PhotoRenderer, Shot};
use super::sensor::Exposure;
use super::vehicle::{Rod, rods_in_cam};
use crate::scene::paint::{Patch, Rgb};
use crate::scene::{Surface, WallHit, noise};

/// Pixels of a block, per axis.
pub(super) const BLOCK: usize = 4;
/// Largest error of the interpolation in a block's middle, in pixels.
const BLOCK_TOLERANCE_PX: f64 = 0.03;
/// Places at which the exposure is metered, per axis.
const METER_GRID: usize = 20;
/// Patch size that the meter looks at: about the middle of what a metering field averages.
const METER_PATCH_M: f32 = 0.1;
/// Linear albedo of dark water seen from above.
const WATER: Rgb = [0.012, 0.018, 0.016];
/// Reflectance of water at normal incidence (refractive index 1.33).
const WATER_REFLECTANCE: f64 = 0.02;
/// Around a vehicle part, so many pixels more are masked, because lens and interpolation smear its edge.
const MASK_MARGIN_PX: f64 = 2.0;
/// Samples per pixel at most (8 per axis).
const MAX_SAMPLES: usize = 64;

/// One photo in the making.
pub(super) struct View<'a> {
    renderer: &'a PhotoRenderer,
    shot: &'a Shot,
    lamp: Lamp,
    rods: Vec<Rod>,
    pub(super) exposure: Exposure,
    perimeter_m: f64,
    blurred: bool,
}

/// Corners at the opening and at the closing of the shutter.
struct Corners {
    opening: Vec<Option<Corner>>,
    /// Empty for a camera at rest.
    closing: Vec<Option<Corner>>,
}

impl Corners {
    /// Tells whether both ends of a pixel's edge see water: its mirror image is dim, one ray per pixel will do.
    fn is_water(&self, column: usize) -> bool {
        let wet = |corner: &Option<Corner>| corner.is_some_and(|corner| corner.surface == Surface::Water);
        self.opening[column..column + 2].iter().all(wet)
    }
}

/// The same piece of the image at the opening and at the closing of the shutter.
struct CellPair {
    opening: Cell,
    closing: Cell,
}

impl<'a> View<'a> {
    pub(super) fn new(renderer: &'a PhotoRenderer, shot: &'a Shot) -> Self {
        let config = &renderer.config;
        let rods = rods_in_cam(&config.vehicle_parts, &shot.tunnel_from_cam, &shot.tunnel_from_body);
        let mut view = Self {
            renderer,
            shot,
            lamp: Lamp::new(&config.light, shot, renderer.lamp_reference_m),
            rods,
            exposure: renderer.sensor.expose(config.sensor.target_intensity, 0),
            perimeter_m: renderer.wall.profile().perimeter_m(),
            blurred: !shot.is_still() && config.sensor.exposure_s > 0.0,
        };
        let photo_seed = noise::derive_seed(renderer.seed, u64::from(shot.index));
        view.exposure = renderer.sensor.expose(view.metered(), photo_seed).times(shot.gain_factors);
        view
    }

    /// Renders whole rows of blocks; `first_row` is a multiple of [`BLOCK`].
    pub(super) fn render_band(&self, first_row: usize, pixels: &mut [u8], mask: &mut [u8]) {
        let width = self.renderer.camera.width_px as usize;
        let rows = mask.len() / width;
        let mut light = vec![[0.0; 3]; width * BLOCK];
        let mut above = self.corners(first_row, &block_columns(width));
        for top in (0..rows).step_by(BLOCK) {
            let height = BLOCK.min(rows - top);
            let below = self.corners(first_row + top + height, &block_columns(width));
            for block in 0..width.div_ceil(BLOCK) {
                self.render_block(block, first_row + top, height, [&above, &below], &mut light);
            }
            for row in 0..height {
                let line = (top + row) * width;
                let (pixels, mask) = (&mut pixels[line * 3..][..width * 3], &mut mask[line..][..width]);
                self.finish_row(first_row + top + row, &light[row * width..][..width], pixels, mask);
            }
            above = below;
        }
    }

    /// Light of a block's pixels before vignetting and gain, into rows of the image's width.
    fn render_block(&self, block: usize, top: usize, height: usize, corners: [&Corners; 2], light: &mut [Rgb]) {
        let image_width = self.renderer.camera.width_px as usize;
        let left = block * BLOCK;
        let width = BLOCK.min(image_width - left);
        if let Some(pair) = self.pair(corners, block)
            && self.is_smooth(&pair, [left, top], [width, height])
        {
            let share = [1.0 / width as f64, 1.0 / height as f64];
            for row in 0..height {
                for column in 0..width {
                    let (u, v) = (column as f64 * share[0], row as f64 * share[1]);
                    let window = Window { u, v, width: share[0], height: share[1] };
                    light[row * image_width + left + column] =
                        self.cell_light(&pair, &window, [left + column, top + row]);
                }
            }
            return;
        }
        let columns: Vec<usize> = (left..=left + width).collect();
        let mut above = self.corners(top, &columns);
        for row in 0..height {
            let below = self.corners(top + row + 1, &columns);
            for column in 0..width {
                let pixel = [left + column, top + row];
                light[row * image_width + left + column] = match self.pair([&above, &below], column) {
                    Some(pair) => self.cell_light(&pair, &Window::WHOLE, pixel),
                    None if above.is_water(column) && below.is_water(column) => self.exact_light(pixel, 1),
                    None => self.exact_light(pixel, usize::from(self.renderer.config.supersampling)),
                };
            }
            above = below;
        }
    }

    /// Vehicle, vignetting, noise and tone of a finished row.
    fn finish_row(&self, row: usize, light: &[Rgb], pixels: &mut [u8], mask: &mut [u8]) {
        let width = light.len();
        for (column, ((light, pixel), mask)) in light.iter().zip(pixels.chunks_mut(3)).zip(mask).enumerate() {
            let mut light = *light;
            if !self.rods.is_empty() && self.draw_rods(column, row, &mut light) {
                *mask = 0;
            }
            let vignette = self.renderer.sensor.vignette(self.radius_squared(column, row));
            let light = light.map(|value| value * vignette);
            let place = (row * width + column) as u64;
            pixel.copy_from_slice(&self.renderer.sensor.quantise(light, &self.exposure, place));
        }
    }

    /// Time of a row (fractional) against the middle row.
    fn row_time_s(&self, row: f64) -> f64 {
        (row / f64::from(self.renderer.camera.height_px) - 0.5) * self.renderer.readout_s
    }

    fn cast(&self, pose: &Isometry3<f64>, ray_in_cam: Vector3<f64>) -> Option<WallHit> {
        self.renderer.wall.ray_cast(Point3::from(pose.translation.vector), pose.rotation * ray_in_cam)
    }

    /// Mean intensity over a coarse grid of the image, vignetting included, vehicle left out.
    fn metered(&self) -> f64 {
        let camera = &self.renderer.camera;
        let mut sum = 0.0;
        for row in 0..METER_GRID {
            for column in 0..METER_GRID {
                let place = |index: usize, size: u32| (2 * index + 1) * size as usize / (2 * METER_GRID);
                let (column, row) = (place(column, camera.width_px), place(row, camera.height_px));
                let Some(ray) = self.renderer.rays.at(column, row) else { continue };
                let Some(hit) = self.cast(&self.shot.tunnel_from_cam, ray) else { continue };
                let light = self.light_of(&hit, METER_PATCH_M, self.shot.tunnel_from_cam.rotation * ray);
                sum += f64::from(light[1] * self.renderer.sensor.vignette(self.radius_squared(column, row)));
            }
        }
        sum / (METER_GRID * METER_GRID) as f64
    }

    /// Squared distance from the image's middle, 1 at the corner.
    fn radius_squared(&self, column: usize, row: usize) -> f32 {
        let camera = &self.renderer.camera;
        let (half_width, half_height) = (0.5 * camera.width_px as f32, 0.5 * camera.height_px as f32);
        let (du, dv) = (column as f32 + 0.5 - half_width, row as f32 + 0.5 - half_height);
        (du * du + dv * dv) / (half_width * half_width + half_height * half_height)
    }

    fn corners(&self, row: usize, columns: &[usize]) -> Corners {
        let middle_s = self.row_time_s(row as f64);
        let at = |time_s: f64| {
            let pose = self.shot.tunnel_from_cam_at(time_s);
            columns.iter().map(|column| self.corner(&pose, *column, row)).collect()
        };
        if !self.blurred {
            return Corners { opening: at(middle_s), closing: Vec::new() };
        }
        let half_s = 0.5 * self.renderer.config.sensor.exposure_s;
        Corners { opening: at(middle_s - half_s), closing: at(middle_s + half_s) }
    }

    fn corner(&self, pose: &Isometry3<f64>, column: usize, row: usize) -> Option<Corner> {
        let hit = self.cast(pose, self.renderer.rays.at(column, row)?)?;
        Some(Corner {
            s_m: hit.s_m,
            x_m: hit.x_m,
            irradiance: self.lamp.irradiance(&hit.point, &hit.normal) as f32,
            normal: hit.normal.map(|part| part as f32),
            surface: hit.surface,
        })
    }

    /// The cells between two rows of corners at a column of them.
    fn pair(&self, [above, below]: [&Corners; 2], column: usize) -> Option<CellPair> {
        let cell = |above: &[Option<Corner>], below: &[Option<Corner>]| {
            Cell::new([above[column], above[column + 1], below[column], below[column + 1]], self.perimeter_m)
        };
        let opening = cell(&above.opening, &below.opening)?;
        if !self.blurred {
            return Some(CellPair { opening, closing: opening });
        }
        let closing = cell(&above.closing, &below.closing)?;
        let same_surface = closing.surface() == opening.surface();
        same_surface.then(|| CellPair { opening, closing: closing.nearest_turn(&opening, self.perimeter_m) })
    }

    /// Tells whether a block may be interpolated: nothing small in front of it, no joint in it, its middle where the
    /// interpolation puts it.
    fn is_smooth(&self, pair: &CellPair, [left, top]: [usize; 2], [width, height]: [usize; 2]) -> bool {
        let wall = &self.renderer.wall;
        let one_ring = |cell: &Cell| {
            let stations = [(0.0, 0.0), (1.0, 0.0), (0.0, 1.0), (1.0, 1.0)].map(|(u, v)| cell.at(u, v)[1]);
            stations.iter().all(|x_m| wall.same_ring(*x_m, stations[0]))
        };
        if !one_ring(&pair.opening) || (self.blurred && !one_ring(&pair.closing)) {
            return false;
        }
        let (column, row) = (left + width / 2, top + height / 2);
        let Some(ray) = self.renderer.rays.at(column, row) else { return false };
        let opening_s = if self.blurred { -0.5 * self.renderer.config.sensor.exposure_s } else { 0.0 };
        let pose = self.shot.tunnel_from_cam_at(self.row_time_s(row as f64) + opening_s);
        let reach = BLOCK as f64 / self.renderer.camera.focal_px[0];
        if wall.pipe_near(Point3::from(pose.translation.vector), pose.rotation * ray, reach) {
            return false;
        }
        let Some(middle) = self.corner(&pose, column, row) else { return false };
        let pixel = Window { width: 1.0 / width as f64, height: 1.0 / height as f64, ..Window::WHOLE };
        let size_m = pair.opening.size_m(&pixel);
        let (u, v) = ((column - left) as f64 / width as f64, (row - top) as f64 / height as f64);
        let error_m = pair.opening.error_m(u, v, &middle, self.perimeter_m);
        middle.surface == pair.opening.surface() && error_m < BLOCK_TOLERANCE_PX * f64::from(size_m[0].min(size_m[1]))
    }

    /// Light of a pixel that is a window of a cell; sample k sees the wall at its own moment of the exposure.
    fn cell_light(&self, pair: &CellPair, window: &Window, pixel: [usize; 2]) -> Rgb {
        let n = usize::from(self.renderer.config.supersampling);
        let count = n * n;
        let rotation = self.time_rotation(pixel);
        let place_at = |sample: usize, u: f64, v: f64| {
            let (u, v) = (window.u + u * window.width, window.v + v * window.height);
            let start = pair.opening.at(u, v);
            if !self.blurred {
                return start;
            }
            let moment = moment(sample + rotation, count);
            let end = pair.closing.at(u, v);
            [start[0] + (end[0] - start[0]) * moment, start[1] + (end[1] - start[1]) * moment]
        };
        let [whole_s_m, whole_x_m] = pair.opening.size_m(window);
        let patch = |[s_m, x_m]: [f64; 2], share: f32| Patch {
            s_m,
            x_m,
            size_s_m: whole_s_m * share,
            size_x_m: whole_x_m * share,
        };
        // The middle sample stands for the middle moment.
        let whole = patch(place_at((count / 2 + count - rotation % count) % count, 0.5, 0.5), 1.0);
        let mut samples = [whole; MAX_SAMPLES];
        for (index, sample) in samples.iter_mut().enumerate().take(count) {
            let [u, v] = within(index, n);
            *sample = patch(place_at(index, u, v), 1.0 / n as f32);
        }
        let albedo = self.albedo_of(pair.opening.surface(), &whole, &samples[..count]);
        let light = pair.opening.irradiance(window.u + 0.5 * window.width, window.v + 0.5 * window.height);
        albedo.map(|value| value * light)
    }

    /// `n` x `n` samples, each with its own ray: at edges, on water, where a lens corner sees nothing.
    fn exact_light(&self, pixel: [usize; 2], n: usize) -> Rgb {
        let [column, row] = pixel;
        let count = n * n;
        let rotation = self.time_rotation(pixel);
        let sample_rad = 1.0 / (self.renderer.camera.focal_px[0] * n as f64);
        let mut sum = [0.0; 3];
        for sample in 0..count {
            let [u, v] = within(sample, n);
            let Some(ray) = self.renderer.rays.within(column, row, u, v) else { continue };
            let blur_s = if self.blurred {
                (moment(sample + rotation, count) - 0.5) * self.renderer.config.sensor.exposure_s
            } else {
                0.0
            };
            let pose = self.shot.tunnel_from_cam_at(self.row_time_s(row as f64 + v) + blur_s);
            let Some(hit) = self.cast(&pose, ray) else { continue };
            let size_m = (hit.distance * ray.norm() * sample_rad) as f32;
            let light = self.light_of(&hit, size_m, pose.rotation * ray);
            for (sum, light) in sum.iter_mut().zip(light) {
                *sum += light;
            }
        }
        sum.map(|value| value / count as f32)
    }

    /// Shifts which sample sees which moment from pixel to pixel, so that blur has no grain of its own.
    fn time_rotation(&self, [column, row]: [usize; 2]) -> usize {
        if self.blurred {
            (noise::lattice_bits(self.renderer.seed, column as i64, row as i64) >> 32) as usize
        } else {
            0
        }
    }

    /// Light that leaves a surface towards the camera; `direction` (tunnel frame) is the ray's that met it.
    fn light_of(&self, hit: &WallHit, size_m: f32, direction: Vector3<f64>) -> Rgb {
        let own = self.lit(hit, size_m);
        if hit.surface != Surface::Water {
            return own;
        }
        // Schlick's approximation of Fresnel's reflectance.
        let direction = direction.normalize();
        let grazing = 1.0 + direction.dot(&hit.normal).min(0.0);
        let reflectance = WATER_REFLECTANCE + (1.0 - WATER_REFLECTANCE) * grazing.powi(5);
        let mirrored = direction - hit.normal * (2.0 * direction.dot(&hit.normal));
        let mut seen = [self.lamp.glint(&hit.point, &mirrored) as f32; 3];
        if let Some(beyond) = self.renderer.wall.ray_cast(hit.point + hit.normal * 1e-6, mirrored) {
            let wall = self.lit(&beyond, 2.0 * size_m);
            seen = std::array::from_fn(|channel| seen[channel] + wall[channel]);
        }
        std::array::from_fn(|channel| own[channel] + reflectance as f32 * seen[channel])
    }

    /// Albedo times irradiance.
    fn lit(&self, hit: &WallHit, size_m: f32) -> Rgb {
        let patch = Patch { s_m: hit.s_m, x_m: hit.x_m, size_s_m: size_m, size_x_m: size_m };
        let irradiance = self.lamp.irradiance(&hit.point, &hit.normal) as f32;
        self.albedo_of(hit.surface, &patch, &[patch]).map(|albedo| albedo * irradiance)
    }

    fn albedo_of(&self, surface: Surface, whole: &Patch, samples: &[Patch]) -> Rgb {
        match surface {
            Surface::Lining => self.renderer.paint.mean_albedo(whole, samples),
            Surface::Pipe(_) => self.renderer.fittings.mean_albedo(whole, samples),
            Surface::Water => WATER,
        }
    }

    /// Draws vehicle parts over a pixel; tells whether the pixel must be masked.
    fn draw_rods(&self, column: usize, row: usize, light: &mut Rgb) -> bool {
        let Some(ray) = self.renderer.rays.within(column, row, 0.5, 0.5) else { return false };
        let pixel_rad = 1.0 / self.renderer.camera.focal_px[0];
        let mut near = false;
        for rod in &self.rods {
            let hit = rod.meet(&ray);
            let pixel_m = hit.depth_m * pixel_rad;
            near |= hit.miss_m < MASK_MARGIN_PX * pixel_m;
            // The edge as the share of a pixel-wide strip that it covers.
            let share = (0.5 - hit.miss_m / pixel_m.max(1e-9)).clamp(0.0, 1.0) as f32;
            *light = light.map(|value| value + (hit.intensity - value) * share);
        }
        near
    }
}

/// Left edges of the blocks, and the image's right edge.
fn block_columns(width: usize) -> Vec<usize> {
    (0..width).step_by(BLOCK).chain([width]).collect()
}

/// Place of a sample within its pixel, in shares.
fn within(sample: usize, n: usize) -> [f64; 2] {
    [((sample % n) as f64 + 0.5) / n as f64, ((sample / n) as f64 + 0.5) / n as f64]
}

/// Moment of a sample within the exposure, in shares.
fn moment(sample: usize, count: usize) -> f64 {
    ((sample % count) as f64 + 0.5) / count as f64
}
