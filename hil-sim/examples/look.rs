//! Renders one photo and a piece of unrolled wall for every pattern, to be looked at.
//!
//! `cargo run -p adit-hil-sim --example look -- OUT`

use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Instant;

use adit_geometry::camera::{Camera, Distortion};
use adit_geometry::profile::{Part, ProfileSpec};
use adit_geometry::rig::{ImageUp, Rig, attitude};
use adit_hil_sim::render::{PhotoRenderer, RenderConfig, Shot, VehiclePartConfig};
use adit_hil_sim::scene::{
    BulgeConfig, LiningPaint, Paint, PartTexture, Patch, Pattern, PipeConfig, TextureConfig, Wall, WallConfig,
};
use anyhow::{Context, Result};
use nalgebra::{Isometry3, Translation3, Vector3};

fn main() -> Result<()> {
    let out = PathBuf::from(std::env::args().nth(1).context("usage: look OUT")?);
    std::fs::create_dir_all(&out)?;
    let circle = ProfileSpec::Circle { radius_m: 3.0 };
    let underpass = ProfileSpec::Underpass { width_m: 4.0, wall_m: 2.5, rise_m: 1.0, axis_height_m: 1.4 };
    let patterns = [Pattern::Brick, Pattern::Panorama, Pattern::Concrete, Pattern::Tiles];
    for (name, pattern) in ["brick", "panorama", "concrete", "tiles"].into_iter().zip(patterns) {
        let texture = TextureConfig { pattern, ..TextureConfig::default() };
        look(&out, name, &circle, &texture, &rough_wall(), 117.0)?;
    }
    let parts = vec![PartTexture { part: Part::Floor, pattern: Pattern::Concrete }];
    let texture = TextureConfig { parts, ..TextureConfig::default() };
    let wall = WallConfig { water_z_m: Some(1.2), ..WallConfig::default() };
    look(&out, "underpass", &underpass, &texture, &wall, 150.0)?;
    Ok(())
}

fn rough_wall() -> WallConfig {
    WallConfig {
        ovality_mm: 10.0,
        ring_step_mm: 6.0,
        undulation_mm: 3.0,
        bulges: vec![BulgeConfig { s_m: 5.5, x_m: 1.0, height_mm: 40.0, sigma_m: 0.25 }],
        pipes: vec![PipeConfig { s_m: 6.6, radius_mm: 70.0, standoff_mm: 30.0, from_x_m: -5.0, to_x_m: 1.8 }],
        ..WallConfig::default()
    }
}

fn look(
    out: &Path,
    name: &str,
    spec: &ProfileSpec<f64>,
    texture: &TextureConfig,
    wall: &WallConfig,
    shaft_deg: f64,
) -> Result<()> {
    let profile = spec.build()?;
    let paint: Arc<dyn Paint> = Arc::new(LiningPaint::new(&profile, texture, Path::new("."), 1)?);
    unrolled(&out.join(format!("{name}-wall.png")), paint.as_ref())?;
    let wall = Arc::new(Wall::new(profile, wall, 1)?);
    let camera = Camera {
        width_px: 1000,
        height_px: 750,
        focal_px: [466.0, 466.0],
        centre_px: [503.0, 373.0],
        distortion: Distortion::BrownConrady([-0.04, 0.006, 0.0, 0.0, 0.0]),
    };
    let rig = Rig {
        images_per_turn: 10,
        image_up: ImageUp::Forward,
        lever_radial_m: 0.06,
        lever_forward_m: 0.0,
        mount_rotvec_rad: [0.0; 3],
    };
    let vehicle_parts = vec![VehiclePartConfig { from_m: [0.15, 0.35, 0.2], to_m: [0.45, 0.35, 0.5], radius_mm: 12.0 }];
    let config = RenderConfig { vehicle_parts, ..RenderConfig::default() };
    let renderer = PhotoRenderer::new(camera, 0.0, wall, paint, &config, 1)?;
    let body = Isometry3::from_parts(Translation3::new(1.0, 0.1, -0.15), attitude(0.02, -0.01, 0.03));
    let still = Shot::still(3, body * rig.body_from_cam(shaft_deg.to_radians()), body);
    let shot =
        Shot { angular_velocity_rad_per_s: Vector3::new(0.0, 0.2, 0.1), velocity_mps: Vector3::x() * 0.3, ..still };
    let started = Instant::now();
    let still = renderer.render(&still);
    let still_s = started.elapsed().as_secs_f64();
    let photo = renderer.render(&shot);
    let moving_s = started.elapsed().as_secs_f64() - still_s;
    println!("{name}: {still_s:.3} s at rest, {moving_s:.3} s in motion, gains {:.2?}", photo.gains);
    write_png(&out.join(format!("{name}-photo.png")), &still.image.data, 1000, 750)?;
    write_png(&out.join(format!("{name}-moving.png")), &photo.image.data, 1000, 750)
}

/// 2 m around by 1.5 m along at 2 mm per pixel.
fn unrolled(file: &Path, paint: &dyn Paint) -> Result<()> {
    let (width, height) = (1000_u32, 750_u32);
    let mut data = Vec::new();
    for row in 0..height {
        for column in 0..width {
            let (s_m, x_m) = (f64::from(column) * 0.002 - 0.5, f64::from(row) * 0.002);
            let albedo = paint.albedo(&Patch { s_m, x_m, size_s_m: 0.002, size_x_m: 0.002 });
            data.extend(albedo.map(|value| (value.powf(1.0 / 2.2) * 255.0) as u8));
        }
    }
    write_png(file, &data, width, height)
}

fn write_png(file: &Path, data: &[u8], width: u32, height: u32) -> Result<()> {
    let mut encoder = png::Encoder::new(std::fs::File::create(file)?, width, height);
    encoder.set_color(png::ColorType::Rgb);
    encoder.set_depth(png::BitDepth::Eight);
    encoder.write_header()?.write_image_data(data)?;
    Ok(())
}
