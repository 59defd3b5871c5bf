//! Photos from disk: a cheap look at size and completeness, and the pixels.
//!
//! A truncated JPEG decodes to a picture whose lower part is grey, and matching on grey is silently wrong. So every
//! photo must end with its end-of-image marker, and the decoder runs in its strict mode, in which damage inside the
//! picture is an error too.

use std::fs::{self, File};
use std::io::{self, BufReader, Cursor, Read, Seek, SeekFrom};
use std::path::Path;

use zune_jpeg::JpegDecoder;
use zune_jpeg::zune_core::colorspace::ColorSpace;
use zune_jpeg::zune_core::options::DecoderOptions;

use super::{PhotoError, Size};
use crate::raster::{Grey, Luma, Raster, Rgb8};

/// The end-of-image marker is looked for in so many bytes before a whole file is searched.
const TAIL_BYTES: u64 = 64 * 1024;

/// The first markers of a JPEG up to its picture data.
struct Headers {
    size: Option<Size>,
    /// Offset of the first byte after the start-of-scan marker; `None` if the file ends before.
    scan_offset: Option<u64>,
}

/// Returns a photo's size after checking that it is a JPEG and is complete. Reads the headers and the end only.
///
/// # Errors
/// [`PhotoError`] if the file cannot be read, is no JPEG or is truncated.
pub fn probe(path: &Path) -> Result<Size, PhotoError> {
    let io_error = |source| PhotoError::Io { path: path.to_owned(), source };
    let mut file = BufReader::new(File::open(path).map_err(io_error)?);
    let length_bytes = file.seek(SeekFrom::End(0)).map_err(io_error)?;
    file.rewind().map_err(io_error)?;
    let headers = read_headers(&mut file, path)?;
    let truncated = || PhotoError::Truncated { path: path.to_owned(), length_bytes };
    let scan_offset = headers.scan_offset.ok_or_else(truncated)?;
    let size = headers.size.ok_or_else(|| damaged(path, "no frame header before the picture data"))?;
    for start in [scan_offset.max(length_bytes.saturating_sub(TAIL_BYTES)), scan_offset] {
        file.seek(SeekFrom::Start(start)).map_err(io_error)?;
        let mut tail = Vec::new();
        file.read_to_end(&mut tail).map_err(io_error)?;
        if has_end_marker(&tail) {
            return Ok(size);
        }
    }
    Err(truncated())
}

/// Decodes a photo to 8-bit RGB.
///
/// # Errors
/// [`PhotoError`] if the file cannot be read, is no JPEG, is truncated or damaged, or has not the `expected` size.
pub fn decode_rgb(path: &Path, expected: Size) -> Result<Rgb8, PhotoError> {
    let data = decode(path, expected, ColorSpace::RGB)?;
    Ok(Raster { width: expected.width_px as usize, height: expected.height_px as usize, data })
}

/// Decodes a photo's luma (full range, 0..=255), without spending time on its colours.
///
/// # Errors
/// As [`decode_rgb`].
pub fn decode_luma(path: &Path, expected: Size) -> Result<Luma, PhotoError> {
    let data = decode(path, expected, ColorSpace::Luma)?;
    Ok(Raster { width: expected.width_px as usize, height: expected.height_px as usize, data })
}

/// Decodes a photo's luma as floating point, 0..=255.
///
/// # Errors
/// As [`decode_rgb`].
pub fn decode_grey(path: &Path, expected: Size) -> Result<Grey, PhotoError> {
    let luma = decode_luma(path, expected)?;
    Ok(Raster { width: luma.width, height: luma.height, data: luma.data.into_iter().map(f32::from).collect() })
}

fn decode(path: &Path, expected: Size, colours: ColorSpace) -> Result<Vec<u8>, PhotoError> {
    let bytes = fs::read(path).map_err(|source| PhotoError::Io { path: path.to_owned(), source })?;
    let headers = read_headers(&mut Cursor::new(&bytes), path)?;
    let truncated = || PhotoError::Truncated { path: path.to_owned(), length_bytes: bytes.len() as u64 };
    let scan_offset = headers.scan_offset.ok_or_else(truncated)? as usize;
    if !bytes.get(scan_offset..).is_some_and(has_end_marker) {
        return Err(truncated());
    }
    let found = headers.size.ok_or_else(|| damaged(path, "no frame header before the picture data"))?;
    if found != expected {
        return Err(PhotoError::WrongSize { path: path.to_owned(), found, expected });
    }
    let options = DecoderOptions::new_fast().jpeg_set_out_colorspace(colours);
    let pixels = match decode_with(&bytes, options.set_strict_mode(true)) {
        // Stray bytes between two headers harm nothing: some cameras pad there.
        Err(reason) if reason.contains("Extra bytes between headers") => {
            decode_with(&bytes, options.set_strict_mode(false))
        }
        decoded => decoded,
    }
    .map_err(|reason| damaged(path, &reason))?;
    let samples = expected.width_px as usize * expected.height_px as usize * colours.num_components();
    if pixels.len() != samples {
        return Err(damaged(path, &format!("the decoder gave {} samples, expected {samples}", pixels.len())));
    }
    Ok(pixels)
}

fn decode_with(bytes: &[u8], options: DecoderOptions) -> Result<Vec<u8>, String> {
    JpegDecoder::new_with_options(Cursor::new(bytes), options).decode().map_err(|error| format!("{error:?}"))
}

fn damaged(path: &Path, reason: &str) -> PhotoError {
    PhotoError::Damaged { path: path.to_owned(), reason: reason.to_owned() }
}

