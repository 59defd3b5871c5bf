use adit_geometry::camera::Distortion;
use adit_geometry::profile::ProfileSpec;
use adit_geometry::rig::{ImageUp, Rig, attitude};
use nalgebra::{Point3, Vector2};

use super::*;
use crate::render::cell::shortest_way;
use crate::render::{LightConfig, SensorConfig, VehiclePartConfig};
use crate::scene::paint::{Patch, Rgb, linear_of_srgb};
use crate::scene::{BulgeConfig, LiningPaint, TextureConfig, WallConfig};

/// Light dots of 25 mm radius on black, at the given `[s, x]`.
struct Dots(Vec<[f64; 2]>);

impl Paint for Dots {
    fn mean_albedo(&self, _: &Patch, samples: &[Patch]) -> Rgb {
        [samples.iter().map(|sample| self.brightness(sample)).sum::<f32>() / samples.len() as f32; 3]
    }
}

impl Dots {
    fn brightness(&self, patch: &Patch) -> f32 {
        let perimeter_m = circle().perimeter_m();
        let nearest_m = self
            .0
            .iter()
            .map(|[s_m, x_m]| shortest_way(patch.s_m - s_m, perimeter_m).hypot(patch.x_m - x_m))
            .fold(f64::INFINITY, f64::min);
        let size_m = f64::from(patch.size_s_m.max(patch.size_x_m));
        // Grey enough not to saturate: clipping would favour the edges.
        0.3 * ((0.025 - nearest_m) / size_m + 0.5).clamp(0.0, 1.0) as f32
    }
}

/// A white wall.
struct White;

impl Paint for White {
    fn mean_albedo(&self, _: &Patch, _: &[Patch]) -> Rgb {
        [0.6; 3]
    }
}

fn circle() -> adit_geometry::profile::Profile<f64> {
    ProfileSpec::Circle { radius_m: 3.0 }.build().expect("valid")
}

fn camera() -> Camera<f64> {
    Camera {
        width_px: 400,
        height_px: 300,
        focal_px: [190.0, 188.0],
        centre_px: [203.0, 147.0],
        distortion: Distortion::BrownConrady([-0.2, 0.05, 0.002, -0.001, 0.0]),
    }
}

fn rough_wall() -> WallConfig {
    WallConfig {
        ovality_mm: 15.0,
        ring_step_mm: 5.0,
        undulation_mm: 5.0,
        bulges: vec![BulgeConfig { s_m: 5.0, x_m: 1.2, height_mm: 40.0, sigma_m: 0.3 }],
        ..WallConfig::default()
    }
}

/// Where the geometry crate sees a point.
fn project(tunnel_from_cam: &Isometry3<f64>, point: &Point3<f64>) -> Option<Vector2<f64>> {
    camera().project(&(tunnel_from_cam.inverse() * point).coords)
}

/// A camera that shows intensities as they are.
fn ideal() -> RenderConfig {
    RenderConfig {
        light: LightConfig { ambient: 1.0, ..LightConfig::default() },
        sensor: SensorConfig {
            auto_exposure: 0.0,
            exposure_drift: 0.0,
            white_balance_drift: 0.0,
            vignetting: 0.0,
            full_well_electrons: 1e9,
            read_noise_electrons: 0.0,
            exposure_s: 0.0,
            ..SensorConfig::default()
        },
        supersampling: 4,
        ..RenderConfig::default()
    }
}

fn poses(shaft_deg: f64, image_up: ImageUp) -> (Isometry3<f64>, Isometry3<f64>) {
    let mount_rotvec_rad = [0.01, -0.02, 0.015];
    let rig = Rig { images_per_turn: 10, image_up, lever_radial_m: 0.06, lever_forward_m: 0.02, mount_rotvec_rad };
    let body = Isometry3::from_parts(Translation3::new(1.0, 0.3, -0.2), attitude(0.05, -0.03, 0.04));
    (body * rig.body_from_cam(shaft_deg.to_radians()), body)
}

/// Brightness-weighted centre of what lies within `reach_px` of `near`; `None` if it is dark there.
fn centroid(image: &RgbImage, near: &Vector2<f64>, reach_px: f64) -> Option<Vector2<f64>> {
    let (mut sum, mut weight) = (Vector2::zeros(), 0.0);
    for row in 0..image.height {
        for column in 0..image.width {
            let place = Vector2::new(column as f64 + 0.5, row as f64 + 0.5);
            if (place - near).norm() < reach_px {
                let value = image.data[(row * image.width + column) * 3 + 1];
                let light = f64::from(linear_of_srgb([value; 3])[1]);
                sum += place * light;
                weight += light;
            }
        }
    }
    (weight > 0.5).then(|| sum / weight)
}

