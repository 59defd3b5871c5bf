//! Speed of the ground's inner loops on the rendered samples. `cargo bench -p adit-ground`.

#[path = "../tests/support/mod.rs"]
mod support;
#[path = "../tests/support/textured.rs"]
mod textured;

mod adjustment;
mod live;

use adit_ground::adjust::{Covariances, adjust};
use adit_ground::features::{OrbOptions, Orientation, SiftOptions, nearest, orb, sift};
use adit_ground::matching::{MatchConfig, match_round};
use adit_ground::raster::{Grey, Luma};
use adit_ground::surface::{self, SurfaceOptions};
use adit_ground::survey::{Size, decode_luma, decode_rgb, load_mask};
use adit_ground::texture::{self, TextureOptions};
use divan::Bencher;
use divan::counter::ItemsCount;
use rayon::prelude::*;

fn main() {
    divan::main();
}

/// Rectifying, filtering and matching twelve photos, every pair that overlaps; divide by the pairs for the cost of one.
#[divan::bench(args = ["wide", "fine"], sample_count = 10)]
fn match_twelve_photos(bencher: Bencher<'_, '_>, stage: &str) {
    let Some(sample) = support::load("cylinder-concrete-spiral", 12) else { return };
    let native_m = MatchConfig::native_m(&sample.profile, &sample.camera);
    let (config, poses) = if stage == "wide" {
        (MatchConfig::wide(native_m), sample.perturbed(0.025, 0.03, 7))
    } else {
        (MatchConfig::fine(native_m), sample.perturbed(0.002, 0.001, 7))
    };
    bencher.bench(|| {
        match_round(&sample.profile, &sample.camera, &poses, sample.photos.as_slice(), &config, &|_| true, &|_| ())
    });
}

/// Laying two photos onto the wall, filtering them and choosing their reference points, and matching the one pair that they make.
#[divan::bench(args = ["wide", "fine"], sample_count = 10)]
fn match_two_photos(bencher: Bencher<'_, '_>, stage: &str) {
    let Some(sample) = support::load("cylinder-concrete-spiral", 2) else { return };
    let native_m = MatchConfig::native_m(&sample.profile, &sample.camera);
    let config = if stage == "wide" { MatchConfig::wide(native_m) } else { MatchConfig::fine(native_m) };
    let poses = sample.perturbed(0.002, 0.001, 7);
    bencher.bench(|| {
        match_round(&sample.profile, &sample.camera, &poses, sample.photos.as_slice(), &config, &|_| true, &|_| ())
    });
}

/// Reading a photo of 1000 x 750 and its mask from disk, as the matching wants them.
#[divan::bench(args = ["photo", "mask"])]
fn read_from_disk(bencher: Bencher<'_, '_>, what: &str) {
    let Some(folder) = support::samples().map(|samples| samples.join("cylinder-concrete-spiral")) else { return };
    let size = Size { width_px: 1000, height_px: 750 };
    if what == "photo" {
        let path = folder.join("photos/GOPR0001.JPG");
        bencher.bench(|| decode_luma(&path, size).expect("a photo"));
    } else {
        let path = folder.join("masks/GOPR0001.JPG.png");
        bencher.bench(|| load_mask(&path, size).expect("a mask"));
    }
}

/// Detecting and describing one photo of 1000 x 750; the count says how many features came of it.
#[divan::bench(args = ["sift", "sift free", "sift native", "orb"], sample_count = 10)]
fn features_of_one_photo(bencher: Bencher<'_, '_>, class: &str) {
    let Some(sample) = support::load("cylinder-brick-spiral", 1) else { return };
    let grey = &grey_of(sample.photos[0].grey());
    let upright = SiftOptions::default();
    let options = match class {
        "sift free" => SiftOptions { orientation: Orientation::Free, ..upright },
        "sift native" => SiftOptions { doubled: false, ..upright },
        _ => upright,
    };
    let count = || match class {
        "orb" => orb(grey, None, &OrbOptions::default()).keypoints.len(),
        _ => sift(grey, None, &options).keypoints.len(),
    };
    bencher.counter(ItemsCount::new(count())).bench(count);
}

/// The photo as the features take it.
fn grey_of(luma: &Luma) -> Grey {
    Grey { width: luma.width, height: luma.height, data: luma.data.iter().map(|&value| f32::from(value)).collect() }
}

/// Two nearest neighbours of every feature of one photo in another; items are comparisons.
#[divan::bench(args = ["sift", "orb"], sample_count = 10)]
fn nearest_neighbours(bencher: Bencher<'_, '_>, class: &str) {
    let Some(sample) = support::load("cylinder-brick-spiral", 2) else { return };
    let photos = sample.photos.iter().map(|photo| grey_of(photo.grey()));
    if class == "orb" {
        let found: Vec<_> = photos.map(|grey| orb(&grey, None, &OrbOptions::default()).descriptors).collect();
        let bencher = bencher.counter(ItemsCount::new(found[0].len() * found[1].len()));
        bencher.bench(|| nearest::<2, _>(&found[0], &found[1]));
    } else {
        let found: Vec<_> = photos.map(|grey| sift(&grey, None, &SiftOptions::default()).descriptors).collect();
        let bencher = bencher.counter(ItemsCount::new(found[0].len() * found[1].len()));
        bencher.bench(|| nearest::<2, _>(&found[0], &found[1]));
    }
}

