//! The real wall: a profile swept along x, displaced along its normal by a [`Relief`], with pipes and water.
//!
//! [`Wall::ray_cast`] serves camera and range sensors alike, so both see the same tunnel. Model limits: the axis is
//! straight; relief is a single-valued height field, so nothing but a pipe can overhang; section outlines are convex
//! wherever relief is not zero (the search starts from a bound that holds for convex sections).

mod config;
mod foot;
mod pipe;

use adit_geometry::profile::{Profile, SurfacePoint};
use nalgebra::{Point3, Vector2, Vector3};

pub use config::{PipeConfig, WallConfig, WallError};
use foot::{Foot, Local, local_shape};
use pipe::Pipe;

use super::relief::{Height, Relief};

/// What a ray met.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Surface {
    /// The lining.
    Lining,
    /// A pipe, by its number in [`WallConfig::pipes`].
    Pipe(usize),
    /// Standing water.
    Water,
}

/// Where a ray meets the tunnel.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct WallHit {
    /// Multiple of the direction's length from the origin (metres if the direction is a unit vector).
    pub distance: f64,
    /// The point, in the tunnel frame.
    pub point: Point3<f64>,
    /// Unit normal towards the free space.
    pub normal: Vector3<f64>,
    /// Arc length of the lining there; for pipes and water that of the nearest lining.
    pub s_m: f64,
    /// Station.
    pub x_m: f64,
    /// Height over the profile, positive inwards.
    pub height_m: f64,
    /// What was met.
    pub surface: Surface,
}

/// A tunnel wall as it is.
#[derive(Clone, Debug)]
pub struct Wall {
    profile: Profile<f64>,
    /// One for each piece of the profile.
    locals: Vec<Local>,
    relief: Relief,
    /// Twice the bound on the relief: within this clearance the relief is looked at.
    shell_m: f64,
    pipes: Vec<Pipe>,
    water_z_m: Option<f64>,
}

/// The bracket around a hit is closed until it is this short, in metres along the ray.
const RAY_TOLERANCE_M: f64 = 1e-7;
/// Steps of the march; rays at 75 degrees from the normal through 100 mm of relief need about 30.
const MAX_MARCH_STEPS: usize = 400;
/// A gap that stays larger than this at the found hit means that the ray met the face of a ring step.
const STEP_FACE_GAP_M: f64 = 1e-6;

impl Wall {
    /// Builds the wall.
    ///
    /// # Errors
    /// [`WallError`] for lengths that are not positive, numbers that are not finite, relief too deep for the section.
    pub fn new(profile: Profile<f64>, config: &WallConfig, seed: u64) -> Result<Self, WallError> {
        let relief = config::build_relief(&profile, config, seed)?;
        let relief_m = relief.bound_m();
        let clearance_m = profile.nearest(Vector2::zeros()).map_or(0.0, |nearest| nearest.clearance_m);
        let limit_m = 0.1 * clearance_m;
        if relief_m > limit_m {
            return Err(WallError::TooDeep { relief_m, limit_m });
        }
        let pipes = config.pipes.iter().map(|pipe| config::build_pipe(&profile, pipe)).collect::<Result<_, _>>()?;
        if let Some(z_m) = config.water_z_m {
            config::finite("water_z_m", z_m)?;
        }
        let locals = (0..profile.pieces().len()).filter_map(|index| local_shape(&profile, index)).collect();
        Ok(Self { profile, locals, relief, shell_m: 2.0 * relief_m, pipes, water_z_m: config.water_z_m })
    }

    /// Returns the nominal section.
    pub fn profile(&self) -> &Profile<f64> {
        &self.profile
    }

    /// Returns the water level, z in the tunnel frame.
    pub fn water_z_m(&self) -> Option<f64> {
        self.water_z_m
    }

    /// Returns the true relief of what a ray along the profile's normal meets at (s, x): lining, or a pipe before it.
    ///
    /// Height over the nominal profile in metres, positive inwards. Water is transparent to this question.
    pub fn relief_m(&self, s_m: f64, x_m: f64) -> f64 {
        let lining_m = self.relief.at(s_m, x_m).height_m;
        let Some(SurfacePoint { point, normal, .. }) = self.profile.at(s_m) else { return lining_m };
        let mut height_m = lining_m;
        for pipe in self.pipes.iter().filter(|pipe| x_m >= pipe.from_x_m && x_m <= pipe.to_x_m) {
            let to_centre = pipe.centre - point;
            let (along, across) = (to_centre.dot(&normal), to_centre.perp(&normal));
            let chord = pipe.radius_m * pipe.radius_m - across * across;
            if chord > 0.0 && along > 0.0 && along < 4.0 * pipe.radius_m + self.shell_m {
                height_m = height_m.max(along + chord.sqrt());
            }
        }
        height_m
    }

