//! From tags and photos to poses: prior, coarse round, fine round, adjustment with pruning.

use std::path::PathBuf;
use std::sync::Arc;

use adit_geometry::camera::Camera;
use adit_geometry::profile::Profile;
use adit_geometry::rig::{ImageUp, Rig};
use adit_protocol::mission::Sigma;
use adit_protocol::tag::CaptureTag;
use anyhow::{Context, Result, bail};
use nalgebra::{Isometry3, Point3, Vector2};
use serde::{Deserialize, Serialize};

use super::groups::registered;
use super::photos::{Hidden, KeptPhotos, SurveyPhotos, Use, size_of};
use super::placing::Placing;
use super::progress::StageProgress;
use super::stages::{AdjustStage, CoarseStage, MatchStage, PriorStage, RoundSummary};
use super::tag_noise::TagNoise;
use super::warnings::Judged;
use crate::adjust::{
    Adjusted, Covariances, Loss as AdjustLoss, Observation, PhotoQuality, Problem, PruneCounts, Pruning, Shared,
    SharedSigmas, Tracks, Weights, adjust, adjust_roughly, median, photo_qualities, prune, tendency,
};
use crate::matching::{MatchConfig, MatchRound, Photos, Pixels, ViewPose, match_round};
use crate::poses::{PhotoPose, PoseStatus, Reconstruction};
use crate::prior::{PriorModel, SizeEstimate, TagPrior, estimate_size, prior_views, tag_priors};
use crate::survey::{Loss, Photo, Survey, load_mask};
use crate::untagged::{Matcher, PlacedPhoto, Untagged, survey_poses};

/// One standard deviation of a match in the coarse round, pixels of the photo as it is matched.
///
/// Said to be worse than they are (0.8), matches let the section bend the poses where the wall is out of shape, and the fine
/// round then looks at a distorted wall: positions came out at twice the error.
const COARSE_MATCH_PX: f64 = 0.25;
/// One standard deviation of a match in the fine round, pixels of the photo as it is matched.
const FINE_MATCH_PX: f64 = 0.3;
/// No match is better than this, whatever the residuals say: the camera model itself is not.
const LEAST_MATCH_PX: f64 = 0.05;
/// A match of the coarse round is disputed by the adjustment from this error on, pixels of the photo as it is matched.
const DISPUTED_PX: f64 = 4.0;
/// Geman-McClure scale in standard deviations.
const ROBUST: AdjustLoss = AdjustLoss::GemanMcClure(3.0);
/// Softness of the surface: real linings are out of shape by centimetres, and points must be free to say so.
const SURFACE_M: f64 = 0.05;
/// No lining is taken for truer than this.
const LEAST_SURFACE_M: f64 = 0.005;
/// So many points lie on the same unevenness and count as one.
const POINTS_PER_UNEVENNESS: f64 = 20.0;

/// Freedom of the section's size where the ranges contradict the nominal one: the ranges decide.
const RESIZED_SIGMA: f64 = 0.05;
/// Freedom of focal length and principal point where `refine` asks for it, as a share of the focal length.
const REFINED_SHARE: f64 = 0.02;
/// Freedom of each distortion coefficient where `refine` asks for it.
const REFINED_DISTORTION: f64 = 0.05;
/// Steps that show what the photos would have the camera be; the first does most of it.
const TENDENCY_STEPS: usize = 2;
/// Speed that the shaft may still have while a photo is read out, radians per second: a servo that has not quite settled.
const SHUTTER_SIGMA_RAD_PER_S: f64 = 0.3;

/// What the pose stages are allowed to do.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct SolveOptions {
    /// The paper's P1: use masks.
    pub prune_mask: bool,
    /// The paper's P2: drop points off the section.
    pub prune_surface: bool,
    /// The paper's P3: drop sightings with a large reprojection error.
    pub prune_reprojection: bool,
    /// Where the first poses come from.
    pub start: Start,
}

/// Where the first poses come from, which guided matching starts with.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Start {
    /// From the tags; of photos without any tag as [`Self::RepMatch`].
    Tags,
    /// From the photos' features alone, matched by likelihood and motion curves.
    RepMatch,
    /// From the photos' features alone, matched by the ratio test.
    Ratio,
    /// From the tags, and they stay: no photo is matched (the authors' feature-less method).
    TagsOnly,
}

impl Default for SolveOptions {
    /// All three steps.
    fn default() -> Self {
        Self { prune_mask: true, prune_surface: true, prune_reprojection: true, start: Start::Tags }
    }
}

