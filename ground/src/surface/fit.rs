//! The ring part from the adjustment's points.

use adit_geometry::SectionVector;
use adit_geometry::profile::Profile;
use nalgebra::{DMatrix, DVector};

use super::ring::{Basis, Rings, dot};
use crate::adjust::{Tracks, median};

/// Distance of rings.
const RING_M: f64 = 0.5;
/// A point farther off the section than this is none of the wall.
const FARTHEST_M: f64 = 0.15;
/// Terms of neighbouring rings differ by about this much.
const BETWEEN_RINGS_M: f64 = 0.005;
/// Terms differ from the section's own by about this much.
const FROM_SECTION_M: f64 = 0.1;
/// Photos see many points of the same bulge: so many points count as one.
const POINTS_PER_SAMPLE: f64 = 20.0;
/// The scale of the points' loss, in robust standard deviations (95 % efficient for Gaussian noise).
const TUKEY: f64 = 4.685;
/// Least standard deviation of points.
const LEAST_SIGMA_M: f64 = 0.001;
/// Rounds of reweighting.
const ROUNDS: usize = 12;

/// A point over the section.
struct Sample {
    terms: Vec<f64>,
    /// Ring before it, and share of the next one.
    ring: usize,
    share: f64,
    height_m: f64,
}

/// Fits the rings to points off the wall. Without points the rings are the section's.
///
/// # Method
/// Least squares of the heights with Tukey's biweight (bulges are relief, not ring), reweighted, the scale from the median
/// of the residuals; terms vary linearly between rings and little from ring to ring. The normal equations are block
/// tridiagonal. Beaton and Tukey, Technometrics 16 (1974), 147.
pub(super) fn fit(tracks: &Tracks, profile: &Profile<f64>) -> Rings {
    let xs = || tracks.positions().iter().map(|point| point.x);
    let (from_m, to_m) = (xs().fold(f64::INFINITY, f64::min), xs().fold(f64::NEG_INFINITY, f64::max));
    let basis = Basis::of(profile);
    if !(to_m >= from_m) {
        return Rings { x0_m: 0.0, step_m: RING_M, terms: vec![vec![0.0; basis.terms()]] };
    }
    let count = ((to_m - from_m) / RING_M).ceil() as usize + 1;
    let mut rings = Rings { x0_m: from_m, step_m: RING_M, terms: vec![vec![0.0; basis.terms()]; count] };
    let samples: Vec<Sample> = tracks
        .positions()
        .iter()
        .filter_map(|point| {
            let nearest = profile.nearest(SectionVector::new(point.y, point.z))?;
            let place = (point.x - from_m) / RING_M;
            (nearest.clearance_m.abs() <= FARTHEST_M).then(|| Sample {
                terms: basis.at(nearest.surface.s_m),
                ring: (place as usize).min(count - 1),
                share: place.fract(),
                height_m: nearest.clearance_m,
            })
        })
        .collect();
    for _ in 0..ROUNDS {
        let residuals: Vec<f64> = samples.iter().map(|sample| sample.height_m - predicted(sample, &rings)).collect();
        let sizes: Vec<f64> = residuals.iter().map(|residual| residual.abs()).collect();
        let sigma_m = (1.4826 * median(&sizes)).max(LEAST_SIGMA_M);
        let weights: Vec<f64> = residuals
            .iter()
            .map(|residual| (1.0 - (residual / (TUKEY * sigma_m)).powi(2)).max(0.0).powi(2) / (sigma_m * sigma_m))
            .collect();
        let Some(terms) = solve(&samples, &weights, count, basis.terms()) else { break };
        rings.terms = terms;
    }
    rings
}

fn predicted(sample: &Sample, rings: &Rings) -> f64 {
    let at = |ring: usize| dot(&sample.terms, &rings.terms[ring.min(rings.terms.len() - 1)]);
    at(sample.ring) * (1.0 - sample.share) + at(sample.ring + 1) * sample.share
}

