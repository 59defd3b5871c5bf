//! The wall's true height over the section that survey.toml states, for comparing a measured one with.

use std::path::Path;

use adit_geometry::profile::Profile;
use nalgebra::{Point3, Vector3};
use rayon::prelude::*;
use serde_json::json;

use super::RenderError;
use super::card::write_file;
use super::truth::TextureGeometry;
use crate::scene::{Surface, Wall};

/// Size of a cell, about.
const CELL_MM: f64 = 25.0;
/// Rays start so far inside the nominal section.
const INSIDE_M: f64 = 0.5;

/// Writes `truth/relief.json` (the fields of texture.json) and `truth/relief.f32`: per cell, row by row, the lining's height
/// over the nominal section in metres, positive inwards, little-endian; NaN where a pipe stands before it. Over the stretch of the
/// true texture.
///
/// # Method
/// A ray per cell along the nominal section's normal: true for any section and any wall, since only the wall's own
/// ray-cast is asked.
pub(crate) fn write_relief(
    folder: &Path,
    nominal: &Profile<f64>,
    wall: &Wall,
    texture: &TextureGeometry,
) -> Result<(), RenderError> {
    let end_m = texture.x0_m + texture.height_px as f64 * texture.mm_per_px * 1e-3;
    let grid = TextureGeometry::new(nominal, texture.x0_m, end_m, CELL_MM);
    let cell_m = grid.mm_per_px * 1e-3;
    let heights: Vec<f32> = (0..grid.width_px * grid.height_px)
        .into_par_iter()
        .map(|cell| {
            let s_m = grid.s0_m + ((cell % grid.width_px) as f64 + 0.5) * cell_m;
            height_m(nominal, wall, s_m, grid.x0_m + ((cell / grid.width_px) as f64 + 0.5) * cell_m)
        })
        .collect();
    let bytes: Vec<u8> = heights.iter().flat_map(|height| height.to_le_bytes()).collect();
    write_file(&folder.join("relief.f32"), &bytes)?;
    let json = serde_json::to_string_pretty(&json!(grid)).unwrap_or_default();
    write_file(&folder.join("relief.json"), json.as_bytes())
}

fn height_m(nominal: &Profile<f64>, wall: &Wall, s_m: f64, x_m: f64) -> f32 {
    let Some(surface) = nominal.at(s_m) else { return f32::NAN };
    let start = surface.point + surface.normal * INSIDE_M;
    let outwards = Vector3::new(0.0, -surface.normal.x, -surface.normal.y);
    match wall.ray_cast(Point3::new(x_m, start.x, start.y), outwards) {
        Some(hit) if hit.surface == Surface::Lining => (INSIDE_M - hit.distance) as f32,
        _ => f32::NAN,
    }
}

#[cfg(test)]
mod tests {
    use adit_geometry::profile::ProfileSpec;

    use super::*;
    use crate::scene::{BulgeConfig, PipeConfig, WallConfig};

    #[test]
    fn the_height_is_that_over_the_nominal_section_and_none_behind_a_pipe() {
        let nominal = ProfileSpec::Circle { radius_m: 3.0 }.build().expect("valid");
        let built = ProfileSpec::Circle { radius_m: 3.03 }.build().expect("valid");
        let bulges = vec![BulgeConfig { s_m: 3.03, x_m: 1.0, height_mm: 40.0, sigma_m: 0.2 }];
        let pipe = PipeConfig { s_m: 9.09, radius_mm: 60.0, standoff_mm: 30.0, from_x_m: -5.0, to_x_m: 5.0 };
        let config = WallConfig { bulges, pipes: vec![pipe], ..WallConfig::default() };
        let wall = Wall::new(built, &config, 1).expect("valid");
        assert!((height_m(&nominal, &wall, 3.0, 1.0) - 0.01).abs() < 1e-5);
        assert!((height_m(&nominal, &wall, 15.0, 1.0) + 0.03).abs() < 1e-5);
        assert!(height_m(&nominal, &wall, 9.0, 1.0).is_nan());
    }
}
