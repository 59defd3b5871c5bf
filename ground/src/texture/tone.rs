//! Exposure per photo and shading shared by all photos, solved together from where photos overlap.
//!
//! Model, per colour channel: `log I = log albedo + gain(photo) + shading(u, v)`, `I` the grey level plus [`SRGB_OFFSET`]: there
//! the sRGB curve is a power law, and a factor on the light is one factor for dark and bright (on the level itself, twice the
//! light is a factor of 1.41 in the dark and 1.36 in the bright). The shading is a polynomial in the
//! offset (u, v) from the principal point over the half diagonal: all terms up to the fourth order (vignetting, and a
//! lamp beside the lens that lights one side more) and r^6. On concrete it leaves 1.3 % between photos of the same
//! place; r^2, r^4 and r^6 alone leave 5.9 %, and their error adds up to a trend along the tunnel. The albedo of each place is eliminated (differences to the mean of the views of that place);
//! what is left is linear least squares with weak priors, re-weighted against highlights and things that moved
//! (a Geman-McClure loss), solved by conjugate gradients, so cost grows linearly with the number of photos.

use adit_geometry::camera::Camera;

use super::layer::Rgbx;

/// Standard deviation of a photo's log exposure about the mean.
const GAIN_SIGMA: f64 = 0.5;
/// Standard deviation of a place's log albedo about the mean. It alone decides between a wall that grows darker over
/// many photos and exposures that do: photos cannot tell. Wide, so that it says nothing about single photos.
const ALBEDO_SIGMA: f64 = 1.0;
/// Standard deviation of each coefficient of the shading.
const SHADING_SIGMA: f64 = 0.5;
/// That of the odd ones, which only a lamp beside the lens makes (0.05 for 7 cm at 3 m). A shading that grows along the axis, exposures
/// that drift and a wall that darkens look the same to the photos; without this the drift is taken for the other two.
const ODD_SIGMA: f64 = 0.05;
/// Which coefficients are odd in u or in v.
const ODD_TERMS: [usize; 6] = [0, 1, 5, 6, 7, 8];
/// Noise of a sample's logarithm: texture that two photos average differently.
const NOISE_SIGMA: f64 = 0.04;
/// Rounds of re-weighting, with the loss's width in units of [`NOISE_SIGMA`].
const LOSS_WIDTHS: [f64; 4] = [20.0, 8.0, 3.0, 3.0];
/// Conjugate gradient steps at most; 50 photos need about 30.
const CG_STEPS: usize = 400;
/// Samples outside are clipped, or below the sRGB curve's straight foot.
const USABLE_LEVELS: std::ops::Range<f32> = 11.0..249.0;
/// The sRGB curve (IEC 61966-2-1) is `level + 255 * 0.055 = 255 * 1.055 * light^(1 / 2.4)` above its foot.
const SRGB_OFFSET: f32 = 255.0 * 0.055;
/// Its exponent: a log factor on the light is so many times that on the level with its offset.
const SRGB_GAMMA: f64 = 2.4;
/// Coefficients of the shading.
const TERMS: usize = 15;
/// Steps of the lookup table across and down a photo; interpolation errs by less than 0.1 %.
const TABLE_STEPS: [usize; 2] = [48, 36];

/// The colour of one place in one photo.
#[derive(Clone, Copy, Debug)]
pub(super) struct ToneSample {
    /// Identifies the place.
    pub(super) cell: u32,
    /// Identifies the photo.
    pub(super) view: u32,
    /// Mean colour, 0..=255.
    pub(super) colour: [f32; 3],
    /// Offset from the principal point over the half diagonal.
    pub(super) offset: [f32; 2],
}

/// What was found.
#[derive(Clone, Debug)]
pub(super) struct Tones {
    /// Log gain per photo and channel.
    gains: Vec<[f64; 3]>,
    /// Coefficients of the shading per channel.
    shading: [[f64; TERMS]; 3],
    /// Root mean square of the differences (log, green) between overlapping photos before and after.
    pub(super) rms_before: f64,
    pub(super) rms_after: f64,
}

