//! Photos of a chessboard or `ChArUco` board by a camera that is known exactly, for the calibration on the ground.
//!
//! Seed, model and size give one camera and its photos: a lens as a HERO4's, drawn anew for every seed, boards all over the
//! photo and tilted by turns, wholly in view or not. Beside the photos lies the truth: the camera, each board's pose and the exact pixels of its corners.

mod picture;
mod place;

use std::path::Path;

use adit_geometry::camera::{Camera, Distortion};
use adit_geometry::charuco::Dictionary;
use adit_protocol::mission::CameraConfig;
use nalgebra::{Isometry3, Vector2, Vector3};
use rayon::prelude::*;
use serde::Serialize;

use crate::render::card::{CardPlace, encode_photo, write_file};
use crate::render::{ExifTime, RenderError};
use crate::seed::{Random, Stream};
use picture::PictureOptions;

/// The folders of a set; another set must not mix with what one left there.
pub const BOARD_PARTS: [&str; 2] = ["DCIM", "truth"];
/// Inner corners in a row and in a column.
pub const CORNERS: [usize; 2] = [8, 6];
/// Edge of a square.
const SQUARE_M: f64 = 0.025;
/// When the camera says the first photo was taken: 17 May 2018, 9:00.
const FIRST_PHOTO: i64 = 1_526_547_600;
const JPEG_QUALITY: u8 = 95;

/// The lens's model.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, clap::ValueEnum)]
#[serde(rename_all = "kebab-case")]
pub enum LensModel {
    /// k1 k2 p1 p2 k3.
    BrownConrady,
    /// k1..k4 over the angle.
    KannalaBrandt,
}

/// What is asked for.
#[derive(Clone, Copy, Debug)]
pub struct BoardOptions {
    /// The lens's model.
    pub model: LensModel,
    /// The markers in the white squares, if any.
    pub charuco: Option<Dictionary>,
    /// Least share of a board's corners in view, 0..=1.
    pub in_view: f64,
    /// How many photos.
    pub photos: u32,
    /// Seed of camera, poses and noise.
    pub seed: u64,
    /// Width of the photos; height and lens follow.
    pub width_px: u32,
    /// Standard deviation of the lens's point spread.
    pub blur_px: f64,
    /// Standard deviation of the noise, of 255 levels.
    pub noise_levels: f64,
}

