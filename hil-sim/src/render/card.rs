//! The camera's memory card: names as a `GoPro` gives them, JPEG files with EXIF.
//!
//! Names: `GOPRnnnn.JPG`, nnnn from 0001 to 9999, in `DCIM/1mmGOPRO`; after 9999 the folder steps and the number
//! starts again at 0001.

use std::path::{Path, PathBuf};

use jpeg_encoder::{ColorType, Encoder, SamplingFactor};

use super::exif::{ExifTime, exif_block};
use super::photo::RgbImage;
use super::{RenderError, RenderedPhoto};

/// Photos per folder.
const PHOTOS_PER_FOLDER: u32 = 9999;

/// Where a photo lies on the card.
#[derive(Clone, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct CardPlace {
    /// `100GOPRO` and so on.
    pub folder: String,
    /// `GOPR0001.JPG` and so on.
    pub name: String,
}

impl CardPlace {
    /// Place of the photo taken `index` photos (from 0) after the one with the number `first_number` (1 to 9999).
    pub fn new(first_number: u32, index: u32) -> Self {
        let place = first_number.saturating_sub(1) + index;
        Self {
            folder: format!("{}GOPRO", 100 + place / PHOTOS_PER_FOLDER),
            name: format!("GOPR{:04}.JPG", place % PHOTOS_PER_FOLDER + 1),
        }
    }

    /// `DCIM/<folder>/<name>` below the card's root.
    pub fn path_on(&self, card: &Path) -> PathBuf {
        card.join("DCIM").join(&self.folder).join(&self.name)
    }
}

/// Encodes a photo as the camera does: 4:2:0, EXIF, no thumbnail.
///
/// # Errors
/// [`RenderError::TooLarge`] beyond 65535 pixels either way, [`RenderError::Jpeg`] if encoding fails.
pub fn encode_photo(image: &RgbImage, quality: u8, exposure_s: f64, taken: ExifTime) -> Result<Vec<u8>, RenderError> {
    let (width, height) = jpeg_size(image.width, image.height)?;
    let mut bytes = Vec::with_capacity(image.data.len() / 4);
    let mut encoder = Encoder::new(&mut bytes, quality);
    encoder.set_sampling_factor(SamplingFactor::R_4_2_0);
    encoder.add_exif_metadata(&exif_block(u32::from(width), u32::from(height), exposure_s, taken))?;
    encoder.encode(&image.data, width, height, ColorType::Rgb)?;
    Ok(bytes)
}

/// Writes a photo to the card and returns its bytes' number; makes folders as needed.
///
/// # Errors
/// Those of [`encode_photo`], and [`RenderError::Write`].
pub fn write_photo(
    card: &Path,
    place: &CardPlace,
    photo: &RenderedPhoto,
    quality: u8,
    exposure_s: f64,
    taken: ExifTime,
) -> Result<usize, RenderError> {
    let bytes = encode_photo(&photo.image, quality, exposure_s, taken)?;
    write_file(&place.path_on(card), &bytes)?;
    Ok(bytes.len())
}

/// Writes a photo's mask as `<photo name>.png` into `folder` (0 = ignore), if the vehicle is in view.
///
/// # Errors
/// [`RenderError::Png`], [`RenderError::Write`].
pub fn write_mask(folder: &Path, place: &CardPlace, photo: &RenderedPhoto) -> Result<(), RenderError> {
    let Some(mask) = &photo.mask else { return Ok(()) };
    let mut bytes = Vec::new();
    let mut encoder = png::Encoder::new(&mut bytes, photo.image.width as u32, photo.image.height as u32);
    encoder.set_color(png::ColorType::Grayscale);
    encoder.set_depth(png::BitDepth::Eight);
    let mut writer = encoder.write_header()?;
    writer.write_image_data(mask)?;
    writer.finish()?;
    write_file(&folder.join(format!("{}.png", place.name)), &bytes)
}

pub(super) fn jpeg_size(width_px: usize, height_px: usize) -> Result<(u16, u16), RenderError> {
    let too_large = |_| RenderError::TooLarge { width_px, height_px };
    Ok((u16::try_from(width_px).map_err(too_large)?, u16::try_from(height_px).map_err(too_large)?))
}

pub(crate) fn write_file(file: &Path, bytes: &[u8]) -> Result<(), RenderError> {
    let name = |source| RenderError::Write { file: file.to_path_buf(), source };
    if let Some(folder) = file.parent() {
        std::fs::create_dir_all(folder).map_err(name)?;
    }
    std::fs::write(file, bytes).map_err(name)
}

#[cfg(test)]
mod tests {
    use exif::{In, Tag, Value};

    use super::*;

    #[test]
    fn numbers_wrap_and_the_folder_steps() {
        let place = |first, index| {
            let place = CardPlace::new(first, index);
            format!("{}/{}", place.folder, place.name)
        };
        assert_eq!(place(1, 0), "100GOPRO/GOPR0001.JPG");
        assert_eq!(place(9998, 1), "100GOPRO/GOPR9999.JPG");
        assert_eq!(place(9998, 2), "101GOPRO/GOPR0001.JPG");
        assert_eq!(place(9998, 2 + 9999), "102GOPRO/GOPR0001.JPG");
    }

    #[test]
    fn an_independent_reader_finds_the_exif_fields() {
        let image = RgbImage { width: 24, height: 16, data: vec![90; 24 * 16 * 3] };
        let bytes = encode_photo(&image, 92, 1.0 / 240.0, ExifTime(1_526_552_400)).expect("small enough");
        let exif = exif::Reader::new().read_from_container(&mut std::io::Cursor::new(&bytes)).expect("EXIF");
        let text = |tag| match &exif.get_field(tag, In::PRIMARY).expect("present").value {
            Value::Ascii(parts) => String::from_utf8(parts[0].clone()).expect("ASCII"),
            other => panic!("{other:?}"),
        };
        assert_eq!(text(Tag::Make), "GoPro");
        assert_eq!(text(Tag::Model), "HERO4 (simulated)");
        assert_eq!(text(Tag::DateTimeOriginal), "2018:05:17 10:20:00");
        let number = |tag| exif.get_field(tag, In::PRIMARY).and_then(|field| field.value.get_uint(0));
        assert_eq!(number(Tag::PixelXDimension), Some(24));
        assert_eq!(number(Tag::PixelYDimension), Some(16));
        assert_eq!(number(Tag::FocalLengthIn35mmFilm), Some(15));
        let Value::Rational(exposure) = &exif.get_field(Tag::ExposureTime, In::PRIMARY).expect("present").value else {
            panic!("exposure time is a rational")
        };
        assert!((exposure[0].to_f64() - 1.0 / 240.0).abs() < 1e-6);
    }

    #[test]
    fn a_card_that_cannot_be_written_is_named() {
        let folder = tempfile::tempdir().expect("a folder");
        let blocked = folder.path().join("DCIM");
        std::fs::write(&blocked, "a file in the way").expect("writable");
        let photo =
            RenderedPhoto { image: RgbImage { width: 8, height: 8, data: vec![0; 192] }, mask: None, gains: [1.0; 3] };
        let error = write_photo(folder.path(), &CardPlace::new(1, 0), &photo, 92, 0.01, ExifTime(0));
        assert!(error.expect_err("blocked").to_string().contains("GOPR0001.JPG"));
    }
}
