//! Gauss-Newton descents from many starts, and what their minima say together.

use nalgebra::{Matrix2, SymmetricEigen, UnitQuaternion};

use super::{Beam, BeamSet, Centring, Fix, MAX_BEAMS};
use crate::profile::Profile;
use crate::{Real, SectionVector};

/// The most Gauss-Newton steps from one start.
const MAX_ITERATIONS: u8 = 25;
/// Starts per axis of the grid over the section.
const GRID: u32 = 5;
/// Scale of the Cauchy loss in sigmas: 95 % efficiency on normal noise (Holland and Welsch 1977).
const CAUCHY_SCALE: f64 = 2.3849;
/// A beam counts as used if its residual is below this many sigmas.
const GATE_SIGMAS: f64 = 4.0;
/// Two minima whose costs (half the sum of squares) differ by less explain the beams about equally well.
const EQUAL_COST: f64 = 3.0;
/// Sums of logarithms are gathered as a product until it exceeds this, so that a descent takes few of them.
const LARGE_PRODUCT: f64 = 1e12;
/// A descent that cannot go on although a step would gain more than this, by the slope, is stuck.
const STUCK_GAIN: f64 = 1e-3;
/// Shortest part of a beam's unit direction that must lie in the section.
const MIN_IN_SECTION: f64 = 0.2;
/// A position is unknown along a direction whose sigma exceeds this share of the section's extent.
const MAX_SIGMA_SHARE: f64 = 0.03;

/// A beam turned into the tunnel.
#[derive(Clone, Copy, Debug)]
pub(super) struct Ray<T> {
    index: usize,
    origin_m: SectionVector<T>,
    /// The unit direction's part in the section: the ray-cast's distance is then the range itself.
    direction: SectionVector<T>,
    range_m: T,
    weight: T,
}

pub(super) type Rays<T> = heapless::Vec<Ray<T>, MAX_BEAMS>;

/// The beams that can be used, turned into the tunnel.
pub(super) fn rays<T: Real>(beams: &[Beam<T>], tunnel_from_body: &UnitQuaternion<T>) -> Rays<T> {
    let mut rays = Rays::new();
    for (index, beam) in beams.iter().enumerate().take(MAX_BEAMS) {
        let Some(range_m) = beam.range_m else { continue };
        let origin_m = (tunnel_from_body * beam.origin_in_body_m).yz();
        let direction = (tunnel_from_body * beam.direction_in_body).yz();
        let finite = range_m.is_finite() && beam.sigma_m.is_finite() && origin_m.norm().is_finite();
        let in_section = direction.norm() >= T::of(MIN_IN_SECTION);
        if finite && in_section && range_m > T::zero() && beam.sigma_m > T::zero() {
            // The vector holds MAX_BEAMS, as many as are taken.
            let _ = rays.push(Ray { index, origin_m, direction, range_m, weight: T::one() / beam.sigma_m });
        }
    }
    rays
}

pub(super) struct Problem<'a, T: Real> {
    pub(super) profile: &'a Profile<T>,
    pub(super) rays: &'a Rays<T>,
}

/// Where a descent starts.
pub(super) enum Start<T: Real> {
    At(SectionVector<T>),
    /// A place of the grid that lies outside the profile.
    Outside,
    /// All have been tried.
    End,
}

/// The beams' view of one position.
#[derive(Clone, Copy)]
struct Normal<T: Real> {
    /// Cauchy cost, in units of half squared sigmas.
    cost: T,
    information: Matrix2<T>,
    gradient: SectionVector<T>,
}

#[derive(Clone, Copy, Debug)]
pub(super) struct Minimum<T: Real> {
    offset_m: SectionVector<T>,
    cost: T,
    information: Matrix2<T>,
    /// The descent ended although the slope goes on: a beam at a corner of the profile, where its expected range jumps.
    pub(super) stuck: bool,
}

