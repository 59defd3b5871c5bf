//! Which photos see the same wall, and how far the shaft turned between them.

use adit_geometry::angles::{shaft_step_rad, wrap_half_turn};
use adit_geometry::rig::{Rig, nominal_rotation};
use nalgebra::{UnitQuaternion, UnitVector3, Vector3};
use rayon::prelude::*;

use super::UntaggedError;

/// A relative rotation further than this from a whole number of steps about the shaft comes from wrong matches. Wide enough
/// for shaft and attitude noise and for the twin of a flat wall, narrow enough to tell steps apart.
const OFF_STEP_RAD: f64 = 0.15;
/// Steps between successive photos that are believed: up to two missed photos.
const MOST_STEPS: i64 = 3;

/// Matches of two photos.
#[derive(Clone, Debug, PartialEq)]
pub struct Link {
    /// Indices of the photos, ascending.
    pub photos: [usize; 2],
    /// Pairs of rays `[in first cam, in second cam]` that agree with one motion.
    pub rays: Vec<[UnitVector3<f64>; 2]>,
    /// The rotation of that motion.
    pub second_from_first: UnitQuaternion<f64>,
}

/// Photos and the matches between them.
#[derive(Clone, Debug, PartialEq)]
pub struct ViewGraph {
    /// Nominal shaft angle of each photo against the first, not wrapped.
    pub shaft_rad: Vec<f64>,
    /// Pairs that see the same wall.
    pub links: Vec<Link>,
}

/// Matches `photos` photos, in order of capture, with `find`: successive ones first, then those that the turns so found put
/// side by side one turn on.
///
/// # Errors
/// [`UntaggedError::TooFewPhotos`], [`UntaggedError::NoTurn`].
pub fn view_graph(
    photos: usize,
    rig: &Rig<f64>,
    find: impl Fn([usize; 2]) -> Option<Link> + Sync,
) -> Result<ViewGraph, UntaggedError> {
    if photos < 2 {
        return Err(UntaggedError::TooFewPhotos { photos });
    }
    let step_rad: f64 = shaft_step_rad(rig.images_per_turn);
    let found: Vec<Option<Link>> = (1..photos).into_par_iter().map(|second| find([second - 1, second])).collect();
    let steps: Vec<Option<i64>> =
        found.iter().map(|link| whole_steps(&turn_of(rig, link.as_ref()?), step_rad)).collect();
    let forward = steps.iter().flatten().filter(|steps| **steps > 0).count();
    let backward = steps.iter().flatten().filter(|steps| **steps < 0).count();
    if forward + backward == 0 {
        let step_deg = 360 / rig.images_per_turn.max(1);
        return Err(UntaggedError::NoTurn { pairs: photos - 1, step_deg });
    }
    let sign = if forward >= backward { 1 } else { -1 };
    let mut angle = 0;
    let mut shaft_rad = vec![0.0];
    let mut links = Vec::new();
    for (link, steps) in found.into_iter().zip(steps) {
        let believed = steps.filter(|steps| steps * sign > 0);
        if believed.is_some() {
            links.extend(link);
        }
        angle += believed.unwrap_or(sign);
        shaft_rad.push(angle as f64 * step_rad);
    }
    let turn_on = turn_pairs(&shaft_rad, step_rad);
    let others: Vec<Link> = turn_on
        .into_par_iter()
        .filter_map(|pair| {
            let link = find(pair)?;
            let expected_rad = wrap_half_turn(shaft_rad[pair[1]] - shaft_rad[pair[0]]);
            let off = turn_of(rig, &link) - Vector3::new(expected_rad, 0.0, 0.0);
            (off.norm() < OFF_STEP_RAD).then_some(link)
        })
        .collect();
    links.extend(others);
    Ok(ViewGraph { shaft_rad, links })
}

/// The turn of the camera between the photos as a rotation vector in tunnel axes, for a vehicle that stays level.
fn turn_of(rig: &Rig<f64>, link: &Link) -> Vector3<f64> {
    nominal_rotation(rig.image_up, 0.0) * link.second_from_first.inverse().scaled_axis()
}

/// The turn in steps of the shaft, if it is a turn about the shaft by some steps.
fn whole_steps(turn: &Vector3<f64>, step_rad: f64) -> Option<i64> {
    let steps = (turn.x / step_rad).round();
    let off = turn - Vector3::new(steps * step_rad, 0.0, 0.0);
    let steps = steps as i64;
    (steps != 0 && steps.abs() <= MOST_STEPS && off.norm() < OFF_STEP_RAD).then_some(steps)
}

/// Pairs about one turn apart whose shaft angles differ by at most a step.
fn turn_pairs(shaft_rad: &[f64], step_rad: f64) -> Vec<[usize; 2]> {
    let one_turn = std::f64::consts::TAU;
    let mut pairs = Vec::new();
    for first in 0..shaft_rad.len() {
        for second in first + 2..shaft_rad.len() {
            let between = (shaft_rad[second] - shaft_rad[first]).abs() - one_turn;
            if between > 1.5 * step_rad {
                break;
            }
            if between > -1.5 * step_rad {
                pairs.push([first, second]);
            }
        }
    }
    pairs
}
