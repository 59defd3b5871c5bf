//! What only a simulation knows: true camera poses and the wall as painted.

use std::cell::RefCell;
use std::fmt::Write as _;
use std::path::Path;

use adit_geometry::profile::Profile;
use jpeg_encoder::{Encoder, ImageBuffer, JpegColorType, SamplingFactor, rgb_to_ycbcr};
use nalgebra::Isometry3;
use rayon::prelude::*;
use serde::Serialize;

use super::RenderError;
use super::card::{jpeg_size, write_file};
use crate::scene::paint::{Paint, Patch, srgb_of_linear};

/// Rows of the texture that are painted at a time.
const BAND_ROWS: usize = 64;
/// The true texture reaches this far beyond the first and the last photo.
const MARGIN_M: f64 = 2.0;
/// Rows that a JPEG holds at most, less some.
const MOST_ROWS: f64 = 65_000.0;
/// Quality of the texture file.
const QUALITY: u8 = 92;

/// Writes `poses.csv`: name of the photo, rotation `tunnel_from_cam` (w first), optical centre.
///
/// # Errors
/// [`RenderError::Write`].
pub fn write_poses<'a>(
    file: &Path,
    poses: impl IntoIterator<Item = (&'a str, &'a Isometry3<f64>)>,
) -> Result<(), RenderError> {
    let mut text = String::from("photo,qw,qx,qy,qz,x_m,y_m,z_m\n");
    for (photo, tunnel_from_cam) in poses {
        let (q, t) = (tunnel_from_cam.rotation, tunnel_from_cam.translation);
        // One of the two quaternions of a rotation: w is not negative.
        let sign = if q.w < 0.0 { -1.0 } else { 1.0 };
        let [w, i, j, k] = [q.w * sign, q.i * sign, q.j * sign, q.k * sign];
        let [x, y, z] = [t.x, t.y, t.z];
        // Writing to a string cannot fail.
        let _ = writeln!(text, "{photo},{w:.12},{i:.12},{j:.12},{k:.12},{x:.9},{y:.9},{z:.9}");
    }
    write_file(file, text.as_bytes())
}

/// Writes the gains (red, green, blue; on the light, before the sRGB curve) that made each photo.
///
/// # Errors
/// [`RenderError::Write`] if the file cannot be written.
pub fn write_exposures<'a>(
    file: &Path,
    photos: impl IntoIterator<Item = (&'a str, [f64; 3])>,
) -> Result<(), RenderError> {
    let mut text = String::from("photo,gain_red,gain_green,gain_blue\n");
    for (photo, [red, green, blue]) in photos {
        // Writing to a string cannot fail.
        let _ = writeln!(text, "{photo},{red:.6},{green:.6},{blue:.6}");
    }
    write_file(file, text.as_bytes())
}

/// Geometry of the unrolled texture, with the fields of `panorama.json`.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct TextureGeometry {
    /// Version of the format.
    pub format: u32,
    /// Scale, adjusted so that a whole number of columns goes around.
    pub mm_per_px: f64,
    /// Columns: once around the section from the crown, clockwise looking forward.
    pub width_px: usize,
    /// Rows: along the tunnel.
    pub height_px: usize,
    /// Station of the first row's outer edge.
    pub x0_m: f64,
    /// Arc length of the first column's outer edge.
    pub s0_m: f64,
    /// Length of the lining once around.
    pub perimeter_m: f64,
    /// The profile as in `survey.toml`.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub profile: Option<serde_json::Value>,
}

impl TextureGeometry {
    /// The texture of the stations `from_x_m..to_x_m` at about `mm_per_px`.
    pub fn new(profile: &Profile<f64>, from_x_m: f64, to_x_m: f64, mm_per_px: f64) -> Self {
        let perimeter_m = profile.perimeter_m();
        let columns = (perimeter_m * 1e3 / mm_per_px).round().max(1.0);
        let mm_per_px = perimeter_m * 1e3 / columns;
        let rows = ((to_x_m - from_x_m) * 1e3 / mm_per_px).ceil().max(1.0);
        Self {
            format: 1,
            mm_per_px,
            width_px: columns as usize,
            height_px: rows as usize,
            x0_m: from_x_m,
            s0_m: 0.0,
            perimeter_m,
            profile: None,
        }
    }

