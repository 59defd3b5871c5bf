//! Centring in the paper's form: a circle of known radius, a level vehicle, the right, left and upward ranges.
//!
//! # Model
//! In the plane `[x, z]` (x right, z up) three wall points `p1 = r (sin a, cos a)`, `p2 = r (sin(a + t), cos(a + t))`,
//! `p3 = r (sin(a + b), cos(a + b))` with `a` = alpha, `t` = theta, `b` = beta, and the vehicle
//! `p = g p1 + (1 - g) p2` with `g` = gamma. `p1` is where the right beam (`d1`) ends, `p2` the left one (`d2`), `p3` the
//! upward one (`d3`). Six residuals, printed so in the paper:
//! `|p - p1| - d1`, `|p - p2| - d2`, `|p - p3| - d3`, `cos t - (2 r^2 - (d1 + d2)^2) / (2 r^2)`, `t / 2 + a - pi`,
//! `(p - p3) x (p1 + p2)`; ordinary least squares over all six as they stand (metres, cosines, radians, square metres).
//!
//! `t < pi` puts the chord below the centre, `t > pi` above: the two mirror branches. Both are started; the smaller
//! residual wins. As printed the six residuals do not tell above from below: the last one is zero also for a `p3` straight
//! *below* the vehicle, so that the mirror image solves all six exactly, always; and for `t < 0` the left-right mirror
//! image does. What decides is that the upward beam points up and `p1` is on the right: steps that would put `p3` below
//! `p`, theta outside (0, 2 pi) or gamma outside [0, 1] are refused.
//! # Source
//! Pahwa et al., IROS 2019, section "Sectional Location of the UAV in the Tunnel".
//! # Limits
//! Level flight only, no lever arms, no outlier rejection, no covariance. Near the height of the centre the horizontal
//! ranges say nothing about height and the equations are nearly singular; the solver is damped and stays finite. With
//! 2 cm of noise on each range in a 3 m circle: 14 mm sideways and 19 to 28 mm in height, the worst 1.5 m off to the side at
//! the height of the centre (general form there: 22 mm).

use nalgebra::{Matrix4, Matrix6x4, Vector4, Vector6};

use crate::{Real, SectionVector};

/// The most steps that one branch may take.
const MAX_ITERATIONS: u8 = 40;

/// The three ranges the paper uses.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PaperRanges<T> {
    /// Body +y (the paper's `d1`).
    pub right_m: T,
    /// Body -y (`d2`).
    pub left_m: T,
    /// Body -z (`d3`).
    pub up_m: T,
}

/// Which of the two mirror solutions.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Branch {
    /// The vehicle is below the centre (`theta < pi`).
    Below,
    /// The vehicle is above the centre (`theta > pi`).
    Above,
}

/// What the solver found.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PaperReport<T> {
    /// Position `[y, z]` (right, down) against the tunnel's axis.
    pub offset_m: SectionVector<T>,
    /// Which branch the solution lies on.
    pub branch: Branch,
    /// Norm of the six residuals at the solution.
    pub residual: T,
    /// The other start's solution, if it ended elsewhere: with nearly as small a residual, the ranges do not tell above
    /// from below.
    pub other: Option<OtherSolution<T>>,
    /// Steps taken by both branches together.
    pub iterations: u8,
    /// Whether the winning branch stopped because it could not improve further, not because steps ran out.
    pub converged: bool,
}

/// A second minimum of the equations.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct OtherSolution<T> {
    /// Position `[y, z]` (right, down) against the tunnel's axis.
    pub offset_m: SectionVector<T>,
    /// Norm of the six residuals there.
    pub residual: T,
}

/// Why there is no solution.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
pub enum PaperError {
    /// A length is not a positive number.
    #[error("{name} is {value} m; expected a positive length")]
    NotPositive {
        /// Which length.
        name: &'static str,
        /// What was given.
        value: f64,
    },
}

/// Solves the paper's equations from both mirror branches.
///
/// # Frame and units
/// Metres; the answer is `[y, z]` in the tunnel's section, z down.
/// # Method
/// Levenberg-Marquardt on the six residuals with analytic derivatives, at most [`MAX_ITERATIONS`] steps per branch.
/// # Errors
/// [`PaperError::NotPositive`] if the radius or a range is not a positive number.
pub fn solve<T: Real>(radius_m: T, ranges: &PaperRanges<T>) -> Result<PaperReport<T>, PaperError> {
    for (name, value) in
        [("radius_m", radius_m), ("right_m", ranges.right_m), ("left_m", ranges.left_m), ("up_m", ranges.up_m)]
    {
        if value <= T::zero() || !value.is_finite() {
            return Err(PaperError::NotPositive { name, value: value.to_f64() });
        }
    }
    let equations = Equations { radius_m, ranges: *ranges };
    let below = minimise(&equations, equations.start(Branch::Below));
    let above = minimise(&equations, equations.start(Branch::Above));
    let (best, other) = if above.cost < below.cost { (above, below) } else { (below, above) };
    let offset_m = equations.position(&best.unknowns);
    let other_m = equations.position(&other.unknowns);
    let elsewhere = (offset_m - other_m).norm() > radius_m * T::of(1e-3);
    let [theta, _, _, _]: [T; 4] = best.unknowns.into();
    Ok(PaperReport {
        offset_m,
        branch: if theta > T::pi() { Branch::Above } else { Branch::Below },
        residual: best.cost.sqrt(),
        other: elsewhere.then(|| OtherSolution { offset_m: other_m, residual: other.cost.sqrt() }),
        iterations: best.iterations + other.iterations,
        converged: best.converged,
    })
}

