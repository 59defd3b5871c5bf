//! Both detectors on a synthetic picture that is known at every point, so that any warp of it is exact.

use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

use super::*;
use crate::raster::{Grey, Mask};

const SIZE: usize = 320;

/// Blobs of many sizes and brightnesses, an analytic function of the place.
struct Picture {
    /// x, y, standard deviation, height.
    blobs: Vec<[f64; 4]>,
}

impl Picture {
    fn new(seed: u64) -> Self {
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        let mut draw = |low: f64, high: f64| rng.random_range(low..high);
        let blobs = (0..900)
            .map(|_| {
                let sigma = 1.6 * 2_f64.powf(draw(0.0, 2.0));
                [draw(-80.0, 400.0), draw(-80.0, 400.0), sigma, draw(-60.0, 60.0)]
            })
            .collect();
        Self { blobs }
    }

    /// The picture seen through `place`, which says where in the picture a pixel of the photo looks.
    fn photo(&self, place: impl Fn([f64; 2]) -> [f64; 2], brightness: impl Fn(f64) -> f64) -> Grey {
        let mut photo = Grey::new(SIZE, SIZE);
        for row in 0..SIZE {
            for column in 0..SIZE {
                let [x, y] = place([column as f64 + 0.5, row as f64 + 0.5]);
                let sum: f64 = self
                    .blobs
                    .iter()
                    .map(|[bx, by, sigma, height]| {
                        let d2 = ((x - bx).powi(2) + (y - by).powi(2)) / (2.0 * sigma * sigma);
                        if d2 < 12.0 { height * (-d2).exp() } else { 0.0 }
                    })
                    .sum();
                photo.set(column, row, [brightness(128.0 + sum).clamp(0.0, 255.0) as f32]);
            }
        }
        photo
    }
}

/// A turn, growth and shift about the middle; the inverse of what the photo looks through.
#[derive(Clone, Copy)]
struct Similarity {
    turn_rad: f64,
    growth: f64,
    shift: [f64; 2],
}

impl Similarity {
    fn apply(&self, [x, y]: [f64; 2]) -> [f64; 2] {
        let (sin, cos) = self.turn_rad.sin_cos();
        let (dx, dy) = (x - 160.0, y - 160.0);
        let grown = |value: f64| self.growth * value;
        [160.0 + grown(cos * dx - sin * dy) + self.shift[0], 160.0 + grown(sin * dx + cos * dy) + self.shift[1]]
    }

    fn undo(&self, [x, y]: [f64; 2]) -> [f64; 2] {
        let (sin, cos) = self.turn_rad.sin_cos();
        let (dx, dy) = ((x - 160.0 - self.shift[0]) / self.growth, (y - 160.0 - self.shift[1]) / self.growth);
        [160.0 + cos * dx + sin * dy, 160.0 - sin * dx + cos * dy]
    }
}

/// What mutual nearest neighbours tell: how many, the share that is right (within two pixels), their median error.
#[derive(Debug)]
struct Agreement {
    mutual: usize,
    right: f64,
    median_px: f64,
}

fn agreement<D: Descriptor>(first: &Features<D>, second: &Features<D>, truth: &Similarity) -> Agreement {
    let forth = nearest::<1, _>(&first.descriptors, &second.descriptors);
    let back = nearest::<1, _>(&second.descriptors, &first.descriptors);
    let mut errors: Vec<f64> = forth
        .iter()
        .enumerate()
        .filter(|(index, [best])| back[best.index as usize][0].index as usize == *index)
        .map(|(index, [best])| {
            let expected = truth.apply(first.keypoints[index].pixel);
            let found = second.keypoints[best.index as usize].pixel;
            (expected[0] - found[0]).hypot(expected[1] - found[1])
        })
        .collect();
    let mutual = errors.len();
    errors.retain(|&error| error < 2.0);
    errors.sort_by(f64::total_cmp);
    Agreement { mutual, right: errors.len() as f64 / mutual as f64, median_px: errors[errors.len() / 2] }
}

fn pair(truth: &Similarity) -> [Grey; 2] {
    let picture = Picture::new(1);
    // The second photo is darker and of less contrast.
    [picture.photo(|pixel| pixel, |value| value), picture.photo(|pixel| truth.undo(pixel), |value| 10.0 + 0.6 * value)]
}

#[test]
fn sift_finds_the_same_points_after_turn_growth_shift_and_a_change_of_light() {
    let truth = Similarity { turn_rad: 0.9, growth: 1.3, shift: [4.3, -7.6] };
    let options = SiftOptions { orientation: Orientation::Free, ..SiftOptions::default() };
    let [first, second] = pair(&truth).map(|photo| sift(&photo, None, &options));
    let found = agreement(&first, &second, &truth);
    assert!(found.mutual > 120 && found.right > 0.9 && found.median_px < 0.06, "{found:?}");
}