/// Offset of a pixel from the principal point, over the half diagonal.
pub(super) fn offset(camera: &Camera<f64>, pixel: [f32; 2]) -> [f32; 2] {
    let half_diagonal_px = f64::from(camera.width_px).hypot(f64::from(camera.height_px)) * 0.5;
    std::array::from_fn(|axis| ((f64::from(pixel[axis]) - camera.centre_px[axis]) / half_diagonal_px) as f32)
}

/// The polynomial's terms at an offset.
fn terms([u, v]: [f32; 2]) -> [f64; TERMS] {
    let (u, v) = (f64::from(u), f64::from(v));
    let (uu, uv, vv) = (u * u, u * v, v * v);
    let r2 = uu + vv;
    [u, v, uu, uv, vv, uu * u, uu * v, vv * u, vv * v, uu * uu, uu * uv, uu * vv, uv * vv, vv * vv, r2 * r2 * r2]
}

impl Tones {
    /// Log shading of a channel at an offset.
    fn shading_log(&self, channel: usize, offset: [f32; 2]) -> f64 {
        terms(offset).iter().zip(self.shading[channel]).map(|(term, coefficient)| term * coefficient).sum()
    }

    /// Factors on the red, green and blue light that a photo's exposure makes, against the mean of all.
    pub(super) fn light_gains(&self) -> impl Iterator<Item = [f64; 3]> {
        self.gains.iter().map(|gain| gain.map(|log| (SRGB_GAMMA * log).exp()))
    }

    /// Mean light (green) at the four corners of a photo against its principal point.
    pub(super) fn corner_brightness(&self, camera: &Camera<f64>) -> f64 {
        let (width, height) = (camera.width_px as f32, camera.height_px as f32);
        let corners = [[0.0, 0.0], [width, 0.0], [0.0, height], [width, height]];
        let light = |corner| (SRGB_GAMMA * self.shading_log(1, offset(camera, corner))).exp();
        corners.map(light).iter().sum::<f64>() / 4.0
    }
}

/// Factors that bring a photo's colours to the common exposure.
pub(super) struct ToneCurve {
    /// Row by row, [`TABLE_STEPS`] + 1 in each direction.
    table: Vec<[f32; 4]>,
    steps_per_px: [f32; 2],
}

impl ToneCurve {
    pub(super) fn new(camera: &Camera<f64>, tones: &Tones, view: usize) -> Self {
        let [across, down] = TABLE_STEPS;
        let (width, height) = (camera.width_px as f32, camera.height_px as f32);
        let mut table = Vec::with_capacity((across + 1) * (down + 1));
        for row in 0..=down {
            for column in 0..=across {
                let pixel = [width * column as f32 / across as f32, height * row as f32 / down as f32];
                let offset = offset(camera, pixel);
                let factor =
                    |channel: usize| (-tones.gains[view][channel] - tones.shading_log(channel, offset)).exp() as f32;
                table.push([factor(0), factor(1), factor(2), 1.0]);
            }
        }
        Self { table, steps_per_px: [across as f32 / width, down as f32 / height] }
    }

    /// A colour of the photo as it would be at the common exposure.
    pub(super) fn evened(&self, colour: Rgbx, [u_px, v_px]: [f32; 2]) -> Rgbx {
        let factors = self.factors(u_px, v_px);
        std::array::from_fn(|i| (colour[i] + SRGB_OFFSET) * factors[i] - SRGB_OFFSET)
    }

    /// The inverse of [`Self::evened`].
    pub(super) fn unevened(&self, colour: Rgbx, [u_px, v_px]: [f32; 2]) -> Rgbx {
        let factors = self.factors(u_px, v_px);
        std::array::from_fn(|i| (colour[i] + SRGB_OFFSET) / factors[i] - SRGB_OFFSET)
    }

    /// Factors for red, green and blue at a pixel.
    fn factors(&self, u_px: f32, v_px: f32) -> [f32; 4] {
        let [across, down] = TABLE_STEPS;
        let (x, y) = (u_px.max(0.0) * self.steps_per_px[0], v_px.max(0.0) * self.steps_per_px[1]);
        let (column, row) = ((x as usize).min(across - 1), (y as usize).min(down - 1));
        let (right, below) = ((x - column as f32).min(1.0), (y - row as f32).min(1.0));
        let at = row * (across + 1) + column;
        let (a, b) = (self.table[at], self.table[at + 1]);
        let (c, d) = (self.table[at + across + 1], self.table[at + across + 2]);
        std::array::from_fn(|i| {
            let upper = a[i] + right * (b[i] - a[i]);
            let lower = c[i] + right * (d[i] - c[i]);
            upper + below * (lower - upper)
        })
    }
}