/// Order of the unknowns: theta, alpha, beta, gamma.
type Unknowns<T> = Vector4<T>;

struct Equations<T> {
    radius_m: T,
    ranges: PaperRanges<T>,
}

struct Descent<T> {
    unknowns: Unknowns<T>,
    /// Sum of the squared residuals.
    cost: T,
    iterations: u8,
    converged: bool,
}

impl<T: Real> Equations<T> {
    /// The branch's own exact solution of the equations without `d3`, kept away from the singular `theta = pi`.
    fn start(&self, branch: Branch) -> Unknowns<T> {
        let chord_m = self.ranges.right_m + self.ranges.left_m;
        let share = (chord_m / (self.radius_m * T::of(2.0))).min(T::of(0.999));
        let short = share.asin() * T::of(2.0);
        let theta = match branch {
            Branch::Below => short,
            Branch::Above => T::two_pi() - short,
        };
        let alpha = T::pi() - theta * T::of(0.5);
        let gamma = self.ranges.left_m / chord_m;
        let start = Unknowns::new(theta, alpha, T::zero(), gamma);
        let p3_angle = (self.position(&start).x / self.radius_m).max(-T::one()).min(T::one()).asin();
        Unknowns::new(theta, alpha, p3_angle - alpha, gamma)
    }

    /// The vehicle in the tunnel's section, `[y, z down]`.
    fn position(&self, unknowns: &Unknowns<T>) -> SectionVector<T> {
        let [theta, alpha, _, gamma] = (*unknowns).into();
        let (s1, c1) = alpha.sin_cos();
        let (s2, c2) = (alpha + theta).sin_cos();
        let rest = T::one() - gamma;
        SectionVector::new(gamma * s1 + rest * s2, -(gamma * c1 + rest * c2)) * self.radius_m
    }

    /// Tells whether the three beams point right, left and up: the mirror images that solve the equations do not.
    fn points_as_mounted(&self, unknowns: &Unknowns<T>) -> bool {
        let [theta, alpha, beta, gamma]: [T; 4] = (*unknowns).into();
        let up_m = self.radius_m * (alpha + beta).cos() + self.position(unknowns).y;
        let between = |value: T, high: T| value >= T::zero() && value <= high;
        up_m > T::zero() && between(theta, T::two_pi()) && between(gamma, T::one())
    }

    /// The six residuals and their derivatives with respect to theta, alpha, beta, gamma.
    fn residuals(&self, unknowns: &Unknowns<T>) -> (Vector6<T>, Matrix6x4<T>) {
        let [theta, alpha, beta, gamma] = (*unknowns).into();
        let (r, zero, two) = (self.radius_m, T::zero(), T::of(2.0));
        let rest = T::one() - gamma;
        let wall = |angle: T| {
            let (sin, cos) = angle.sin_cos();
            // The point and its derivative with respect to the angle.
            (SectionVector::new(r * sin, r * cos), SectionVector::new(r * cos, -r * sin))
        };
        let (p1, q1) = wall(alpha);
        let (p2, q2) = wall(alpha + theta);
        let (p3, q3) = wall(alpha + beta);
        let p = p1 * gamma + p2 * rest;
        let none = SectionVector::zeros();
        // Derivatives of the points, in the order theta, alpha, beta, gamma.
        let dp1 = [none, q1, none, none];
        let dp2 = [q2, q2, none, none];
        let dp3 = [none, q3, q3, none];
        let dp = [q2 * rest, q1 * gamma + q2 * rest, none, p1 - p2];

        let d = &self.ranges;
        let chord_m = d.right_m + d.left_m;
        let mut residuals = Vector6::zeros();
        let mut jacobian = Matrix6x4::zeros();
        for (row, (end, dend, range)) in
            [(p1, dp1, d.right_m), (p2, dp2, d.left_m), (p3, dp3, d.up_m)].iter().enumerate()
        {
            let beam = p - end;
            let length = beam.norm().max(T::of(1e-6));
            residuals[row] = length - *range;
            for (column, (dp, dend)) in dp.iter().zip(dend).enumerate() {
                jacobian[(row, column)] = beam.dot(&(dp - dend)) / length;
            }
        }
        residuals[3] = theta.cos() - (two * r * r - chord_m * chord_m) / (two * r * r);
        jacobian.set_row(3, &Vector4::new(-theta.sin(), zero, zero, zero).transpose());
        residuals[4] = theta / two + alpha - T::pi();
        jacobian.set_row(4, &Vector4::new(T::one() / two, T::one(), zero, zero).transpose());
        residuals[5] = (p - p3).perp(&(p1 + p2));
        for (column, (((dp, dp1), dp2), dp3)) in dp.iter().zip(&dp1).zip(&dp2).zip(&dp3).enumerate() {
            jacobian[(5, column)] = (dp - dp3).perp(&(p1 + p2)) + (p - p3).perp(&(dp1 + dp2));
        }
        (residuals, jacobian)
    }
}

