//! One photo as seen from the wall: where a wall point lies in it, how finely it shows it, what it covers.

use adit_geometry::SectionVector;
use adit_geometry::camera::Camera;
use adit_geometry::profile::Profile;
use nalgebra::{Isometry3, Matrix3, Vector2, Vector3};

use super::grid::{Lattice, Region, WallPoint, wall_at};
use super::usable::Usable;
use crate::surface::SurfaceWindow;

/// Flattest angle under which a wall is still textured: cosine of the angle of incidence (80 degrees).
const LEAST_INCIDENCE_COS: f64 = 0.17;

/// A wall so many times farther away than the nearest one in the photo is not textured from it.
const FARTHEST_RATIO: f64 = 8.0;

/// Rays cast per side of a photo to find what it covers.
const FOOTPRINT_RAYS: usize = 24;

/// Quality falls towards the border of what is usable over this share of the photo's width, so that seams do not
/// follow borders: there vignetting, aberration and calibration errors are worst.
const EDGE_RAMP_SHARE: f64 = 0.08;

/// Widest ramp: distances beyond it are not measured.
const EDGE_RAMP_MAX_PX: f64 = 200.0;

/// Quality at the very border, so that a place that only one photo sees is still taken from it.
const EDGE_FLOOR: f32 = 0.02;

/// A photo's camera and pose, made for projecting many wall points.
#[derive(Clone)]
pub(crate) struct View {
    pub(crate) camera: Camera<f64>,
    cam_from_tunnel: Matrix3<f64>,
    centre_in_tunnel: Vector3<f64>,
    /// Factor on the quality: below 1 for poses that are less certain than others.
    trust: f32,
}

/// What a photo covers: a box in arc length (not wrapped, around the photo's own middle) and along the axis.
#[derive(Clone, Copy, Debug, PartialEq)]
#[expect(clippy::struct_field_names, reason = "the unit is part of every name")]
pub(crate) struct Footprint {
    pub(crate) s_m: [f64; 2],
    pub(crate) x_m: [f64; 2],
    /// Where the optical axis meets the wall, along the axis.
    pub(crate) axis_x_m: f64,
    /// Photo pixels per metre of wall where the optical axis meets it.
    pub(crate) axis_density_per_m: f64,
}

/// A place of a lattice as a photo shows it.
#[derive(Clone, Copy, Debug)]
pub(super) struct Sight {
    pub(super) pixel: [f32; 2],
    /// Photo pixels per metre of wall in the direction in which there are fewest; 0 = not usable.
    pub(super) density_per_m: f32,
    /// Geometric mean of the pixels per metre over both directions.
    pub(super) mean_density_per_m: f32,
    /// `density_per_m`, lowered towards the border of what is usable; 0 = not usable.
    pub(super) score: f32,
}

const UNSEEN: Sight = Sight { pixel: [-1.0, -1.0], density_per_m: 0.0, mean_density_per_m: 0.0, score: 0.0 };

impl Footprint {
    /// The box of coarse-lattice cells that the footprint touches.
    pub(super) fn region(&self, coarse: &Lattice) -> Region {
        let column0 = (self.s_m[0] / coarse.step_s_m).floor() as i64 - 1;
        let column_end = (self.s_m[1] / coarse.step_s_m).ceil() as i64 + 1;
        let row = |x_m: f64| (x_m - coarse.x0_m) / coarse.step_x_m;
        let row0 = (row(self.x_m[0]).floor().max(0.0) as usize).min(coarse.rows - 1);
        let row_end = (row(self.x_m[1]).ceil().max(0.0) as usize + 1).min(coarse.rows);
        Region {
            column0,
            columns: ((column_end - column0) as usize).min(coarse.columns),
            row0,
            rows: row_end.max(row0 + 1) - row0,
        }
    }
}

impl View {
    pub(crate) fn new(camera: Camera<f64>, tunnel_from_cam: &Isometry3<f64>, trust: f32) -> Self {
        let cam_from_tunnel = *tunnel_from_cam.rotation.inverse().to_rotation_matrix().matrix();
        Self { camera, cam_from_tunnel, centre_in_tunnel: tunnel_from_cam.translation.vector, trust }
    }