    /// Returns the lining's point at (s, x), relief included, pipes and water ignored. `None` only for NaN.
    pub fn lining_point(&self, s_m: f64, x_m: f64) -> Option<Point3<f64>> {
        let surface = self.profile.at(s_m)?;
        let section = surface.point + surface.normal * self.relief.at(surface.s_m, x_m).height_m;
        Some(Point3::new(x_m, section.x, section.y))
    }

    /// Returns the first surface that the ray from `origin` along `direction` meets.
    ///
    /// # Frame and units
    /// Both in `tunnel`, metres; the direction need not be of unit length. The origin must lie in free space.
    /// # Method
    /// Exact intersection with profile, pipes and water; where the wall has relief, a march through the shell that the
    /// relief can fill, then a bracketed root of clearance minus height. Position error below 1e-6 m.
    /// `None` where the ray runs along the axis and meets nothing, or for an origin behind the profile.
    pub fn ray_cast(&self, origin: Point3<f64>, direction: Vector3<f64>) -> Option<WallHit> {
        let mut best = self.cast_lining(&Ray { origin, direction });
        if let Some(hit) = self.cast_water(origin, direction)
            && best.is_none_or(|other| hit.distance < other.distance)
        {
            best = Some(hit);
        }
        for (index, pipe) in self.pipes.iter().enumerate() {
            if let Some((distance, normal)) = pipe.ray_cast(origin, direction)
                && best.is_none_or(|other| distance < other.distance)
            {
                best = self.plain_hit(origin + direction * distance, distance, normal, Surface::Pipe(index));
            }
        }
        best
    }

    /// Tells whether the lining between two stations belongs to one ring, so that no joint's step lies between.
    pub fn same_ring(&self, x_m: f64, other_x_m: f64) -> bool {
        self.relief.ring_of(x_m) == self.relief.ring_of(other_x_m)
    }

    /// Tells whether a pipe comes within `reach` (per unit of distance) of the ray.
    pub fn pipe_near(&self, origin: Point3<f64>, direction: Vector3<f64>, reach: f64) -> bool {
        self.pipes.iter().any(|pipe| pipe.is_near(origin, direction, reach))
    }

    fn cast_lining(&self, ray: &Ray) -> Option<WallHit> {
        let nominal = self.profile.ray_cast(ray.origin.coords.yz(), ray.direction.yz())?;
        let distance = if self.relief.is_flat() { nominal.distance } else { self.march(ray, nominal.distance)? };
        let point = ray.at(distance);
        let (gap_m, foot) =
            if self.relief.is_flat() { (0.0, self.foot_on(nominal.surface.piece, &point)) } else { self.gap(&point) };
        let height = self.relief.at(foot.s_m, point.x);
        let on_step_face = gap_m.abs() > STEP_FACE_GAP_M;
        let normal =
            if on_step_face { Vector3::x() * -ray.direction.x.signum() } else { surface_normal(&foot, &height) };
        Some(WallHit {
            distance,
            point,
            normal,
            s_m: self.profile.wrap_s(foot.s_m),
            x_m: point.x,
            height_m: foot.clearance_m,
            surface: Surface::Lining,
        })
    }

    /// Searches the first zero of the gap along the ray; `nominal` is where it meets the profile.
    fn march(&self, ray: &Ray, nominal: f64) -> Option<f64> {
        let section_speed = ray.direction.yz().norm();
        let smallest_step = RAY_TOLERANCE_M / ray.direction.norm();
        let start_clearance_m = self.profile.nearest(ray.origin.coords.yz())?.clearance_m;
        if start_clearance_m < 0.0 {
            return None;
        }
        // In a convex section the clearance falls at most linearly from here to zero at the nominal hit, so that the
        // ray has not yet entered the shell here.
        let mut t = (nominal * (1.0 - self.shell_m / start_clearance_m.max(1e-9))).max(0.0);
        let mut gap_m = self.gap(&ray.at(t)).0;
        if gap_m <= 0.0 {
            return (t == 0.0).then_some(0.0);
        }
        let mut previous: Option<(f64, f64)> = None;
        for _ in 0..MAX_MARCH_STEPS {
            // Nothing is met within `safe` on a wall of gentle slope; the secant hastens the approach.
            let safe = gap_m * 0.8 / section_speed;
            let secant = previous.map_or(safe, |(t0, gap0_m)| gap_m * (t - t0) / (gap0_m - gap_m));
            let mut step = if secant > safe { secant.min(4.0 * safe) } else { safe }.max(smallest_step);
            let x_m = ray.at(t).x;
            if let Some(joint_x_m) = self.relief.next_joint_x_m(x_m, ray.direction.x) {
                // Just beyond the joint and no further, so that no ring is skipped.
                step = step.min((joint_x_m - x_m) / ray.direction.x + smallest_step);
            }
            let next_gap_m = self.gap(&ray.at(t + step)).0;
            if next_gap_m <= 0.0 {
                let gap = |t: f64| self.gap(&ray.at(t)).0;
                return Some(bracketed_root(gap, (t, gap_m), (t + step, next_gap_m), smallest_step));
            }
            previous = Some((t, gap_m));
            (t, gap_m) = (t + step, next_gap_m);
        }
        None
    }

