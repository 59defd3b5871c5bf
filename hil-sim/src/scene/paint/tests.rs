use adit_geometry::profile::ProfileSpec;

use super::*;

fn patch(s_m: f64, x_m: f64, size_m: f32) -> Patch {
    Patch { s_m, x_m, size_s_m: size_m, size_x_m: size_m }
}

fn lining(pattern: Pattern) -> LiningPaint {
    let profile = ProfileSpec::Circle { radius_m: 3.0 }.build().expect("valid");
    let config = TextureConfig { pattern, ..TextureConfig::default() };
    LiningPaint::new(&profile, &config, Path::new("."), 42).expect("no file needed")
}

const PROCEDURAL: [Pattern; 5] =
    [Pattern::Brick, Pattern::Panorama, Pattern::Concrete, Pattern::Tiles, Pattern::IdenticalBrick];

#[test]
fn every_pattern_closes_at_the_crown() {
    for pattern in PROCEDURAL {
        let paint = lining(pattern);
        for step in 0..500 {
            let x_m = f64::from(step) * 0.0137;
            let s_m = f64::from(step % 7) * 0.01;
            let here = paint.albedo(&patch(s_m, x_m, 0.003));
            let around = paint.albedo(&patch(s_m + paint.perimeter_m, x_m, 0.003));
            let worst = here.iter().zip(around).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
            assert!(worst < 1e-3, "{pattern:?} at x {x_m}: {here:?} {around:?}");
        }
    }
}

#[test]
fn every_pattern_is_continuous_over_the_seam() {
    for pattern in PROCEDURAL {
        let paint = lining(pattern);
        for step in 0..500 {
            let x_m = f64::from(step) * 0.0137;
            let left = paint.albedo(&patch(-1e-6, x_m, 0.002));
            let right = paint.albedo(&patch(1e-6, x_m, 0.002));
            let worst = left.iter().zip(right).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
            assert!(worst < 0.02, "{pattern:?} at x {x_m}: {left:?} {right:?}");
        }
    }
}

#[test]
fn a_large_patch_has_the_mean_colour_of_its_small_ones() {
    // Averaging in the pattern instead of over samples is what keeps far walls free of moire.
    for pattern in PROCEDURAL {
        let paint = lining(pattern);
        let (mut error, mut spread) = (0.0_f32, 0.0_f32);
        for place in 0..60 {
            let (s_m, x_m) = (f64::from(place) * 0.29, f64::from(place % 11) * 0.37);
            let mut mean = 0.0;
            for column in 0..16 {
                for row in 0..16 {
                    let offset = |index: i32| (f64::from(index) - 7.5) * 0.001;
                    mean += paint.albedo(&patch(s_m + offset(column), x_m + offset(row), 0.001))[1] / 256.0;
                }
            }
            let whole = paint.albedo(&patch(s_m, x_m, 0.016))[1];
            error += (whole - mean).abs() / 60.0;
            spread += mean / 60.0;
        }
        assert!(error < 0.12 * spread, "{pattern:?}: mean error {error} of {spread}");
    }
}

#[test]
fn identical_bricks_repeat_to_the_last_digit_but_for_a_few_stains() {
    let (identical, varied) = (lining(Pattern::IdenticalBrick), lining(Pattern::Brick));
    // Two courses and two bricks on: the same place of another brick.
    let courses = (identical.perimeter_m / 0.15).round();
    let repeats = |paint: &LiningPaint| {
        let same = |step: &i32| {
            let (s_m, x_m) = (f64::from(step % 97) * 0.131, f64::from(*step) * 0.0371);
            let moved = patch(s_m + 2.0 * identical.perimeter_m / courses, x_m + 0.45, 0.003);
            let (here, there) = (paint.albedo(&patch(s_m, x_m, 0.003)), paint.albedo(&moved));
            here.iter().zip(there).all(|(a, b)| (a - b).abs() < 1e-4)
        };
        (0..2000).filter(same).count()
    };
    let repeated = repeats(&identical);
    assert!((1600..1990).contains(&repeated), "{repeated} of 2000 places repeat");
    assert!(repeats(&varied) < 20);
}

#[test]
fn parts_have_their_own_pattern() {
    let spec = ProfileSpec::Underpass { width_m: 4.0, wall_m: 2.5, rise_m: 1.0, axis_height_m: 1.4 };
    let profile = spec.build().expect("valid");
    let parts = vec![PartTexture { part: Part::Floor, pattern: Pattern::Concrete }];
    let mixed = TextureConfig { parts, ..TextureConfig::default() };
    let mixed = LiningPaint::new(&profile, &mixed, Path::new("."), 1).expect("valid");
    let brick = LiningPaint::new(&profile, &TextureConfig::default(), Path::new("."), 1).expect("valid");
    let below = profile.ray_cast([0.0, 0.0].into(), [0.1, 1.0].into()).expect("hit").surface.s_m;
    let beside = profile.ray_cast([0.0, 0.0].into(), [1.0, 0.1].into()).expect("hit").surface.s_m;
    assert_ne!(mixed.albedo(&patch(below, 1.0, 0.002)), brick.albedo(&patch(below, 1.0, 0.002)));
    assert_eq!(mixed.albedo(&patch(beside, 1.0, 0.002)), brick.albedo(&patch(beside, 1.0, 0.002)));
}

#[test]
fn a_picture_is_hung_with_columns_around_and_rows_along() {
    let folder = tempfile::tempdir().expect("a folder");
    let file = folder.path().join("four.png");
    // 2 x 2 pixels: red, green / blue, white.
    let mut encoder = png::Encoder::new(std::fs::File::create(&file).expect("writable"), 2, 2);
    encoder.set_color(png::ColorType::Rgb);
    let pixels = [255, 0, 0, 0, 255, 0, 0, 0, 255, 255, 255, 255];
    encoder.write_header().expect("header").write_image_data(&pixels).expect("pixels");
    let perimeter_m = 4.0;
    let config = PhotoTextureConfig { file: "four.png".into(), mm_per_px: 1000.0, x0_m: 10.0, s0_m: 0.0 };
    let texture = PhotoTexture::open(&config, perimeter_m, folder.path()).expect("readable");
    assert_eq!(texture.albedo(&patch(0.5, 10.5, 0.01)), [1.0, 0.0, 0.0]);
    assert_eq!(texture.albedo(&patch(1.5, 10.5, 0.01)), [0.0, 1.0, 0.0]);
    assert_eq!(texture.albedo(&patch(0.5, 11.5, 0.01)), [0.0, 0.0, 1.0]);
    assert_eq!(texture.albedo(&patch(2.5, 10.5, 0.01)), [1.0, 0.0, 0.0], "repeats");
}

#[test]
fn an_unusable_picture_is_named() {
    let folder = tempfile::tempdir().expect("a folder");
    let config = |file: &str| PhotoTextureConfig { file: file.into(), mm_per_px: 2.0, x0_m: 0.0, s0_m: 0.0 };
    let message =
        |file: &str| PhotoTexture::open(&config(file), 10.0, folder.path()).err().expect("an error").to_string();
    assert!(message("missing.png").contains("missing.png"));
    std::fs::write(folder.path().join("text.png"), "hello").expect("writable");
    assert!(message("text.png").contains("neither a PNG nor a JPEG"));
    std::fs::write(folder.path().join("cut.jpg"), b"\xff\xd8\xff\xe0").expect("writable");
    assert!(message("cut.jpg").contains("cut.jpg"));
}
