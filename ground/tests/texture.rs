//! The panorama of a rendered sample at its true poses against the wall as painted.

#[path = "support/painted.rs"]
mod painted;
#[expect(dead_code, reason = "shared with the tests of the matching")]
mod support;
#[path = "support/textured.rs"]
mod textured;

use std::fs::{self, File};
use std::path::Path;

use adit_ground::model::{self, ModelOptions};
use adit_ground::poses::{PoseStatus, Reconstruction};
use adit_ground::surface::{self, SurfaceOptions, SurfaceStore};
use adit_ground::survey::{Size, Survey, load_mask};
use adit_ground::texture::{self, PanoramaGrid, PixelBox, TextureError, TextureOptions, TextureReport, TileReader};
use nalgebra::Point3;
use textured::{flat, load_textured};
use tiff::decoder::{Decoder, DecodingResult};
use zune_jpeg::JpegDecoder;
use zune_jpeg::zune_core::bytestream::ZCursor;

/// Coarse, so that the tests are quick.
const MM_PER_PX: f64 = 12.0;

fn options() -> TextureOptions {
    TextureOptions { mm_per_px: Some(MM_PER_PX), ..TextureOptions::default() }
}

/// The painted wall, averaged onto the panorama's grid: green, or nothing where it was not painted.
fn painted(folder: &Path, grid: &PanoramaGrid) -> Vec<Option<f64>> {
    let about: serde_json::Value =
        serde_json::from_str(&fs::read_to_string(folder.join("truth/texture.json")).unwrap()).unwrap();
    let number = |key: &str| about[key].as_f64().unwrap();
    let (texel_m, x0_m) = (number("mm_per_px") / 1000.0, number("x0_m"));
    let bytes = fs::read(folder.join("truth/texture.jpg")).unwrap();
    let mut decoder = JpegDecoder::new(ZCursor::new(bytes));
    let rgb = decoder.decode().unwrap();
    let (width, height) = decoder.dimensions().unwrap();
    let mut sums = vec![(0.0, 0); grid.width_px * grid.height_px];
    for row in 0..height {
        let v = (x0_m + (row as f64 + 0.5) * texel_m - grid.x0_m) / grid.texel_m();
        for column in (0..width).filter(|_| v >= 0.0 && (v as usize) < grid.height_px) {
            let u = (((column as f64 + 0.5) * texel_m / grid.texel_m()) as usize).min(grid.width_px - 1);
            let (sum, count) = &mut sums[v as usize * grid.width_px + u];
            *sum += f64::from(rgb[(row * width + column) * 3 + 1]);
            *count += 1;
        }
    }
    // Cells that the painting covers in part only do not count.
    let whole = (MM_PER_PX / 2.0).powi(2) * 0.7;
    sums.into_iter().map(|(sum, count)| (f64::from(count) > whole).then(|| sum / f64::from(count))).collect()
}

/// Correlation of the panorama, shifted by (columns, rows), with the painted wall.
fn correlation(found: &[Option<f64>], painted: &[Option<f64>], width: usize, shift: (i64, i64)) -> f64 {
    let rows = (found.len() / width) as i64;
    let pairs: Vec<(f64, f64)> = (0..found.len())
        .filter_map(|at| {
            let row = (at / width) as i64 + shift.1;
            let column = ((at % width) as i64 + shift.0).rem_euclid(width as i64);
            let other = (0..rows).contains(&row).then(|| painted[row as usize * width + column as usize])??;
            Some((found[at]?, other))
        })
        .collect();
    let count = pairs.len() as f64;
    let (mean_a, mean_b) = pairs.iter().fold((0.0, 0.0), |(a, b), pair| (a + pair.0 / count, b + pair.1 / count));
    let (mut ab, mut aa, mut bb) = (0.0, 0.0, 0.0);
    for (a, b) in pairs {
        ab += (a - mean_a) * (b - mean_b);
        aa += (a - mean_a).powi(2);
        bb += (b - mean_b).powi(2);
    }
    ab / (aa * bb).sqrt()
}

fn panorama(out: &Path, report: &TextureReport) -> Vec<Option<f64>> {
    let grid = report.grid;
    let reader = TileReader::new(&out.join("panorama/tiles"), grid.width_px, grid.height_px);
    let area = PixelBox { column: 0, row: 0, width: grid.width_px, height: grid.height_px };
    let picture = reader.read(reader.last_level(), area).unwrap();
    picture.data.chunks_exact(4).map(|pixel| (pixel[3] == 255).then(|| f64::from(pixel[1]))).collect()
}