/// What all pose stages share.
pub struct Solver<'a> {
    pub(crate) survey: &'a Survey,
    /// The section in use.
    pub(super) profile: Profile<f64>,
    options: SolveOptions,
    photos: Arc<KeptPhotos>,
}

impl<'a> Solver<'a> {
    /// Prepares a survey, with the nominal section.
    ///
    /// # Errors
    /// If the survey's section cannot be built.
    pub fn new(survey: &'a Survey, options: SolveOptions) -> Result<Self> {
        let profile = survey.config.profile.build().context("survey.toml: [tunnel]")?;
        Ok(Self { survey, profile, options, photos: Arc::new(KeptPhotos::new(survey)) })
    }

    /// The same with the section that the prior stage chose.
    ///
    /// # Errors
    /// If the section cannot be built.
    pub fn with_section(self, prior: &PriorStage) -> Result<Self> {
        Ok(Self { profile: prior.profile.build().context("the section")?, ..self })
    }

    /// Poses from the tags, and the section's size from the ranges; or, without tags, poses from the photos' features.
    ///
    /// # Errors
    /// If the resized section cannot be built, or photos without tags do not show a turning camera.
    pub fn prior(&self) -> Result<PriorStage> {
        let no_tags = self.survey.photos.iter().all(|photo| photo.tag.is_none());
        match self.options.start {
            Start::TagsOnly if no_tags => {
                bail!("no photo has a tag, and without matches nothing else says where it was taken")
            }
            Start::Tags if !no_tags => self.prior_of_tags(),
            Start::TagsOnly => self.prior_of_tags(),
            Start::Tags | Start::RepMatch => self.prior_of_features(Matcher::RepMatch),
            Start::Ratio => self.prior_of_features(Matcher::Ratio),
        }
    }

    /// The survey with every photo where its tag puts it.
    pub fn tags_only(&self, prior: &PriorStage) -> Reconstruction {
        let pose = |(photo, view): (&Photo, &ViewPose)| PhotoPose {
            photo: photo.name.clone(),
            tunnel_from_cam: view.tunnel_from_cam,
            position_sigma_m: view.position_sigma_m,
            rotation_sigma_rad: view.rotation_sigma_rad,
            status: PoseStatus::PriorOnly,
            quality: PhotoQuality::default(),
        };
        Reconstruction {
            poses: self.survey.photos.iter().zip(&prior.views).map(pose).collect(),
            tracks: Tracks::default(),
            camera: self.survey.config.camera.camera,
            profile: prior.profile.clone(),
        }
    }

    fn prior_of_features(&self, matcher: Matcher) -> Result<PriorStage> {
        let Untagged { photos, losses } = survey_poses(self.survey, &self.profile, matcher)?;
        let view = |placed: &PlacedPhoto| ViewPose {
            tunnel_from_cam: placed.tunnel_from_cam,
            position_sigma_m: [placed.position_sigma_m; 3],
            rotation_sigma_rad: [placed.rotation_sigma_rad; 3],
            drift_m: 0.0,
        };
        Ok(PriorStage {
            tags: photos.iter().map(|placed| placed.tag(&self.survey.config.rig)).collect(),
            views: photos.iter().map(view).collect(),
            size: None,
            profile: self.survey.config.profile.clone(),
            tagged: false,
            losses,
        })
    }

    fn prior_of_tags(&self) -> Result<PriorStage> {
        let config = &self.survey.config;
        let raw: Vec<_> = self.survey.photos.iter().map(|photo| photo.tag).collect();
        let tags = self.tag_priors(&raw);
        let size = estimate_size(&tags, &self.profile, config.sigma.range_m);
        let factor = size.filter(SizeEstimate::contradicts_nominal).map_or(1.0, |size| size.factor);
        let profile = config.profile.scaled(factor);
        let resized =
            Self { profile: profile.build().context("the section")?, photos: Arc::clone(&self.photos), ..*self };
        let views = resized.views(&tags, &self.shared_prior());
        Ok(PriorStage { tags, views, size, profile, tagged: true, losses: Vec::new() })
    }

    /// What tags say, after corrections.
    pub(super) fn tag_priors(&self, raw: &[Option<CaptureTag>]) -> Vec<TagPrior> {
        tag_priors(raw, &self.survey.config.sigma, self.survey.config.rig.images_per_turn)
    }

