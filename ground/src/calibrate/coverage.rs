//! What the photos leave open: where no corner was seen, and from which sides the board was not.
//!
//! Distortion is known where corners were, and nowhere else; the focal length is known from tilted boards only (a board
//! that is parallel to the image may as well be larger and farther away).

use adit_geometry::camera::Camera;
use nalgebra::Vector2;
use serde::Serialize;
use serde::ser::SerializeStruct;

use super::fit::{Fit, model_of};
use super::report::model_name;
use super::{CalibrationPhoto, Model};
use crate::survey::Size;

/// Fewer corners than this leave a region open.
const FEW_CORNERS: usize = 8;
/// Photos below this are few: a bent board or one bad photo shows.
const FEW_PHOTOS: usize = 10;
/// Boards tilted by less say little of the focal length.
const TILT_DEG: f64 = 15.0;
/// Tilted photos needed in each of the two directions.
const TILTED_PHOTOS: usize = 2;
/// The corners should reach so far of the way to the photo's corners.
const REACH: f64 = 0.8;
/// The other model fits better if its error is below this share.
const BETTER: f64 = 0.97;
/// A focal length known worse costs millimetres of the poses (README, "Intrinsics").
const FOCAL_SHARE: f64 = 0.001;

/// A ninth of the photo.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
#[expect(missing_docs, reason = "the names say it")]
pub enum Region {
    UpperLeft,
    UpperMiddle,
    UpperRight,
    MiddleLeft,
    Middle,
    MiddleRight,
    LowerLeft,
    LowerMiddle,
    LowerRight,
}

const REGIONS: [Region; 9] = [
    Region::UpperLeft,
    Region::UpperMiddle,
    Region::UpperRight,
    Region::MiddleLeft,
    Region::Middle,
    Region::MiddleRight,
    Region::LowerLeft,
    Region::LowerMiddle,
    Region::LowerRight,
];

impl Region {
    fn name(self) -> &'static str {
        match self {
            Self::UpperLeft => "upper left",
            Self::UpperMiddle => "upper middle",
            Self::UpperRight => "upper right",
            Self::MiddleLeft => "left",
            Self::Middle => "middle",
            Self::MiddleRight => "right",
            Self::LowerLeft => "lower left",
            Self::LowerMiddle => "lower middle",
            Self::LowerRight => "lower right",
        }
    }
}

/// Where corners of the photos used were seen.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Coverage {
    /// Corners in each ninth of the photo, row by row.
    pub corners: [usize; 9],
    /// Distance of the farthest corner from the photo's middle, as a share of the way to the photo's corner.
    pub reach: f64,
    /// Photos used.
    pub photos: usize,
}

impl Coverage {
    /// Counts the corners of the photos that were used.
    pub(super) fn new(photos: &[CalibrationPhoto], size: Size) -> Self {
        let used = photos.iter().filter(|photo| photo.unused.is_none());
        let middle = Vector2::new(f64::from(size.width_px), f64::from(size.height_px)) / 2.0;
        let mut coverage = Self { corners: [0; 9], reach: 0.0, photos: 0 };
        for photo in used {
            coverage.photos += 1;
            for corner in photo.corners.iter().map(|corner| corner.pixel) {
                let third = |value: f64, half: f64| ((value / half * 1.5) as usize).min(2);
                coverage.corners[third(corner.y, middle.y) * 3 + third(corner.x, middle.x)] += 1;
                coverage.reach = coverage.reach.max((corner - middle).norm() / middle.norm());
            }
        }
        coverage
    }
}

