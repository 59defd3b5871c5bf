//! poses.json: poses, camera and section for programs that would rather not read CSV.

use std::fs::File;
use std::io::{BufWriter, Write};
use std::path::Path;

use adit_geometry::camera::{Camera, Distortion};
use serde_json::{Value, json};

use super::error::{ExportError, at_path};
use crate::poses::{PhotoPose, Reconstruction};
use crate::texture::profile_json;

/// Writes the file, a line per photo.
pub(super) fn write_json(path: &Path, reconstruction: &Reconstruction) -> Result<(), ExportError> {
    let write = || -> std::io::Result<()> {
        let mut file = BufWriter::new(File::create(path)?);
        writeln!(file, "{{\n\"format\": 1,\n\"program\": {:?},", concat!("adit ", env!("CARGO_PKG_VERSION")))?;
        writeln!(
            file,
            "\"frame\": {:?},",
            "tunnel: x forward along the axis, y right, z down, metres; cam: x right, y down, z forward"
        )?;
        writeln!(file, "\"camera\": {},", camera(&reconstruction.camera))?;
        writeln!(file, "\"tunnel\": {},\n\"photos\": [", profile_json(&reconstruction.profile))?;
        for (index, pose) in reconstruction.poses.iter().enumerate() {
            let separator = if index + 1 < reconstruction.poses.len() { "," } else { "" };
            writeln!(file, "{}{separator}", photo(pose))?;
        }
        writeln!(file, "]\n}}")?;
        file.flush()
    };
    write().map_err(at_path(path))
}

/// With the keys of survey.toml's `[camera]`.
fn camera(camera: &Camera<f64>) -> Value {
    let (model, distortion) = match camera.distortion {
        Distortion::BrownConrady(k) => ("brown-conrady", k.to_vec()),
        Distortion::KannalaBrandt(k) => ("kannala-brandt", k.to_vec()),
    };
    json!({
        "model": model,
        "width_px": camera.width_px,
        "height_px": camera.height_px,
        "fx_px": camera.focal_px[0],
        "fy_px": camera.focal_px[1],
        "cx_px": camera.centre_px[0],
        "cy_px": camera.centre_px[1],
        "distortion": distortion,
    })
}

/// Rotation and optical centre are `tunnel_from_cam`; w first and not negative, as in poses.csv.
fn photo(pose: &PhotoPose) -> Value {
    let q = pose.tunnel_from_cam.rotation.quaternion();
    let q = if q.w < 0.0 { -*q } else { *q };
    let centre = pose.tunnel_from_cam.translation.vector;
    json!({
        "photo": pose.photo,
        "status": pose.status,
        "tunnel_from_cam": { "quaternion_wxyz": [q.w, q.i, q.j, q.k], "position_m": [centre.x, centre.y, centre.z] },
        "sigma_position_m": pose.position_sigma_m,
        "sigma_rotation_deg": pose.rotation_sigma_rad.map(f64::to_degrees),
        "matches": pose.quality.observations,
        "rms_px": pose.quality.rms_px,
    })
}