    /// The shared unknowns before anything is adjusted.
    pub(super) fn shared_prior(&self) -> Shared {
        Shared::nominal(&self.survey.config.camera.camera, &self.survey.config.rig)
    }

    /// Poses by tags alone, under what is known of the rig.
    pub(super) fn views(&self, tags: &[TagPrior], shared: &Shared) -> Vec<ViewPose> {
        let config = &self.survey.config;
        let rig = Rig { mount_rotvec_rad: shared.mount_rotvec.into(), ..config.rig };
        let model = PriorModel {
            rig: &rig,
            profile: &self.profile,
            sigma: &config.sigma,
            odometer_factor: 1.0 + shared.odometer_scale,
            unknown_step_m: self.unknown_step_m(),
        };
        prior_views(tags, &model)
    }

    /// Half the step along the axis that leaves no hole: what a photo shows of the wall, shared by the photos of a turn.
    fn unknown_step_m(&self) -> f64 {
        let camera = &self.survey.config.camera.camera;
        let along_px = match self.survey.config.rig.image_up {
            ImageUp::Forward | ImageUp::Backward => camera.height_px,
            ImageUp::Clockwise | ImageUp::Counterclockwise => camera.width_px,
        };
        let shown_m = f64::from(along_px) * MatchConfig::native_m(&self.profile, camera);
        0.5 * shown_m / f64::from(self.survey.config.rig.images_per_turn.max(1))
    }

    /// The coarse round's parameters.
    pub(super) fn wide(&self) -> MatchConfig {
        MatchConfig::wide(self.matched_m())
    }

    /// See [`MatchConfig::matched_m`].
    fn matched_m(&self) -> f64 {
        MatchConfig::matched_m(&self.profile, &self.survey.config.camera.camera)
    }

    /// Pixels of the photo per pixel as it is matched.
    pub(super) fn matched_px(&self) -> f64 {
        self.matched_m() / MatchConfig::native_m(&self.profile, &self.survey.config.camera.camera)
    }

    /// How much the coarse round's matches are trusted.
    pub(super) fn coarse_weights(&self) -> Weights {
        Weights { pixel_px: COARSE_MATCH_PX * self.matched_px(), loss: ROBUST, surface_m: SURFACE_M }
    }

    /// From this reprojection error on a match of the coarse round is disputed, pixels.
    pub(super) fn disputed_px(&self) -> f64 {
        DISPUTED_PX * self.matched_px()
    }

    /// The coarse round: photos found within the tags' uncertainty, then a first adjustment.
    ///
    /// # Errors
    /// If the normal equations cannot be solved.
    pub fn coarse(&self, prior: &PriorStage, progress: &StageProgress) -> Result<CoarseStage> {
        Placing::new(self, prior).run(progress)
    }

    /// The fine round, at the photos' own resolution (of large photos a lower one, see [`MatchConfig::matched_m`]), between photos that have a place.
    pub fn fine(&self, coarse: &CoarseStage, progress: &StageProgress) -> MatchStage {
        let config = MatchConfig::fine(self.matched_m());
        let wanted = |photos: [usize; 2]| photos.iter().all(|&photo| coarse.placed[photo]);
        let (round, _) = self.round(&coarse.views, &|photo| photo, &config, &wanted, Use::Last, progress);
        let summary = RoundSummary::new(&round.pairs, &round.tracks, self.survey);
        MatchStage { tracks: round.tracks, round: summary }
    }

    /// Adjustment, pruning, adjustment.
    ///
    /// # Errors
    /// If the normal equations cannot be solved or a mask cannot be read.
    pub fn adjust(&self, prior: &PriorStage, coarse: &CoarseStage, matches: MatchStage) -> Result<AdjustStage> {
        let settled = self.settle(prior, coarse, matches.tracks, self.freed(prior))?;
        let Settled { last, weights, registered, noise, .. } = &settled;
        let end = self.problem(&settled.tags, &last.poses, &settled.tracks, last.shared);
        let problem = Problem { sigma: settled.sigma, shared_sigmas: settled.shared_sigmas, ..end };
        let qualities = photo_qualities(&problem, weights);
        let poses = self.survey.photos.iter().zip(settled.covariances.pose_sigmas()).enumerate();
        let poses = poses.map(|(index, (photo, sigma))| PhotoPose {
            photo: photo.name.clone(),
            tunnel_from_cam: last.poses[index],
            position_sigma_m: sigma.position_m,
            rotation_sigma_rad: sigma.rotation_rad,
            status: if registered[index] { PoseStatus::Adjusted } else { PoseStatus::PriorOnly },
            quality: qualities[index],
        });
        let poses: Vec<PhotoPose> = poses.collect();
        let profile = prior.profile.scaled(last.shared.profile_size);
        let camera_off_px = self.camera_off_px(&problem, weights)?;
        let round = &matches.round;
        let judged = Judged {
            solver: self,
            prior,
            coarse,
            round,
            problem: &problem,
            poses: &poses,
            noise: *noise,
            camera_off_px,
        };
        let warnings = judged.warnings();
        let Settled { tracks, first, last, pruned, .. } = settled;
        let camera = last.shared.camera;
        Ok(AdjustStage {
            reconstruction: Reconstruction { poses, tracks, camera, profile },
            shared: last.shared,
            warnings,
            first: first.report,
            last: last.report,
            pruned,
        })
    }