    /// A wall point at x = 0 in the camera frame; [`Self::forward_in_cam`] times x is to be added.
    pub(crate) fn section_in_cam(&self, point: SectionVector<f64>) -> Vector3<f64> {
        self.cam_from_tunnel * (Vector3::new(0.0, point.x, point.y) - self.centre_in_tunnel)
    }

    /// The tunnel's x axis in the camera frame.
    pub(crate) fn forward_in_cam(&self) -> Vector3<f64> {
        self.cam_from_tunnel.column(0).into_owned()
    }

    /// A direction of the tunnel frame in the camera frame.
    pub(crate) fn turned_into_cam(&self, in_tunnel: &Vector3<f64>) -> Vector3<f64> {
        self.cam_from_tunnel * in_tunnel
    }

    /// The optical centre in the tunnel frame.
    pub(crate) fn centre_in_tunnel(&self) -> Vector3<f64> {
        self.centre_in_tunnel
    }

    /// Finds the box of wall that the photo covers, or `None` if its optical axis meets no wall.
    pub(crate) fn footprint(&self, profile: &Profile<f64>) -> Option<Footprint> {
        let (width, height) = (f64::from(self.camera.width_px), f64::from(self.camera.height_px));
        let middle = self.cast(profile, &Vector2::new(width * 0.5, height * 0.5))?;
        let mut hits = vec![middle];
        for row in 0..=FOOTPRINT_RAYS {
            for column in 0..=FOOTPRINT_RAYS {
                let share = |index: usize| index as f64 / FOOTPRINT_RAYS as f64;
                hits.extend(self.cast(profile, &Vector2::new(width * share(column), height * share(row))));
            }
        }
        let nearest_m = hits.iter().map(|hit| hit.distance_m).fold(f64::INFINITY, f64::min);
        let perimeter_m = profile.perimeter_m();
        let (mut s_m, mut x_m) = ([0.0_f64; 2], [middle.x_m; 2]);
        for hit in hits.iter().filter(|hit| hit.distance_m <= nearest_m * FARTHEST_RATIO) {
            let turn = hit.s_m - middle.s_m;
            let turn = turn - (turn / perimeter_m).round() * perimeter_m;
            s_m = [s_m[0].min(turn), s_m[1].max(turn)];
            x_m = [x_m[0].min(hit.x_m), x_m[1].max(hit.x_m)];
        }
        let wall = wall_at(profile, middle.s_m);
        let sight = self.density(&wall, middle.x_m)?;
        Some(Footprint {
            s_m: s_m.map(|turn| turn + middle.s_m),
            x_m,
            axis_x_m: middle.x_m,
            axis_density_per_m: sight.1,
        })
    }

    fn cast(&self, profile: &Profile<f64>, pixel: &Vector2<f64>) -> Option<Hit> {
        let in_cam = self.camera.unproject(pixel)?.normalize();
        let direction = self.cam_from_tunnel.tr_mul(&in_cam);
        let origin = SectionVector::new(self.centre_in_tunnel.y, self.centre_in_tunnel.z);
        let section = SectionVector::new(direction.y, direction.z);
        let hit = profile.ray_cast(origin, section)?;
        let incidence_cos = -section.dot(&hit.surface.normal);
        (incidence_cos >= LEAST_INCIDENCE_COS).then(|| Hit {
            s_m: hit.surface.s_m,
            x_m: self.centre_in_tunnel.x + direction.x * hit.distance,
            distance_m: hit.distance,
        })
    }

    /// Least and geometric mean density in pixels per metre at a wall point.
    fn density(&self, wall: &WallPoint, x_m: f64) -> Option<(f64, f64)> {
        let forward = self.forward_in_cam();
        let in_cam = self.section_in_cam(wall.point) + forward * x_m;
        let (_, pixel_from_cam) = self.camera.project_with_jacobian(&in_cam)?;
        let around = self.cam_from_tunnel * Vector3::new(0.0, wall.tangent.x, wall.tangent.y);
        Some(densities((pixel_from_cam * around).into(), (pixel_from_cam * forward).into()))
    }

