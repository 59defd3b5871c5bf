//! COLMAP's model: cameras, images and points3D as text or binary files, in the tunnel frame and metres.
//!
//! COLMAP stores `cam_from_world` and puts (0.5, 0.5) at the first pixel's centre, as we do. Format: COLMAP documentation,
//! "Output Format", text.

mod binary;

use std::fmt::Write as _;
use std::path::{Path, PathBuf};

use adit_geometry::camera::{Camera, Distortion};
use nalgebra::{Point3, Vector2};

use crate::adjust::Observation;
use crate::poses::Reconstruction;

pub use binary::write_binary;

/// Colours of points are not looked up.
const POINT_COLOUR: [u8; 3] = [128; 3];

/// A file of the model cannot be written.
#[derive(Debug, thiserror::Error)]
#[error("cannot write {}", path.display())]
pub struct ColmapError {
    /// The file.
    pub path: PathBuf,
    /// What the system said.
    pub source: std::io::Error,
}

/// Writes `cameras.txt`, `images.txt` and `points3D.txt` to `folder`.
///
/// # Errors
/// [`ColmapError`] names the file.
pub fn write(reconstruction: &Reconstruction, folder: &Path) -> Result<(), ColmapError> {
    std::fs::create_dir_all(folder).map_err(|source| ColmapError { path: folder.to_owned(), source })?;
    let files = [
        ("cameras.txt", cameras(&reconstruction.camera)),
        ("images.txt", images(reconstruction)),
        ("points3D.txt", points(reconstruction)),
    ];
    for (name, content) in files {
        let path = folder.join(name);
        std::fs::write(&path, content).map_err(|source| ColmapError { path, source })?;
    }
    Ok(())
}

/// One of COLMAP's camera models, as in its `sensor/models.h`.
struct CameraModel {
    name: &'static str,
    number: i32,
}

/// The model that a camera is, and its parameters in COLMAP's order.
fn camera_parameters(camera: &Camera<f64>) -> (CameraModel, Vec<f64>) {
    let (name, number, distortion) = match camera.distortion {
        Distortion::BrownConrady([k1, k2, p1, p2, 0.0]) => ("OPENCV", 4, vec![k1, k2, p1, p2]),
        Distortion::BrownConrady([k1, k2, p1, p2, k3]) => ("FULL_OPENCV", 6, vec![k1, k2, p1, p2, k3, 0.0, 0.0, 0.0]),
        Distortion::KannalaBrandt(k) => ("OPENCV_FISHEYE", 5, k.to_vec()),
    };
    let parameters = camera.focal_px.into_iter().chain(camera.centre_px).chain(distortion).collect();
    (CameraModel { name, number }, parameters)
}

fn cameras(camera: &Camera<f64>) -> String {
    let (model, parameters) = camera_parameters(camera);
    let parameters: Vec<String> = parameters.iter().map(f64::to_string).collect();
    let Camera { width_px, height_px, .. } = camera;
    format!(
        "# CAMERA_ID, MODEL, WIDTH, HEIGHT, PARAMS[]\n\
         1 {} {width_px} {height_px} {}\n",
        model.name,
        parameters.join(" ")
    )
}

/// Two lines per photo: pose, then its sightings as `X Y POINT3D_ID`.
fn images(reconstruction: &Reconstruction) -> String {
    let mut sightings = vec![String::new(); reconstruction.poses.len()];
    for (index, (_, seen)) in reconstruction.tracks.iter().enumerate() {
        for sighting in seen {
            let [x, y] = sighting.pixel;
            // Writing to a string cannot fail.
            let _ = write!(sightings[sighting.photo as usize], "{x:.3} {y:.3} {} ", index + 1);
        }
    }
    let mut text =
        "# IMAGE_ID, QW, QX, QY, QZ, TX, TY, TZ, CAMERA_ID, NAME\n# POINTS2D[] as (X, Y, POINT3D_ID)\n".to_owned();
    for (index, pose) in reconstruction.poses.iter().enumerate() {
        let cam_from_tunnel = pose.tunnel_from_cam.inverse();
        let (q, t) = (cam_from_tunnel.rotation, cam_from_tunnel.translation.vector);
        let _ = writeln!(
            text,
            "{} {:.9} {:.9} {:.9} {:.9} {:.6} {:.6} {:.6} 1 {}\n{}",
            index + 1,
            q.w,
            q.i,
            q.j,
            q.k,
            t.x,
            t.y,
            t.z,
            pose.photo,
            sightings[index].trim_end()
        );
    }
    text
}

