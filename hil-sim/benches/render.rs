//! Cost of a ray, of a patch of paint and of a photo.

use std::hint::black_box;
use std::path::Path;
use std::sync::Arc;

use adit_geometry::camera::{Camera, Distortion};
use adit_geometry::profile::ProfileSpec;
use adit_geometry::rig::{ImageUp, nominal_rotation};
use adit_hil_sim::render::card::encode_photo;
use adit_hil_sim::render::{ExifTime, PhotoRenderer, RenderConfig, Shot};
use adit_hil_sim::scene::{LiningPaint, Paint, Patch, Pattern, TextureConfig, Wall, WallConfig};
use divan::Bencher;
use nalgebra::{Isometry3, Point3, Translation3, Vector3};

const PATTERNS: [Pattern; 4] = [Pattern::Brick, Pattern::Panorama, Pattern::Concrete, Pattern::Tiles];

fn main() {
    divan::main();
}

fn wall(relief: bool) -> Arc<Wall> {
    let profile = ProfileSpec::Circle { radius_m: 3.0 }.build().expect("valid");
    let flat = WallConfig::default();
    let rough = WallConfig { ovality_mm: 10.0, ring_step_mm: 4.0, undulation_mm: 3.0, ..WallConfig::default() };
    Arc::new(Wall::new(profile, if relief { &rough } else { &flat }, 1).expect("valid"))
}

fn paint(wall: &Wall, pattern: Pattern) -> Arc<dyn Paint> {
    let texture = TextureConfig { pattern, ..TextureConfig::default() };
    Arc::new(LiningPaint::new(wall.profile(), &texture, Path::new("."), 1).expect("no file"))
}

#[divan::bench(args = [false, true])]
fn ray_cast(bencher: Bencher, relief: bool) {
    let wall = wall(relief);
    let mut turn = 0.0_f64;
    bencher.bench_local(|| {
        turn += 0.1;
        let direction = Vector3::new(0.4 * (0.37 * turn).sin(), turn.sin(), turn.cos());
        wall.ray_cast(black_box(Point3::new(1.0, 0.2, -0.1)), direction)
    });
}

#[divan::bench(args = PATTERNS)]
fn albedo(bencher: Bencher, pattern: Pattern) {
    let wall = wall(false);
    let paint = paint(&wall, pattern);
    let mut place = 0.0_f64;
    bencher.bench_local(|| {
        place += 0.0031;
        paint.albedo(black_box(&Patch { s_m: place, x_m: 0.7 * place, size_s_m: 0.003, size_x_m: 0.003 }))
    });
}

/// A photo of 0.75 megapixels on one thread.
#[divan::bench(args = PATTERNS, sample_count = 5, sample_size = 1)]
fn photo(bencher: Bencher, pattern: Pattern) {
    let wall = wall(true);
    let camera = Camera {
        width_px: 1000,
        height_px: 750,
        focal_px: [466.0; 2],
        centre_px: [503.0, 373.0],
        distortion: Distortion::BrownConrady([-0.04, 0.006, 0.0, 0.0, 0.0]),
    };
    let paint = paint(&wall, pattern);
    let renderer = PhotoRenderer::new(camera, 0.0, wall, paint, &RenderConfig::default(), 1).expect("valid");
    let pose = Isometry3::from_parts(Translation3::new(1.0, 0.1, 0.2), nominal_rotation(ImageUp::Forward, 1.0));
    let shot = Shot::still(0, pose, Isometry3::identity());
    let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build().expect("a thread");
    bencher.bench_local(|| {
        let photo = pool.install(|| renderer.render(&shot));
        encode_photo(&photo.image, 92, 0.004, ExifTime(0)).expect("small enough")
    });
}
