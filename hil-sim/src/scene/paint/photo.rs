//! A picture file as the lining: columns run around the section, rows along the tunnel, as in `panorama.json`.

use std::io;
use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};
use zune_jpeg::zune_core::bytestream::ZCursor;
use zune_jpeg::zune_core::colorspace::ColorSpace;
use zune_jpeg::zune_core::options::DecoderOptions;

use super::{Paint, Patch, Rgb, blend, linear_of_srgb, mean};

/// The picture for `pattern = "photo"`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PhotoTextureConfig {
    /// PNG or JPEG; relative to the mission file.
    pub file: PathBuf,
    /// Scale on the wall. Around the section it is stretched so that a whole number of pictures closes.
    pub mm_per_px: f64,
    /// Station of the first row's outer edge.
    #[serde(default)]
    pub x0_m: f64,
    /// Arc length of the first column's outer edge.
    #[serde(default)]
    pub s0_m: f64,
}

/// Why a picture cannot be used.
#[derive(Debug, thiserror::Error)]
pub enum PhotoTextureError {
    /// `pattern = "photo"` without a picture.
    #[error(
        "simulation.texture: pattern = \"photo\" needs simulation.texture.photo = {{ file = ..., mm_per_px = ... }}"
    )]
    NotGiven,
    /// The scale is not a positive number.
    #[error("simulation.texture.photo.mm_per_px is {0}; expected a positive number")]
    Scale(f64),
    /// The file cannot be read.
    #[error("{}: {source}", file.display())]
    Read {
        /// The file.
        file: PathBuf,
        /// What the system said.
        source: io::Error,
    },
    /// Neither PNG nor JPEG.
    #[error("{}: neither a PNG nor a JPEG file", .0.display())]
    Format(PathBuf),
    /// A damaged or unusual PNG.
    #[error("{}: {source}", file.display())]
    Png {
        /// The file.
        file: PathBuf,
        /// What the decoder said.
        source: png::DecodingError,
    },
    /// A damaged or unusual JPEG.
    #[error("{}: {source}", file.display())]
    Jpeg {
        /// The file.
        file: PathBuf,
        /// What the decoder said.
        source: zune_jpeg::errors::DecodeErrors,
    },
}

/// One level of the pyramid: linear RGB scaled to 16 bits.
struct Level {
    width: usize,
    height: usize,
    samples: Vec<[u16; 3]>,
}

/// A picture with its pyramid of halved copies.
pub(super) struct PhotoTexture {
    levels: Vec<Level>,
    pixel_s_m: f64,
    pixel_x_m: f64,
    s0_m: f64,
    x0_m: f64,
}

impl PhotoTexture {
    pub(super) fn open(
        config: &PhotoTextureConfig,
        perimeter_m: f64,
        folder: &Path,
    ) -> Result<Self, PhotoTextureError> {
        if !(config.mm_per_px > 0.0 && config.mm_per_px < 1e6) {
            return Err(PhotoTextureError::Scale(config.mm_per_px));
        }
        let picture = read_picture(&folder.join(&config.file))?;
        let repeats = (perimeter_m / (picture.width as f64 * config.mm_per_px * 1e-3)).round().max(1.0);
        let pixel_s_m = perimeter_m / (repeats * picture.width as f64);
        let mut levels = vec![picture];
        while let Some(halved) = levels.last().and_then(halve) {
            levels.push(halved);
        }
        Ok(Self { levels, pixel_s_m, pixel_x_m: config.mm_per_px * 1e-3, s0_m: config.s0_m, x0_m: config.x0_m })
    }
}

impl Paint for PhotoTexture {
    fn mean_albedo(&self, _: &Patch, samples: &[Patch]) -> Rgb {
        mean(samples, |sample| self.interpolated(sample))
    }
}

impl PhotoTexture {
    /// Between the two nearest levels of the pyramid.
    fn interpolated(&self, patch: &Patch) -> Rgb {
        let (u, v) = ((patch.s_m - self.s0_m) / self.pixel_s_m, (patch.x_m - self.x0_m) / self.pixel_x_m);
        let pixels = (f64::from(patch.size_s_m) / self.pixel_s_m).max(f64::from(patch.size_x_m) / self.pixel_x_m);
        let level = (pixels.log2() as f32).clamp(0.0, (self.levels.len() - 1) as f32);
        let (fine, share) = (level as usize, level.fract());
        let sharp = self.levels[fine].bilinear(u, v, fine);
        if share > 0.0 && fine + 1 < self.levels.len() {
            blend(sharp, self.levels[fine + 1].bilinear(u, v, fine + 1), share)
        } else {
            sharp
        }
    }
}

