//! One photo: every pixel's ray, surface, light and value.

use std::sync::Arc;

use adit_geometry::camera::Camera;
use nalgebra::{Isometry3, Point3, Translation3, UnitQuaternion, Vector3};
use rayon::prelude::*;

use super::config::{RenderConfig, RenderError};
use super::light::Lamp;
use super::rays::CornerRays;
use super::sensor::{Exposure, Sensor};
use super::vehicle::{Rod, rods_in_cam};
use crate::scene::noise;
use crate::scene::paint::{Fittings, Paint, Patch, Rgb};
use crate::scene::{Surface, Wall, WallHit};

/// Rows that one task renders; the corner rows between tasks are cast twice.
const BAND_ROWS: usize = 16;
/// Places at which the exposure is metered, per axis.
const METER_GRID: usize = 20;
/// Patch size that the meter looks at: about the middle of what a metering field averages.
const METER_PATCH_M: f32 = 0.1;
/// Corners whose normals differ by more than this cosine are not interpolated between.
const SAME_FACE_COSINE: f32 = 0.97;
/// Corners further apart than this on the wall are not interpolated between.
const SAME_FACE_M: f64 = 0.3;
/// Linear albedo of dark water seen from above.
const WATER: Rgb = [0.012, 0.018, 0.016];
/// Reflectance of water at normal incidence (refractive index 1.33).
const WATER_REFLECTANCE: f64 = 0.02;
/// Around a vehicle part, so many pixels more are masked, because lens and interpolation smear its edge.
const MASK_MARGIN_PX: f64 = 2.0;

/// An 8-bit sRGB image, row by row.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct RgbImage {
    /// Columns.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// `width * height * 3` values.
    pub data: Vec<u8>,
}

/// Where the camera is at one exposure and how it moves.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Shot {
    /// Number of the photo within the flight; selects its noise and exposure.
    pub index: u32,
    /// Camera pose at the middle of the exposure of the middle row.
    pub tunnel_from_cam: Isometry3<f64>,
    /// Vehicle pose at the same time.
    pub tunnel_from_body: Isometry3<f64>,
    /// Velocity of the optical centre in the tunnel frame.
    pub velocity_mps: Vector3<f64>,
    /// Angular velocity of the camera in the tunnel frame.
    pub angular_velocity_rad_per_s: Vector3<f64>,
    /// Brightness of the lamp, 0 to 1.
    pub light_level: f64,
}

impl Shot {
    /// A camera at rest with its lamp on.
    pub fn still(index: u32, tunnel_from_cam: Isometry3<f64>, tunnel_from_body: Isometry3<f64>) -> Self {
        Self {
            index,
            tunnel_from_cam,
            tunnel_from_body,
            velocity_mps: Vector3::zeros(),
            angular_velocity_rad_per_s: Vector3::zeros(),
            light_level: 1.0,
        }
    }

    /// Camera pose `time_s` after the middle of the exposure.
    fn tunnel_from_cam_at(&self, time_s: f64) -> Isometry3<f64> {
        if time_s == 0.0 {
            return self.tunnel_from_cam;
        }
        let turned = UnitQuaternion::from_scaled_axis(self.angular_velocity_rad_per_s * time_s);
        let Isometry3 { rotation, translation } = self.tunnel_from_cam;
        Isometry3::from_parts(Translation3::from(translation.vector + self.velocity_mps * time_s), turned * rotation)
    }

    fn is_still(&self) -> bool {
        self.velocity_mps == Vector3::zeros() && self.angular_velocity_rad_per_s == Vector3::zeros()
    }
}

/// A finished photo.
#[derive(Clone, Debug, PartialEq)]
pub struct RenderedPhoto {
    /// The picture.
    pub image: RgbImage,
    /// 0 where a part of the vehicle hides the wall, 255 elsewhere; `None` where the vehicle is not in view.
    pub mask: Option<Vec<u8>>,
    /// Gain that the exposure control chose.
    pub gain: f64,
}

/// Renders photos of one tunnel with one camera.
pub struct PhotoRenderer {
    camera: Camera<f64>,
    readout_s: f64,
    wall: Arc<Wall>,
    paint: Arc<dyn Paint>,
    fittings: Fittings,
    rays: CornerRays,
    sensor: Sensor,
    config: RenderConfig,
    lamp_reference_m: f64,
    seed: u64,
}