/// Something to mind, or to photograph in addition. Serialised as its kind, its text and its figures.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
pub enum Hint {
    /// Few photos were used.
    #[error("{photos} photos were used; a dozen or two from different sides are better")]
    FewPhotos {
        /// Their number.
        photos: usize,
    },
    /// A part of the photo shows no corners.
    #[error("{} in the {}: photograph the board there", if *corners == 0 { "no corners".to_owned() } else { format!("only {corners} corners") }, region.name())]
    Empty {
        /// Which.
        region: Region,
        /// Corners seen there.
        corners: usize,
    },
    /// The photo's corners were not reached.
    #[error("no corners beyond {:.0} % of the way from the photo's middle to its corners: the distortion there is a guess", reach * 100.0)]
    Reach {
        /// How far they got.
        reach: f64,
    },
    /// The model ends within the photo.
    #[error("the model folds back {:.0} % of the way from the photo's middle to a corner: what lies beyond has no direction; kannala-brandt has no such end for a wide lens", reach * 100.0)]
    Folds {
        /// Where.
        reach: f64,
    },
    /// The board was hardly ever tilted to the left and right.
    #[error(
        "{photos} photos show the board turned by more than {TILT_DEG} degrees about an upright axis: photograph it from the left and the right"
    )]
    NotTurned {
        /// Photos that do.
        photos: usize,
    },
    /// The board was hardly ever tilted up and down.
    #[error(
        "{photos} photos show the board tipped by more than {TILT_DEG} degrees about a level axis: photograph it from above and below"
    )]
    NotTipped {
        /// Photos that do.
        photos: usize,
    },
    /// The focal length is not known well enough.
    #[error(
        "the focal length is known to {percent:.2} % only, by fits without one photo each; 0.1 % is what a survey needs"
    )]
    FocalLength {
        /// One standard deviation, percent.
        percent: f64,
    },
    /// Only the other model describes the lens.
    #[error("no {} camera shows the boards as they were seen; {} does, to {other_px:.3} px: ask for that", model_name(model.other()), model_name(*model))]
    OnlyOtherModel {
        /// The model that does.
        model: Model,
        /// Its root mean square error.
        other_px: f64,
    },
    /// The other model describes the lens better.
    #[error("{} fits better: {other_px:.3} px instead of {rms_px:.3} px", model_name(*model))]
    OtherModel {
        /// The better model.
        model: Model,
        /// Its root mean square error.
        other_px: f64,
        /// That of the model asked for.
        rms_px: f64,
    },
}

impl Serialize for Hint {
    fn serialize<S: serde::Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        let kind = match self {
            Self::FewPhotos { .. } => "few-photos",
            Self::Empty { .. } => "empty",
            Self::Reach { .. } => "reach",
            Self::Folds { .. } => "folds",
            Self::NotTurned { .. } => "not-turned",
            Self::NotTipped { .. } => "not-tipped",
            Self::FocalLength { .. } => "focal-length",
            Self::OnlyOtherModel { .. } => "only-other-model",
            Self::OtherModel { .. } => "other-model",
        };
        let mut hint = serializer.serialize_struct("Hint", 2)?;
        hint.serialize_field("kind", kind)?;
        hint.serialize_field("text", &self.to_string())?;
        hint.end()
    }
}

/// Everything to mind; where there is no camera only the number of photos, or the other model if that has one.
pub(super) fn hints(coverage: &Coverage, fit: Option<&Fit>, other: Option<&Fit>) -> Vec<Hint> {
    let mut hints = Vec::new();
    if let (None, Some(other)) = (fit, other) {
        return vec![Hint::OnlyOtherModel { model: model_of(&other.camera), other_px: other.rms_px }];
    }
    if coverage.photos < FEW_PHOTOS {
        hints.push(Hint::FewPhotos { photos: coverage.photos });
    }
    let Some(fit) = fit else { return hints };
    let open = REGIONS.into_iter().zip(coverage.corners).filter(|(_, corners)| *corners < FEW_CORNERS);
    hints.extend(open.map(|(region, corners)| Hint::Empty { region, corners }));
    if coverage.reach < REACH {
        hints.push(Hint::Reach { reach: coverage.reach });
    }
    let reach = model_reach(&fit.camera);
    if reach < 1.0 {
        hints.push(Hint::Folds { reach });
    }
    let tilts = || fit.photos.iter().map(|photo| tilt_deg(&photo.cam_from_board));
    let turned = tilts().filter(|[turned, _]| turned.abs() > TILT_DEG).count();
    let tipped = tilts().filter(|[_, tipped]| tipped.abs() > TILT_DEG).count();
    if turned < TILTED_PHOTOS {
        hints.push(Hint::NotTurned { photos: turned });
    }
    if tipped < TILTED_PHOTOS {
        hints.push(Hint::NotTipped { photos: tipped });
    }
    let share = fit.sigmas.jackknife.focal_px[0] / fit.camera.focal_px[0];
    if share > FOCAL_SHARE {
        hints.push(Hint::FocalLength { percent: share * 100.0 });
    }
    if let Some(other) = other.filter(|other| other.photos.len() == fit.photos.len())
        && other.rms_px < BETTER * fit.rms_px
    {
        hints.push(Hint::OtherModel { model: model_of(&other.camera), other_px: other.rms_px, rms_px: fit.rms_px });
    }
    hints
}

