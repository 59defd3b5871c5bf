//! The exact bound on the step per image, computed a second time in another way than the board does.
//!
//! Method: for each of the `n` cameras of one turn (level, at the given offset) and each of many lines along the wall,
//! the stretch of the line that the camera sees is found by projecting points of it. A helix with step `d` repeats those
//! stretches every `n d`, each shifted by its camera's place; sweeping over one period counts how often each place is seen.
//! The bound is the largest step at which nothing is seen less often than asked. Model limits: convex sections (a camera
//! inside sees every point in its image), nominal mounting, a straight axis.

use adit_geometry::camera::Camera;
use adit_geometry::profile::Profile;
use adit_geometry::rig::Rig;
use nalgebra::{Point3, Translation3, Vector2};

/// Lines along the wall that are looked at.
const LINES: usize = 120;
/// Points of a line that are tried on each side of the camera.
const TRIED: usize = 60;
/// Steps longer than this are not considered.
const STEP_LIMIT_M: f64 = 5.0;

/// What one camera sees of one line: `[from, to]` along x, the camera at x = 0.
type Stretch = Option<[f64; 2]>;

/// Stretches of all lines, by line, then by camera of the turn.
#[derive(Clone, Debug)]
pub struct Footprints {
    lines: Vec<Vec<Stretch>>,
    images_per_turn: usize,
}

impl Footprints {
    /// Finds what the cameras of one turn see from `offset_m` in the section.
    pub fn new(profile: &Profile<f64>, camera: &Camera<f64>, rig: &Rig<f64>, offset_m: [f64; 2]) -> Self {
        let images_per_turn = usize::from(rig.images_per_turn);
        let turn = std::f64::consts::TAU;
        let cameras: Vec<_> = (0..images_per_turn)
            .map(|image| {
                let shaft_rad = image as f64 * turn / images_per_turn as f64;
                let place = Translation3::new(0.0, offset_m[0], offset_m[1]);
                (place * rig.body_from_cam(shaft_rad)).inverse()
            })
            .collect();
        let lines = (0..LINES)
            .filter_map(|line| profile.at(line as f64 / LINES as f64 * profile.perimeter_m()))
            .map(|surface| {
                let reach_m = 4.0 * (surface.point - Vector2::from(offset_m)).norm();
                let sees = |cam_from_tunnel: &nalgebra::Isometry3<f64>, x_m: f64| {
                    let point = cam_from_tunnel * Point3::new(x_m, surface.point.x, surface.point.y);
                    camera.project(&point.coords).is_some_and(|pixel| camera.contains(&pixel, 0.0))
                };
                cameras.iter().map(|cam| stretch(reach_m, |x_m| sees(cam, x_m))).collect()
            })
            .collect();
        Self { lines, images_per_turn }
    }

    /// The largest step per image at which every place is seen by at least `views` images; zero if there is none.
    pub fn longest_step_m(&self, views: usize) -> f64 {
        let (mut low, mut high) = (0.0, STEP_LIMIT_M);
        for _ in 0..24 {
            let middle = 0.5 * (low + high);
            if self.covers(middle, views) { low = middle } else { high = middle }
        }
        low
    }

    fn covers(&self, step_m: f64, views: usize) -> bool {
        let period_m = step_m * self.images_per_turn as f64;
        self.lines.iter().all(|line| {
            let placed = line.iter().enumerate().filter_map(|(image, stretch)| {
                stretch.map(|[from, to]| [from + image as f64 * step_m, to + image as f64 * step_m])
            });
            least_covered(placed, period_m) >= views
        })
    }
}

/// The stretch around x = 0 at whose points `sees` holds, found by trying and halving; `None` if nothing is seen.
fn stretch(reach_m: f64, sees: impl Fn(f64) -> bool) -> Stretch {
    let place = |index: usize| (index as f64 / TRIED as f64 - 1.0) * reach_m;
    let first = (0..=2 * TRIED).find(|&index| sees(place(index)))?;
    let last = (0..=2 * TRIED).rfind(|&index| sees(place(index)))?;
    let edge = |mut outside: f64, mut inside: f64| {
        for _ in 0..20 {
            let middle = 0.5 * (outside + inside);
            if sees(middle) { inside = middle } else { outside = middle }
        }
        inside
    };
    Some([
        edge(place(first) - reach_m / TRIED as f64, place(first)),
        edge(place(last) + reach_m / TRIED as f64, place(last)),
    ])
}