impl<T: Real> Problem<'_, T> {
    pub(super) fn usable(&self) -> BeamSet {
        self.rays.iter().fold(BeamSet::default(), |set, ray| set.with(ray.index))
    }

    /// Residual in sigmas and its derivative with respect to the position.
    ///
    /// On the wall `n . (o + t d) = const`, so `dt/do = -n / (n . d)` and the residual `m - t` changes by `+n / (n . d)`.
    fn residual(&self, ray: &Ray<T>, offset_m: SectionVector<T>) -> Option<(T, SectionVector<T>)> {
        let (expected_m, normal) = self.profile.wall_ahead(offset_m + ray.origin_m, ray.direction)?;
        let closing = normal.dot(&ray.direction);
        // A wall seen from behind means that the position lies outside; one seen edge-on tells nothing.
        if closing > -T::of(1e-3) {
            return None;
        }
        Some(((ray.range_m - expected_m) * ray.weight, normal * (ray.weight / closing)))
    }

    /// Normal equations at a position; `None` where a beam meets no wall from within.
    fn normal(&self, offset_m: SectionVector<T>) -> Option<Normal<T>> {
        let scale2 = T::of(CAUCHY_SCALE * CAUCHY_SCALE);
        let mut normal = Normal { cost: T::zero(), information: Matrix2::zeros(), gradient: SectionVector::zeros() };
        let (mut logarithms, mut product) = (T::zero(), T::one());
        for ray in self.rays {
            let (residual, derivative) = self.residual(ray, offset_m)?;
            let share = residual * residual / scale2;
            let robust = T::one() / (T::one() + share);
            product *= T::one() + share;
            if product > T::of(LARGE_PRODUCT) {
                logarithms += product.ln();
                product = T::one();
            }
            normal.information += derivative * derivative.transpose() * robust;
            normal.gradient += derivative * (residual * robust);
        }
        normal.cost = scale2 * (logarithms + product.ln()) * T::of(0.5);
        Some(normal)
    }

    pub(super) fn descend(&self, start_m: SectionVector<T>, iterations: &mut u16) -> Option<Minimum<T>> {
        let mut offset_m = start_m;
        let mut normal = self.normal(start_m)?;
        let (low, high) = self.profile.bounds();
        let extent_m = (high - low).norm();
        // Enough to solve along a direction that no beam sees, too little to matter along any other.
        let ridge = T::of(1e-2) / (extent_m * extent_m);
        let tiny_m = extent_m * T::default_epsilon() * T::of(8.0);
        let mut stuck = false;
        for _ in 0..MAX_ITERATIONS {
            *iterations = iterations.saturating_add(1);
            let damped = normal.information + Matrix2::identity() * ridge;
            let step = -(damped.try_inverse()? * normal.gradient);
            // What the step would gain is lost in the cost's rounding: this is the minimum.
            if -step.dot(&normal.gradient) < T::default_epsilon() * T::of(32.0) * (T::one() + normal.cost) {
                break;
            }
            let mut share = T::one();
            let mut accepted = None;
            while share > T::of(1e-3) {
                let candidate = offset_m + step * share;
                if let Some(next) = self.normal(candidate)
                    && next.cost < normal.cost
                {
                    accepted = Some((candidate, next));
                    break;
                }
                share *= T::of(0.4);
            }
            let Some((candidate, next)) = accepted else {
                stuck = -step.dot(&normal.gradient) > T::of(STUCK_GAIN);
                break;
            };
            let moved_m = (candidate - offset_m).norm();
            (offset_m, normal) = (candidate, next);
            if moved_m <= tiny_m {
                break;
            }
        }
        let minimum = Minimum { offset_m, cost: normal.cost, information: normal.information, stuck };
        self.profile.contains(offset_m).then_some(minimum)
    }

    /// The starting points in order: the hint, then a grid over the bounding box.
    pub(super) fn start(&self, index: u32, hint_m: Option<SectionVector<T>>) -> Start<T> {
        let Some(place) = index.checked_sub(1) else { return hint_m.map_or(Start::Outside, Start::At) };
        if place >= GRID * GRID {
            return Start::End;
        }
        let (low, high) = self.profile.bounds();
        let share = |i: u32| (T::count(i) + T::of(0.5)) / T::count(GRID);
        let size = high - low;
        let start_m = low + SectionVector::new(size.x * share(place % GRID), size.y * share(place / GRID));
        if self.profile.contains(start_m) { Start::At(start_m) } else { Start::Outside }
    }

    /// What the minima of all descents say.
    pub(super) fn conclude(
        &self,
        minima: &Minima<T>,
        hint_m: Option<SectionVector<T>>,
        iterations: u16,
    ) -> Centring<T> {
        let Some(best) = minima.best() else { return Centring::Inconsistent { usable: self.usable() } };
        let outcome = |minimum: &Minimum<T>| self.outcome(minimum, iterations);
        match (minima.rival(&best), hint_m) {
            (Some(rival), Some(hint_m)) => {
                let farther = (rival.offset_m - hint_m).norm() >= (best.offset_m - hint_m).norm();
                outcome(if farther { &best } else { &rival })
            }
            (Some(rival), None) => match (outcome(&best), outcome(&rival)) {
                (Centring::Solved(best), Centring::Solved(rival)) => Centring::Ambiguous { fixes: [best, rival] },
                (outcome, _) => outcome,
            },
            (None, _) => outcome(&best),
        }
    }

    pub(super) fn explains_all(&self, minimum: &Minimum<T>) -> bool {
        self.rays.iter().all(|ray| {
            self.residual(ray, minimum.offset_m).is_some_and(|(residual, _)| residual.abs() < T::of(GATE_SIGMAS))
        })
    }

    pub(super) fn outcome(&self, minimum: &Minimum<T>, iterations: u16) -> Centring<T> {
        let (mut used, mut rejected) = (BeamSet::default(), BeamSet::default());
        let mut sum = T::zero();
        for ray in self.rays {
            match self.residual(ray, minimum.offset_m) {
                Some((residual, _)) if residual.abs() < T::of(GATE_SIGMAS) => {
                    used = used.with(ray.index);
                    sum += residual * residual;
                }
                _ => rejected = rejected.with(ray.index),
            }
        }
        if used.len() < 2 {
            return Centring::Inconsistent { usable: self.usable() };
        }
        let (low, high) = self.profile.bounds();
        let largest_sigma_m = (high - low).norm() * T::of(MAX_SIGMA_SHARE);
        let floor = T::one() / (largest_sigma_m * largest_sigma_m);
        let eigen = SymmetricEigen::new(minimum.information);
        let weakest = eigen.eigenvalues.imin();
        let undetermined = eigen.eigenvalues.min() < floor;
        let bounded = eigen.eigenvalues.map(|value| T::one() / value.max(floor));
        let covariance_m2 = eigen.eigenvectors * Matrix2::from_diagonal(&bounded) * eigen.eigenvectors.transpose();
        let residual_sigmas = (sum / T::count(used.len())).sqrt();
        let fix = Fix { offset_m: minimum.offset_m, covariance_m2, used, rejected, residual_sigmas, iterations };
        if undetermined {
            Centring::Undetermined { fix, free_direction: eigen.eigenvectors.column(weakest).into_owned() }
        } else {
            Centring::Solved(fix)
        }
    }
}