/// How far the model has a direction for pixels, on the ways from the photo's middle to its corners: 1 if all the way.
fn model_reach(camera: &Camera<f64>) -> f64 {
    const STEPS: u32 = 100;
    let size = Vector2::new(f64::from(camera.width_px), f64::from(camera.height_px));
    let corners = [Vector2::zeros(), Vector2::new(size.x, 0.0), Vector2::new(0.0, size.y), size];
    let shares = (1..=STEPS).map(|step| f64::from(step) / f64::from(STEPS));
    let ends =
        |share: &f64| corners.iter().any(|corner| camera.unproject(&(size * 0.5).lerp(corner, *share)).is_none());
    shares.take_while(|share| !ends(share)).last().unwrap_or(0.0)
}

/// How far a board is turned about the photo's upright axis and tipped about its level one, degrees.
pub(super) fn tilt_deg(cam_from_board: &nalgebra::Isometry3<f64>) -> [f64; 2] {
    let normal = cam_from_board.rotation * nalgebra::Vector3::z();
    [normal.x.atan2(normal.z), normal.y.atan2(normal.z)].map(f64::to_degrees)
}

#[cfg(test)]
mod tests {
    use super::super::Corner;
    use super::*;

    fn photo(corners: &[[f64; 2]]) -> CalibrationPhoto {
        CalibrationPhoto {
            name: "GOPR0001.JPG".to_owned(),
            path: "GOPR0001.JPG".into(),
            corners: corners.iter().map(|pixel| Corner { number: 0, pixel: Vector2::from(*pixel) }).collect(),
            unused: None,
        }
    }

    #[test]
    fn corners_are_counted_in_the_ninth_they_lie_in() {
        let size = Size { width_px: 900, height_px: 600 };
        let coverage = Coverage::new(&[photo(&[[10.0, 10.0], [450.0, 300.0], [899.0, 599.0], [890.0, 10.0]])], size);
        assert_eq!(coverage.corners, [1, 0, 1, 0, 1, 0, 0, 0, 1]);
        assert!((coverage.reach - 0.998).abs() < 0.002, "{coverage:?}");
    }

    #[test]
    fn without_a_camera_only_the_photos_are_hinted_at() {
        let coverage = Coverage { corners: [0; 9], reach: 0.0, photos: 2 };
        assert_eq!(hints(&coverage, None, None), [Hint::FewPhotos { photos: 2 }]);
    }

    #[test]
    fn the_end_of_a_model_that_folds_back_within_the_photo_is_found() {
        use adit_geometry::camera::Distortion;
        let distortion = Distortion::BrownConrady([-0.241177, 0.071318, 0.0, 0.0, -0.01045]);
        let hero4 =
            Camera { width_px: 1280, height_px: 960, focal_px: [561.0; 2], centre_px: [640.0, 480.0], distortion };
        // The radius is largest, 1.10 focal lengths, at a tangent of 1.76; the photo's corner is 1.43 away.
        let reach = model_reach(&hero4);
        assert!((0.74..0.80).contains(&reach), "{reach}");
        assert_eq!(
            model_reach(&Camera { distortion: Distortion::KannalaBrandt([0.06, 0.01, -0.02, 0.01]), ..hero4 }),
            1.0
        );
    }

    #[test]
    fn a_hint_says_where() {
        let text = Hint::Empty { region: Region::UpperLeft, corners: 0 }.to_string();
        assert_eq!(text, "no corners in the upper left: photograph the board there");
    }
}
