//! A sample survey with its exact poses as a reconstruction, for tests and benches of the texture.

use std::fs;

use adit_ground::adjust::{PhotoQuality, Tracks};
use adit_ground::poses::{PhotoPose, PoseStatus, Reconstruction};
use adit_ground::surface::SurfaceStore;
use adit_ground::survey::{self, Survey};
use nalgebra::{Isometry3, Quaternion, Translation3, UnitQuaternion};

/// Loads the first `count` photos of a sample; `None` (said on stderr) if the samples are not there.
pub(crate) fn load_textured(name: &str, count: usize) -> Option<(Survey, Reconstruction)> {
    let Some(folder) = super::support::samples().map(|samples| samples.join(name)).filter(|folder| folder.is_dir())
    else {
        eprintln!("skipped: no shared/samples/{name}");
        return None;
    };
    let mut survey = survey::load(&folder).expect("a survey");
    survey.photos.truncate(count);
    let text = fs::read_to_string(folder.join("truth/poses.csv")).expect("truth/poses.csv");
    let poses = text.lines().skip(1).take(count).map(pose).collect();
    let (camera, profile) = (survey.config.camera.camera, survey.config.profile.clone());
    Some((survey, Reconstruction { poses, tracks: Tracks::default(), camera, profile }))
}

/// The section itself as the wall.
pub(crate) fn flat(reconstruction: &Reconstruction) -> SurfaceStore {
    SurfaceStore::flat(&reconstruction.profile).expect("a section")
}

fn pose(line: &str) -> PhotoPose {
    let cells: Vec<&str> = line.split(',').collect();
    let v: Vec<f64> = cells[1..].iter().map(|cell| cell.trim().parse().expect("a number")).collect();
    let rotation = UnitQuaternion::from_quaternion(Quaternion::new(v[0], v[1], v[2], v[3]));
    PhotoPose {
        photo: cells[0].to_owned(),
        tunnel_from_cam: Isometry3::from_parts(Translation3::new(v[4], v[5], v[6]), rotation),
        position_sigma_m: [1e-4; 3],
        rotation_sigma_rad: [1e-4; 3],
        status: PoseStatus::Adjusted,
        quality: PhotoQuality::default(),
    }
}
