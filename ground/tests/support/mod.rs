//! The rendered sample sets with their exact poses, for tests and benches of the matching.

use std::fs;
use std::path::{Path, PathBuf};

use adit_geometry::camera::{Camera, Distortion};
use adit_geometry::profile::{Profile, ProfileSpec};
use adit_ground::matching::{Pixels, ViewPose};
use adit_ground::raster::{Luma, Mask};
use nalgebra::{Isometry3, Quaternion, Translation3, UnitQuaternion, Vector3};
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, Normal};
use rayon::prelude::*;
use zune_jpeg::JpegDecoder;
use zune_jpeg::zune_core::bytestream::ZCursor;
use zune_jpeg::zune_core::colorspace::ColorSpace;
use zune_jpeg::zune_core::options::DecoderOptions;

/// A sample set in memory.
pub(crate) struct Sample {
    /// The section.
    pub(crate) profile: Profile<f64>,
    /// The camera, the same for all three sets.
    pub(crate) camera: Camera<f64>,
    /// Exact poses.
    pub(crate) truth: Vec<Isometry3<f64>>,
    /// Decoded photos.
    pub(crate) photos: Vec<Pixels>,
}

/// The folder of the sample sets, found by walking up from this crate.
pub(crate) fn samples() -> Option<PathBuf> {
    Path::new(env!("CARGO_MANIFEST_DIR")).ancestors().map(|up| up.join("shared/samples")).find(|dir| dir.is_dir())
}

/// Reads the first `count` photos of a set; `None` (said on stderr) if the samples are not there.
pub(crate) fn load(name: &str, count: usize) -> Option<Sample> {
    let Some(folder) = samples().map(|samples| samples.join(name)).filter(|folder| folder.is_dir()) else {
        eprintln!("skipped: no shared/samples/{name}");
        return None;
    };
    let spec = if name.starts_with("underpass") {
        ProfileSpec::Underpass { width_m: 4.0, wall_m: 2.5, rise_m: 1.0, axis_height_m: 1.4 }
    } else {
        ProfileSpec::Circle { radius_m: 3.0 }
    };
    let camera = Camera {
        width_px: 1000,
        height_px: 750,
        focal_px: [466.0, 466.0],
        centre_px: [503.0, 373.0],
        distortion: Distortion::BrownConrady([-0.04, 0.006, 0.0, 0.0, 0.0]),
    };
    let text = fs::read_to_string(folder.join("truth/poses.csv")).expect("truth/poses.csv");
    let rows: Vec<(String, Isometry3<f64>)> = text.lines().skip(1).take(count).map(pose).collect();
    let photos = rows.par_iter().map(|(photo, _)| pixels(&folder, photo)).collect();
    let truth = rows.into_iter().map(|(_, pose)| pose).collect();
    Some(Sample { profile: spec.build().expect("a valid profile"), camera, truth, photos })
}

fn pose(line: &str) -> (String, Isometry3<f64>) {
    let mut cells = line.split(',');
    let photo = cells.next().expect("a photo").to_owned();
    let v: Vec<f64> = cells.map(|cell| cell.trim().parse().expect("a number")).collect();
    let rotation = UnitQuaternion::from_quaternion(Quaternion::new(v[0], v[1], v[2], v[3]));
    (photo, Isometry3::from_parts(Translation3::new(v[4], v[5], v[6]), rotation))
}

fn pixels(folder: &Path, photo: &str) -> Pixels {
    let options = DecoderOptions::default().jpeg_set_out_colorspace(ColorSpace::Luma);
    let bytes = fs::read(folder.join("photos").join(photo)).expect("a photo");
    let mut decoder = JpegDecoder::new_with_options(ZCursor::new(bytes), options);
    let data = decoder.decode().expect("a JPEG");
    let (width, height) = decoder.dimensions().expect("a size");
    let grey = Luma { width, height, data };
    let Ok(file) = fs::File::open(folder.join("masks").join(format!("{photo}.png"))) else {
        return Pixels::new(grey);
    };
    let mut reader = png::Decoder::new(std::io::BufReader::new(file)).read_info().expect("a PNG");
    let mut data = vec![0; reader.output_buffer_size().expect("a size")];
    reader.next_frame(&mut data).expect("a PNG");
    Pixels::with_mask(grey, &Mask { width, height, data }).expect("a mask of the photo's size")
}

impl Sample {
    /// Poses off the truth by normal errors of the given standard deviations per axis, reproducible by `seed`.
    pub(crate) fn perturbed(&self, position_sigma_m: f64, rotation_sigma_rad: f64, seed: u64) -> Vec<ViewPose> {
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        let normal = Normal::new(0.0, 1.0).expect("a positive sigma");
        let mut draw = |sigma: f64| Vector3::from_fn(|_, _| sigma * normal.sample(&mut rng));
        let mut perturb = |pose: &Isometry3<f64>| {
            let translation = Translation3::from(pose.translation.vector + draw(position_sigma_m));
            let rotation = pose.rotation * UnitQuaternion::from_scaled_axis(draw(rotation_sigma_rad));
            let tunnel_from_cam = Isometry3::from_parts(translation, rotation);
            ViewPose {
                tunnel_from_cam,
                position_sigma_m: [position_sigma_m; 3],
                rotation_sigma_rad: [rotation_sigma_rad; 3],
                drift_m: 0.0,
            }
        };
        self.truth.iter().map(&mut perturb).collect()
    }
}
