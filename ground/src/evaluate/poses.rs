//! Estimated poses against true ones.

use std::collections::{HashMap, HashSet};

use nalgebra::{Isometry3, Point3, Similarity3, UnitQuaternion};
use serde::Serialize;

use super::align::similarity;
use super::drift::drift_mm_per_m;
use crate::poses::{PhotoPose, PoseStatus};

/// Figures of a set of errors.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct Spread {
    /// Root of the mean square.
    pub rmse: f64,
    /// Median.
    pub median: f64,
    /// 95th percentile.
    pub p95: f64,
    /// Largest.
    pub max: f64,
}

impl Spread {
    /// Returns the figures of `errors` (their sign does not matter); zeros for none.
    pub fn of(errors: impl IntoIterator<Item = f64>) -> Self {
        let mut sizes: Vec<f64> = errors.into_iter().map(f64::abs).collect();
        sizes.sort_by(f64::total_cmp);
        let Some(&max) = sizes.last() else { return Self::default() };
        let rmse = (sizes.iter().map(|e| e * e).sum::<f64>() / sizes.len() as f64).sqrt();
        let upper = sizes[sizes.len() / 2];
        let median =
            if sizes.len().is_multiple_of(2) { f64::midpoint(upper, sizes[sizes.len() / 2 - 1]) } else { upper };
        let p95 = sizes[((sizes.len() as f64 * 0.95) as usize).min(sizes.len() - 1)];
        Self { rmse, median, p95, max }
    }
}

/// Position and rotation errors in one frame.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct FrameErrors {
    /// Distance between estimated and true optical centres.
    pub position_mm: Spread,
    /// Angle between estimated and true orientation.
    pub rotation_deg: Spread,
    /// The photo with the largest position error.
    pub worst_photo: String,
}

/// Errors after the best similarity transform.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct AlignedErrors {
    /// The errors that are left.
    #[serde(flatten)]
    pub errors: FrameErrors,
    /// How much too large the reconstruction is.
    pub scale_error_percent: f64,
}

/// How the poses compare with the truth.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct PoseEvaluation {
    /// Photos in truth/poses.csv.
    pub photos: usize,
    /// Of these, photos with an adjusted pose. The errors below are theirs.
    pub registered: usize,
    /// Photos whose pose rests on the tag alone.
    pub prior_only: Vec<String>,
    /// Photos of the truth without any pose.
    pub missing: Vec<String>,
    /// Photos with a pose that the truth does not know.
    pub unknown: Vec<String>,
    /// Similarity-aligned; absent for fewer than three registered photos or photos on a line.
    pub aligned: Option<AlignedErrors>,
    /// In the tunnel frame without any alignment; absent without a registered photo.
    pub absolute: Option<FrameErrors>,
    /// Growth of the position error per metre of distance from the start, the reconstruction laid onto the truth at its
    /// first ten photos; absent for fewer than twenty photos, or less than a metre.
    pub drift_mm_per_m: Option<f64>,
}

/// Compares estimated poses with true ones.
pub(crate) fn compare_poses(estimated: &[PhotoPose], truth: &[PhotoPose]) -> PoseEvaluation {
    let names = Names::of(estimated.iter().map(|pose| (pose.photo.as_str(), pose)));
    let mut used = HashSet::new();
    let (mut pairs, mut prior_only, mut missing) = (Vec::new(), Vec::new(), Vec::new());
    for true_pose in truth {
        let Some(pose) = names.find(&true_pose.photo) else {
            missing.push(true_pose.photo.clone());
            continue;
        };
        used.insert(pose.photo.as_str());
        if pose.status == PoseStatus::PriorOnly {
            prior_only.push(pose.photo.clone());
        } else {
            pairs.push((pose.photo.as_str(), pose.tunnel_from_cam, true_pose.tunnel_from_cam));
        }
    }
    let unknown =
        estimated.iter().map(|pose| &pose.photo).filter(|photo| !used.contains(photo.as_str())).cloned().collect();
    let centre = |pose: &Isometry3<f64>| Point3::from(pose.translation.vector);
    let ours: Vec<Point3<f64>> = pairs.iter().map(|(_, estimated, _)| centre(estimated)).collect();
    let theirs: Vec<Point3<f64>> = pairs.iter().map(|(_, _, truth)| centre(truth)).collect();
    let truth_from_estimate = similarity(&ours, &theirs);
    let drift_mm_per_m = truth_from_estimate.and_then(|found| {
        let pairs: Vec<_> = pairs.iter().map(|(_, estimated, truth)| (*estimated, *truth)).collect();
        drift_mm_per_m(&pairs, found.scaling())
    });
    let aligned = truth_from_estimate.map(|truth_from_estimate| AlignedErrors {
        errors: errors_after(&truth_from_estimate, &pairs),
        scale_error_percent: (1.0 / truth_from_estimate.scaling() - 1.0) * 100.0,
    });
    let absolute = (!pairs.is_empty()).then(|| errors_after(&Similarity3::identity(), &pairs));
    PoseEvaluation {
        photos: truth.len(),
        registered: pairs.len(),
        prior_only,
        missing,
        unknown,
        aligned,
        absolute,
        drift_mm_per_m,
    }
}

/// What belongs to photos by the photo's name, with its folder or, where that is unique, without.
pub(super) struct Names<'a, T> {
    whole: HashMap<&'a str, &'a T>,
    file: HashMap<&'a str, Option<&'a T>>,
}

impl<'a, T> Names<'a, T> {
    pub(super) fn of(named: impl Iterator<Item = (&'a str, &'a T)>) -> Self {
        let (mut whole, mut file) = (HashMap::new(), HashMap::new());
        for (photo, item) in named {
            whole.insert(photo, item);
            file.entry(file_name(photo)).and_modify(|first| *first = None).or_insert(Some(item));
        }
        Self { whole, file }
    }

