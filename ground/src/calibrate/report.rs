//! The figures of a calibration, for people and for programs.

use std::fmt;

use adit_geometry::camera::{Camera, Distortion};
use adit_protocol::mission::CameraConfig;
use serde::Serialize;

use super::coverage::tilt_deg;
use super::fit::{Fit, IntrinsicSigmas, Sigmas, model_of};
use super::{Board, Calibration, Coverage, Hint, Model, Pattern};

/// What is printed and kept as calibration.json.
#[derive(Clone, Debug, Serialize)]
pub struct CalibrationFigures {
    /// Inner corners in a row and in a column, and the edge of a square.
    pub board: Board,
    /// Size of the photos.
    pub width_px: u32,
    /// See `width_px`.
    pub height_px: u32,
    /// Photos looked at.
    pub photos_found: usize,
    /// The camera with the model asked for; `None` if there is none.
    pub camera: Option<CameraFigures>,
    /// The same photos with the other model.
    pub other_model: Option<CameraFigures>,
    /// Every photo.
    pub photos: Vec<PhotoFigures>,
    /// Where corners were seen.
    pub coverage: Coverage,
    /// What to mind, and to photograph in addition.
    pub hints: Vec<Hint>,
    /// The table `[camera]` for survey.toml and mission.toml.
    pub camera_toml: Option<String>,
}

/// A fitted camera.
#[derive(Clone, Debug, Serialize)]
pub struct CameraFigures {
    /// Its model.
    pub model: Model,
    /// Root mean square distance of corners from where the camera sees them.
    pub rms_px: f64,
    /// Photos used.
    pub photos_used: usize,
    /// Intrinsics.
    pub fx_px: f64,
    /// See `fx_px`.
    pub fy_px: f64,
    /// Principal point, (0.5, 0.5) = centre of the first pixel.
    pub cx_px: f64,
    /// See `cx_px`.
    pub cy_px: f64,
    /// Distortion in the model's order.
    pub distortion: Vec<f64>,
    /// One standard deviation of each.
    pub sigma: Sigmas,
}

/// One photo.
#[derive(Clone, Debug, Serialize)]
pub struct PhotoFigures {
    /// Its name.
    pub photo: String,
    /// Why it was not used; `None` if it was.
    pub unused: Option<String>,
    /// Corners that were used, of those found.
    pub corners_used: Option<usize>,
    /// Corners found.
    pub corners_found: usize,
    /// Root mean square error of its corners.
    pub rms_px: Option<f64>,
    /// Distance of the board's first corner.
    pub distance_m: Option<f64>,
    /// Turn of the board about the photo's upright axis.
    pub turned_deg: Option<f64>,
    /// Tip of the board about the photo's level axis.
    pub tipped_deg: Option<f64>,
}

impl Calibration {
    /// The figures of this calibration.
    pub fn figures(&self) -> CalibrationFigures {
        let photos = self.photos.iter().enumerate().map(|(index, photo)| {
            let fitted = self.fit.as_ref().and_then(|fit| fit.photos.iter().find(|fitted| fitted.index == index));
            let tilt = fitted.map(|fitted| tilt_deg(&fitted.cam_from_board));
            PhotoFigures {
                photo: photo.name.clone(),
                unused: photo.unused.as_ref().map(ToString::to_string),
                corners_used: fitted.map(|fitted| fitted.corners),
                corners_found: photo.corners.len(),
                rms_px: fitted.map(|fitted| fitted.rms_px),
                distance_m: fitted.map(|fitted| fitted.cam_from_board.translation.vector.norm()),
                turned_deg: tilt.map(|[turned, _]| turned),
                tipped_deg: tilt.map(|[_, tipped]| tipped),
            }
        });
        CalibrationFigures {
            board: self.board,
            width_px: self.size.width_px,
            height_px: self.size.height_px,
            photos_found: self.photos.len(),
            camera: self.fit.as_ref().map(camera_figures),
            other_model: self.other_fit.as_ref().map(camera_figures),
            photos: photos.collect(),
            coverage: self.coverage.clone(),
            hints: self.hints.clone(),
            camera_toml: self.fit.as_ref().map(|fit| camera_toml(&fit.camera)),
        }
    }
}

fn camera_figures(fit: &Fit) -> CameraFigures {
    let camera = &fit.camera;
    CameraFigures {
        model: model_of(camera),
        rms_px: fit.rms_px,
        photos_used: fit.photos.len(),
        fx_px: camera.focal_px[0],
        fy_px: camera.focal_px[1],
        cx_px: camera.centre_px[0],
        cy_px: camera.centre_px[1],
        distortion: match &camera.distortion {
            Distortion::BrownConrady(k) => k.to_vec(),
            Distortion::KannalaBrandt(k) => k.to_vec(),
        },
        sigma: fit.sigmas,
    }
}

