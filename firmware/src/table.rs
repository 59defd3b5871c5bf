//! The speed law's bound over the places allowed in the section, computed once at the start.
//!
//! The exact bound costs far more than a control step may take. So it is computed on a grid of offsets, a piece per step
//! while the board boots; a look-up takes the smallest step among the nodes around the position, as far as its uncertainty
//! reaches.

use adit_geometry::SectionVector;
use adit_geometry::coverage::{Footprint, FootprintSurvey, Scene, max_step};
use adit_geometry::profile::Profile;
use adit_geometry::speed::paper_step;
use adit_protocol::parameters::{Parameters, SpeedBound};
use nalgebra::Vector2;

/// Nodes per axis.
const NODES: usize = 7;
/// The position may be off by as many standard deviations.
const SIGMAS: f32 = 2.0;

/// The bound on the step per image over the offset.
#[derive(Clone, Debug)]
pub struct StepTable {
    offset_max_m: f32,
    view: View,
    steps_m: heapless::Vec<f32, { NODES * NODES }>,
}

/// What the camera sees, as far as it is known.
#[derive(Clone, Debug)]
enum View {
    /// Being found out.
    Survey(FootprintSurvey<f32>),
    /// Known.
    Known(Footprint<f32>),
    /// The camera does not see where the shaft points it.
    None,
}

impl StepTable {
    /// An empty table for these parameters.
    pub(crate) fn new(parameters: &Parameters) -> Self {
        let offset_max_m = parameters.speed.offset_max_m;
        let view = FootprintSurvey::new(&parameters.camera, &parameters.rig, 0.0).map_or(View::None, View::Survey);
        Self { offset_max_m, view, steps_m: heapless::Vec::new() }
    }

    /// Computes the whole table at once, for hosts that fly many times with the same parameters.
    pub fn computed(parameters: &Parameters) -> Self {
        let mut table = Self::new(parameters);
        let profile = parameters.profile.build().ok();
        while !table.is_complete() {
            table.advance(parameters, profile.as_ref());
        }
        table
    }

    /// The same step everywhere.
    #[cfg(test)]
    pub(crate) fn uniform(offset_max_m: f32, step_m: f32) -> Self {
        let steps_m = heapless::Vec::from_array([step_m; NODES * NODES]);
        Self { offset_max_m, view: View::None, steps_m }
    }

    /// Whether every node has its step.
    pub(crate) fn is_complete(&self) -> bool {
        self.steps_m.is_full()
    }

    /// Computes a piece: of the camera's footprint first, then node by node.
    pub(crate) fn advance(&mut self, parameters: &Parameters, profile: Option<&Profile<f32>>) {
        let offset_m = self.node_m(self.steps_m.len());
        let footprint = match &mut self.view {
            View::Survey(survey) => {
                if let Some(footprint) = survey.advance() {
                    self.view = View::Known(footprint);
                }
                return;
            }
            View::Known(footprint) => Some(&*footprint),
            View::None => None,
        };
        let known = profile.zip(footprint);
        let step_m = known.and_then(|(profile, footprint)| bound_m(parameters, profile, footprint, offset_m));
        // A full table stays as it is.
        let _ = self.steps_m.push(step_m.filter(|step_m| step_m.is_finite()).unwrap_or(0.0).max(0.0));
    }

    /// The smallest step around `offset_m`; zero outside the offsets allowed.
    pub(crate) fn step_m(&self, offset_m: [f32; 2], sigma_m: [f32; 2]) -> f32 {
        if !offset_m.iter().all(|offset_m| offset_m.abs() <= self.offset_max_m) {
            return 0.0;
        }
        let spacing_m = self.offset_max_m * 2.0 / (NODES - 1) as f32;
        let near = |node_m: f32, axis: usize| {
            let reach_m = spacing_m + SIGMAS * sigma_m.get(axis).copied().unwrap_or_default();
            // Written so that NaN counts as near.
            !(offset_m.get(axis).is_some_and(|offset_m| (node_m - offset_m).abs() > reach_m))
        };
        let around = self.steps_m.iter().enumerate().filter(|(index, _)| {
            let node_m = self.node_m(*index);
            near(node_m.x, 0) && near(node_m.y, 1)
        });
        smallest(around.map(|(_, step_m)| *step_m))
    }

    /// The smallest step of all.
    pub(crate) fn worst_m(&self) -> f32 {
        smallest(self.steps_m.iter().copied())
    }

    /// The step on the axis.
    pub(crate) fn central_m(&self) -> f32 {
        self.steps_m.get(NODES * NODES / 2).copied().unwrap_or_default()
    }

    fn node_m(&self, index: usize) -> SectionVector<f32> {
        let along = |count: usize| self.offset_max_m * (count as f32 * 2.0 / (NODES - 1) as f32 - 1.0);
        Vector2::new(along(index % NODES), along(index / NODES))
    }
}