    /// Free space between a point and the nearest displaced piece, and the point's foot on that piece.
    ///
    /// Far from the wall a lower bound; exact within the shell that relief can fill.
    fn gap(&self, point: &Point3<f64>) -> (f64, Foot) {
        let section = point.coords.yz();
        let mut best: Option<(f64, Foot)> = None;
        for foot in self.locals.iter().filter_map(|local| local.foot(section)) {
            let within_shell = foot.clearance_m.abs() <= self.shell_m;
            let height_m = if within_shell { self.relief.at(foot.s_m, point.x).height_m } else { self.shell_m };
            let gap_m = foot.clearance_m - height_m;
            if best.is_none_or(|(smallest_m, _)| gap_m < smallest_m) {
                best = Some((gap_m, foot));
            }
        }
        best.unwrap_or_else(|| {
            let foot = self.nearest_foot(section);
            (foot.clearance_m - self.relief.at(foot.s_m, point.x).height_m, foot)
        })
    }

    fn foot_on(&self, piece: usize, point: &Point3<f64>) -> Foot {
        let section = point.coords.yz();
        self.locals.get(piece).and_then(|local| local.foot(section)).unwrap_or_else(|| self.nearest_foot(section))
    }

    /// The foot of any point, from the profile itself; needed behind corners only.
    fn nearest_foot(&self, section: Vector2<f64>) -> Foot {
        self.profile.nearest(section).map_or_else(Foot::nowhere, |nearest| Foot {
            clearance_m: nearest.clearance_m,
            s_m: nearest.surface.s_m,
            normal: nearest.surface.normal,
            curvature: self.locals.get(nearest.surface.piece).map_or(0.0, Local::curvature),
        })
    }

    fn cast_water(&self, origin: Point3<f64>, direction: Vector3<f64>) -> Option<WallHit> {
        let level_m = self.water_z_m?;
        if direction.z <= 0.0 || origin.z >= level_m {
            return None;
        }
        let distance = (level_m - origin.z) / direction.z;
        self.plain_hit(origin + direction * distance, distance, -Vector3::z(), Surface::Water)
    }

    fn plain_hit(&self, point: Point3<f64>, distance: f64, normal: Vector3<f64>, surface: Surface) -> Option<WallHit> {
        let nearest = self.profile.nearest(point.coords.yz())?;
        let s_m = nearest.surface.s_m;
        Some(WallHit { distance, point, normal, s_m, x_m: point.x, height_m: nearest.clearance_m, surface })
    }
}

struct Ray {
    origin: Point3<f64>,
    direction: Vector3<f64>,
}

impl Ray {
    fn at(&self, t: f64) -> Point3<f64> {
        self.origin + self.direction * t
    }
}

/// Normal of the displaced surface: `n - h_s / (1 - h k) t - h_x e_x`, normalised (k: curvature of the profile).
fn surface_normal(foot: &Foot, height: &Height) -> Vector3<f64> {
    let tangent = Vector2::new(foot.normal.y, -foot.normal.x);
    let section = foot.normal - tangent * (height.d_s / (1.0 - height.height_m * foot.curvature));
    Vector3::new(-height.d_x, section.x, section.y).normalize()
}

/// Regula falsi (Illinois form) with bisection every third step, so that it also converges to a jump.
fn bracketed_root(gap: impl Fn(f64) -> f64, outside: (f64, f64), inside: (f64, f64), tolerance: f64) -> f64 {
    let ((mut a, mut gap_a), (mut b, mut gap_b)) = (outside, inside);
    for iteration in 0..100 {
        if b - a <= tolerance {
            break;
        }
        let mut middle = a + (b - a) * gap_a / (gap_a - gap_b);
        if iteration % 3 == 2 || !(middle > a && middle < b) {
            middle = 0.5 * (a + b);
        }
        let gap_m = gap(middle);
        if gap_m.abs() < 1e-9 {
            return middle;
        }
        if gap_m > 0.0 {
            (a, gap_a, gap_b) = (middle, gap_m, gap_b * 0.5);
        } else {
            (b, gap_b, gap_a) = (middle, gap_m, gap_a * 0.5);
        }
    }
    b
}

#[cfg(test)]
mod tests;
