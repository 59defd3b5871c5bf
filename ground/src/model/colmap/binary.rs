//! The same model as COLMAP's binary files, little-endian, for programs that read nothing else, and for large surveys.
//!
//! Format: COLMAP documentation, "Output Format", binary; order and types as in its `scene/reconstruction_io_binary.cc`.

use std::fs::File;
use std::io::{self, BufWriter, Write};
use std::path::Path;

use super::{ColmapError, camera_parameters, rms_px};
use crate::adjust::Observation;
use crate::poses::{PhotoPose, Reconstruction};

/// One of the model's files: its name and what writes it.
type Part = (&'static str, fn(&Reconstruction, &mut BufWriter<File>) -> io::Result<()>);

/// Writes `cameras.bin`, `images.bin` and `points3D.bin` to `folder`.
///
/// # Errors
/// [`ColmapError`] names the file.
pub fn write_binary(reconstruction: &Reconstruction, folder: &Path) -> Result<(), ColmapError> {
    std::fs::create_dir_all(folder).map_err(|source| ColmapError { path: folder.to_owned(), source })?;
    let parts: [Part; 3] = [("cameras.bin", cameras), ("images.bin", images), ("points3D.bin", points)];
    for (name, write) in parts {
        let path = folder.join(name);
        let file = File::create(&path).map(BufWriter::new);
        file.and_then(|mut file| write(reconstruction, &mut file).and_then(|()| file.flush()))
            .map_err(|source| ColmapError { path, source })?;
    }
    Ok(())
}

fn put_f64(file: &mut impl Write, values: impl IntoIterator<Item = f64>) -> io::Result<()> {
    values.into_iter().try_for_each(|value| file.write_all(&value.to_le_bytes()))
}

fn put_u64(file: &mut impl Write, value: usize) -> io::Result<()> {
    file.write_all(&(value as u64).to_le_bytes())
}

/// Number, then per camera: identifier, model's number, width, height, parameters.
fn cameras(reconstruction: &Reconstruction, file: &mut BufWriter<File>) -> io::Result<()> {
    let camera = &reconstruction.camera;
    let (model, parameters) = camera_parameters(camera);
    put_u64(file, 1)?;
    file.write_all(&1_u32.to_le_bytes())?;
    file.write_all(&model.number.to_le_bytes())?;
    put_u64(file, camera.width_px as usize)?;
    put_u64(file, camera.height_px as usize)?;
    put_f64(file, parameters)
}

/// Number, then per photo: identifier, `cam_from_world` as quaternion (w first) and translation, camera, name, sightings.
fn images(reconstruction: &Reconstruction, file: &mut BufWriter<File>) -> io::Result<()> {
    let mut seen: Vec<Vec<(Observation, usize)>> = vec![Vec::new(); reconstruction.poses.len()];
    for (index, (_, sightings)) in reconstruction.tracks.iter().enumerate() {
        for sighting in sightings {
            seen[sighting.photo as usize].push((*sighting, index + 1));
        }
    }
    put_u64(file, reconstruction.poses.len())?;
    for (index, (pose, seen)) in reconstruction.poses.iter().zip(&seen).enumerate() {
        file.write_all(&(index as u32 + 1).to_le_bytes())?;
        put_f64(file, cam_from_world(pose))?;
        file.write_all(&1_u32.to_le_bytes())?;
        file.write_all(pose.photo.as_bytes())?;
        file.write_all(&[0])?;
        put_u64(file, seen.len())?;
        for (sighting, point) in seen {
            put_f64(file, sighting.pixel.map(f64::from))?;
            put_u64(file, *point)?;
        }
    }
    Ok(())
}

fn cam_from_world(pose: &PhotoPose) -> [f64; 7] {
    let cam_from_tunnel = pose.tunnel_from_cam.inverse();
    let (q, t) = (cam_from_tunnel.rotation, cam_from_tunnel.translation.vector);
    [q.w, q.i, q.j, q.k, t.x, t.y, t.z]
}

/// Number, then per point: identifier, position, colour, error, track as pairs (photo, number of the sighting in it).
fn points(reconstruction: &Reconstruction, file: &mut BufWriter<File>) -> io::Result<()> {
    let mut counts = vec![0_u32; reconstruction.poses.len()];
    put_u64(file, reconstruction.tracks.len())?;
    for (index, (position, sightings)) in reconstruction.tracks.iter().enumerate() {
        put_u64(file, index + 1)?;
        put_f64(file, <[f64; 3]>::from(position.coords))?;
        file.write_all(&super::POINT_COLOUR)?;
        put_f64(file, [rms_px(reconstruction, position, sightings)])?;
        put_u64(file, sightings.len())?;
        for sighting in sightings {
            let place = &mut counts[sighting.photo as usize];
            file.write_all(&(sighting.photo + 1).to_le_bytes())?;
            file.write_all(&place.to_le_bytes())?;
            *place += 1;
        }
    }
    Ok(())
}
