//! panorama.tif: the panorama as a tiled `GeoTIFF` with overviews, written tile by tile from the deep-zoom pyramid.
//!
//! TIFF 6.0, `BigTIFF` where 4 GiB might not do. The first directory is the panorama, the others (`NewSubfileType` 1) are
//! its halvings, as GDAL, QGIS and libtiff expect overviews. `GeoTIFF` 1.1 tags give a local system in metres:
//! X = arc length s from the crown, clockwise looking forward; Y = -x, so that the picture is neither turned nor mirrored:
//! rows run forward along the tunnel, and map coordinates of pictures fall from row to row.

use std::fs::File;
use std::io::{BufWriter, Write};
use std::path::Path;

use flate2::Compression as Effort;
use flate2::write::ZlibEncoder;
use jpeg_encoder::{ColorType, Encoder, SamplingFactor};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};
use tiff::encoder::{DirectoryEncoder, TiffEncoder, TiffKind, TiffKindBig, TiffKindStandard};
use tiff::tags::Tag;

use super::error::{ExportError, at_path};
use crate::model::TexturedWall;
use crate::texture::{PixelBox, Rgba8, TILE_PX};

/// Tiles in memory at a time.
const BATCH: usize = 64;
/// A classic TIFF's offsets have 32 bits; the rest is for directories and for data that compression makes larger.
const CLASSIC_BYTES: u64 = 4_000_000_000;

/// How pixels are stored.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, clap::ValueEnum)]
#[serde(rename_all = "lowercase")]
pub enum TiffCompression {
    /// Exact, with opacity as a fourth channel
    #[default]
    Deflate,
    /// A fifth of the size, with the unseen as a mask of its own (GDAL's internal mask)
    Jpeg,
}

/// What is written.
pub(super) struct Picture<'a> {
    pub(super) wall: &'a TexturedWall,
    /// The level that becomes the first directory.
    pub(super) level: u32,
    pub(super) compression: TiffCompression,
    pub(super) jpeg_quality: u8,
}

/// One directory's kind.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Layer {
    Rgba,
    Jpeg,
    Mask,
}