/// One line per point.
fn points(reconstruction: &Reconstruction) -> String {
    let mut seen: std::collections::HashMap<u32, usize> = std::collections::HashMap::new();
    let mut text = "# POINT3D_ID, X, Y, Z, R, G, B, ERROR, TRACK[] as (IMAGE_ID, POINT2D_IDX)\n".to_owned();
    for (index, (p, sightings)) in reconstruction.tracks.iter().enumerate() {
        let error_px = rms_px(reconstruction, p, sightings);
        let [red, green, blue] = POINT_COLOUR;
        let _ = write!(text, "{} {:.6} {:.6} {:.6} {red} {green} {blue} {error_px:.4}", index + 1, p.x, p.y, p.z);
        for sighting in sightings {
            let place = seen.entry(sighting.photo).or_default();
            let _ = write!(text, " {} {place}", sighting.photo + 1);
            *place += 1;
        }
        text.push('\n');
    }
    text
}

/// Root mean square reprojection error of a point.
fn rms_px(reconstruction: &Reconstruction, position: &Point3<f64>, seen: &[Observation]) -> f64 {
    let squared = seen.iter().map(|seen| {
        let in_cam = reconstruction.poses[seen.photo as usize].tunnel_from_cam.inverse_transform_point(position).coords;
        let pixel = Vector2::from(seen.pixel.map(f64::from));
        reconstruction.camera.project(&in_cam).map_or(0.0, |projected| (projected - pixel).norm_squared())
    });
    (squared.sum::<f64>() / seen.len().max(1) as f64).sqrt()
}

#[cfg(test)]
mod tests {
    use adit_geometry::profile::ProfileSpec;
    use nalgebra::{Isometry3, Point3, Quaternion, UnitQuaternion, Vector3};

    use super::*;
    use crate::adjust::{PhotoQuality, Tracks};
    use crate::poses::{PhotoPose, PoseStatus};

    fn reconstruction() -> Reconstruction {
        let pose = |photo: &str, x: f64| PhotoPose {
            photo: photo.to_owned(),
            tunnel_from_cam: Isometry3::new(Vector3::new(x, 0.1, -0.2), Vector3::new(0.3, -0.2, 0.1 + x)),
            position_sigma_m: [0.001; 3],
            rotation_sigma_rad: [0.001; 3],
            status: PoseStatus::Adjusted,
            quality: PhotoQuality::default(),
        };
        let camera = Camera {
            width_px: 1000,
            height_px: 750,
            focal_px: [466.0, 466.0],
            centre_px: [503.0, 373.0],
            distortion: Distortion::BrownConrady([-0.04, 0.006, 0.0, 0.0, 0.0]),
        };
        let poses = vec![pose("GOPR0001.JPG", 0.0), pose("GOPR0002.JPG", 0.1)];
        let position = poses[0].tunnel_from_cam * Point3::new(0.2, -0.1, 3.0);
        let sightings = poses.iter().enumerate().map(|(photo, pose)| {
            let pixel = camera.project(&pose.tunnel_from_cam.inverse_transform_point(&position).coords).unwrap();
            Observation { photo: photo as u32, pixel: [pixel.x as f32, pixel.y as f32] }
        });
        let mut tracks = Tracks::default();
        tracks.push(position, sightings);
        Reconstruction { poses, tracks, camera, profile: ProfileSpec::Circle { radius_m: 3.0 } }
    }

    /// Reads the text back by the format's own rules and projects with COLMAP's OPENCV model.
    #[test]
    fn a_point_read_back_projects_onto_its_sightings() {
        let reconstruction = reconstruction();
        let numbers = |line: &str| -> Vec<f64> { line.split(' ').filter_map(|word| word.parse().ok()).collect() };
        let camera_text = cameras(&reconstruction.camera);
        let camera_line = camera_text.lines().nth(1).unwrap();
        assert!(camera_line.starts_with("1 OPENCV 1000 750 "));
        let camera = numbers(camera_line);
        let points_text = points(&reconstruction);
        let point_line = numbers(points_text.lines().nth(1).unwrap());
        let point = Vector3::new(point_line[1], point_line[2], point_line[3]);
        let text = images(&reconstruction);
        let lines: Vec<&str> = text.lines().skip(2).collect();
        for photo in 0..2 {
            let pose = numbers(lines[2 * photo]);
            let rotation = UnitQuaternion::from_quaternion(Quaternion::new(pose[1], pose[2], pose[3], pose[4]));
            let in_cam = rotation * point + Vector3::new(pose[5], pose[6], pose[7]);
            let (u, v) = (in_cam.x / in_cam.z, in_cam.y / in_cam.z);
            let r2 = u * u + v * v;
            let radial = 1.0 + camera[7] * r2 + camera[8] * r2 * r2;
            let seen = numbers(lines[2 * photo + 1]);
            assert!((camera[3] * u * radial + camera[5] - seen[0]).abs() < 2e-2);
            assert!((camera[4] * v * radial + camera[6] - seen[1]).abs() < 2e-2);
        }
    }
}