impl Level {
    /// Interpolates at the pixel position (u, v) of the full picture; wraps around in both directions.
    fn bilinear(&self, u: f64, v: f64, level: usize) -> Rgb {
        let shrink = 1.0 / (1_u64 << level) as f64;
        let (u, v) = (u * shrink - 0.5, v * shrink - 0.5);
        let (column, row) = (u.floor(), v.floor());
        let (fu, fv) = ((u - column) as f32, (v - row) as f32);
        let wrap = |value: f64, count: usize| (value as i64).rem_euclid(count as i64) as usize;
        let (left, right) = (wrap(column, self.width), wrap(column + 1.0, self.width));
        let (top, bottom) = (wrap(row, self.height), wrap(row + 1.0, self.height));
        let at = |column: usize, row: usize| self.samples[row * self.width + column].map(|v| f32::from(v) / 65535.0);
        blend(blend(at(left, top), at(right, top), fu), blend(at(left, bottom), at(right, bottom), fu), fv)
    }
}

/// The next level: means of 2 x 2 pixels; a last odd row or column is left out. `None` below 2 x 2.
fn halve(level: &Level) -> Option<Level> {
    let (width, height) = (level.width / 2, level.height / 2);
    if width == 0 || height == 0 {
        return None;
    }
    let mut samples = Vec::with_capacity(width * height);
    for row in 0..height {
        for column in 0..width {
            let at = |dc: usize, dr: usize| level.samples[(2 * row + dr) * level.width + 2 * column + dc];
            let four = [at(0, 0), at(1, 0), at(0, 1), at(1, 1)];
            samples.push(std::array::from_fn(|channel| {
                (four.iter().map(|pixel| u32::from(pixel[channel])).sum::<u32>() / 4) as u16
            }));
        }
    }
    Some(Level { width, height, samples })
}

fn read_picture(file: &Path) -> Result<Level, PhotoTextureError> {
    let bytes = std::fs::read(file).map_err(|source| PhotoTextureError::Read { file: file.into(), source })?;
    let (width, height, rgb) = if bytes.starts_with(b"\x89PNG") {
        decode_png(&bytes).map_err(|source| PhotoTextureError::Png { file: file.into(), source })?
    } else if bytes.starts_with(b"\xff\xd8") {
        decode_jpeg(&bytes).map_err(|source| PhotoTextureError::Jpeg { file: file.into(), source })?
    } else {
        return Err(PhotoTextureError::Format(file.into()));
    };
    let linear: Vec<u16> = (0..=255).map(|value| (linear_of_srgb([value; 3])[0] * 65535.0).round() as u16).collect();
    let samples = rgb.as_chunks::<3>().0.iter().map(|pixel| pixel.map(|value| linear[usize::from(value)])).collect();
    Ok(Level { width, height, samples })
}

fn decode_jpeg(bytes: &[u8]) -> Result<(usize, usize, Vec<u8>), zune_jpeg::errors::DecodeErrors> {
    let options =
        DecoderOptions::default().jpeg_set_out_colorspace(ColorSpace::RGB).set_max_width(65_500).set_max_height(65_500);
    let mut decoder = zune_jpeg::JpegDecoder::new_with_options(ZCursor::new(bytes), options);
    let rgb = decoder.decode()?;
    let (width, height) = decoder.dimensions().unwrap_or((0, 0));
    Ok((width, height, rgb))
}

fn decode_png(bytes: &[u8]) -> Result<(usize, usize, Vec<u8>), png::DecodingError> {
    let mut decoder = png::Decoder::new(io::Cursor::new(bytes));
    decoder.set_transformations(png::Transformations::EXPAND | png::Transformations::STRIP_16);
    let mut reader = decoder.read_info()?;
    let mut data = vec![0; reader.output_buffer_size().unwrap_or(0)];
    let info = reader.next_frame(&mut data)?;
    data.truncate(info.buffer_size());
    let channels = info.color_type.samples();
    let rgb = data
        .chunks_exact(channels)
        .flat_map(|pixel| if channels < 3 { [pixel[0]; 3] } else { [pixel[0], pixel[1], pixel[2]] })
        .collect();
    Ok((info.width as usize, info.height as usize, rgb))
}