impl Picture<'_> {
    /// The levels that become directories: down to a single tile.
    pub(super) fn levels(&self) -> Vec<u32> {
        let one_tile = |level: &u32| {
            let (width, height) = self.wall.reader.size(*level);
            width.max(height) <= TILE_PX
        };
        let last = (0..=self.level).rev().find(one_tile).unwrap_or(0);
        (last..=self.level).rev().collect()
    }

    /// Tiles that are written, one tick each.
    pub(super) fn tiles(&self) -> usize {
        let tiles = |level: u32| {
            let (width, height) = self.wall.reader.size(level);
            width.div_ceil(TILE_PX) * height.div_ceil(TILE_PX) * self.layers().len()
        };
        self.levels().into_iter().map(tiles).sum()
    }

    /// Whether it has to be a `BigTIFF`: if it would not fit into a classic one even without compression.
    pub(super) fn is_big(&self) -> bool {
        (self.tiles() * TILE_PX * TILE_PX * 4) as u64 > CLASSIC_BYTES
    }

    /// Writes the file.
    pub(super) fn write(&self, path: &Path, tick: &(dyn Fn() + Sync)) -> Result<(), ExportError> {
        if self.is_big() {
            self.write_as::<TiffKindBig>(path, tick)
        } else {
            self.write_as::<TiffKindStandard>(path, tick)
        }
    }

    fn layers(&self) -> &'static [Layer] {
        match self.compression {
            TiffCompression::Deflate => &[Layer::Rgba],
            TiffCompression::Jpeg => &[Layer::Jpeg, Layer::Mask],
        }
    }

    fn write_as<K: TiffKind>(&self, path: &Path, tick: &(dyn Fn() + Sync)) -> Result<(), ExportError> {
        let failed = |source| ExportError::Tiff { path: path.to_owned(), source };
        let mut file = BufWriter::new(File::create(path).map_err(at_path(path))?);
        let mut encoder = TiffEncoder::<_, K>::new_generic(&mut file).map_err(failed)?;
        for level in self.levels() {
            for &layer in self.layers() {
                let mut directory = encoder.image_directory().map_err(failed)?;
                self.write_tiles(path, &mut directory, level, layer, tick)?;
                self.describe(&mut directory, level, layer).map_err(failed)?;
                if level == self.level && layer != Layer::Mask {
                    self.place_on_earth(&mut directory).map_err(failed)?;
                }
                directory.finish().map_err(failed)?;
            }
        }
        file.flush().map_err(at_path(path))
    }

    fn write_tiles<K: TiffKind>(
        &self,
        path: &Path,
        directory: &mut DirectoryEncoder<'_, &mut BufWriter<File>, K>,
        level: u32,
        layer: Layer,
        tick: &(dyn Fn() + Sync),
    ) -> Result<(), ExportError> {
        let failed = |source| ExportError::Tiff { path: path.to_owned(), source };
        let (width, height) = self.wall.reader.size(level);
        let places: Vec<(usize, usize)> = (0..height.div_ceil(TILE_PX))
            .flat_map(|row| (0..width.div_ceil(TILE_PX)).map(move |column| (column * TILE_PX, row * TILE_PX)))
            .collect();
        let (mut offsets, mut lengths) = (Vec::new(), Vec::new());
        for batch in places.chunks(BATCH) {
            let tiles: Vec<Vec<u8>> = batch
                .par_iter()
                .map(|&(column, row)| {
                    let area = PixelBox { column, row, width: TILE_PX, height: TILE_PX };
                    let tile = self.wall.reader.read(level, area)?;
                    tick();
                    self.encode(&tile, layer, path)
                })
                .collect::<Result<_, ExportError>>()?;
            for tile in tiles {
                let length = tile.len() as u64;
                offsets.push(directory.write_data(tile.as_slice()).map_err(failed)?);
                lengths.push(length);
                if length % 2 == 1 {
                    // Directories begin at even offsets.
                    directory.write_data(0_u8).map_err(failed)?;
                }
            }
        }
        let mut list = |tag, values: Vec<u64>| {
            let values = values.into_iter().map(K::convert_offset).collect::<Result<Vec<_>, _>>()?;
            directory.write_tag(tag, K::convert_slice(&values))
        };
        list(Tag::TileOffsets, offsets).and_then(|()| list(Tag::TileByteCounts, lengths)).map_err(failed)
    }

    fn encode(&self, tile: &Rgba8, layer: Layer, path: &Path) -> Result<Vec<u8>, ExportError> {
        match layer {
            Layer::Rgba => deflate(&predicted(tile)),
            Layer::Mask => deflate(&mask(tile)),
            Layer::Jpeg => {
                let rgb = without_edges(tile);
                let mut jpeg = Vec::new();
                let mut encoder = Encoder::new(&mut jpeg, self.jpeg_quality);
                encoder.set_sampling_factor(SamplingFactor::F_1_1);
                return encoder
                    .encode(&rgb, TILE_PX as u16, TILE_PX as u16, ColorType::Rgb)
                    .map(|()| jpeg)
                    .map_err(|source| ExportError::Jpeg { path: path.to_owned(), source });
            }
        }
        .map_err(at_path(path))
    }

    /// The tags that say what the pixels are. TIFF 6.0, sections 8, 10, 15, 18, 21; TIFF Technical Note 2 for JPEG.
    fn describe<K: TiffKind>(
        &self,
        directory: &mut DirectoryEncoder<'_, &mut BufWriter<File>, K>,
        level: u32,
        layer: Layer,
    ) -> tiff::TiffResult<()> {
        let (width, height) = self.wall.reader.size(level);
        // Bit 0: reduced resolution; bit 2: mask.
        let subfile = u32::from(level != self.level) | if layer == Layer::Mask { 4 } else { 0 };
        directory.write_tag(Tag::NewSubfileType, subfile)?;
        directory.write_tag(Tag::ImageWidth, width as u32)?;
        directory.write_tag(Tag::ImageLength, height as u32)?;
        directory.write_tag(Tag::TileWidth, TILE_PX as u32)?;
        directory.write_tag(Tag::TileLength, TILE_PX as u32)?;
        // Adobe deflate 8, JPEG 7; RGB 2, YCbCr 6, transparency mask 4.
        let (samples, bits, compression, photometric) = match layer {
            Layer::Rgba => (4_u16, 8_u16, 8_u16, 2_u16),
            Layer::Jpeg => (3, 8, 7, 6),
            Layer::Mask => (1, 1, 8, 4),
        };
        directory.write_tag(Tag::SamplesPerPixel, samples)?;
        directory.write_tag(Tag::BitsPerSample, vec![bits; samples.into()].as_slice())?;
        directory.write_tag(Tag::Compression, compression)?;
        directory.write_tag(Tag::PhotometricInterpretation, photometric)?;
        directory.write_tag(Tag::PlanarConfiguration, 1_u16)?;
        match layer {
            Layer::Rgba => {
                directory.write_tag(Tag::Predictor, 2_u16)?;
                // Opacity, colours not multiplied by it.
                directory.write_tag(Tag::ExtraSamples, 2_u16)
            }
            Layer::Jpeg => directory.write_tag(Tag::ChromaSubsampling, &[1_u16, 1][..]),
            Layer::Mask => Ok(()),
        }
    }

    /// OGC `GeoTIFF` 1.1: pixel size, place of the corner, keys of a local system in metres.
    fn place_on_earth<K: TiffKind>(
        &self,
        directory: &mut DirectoryEncoder<'_, &mut BufWriter<File>, K>,
    ) -> tiff::TiffResult<()> {
        /// Ends with the separator of `GeoTIFF`'s texts.
        const SYSTEM: &str = "tunnel wall: X = arc length from the crown clockwise looking forward, \
                              Y = minus distance along the axis, metres|";
        /// Model is user-defined, pixels are areas, citation, metres.
        const MODEL: [u16; 4] = [1024, 0, 1, 32767];
        const RASTER: [u16; 4] = [1025, 0, 1, 1];
        const CITATION: [u16; 4] = [1026, 34737, SYSTEM.len() as u16, 0];
        const METRES: [u16; 4] = [3076, 0, 1, 9001];
        let grid = &self.wall.grid;
        let pixel_m = self.wall.mm_per_px(self.level) / 1000.0;
        let keys = [[1, 1, 1, 4], MODEL, RASTER, CITATION, METRES].concat();
        directory.write_tag(Tag::Software, even(concat!("adit ", env!("CARGO_PKG_VERSION"))).as_str())?;
        directory.write_tag(Tag::ModelPixelScaleTag, &[pixel_m, pixel_m, 0.0][..])?;
        directory.write_tag(Tag::ModelTiepointTag, &[0.0, 0.0, 0.0, grid.s0_m, -grid.x0_m, 0.0][..])?;
        directory.write_tag(Tag::GeoKeyDirectoryTag, keys.as_slice())?;
        directory.write_tag(Tag::GeoAsciiParamsTag, even(SYSTEM).as_str())
    }
}