/// Solves gains and shading from the samples; `views` photos, of which some may have no samples (gain 0).
pub(super) fn solve(mut samples: Vec<ToneSample>, views: usize) -> Tones {
    samples.retain(|sample| sample.colour.iter().all(|level| USABLE_LEVELS.contains(level)));
    samples.sort_unstable_by_key(|sample| (sample.cell, sample.view));
    let groups: Vec<&[ToneSample]> =
        samples.chunk_by(|a, b| a.cell == b.cell).filter(|group| group.len() >= 2).collect();
    let mut tones = Tones { gains: vec![[0.0; 3]; views], shading: [[0.0; TERMS]; 3], rms_before: 0.0, rms_after: 0.0 };
    for channel in 0..3 {
        let system = System::new(&groups, channel, views);
        let (solution, before, after) = system.solve();
        for (gains, found) in tones.gains.iter_mut().zip(&solution) {
            gains[channel] = *found;
        }
        tones.shading[channel].copy_from_slice(&solution[views..]);
        if channel == 1 {
            (tones.rms_before, tones.rms_after) = (before, after);
        }
    }
    tones
}

/// One channel's least squares problem. Unknowns: a gain per view, then the coefficients of the shading.
struct System {
    views: usize,
    observations: Vec<Observation>,
    /// Ends of the groups of observations of one place.
    ends: Vec<usize>,
}

struct Observation {
    view: usize,
    /// About the mean of all.
    log: f64,
    terms: [f64; TERMS],
    weight: f64,
}