fn smallest(steps_m: impl Iterator<Item = f32>) -> f32 {
    steps_m.reduce(f32::min).unwrap_or_default()
}

/// The bound at one offset; `None` where there is none.
fn bound_m(
    parameters: &Parameters,
    profile: &Profile<f32>,
    footprint: &Footprint<f32>,
    offset_m: SectionVector<f32>,
) -> Option<f32> {
    let rig = &parameters.rig;
    let clearance_m = profile.nearest(offset_m)?.clearance_m;
    if !(clearance_m > rig.lever_radial_m.max(0.0)) {
        return None;
    }
    // Images lie on multiples of the step: image 0 of each turn looks up.
    let scene = Scene::new(profile, footprint, rig, offset_m, 0.0).ok()?;
    let exact_m = |views| max_step(&scene, views).ok().map(|bound| bound.per_image_m);
    match parameters.speed.bound {
        SpeedBound::OneView => exact_m(1),
        SpeedBound::TwoViews => exact_m(2),
        SpeedBound::Paper => {
            // As printed, for the largest circle around the axis; on no profile more than the exact bound.
            let radius_m = profile.nearest(Vector2::zeros())?.clearance_m;
            let view = footprint.field_of_view()?;
            let paper = paper_step(radius_m, offset_m.norm(), view, rig.images_per_turn).ok()?;
            Some(paper.per_image_m.min(exact_m(1)?))
        }
    }
}

#[cfg(test)]
mod tests {
    use adit_geometry::profile::ProfileSpec;

    use super::*;

    fn parameters(bound: SpeedBound) -> Parameters {
        let mut parameters = Parameters::default();
        parameters.speed.bound = bound;
        parameters
    }

    #[test]
    fn the_papers_set_up_allows_18_cm_on_the_axis() {
        let table = StepTable::computed(&parameters(SpeedBound::Paper));
        assert!((table.central_m() - 0.1836).abs() < 1e-3, "{}", table.central_m());
    }

    #[test]
    fn two_views_allow_less_than_one_and_the_worst_place_least() {
        let [one, two] =
            [SpeedBound::OneView, SpeedBound::TwoViews].map(|bound| StepTable::computed(&parameters(bound)));
        assert!(two.central_m() < one.central_m() && two.central_m() > 0.05, "{} {}", two.central_m(), one.central_m());
        assert!(one.worst_m() < one.central_m() && two.worst_m() > 0.0);
    }

    #[test]
    fn a_look_up_is_never_above_the_bound_at_that_very_place() {
        let specs = [
            ProfileSpec::Circle { radius_m: 3.0 },
            ProfileSpec::Underpass { width_m: 4.0, wall_m: 2.2, rise_m: 0.8, axis_height_m: 1.5 },
        ];
        for (spec, bound) in specs.into_iter().zip([SpeedBound::OneView, SpeedBound::TwoViews]) {
            let parameters = Parameters { profile: spec, ..parameters(bound) };
            let table = StepTable::computed(&parameters);
            let profile = parameters.profile.build().unwrap();
            let footprint = Footprint::of_camera(&parameters.camera, &parameters.rig, 0.0).unwrap();
            for index in 0..100_u16 {
                let along = |count: u16| f32::from(count) * 0.0999 - 0.4995;
                let offset_m = [along(index % 10), along(index / 10)];
                let exact_m = bound_m(&parameters, &profile, &footprint, offset_m.into()).unwrap();
                let step_m = table.step_m(offset_m, [0.0; 2]);
                assert!(step_m <= exact_m * 1.01, "{offset_m:?}: {step_m} m, exact {exact_m} m");
                assert!(step_m >= exact_m * 0.7, "{offset_m:?}: {step_m} m, exact {exact_m} m");
                assert!(table.step_m(offset_m, [0.1; 2]) <= step_m);
            }
        }
    }

    #[test]
    fn outside_the_offsets_allowed_there_is_no_step() {
        let table = StepTable::uniform(0.5, 0.2);
        assert_eq!(table.step_m([0.0, 0.0], [0.0; 2]), 0.2);
        assert_eq!(table.step_m([0.6, 0.0], [0.0; 2]), 0.0);
        assert_eq!(table.step_m([0.0, -0.51], [0.0; 2]), 0.0);
        assert_eq!(table.step_m([f32::NAN, 0.0], [0.0; 2]), 0.0);
    }

    #[test]
    fn places_in_the_wall_allow_no_step() {
        let mut parameters = parameters(SpeedBound::OneView);
        parameters.profile = ProfileSpec::Circle { radius_m: 0.6 };
        let table = StepTable::computed(&parameters);
        assert_eq!(table.worst_m(), 0.0, "the corners of the square of offsets lie in the wall");
        assert!(table.central_m() > 0.0);
    }
}
