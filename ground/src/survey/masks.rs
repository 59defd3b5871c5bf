//! Masks: PNG files in which black (0) means "ignore this pixel" (COLMAP's convention).

use std::fs::File;
use std::io::BufReader;
use std::path::{Path, PathBuf};

use super::{MaskError, Size};
use crate::raster::{Mask, Raster};

/// Name of the mask that holds for every photo without one of its own.
const COMMON_MASK: &str = "mask.png";

/// Reads a mask; 255 where the photo may be used, 0 where the mask is black. A transparency channel is ignored.
///
/// # Errors
/// [`MaskError`] if the file cannot be read, is no PNG, or has not the `expected` size.
pub fn load_mask(path: &Path, expected: Size) -> Result<Mask, MaskError> {
    let mut decoder = open(path)?;
    decoder.set_transformations(png::Transformations::normalize_to_color8());
    let not_png = |source| MaskError::NotPng { path: path.to_owned(), source };
    let mut reader = decoder.read_info().map_err(not_png)?;
    check_size(path, reader.info(), expected)?;
    let mut samples = vec![0; reader.output_buffer_size().unwrap_or_default()];
    let frame = reader.next_frame(&mut samples).map_err(not_png)?;
    let channels = frame.color_type.samples();
    let colours = match frame.color_type {
        png::ColorType::GrayscaleAlpha | png::ColorType::Rgba => channels - 1,
        _ => channels,
    };
    let shown = |shown: bool| if shown { 255 } else { 0 };
    let data = if channels == 1 {
        // Almost every mask.
        for sample in &mut samples {
            *sample = shown(*sample > 0);
        }
        samples
    } else {
        samples.chunks_exact(channels).map(|pixel| shown(pixel[..colours].iter().any(|&sample| sample > 0))).collect()
    };
    Ok(Raster { width: expected.width_px as usize, height: expected.height_px as usize, data })
}

/// Checks a mask's size without decoding it.
pub(super) fn check_mask(path: &Path, expected: Size) -> Result<(), MaskError> {
    let reader = open(path)?.read_info().map_err(|source| MaskError::NotPng { path: path.to_owned(), source })?;
    check_size(path, reader.info(), expected)
}

fn open(path: &Path) -> Result<png::Decoder<BufReader<File>>, MaskError> {
    let file = File::open(path).map_err(|source| MaskError::Io { path: path.to_owned(), source })?;
    Ok(png::Decoder::new(BufReader::new(file)))
}

fn check_size(path: &Path, info: &png::Info<'_>, expected: Size) -> Result<(), MaskError> {
    let found = Size { width_px: info.width, height_px: info.height };
    if found == expected { Ok(()) } else { Err(MaskError::WrongSize { path: path.to_owned(), found, expected }) }
}

/// The masks of a survey folder.
pub(super) struct Masks {
    /// `mask.png`.
    common: Option<PathBuf>,
    /// Names relative to `masks/`, folders joined by `/`, with their paths.
    own: Vec<(String, PathBuf)>,
}

impl Masks {
    /// Takes the PNG files below `masks/` apart into the common one and those of single photos.
    pub(super) fn new(files: Vec<(String, PathBuf)>) -> Self {
        let (common, own): (Vec<_>, Vec<_>) =
            files.into_iter().partition(|(name, _)| name.eq_ignore_ascii_case(COMMON_MASK));
        Self { common: common.into_iter().next().map(|(_, path)| path), own }
    }

    /// Returns the mask of a photo: its own, else the common one. Letter case does not matter.
    pub(super) fn of(&self, photo: &str) -> Option<&Path> {
        let file_name = photo.rsplit('/').next().unwrap_or(photo);
        let own = self
            .own
            .iter()
            .find(|(name, _)| is_mask_of(name, photo))
            .or_else(|| self.own.iter().find(|(name, _)| is_mask_of(name, file_name)));
        own.map(|(_, path)| path).or(self.common.as_ref()).map(PathBuf::as_path)
    }

    /// Returns the names of the masks that belong to none of `photos`.
    pub(super) fn orphans(&self, photos: &[&str]) -> Vec<&str> {
        let owned = |name: &str| {
            photos
                .iter()
                .any(|photo| is_mask_of(name, photo) || is_mask_of(name, photo.rsplit('/').next().unwrap_or(photo)))
        };
        self.own.iter().map(|(name, _)| name.as_str()).filter(|name| !owned(name)).collect()
    }
}

fn is_mask_of(mask: &str, photo: &str) -> bool {
    mask.len() == photo.len() + 4
        && mask.is_char_boundary(photo.len())
        && mask[..photo.len()].eq_ignore_ascii_case(photo)
        && mask[photo.len()..].eq_ignore_ascii_case(".png")
}

#[cfg(test)]
mod tests {
    use super::*;

    fn write_png(path: &Path, width: u32, height: u32, colour: png::ColorType, samples: &[u8]) {
        let mut encoder = png::Encoder::new(File::create(path).unwrap(), width, height);
        encoder.set_color(colour);
        encoder.write_header().unwrap().write_image_data(samples).unwrap();
    }

    #[test]
    fn black_is_ignore_and_any_other_grey_is_use() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("mask.png");
        write_png(&path, 3, 1, png::ColorType::Grayscale, &[0, 1, 255]);
        let mask = load_mask(&path, Size { width_px: 3, height_px: 1 }).unwrap();
        assert_eq!(mask.data, [0, 255, 255]);
    }

    #[test]
    fn an_opaque_black_pixel_with_alpha_is_ignored() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("mask.png");
        write_png(&path, 2, 1, png::ColorType::Rgba, &[0, 0, 0, 255, 0, 9, 0, 0]);
        assert_eq!(load_mask(&path, Size { width_px: 2, height_px: 1 }).unwrap().data, [0, 255]);
    }

    #[test]
    fn a_mask_of_the_wrong_size_names_both_sizes() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("mask.png");
        write_png(&path, 3, 1, png::ColorType::Grayscale, &[0, 1, 255]);
        let message = check_mask(&path, Size { width_px: 1000, height_px: 750 }).unwrap_err().to_string();
        assert!(
            message.contains("3 x 1") && message.contains("1000 x 750") && message.contains("mask.png"),
            "{message}"
        );
    }

    #[test]
    fn a_photo_s_own_mask_goes_before_the_common_one() {
        let file = |name: &str| (name.to_owned(), PathBuf::from(name));
        let masks = Masks::new(vec![
            file("mask.png"),
            file("GOPR0001.jpg.PNG"),
            file("100GOPRO/GOPR0002.JPG.png"),
            file("X.png"),
        ]);
        assert_eq!(masks.of("100GOPRO/GOPR0001.JPG"), Some(Path::new("GOPR0001.jpg.PNG")));
        assert_eq!(masks.of("100GOPRO/GOPR0002.JPG"), Some(Path::new("100GOPRO/GOPR0002.JPG.png")));
        assert_eq!(masks.of("GOPR0003.JPG"), Some(Path::new("mask.png")));
        assert_eq!(masks.orphans(&["GOPR0001.JPG", "100GOPRO/GOPR0002.JPG"]), ["X.png"]);
    }
}