impl PhotoRenderer {
    /// Prepares the camera; `readout_s` is the time between the first and the last row's exposure.
    ///
    /// # Errors
    /// [`RenderError::OutOfRange`] for a number out of its range.
    pub fn new(
        camera: Camera<f64>,
        readout_s: f64,
        wall: Arc<Wall>,
        paint: Arc<dyn Paint>,
        config: &RenderConfig,
        seed: u64,
    ) -> Result<Self, RenderError> {
        config.check()?;
        let perimeter_m = wall.profile().perimeter_m();
        Ok(Self {
            camera,
            readout_s,
            paint,
            fittings: Fittings::new(perimeter_m, noise::derive_seed(seed, 0x30)),
            rays: CornerRays::new(&camera),
            sensor: Sensor::new(config.sensor),
            config: config.clone(),
            // Unit irradiance at the distance of the wall of a circle with the same perimeter.
            lamp_reference_m: perimeter_m / std::f64::consts::TAU,
            wall,
            seed: noise::derive_seed(seed, 0x31),
        })
    }

    /// Renders a photo on the current thread pool.
    pub fn render(&self, shot: &Shot) -> RenderedPhoto {
        let (width, height) = (self.camera.width_px as usize, self.camera.height_px as usize);
        let mut view = View::new(self, shot);
        let photo_seed = noise::derive_seed(self.seed, u64::from(shot.index));
        view.exposure = self.sensor.expose(view.metered(), photo_seed);
        let mut data = vec![0; width * height * 3];
        let mut mask = vec![255; width * height];
        data.par_chunks_mut(width * 3 * BAND_ROWS)
            .zip(mask.par_chunks_mut(width * BAND_ROWS))
            .enumerate()
            .for_each(|(band, (pixels, mask))| view.render_band(band * BAND_ROWS, pixels, mask));
        let masked = mask.contains(&0);
        RenderedPhoto {
            image: RgbImage { width, height, data },
            mask: masked.then_some(mask),
            gain: view.exposure.gain(),
        }
    }
}

/// What the ray through a pixel corner meets.
#[derive(Clone, Copy, Debug)]
struct Corner {
    s_m: f64,
    x_m: f64,
    irradiance: f32,
    normal: Vector3<f32>,
    surface: Surface,
}

/// A row of corners at the opening and at the closing of the shutter.
struct CornerRow {
    opening: Vec<Option<Corner>>,
    /// Empty for a camera at rest.
    closing: Vec<Option<Corner>>,
}

/// The state of one photo.
struct View<'a> {
    renderer: &'a PhotoRenderer,
    shot: &'a Shot,
    lamp: Lamp,
    rods: Vec<Rod>,
    exposure: Exposure,
    perimeter_m: f64,
    blurred: bool,
}