    /// The texture that photos at these stations may see, at `finest_mm_per_px` or, for a long tunnel, as fine as a JPEG
    /// file holds.
    pub fn around(profile: &Profile<f64>, stations_m: impl IntoIterator<Item = f64>, finest_mm_per_px: f64) -> Self {
        let range = |(from_m, to_m): (f64, f64), x_m: f64| (from_m.min(x_m), to_m.max(x_m));
        let (from_m, to_m) = stations_m.into_iter().fold((f64::INFINITY, f64::NEG_INFINITY), range);
        let (from_m, to_m) = (from_m - MARGIN_M, to_m + MARGIN_M);
        Self::new(profile, from_m, to_m, finest_mm_per_px.max((to_m - from_m) * 1e3 / MOST_ROWS))
    }

    /// Wall patch of a pixel.
    fn patch(&self, column: usize, row: usize) -> Patch {
        let pixel_m = self.mm_per_px * 1e-3;
        Patch {
            s_m: self.s0_m + (column as f64 + 0.5) * pixel_m,
            x_m: self.x0_m + (row as f64 + 0.5) * pixel_m,
            size_s_m: pixel_m as f32,
            size_x_m: pixel_m as f32,
        }
    }
}

/// Writes `texture.jpg` (albedo as sRGB) and `texture.json` into `folder`.
///
/// Pipes, water and light are left out: this is the lining's paint. Memory does not grow with the tunnel's length.
///
/// # Errors
/// [`RenderError::TooLarge`] beyond what a JPEG file holds, [`RenderError::Jpeg`], [`RenderError::Write`].
pub fn write_texture(folder: &Path, geometry: &TextureGeometry, paint: &dyn Paint) -> Result<(), RenderError> {
    let (width, height) = jpeg_size(geometry.width_px, geometry.height_px)?;
    let mut bytes = Vec::new();
    let mut encoder = Encoder::new(&mut bytes, QUALITY);
    encoder.set_sampling_factor(SamplingFactor::R_4_4_4);
    let band = RefCell::new(Band { first_row: usize::MAX, pixels: Vec::new() });
    encoder.encode_image(LazyTexture { geometry, paint, width, height, band })?;
    write_file(&folder.join("texture.jpg"), &bytes)?;
    let json = serde_json::to_string_pretty(geometry).unwrap_or_default();
    write_file(&folder.join("texture.json"), json.as_bytes())
}

/// A band of finished rows.
struct Band {
    first_row: usize,
    pixels: Vec<[u8; 3]>,
}

/// A texture that is painted band by band as the encoder asks for its rows.
struct LazyTexture<'a> {
    geometry: &'a TextureGeometry,
    paint: &'a dyn Paint,
    width: u16,
    height: u16,
    band: RefCell<Band>,
}

impl LazyTexture<'_> {
    fn paint_band(&self, first_row: usize) -> Vec<[u8; 3]> {
        let width = self.geometry.width_px;
        let rows = BAND_ROWS.min(self.geometry.height_px - first_row);
        let mut pixels = vec![[0; 3]; rows * width];
        pixels.par_chunks_mut(width).enumerate().for_each(|(row, pixels)| {
            for (column, pixel) in pixels.iter_mut().enumerate() {
                let albedo = self.paint.albedo(&self.geometry.patch(column, first_row + row));
                *pixel = albedo.map(|value| (srgb_of_linear(value) * 255.0).round() as u8);
            }
        });
        pixels
    }
}