#[test]
fn the_panorama_of_an_underpass_lies_where_the_wall_was_painted() {
    let Some((survey, reconstruction)) = load_textured("underpass-spiral", 50) else { return };
    let out = tempfile::tempdir().unwrap();
    let report =
        texture::build(&survey, &reconstruction, &flat(&reconstruction), &options(), out.path(), &|_| ()).unwrap();
    assert!(report.losses.is_empty(), "{:?}", report.losses);
    assert!(report.coloured_area_m2 > 0.99 * report.coverage.seen_area_m2, "{report:?}");
    assert!(report.coverage.seen_share[0] > 0.999);

    let found = panorama(out.path(), &report);
    let painted = painted(&survey.folder, &report.grid);
    let width = report.grid.width_px;
    let here = correlation(&found, &painted, width, (0, 0));
    assert!(here > 0.9, "{here}");
    for shift in [(1, 0), (-1, 0), (0, 1), (0, -1)] {
        let there = correlation(&found, &painted, width, shift);
        assert!(there < here, "shifted by {shift:?} texels: {there}, not shifted: {here}");
    }

    let made = model::write(flat(&reconstruction), &report.grid, &ModelOptions::default(), out.path()).unwrap();
    assert!(made.points > 10_000 && made.chunks > 0);
    let sheets: Vec<&str> = report.sheets.iter().map(|sheet| sheet.part.as_str()).collect();
    assert_eq!(sheets, ["right-wall", "floor", "left-wall"]);
    let files = ["panorama/panorama.png", "panorama/panorama.json", "panorama/tiles/panorama.dzi", "sheets/floor.png"];
    for file in files.into_iter().chain(["coverage.json", "model.glb", "model.obj", "model.mtl", "points.ply"]) {
        assert!(out.path().join(file).is_file(), "{file}");
    }
}

/// Tells for every texel of a round tunnel whether some photo shows its centre between four pixels that are all in the photo
/// and not masked.
fn seen_texels(survey: &Survey, reconstruction: &Reconstruction, grid: &PanoramaGrid) -> Vec<bool> {
    let camera = reconstruction.camera;
    let radius_m = grid.perimeter_m / std::f64::consts::TAU;
    let size = Size { width_px: camera.width_px, height_px: camera.height_px };
    let mut seen = vec![false; grid.width_px * grid.height_px];
    for (photo, pose) in survey.photos.iter().zip(&reconstruction.poses) {
        let mask = photo.mask.as_ref().map(|path| load_mask(path, size).unwrap());
        let cam_from_tunnel = pose.tunnel_from_cam.inverse();
        let shows = |u: f64, v: f64| {
            let inside = u >= 0.0 && v >= 0.0 && u < f64::from(size.width_px) && v < f64::from(size.height_px);
            inside && mask.as_ref().is_none_or(|mask| mask.at(u as usize, v as usize) != [0])
        };
        for (at, seen) in seen.iter_mut().enumerate() {
            let angle = grid.s_m((at % grid.width_px) as f64 + 0.5) / radius_m;
            let x_m = grid.x_m((at / grid.width_px) as f64 + 0.5);
            let point = Point3::new(x_m, radius_m * angle.sin(), -radius_m * angle.cos());
            let Some(pixel) = camera.project(&(cam_from_tunnel * point).coords) else { continue };
            let corners = [(-0.5, -0.5), (0.5, -0.5), (-0.5, 0.5), (0.5, 0.5)];
            *seen |= corners.iter().all(|(du, dv)| shows(pixel.x + du, pixel.y + dv));
        }
    }
    seen
}

#[test]
fn every_texel_that_a_photo_shows_is_coloured() {
    let Some((survey, reconstruction)) = load_textured("cylinder-brick-spiral", 12) else { return };
    let out = tempfile::tempdir().unwrap();
    let report =
        texture::build(&survey, &reconstruction, &flat(&reconstruction), &options(), out.path(), &|_| ()).unwrap();
    let found = panorama(out.path(), &report);
    let seen = seen_texels(&survey, &reconstruction, &report.grid);
    let count = seen.iter().filter(|seen| **seen).count();
    let missed: Vec<usize> = (0..found.len()).filter(|&at| seen[at] && found[at].is_none()).collect();
    assert!(count > 200_000, "{count} texels seen");
    assert!(missed.is_empty(), "{} of {count} not coloured, such as {:?}", missed.len(), missed.first());
}