impl<'a> View<'a> {
    fn new(renderer: &'a PhotoRenderer, shot: &'a Shot) -> Self {
        let config = &renderer.config;
        let (tunnel_from_cam, tunnel_from_body) = (&shot.tunnel_from_cam, &shot.tunnel_from_body);
        Self {
            renderer,
            shot,
            lamp: Lamp::new(&config.light, shot, renderer.lamp_reference_m),
            rods: rods_in_cam(&config.vehicle_parts, tunnel_from_cam, tunnel_from_body),
            exposure: renderer.sensor.expose(config.sensor.target_intensity, 0),
            perimeter_m: renderer.wall.profile().perimeter_m(),
            blurred: !shot.is_still() && config.sensor.exposure_s > 0.0,
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
                let light = self.light_of(&hit, [METER_PATCH_M; 2], ray);
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

    fn render_band(&self, first_row: usize, pixels: &mut [u8], mask: &mut [u8]) {
        let width = self.renderer.camera.width_px as usize;
        let mut above = self.corner_row(first_row);
        for (offset, (pixels, mask)) in pixels.chunks_mut(width * 3).zip(mask.chunks_mut(width)).enumerate() {
            let row = first_row + offset;
            let below = self.corner_row(row + 1);
            for (column, (pixel, mask)) in pixels.chunks_mut(3).zip(mask.iter_mut()).enumerate() {
                let mut light = self.pixel_light(&above, &below, column, row);
                if !self.rods.is_empty() && self.draw_rods(column, row, &mut light) {
                    *mask = 0;
                }
                let vignette = self.renderer.sensor.vignette(self.radius_squared(column, row));
                let place = (row * width + column) as u64;
                let light = light.map(|value| value * vignette);
                pixel.copy_from_slice(&self.renderer.sensor.quantise(light, &self.exposure, place));
            }
            above = below;
        }
    }

    fn corner_row(&self, row: usize) -> CornerRow {
        let middle_s = self.row_time_s(row as f64);
        if !self.blurred {
            return CornerRow { opening: self.corners_at(row, middle_s), closing: Vec::new() };
        }
        let half_s = 0.5 * self.renderer.config.sensor.exposure_s;
        CornerRow { opening: self.corners_at(row, middle_s - half_s), closing: self.corners_at(row, middle_s + half_s) }
    }

    fn corners_at(&self, row: usize, time_s: f64) -> Vec<Option<Corner>> {
        let pose = self.shot.tunnel_from_cam_at(time_s);
        let columns = 0..=self.renderer.camera.width_px as usize;
        columns
            .map(|column| {
                let hit = self.cast(&pose, self.renderer.rays.at(column, row)?)?;
                Some(Corner {
                    s_m: hit.s_m,
                    x_m: hit.x_m,
                    irradiance: self.lamp.irradiance(&hit.point, &hit.normal) as f32,
                    normal: hit.normal.map(|part| part as f32),
                    surface: hit.surface,
                })
            })
            .collect()
    }

    /// Mean light of a pixel before vignetting and gain.
    fn pixel_light(&self, above: &CornerRow, below: &CornerRow, column: usize, row: usize) -> Rgb {
        let cell = |above: &[Option<Corner>], below: &[Option<Corner>]| {
            Cell::new([above[column], above[column + 1], below[column], below[column + 1]], self.perimeter_m)
        };
        let Some(opening) = cell(&above.opening, &below.opening) else { return self.exact_light(column, row) };
        if !self.blurred {
            return self.cell_light(&opening, &opening, 0);
        }
        match cell(&above.closing, &below.closing) {
            Some(closing) if closing.surface == opening.surface => {
                let rotation = noise::lattice_bits(self.renderer.seed, column as i64, row as i64) as usize;
                self.cell_light(&opening, &closing.nearest_turn(&opening, self.perimeter_m), rotation)
            }
            _ => self.exact_light(column, row),
        }
    }

    /// Samples between the corners; sample k sees the wall at its own moment between opening and closing.
    fn cell_light(&self, opening: &Cell, closing: &Cell, rotation: usize) -> Rgb {
        let n = usize::from(self.renderer.config.supersampling);
        let count = n * n;
        let size = opening.size_m(n);
        let mut sum = [0.0; 3];
        for sample in 0..count {
            let (u, v) = (((sample % n) as f64 + 0.5) / n as f64, ((sample / n) as f64 + 0.5) / n as f64);
            let mut place = opening.at(u, v);
            if self.blurred {
                let moment = (((sample + rotation) % count) as f64 + 0.5) / count as f64;
                let end = closing.at(u, v);
                place = [place[0] + (end[0] - place[0]) * moment, place[1] + (end[1] - place[1]) * moment];
            }
            let patch = Patch { s_m: place[0], x_m: place[1], size_s_m: size[0], size_x_m: size[1] };
            let albedo = self.albedo_of(opening.surface, &patch);
            for (sum, albedo) in sum.iter_mut().zip(albedo) {
                *sum += albedo;
            }
        }
        sum.map(|value| value * opening.irradiance / count as f32)
    }

    /// Every sample with its own ray: at edges, on water, where a lens corner sees nothing.
    fn exact_light(&self, column: usize, row: usize) -> Rgb {
        let n = usize::from(self.renderer.config.supersampling);
        let count = n * n;
        let rotation = noise::lattice_bits(self.renderer.seed, column as i64, row as i64) as usize;
        let pixel_rad = 1.0 / (self.renderer.camera.focal_px[0] * n as f64);
        let mut sum = [0.0; 3];
        for sample in 0..count {
            let (u, v) = (((sample % n) as f64 + 0.5) / n as f64, ((sample / n) as f64 + 0.5) / n as f64);
            let Some(ray) = self.renderer.rays.within(column, row, u, v) else { continue };
            let moment =
                if self.blurred { (((sample + rotation) % count) as f64 + 0.5) / count as f64 - 0.5 } else { 0.0 };
            let time_s = self.row_time_s(row as f64 + v) + moment * self.renderer.config.sensor.exposure_s;
            let pose = self.shot.tunnel_from_cam_at(if self.shot.is_still() { 0.0 } else { time_s });
            let Some(hit) = self.cast(&pose, ray) else { continue };
            let direction = pose.rotation * ray;
            let size_m = (hit.distance * ray.norm() * pixel_rad) as f32;
            let light = self.light_of(&hit, [size_m; 2], direction);
            for (sum, light) in sum.iter_mut().zip(light) {
                *sum += light;
            }
        }
        sum.map(|value| value / count as f32)
    }

    /// Light that leaves a surface towards the camera; `direction` (tunnel frame) is the ray's that met it.
    fn light_of(&self, hit: &WallHit, size_m: [f32; 2], direction: Vector3<f64>) -> Rgb {
        let patch = Patch { s_m: hit.s_m, x_m: hit.x_m, size_s_m: size_m[0], size_x_m: size_m[1] };
        let irradiance = self.lamp.irradiance(&hit.point, &hit.normal) as f32;
        let own = self.albedo_of(hit.surface, &patch).map(|albedo| albedo * irradiance);
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
            let patch =
                Patch { s_m: beyond.s_m, x_m: beyond.x_m, size_s_m: 2.0 * size_m[0], size_x_m: 2.0 * size_m[1] };
            let irradiance = self.lamp.irradiance(&beyond.point, &beyond.normal) as f32;
            let albedo = self.albedo_of(beyond.surface, &patch);
            seen = std::array::from_fn(|channel| seen[channel] + albedo[channel] * irradiance);
        }
        std::array::from_fn(|channel| own[channel] + reflectance as f32 * seen[channel])
    }

    fn albedo_of(&self, surface: Surface, patch: &Patch) -> Rgb {
        match surface {
            Surface::Lining => self.renderer.paint.albedo(patch),
            Surface::Pipe(_) => self.renderer.fittings.albedo(patch),
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

/// Four corners of a pixel on one smooth face.
#[derive(Clone, Copy, Debug)]
struct Cell {
    /// `[s, x]`: top left, then the changes along u, along v, and along both.
    origin: [f64; 2],
    du: [f64; 2],
    dv: [f64; 2],
    twist: [f64; 2],
    irradiance: f32,
    surface: Surface,
}

impl Cell {
    /// `None` where the corners do not lie on one smooth face, and on water, whose mirror image needs rays.
    fn new(corners: [Option<Corner>; 4], perimeter_m: f64) -> Option<Self> {
        let [a, b, c, d] = [corners[0]?, corners[1]?, corners[2]?, corners[3]?];
        if a.surface == Surface::Water {
            return None;
        }
        let step = |to: &Corner| [shortest_way(to.s_m - a.s_m, perimeter_m), to.x_m - a.x_m];
        let steps = [step(&b), step(&c), step(&d)];
        let smooth = [b, c, d].iter().zip(&steps).all(|(corner, step)| {
            corner.surface == a.surface
                && corner.normal.dot(&a.normal) > SAME_FACE_COSINE
                && step[0].abs() < SAME_FACE_M
                && step[1].abs() < SAME_FACE_M
        });
        let [du, dv, both] = steps;
        smooth.then(|| Self {
            origin: [a.s_m, a.x_m],
            du,
            dv,
            twist: [both[0] - du[0] - dv[0], both[1] - du[1] - dv[1]],
            irradiance: 0.25 * (a.irradiance + b.irradiance + c.irradiance + d.irradiance),
            surface: a.surface,
        })
    }

    fn at(&self, u: f64, v: f64) -> [f64; 2] {
        let along = |axis: usize| self.origin[axis] + u * self.du[axis] + v * self.dv[axis] + u * v * self.twist[axis];
        [along(0), along(1)]
    }

    /// Size of one of n x n samples on the wall, `[along s, along x]`.
    fn size_m(&self, n: usize) -> [f32; 2] {
        [0, 1].map(|axis| (self.du[axis].hypot(self.dv[axis]) / n as f64) as f32)
    }

    /// The same cell with its arc length in the turn of `other`'s.
    fn nearest_turn(mut self, other: &Self, perimeter_m: f64) -> Self {
        self.origin[0] = other.origin[0] + shortest_way(self.origin[0] - other.origin[0], perimeter_m);
        self
    }
}

fn shortest_way(difference_m: f64, perimeter_m: f64) -> f64 {
    if difference_m.abs() <= 0.5 * perimeter_m {
        difference_m
    } else {
        difference_m - (difference_m / perimeter_m).round() * perimeter_m
    }
}

#[cfg(test)]
mod tests;
