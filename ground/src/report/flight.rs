//! How the flight went by its tags: speed against its limit, place in the section as the board saw it, water, flags.

use adit_geometry::SectionVector;
use adit_geometry::profile::Profile;
use adit_protocol::tag::TagFlags;
use nalgebra::Vector3;
use serde::Serialize;

use super::figures::{Series, line_plot};
use crate::adjust::median;
use crate::poses::Reconstruction;
use crate::survey::Survey;

/// A single reading of the downward sensor is no water.
const LEAST_READINGS: usize = 5;

/// The flight in a few numbers; absent where the tags do not say.
#[derive(Clone, Debug, Default, Serialize)]
pub(super) struct FlightFigures {
    /// Median of the measured speed at the captures.
    median_speed_mps: Option<f64>,
    /// Captures with a speed and a limit.
    with_limit: usize,
    /// Of these, above the limit.
    above_limit: usize,
    /// Root mean square difference of the board's place in the section from the adjusted one.
    board_offset_rms_mm: Option<f64>,
    /// Median of what lies on the floor (water or sludge) by the downward range, against its noise of one reading.
    water_level_mm: Option<f64>,
    /// Largest running median over a turn.
    highest_water_mm: Option<f64>,
    /// How often each flag was set, those that were.
    flags: Vec<(&'static str, usize)>,
}

/// Figures and plots.
pub(super) struct Flight {
    pub(super) figures: FlightFigures,
    pub(super) speed_svg: Option<String>,
    pub(super) water_svg: Option<String>,
}

impl Flight {
    pub(super) fn new(survey: &Survey, reconstruction: &Reconstruction, profile: &Profile<f64>) -> Self {
        let tagged =
            survey.photos.iter().zip(&reconstruction.poses).filter_map(|(photo, pose)| Some((photo.tag?, pose)));
        let lever_m = survey.config.rig.lever_radial_m;
        let (mut speeds, mut waters, mut offsets) = (Vec::new(), Vec::new(), Vec::new());
        let mut figures = FlightFigures::default();
        let mut counts = TagFlags::NAMES.map(|(name, _)| (name, 0));
        for (tag, pose) in tagged {
            let cam = &pose.tunnel_from_cam;
            let x_m = cam.translation.x;
            // The attitude is a degree or two: it does not move the body's place, and lengthens the beam by a thousandth.
            let body = cam.translation.vector - cam.rotation * (Vector3::z() * lever_m);
            for ((_, count), (_, flag)) in counts.iter_mut().zip(TagFlags::NAMES) {
                *count += usize::from(tag.flags.contains(flag));
            }
            if let Some(speed) = tag.speed_mps {
                let limit = tag.speed_limit_mps.map(f64::from);
                speeds.push((x_m, f64::from(speed), limit));
            }
            if let Some([y_m, z_m]) = tag.offset_m {
                offsets.push((f64::from(y_m) - body.y).powi(2) + (f64::from(z_m) - body.z).powi(2));
            }
            let down = profile.ray_cast(body.yz(), SectionVector::new(0.0, 1.0));
            if let (Some(hit), Some(range_m)) = (down, tag.ranges.down_m) {
                waters.push((x_m, (hit.distance - f64::from(range_m)) * 1e3));
            }
        }
        figures.flags = counts.into_iter().filter(|(_, count)| *count > 0).collect();
        let limited: Vec<_> = speeds.iter().filter_map(|&(x_m, speed, limit)| Some((x_m, speed, limit?))).collect();
        figures.with_limit = limited.len();
        figures.above_limit = limited.iter().filter(|(_, speed, limit)| speed > limit).count();
        let all: Vec<f64> = speeds.iter().map(|&(_, speed, _)| speed).collect();
        figures.median_speed_mps = (!all.is_empty()).then(|| median(&all));
        let mean = offsets.iter().sum::<f64>() / offsets.len().max(1) as f64;
        figures.board_offset_rms_mm = (!offsets.is_empty()).then(|| mean.sqrt() * 1e3);
        let running = running_medians(&waters, usize::from(survey.config.rig.images_per_turn));
        if waters.len() >= LEAST_READINGS {
            figures.water_level_mm = Some(median(&waters.iter().map(|&(_, mm)| mm).collect::<Vec<_>>()));
            figures.highest_water_mm = running.iter().copied().reduce(f64::max);
        }
        let speed_svg = (!limited.is_empty()).then(|| speed_plot(&limited));
        let water_svg = (waters.len() >= LEAST_READINGS).then(|| water_plot(&waters, running));
        Self { figures, speed_svg, water_svg }
    }
}

/// Medians over windows of `count` readings.
fn running_medians(readings: &[(f64, f64)], count: usize) -> Vec<f64> {
    let half = (count / 2).max(1);
    let window = |index: usize| &readings[index.saturating_sub(half)..(index + half + 1).min(readings.len())];
    let values = |index: usize| window(index).iter().map(|&(_, value)| value).collect::<Vec<_>>();
    (0..readings.len()).map(|index| median(&values(index))).collect()
}

/// Place, speed and limit of every capture that has one.
fn speed_plot(limited: &[(f64, f64, f64)]) -> String {
    let xs: Vec<f64> = limited.iter().map(|&(x_m, ..)| x_m).collect();
    let series = [
        Series { class: "a", label: "speed", values: limited.iter().map(|&(_, speed, _)| speed).collect() },
        Series { class: "b", label: "limit", values: limited.iter().map(|&(.., limit)| limit).collect() },
    ];
    line_plot(&xs, &series, "m/s")
}

fn water_plot(waters: &[(f64, f64)], running: Vec<f64>) -> String {
    let xs: Vec<f64> = waters.iter().map(|&(x_m, _)| x_m).collect();
    let series = [
        Series { class: "c", label: "readings", values: waters.iter().map(|&(_, mm)| mm).collect() },
        Series { class: "a", label: "over a turn", values: running },
    ];
    line_plot(&xs, &series, "mm")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_stray_reading_is_no_high_water() {
        let mut readings: Vec<(f64, f64)> = (0..40).map(|index| (0.1 * f64::from(index), 30.0)).collect();
        readings[17].1 = 900.0;
        assert!(running_medians(&readings, 10).iter().all(|&mm| (mm - 30.0).abs() < 1e-9));
    }
}