/// The table `[camera]`, in digits that are still a hundred times finer than any calibration.
fn camera_toml(camera: &Camera<f64>) -> String {
    let pixel = |value: f64| (value * 1e4).round() / 1e4;
    let small = |value: f64| (value * 1e8).round() / 1e8;
    let distortion = match camera.distortion {
        Distortion::BrownConrady(k) => Distortion::BrownConrady(k.map(small)),
        Distortion::KannalaBrandt(k) => Distortion::KannalaBrandt(k.map(small)),
    };
    let camera =
        Camera { focal_px: camera.focal_px.map(pixel), centre_px: camera.centre_px.map(pixel), distortion, ..*camera };
    CameraConfig { camera, refine: false, rolling_shutter_s: 0.0 }.to_toml()
}

impl fmt::Display for CalibrationFigures {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Board { columns, rows, square_m, pattern } = self.board;
        let used = self.photos.iter().filter(|photo| photo.unused.is_none()).count();
        write!(out, "board          {columns} x {rows} inner corners, squares of {} mm", square_m * 1000.0)?;
        match pattern {
            Pattern::Chessboard => writeln!(out)?,
            Pattern::Charuco(dictionary) => writeln!(out, " with markers of {0} x {0} cells", dictionary.side())?,
        }
        writeln!(
            out,
            "photos         {used} of {} used, {} x {} pixels",
            self.photos_found, self.width_px, self.height_px
        )?;
        if let Some(camera) = &self.camera {
            writeln!(out, "model          {}", model_name(camera.model))?;
            writeln!(out, "error          {:.4} px (root mean square over all corners)", camera.rms_px)?;
            table(out, camera)?;
        }
        if let Some(other) = &self.other_model {
            let CameraFigures { rms_px, photos_used, fx_px, fy_px, .. } = other;
            writeln!(
                out,
                "other model    {}: {rms_px:.4} px, {photos_used} photos, fx {fx_px:.2}, fy {fy_px:.2}",
                model_name(other.model)
            )?;
        }
        writeln!(
            out,
            "\n{:<24} {:>7} {:>8} {:>10} {:>8} {:>8}",
            "photo", "corners", "error px", "distance m", "turned", "tipped"
        )?;
        for photo in &self.photos {
            let name = &photo.photo;
            let PhotoFigures { corners_used, rms_px, distance_m, turned_deg, tipped_deg, unused, .. } = photo;
            match (corners_used, rms_px, distance_m, turned_deg, tipped_deg, unused) {
                (Some(corners), Some(rms_px), Some(distance_m), Some(turned), Some(tipped), None) => {
                    writeln!(
                        out,
                        "{name:<24} {corners:>7} {rms_px:>8.3} {distance_m:>10.3} {turned:>8.1} {tipped:>8.1}"
                    )?;
                }
                _ => writeln!(out, "{name:<24} not used: {}", unused.as_deref().unwrap_or_default())?,
            }
        }
        if !self.hints.is_empty() {
            writeln!(out)?;
        }
        for hint in &self.hints {
            writeln!(out, "hint: {hint}")?;
        }
        match &self.camera_toml {
            Some(toml) => write!(out, "\n{toml}"),
            None => Ok(()),
        }
    }
}

/// Each intrinsic with its two standard deviations.
fn table(out: &mut fmt::Formatter<'_>, camera: &CameraFigures) -> fmt::Result {
    writeln!(out, "{:<14} {:>12} {:>10} {:>10}", "", "value", "formal", "jackknife")?;
    let Sigmas { formal, jackknife } = &camera.sigma;
    let [fx, fy] = [camera.fx_px, camera.fy_px];
    let [cx, cy] = [camera.cx_px, camera.cy_px];
    let pair = |sigmas: &IntrinsicSigmas| [sigmas.focal_px, sigmas.centre_px].concat();
    let names = ["fx_px", "fy_px", "cx_px", "cy_px"];
    for (((name, value), formal), jackknife) in
        names.iter().zip([fx, fy, cx, cy]).zip(pair(formal)).zip(pair(jackknife))
    {
        writeln!(out, "{name:<14} {value:>12.3} {formal:>10.3} {jackknife:>10.3}")?;
    }
    let names: &[&str] = match camera.model {
        Model::BrownConrady => &["k1", "k2", "p1", "p2", "k3"],
        Model::KannalaBrandt => &["k1", "k2", "k3", "k4"],
    };
    let rows = names.iter().zip(&camera.distortion).zip(formal.distortion).zip(jackknife.distortion);
    for (((name, value), formal), jackknife) in rows {
        writeln!(out, "{name:<14} {value:>12.6} {formal:>10.6} {jackknife:>10.6}")?;
    }
    Ok(())
}

/// The model's name in survey.toml.
pub(super) fn model_name(model: Model) -> &'static str {
    match model {
        Model::BrownConrady => "brown-conrady",
        Model::KannalaBrandt => "kannala-brandt",
    }
}