impl System {
    fn new(groups: &[&[ToneSample]], channel: usize, views: usize) -> Self {
        let mut system = Self { views, observations: Vec::new(), ends: Vec::new() };
        for group in groups {
            system.observations.extend(group.iter().map(|sample| Observation {
                view: sample.view as usize,
                log: f64::from(sample.colour[channel] + SRGB_OFFSET).ln(),
                terms: terms(sample.offset),
                weight: 1.0,
            }));
            system.ends.push(system.observations.len());
        }
        let mean = system.observations.iter().map(|o| o.log).sum::<f64>() / system.observations.len().max(1) as f64;
        for observation in &mut system.observations {
            observation.log -= mean;
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
        let shading: f64 = observation.terms.iter().zip(&solution[self.views..]).map(|(a, b)| a * b).sum();
        solution[observation.view] + shading
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

    /// `A^T W (I - mean) value`, where `value` is given per observation and the mean is drawn to zero by the albedo's prior.
    fn transposed(&self, value: impl Fn(&Observation) -> f64, out: &mut [f64]) {
        for group in self.groups() {
            let total = group.iter().map(|o| o.weight).sum::<f64>() + (NOISE_SIGMA / ALBEDO_SIGMA).powi(2);
            let mean = group.iter().map(|o| o.weight * value(o)).sum::<f64>() / total;
            for o in group {
                let residual = o.weight * (value(o) - mean);
                out[o.view] += residual;
                for (sum, term) in out[self.views..].iter_mut().zip(o.terms) {
                    *sum += residual * term;
                }
            }
        }
    }

    fn prior(&self, index: usize) -> f64 {
        let sigma = match index.checked_sub(self.views) {
            None => GAIN_SIGMA,
            Some(term) if ODD_TERMS.contains(&term) => ODD_SIGMA,
            Some(_) => SHADING_SIGMA,
        };
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
            for (sum, term) in diagonal[self.views..].iter_mut().zip(o.terms) {
                *sum += o.weight * term * term;
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

    const SHADING: [f64; TERMS] =
        [0.1, -0.15, -0.2, 0.05, -0.3, 0.05, 0.0, -0.05, 0.02, -0.1, 0.0, -0.1, 0.05, 0.0, 0.05];

    fn truth() -> Tones {
        let gains = (0..12).map(|view| [0.2 * (f64::from(view) * 1.7).sin(); 3]).collect();
        Tones { gains, shading: [SHADING; 3], rms_before: 0.0, rms_after: 0.0 }
    }

    /// Places seen by three photos each, in a chain.
    fn scene(outliers: bool) -> Vec<ToneSample> {
        let truth = truth();
        let mut samples = Vec::new();
        for view in 0..truth.gains.len() as u32 {
            for reach in 0..3_u32 {
                for spot in 0..40_u32 {
                    let cell = (view + reach) * 40 + spot;
                    let albedo = 60.0 + f64::from(cell * 37 % 100);
                    let along = |step: u32| (spot * step + reach * 29 + view * 7) % 40;
                    let offset = [13, 17].map(|step| along(step) as f32 / 25.0 - 0.8);
                    let odd = outliers && (cell + view).is_multiple_of(11);
                    let factor = (truth.gains[view as usize][1] + truth.shading_log(1, offset)).exp() as f32;
                    let level = (albedo as f32 + SRGB_OFFSET) * factor - SRGB_OFFSET;
                    let level = if odd { level * 0.5 } else { level };
                    samples.push(ToneSample { cell, view, colour: [level; 3], offset });
                }
            }
        }
        samples
    }

    fn worst_gain_error(found: &Tones) -> f64 {
        let truth = truth();
        let errors: Vec<f64> = found.gains.iter().zip(&truth.gains).map(|(f, t)| f[1] - t[1]).collect();
        let offset = errors.iter().sum::<f64>() / errors.len() as f64;
        errors.iter().map(|error| (error - offset).abs()).fold(0.0, f64::max)
    }

    #[test]
    fn gains_and_shading_are_found() {
        let found = solve(scene(false), truth().gains.len());
        assert!(worst_gain_error(&found) < 0.02, "{found:?}");
        for offset in [[0.5, 0.4], [-0.6, 0.2], [0.0, -0.5]] {
            let error = found.shading_log(0, offset) - truth().shading_log(0, offset);
            assert!(error.abs() < 0.02, "{error} at {offset:?}");
        }
        assert!(found.rms_after < 0.01 && found.rms_before > 0.05);
    }

    #[test]
    fn highlights_and_shadows_do_not_pull_the_gains() {
        assert!(worst_gain_error(&solve(scene(true), truth().gains.len())) < 0.03);
    }

    #[test]
    fn a_photo_that_overlaps_nothing_keeps_its_exposure() {
        let views = truth().gains.len();
        assert_eq!(solve(scene(false), views + 1).gains[views], [0.0; 3]);
    }

    #[test]
    fn the_table_of_factors_follows_the_polynomial() {
        let camera = Camera {
            width_px: 1000,
            height_px: 750,
            focal_px: [466.0, 466.0],
            centre_px: [503.0, 373.0],
            distortion: adit_geometry::camera::Distortion::BrownConrady([0.0; 5]),
        };
        let tones = truth();
        let curve = ToneCurve::new(&camera, &tones, 3);
        for pixel in [[0.0, 0.0], [999.5, 749.5], [333.3, 12.0], [501.0, 700.0]] {
            let expected = (-tones.gains[3][0] - tones.shading_log(0, offset(&camera, pixel))).exp();
            let found = f64::from(curve.factors(pixel[0], pixel[1])[0]);
            assert!((found / expected - 1.0).abs() < 1e-3, "{found} {expected} at {pixel:?}");
            let there_and_back = curve.evened(curve.unevened([100.0; 4], pixel), pixel);
            assert!((there_and_back[1] - 100.0).abs() < 1e-3);
        }
    }

    #[test]
    fn a_factor_on_the_light_is_one_factor_whatever_the_level() {
        let srgb = |light: f64| 255.0 * (1.055 * light.powf(1.0 / SRGB_GAMMA) - 0.055);
        let curve = ToneCurve { table: vec![[2.0_f32.powf(1.0 / 2.4); 4]; 49 * 37], steps_per_px: [0.048, 0.048] };
        for light in [0.01, 0.1, 0.45] {
            let found = curve.evened([srgb(light) as f32; 4], [500.0, 400.0])[1];
            assert!((f64::from(found) - srgb(2.0 * light)).abs() < 0.01, "{found} at {light}");
        }
    }
}