fn minimise<T: Real>(equations: &Equations<T>, start: Unknowns<T>) -> Descent<T> {
    let (mut residuals, mut jacobian) = equations.residuals(&start);
    let mut descent = Descent { unknowns: start, cost: residuals.norm_squared(), iterations: 0, converged: false };
    let smallest_step = T::default_epsilon() * T::of(8.0);
    let mut damping = T::of(1e-3);
    while descent.iterations < MAX_ITERATIONS {
        descent.iterations += 1;
        let normal = jacobian.transpose() * jacobian;
        let gradient = jacobian.transpose() * residuals;
        let damped = normal + Matrix4::from_diagonal(&normal.diagonal().add_scalar(T::of(1e-3))) * damping;
        let Some(cholesky) = damped.cholesky() else {
            damping *= T::of(10.0);
            continue;
        };
        let step = cholesky.solve(&gradient);
        let candidate = descent.unknowns - step;
        let (new_residuals, new_jacobian) = equations.residuals(&candidate);
        let refused = !equations.points_as_mounted(&candidate);
        let cost = new_residuals.norm_squared();
        let small = step.norm() <= smallest_step * (T::one() + descent.unknowns.norm());
        if cost < descent.cost && !refused {
            (descent.unknowns, descent.cost) = (candidate, cost);
            (residuals, jacobian) = (new_residuals, new_jacobian);
            damping = (damping * T::of(0.1)).max(T::of(1e-9));
        } else if (small && !refused) || damping > T::of(1e6) {
            descent.converged = true;
            break;
        } else {
            damping *= T::of(10.0);
        }
        if small {
            descent.converged = true;
            break;
        }
    }
    descent
}

#[cfg(test)]
mod tests {
    use super::*;

    fn ranges_at(y: f64, z: f64, r: f64) -> PaperRanges<f64> {
        let half_chord = (r * r - z * z).sqrt();
        PaperRanges { right_m: half_chord - y, left_m: half_chord + y, up_m: (r * r - y * y).sqrt() + z }
    }

    #[test]
    fn exact_ranges_give_the_place_back_on_both_branches() {
        for (y, z, branch) in [(0.4, 0.7, Branch::Below), (0.4, -0.7, Branch::Above), (-1.0, 0.5, Branch::Below)] {
            let report = solve(3.0, &ranges_at(y, z, 3.0)).unwrap();
            assert!((report.offset_m - SectionVector::new(y, z)).norm() < 1e-9, "{report:?}");
            assert_eq!(report.branch, branch);
            assert!(report.residual < 1e-9 && report.other.is_none_or(|other| other.residual > 0.1), "{report:?}");
            assert!(report.converged && report.iterations < 80);
        }
    }

    #[test]
    fn each_sensor_has_its_sign() {
        let at = |y, z| solve(3.0, &ranges_at(y, z, 3.0)).unwrap().offset_m;
        assert!(at(0.5, 0.3).x > 0.4, "nearer to the right wall is right of the axis");
        assert!(at(-0.5, 0.3).x < -0.4);
        assert!(at(0.2, 0.5).y > 0.4, "farther from the crown is below the axis");
        assert!(at(0.2, -0.5).y < -0.4);
    }

    #[test]
    fn the_jacobian_agrees_with_differences() {
        let equations = Equations { radius_m: 2.5, ranges: ranges_at(0.3, -0.4, 2.5) };
        for unknowns in [[2.0, 1.9, -1.7, 0.4], [3.5, 1.2, -1.0, 0.6], [2.9, 1.7, -2.2, 0.55]] {
            let unknowns = Unknowns::from(unknowns);
            let (_, jacobian) = equations.residuals(&unknowns);
            for column in 0..4 {
                let mut moved = [unknowns, unknowns];
                moved[0][column] -= 1e-6;
                moved[1][column] += 1e-6;
                let [low, high] = moved.map(|u| equations.residuals(&u).0);
                let difference = (high - low) / 2e-6;
                assert!((difference - jacobian.column(column)).norm() < 1e-7, "column {column}");
            }
        }
    }

    #[test]
    fn what_is_no_length_is_refused() {
        let good = ranges_at(0.1, 0.1, 3.0);
        assert!(matches!(
            solve(3.0, &PaperRanges { up_m: f64::NAN, ..good }),
            Err(PaperError::NotPositive { name: "up_m", .. })
        ));
        assert!(solve(0.0, &good).is_err());
        assert!(solve(3.0, &PaperRanges { left_m: -1.0, ..good }).is_err());
    }
}