/// One iteration of the adjustment (order, linearise, eliminate the points, factor, step, new cost) of a spiral with 150 points
/// per photo, each seen by about seven; ten times the photos should take ten times the time. Items are observations.
#[divan::bench(args = [50, 230, 2300], sample_count = 10)]
fn one_adjust_iteration(bencher: Bencher<'_, '_>, photos: usize) {
    let scene = adjustment::Scene::new(photos, 0.0).adjusted();
    let problem = scene.problem();
    bencher.counter(ItemsCount::new(problem.tracks.observations().len())).bench(|| {
        let adjusted = adjust(&problem, &adjustment::WEIGHTS).expect("the priors make the system definite");
        assert_eq!(adjusted.report.iterations, 1, "the scene is at its optimum");
        adjusted
    });
}

/// A whole adjustment from poses that are 2 cm and half a degree off, all stages of the robust loss included; ten times the photos
/// should take ten times the time, iterations included.
#[divan::bench(args = [50, 230, 2300], sample_count = 3)]
fn whole_adjustment(bencher: Bencher<'_, '_>, photos: usize) {
    let scene = adjustment::Scene::new(photos, 1.0);
    let problem = scene.problem();
    bencher.bench(|| adjust(&problem, &adjustment::WEIGHTS).expect("the priors make the system definite"));
}

/// The covariance of every pose, linear too.
#[divan::bench(args = [50, 230, 2300], sample_count = 3)]
fn pose_covariances(bencher: Bencher<'_, '_>, photos: usize) {
    let scene = adjustment::Scene::new(photos, 0.0);
    let problem = scene.problem();
    bencher.bench(|| Covariances::at(&problem, &adjustment::WEIGHTS).expect("every pose is determined"));
}

/// The yardstick of the texture: decoding the same twelve photos once, in parallel as the texture does; items are pixels.
#[divan::bench(sample_count = 10)]
fn decode_twelve_photos(bencher: Bencher<'_, '_>) {
    let Some((survey, _)) = textured::load_textured("cylinder-brick-spiral", 12) else { return };
    let camera = survey.config.camera.camera;
    let size = Size { width_px: camera.width_px, height_px: camera.height_px };
    let pixels = survey.photos.len() * size.width_px as usize * size.height_px as usize;
    let decode = || {
        survey.photos.par_iter().map(|photo| decode_rgb(&photo.path, size).expect("a photo").data.len()).sum::<usize>()
    };
    bencher.counter(ItemsCount::new(pixels)).bench(decode);
}

/// Decoding, exposures, seams and the panorama of twelve photos, files included; items are texels of the panorama or pixels of the
/// photos.
#[divan::bench(args = [(6.0, "texels"), (6.0, "pixels"), (2.0, "texels")], sample_count = 3)]
fn texture_of_twelve_photos(bencher: Bencher<'_, '_>, (mm_per_px, items): (f64, &str)) {
    let Some((survey, reconstruction)) = textured::load_textured("cylinder-brick-spiral", 12) else { return };
    let out = tempfile::tempdir().expect("a folder");
    let options = TextureOptions { mm_per_px: Some(mm_per_px), ..TextureOptions::default() };
    let flat = textured::flat(&reconstruction);
    let build = || texture::build(&survey, &reconstruction, &flat, &options, out.path(), &|_| ()).expect("a panorama");
    let (grid, camera) = (build().grid, survey.config.camera.camera);
    let count = match items {
        "texels" => grid.width_px * grid.height_px,
        _ => survey.photos.len() * camera.width_px as usize * camera.height_px as usize,
    };
    bencher.counter(ItemsCount::new(count)).bench(build);
}

/// The plane sweep over what twelve photos see, decoding and files included; items are cells.
#[divan::bench(sample_count = 3)]
fn surface_cells(bencher: Bencher<'_, '_>) {
    let Some((survey, reconstruction)) = textured::load_textured("cylinder-brick-spiral", 12) else { return };
    let out = tempfile::tempdir().expect("a folder");
    let options = SurfaceOptions::default();
    let build = || surface::build(&survey, &reconstruction, &options, out.path(), &|_, _| ()).expect("a surface");
    let [around, along] = build().cells;
    bencher.counter(ItemsCount::new(around * along)).bench(build);
}

/// What a second of a flood costs the live view: less than a second, or it lags.
#[divan::bench]
fn live_ten_thousand_messages(bencher: Bencher<'_, '_>) {
    let flood = live::flood();
    bencher.counter(ItemsCount::new(flood.len())).with_inputs(live::state).bench_local_values(|mut state| {
        for (now, heard) in &flood {
            state.hear(*now, heard);
        }
        state.show(std::time::Duration::from_secs(1))
    });
}

/// Ten metres of a 3 m pipe in the live view's strip; divide by 125 for a photo, of which there is one a second.
#[divan::bench]
fn live_strip_of_ten_metres(bencher: Bencher<'_, '_>) {
    let tags = live::tags();
    bencher.counter(ItemsCount::new(tags.len())).with_inputs(live::state).bench_local_values(|mut state| {
        for heard in &tags {
            state.hear(std::time::Duration::ZERO, heard);
        }
        state
    });
}