    pub(super) fn find(&self, photo: &str) -> Option<&'a T> {
        let whole = self.whole.get(photo).copied();
        whole.or_else(|| self.file.get(file_name(photo)).copied().flatten())
    }
}

/// The name without its folder.
fn file_name(photo: &str) -> &str {
    photo.rsplit('/').next().unwrap_or(photo)
}

/// Photo, estimated and true `tunnel_from_cam`.
type Pair<'a> = (&'a str, Isometry3<f64>, Isometry3<f64>);

fn errors_after(truth_from_estimate: &Similarity3<f64>, pairs: &[Pair<'_>]) -> FrameErrors {
    let turn: UnitQuaternion<f64> = truth_from_estimate.isometry.rotation;
    let errors: Vec<(&str, f64, f64)> = pairs
        .iter()
        .map(|(photo, estimated, truth)| {
            let centre = truth_from_estimate * Point3::from(estimated.translation.vector);
            let distance_mm = (centre.coords - truth.translation.vector).norm() * 1000.0;
            (*photo, distance_mm, (turn * estimated.rotation).angle_to(&truth.rotation).to_degrees())
        })
        .collect();
    let worst = errors.iter().max_by(|a, b| a.1.total_cmp(&b.1)).map_or("", |error| error.0);
    FrameErrors {
        position_mm: Spread::of(errors.iter().map(|error| error.1)),
        rotation_deg: Spread::of(errors.iter().map(|error| error.2)),
        worst_photo: worst.to_owned(),
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::{Translation3, Vector3};

    use super::*;

    fn spiral(count: usize) -> Vec<PhotoPose> {
        (0..count)
            .map(|i| {
                let t = i as f64 * 0.6;
                PhotoPose {
                    photo: format!("G{i}.JPG"),
                    tunnel_from_cam: Isometry3::from_parts(
                        Translation3::new(i as f64 * 0.1, t.cos() * 0.2, t.sin() * 0.2),
                        UnitQuaternion::from_scaled_axis(Vector3::new(t, 0.1, 0.0)),
                    ),
                    position_sigma_m: [0.0; 3],
                    rotation_sigma_rad: [0.0; 3],
                    status: PoseStatus::Adjusted,
                    quality: crate::adjust::PhotoQuality::default(),
                }
            })
            .collect()
    }

    #[test]
    fn a_moved_and_scaled_copy_has_no_aligned_error_but_an_absolute_one() {
        let truth = spiral(20);
        let mut estimated = truth.clone();
        let turn = UnitQuaternion::from_scaled_axis(Vector3::new(0.02, 0.0, 0.0));
        for pose in &mut estimated {
            let moved = turn * pose.tunnel_from_cam.translation.vector * 1.01 + Vector3::new(0.005, 0.0, 0.0);
            pose.tunnel_from_cam = Isometry3::from_parts(moved.into(), turn * pose.tunnel_from_cam.rotation);
        }
        let result = compare_poses(&estimated, &truth);
        let aligned = result.aligned.unwrap();
        assert!(aligned.errors.position_mm.max < 1e-6 && aligned.errors.rotation_deg.max < 1e-5);
        assert!((aligned.scale_error_percent - 1.0).abs() < 1e-9);
        let absolute = result.absolute.unwrap();
        assert!(absolute.position_mm.rmse > 5.0);
        assert!((absolute.rotation_deg.median - 0.02_f64.to_degrees()).abs() < 1e-6);
    }

    #[test]
    fn one_photo_that_is_off_is_named_as_the_worst() {
        let truth = spiral(20);
        let mut estimated = truth.clone();
        estimated[7].tunnel_from_cam.translation.vector.z += 0.02;
        let absolute = compare_poses(&estimated, &truth).absolute.unwrap();
        assert_eq!(absolute.worst_photo, "G7.JPG");
        assert!((absolute.position_mm.max - 20.0).abs() < 1e-9 && absolute.position_mm.median == 0.0);
        assert!((absolute.position_mm.rmse - 20.0 / 20.0_f64.sqrt()).abs() < 1e-9);
    }

    #[test]
    fn photos_that_are_not_registered_are_counted_and_named() {
        let truth = spiral(6);
        let mut estimated = truth.clone();
        estimated.remove(2);
        estimated[3].status = PoseStatus::PriorOnly;
        estimated.push(PhotoPose { photo: "X.JPG".to_owned(), ..truth[0].clone() });
        let result = compare_poses(&estimated, &truth);
        assert_eq!((result.photos, result.registered), (6, 4));
        assert_eq!(
            (result.missing, result.prior_only, result.unknown),
            (vec!["G2.JPG".to_owned()], vec!["G4.JPG".to_owned()], vec!["X.JPG".to_owned()])
        );
    }

    #[test]
    fn a_folder_in_front_of_a_name_makes_no_difference_where_the_name_is_unique() {
        let truth = spiral(4);
        let mut estimated = truth.clone();
        for pose in &mut estimated {
            pose.photo = format!("100GOPRO/{}", pose.photo);
        }
        assert_eq!(compare_poses(&estimated, &truth).registered, 4);
        estimated.push(PhotoPose { photo: "101GOPRO/G0.JPG".to_owned(), ..truth[0].clone() });
        assert_eq!(compare_poses(&estimated, &truth).missing, ["G0.JPG"]);
    }

    #[test]
    fn a_median_of_an_even_number_lies_between() {
        assert_eq!(Spread::of([4.0, -1.0, 2.0, 3.0]).median, 2.5);
        assert_eq!(Spread::of([]), Spread::default());
    }
}