#[test]
fn upright_sift_is_better_where_photos_stand_upright_and_fails_where_they_do_not() {
    let upright = SiftOptions::default();
    let still = Similarity { turn_rad: 0.03, growth: 1.05, shift: [11.7, 3.2] };
    let [first, second] = pair(&still).map(|photo| sift(&photo, None, &upright));
    let found = agreement(&first, &second, &still);
    assert!(found.mutual > 180 && found.right > 0.97 && found.median_px < 0.05, "{found:?}");
    assert!(first.keypoints.iter().all(|keypoint| keypoint.angle_rad == 0.0));
    let turned = Similarity { turn_rad: 1.5, growth: 1.0, shift: [0.0, 0.0] };
    let [first, second] = pair(&turned).map(|photo| sift(&photo, None, &upright));
    assert!(agreement(&first, &second, &turned).right < 0.2);
}

#[test]
fn sift_measures_a_lone_blob_s_place_to_a_hundredth_of_its_size_and_its_size() {
    for doubled in [false, true] {
        let picture = Picture { blobs: vec![[161.37, 158.81, 5.0, 90.0]] };
        let options = SiftOptions { doubled, ..SiftOptions::default() };
        let found = sift(&picture.photo(|pixel| pixel, |value| value), None, &options);
        let best = found.keypoints[0];
        let error = (best.pixel[0] - 161.37).hypot(best.pixel[1] - 158.81);
        // The quadratic's own error, where the blob's middle falls half way between samples.
        assert!(error < 0.06, "{best:?}");
        // A difference of Gaussians s and k s answers most where s is the blob's deviation over sqrt(k).
        let expected = 5.0 / 2_f32.powf(1.0 / 6.0);
        assert!((best.scale_px / expected - 1.0).abs() < 0.06, "{best:?}");
    }
}

#[test]
fn orb_finds_the_same_points_upright_and_turned() {
    let cases = [
        (Orientation::Upright, Similarity { turn_rad: 0.05, growth: 1.0, shift: [9.0, 3.0] }),
        (Orientation::Free, Similarity { turn_rad: 0.8, growth: 1.15, shift: [2.4, -5.1] }),
    ];
    for (orientation, truth) in cases {
        let options = OrbOptions { orientation, ..OrbOptions::default() };
        let [first, second] = pair(&truth).map(|photo| orb(&photo, None, &options));
        let found = agreement(&first, &second, &truth);
        assert!(found.mutual > 150 && found.right > 0.6, "{orientation:?} {found:?}");
    }
}

/// Share of the descriptors that are found in `others` with hardly a difference.
fn kept<D: Descriptor>(features: &Features<D>, others: &Features<D>, hardly: u32) -> f64 {
    let found = nearest::<1, _>(&features.descriptors, &others.descriptors);
    found.iter().filter(|[best]| best.distance <= hardly).count() as f64 / features.descriptors.len() as f64
}

#[test]
fn what_is_under_the_mask_carries_no_feature_and_disturbs_none_beside_it() {
    let picture = Picture::new(3);
    let photo = picture.photo(|pixel| pixel, |value| value);
    let mut mask = Mask { width: SIZE, height: SIZE, data: vec![255; SIZE * SIZE] };
    let mut disturbed = photo.clone();
    let mut rng = ChaCha8Rng::seed_from_u64(9);
    for row in 100..180 {
        for column in 120..260 {
            mask.set(column, row, [0]);
            disturbed.set(column, row, [rng.random_range(0.0..255.0)]);
        }
    }
    let outside = |keypoint: &Keypoint| {
        let [x, y] = keypoint.pixel;
        !(120.0..260.0).contains(&x) || !(100.0..180.0).contains(&y)
    };
    for orientation in [Orientation::Upright, Orientation::Free] {
        let options = SiftOptions { orientation, ..SiftOptions::default() };
        let [clean, noisy] = [&photo, &disturbed].map(|photo| sift(photo, Some(&mask), &options));
        assert!(noisy.keypoints.len() > 100 && noisy.keypoints.iter().all(outside));
        // Strangers are some 60,000 apart. What is left is the blur, which carries a little across the border.
        assert!(kept(&clean, &noisy, 600) > 0.98, "{orientation:?} {}", kept(&clean, &noisy, 600));
        let unmasked = sift(&disturbed, None, &options);
        assert!(!unmasked.keypoints.iter().all(outside));
        let options = OrbOptions { orientation, ..OrbOptions::default() };
        let [clean, noisy] = [&photo, &disturbed].map(|photo| orb(photo, Some(&mask), &options));
        assert!(clean.keypoints.len() > 100 && noisy.keypoints.iter().all(outside));
        assert!(kept(&clean, &noisy, 3) > 0.98, "{orientation:?} {}", kept(&clean, &noisy, 3));
    }
}

#[test]
fn a_grey_photo_has_no_features_and_a_tiny_one_is_no_error() {
    let grey = Grey { width: 200, height: 100, data: vec![90.0; 20_000] };
    assert!(sift(&grey, None, &SiftOptions::default()).keypoints.is_empty());
    assert!(orb(&grey, None, &OrbOptions::default()).keypoints.is_empty());
    let tiny = Grey::new(3, 2);
    assert!(sift(&tiny, None, &SiftOptions::default()).keypoints.is_empty());
    assert!(orb(&tiny, None, &OrbOptions::default()).keypoints.is_empty());
}
