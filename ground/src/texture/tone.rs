//! Exposure per photo and vignetting shared by all photos, solved together from where photos overlap.
//!
//! Model, per colour channel: `log I = log albedo + gain(photo) + v1 r^2 + v2 r^4 + v3 r^6`, with r the distance from
//! the principal point over the half diagonal. In gamma-encoded values an exposure is a factor too (a power law turns
//! factors into factors). The albedo of each place is eliminated (differences to the mean of the views of that place);
//! what is left is linear least squares with weak priors, re-weighted against highlights and things that moved
//! (a Geman-McClure loss), solved by conjugate gradients, so cost grows linearly with the number of photos.

use adit_geometry::camera::Camera;

/// Standard deviation of a photo's log exposure about the mean.
const GAIN_SIGMA: f64 = 0.5;
/// Standard deviation of each vignetting coefficient.
const VIGNETTE_SIGMA: f64 = 0.5;
/// Noise of a sample's logarithm: texture that two photos average differently.
const NOISE_SIGMA: f64 = 0.04;
/// Rounds of re-weighting, with the loss's width in units of [`NOISE_SIGMA`].
const LOSS_WIDTHS: [f64; 4] = [20.0, 8.0, 3.0, 3.0];
/// Conjugate gradient steps at most; 50 photos need about 30.
const CG_STEPS: usize = 400;
/// Samples outside are clipped or drowned in noise.
const USABLE_LEVELS: std::ops::Range<f32> = 8.0..249.0;
/// Vignetting coefficients.
const TERMS: usize = 3;
/// Steps of the lookup table for the vignetting.
const TABLE_STEPS: usize = 256;

/// The colour of one place in one photo.
#[derive(Clone, Copy, Debug)]
pub(super) struct ToneSample {
    /// Identifies the place.
    pub(super) cell: u32,
    /// Identifies the photo.
    pub(super) view: u32,
    /// Mean colour, 0..=255.
    pub(super) colour: [f32; 3],
    /// Squared distance from the principal point over the half diagonal's square.
    pub(super) radius2: f32,
}

/// What was found.
#[derive(Clone, Debug)]
pub(super) struct Tones {
    /// Log gain per photo and channel.
    pub(super) gains: Vec<[f64; 3]>,
    /// Vignetting coefficients per channel.
    pub(super) vignette: [[f64; TERMS]; 3],
    /// Root mean square of the differences (log, green) between overlapping photos before and after.
    pub(super) rms_before: f64,
    pub(super) rms_after: f64,
}

/// Squared distance of a pixel from the principal point, over the half diagonal's square.
pub(super) fn radius2(camera: &Camera<f64>, pixel: [f32; 2]) -> f32 {
    let (du, dv) = (pixel[0] - camera.centre_px[0] as f32, pixel[1] - camera.centre_px[1] as f32);
    (du * du + dv * dv) * inverse_half_diagonal2(camera)
}

fn inverse_half_diagonal2(camera: &Camera<f64>) -> f32 {
    let (width, height) = (camera.width_px as f32, camera.height_px as f32);
    4.0 / (width * width + height * height)
}

/// Factors that bring a photo's colours to the common exposure.
pub(super) struct ToneCurve {
    centre_px: [f32; 2],
    inverse_half_diagonal2: f32,
    /// Per step of r^2, up to the farthest corner.
    table: Vec<[f32; 4]>,
    steps_per_radius2: f32,
}

impl ToneCurve {
    pub(super) fn new(camera: &Camera<f64>, tones: &Tones, view: usize) -> Self {
        let corners = [
            [0.0, 0.0],
            [camera.width_px as f32, 0.0],
            [0.0, camera.height_px as f32],
            [camera.width_px as f32, camera.height_px as f32],
        ];
        let farthest = corners.into_iter().map(|corner| radius2(camera, corner)).fold(0.0, f32::max) * 1.01;
        let table = (0..=TABLE_STEPS)
            .map(|step| {
                let r2 = f64::from(farthest) * step as f64 / TABLE_STEPS as f64;
                let factor = |channel: usize| {
                    (-tones.gains[view][channel] - vignette_log(&tones.vignette[channel], r2)).exp() as f32
                };
                [factor(0), factor(1), factor(2), 0.0]
            })
            .collect();
        Self {
            centre_px: camera.centre_px.map(|centre| centre as f32),
            inverse_half_diagonal2: inverse_half_diagonal2(camera),
            table,
            steps_per_radius2: TABLE_STEPS as f32 / farthest,
        }
    }

    /// Factors for red, green and blue at a pixel.
    pub(super) fn factors(&self, u_px: f32, v_px: f32) -> [f32; 4] {
        let (du, dv) = (u_px - self.centre_px[0], v_px - self.centre_px[1]);
        let step = (du * du + dv * dv) * self.inverse_half_diagonal2 * self.steps_per_radius2;
        let lower = (step as usize).min(TABLE_STEPS - 1);
        let share = (step - lower as f32).min(1.0);
        let (a, b) = (self.table[lower], self.table[lower + 1]);
        std::array::from_fn(|i| a[i] + share * (b[i] - a[i]))
    }
}