#[test]
fn a_damaged_photo_is_named_and_the_others_are_used() {
    let Some((mut survey, reconstruction)) = load_textured("cylinder-concrete-spiral", 6) else { return };
    let out = tempfile::tempdir().unwrap();
    let bytes = fs::read(&survey.photos[2].path).unwrap();
    let torn = out.path().join("torn.jpg");
    fs::write(&torn, &bytes[..bytes.len() / 2]).unwrap();
    survey.photos[2].path = torn;
    let report =
        texture::build(&survey, &reconstruction, &flat(&reconstruction), &options(), out.path(), &|_| ()).unwrap();
    assert_eq!(report.photos_used, 5);
    assert_eq!(report.losses.len(), 1);
    assert_eq!(report.losses[0].what, survey.photos[2].name);
}

#[test]
fn a_small_cache_gives_the_same_panorama() {
    let Some((survey, reconstruction)) = load_textured("cylinder-brick-spiral", 12) else { return };
    let out = tempfile::tempdir().unwrap();
    let build = |name: &str, cache_bytes: usize| {
        let out = out.path().join(name);
        let options = TextureOptions { cache_bytes, ..options() };
        let report = texture::build(&survey, &reconstruction, &flat(&reconstruction), &options, &out, &|_| ()).unwrap();
        fs::read(out.join("panorama").join(report.picture.unwrap())).unwrap()
    };
    assert!(build("large", usize::MAX) == build("small", 1));
}

#[test]
fn what_cannot_be_written_or_makes_no_sense_is_said() {
    let Some((survey, reconstruction)) = load_textured("cylinder-concrete-spiral", 2) else { return };
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("file");
    fs::write(&file, "").unwrap();
    let error =
        texture::build(&survey, &reconstruction, &flat(&reconstruction), &options(), &file.join("out"), &|_| ())
            .unwrap_err();
    assert!(error.to_string().contains("file/out"), "{error}");

    let fine = TextureOptions { mm_per_px: Some(0.001), ..TextureOptions::default() };
    let error =
        texture::build(&survey, &reconstruction, &flat(&reconstruction), &fine, folder.path(), &|_| ()).unwrap_err();
    assert!(matches!(error, TextureError::Resolution { .. }), "{error}");
}

/// A sheet's size and, per pixel, its green and opacity.
fn read_sheet(path: &Path) -> (usize, Vec<[u8; 2]>) {
    let reader = png::Decoder::new(std::io::BufReader::new(fs::File::open(path).unwrap()));
    let mut reader = reader.read_info().unwrap();
    let mut data = vec![0; reader.output_buffer_size().unwrap()];
    let info = reader.next_frame(&mut data).unwrap();
    (info.width as usize, data.chunks_exact(4).map(|pixel| [pixel[1], pixel[3]]).collect())
}

#[test]
fn straight_lines_on_the_wall_are_straight_on_the_sheets() {
    let folder = tempfile::tempdir().unwrap();
    let (survey, reconstruction) = painted::painted(folder.path(), false);
    let fine = TextureOptions { mm_per_px: Some(5.0), ..TextureOptions::default() };
    let report =
        texture::build(&survey, &reconstruction, &flat(&reconstruction), &fine, folder.path(), &|_| ()).unwrap();
    assert_eq!(report.sheets.len(), 4);
    let grid = report.grid;
    for (part, line_m) in painted::LINES {
        let sheet = report.sheets.iter().find(|sheet| sheet.part == part).unwrap();
        let (width, pixels) = read_sheet(&folder.path().join("sheets").join(&sheet.file));
        let mut rows = 0;
        for (row, pixels) in pixels.chunks_exact(width).enumerate() {
            let x_m = grid.x_m(row as f64 + 0.5);
            let s_m = line_m + painted::SLOPE * (x_m - painted::MIDDLE_X_M);
            let expected = (s_m - grid.s_m(sheet.column0 as f64)) / grid.texel_m();
            // The line is 8 pixels wide.
            let around = expected as i64 - 9..expected as i64 + 10;
            if around.start < 0 || around.end > width as i64 {
                continue;
            }
            let around = around.start as usize..around.end as usize;
            if pixels[around.clone()].iter().any(|[_, opacity]| *opacity == 0) {
                continue;
            }
            let darkness = |column: usize| 180.0 - f64::from(pixels[column][0]).min(180.0);
            let total: f64 = around.clone().map(darkness).sum();
            let middle = around.map(|column| (column as f64 + 0.5) * darkness(column)).sum::<f64>() / total;
            assert!((middle - expected).abs() < 1.0, "{part}, row {row}: {middle}, not {expected}");
            rows += 1;
        }
        assert!(rows > 300, "{part}: {rows} rows");
    }
}

