//! What a round of matching needs to be told.

use adit_geometry::camera::Camera;
use adit_geometry::profile::Profile;

/// Focal length beyond which a photo is matched at less than its own resolution, pixels: that of 1.5 to 2 megapixels.
const MOST_FOCAL_PX: f64 = 800.0;

/// Texel of the blurred grid: three of them are the least wavelength in a bond of the commonest bricks, 125 mm.
const BLURRED_GRID_M: f64 = 0.049;

/// Parameters of one round. Texels are those of the wall grid.
#[derive(Clone, Debug, PartialEq)]
pub struct MatchConfig {
    /// Step of the wall grid, metres per texel (rounded so that the perimeter is a whole number of texels).
    pub grid_m: f64,
    /// Side of the square template, texels (made odd).
    pub template_px: usize,
    /// Least half-width of the search window, texels.
    pub min_search_px: usize,
    /// Half-width of the search window in standard deviations of the predicted displacement.
    pub search_sigmas: f64,
    /// Greatest half-width of the search window, texels: a photo known worse than that is not worth its quadratic cost.
    pub max_search_px: usize,
    /// Factor by which the window grows when a pair that should overlap does not agree; 1 = no second try.
    pub widen: f64,
    /// Band-pass: standard deviation of the smaller Gaussian, texels.
    pub band_small_px: f32,
    /// Band-pass and local contrast: standard deviation of the larger Gaussian, texels.
    pub band_large_px: f32,
    /// Local contrast (of the logarithm) below which the wall counts as featureless.
    pub contrast_floor: f32,
    /// One reference point is taken per cell of this side, texels.
    pub cell_px: usize,
    /// Half-width of the box over which a point's corner strength is summed, texels.
    pub corner_px: usize,
    /// Least normalised cross-correlation of a match.
    pub min_ncc: f32,
    /// Greatest distance of a match from the pair's common motion, texels.
    pub gate_px: f64,
    /// A pair is tried if its footprints share at least this part of the smaller one.
    pub min_overlap: f64,
    /// Most earlier photos that a photo is paired with, those of greatest overlap first: a vehicle that hovers takes
    /// hundreds of photos of the same wall.
    pub max_partners: usize,
    /// A pair is kept with at least this many agreeing matches ...
    pub min_agreeing: usize,
    /// ... that are at least this share of all its matches.
    pub min_agreeing_share: f64,
    /// Repetitions farther off than the window are harmless, and so are those that the window of this round never reaches:
    /// tells whether photos are looked at for repetitions.
    pub resolve_repeats: bool,
    /// The wall is used where the angle between its normal and the view is at most this, radians.
    pub max_incidence_rad: f64,
}

impl MatchConfig {
    /// Returns the size of a photo's pixel on the wall, metres: mean distance of the wall from the axis over focal length.
    pub fn native_m(profile: &Profile<f64>, camera: &Camera<f64>) -> f64 {
        let samples = 64;
        let mut sum_m = 0.0;
        let mut count = 0.0;
        for sample in 0..samples {
            let s_m = profile.perimeter_m() * f64::from(sample) / f64::from(samples);
            if let Some(surface) = profile.at(s_m) {
                sum_m += surface.point.norm();
                count += 1.0;
            }
        }
        sum_m / f64::max(count, 1.0) / (0.5 * (camera.focal_px[0] + camera.focal_px[1]))
    }

    /// Returns `native_m` of a photo halved until its focal length is at most [`MOST_FOCAL_PX`].
    ///
    /// Templates must cover a brick and windows the tags' uncertainty, whatever the pixels; and what a camera resolves does not
    /// grow with them.
    pub fn matched_m(profile: &Profile<f64>, camera: &Camera<f64>) -> f64 {
        let focal_px = 0.5 * (camera.focal_px[0] + camera.focal_px[1]);
        Self::native_m(profile, camera) * (focal_px / MOST_FOCAL_PX).max(1.0)
    }

    /// The first round: poses known to a degree or two and some centimetres, a grid twice as coarse as the photos.
    pub fn wide(native_m: f64) -> Self {
        Self {
            grid_m: 1.9 * native_m,
            template_px: 21,
            min_search_px: 8,
            search_sigmas: 2.5,
            max_search_px: 100,
            widen: 1.7,
            band_small_px: 1.0,
            band_large_px: 8.0,
            // About the noise of a dark photo.
            contrast_floor: 0.01,
            cell_px: 56,
            corner_px: 4,
            min_ncc: 0.3,
            gate_px: 3.0,
            min_overlap: 0.15,
            max_partners: 40,
            min_agreeing: 6,
            min_agreeing_share: 0.25,
            resolve_repeats: true,
            max_incidence_rad: 68_f64.to_radians(),
        }
    }

    /// The second round: poses known to a few millimetres, the photos' own resolution.
    pub fn fine(native_m: f64) -> Self {
        Self {
            grid_m: 0.95 * native_m,
            template_px: 41,
            min_search_px: 3,
            search_sigmas: 3.0,
            widen: 1.0,
            band_small_px: 0.6,
            band_large_px: 6.0,
            cell_px: 60,
            gate_px: 2.0,
            resolve_repeats: false,
            ..Self::wide(native_m)
        }
    }

    /// The same round too blurred to show bricks or tiles, but stains still: where on a wall that repeats itself is this?
    pub(super) fn blurred(&self) -> Option<Self> {
        self.resolve_repeats.then(|| Self {
            grid_m: BLURRED_GRID_M.max(2.0 * self.grid_m),
            template_px: 21,
            min_search_px: 2,
            band_small_px: 1.2,
            band_large_px: 8.0,
            // What lamp and vignetting leave in this band, which moves with the camera.
            contrast_floor: 0.04,
            cell_px: 8,
            min_ncc: 0.5,
            gate_px: 1.0,
            resolve_repeats: false,
            ..self.clone()
        })
    }
}