impl ImageBuffer for LazyTexture<'_> {
    fn get_jpeg_color_type(&self) -> JpegColorType {
        JpegColorType::Ycbcr
    }

    fn width(&self) -> u16 {
        self.width
    }

    fn height(&self) -> u16 {
        self.height
    }

    fn fill_buffers(&self, row: u16, buffers: &mut [Vec<u8>; 4]) {
        let row = usize::from(row);
        let first_row = row - row % BAND_ROWS;
        let mut band = self.band.borrow_mut();
        if band.first_row != first_row {
            *band = Band { first_row, pixels: self.paint_band(first_row) };
        }
        let width = self.geometry.width_px;
        for [red, green, blue] in &band.pixels[(row - first_row) * width..][..width] {
            let (luma, cb, cr) = rgb_to_ycbcr(*red, *green, *blue);
            buffers[0].push(luma);
            buffers[1].push(cb);
            buffers[2].push(cr);
        }
    }
}

#[cfg(test)]
mod tests {
    use adit_geometry::profile::ProfileSpec;
    use nalgebra::{Translation3, UnitQuaternion, Vector3};

    use super::*;

    #[test]
    fn poses_are_written_in_the_promised_format() {
        let folder = tempfile::tempdir().expect("a folder");
        let file = folder.path().join("truth/poses.csv");
        let turned = UnitQuaternion::from_scaled_axis(Vector3::new(0.0, 0.0, std::f64::consts::FRAC_PI_2));
        let pose = Isometry3::from_parts(Translation3::new(1.0, -2.0, 0.5), turned);
        write_poses(&file, [("GOPR0001.JPG", &pose)]).expect("writable");
        let text = std::fs::read_to_string(&file).expect("readable");
        assert_eq!(
            text,
            "photo,qw,qx,qy,qz,x_m,y_m,z_m\n\
             GOPR0001.JPG,0.707106781187,0.000000000000,0.000000000000,0.707106781187,1.000000000,-2.000000000,0.500000000\n"
        );
    }

    /// Red grows with s, green with x.
    struct Ramp;

    impl Paint for Ramp {
        fn mean_albedo(&self, patch: &Patch, _: &[Patch]) -> [f32; 3] {
            [(patch.s_m / 10.0) as f32, (patch.x_m / 10.0) as f32, 0.2]
        }
    }

    #[test]
    fn the_texture_has_columns_around_and_rows_along() {
        let folder = tempfile::tempdir().expect("a folder");
        let profile = ProfileSpec::Circle { radius_m: 1.0 }.build().expect("valid");
        let geometry = TextureGeometry::new(&profile, 1.0, 4.0, 20.0);
        assert_eq!((geometry.width_px, geometry.height_px), (314, 150));
        write_texture(folder.path(), &geometry, &Ramp).expect("writable");
        let bytes = std::fs::read(folder.path().join("texture.jpg")).expect("readable");
        let mut decoder = zune_jpeg::JpegDecoder::new(zune_jpeg::zune_core::bytestream::ZCursor::new(bytes));
        let pixels = decoder.decode().expect("a JPEG");
        let at = |column: usize, row: usize| &pixels[(row * 314 + column) * 3..][..3];
        let expected = |value: f64| f64::from(srgb_of_linear(value as f32) * 255.0);
        for (column, row) in [(20, 10), (300, 10), (20, 140), (200, 77)] {
            let (s_m, x_m) = ((column as f64 + 0.5) * 0.02001, 1.0 + (row as f64 + 0.5) * 0.02001);
            assert!((f64::from(at(column, row)[0]) - expected(s_m / 10.0)).abs() < 4.0);
            assert!((f64::from(at(column, row)[1]) - expected(x_m / 10.0)).abs() < 4.0);
        }
        let json = std::fs::read_to_string(folder.path().join("texture.json")).expect("readable");
        let json: serde_json::Value = serde_json::from_str(&json).expect("JSON");
        assert_eq!(json["width_px"], 314);
        assert_eq!(json["x0_m"], 1.0);
    }

    #[test]
    fn a_texture_beyond_the_jpeg_limit_is_an_error() {
        let folder = tempfile::tempdir().expect("a folder");
        let profile = ProfileSpec::Circle { radius_m: 1.0 }.build().expect("valid");
        let geometry = TextureGeometry::new(&profile, 0.0, 200.0, 2.0);
        let result = write_texture(folder.path(), &geometry, &Ramp);
        assert!(matches!(result, Err(RenderError::TooLarge { .. })));
    }
}