#[test]
fn what_every_mask_hides_stays_transparent_and_is_listed() {
    let folder = tempfile::tempdir().unwrap();
    let (survey, reconstruction) = painted::painted(folder.path(), true);
    let report =
        texture::build(&survey, &reconstruction, &flat(&reconstruction), &options(), folder.path(), &|_| ()).unwrap();
    let found = panorama(folder.path(), &report);
    let at = |s_m: f64, x_m: f64| {
        let texel_m = report.grid.texel_m();
        let row = ((x_m - report.grid.x0_m) / texel_m) as usize;
        found[row * report.grid.width_px + (s_m / texel_m) as usize]
    };
    let [[s_from_m, s_to_m], [x_from_m, x_to_m]] = painted::HIDDEN;
    // The distance map has cells of 4 pixels, 4 cm on the floor.
    for s_m in [s_from_m + 0.02, 6.8, s_to_m - 0.02] {
        for x_m in [x_from_m + 0.02, 0.8, x_to_m - 0.02] {
            assert_eq!(at(s_m, x_m), None, "s = {s_m} m, x = {x_m} m");
        }
    }
    for [s_m, x_m] in [[s_from_m - 0.12, 0.8], [s_to_m + 0.12, 0.8], [6.8, x_from_m - 0.12], [6.8, x_to_m + 0.12]] {
        assert!(at(s_m, x_m).is_some(), "s = {s_m} m, x = {x_m} m");
    }
    let holes = &report.coverage.holes;
    let [hole] = holes.as_slice() else { panic!("one hole, not {holes:?}") };
    assert!((hole.x_from_m - x_from_m).abs() < 0.15 && (hole.x_to_m - x_to_m).abs() < 0.15, "{hole:?}");
    // The floor's middle is at 7 m of 14 m, six o'clock.
    assert!(hole.clock_from < 6.0 && hole.clock_to > 6.0 && hole.clock_to - hole.clock_from < 1.5, "{hole:?}");
}

#[test]
fn a_wall_that_is_its_section_is_measured_flat() {
    let Some((survey, reconstruction)) = load_textured("underpass-spiral", 24) else { return };
    let out = tempfile::tempdir().unwrap();
    let report = surface::build(&survey, &reconstruction, &SurfaceOptions::default(), out.path(), &|_, _| ()).unwrap();
    assert!(report.losses.is_empty() && report.rings.is_empty(), "{report:?}");
    let mut decoder = Decoder::new(File::open(out.path().join("relief.tif")).unwrap()).unwrap();
    let [columns, rows] = report.cells;
    assert_eq!(decoder.dimensions().unwrap(), (columns as u32, rows as u32));
    let DecodingResult::F32(heights) = decoder.read_image().unwrap() else { panic!("not single precision") };
    let mut sizes_m: Vec<f32> = heights.iter().filter(|height| height.is_finite()).map(|h| h.abs()).collect();
    sizes_m.sort_by(f32::total_cmp);
    let known_m2 = sizes_m.len() as f64 * (report.cell_mm * 1e-3).powi(2);
    assert!((known_m2 - report.known_area_m2).abs() < 0.01 && known_m2 > 25.0, "{known_m2} {report:?}");
    let [median_m, usual_m] = [50, 95].map(|percent| sizes_m[sizes_m.len() * percent / 100]);
    // Where views are steep or tiles repeat.
    assert!(median_m < 0.0015 && usual_m < 0.008, "median {median_m} m, 95 % below {usual_m} m: {report:?}");
}

#[test]
fn without_an_adjusted_pose_the_wall_is_its_section() {
    let Some((survey, mut reconstruction)) = load_textured("cylinder-concrete-spiral", 3) else { return };
    reconstruction.poses.iter_mut().for_each(|pose| pose.status = PoseStatus::PriorOnly);
    let out = tempfile::tempdir().unwrap();
    let report = surface::build(&survey, &reconstruction, &SurfaceOptions::default(), out.path(), &|_, _| ()).unwrap();
    assert_eq!((report.photos_used, report.known_area_m2), (0, 0.0));
    let store = SurfaceStore::open(out.path()).unwrap();
    let window = store.window([-2.0, 2.0]).unwrap();
    assert_eq!((window.height_m(3.0, 0.5), window.relief_m(3.0, 0.5)), (0.0, None));
}