/// Byte stuffing keeps ff d9 out of picture data, so after the start of the scan it can only be the real marker.
fn has_end_marker(picture_data: &[u8]) -> bool {
    picture_data.windows(2).rev().any(|pair| pair == [0xff, 0xd9])
}

/// Walks the marker segments up to the first start of scan.
fn read_headers(reader: &mut (impl Read + Seek), path: &Path) -> Result<Headers, PhotoError> {
    let mut start = Vec::new();
    let io_error = |source| PhotoError::Io { path: path.to_owned(), source };
    reader.take(2).read_to_end(&mut start).map_err(io_error)?;
    if start != [0xff, 0xd8] {
        return Err(PhotoError::NotJpeg { path: path.to_owned(), found: start });
    }
    let mut headers = Headers { size: None, scan_offset: None };
    match walk_segments(reader, &mut headers) {
        Err(error) if error.kind() != io::ErrorKind::UnexpectedEof => Err(io_error(error)),
        _ => Ok(headers),
    }
}

fn walk_segments(reader: &mut (impl Read + Seek), headers: &mut Headers) -> io::Result<()> {
    loop {
        while read_byte(reader)? != 0xff {}
        let mut marker = read_byte(reader)?;
        while marker == 0xff {
            marker = read_byte(reader)?;
        }
        if matches!(marker, 0x00 | 0x01 | 0xd0..=0xd8) {
            continue;
        }
        if marker == 0xda {
            headers.scan_offset = Some(reader.stream_position()?);
            return Ok(());
        }
        let mut length = [0; 2];
        reader.read_exact(&mut length)?;
        let mut rest_bytes = i64::from(u16::from_be_bytes(length)) - 2;
        // All start-of-frame markers; c4, c8 and cc are tables and extensions.
        if matches!(marker, 0xc0..=0xcf) && !matches!(marker, 0xc4 | 0xc8 | 0xcc) {
            let mut frame = [0; 5];
            reader.read_exact(&mut frame)?;
            rest_bytes -= 5;
            let [_, h1, h0, w1, w0] = frame;
            headers.size = Some(Size {
                width_px: u32::from(u16::from_be_bytes([w1, w0])),
                height_px: u32::from(u16::from_be_bytes([h1, h0])),
            });
        }
        reader.seek(SeekFrom::Current(rest_bytes.max(0)))?;
    }
}

fn read_byte(reader: &mut impl Read) -> io::Result<u8> {
    let mut byte = [0];
    reader.read_exact(&mut byte)?;
    Ok(byte[0])
}

#[cfg(test)]
mod tests {
    use super::*;

    const SIZE: Size = Size { width_px: 96, height_px: 64 };

    fn photo_bytes() -> Vec<u8> {
        let pixels: Vec<u8> = (0..96 * 64).flat_map(|i: u32| [(i % 251) as u8, (i / 96) as u8, 90]).collect();
        let mut bytes = Vec::new();
        jpeg_encoder::Encoder::new(&mut bytes, 90).encode(&pixels, 96, 64, jpeg_encoder::ColorType::Rgb).unwrap();
        bytes
    }

    fn on_disk(bytes: &[u8]) -> (tempfile::TempDir, std::path::PathBuf) {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("GOPR0001.JPG");
        fs::write(&path, bytes).unwrap();
        (folder, path)
    }

    #[test]
    fn a_whole_photo_is_probed_and_decoded() {
        let (_folder, path) = on_disk(&photo_bytes());
        assert_eq!(probe(&path).unwrap(), SIZE);
        let rgb = decode_rgb(&path, SIZE).unwrap();
        let luma = decode_luma(&path, SIZE).unwrap();
        let [red, green, blue] = rgb.at(40, 20).map(f32::from);
        let expected = 0.299 * red + 0.587 * green + 0.114 * blue;
        assert!((f32::from(luma.at(40, 20)[0]) - expected).abs() < 3.0);
        assert_eq!(decode_grey(&path, SIZE).unwrap().at(40, 20), [f32::from(luma.at(40, 20)[0])]);
    }

    #[test]
    fn a_photo_cut_anywhere_is_truncated_for_both_probe_and_decoder() {
        let bytes = photo_bytes();
        for length in [3, 30, 200, bytes.len() / 2, bytes.len() - 100, bytes.len() - 2, bytes.len() - 1] {
            let (_folder, path) = on_disk(&bytes[..length]);
            assert!(matches!(probe(&path), Err(PhotoError::Truncated { .. })), "probe, cut at {length}");
            assert!(matches!(decode_rgb(&path, SIZE), Err(PhotoError::Truncated { .. })), "decode, cut at {length}");
        }
    }

    #[test]
    fn bytes_after_the_end_marker_do_no_harm() {
        let mut bytes = photo_bytes();
        bytes.extend(std::iter::repeat_n(0, 200_000));
        let (_folder, path) = on_disk(&bytes);
        assert_eq!(probe(&path).unwrap(), SIZE);
        assert!(decode_luma(&path, SIZE).is_ok());
    }

    #[test]
    fn a_wrong_size_names_both_sizes() {
        let (_folder, path) = on_disk(&photo_bytes());
        let message = decode_rgb(&path, Size { width_px: 100, height_px: 75 }).unwrap_err().to_string();
        assert!(message.contains("96 x 64") && message.contains("100 x 75"), "{message}");
    }

    #[test]
    fn a_text_file_is_not_a_jpeg() {
        let (_folder, path) = on_disk(b"not a photo");
        assert!(matches!(probe(&path), Err(PhotoError::NotJpeg { .. })));
        let (_folder, path) = on_disk(b"");
        assert!(matches!(probe(&path), Err(PhotoError::NotJpeg { .. })));
    }
}