/// Dots on a grid around the middle of the photo.
fn dots_around(wall: &Wall, tunnel_from_cam: &Isometry3<f64>) -> Vec<[f64; 2]> {
    let axis = tunnel_from_cam.rotation * Vector3::z();
    let middle = wall.ray_cast(Point3::from(tunnel_from_cam.translation.vector), axis).expect("a wall");
    let offsets = [-1.5, -0.75, 0.0, 0.75, 1.5];
    let at = |ds: f64, dx: f64| [middle.s_m + ds, middle.x_m + dx];
    offsets.iter().flat_map(|ds| offsets.iter().map(move |dx| at(*ds, *dx))).collect()
}

#[test]
fn wall_points_appear_where_the_geometry_crate_projects_them() {
    let wall = Arc::new(Wall::new(circle(), &rough_wall(), 3).expect("valid"));
    let mut seen = 0;
    for (shaft_deg, image_up) in [
        (0.0, ImageUp::Forward),
        (75.0, ImageUp::Forward),
        (190.0, ImageUp::Backward),
        (300.0, ImageUp::Clockwise),
        (359.0, ImageUp::Counterclockwise),
    ] {
        let (tunnel_from_cam, body) = poses(shaft_deg, image_up);
        let dots = dots_around(&wall, &tunnel_from_cam);
        let paint = Arc::new(Dots(dots.clone()));
        let renderer = PhotoRenderer::new(camera(), 0.0, wall.clone(), paint, &ideal(), 1).expect("valid");
        let photo = renderer.render(&Shot::still(0, tunnel_from_cam, body));
        for [s_m, x_m] in dots {
            let point = wall.lining_point(s_m, x_m).expect("finite");
            let Some(expected) = project(&tunnel_from_cam, &point) else { continue };
            if !camera().contains(&expected, 6.0) {
                continue;
            }
            let found = centroid(&photo.image, &expected, 5.0).expect("a dot");
            let error_px = (found - expected).norm();
            // A 25 mm disc on a bent wall is not centred on its middle to better than a few hundredths of a pixel.
            assert!(error_px < 0.05, "{error_px} px at shaft {shaft_deg}, s {s_m}, x {x_m}");
            seen += 1;
        }
    }
    assert!(seen > 60, "{seen} dots in view");
}

#[test]
fn the_same_seed_gives_the_same_bytes_on_any_number_of_threads() {
    let wall = Arc::new(Wall::new(circle(), &WallConfig { water_z_m: Some(2.6), ..rough_wall() }, 3).expect("valid"));
    let texture = TextureConfig::default();
    let Camera { focal_px, centre_px, .. } = camera();
    let (focal_px, centre_px) = (focal_px.map(|value| value / 3.0), centre_px.map(|value| value / 3.0));
    // Neither a whole number of blocks nor of bands.
    let small = Camera { width_px: 133, height_px: 101, focal_px, centre_px, ..camera() };
    let render = |threads: usize, seed: u64| {
        let paint = LiningPaint::new(wall.profile(), &texture, std::path::Path::new("."), seed).expect("no file");
        let config = RenderConfig {
            vehicle_parts: vec![VehiclePartConfig { from_m: [0.1, 0.2, 0.2], to_m: [0.5, 0.3, 0.6], radius_mm: 15.0 }],
            ..RenderConfig::default()
        };
        let renderer = PhotoRenderer::new(small, 0.03, wall.clone(), Arc::new(paint), &config, seed).expect("valid");
        let (tunnel_from_cam, body) = poses(150.0, ImageUp::Forward);
        let shot = Shot { velocity_mps: Vector3::x(), ..Shot::still(5, tunnel_from_cam, body) };
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("threads");
        pool.install(|| renderer.render(&shot))
    };
    let first = render(1, 9);
    assert_eq!(first, render(3, 9));
    assert_ne!(first.image, render(2, 10).image);
}

#[test]
fn motion_during_the_exposure_smears_along_the_motion() {
    let wall = Arc::new(Wall::new(circle(), &WallConfig::default(), 3).expect("valid"));
    let (tunnel_from_cam, body) = poses(90.0, ImageUp::Forward);
    let middle = dots_around(&wall, &tunnel_from_cam)[12];
    let expected = project(&tunnel_from_cam, &wall.lining_point(middle[0], middle[1]).expect("finite"));
    let expected = expected.expect("in view");
    let extent = |velocity_mps: Vector3<f64>| {
        let mut config = ideal();
        config.sensor.exposure_s = 0.2;
        let renderer =
            PhotoRenderer::new(camera(), 0.0, wall.clone(), Arc::new(Dots(vec![middle])), &config, 1).expect("valid");
        let photo = renderer.render(&Shot { velocity_mps, ..Shot::still(0, tunnel_from_cam, body) });
        let centre = centroid(&photo.image, &expected, 20.0).expect("a dot");
        assert!((centre - expected).norm() < 0.2, "the smear is centred on the pose at mid-exposure");
        let lit = |column: usize, row: usize| photo.image.data[(row * 400 + column) * 3] > 20;
        let columns = (0..400).filter(|column| (0..300).any(|row| lit(*column, row))).count();
        let rows = (0..300).filter(|row| (0..400).any(|column| lit(column, *row))).count();
        (columns, rows)
    };
    let still = extent(Vector3::zeros());
    let moving = extent(Vector3::x());
    // Up in the image is forward: 0.2 m at 2.7 m and 188 px are 14 px of rows.
    assert!(moving.1 >= still.1 + 11 && moving.1 <= still.1 + 16, "{still:?} {moving:?}");
    assert!(moving.0 <= still.0 + 2, "{still:?} {moving:?}");
}