    /// Looks at every cell of `region` (in cells of `lattice`), row by row.
    pub(super) fn sights(
        &self,
        surface: &SurfaceWindow,
        usable: &Usable,
        lattice: &Lattice,
        region: &Region,
    ) -> Vec<Sight> {
        let columns: Vec<_> = (0..region.columns as i64)
            .map(|column| self.column(surface.profile(), lattice.s_m(region.column0 + column), lattice.step_s_m))
            .collect();
        let forward = self.forward_in_cam();
        let ramp_px = (f64::from(self.camera.width_px) * EDGE_RAMP_SHARE).min(EDGE_RAMP_MAX_PX) as f32;
        let mut sights = Vec::with_capacity(region.len());
        for row in region.row0..region.row_end() {
            let x_m = lattice.x_m(row as i64);
            let heights = surface.line(x_m);
            sights.extend(columns.iter().zip(region.column0..).map(|(column, number)| {
                let sight = column.as_ref().and_then(|column| {
                    let shift = forward * x_m + column.inwards * heights.at(lattice.s_m(number));
                    self.sight(column, &forward, &(column.in_cam + shift), usable, ramp_px)
                });
                sight.unwrap_or(UNSEEN)
            }));
        }
        sights
    }

    /// Looks at one place `[s, x]` of the wall at a height over the profile.
    pub(super) fn sight_at(
        &self,
        profile: &Profile<f64>,
        [s_m, x_m]: [f64; 2],
        height_m: f64,
        slack_m: f64,
        usable: &Usable,
    ) -> Sight {
        let forward = self.forward_in_cam();
        let column = self.column(profile, s_m, slack_m);
        let sight = column.and_then(|column| {
            let in_cam = column.in_cam + forward * x_m + column.inwards * height_m;
            self.sight(&column, &forward, &in_cam, usable, 1.0)
        });
        sight.unwrap_or(UNSEEN)
    }

    /// Prepares one place around the wall; `None` if the photo's optical centre cannot see it.
    fn column(&self, profile: &Profile<f64>, s_m: f64, slack_m: f64) -> Option<Column> {
        let wall = wall_at(profile, s_m);
        let origin = SectionVector::new(self.centre_in_tunnel.y, self.centre_in_tunnel.z);
        let to_wall = wall.point - origin;
        let facing_m = -to_wall.dot(&wall.normal);
        if facing_m <= 0.0 {
            return None;
        }
        let hit = profile.ray_cast(origin, to_wall)?;
        if (hit.distance - 1.0) * to_wall.norm() < -2.0 * slack_m {
            return None;
        }
        Some(Column {
            in_cam: self.section_in_cam(wall.point),
            around: self.cam_from_tunnel * Vector3::new(0.0, wall.tangent.x, wall.tangent.y),
            inwards: self.cam_from_tunnel * Vector3::new(0.0, wall.normal.x, wall.normal.y),
            facing_m,
        })
    }

    fn sight(
        &self,
        column: &Column,
        forward: &Vector3<f64>,
        in_cam: &Vector3<f64>,
        usable: &Usable,
        ramp_px: f32,
    ) -> Option<Sight> {
        let distance_m = in_cam.norm();
        if column.facing_m < LEAST_INCIDENCE_COS * distance_m {
            return None;
        }
        let (pixel, pixel_from_cam) = self.camera.project_with_jacobian(in_cam)?;
        let pixel = [pixel.x as f32, pixel.y as f32];
        let clearance_px = usable.clearance_px(pixel[0], pixel[1]);
        let (least, mean) = densities((pixel_from_cam * column.around).into(), (pixel_from_cam * forward).into());
        let sight = Sight { pixel, density_per_m: least as f32, mean_density_per_m: mean as f32, score: 0.0 };
        if clearance_px <= 0.0 {
            return Some(Sight { density_per_m: 0.0, ..sight });
        }
        let inwards = (clearance_px / ramp_px).min(1.0);
        let ramp = inwards * inwards * (3.0 - 2.0 * inwards);
        Some(Sight { score: least as f32 * ramp.max(EDGE_FLOOR) * self.trust, ..sight })
    }
}

#[derive(Clone, Copy)]
#[expect(clippy::struct_field_names, reason = "the unit is part of every name")]
struct Hit {
    s_m: f64,
    x_m: f64,
    distance_m: f64,
}