/// Solves the block-tridiagonal normal equations; `None` if they cannot be solved.
fn solve(samples: &[Sample], weights: &[f64], count: usize, terms: usize) -> Option<Vec<Vec<f64>>> {
    let own = 1.0 / (FROM_SECTION_M * FROM_SECTION_M);
    let tie = 1.0 / (BETWEEN_RINGS_M * BETWEEN_RINGS_M);
    let unit = DMatrix::<f64>::identity(terms, terms);
    let mut diagonal = vec![&unit * own; count];
    let mut beside = vec![&unit * -tie; count.saturating_sub(1)];
    let mut right = vec![DVector::<f64>::zeros(terms); count];
    for ring in 0..count.saturating_sub(1) {
        diagonal[ring] += &unit * tie;
        diagonal[ring + 1] += &unit * tie;
    }
    for (sample, weight) in samples.iter().zip(weights) {
        let weight = weight / POINTS_PER_SAMPLE;
        let row = DVector::from_column_slice(&sample.terms);
        let square = &row * row.transpose() * weight;
        let shares = [1.0 - sample.share, sample.share];
        for (step, share) in shares.into_iter().enumerate().filter(|(step, _)| sample.ring + step < count) {
            diagonal[sample.ring + step] += &square * (share * share);
            right[sample.ring + step] += &row * (weight * share * sample.height_m);
        }
        if sample.ring + 1 < count {
            beside[sample.ring] += &square * (shares[0] * shares[1]);
        }
    }
    // Forward elimination of each ring from the next, then back.
    for ring in 1..count {
        let inverse = diagonal[ring - 1].clone().cholesky()?;
        let factor = inverse.solve(&beside[ring - 1]).transpose();
        let change = &factor * &beside[ring - 1];
        diagonal[ring] -= change;
        let change = &factor * &right[ring - 1];
        right[ring] -= change;
    }
    let mut solution = vec![DVector::zeros(terms); count];
    for ring in (0..count).rev() {
        let mut rest = right[ring].clone();
        if ring + 1 < count {
            rest -= &beside[ring] * &solution[ring + 1];
        }
        solution[ring] = diagonal[ring].clone().cholesky()?.solve(&rest);
    }
    Some(solution.into_iter().map(|terms| terms.iter().copied().collect()).collect())
}

#[cfg(test)]
mod tests {
    use adit_geometry::profile::ProfileSpec;
    use nalgebra::Point3;

    use super::*;

    /// Points on a wall of which `height_m(s, x)` is known.
    fn points(profile: &Profile<f64>, height_m: impl Fn(f64, f64) -> f64) -> Tracks {
        let mut tracks = Tracks::default();
        for row in 0..60 {
            let x_m = f64::from(row) * 0.07;
            for column in 0..150 {
                let s_m = (f64::from(column) + 0.5) / 150.0 * profile.perimeter_m();
                let wall = profile.at(s_m).unwrap();
                let at = wall.point + wall.normal * height_m(s_m, x_m);
                tracks.push(Point3::new(x_m, at.x, at.y), []);
            }
        }
        tracks
    }

    #[test]
    fn ovality_is_found_beside_a_bulge() {
        let profile = ProfileSpec::Circle { radius_m: 3.0 }.build().unwrap();
        let oval = |s_m: f64| 0.03 * (2.0 * s_m / 3.0).cos();
        let bulge = |s_m: f64, x_m: f64| 0.05 * (-((s_m - 5.0).powi(2) + (x_m - 2.0).powi(2)) / 0.18).exp();
        let rings = fit(&points(&profile, |s_m, x_m| oval(s_m) + bulge(s_m, x_m)), &profile);
        for terms in &rings.terms {
            assert!((terms[3] - 0.03).abs() < 0.001 && terms[0].abs() < 0.001, "{terms:?}");
        }
    }

    #[test]
    fn a_leaning_wall_is_an_offset_and_a_tilt_of_its_plane_alone() {
        let profile = ProfileSpec::Rectangle { width_m: 4.0, height_m: 3.0, axis_height_m: 1.5 }.build().unwrap();
        let wall = profile.pieces().iter().position(|piece| piece.part() == adit_geometry::profile::Part::RightWall);
        let piece = profile.pieces()[wall.unwrap()];
        let lean = |s_m: f64, _: f64| {
            let place = (s_m - piece.start_s_m()) / piece.length_m();
            if (0.0..1.0).contains(&place) { 0.01 + 0.02 * (2.0 * place - 1.0) } else { 0.0 }
        };
        let rings = fit(&points(&profile, lean), &profile);
        let at = rings.at(2.0);
        let big: Vec<f64> = at.iter().copied().filter(|term| term.abs() > 0.002).collect();
        assert!(big.len() == 2 && (big[0] - 0.01).abs() < 1e-3 && (big[1] - 0.02).abs() < 1e-3, "{at:?}");
    }

    #[test]
    fn without_points_the_rings_are_the_section_s() {
        let profile = ProfileSpec::Circle { radius_m: 3.0 }.build().unwrap();
        assert_eq!(fit(&Tracks::default(), &profile).at(7.0), vec![0.0; 5]);
    }
}