#[test]
fn a_rolling_shutter_shifts_rows_by_their_time() {
    let wall = Arc::new(Wall::new(circle(), &WallConfig::default(), 3).expect("valid"));
    let (tunnel_from_cam, body) = poses(90.0, ImageUp::Forward);
    let dots = dots_around(&wall, &tunnel_from_cam);
    let renderer =
        PhotoRenderer::new(camera(), 0.1, wall.clone(), Arc::new(Dots(dots.clone())), &ideal(), 1).expect("valid");
    let shot = Shot {
        velocity_mps: Vector3::new(0.5, 0.0, 0.3),
        angular_velocity_rad_per_s: Vector3::new(0.1, 0.3, 0.2),
        ..Shot::still(0, tunnel_from_cam, body)
    };
    let photo = renderer.render(&shot);
    let mut largest_shift_px = 0.0_f64;
    for [s_m, x_m] in dots {
        let point = wall.lining_point(s_m, x_m).expect("finite");
        let project = |pose: Isometry3<f64>| project(&pose, &point).expect("in view");
        // The row decides the time, and the time the row: three rounds settle it.
        let unmoved = project(tunnel_from_cam);
        let mut expected = unmoved;
        for _ in 0..3 {
            let time_s = (expected.y / 300.0 - 0.5) * 0.1;
            let turned = UnitQuaternion::from_scaled_axis(shot.angular_velocity_rad_per_s * time_s);
            let mut pose = tunnel_from_cam;
            pose.rotation = turned * pose.rotation;
            pose.translation.vector += shot.velocity_mps * time_s;
            expected = project(pose);
        }
        if camera().contains(&expected, 6.0) {
            let found = centroid(&photo.image, &expected, 5.0).expect("a dot");
            assert!((found - expected).norm() < 0.05, "{} px", (found - expected).norm());
            largest_shift_px = largest_shift_px.max((expected - unmoved).norm());
        }
    }
    assert!(largest_shift_px > 1.0, "the test must be able to fail: {largest_shift_px}");
}

#[test]
fn a_vehicle_part_is_dark_and_masked_and_the_rest_is_not() {
    let wall = Arc::new(Wall::new(circle(), &WallConfig::default(), 3).expect("valid"));
    let (tunnel_from_cam, body) = poses(90.0, ImageUp::Forward);
    let part = VehiclePartConfig { from_m: [0.1, 0.5, 0.0], to_m: [0.1, 0.9, 0.0], radius_mm: 20.0 };
    let config = RenderConfig { vehicle_parts: vec![part], ..ideal() };
    let renderer = PhotoRenderer::new(camera(), 0.0, wall, Arc::new(White), &config, 1).expect("valid");
    let photo = renderer.render(&Shot::still(0, tunnel_from_cam, body));
    let mask = photo.mask.expect("in view");
    let on_part = body * Point3::new(0.1, 0.7, 0.0);
    let pixel = project(&tunnel_from_cam, &on_part).expect("in view");
    let index = pixel.y as usize * 400 + pixel.x as usize;
    assert_eq!(mask[index], 0);
    assert!(photo.image.data[index * 3] < 80);
    let masked: usize = mask.iter().map(|value| usize::from(*value == 0)).sum();
    assert!(masked > 100 && masked < 12_000, "{masked}");
    let dark_unmasked =
        mask.iter().enumerate().filter(|(index, mask)| **mask == 255 && photo.image.data[index * 3] < 120);
    assert_eq!(dark_unmasked.count(), 0, "what hides the wall is masked");
    let away = Shot::still(0, poses(270.0, ImageUp::Forward).0, body);
    assert!(renderer.render(&away).mask.is_none());
}

#[test]
fn bad_numbers_are_named() {
    let wall = Arc::new(Wall::new(circle(), &WallConfig::default(), 3).expect("valid"));
    let check = |config: &RenderConfig| {
        let renderer = PhotoRenderer::new(camera(), 0.0, wall.clone(), Arc::new(Dots(Vec::new())), config, 1);
        renderer.err().expect("an error").to_string()
    };
    let config = RenderConfig { jpeg_quality: 0, ..RenderConfig::default() };
    assert!(check(&config).contains("jpeg_quality is 0; expected 1 to 100"));
    let sensor = SensorConfig { exposure_s: f64::NAN, ..SensorConfig::default() };
    assert!(check(&RenderConfig { sensor, ..RenderConfig::default() }).contains("exposure_s"));
}