fn vignette_log(coefficients: &[f64; TERMS], radius2: f64) -> f64 {
    let mut power = 1.0;
    coefficients
        .iter()
        .map(|coefficient| {
            power *= radius2;
            coefficient * power
        })
        .sum()
}

/// Solves gains and vignetting from the samples; `views` photos, of which some may have no samples (gain 0).
pub(super) fn solve(mut samples: Vec<ToneSample>, views: usize) -> Tones {
    samples.retain(|sample| sample.colour.iter().all(|level| USABLE_LEVELS.contains(level)));
    samples.sort_unstable_by_key(|sample| (sample.cell, sample.view));
    let groups: Vec<&[ToneSample]> =
        samples.chunk_by(|a, b| a.cell == b.cell).filter(|group| group.len() >= 2).collect();
    let mut tones =
        Tones { gains: vec![[0.0; 3]; views], vignette: [[0.0; TERMS]; 3], rms_before: 0.0, rms_after: 0.0 };
    for channel in 0..3 {
        let system = System::new(&groups, channel, views);
        let (solution, before, after) = system.solve();
        for (gains, found) in tones.gains.iter_mut().zip(&solution) {
            gains[channel] = *found;
        }
        tones.vignette[channel].copy_from_slice(&solution[views..]);
        if channel == 1 {
            (tones.rms_before, tones.rms_after) = (before, after);
        }
    }
    tones
}

/// One channel's least squares problem. Unknowns: a gain per view, then the vignetting coefficients.
struct System {
    views: usize,
    observations: Vec<Observation>,
    /// Ends of the groups of observations of one place.
    ends: Vec<usize>,
}

struct Observation {
    view: usize,
    log: f64,
    powers: [f64; TERMS],
    weight: f64,
}

impl System {
    fn new(groups: &[&[ToneSample]], channel: usize, views: usize) -> Self {
        let mut system = Self { views, observations: Vec::new(), ends: Vec::new() };
        for group in groups {
            system.observations.extend(group.iter().map(|sample| {
                let r2 = f64::from(sample.radius2);
                Observation {
                    view: sample.view as usize,
                    log: f64::from(sample.colour[channel]).ln(),
                    powers: [r2, r2 * r2, r2 * r2 * r2],
                    weight: 1.0,
                }
            }));
            system.ends.push(system.observations.len());
        }
        system
    }

    fn solve(mut self) -> (Vec<f64>, f64, f64) {
        let mut solution = vec![0.0; self.views + TERMS];
        let before = self.rms(&solution);
        for width in LOSS_WIDTHS {
            self.reweight(&solution, width * NOISE_SIGMA);
            solution = self.conjugate_gradients(solution);
        }
        let after = self.rms(&solution);
        (solution, before, after)
    }

    fn model(&self, solution: &[f64], observation: &Observation) -> f64 {
        let vignette: f64 = observation.powers.iter().zip(&solution[self.views..]).map(|(a, b)| a * b).sum();
        solution[observation.view] + vignette
    }

    fn groups(&self) -> impl Iterator<Item = &[Observation]> {
        let starts = std::iter::once(0).chain(self.ends.iter().copied());
        starts.zip(&self.ends).map(|(start, &end)| &self.observations[start..end])
    }

    /// Calls `visit` with each observation and its residual against the weighted mean of its place.
    fn residuals(&self, solution: &[f64], mut visit: impl FnMut(usize, f64)) {
        let mut first = 0;
        for group in self.groups() {
            let total: f64 = group.iter().map(|o| o.weight).sum::<f64>().max(1e-12);
            let mean = group.iter().map(|o| o.weight * (o.log - self.model(solution, o))).sum::<f64>() / total;
            for (offset, o) in group.iter().enumerate() {
                visit(first + offset, o.log - self.model(solution, o) - mean);
            }
            first += group.len();
        }
    }

    fn rms(&self, solution: &[f64]) -> f64 {
        let (mut sum, mut weights) = (0.0, 0.0);
        self.residuals(solution, |index, residual| {
            let weight = self.observations[index].weight;
            sum += weight * residual * residual;
            weights += weight;
        });
        if weights > 0.0 { (sum / weights).sqrt() } else { 0.0 }
    }

    fn reweight(&mut self, solution: &[f64], width: f64) {
        let mut weights = vec![1.0; self.observations.len()];
        self.residuals(solution, |index, residual| {
            let scaled = residual / width;
            weights[index] = 1.0 / (1.0 + scaled * scaled).powi(2);
        });
        for (observation, weight) in self.observations.iter_mut().zip(weights) {
            observation.weight = weight;
        }
    }

