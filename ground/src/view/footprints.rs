//! Where photos lie on the wall: their borders, cast onto the section.

use std::fs;
use std::path::Path;

use adit_geometry::SectionVector;
use adit_geometry::camera::{Camera, Distortion};
use adit_geometry::profile::Profile;
use nalgebra::{Isometry3, Vector2, Vector3};

use super::error::ViewError;

/// Points along each side of a photo.
const POINTS_PER_SIDE: usize = 8;
/// A border that looks along the tunnel is cut off so many perimeters away.
const FARTHEST_PERIMETERS: f64 = 2.0;

/// Reads the camera of `colmap/cameras.txt` as [`crate::model::colmap`] writes it.
pub(super) fn read_camera(path: &Path) -> Result<Camera<f64>, ViewError> {
    let text = fs::read_to_string(path).map_err(|source| ViewError::Read { path: path.to_owned(), source })?;
    let line = text.lines().find(|line| !line.starts_with('#') && !line.trim().is_empty());
    line.and_then(parse_camera).ok_or_else(|| ViewError::Camera { path: path.to_owned() })
}

fn parse_camera(line: &str) -> Option<Camera<f64>> {
    let words: Vec<&str> = line.split_whitespace().collect();
    let (model, width_px, height_px) = (*words.get(1)?, words.get(2)?.parse().ok()?, words.get(3)?.parse().ok()?);
    let numbers: Vec<f64> = words.get(4..)?.iter().map(|word| word.parse().ok()).collect::<Option<_>>()?;
    let (&[fx, fy, cx, cy], rest) = numbers.split_first_chunk()?;
    let distortion = match (model, rest) {
        ("OPENCV", &[k1, k2, p1, p2]) => Distortion::BrownConrady([k1, k2, p1, p2, 0.0]),
        ("FULL_OPENCV", &[k1, k2, p1, p2, k3, 0.0, 0.0, 0.0]) => Distortion::BrownConrady([k1, k2, p1, p2, k3]),
        ("OPENCV_FISHEYE", &[k1, k2, k3, k4]) => Distortion::KannalaBrandt([k1, k2, k3, k4]),
        _ => return None,
    };
    Some(Camera { width_px, height_px, focal_px: [fx, fy], centre_px: [cx, cy], distortion })
}

/// Returns the photo's border on the wall as `[s_m, x_m]`, `s` without a jump at the crown (so it may leave
/// `[0, perimeter)`); empty if the camera is not inside the section.
pub(super) fn footprint(
    camera: &Camera<f64>,
    tunnel_from_cam: &Isometry3<f64>,
    profile: &Profile<f64>,
) -> Vec<[f64; 2]> {
    let perimeter_m = profile.perimeter_m();
    let mut points: Vec<[f64; 2]> = Vec::with_capacity(4 * POINTS_PER_SIDE);
    for pixel in border(camera) {
        let Some(in_cam) = camera.unproject(&pixel) else { continue };
        let Some([s_m, x_m]) = on_wall(&(tunnel_from_cam.rotation * in_cam), tunnel_from_cam, profile) else {
            continue;
        };
        let s_m = match points.last() {
            Some(&[last, _]) => s_m - ((s_m - last) / perimeter_m).round() * perimeter_m,
            None => s_m,
        };
        points.push([s_m, x_m]);
    }
    points
}

fn on_wall(direction: &Vector3<f64>, tunnel_from_cam: &Isometry3<f64>, profile: &Profile<f64>) -> Option<[f64; 2]> {
    let centre = tunnel_from_cam.translation.vector;
    let origin = SectionVector::new(centre.y, centre.z);
    if !profile.contains(origin) {
        return None;
    }
    let hit = profile.ray_cast(origin, SectionVector::new(direction.y, direction.z))?;
    let most_m = FARTHEST_PERIMETERS * profile.perimeter_m();
    Some([hit.surface.s_m, centre.x + (hit.distance * direction.x).clamp(-most_m, most_m)])
}

/// Pixel positions along the image's border, once around.
fn border(camera: &Camera<f64>) -> impl Iterator<Item = Vector2<f64>> {
    let (width, height) = (f64::from(camera.width_px), f64::from(camera.height_px));
    let corners = [[0.0, 0.0], [width, 0.0], [width, height], [0.0, height]];
    (0..4 * POINTS_PER_SIDE).map(move |at| {
        let (side, share) = (at / POINTS_PER_SIDE, (at % POINTS_PER_SIDE) as f64 / POINTS_PER_SIDE as f64);
        let (from, to) = (corners[side], corners[(side + 1) % 4]);
        Vector2::new(from[0] + (to[0] - from[0]) * share, from[1] + (to[1] - from[1]) * share)
    })
}

#[cfg(test)]
mod tests {
    use adit_geometry::profile::ProfileSpec;
    use nalgebra::{Rotation3, Translation3, UnitQuaternion};

    use super::*;

    fn pinhole() -> Camera<f64> {
        Camera {
            width_px: 800,
            height_px: 600,
            focal_px: [400.0, 400.0],
            centre_px: [400.0, 300.0],
            distortion: Distortion::BrownConrady([0.0; 5]),
        }
    }

    #[test]
    fn a_camera_that_looks_up_at_a_flat_ceiling_sees_a_rectangle_over_the_seam() {
        let profile = ProfileSpec::Rectangle { width_m: 6.0, height_m: 3.0, axis_height_m: 1.0 }.build().unwrap();
        // cam x = -tunnel y, cam y = -tunnel x (image up forward), cam z = up = -tunnel z.
        let axes = nalgebra::Matrix3::new(0.0, -1.0, 0.0, -1.0, 0.0, 0.0, 0.0, 0.0, -1.0);
        let rotation = UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(axes));
        let pose = Isometry3::from_parts(Translation3::new(5.0, 0.0, 0.0), rotation);
        let points = footprint(&pinhole(), &pose, &profile);
        assert_eq!(points.len(), 32);
        let range = |axis: usize| {
            let values = points.iter().map(|point| point[axis]);
            (values.clone().fold(f64::INFINITY, f64::min), values.fold(f64::NEG_INFINITY, f64::max))
        };
        // Two metres to the ceiling, half a field of view of 400 and 300 over 400 pixels.
        let (s, x) = (range(0), range(1));
        assert!((x.0 - 3.5).abs() < 1e-9 && (x.1 - 6.5).abs() < 1e-9, "{x:?}");
        assert!((s.1 - s.0 - 4.0).abs() < 1e-9, "{s:?}");
    }

    #[test]
    fn the_camera_is_read_as_it_is_written() {
        let line = "1 FULL_OPENCV 1000 750 466 467 503.5 373 -0.04 0.006 0.001 0.002 0.003 0 0 0";
        let camera = parse_camera(line).unwrap();
        assert_eq!(camera.distortion, Distortion::BrownConrady([-0.04, 0.006, 0.001, 0.002, 0.003]));
        assert_eq!((camera.width_px, camera.focal_px[1]), (1000, 467.0));
        assert!(parse_camera("1 PINHOLE 1000 750 466 467 503.5 373").is_none());
    }
}