/// Why photos cannot be made.
#[derive(Debug, thiserror::Error)]
pub enum BoardError {
    /// A number out of its range.
    #[error("{name} is {value}; expected a number from 0 to {most}")]
    OutOfRange {
        /// Which.
        name: &'static str,
        /// What was given.
        value: f64,
        /// The largest accepted.
        most: f64,
    },
    /// A file.
    #[error(transparent)]
    Render(#[from] RenderError),
    /// The truth cannot be written as JSON.
    #[error("truth/board.json: {0}")]
    Json(#[from] serde_json::Error),
}

/// The truth about a set: the command's figures, and `truth/board.json`.
#[derive(Clone, Debug, Serialize)]
pub struct BoardTruth {
    /// Version of the format.
    pub format: u32,
    /// Name and version of the program.
    pub program: &'static str,
    /// The seed.
    pub seed: u64,
    /// Inner corners in a row and in a column.
    pub corners: [usize; 2],
    /// Edge of a square.
    pub square_m: f64,
    /// The markers in the white squares, if any.
    pub charuco: Option<Dictionary>,
    /// The camera: `fx fy cx cy`, then the distortion in the model's order.
    pub intrinsics: Vec<f64>,
    /// Its model.
    pub model: LensModel,
    /// Each photo.
    pub photos: Vec<TruePhoto>,
}

/// The truth about one photo.
#[derive(Clone, Debug, Serialize)]
pub struct TruePhoto {
    /// Its name on the card.
    pub photo: String,
    /// Where the board is: rotation vector and translation of `cam_from_board`.
    pub rotvec_rad: [f64; 3],
    /// See `rotvec_rad`.
    pub translation_m: [f64; 3],
    /// Exact pixels of the corners, row by row; null for those out of view.
    pub corners_px: Vec<Option<[f64; 2]>>,
}

/// Renders photos of a board into `out/DCIM` and the truth into `out/truth`; `after_each` is called after each photo.
///
/// # Errors
/// [`BoardError`] if blur or noise is out of its range or a file cannot be written.
pub fn make_board_photos(
    out: &Path,
    options: &BoardOptions,
    after_each: &(dyn Fn() + Sync),
) -> Result<BoardTruth, BoardError> {
    let ranges = [
        ("blur_px", options.blur_px, 5.0),
        ("noise_levels", options.noise_levels, 50.0),
        ("in_view", options.in_view, 1.0),
    ];
    for (name, value, most) in ranges {
        if !(0.0..=most).contains(&value) {
            return Err(BoardError::OutOfRange { name, value, most });
        }
    }
    let camera = camera(options);
    let mut random = Random::numbered(options.seed, Stream::Board, 1);
    let poses: Vec<Isometry3<f64>> = (0..options.photos as usize)
        .map(|index| place::cam_from_board(&camera, index, options.in_view, &mut random))
        .collect();
    let photos = poses.par_iter().enumerate().map(|(index, pose)| {
        let place = CardPlace::new(1, index as u32);
        let picture = PictureOptions {
            blur_px: options.blur_px as f32,
            noise_levels: options.noise_levels as f32,
            seed: crate::scene::noise::derive_seed(options.seed, index as u64),
        };
        let image = picture::photo(&camera, pose, options.charuco, &picture);
        let taken = ExifTime(FIRST_PHOTO + 10 * index as i64);
        write_file(&place.path_on(out), &encode_photo(&image, JPEG_QUALITY, 0.01, taken)?)?;
        after_each();
        Ok(TruePhoto {
            photo: place.name,
            rotvec_rad: pose.rotation.scaled_axis().into(),
            translation_m: pose.translation.vector.into(),
            corners_px: corners(&camera, pose).map(|corner| corner.map(Into::into)).collect(),
        })
    });
    let truth = BoardTruth {
        format: 1,
        program: concat!("adit-sim ", env!("CARGO_PKG_VERSION")),
        seed: options.seed,
        corners: CORNERS,
        square_m: SQUARE_M,
        charuco: options.charuco,
        intrinsics: intrinsics(&camera),
        model: options.model,
        photos: photos.collect::<Result<_, BoardError>>()?,
    };
    let config = CameraConfig { camera, refine: false, rolling_shutter_s: 0.0 };
    write_file(&out.join("truth/camera.toml"), config.to_toml().as_bytes())?;
    write_file(&out.join("truth/board.json"), serde_json::to_string_pretty(&truth)?.as_bytes())?;
    Ok(truth)
}

/// A lens as a HERO4's wide one at 4:3, with what makes one copy different from the next.
fn camera(options: &BoardOptions) -> Camera<f64> {
    let mut random = Random::new(options.seed, Stream::Board);
    let width_px = options.width_px;
    let height_px = width_px * 3 / 4;
    let width = f64::from(width_px);
    let focal_px = width * random.uniform(0.42, 0.47);
    let mut near = |middle: f64, share: f64| middle * (1.0 + random.uniform(-share, share));
    let focal_px = [focal_px, near(focal_px, 0.004)];
    let centre_px = [near(0.5 * width, 0.03), near(0.5 * f64::from(height_px), 0.03)];
    let distortion = match options.model {
        LensModel::BrownConrady => Distortion::BrownConrady([
            near(-0.24, 0.1),
            near(0.07, 0.1),
            near(0.0002, 2.0),
            near(0.0002, 2.0),
            near(-0.01, 0.1),
        ]),
        LensModel::KannalaBrandt => {
            Distortion::KannalaBrandt([near(0.06, 0.3), near(0.01, 0.5), near(-0.02, 0.3), near(0.01, 0.3)])
        }
    };
    Camera { width_px, height_px, focal_px, centre_px, distortion }
}

fn intrinsics(camera: &Camera<f64>) -> Vec<f64> {
    let distortion: &[f64] = match &camera.distortion {
        Distortion::BrownConrady(k) => k,
        Distortion::KannalaBrandt(k) => k,
    };
    [&camera.focal_px[..], &camera.centre_px, distortion].concat()
}

/// Exact pixels of a board's corners, row by row; `None` for those out of view.
fn corners(camera: &Camera<f64>, cam_from_board: &Isometry3<f64>) -> impl Iterator<Item = Option<Vector2<f64>>> {
    let [columns, rows] = CORNERS;
    (0..columns * rows).map(move |index| {
        let place = Vector3::new((index % columns) as f64, (index / columns) as f64, 0.0) * SQUARE_M;
        let seen = camera.project(&(cam_from_board.rotation * place + cam_from_board.translation.vector));
        seen.filter(|seen| camera.contains(seen, 0.0))
    })
}
