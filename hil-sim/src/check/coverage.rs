//! What the photos of a flight truly saw of the wall, from their true poses.

use adit_geometry::camera::Camera;
use adit_geometry::profile::Profile;
use nalgebra::{Isometry3, Point3};

use crate::world::Exposure;

/// How the wall between two stations was seen.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Coverage {
    /// Cells looked at.
    pub cells: usize,
    /// Share of them seen by at least one photo.
    pub once: f64,
    /// Share of them seen by at least two photos.
    pub twice: f64,
}

/// Counts for cells of `cell_m` between the stations `from_x_m` and `to_x_m` how many photos saw their middles.
///
/// Model limits: the nominal profile, convex, so that nothing hides anything.
pub fn coverage(
    profile: &Profile<f64>,
    camera: &Camera<f64>,
    exposures: &[Exposure],
    [from_x_m, to_x_m]: [f64; 2],
    cell_m: f64,
) -> Coverage {
    let around = (profile.perimeter_m() / cell_m).ceil() as usize;
    let along = ((to_x_m - from_x_m) / cell_m).floor().max(0.0) as usize;
    let views: Vec<(f64, Isometry3<f64>)> = exposures
        .iter()
        .map(|exposure| (exposure.tunnel_from_cam.translation.x, exposure.tunnel_from_cam.inverse()))
        .collect();
    let (mut once, mut twice) = (0, 0);
    for line in 0..around {
        let Some(surface) = profile.at((line as f64 + 0.5) / around as f64 * profile.perimeter_m()) else { continue };
        // No photo of a wide-angle lens is used farther along the wall than four times its distance.
        let reach_m = 4.0 * surface.point.norm();
        for cell in 0..along {
            let x_m = from_x_m + (cell as f64 + 0.5) * cell_m;
            let point = Point3::new(x_m, surface.point.x, surface.point.y);
            let seen = views.iter().filter(|(cam_x_m, _)| (cam_x_m - x_m).abs() < reach_m).filter(|(_, cam)| {
                camera.project(&(cam * point).coords).is_some_and(|pixel| camera.contains(&pixel, 0.0))
            });
            let count = seen.take(2).count();
            once += usize::from(count >= 1);
            twice += usize::from(count >= 2);
        }
    }
    let cells = around * along;
    let share = |count: usize| if cells == 0 { 0.0 } else { count as f64 / cells as f64 };
    Coverage { cells, once: share(once), twice: share(twice) }
}