    /// Adjusts with mounting and odometer scale free, prunes, and adjusts with what `shared_sigmas` free.
    ///
    /// # Errors
    /// As [`Self::adjust`].
    pub(crate) fn settle(
        &self,
        prior: &PriorStage,
        coarse: &CoarseStage,
        mut tracks: Tracks,
        shared_sigmas: SharedSigmas,
    ) -> Result<Settled> {
        let fine_match_px = FINE_MATCH_PX * self.matched_px();
        let weights = Weights { pixel_px: fine_match_px, loss: ROBUST, surface_m: SURFACE_M };
        let poses: Vec<_> = coarse.views.iter().map(|view| view.tunnel_from_cam).collect();
        let first = adjust_roughly(&self.problem(&coarse.tags, &poses, &tracks, coarse.shared), &weights)?;
        tracks.positions_mut().copy_from_slice(&first.points);
        // The matches' noise is what the first adjustment leaves (median of a two-dimensional normal: 1.18 sigma).
        let measured_px = first.report.median_after_px / 1.18;
        let pruned = self.prune(&mut tracks, &first)?;
        let surface_m = unevenness_m(&tracks, &self.profile, first.shared.profile_size);
        let pixel_px = measured_px.clamp(LEAST_MATCH_PX, fine_match_px);
        let weights = Weights { pixel_px, surface_m: surface_m.clamp(LEAST_SURFACE_M, SURFACE_M), ..weights };
        let registered = registered(&tracks, first.poses.len());
        let noise = self.tag_noise(prior, coarse, &first, &registered);
        let (tags, sigma) = self.noisier(&coarse.tags, noise);
        let mut shared = first.shared;
        // What is held is held at what survey.toml states, not where the first adjustment left it.
        let stated = self.survey.config.rig.mount_rotvec_rad;
        for axis in (0..3).filter(|&axis| shared_sigmas.mount_rad[axis] == 0.0) {
            shared.mount_rotvec[axis] = stated[axis];
        }
        let start = self.problem(&tags, &first.poses, &tracks, shared);
        let last = adjust(&Problem { sigma, shared_sigmas, ..start }, &weights)?;
        tracks.positions_mut().copy_from_slice(&last.points);
        let end = self.problem(&tags, &last.poses, &tracks, last.shared);
        let covariances = Covariances::at(&Problem { sigma, shared_sigmas, ..end }, &weights)?;
        Ok(Settled { tags, sigma, shared_sigmas, weights, tracks, first, last, pruned, registered, noise, covariances })
    }

    fn tag_noise(
        &self,
        prior: &PriorStage,
        coarse: &CoarseStage,
        adjusted: &Adjusted,
        registered: &[bool],
    ) -> TagNoise {
        if !prior.tagged {
            return TagNoise { rotation: [1.0; 3], range: 1.0 };
        }
        let (tags, range_m) = (&coarse.tags, self.survey.config.sigma.range_m);
        let views = self.views(tags, &adjusted.shared);
        TagNoise::new(tags, &views, &adjusted.poses, registered, &adjusted.shared, &self.profile, range_m)
    }

    /// The tags and their uncertainty, as noisy as they are.
    fn noisier(&self, tags: &[TagPrior], noise: TagNoise) -> (Vec<TagPrior>, Sigma) {
        let sigma = self.survey.config.sigma;
        let noisier = |tag: &TagPrior| {
            let rotation_sigma_rad = [0, 1, 2].map(|axis| tag.rotation_sigma_rad[axis] * noise.rotation[axis]);
            TagPrior { rotation_sigma_rad, ..tag.clone() }
        };
        (tags.iter().map(noisier).collect(), Sigma { range_m: sigma.range_m * noise.range, ..sigma })
    }