/// The minima of all descents so far.
#[derive(Clone, Debug)]
pub(super) struct Minima<T: Real> {
    found: heapless::Vec<Minimum<T>, 26>,
}

impl<T: Real> Minima<T> {
    pub(super) fn new() -> Self {
        Self { found: heapless::Vec::new() }
    }

    pub(super) fn offer(&mut self, minimum: Option<Minimum<T>>) {
        if let Some(minimum) = minimum {
            // Room for the hint and every start of the grid.
            let _ = self.found.push(minimum);
        }
    }

    fn best(&self) -> Option<Minimum<T>> {
        self.found.iter().copied().reduce(|best, next| if next.cost < best.cost { next } else { best })
    }

    /// The best minimum that lies elsewhere and explains the beams about as well.
    fn rival(&self, best: &Minimum<T>) -> Option<Minimum<T>> {
        self.found
            .iter()
            .filter(|minimum| minimum.cost - best.cost < T::of(EQUAL_COST))
            .filter(|minimum| {
                // Elsewhere: farther than the beams' own uncertainty at the best place (9 = three sigmas squared).
                let apart = minimum.offset_m - best.offset_m;
                apart.dot(&(best.information * apart)) > T::of(9.0)
            })
            .copied()
            .reduce(|best, next| if next.cost < best.cost { next } else { best })
    }
}