    /// `A^T W (I - mean) value`, where `value` is given per observation.
    fn transposed(&self, value: impl Fn(&Observation) -> f64, out: &mut [f64]) {
        for group in self.groups() {
            let total: f64 = group.iter().map(|o| o.weight).sum::<f64>().max(1e-12);
            let mean = group.iter().map(|o| o.weight * value(o)).sum::<f64>() / total;
            for o in group {
                let residual = o.weight * (value(o) - mean);
                out[o.view] += residual;
                for (sum, power) in out[self.views..].iter_mut().zip(o.powers) {
                    *sum += residual * power;
                }
            }
        }
    }

    fn prior(&self, index: usize) -> f64 {
        let sigma = if index < self.views { GAIN_SIGMA } else { VIGNETTE_SIGMA };
        (NOISE_SIGMA / sigma).powi(2)
    }

    fn apply(&self, direction: &[f64]) -> Vec<f64> {
        let mut out: Vec<f64> = direction.iter().enumerate().map(|(i, d)| d * self.prior(i)).collect();
        self.transposed(|o| self.model(direction, o), &mut out);
        out
    }

    /// Preconditioned conjugate gradients on the normal equations from a first guess.
    fn conjugate_gradients(&self, mut solution: Vec<f64>) -> Vec<f64> {
        let mut residual = vec![0.0; solution.len()];
        self.transposed(|o| o.log, &mut residual);
        for (r, a) in residual.iter_mut().zip(self.apply(&solution)) {
            *r -= a;
        }
        let mut diagonal: Vec<f64> = (0..solution.len()).map(|i| self.prior(i)).collect();
        for o in &self.observations {
            diagonal[o.view] += o.weight;
            for (sum, power) in diagonal[self.views..].iter_mut().zip(o.powers) {
                *sum += o.weight * power * power;
            }
        }
        let scaled = |residual: &[f64]| -> Vec<f64> { residual.iter().zip(&diagonal).map(|(r, d)| r / d).collect() };
        let mut conditioned = scaled(&residual);
        let mut direction = conditioned.clone();
        let mut energy = dot(&residual, &conditioned);
        let enough = energy * 1e-16;
        for _ in 0..CG_STEPS {
            if energy <= enough {
                break;
            }
            let applied = self.apply(&direction);
            let step = energy / dot(&direction, &applied);
            for i in 0..solution.len() {
                solution[i] += step * direction[i];
                residual[i] -= step * applied[i];
            }
            conditioned = scaled(&residual);
            let next = dot(&residual, &conditioned);
            for (d, c) in direction.iter_mut().zip(&conditioned) {
                *d = c + next / energy * *d;
            }
            energy = next;
        }
        solution
    }
}

fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Places seen by three photos each, in a chain.
    fn scene(outliers: bool) -> (Vec<ToneSample>, Vec<f64>, [f64; TERMS]) {
        let views = 12;
        let truth: Vec<f64> = (0..views).map(|i| 0.2 * (f64::from(i) * 1.7).sin()).collect();
        let vignette = [-0.3, -0.1, 0.05];
        let mut samples = Vec::new();
        for view in 0..views as u32 {
            for reach in 0..3_u32 {
                for spot in 0..40_u32 {
                    let cell = (view + reach) * 40 + spot;
                    let albedo = 60.0 + f64::from(cell * 37 % 100);
                    let radius2 = f64::from((spot * 13 + reach * 29 + view * 7) % 40) / 40.0;
                    let odd = outliers && (cell + view) % 11 == 0;
                    let level = albedo * (truth[view as usize] + vignette_log(&vignette, radius2)).exp();
                    let level = (if odd { level * 0.5 } else { level }) as f32;
                    samples.push(ToneSample { cell, view, colour: [level; 3], radius2: radius2 as f32 });
                }
            }
        }
        (samples, truth, vignette)
    }

    fn worst_gain_error(found: &Tones, truth: &[f64]) -> f64 {
        let offset = found.gains.iter().zip(truth).map(|(f, t)| f[1] - t).sum::<f64>() / truth.len() as f64;
        found.gains.iter().zip(truth).map(|(f, t)| (f[1] - t - offset).abs()).fold(0.0, f64::max)
    }

    #[test]
    fn gains_and_vignetting_are_found() {
        let (samples, truth, vignette) = scene(false);
        let found = solve(samples, truth.len());
        assert!(worst_gain_error(&found, &truth) < 0.01, "{found:?}");
        for r2 in [0.3, 0.9] {
            let error = vignette_log(&found.vignette[0], r2) - vignette_log(&vignette, r2);
            assert!(error.abs() < 0.01, "{error} at {r2}");
        }
        assert!(found.rms_after < 0.01 && found.rms_before > 0.05);
    }

    #[test]
    fn highlights_and_shadows_do_not_pull_the_gains() {
        let (samples, truth, _) = scene(true);
        assert!(worst_gain_error(&solve(samples, truth.len()), &truth) < 0.02);
    }

    #[test]
    fn a_photo_that_overlaps_nothing_keeps_its_exposure() {
        let (samples, truth, _) = scene(false);
        let found = solve(samples, truth.len() + 1);
        assert_eq!(found.gains[truth.len()], [0.0; 3]);
    }
}