    /// Which of the shared unknowns the last adjustment may move, and how well they are known before it.
    fn freed(&self, prior: &PriorStage) -> SharedSigmas {
        let config = &self.survey.config;
        let mut sigmas = SharedSigmas::of_tags(&config.sigma);
        if prior.size.is_some_and(|size| size.contradicts_nominal()) {
            sigmas.profile_size = RESIZED_SIGMA;
        }
        if config.camera.refine {
            sigmas = with_free_camera(sigmas, &config.camera.camera);
        }
        if config.camera.rolling_shutter_s > 0.0 {
            sigmas.shutter_rad_per_s = SHUTTER_SIGMA_RAD_PER_S;
        }
        sigmas
    }

    /// By how many pixels the photos would have the camera's model other than it is, where it was not refined.
    fn camera_off_px(&self, problem: &Problem<'_>, weights: &Weights) -> Result<Option<f64>> {
        let config = &self.survey.config.camera;
        if config.refine {
            return Ok(None);
        }
        let freed = Problem { shared_sigmas: with_free_camera(problem.shared_sigmas, &config.camera), ..*problem };
        let wanted = tendency(&freed, weights, TENDENCY_STEPS)?;
        Ok(Some(largest_shift_px(&config.camera, &wanted.camera)))
    }

    pub(crate) fn prune(&self, tracks: &mut Tracks, adjusted: &Adjusted) -> Result<PruneCounts> {
        let (low, high) = self.profile.bounds();
        let across_m = (high - low).min();
        let pruning = Pruning {
            mask: self.options.prune_mask,
            // A fifth of the radius: pipes, brackets and bulges are wall; what floats farther inside is not.
            off_surface_m: self.options.prune_surface.then_some(0.1 * across_m),
            reprojection_px: self.options.prune_reprojection.then_some(4.0 * FINE_MATCH_PX * self.matched_px()),
        };
        let masked = if pruning.mask { self.masked(tracks)? } else { Vec::new() };
        Ok(prune(tracks, &adjusted.poses, &adjusted.shared.camera, &self.profile, &masked, &pruning))
    }

    /// Tells for every observation whether its photo's mask hides it. One mask is held at a time.
    fn masked(&self, tracks: &Tracks) -> Result<Vec<bool>> {
        let seen = tracks.observations();
        let mut by_photo: Vec<u32> = (0..seen.len() as u32).collect();
        by_photo.sort_by_key(|&index| seen[index as usize].photo);
        let mut masked = vec![false; seen.len()];
        let mut held: Option<(PathBuf, Hidden)> = None;
        for group in by_photo.chunk_by(|&a, &b| seen[a as usize].photo == seen[b as usize].photo) {
            let photo = seen[group[0] as usize].photo as usize;
            let Some(path) = &self.survey.photos[photo].mask else { continue };
            let kept = self.photos.hidden(photo);
            if kept.is_none() && held.as_ref().is_none_or(|(known, _)| known != path) {
                held = Some((path.clone(), Hidden::new(&load_mask(path, size_of(self.survey))?)));
            }
            let Some(hidden) = kept.or(held.as_ref().map(|(_, hidden)| hidden)) else { continue };
            for &index in group {
                masked[index as usize] = hidden.contains(seen[index as usize].pixel);
            }
        }
        Ok(masked)
    }