/// How often the least covered place of a period is covered by the stretches and their repetitions.
fn least_covered(stretches: impl Iterator<Item = [f64; 2]>, period_m: f64) -> usize {
    let mut everywhere = 0_usize;
    let mut changes: Vec<(f64, i32)> = Vec::new();
    let mut open = 0_i32;
    for [from, to] in stretches {
        let length_m = to - from;
        everywhere += (length_m / period_m) as usize;
        let rest_m = length_m % period_m;
        let start = from.rem_euclid(period_m);
        let end = start + rest_m;
        changes.push((start, 1));
        if end >= period_m {
            open += 1;
            changes.push((end - period_m, -1));
        } else {
            changes.push((end, -1));
        }
    }
    // At the same place, what begins counts before what ends.
    changes.sort_by(|a, b| a.0.total_cmp(&b.0).then(b.1.cmp(&a.1)));
    let mut least = open;
    for (_, change) in changes {
        open += change;
        least = least.min(open);
    }
    everywhere + usize::try_from(least).unwrap_or(0)
}

#[cfg(test)]
mod tests {
    use adit_geometry::camera::Distortion;
    use adit_geometry::profile::ProfileSpec;
    use adit_geometry::rig::ImageUp;

    use super::*;

    /// The paper's set-up: 101 degrees around, 60 along, 12 images per turn, radius 3 m.
    fn paper() -> (Profile<f64>, Camera<f64>, Rig<f64>) {
        let profile = ProfileSpec::Circle { radius_m: 3.0 }.build().expect("a profile");
        let half_width = 2000.0;
        let half_height = 1500.0;
        let camera = Camera {
            width_px: 4000,
            height_px: 3000,
            focal_px: [half_width / 50.5_f64.to_radians().tan(), half_height / 30_f64.to_radians().tan()],
            centre_px: [half_width, half_height],
            distortion: Distortion::BrownConrady([0.0; 5]),
        };
        let rig = Rig {
            images_per_turn: 12,
            image_up: ImageUp::Forward,
            lever_radial_m: 0.0,
            lever_forward_m: 0.0,
            mount_rotvec_rad: [0.0; 3],
        };
        (profile, camera, rig)
    }

    #[test]
    fn more_views_ask_for_shorter_steps() {
        let (profile, camera, rig) = paper();
        let footprints = Footprints::new(&profile, &camera, &rig, [0.0, 0.0]);
        let [one, two, three] = [1, 2, 3].map(|views| footprints.longest_step_m(views));
        assert!(one > two && two > three && three > 0.0, "{one} {two} {three}");
        // The paper bounds the worst edge of one image and asks that this alone closes the turn: never the longer one.
        assert!(one > 0.1836, "{one}");
    }

    #[test]
    fn off_the_axis_the_bound_is_shorter() {
        let (profile, camera, rig) = paper();
        let step = |offset| Footprints::new(&profile, &camera, &rig, offset).longest_step_m(2);
        assert!(step([0.5, 0.0]) < step([0.0, 0.0]));
        assert!(step([0.0, 0.5]) < step([0.0, 0.0]));
    }

    #[test]
    fn intervals_on_a_ring_are_counted_as_a_brute_count_does() {
        let stretches = [[-0.3, 0.9], [0.2, 0.5], [0.7, 3.1], [1.9, 2.2]];
        let period_m = 1.3;
        let brute = (0..1300)
            .map(|place| {
                let x_m = f64::from(place) * 0.001 + 0.0005;
                let covering = |[from, to]: [f64; 2]| {
                    (-5..=5)
                        .filter(|turn| {
                            let at = x_m + f64::from(*turn) * period_m;
                            at >= from && at <= to
                        })
                        .count()
                };
                stretches.into_iter().map(covering).sum::<usize>()
            })
            .min();
        assert_eq!(Some(least_covered(stretches.into_iter(), period_m)), brute);
    }
}