/// A text that takes an even number of bytes with the zero behind it.
fn even(text: &str) -> String {
    let padding = if text.len().is_multiple_of(2) { " " } else { "" };
    format!("{text}{padding}")
}

fn deflate(bytes: &[u8]) -> std::io::Result<Vec<u8>> {
    let mut encoder = ZlibEncoder::new(Vec::new(), Effort::default());
    encoder.write_all(bytes)?;
    encoder.finish()
}

/// Differences to the pixel on the left: TIFF 6.0, section 14.
fn predicted(tile: &Rgba8) -> Vec<u8> {
    let mut out = tile.data.clone();
    for (row, original) in out.chunks_exact_mut(tile.width * 4).zip(tile.data.chunks_exact(tile.width * 4)) {
        for (value, left) in row[4..].iter_mut().zip(original) {
            *value = value.wrapping_sub(*left);
        }
    }
    out
}

/// Side of the blocks that JPEG transforms.
const JPEG_BLOCK_PX: usize = 8;

/// Colours alone; in blocks that were seen in part the unseen pixels get the mean of the others: an edge to black would
/// ripple over them.
fn without_edges(tile: &Rgba8) -> Vec<u8> {
    let mut rgb: Vec<u8> = tile.data.chunks_exact(4).flat_map(|pixel| [pixel[0], pixel[1], pixel[2]]).collect();
    for block in 0..tile.width / JPEG_BLOCK_PX * (tile.height / JPEG_BLOCK_PX) {
        let (row, column) = (block / (tile.width / JPEG_BLOCK_PX), block % (tile.width / JPEG_BLOCK_PX));
        let corner = (row * tile.width + column) * JPEG_BLOCK_PX;
        let places = (0..JPEG_BLOCK_PX.pow(2)).map(|at| corner + at / JPEG_BLOCK_PX * tile.width + at % JPEG_BLOCK_PX);
        let (seen, unseen): (Vec<usize>, Vec<usize>) = places.partition(|&place| tile.data[place * 4 + 3] > 0);
        if seen.is_empty() {
            continue;
        }
        for channel in 0..3 {
            let sum: usize = seen.iter().map(|place| usize::from(rgb[place * 3 + channel])).sum();
            for place in &unseen {
                rgb[place * 3 + channel] = (sum / seen.len()) as u8;
            }
        }
    }
    rgb
}

/// One bit per pixel, the highest first; 1 where a photo saw the wall.
fn mask(tile: &Rgba8) -> Vec<u8> {
    let seen = |pixels: &[u8]| {
        let bits = pixels.chunks_exact(4).enumerate().map(|(at, pixel)| u8::from(pixel[3] >= 128) << (7 - at));
        bits.sum()
    };
    tile.data.chunks_exact(8 * 4).map(seen).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_predictor_is_undone_by_summing_up() {
        let tile = Rgba8 { width: 3, height: 1, data: vec![10, 20, 30, 255, 5, 25, 30, 255, 0, 255, 31, 0] };
        let mut found = predicted(&tile);
        for at in 4..found.len() {
            found[at] = found[at].wrapping_add(found[at - 4]);
        }
        assert_eq!(found, tile.data);
    }

    #[test]
    fn unseen_pixels_beside_seen_ones_take_their_colour() {
        let mut tile = Rgba8::new(16, 8);
        for row in 0..8 {
            tile.set(row % 2, row, [100 + 20 * (row % 2) as u8, 50, 7, 255]);
        }
        let rgb = without_edges(&tile);
        assert_eq!((&rgb[..3], &rgb[15..18]), (&[100, 50, 7][..], &[110, 50, 7][..]));
        assert_eq!(rgb[8 * 3..16 * 3], [0; 24]);
    }

    #[test]
    fn the_mask_holds_a_bit_per_pixel() {
        let mut tile = Rgba8::new(8, 2);
        tile.set(0, 0, [0, 0, 0, 255]);
        tile.set(6, 1, [0, 0, 0, 128]);
        tile.set(7, 1, [0, 0, 0, 127]);
        assert_eq!(mask(&tile), [0b1000_0000, 0b0000_0010]);
    }
}