    pub(crate) fn problem<'b>(
        &'b self,
        tags: &'b [TagPrior],
        poses: &'b [Isometry3<f64>],
        tracks: &'b Tracks,
        shared: Shared,
    ) -> Problem<'b> {
        let config = &self.survey.config;
        Problem {
            camera: &config.camera.camera,
            profile: &self.profile,
            rig: &config.rig,
            sigma: config.sigma,
            tags,
            poses,
            tracks,
            shared,
            shared_sigmas: SharedSigmas::of_tags(&config.sigma),
            readout_s: config.camera.rolling_shutter_s,
        }
    }

    /// Puts every point where its first observation's ray meets the section.
    pub(crate) fn put_on_wall(&self, tracks: &mut Tracks, poses: &[Isometry3<f64>]) {
        let camera = &self.survey.config.camera.camera;
        let hit = |seen: &Observation| {
            let pose = &poses[seen.photo as usize];
            let direction = pose.rotation * camera.unproject(&Vector2::from(seen.pixel.map(f64::from)))?;
            let centre = pose.translation.vector;
            let hit = self.profile.ray_cast(centre.yz(), direction.yz())?;
            Some(Point3::from(centre + direction * hit.distance))
        };
        let hits: Vec<Option<Point3<f64>>> = tracks.iter().map(|(_, seen)| hit(&seen[0])).collect();
        for (position, hit) in tracks.positions_mut().iter_mut().zip(hits) {
            *position = hit.unwrap_or(*position);
        }
    }

    /// A round of matching over `views`; `photo_of` tells which photo each is of.
    pub(super) fn round(
        &self,
        views: &[ViewPose],
        photo_of: &(dyn Fn(usize) -> usize + Sync),
        config: &MatchConfig,
        wanted: &dyn Fn([usize; 2]) -> bool,
        used: Use,
        progress: &StageProgress,
    ) -> (MatchRound, Vec<Loss>) {
        let photos = SurveyPhotos::new(self.survey, &self.photos, self.options.prune_mask, used);
        let camera = &self.survey.config.camera.camera;
        progress.restart(views.len());
        let views_photos = ViewsPhotos { photos: &photos, photo_of };
        let round =
            match_round(&self.profile, camera, views, &views_photos, config, wanted, &|done| progress.set(done));
        let name = |photo: usize| self.survey.photos[photo].path.display().to_string();
        let losses = photos.faults().into_iter().map(|(photo, why)| Loss::new(name(photo), why)).collect();
        (round, losses)
    }
}

/// A last adjustment, and what it was made of.
pub(crate) struct Settled {
    /// Tags and their uncertainty, as noisy as they turned out to be.
    tags: Vec<TagPrior>,
    sigma: Sigma,
    shared_sigmas: SharedSigmas,
    weights: Weights,
    tracks: Tracks,
    first: Adjusted,
    pub(crate) last: Adjusted,
    pruned: PruneCounts,
    pub(crate) registered: Vec<bool>,
    noise: TagNoise,
    pub(crate) covariances: Covariances,
}

/// Photos by the number of a view.
struct ViewsPhotos<'a> {
    photos: &'a SurveyPhotos<'a>,
    photo_of: &'a (dyn Fn(usize) -> usize + Sync),
}

impl Photos for ViewsPhotos<'_> {
    fn load(&self, view: usize) -> Option<Pixels> {
        self.photos.load((self.photo_of)(view))
    }
}

/// How far points are to be expected off the section, as one standard deviation of independent ones: of a wall that is true
/// the points hold the whole reconstruction's place and tilt, which tags know to half a millimetre per metre at best.
fn unevenness_m(tracks: &Tracks, profile: &Profile<f64>, size: f64) -> f64 {
    let off_m = |point: &Point3<f64>| Some(profile.nearest(point.coords.yz() / size)?.clearance_m.abs() * size);
    let off_m: Vec<f64> = tracks.positions().iter().filter_map(off_m).collect();
    // The median size of a normal deviate is 0.67 standard deviations.
    median(&off_m) * 1.4826 * POINTS_PER_UNEVENNESS.sqrt()
}

fn with_free_camera(sigmas: SharedSigmas, camera: &Camera<f64>) -> SharedSigmas {
    SharedSigmas {
        focal_px: camera.focal_px.map(|focal_px| REFINED_SHARE * focal_px),
        centre_px: [REFINED_SHARE * camera.focal_px[0]; 2],
        distortion: [REFINED_DISTORTION; 5],
        ..sigmas
    }
}

/// The largest distance, over a photo, of where two models project a ray, less their mean shift: that is as good as a rotation.
fn largest_shift_px(camera: &Camera<f64>, other: &Camera<f64>) -> f64 {
    const PLACES: u32 = 8;
    let (width_px, height_px) = (f64::from(camera.width_px), f64::from(camera.height_px));
    let place = |index: u32| f64::from(index) / f64::from(PLACES);
    let pixels = (0..=PLACES)
        .flat_map(|row| (0..=PLACES).map(move |column| Vector2::new(place(column) * width_px, place(row) * height_px)));
    let shift = |pixel: Vector2<f64>| Some(other.project(&camera.unproject(&pixel)?)? - pixel);
    let shifts: Vec<Vector2<f64>> = pixels.filter_map(shift).collect();
    let mean = shifts.iter().sum::<Vector2<f64>>() / shifts.len().max(1) as f64;
    shifts.iter().map(|shift| (shift - mean).norm()).fold(0.0, f64::max)
}