struct Column {
    in_cam: Vector3<f64>,
    around: Vector3<f64>,
    /// The wall's normal in the camera frame.
    inwards: Vector3<f64>,
    /// Distance of the optical centre from the wall's tangent plane.
    facing_m: f64,
}

/// Smallest singular value and root of the determinant's size of the 2 x 2 matrix with columns `a` and `b`.
fn densities(a: [f64; 2], b: [f64; 2]) -> (f64, f64) {
    let area = (a[0] * b[1] - a[1] * b[0]).abs();
    let sum = a[0] * a[0] + a[1] * a[1] + b[0] * b[0] + b[1] * b[1];
    let spread = (sum * sum - 4.0 * area * area).max(0.0).sqrt();
    // Smallest squared singular value as area^2 / largest, which does not cancel.
    let largest = ((sum + spread) * 0.5).max(f64::MIN_POSITIVE);
    (area / largest.sqrt(), area.sqrt())
}

#[cfg(test)]
mod tests {
    use adit_geometry::camera::Distortion;
    use adit_geometry::profile::ProfileSpec;
    use adit_geometry::rig::{ImageUp, nominal_rotation};
    use nalgebra::Translation3;

    use super::*;
    use crate::surface::SurfaceStore;

    fn camera() -> Camera<f64> {
        Camera {
            width_px: 1000,
            height_px: 750,
            focal_px: [466.0, 466.0],
            centre_px: [500.0, 375.0],
            distortion: Distortion::BrownConrady([0.0; 5]),
        }
    }

    fn view(shaft_rad: f64) -> View {
        let rotation = nominal_rotation(ImageUp::Forward, shaft_rad);
        View::new(camera(), &Isometry3::from_parts(Translation3::new(2.0, 0.0, 0.0), rotation), 1.0)
    }

    #[test]
    fn a_camera_on_the_axis_sees_as_many_pixels_per_metre_as_its_focal_length_over_the_radius() {
        let profile = ProfileSpec::Circle { radius_m: 3.0 }.build().unwrap();
        let footprint = view(1.0).footprint(&profile).unwrap();
        assert!((footprint.axis_density_per_m - 466.0 / 3.0).abs() < 0.5);
        assert!((footprint.axis_x_m - 2.0).abs() < 1e-9);
        let half_angle = (500.0_f64 / 466.0).atan();
        assert!((footprint.s_m[1] - footprint.s_m[0] - 6.0 * half_angle).abs() < 0.05, "{footprint:?}");
    }

    #[test]
    fn the_footprint_of_a_camera_that_looks_up_runs_over_the_seam() {
        let profile = ProfileSpec::Circle { radius_m: 3.0 }.build().unwrap();
        let coarse = Lattice::coarse(profile.perimeter_m(), 0.0128, -1.0, 5.0);
        let view = view(0.0);
        let region = view.footprint(&profile).unwrap().region(&coarse);
        let middle = region.column0 + region.columns as i64 / 2;
        assert!(middle.rem_euclid(coarse.columns as i64) < 2 || coarse.wrap(middle) + 2 > coarse.columns, "{region:?}");
    }

    #[test]
    fn the_wall_behind_the_camera_is_not_seen() {
        let store = SurfaceStore::flat(&ProfileSpec::Circle { radius_m: 3.0 }).unwrap();
        let profile = store.profile();
        let coarse = Lattice::coarse(profile.perimeter_m(), 0.05, -1.0, 5.0);
        let view = view(0.0);
        let usable = Usable::new(1000, 750, None);
        let all = Region { column0: 0, columns: coarse.columns, row0: 0, rows: coarse.rows };
        let sights = view.sights(&store.window([-1.0, 5.0]).unwrap(), &usable, &coarse, &all);
        for (index, sight) in sights.iter().enumerate() {
            let s_m = coarse.s_m((index % coarse.columns) as i64);
            let from_crown_m = s_m.min(profile.perimeter_m() - s_m);
            assert!(sight.score == 0.0 || from_crown_m < 3.0 * 0.83, "seen at {s_m} m");
        }
        assert!(sights.iter().any(|sight| sight.score > 100.0));
    }
}
