//! From tags and photos to poses: prior, coarse round, fine round, adjustment with pruning.

use std::collections::BTreeMap;

use adit_geometry::profile::Profile;
use anyhow::{Context, Result};
use nalgebra::{Isometry3, Point3, Vector2, Vector3};
use serde::{Deserialize, Serialize};

use super::groups::registered;
use super::photos::{SurveyPhotos, photo_mask};
use super::progress::StageProgress;
use crate::adjust::{
    AdjustReport, Covariances, Loss as MatchLoss, Observation, Problem, PruneCounts, Pruning, Shared, SharedSigmas,
    Tracks, Weights, adjust, prune,
};
use crate::matching::{MatchConfig, MatchRound, PairReport, StarTrack, ViewPose, match_round};
use crate::poses::{PhotoPose, PoseStatus, Reconstruction, Sighting, Track};
use crate::prior::{SizeEstimate, TagPrior, estimate_size, prior_poses};
use crate::raster::Mask;
use crate::survey::{Loss, Survey};

/// One standard deviation of a match in the coarse round, pixels of the photo.
const COARSE_MATCH_PX: f64 = 0.8;
/// One standard deviation, against its neighbours, of a pose that the coarse round found: optical centre (metres), rotation
/// (radians). What all photos share (the roll gauge, the frame) moves no match.
const COARSE_SIGMAS: [f64; 2] = [0.002, 0.0005];
/// One standard deviation of a match in the fine round, pixels of the photo.
const FINE_MATCH_PX: f64 = 0.3;
/// No match is better than this, whatever the residuals say: the camera model itself is not.
const LEAST_MATCH_PX: f64 = 0.05;
/// Loss of a match.
const ROBUST: MatchLoss = MatchLoss::GemanMcClure(3.0);
/// Softness of the surface: real linings are out of shape by centimetres, and points must be free to say so.
const SURFACE_M: f64 = 0.05;

/// What the pose stages are allowed to do.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct SolveOptions {
    /// The paper's P1: use masks.
    pub prune_mask: bool,
    /// The paper's P2: drop points off the section.
    pub prune_surface: bool,
    /// The paper's P3: drop sightings with a large reprojection error.
    pub prune_reprojection: bool,
}

impl Default for SolveOptions {
    /// All three steps.
    fn default() -> Self {
        Self { prune_mask: true, prune_surface: true, prune_reprojection: true }
    }
}

/// Poses as the tags alone give them.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct PriorStage {
    /// `tunnel_from_cam`, one per photo.
    pub poses: Vec<Isometry3<f64>>,
    /// The section's size by the ranges.
    pub size: Option<SizeEstimate>,
}

/// Poses after a round of matching and an adjustment.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct CoarseStage {
    /// `tunnel_from_cam`, one per photo.
    pub poses: Vec<Isometry3<f64>>,
    /// Photos that at least half of their pairs doubt, or without any pair: no better known than before.
    pub doubtful: Vec<u32>,
    /// Mounting rotation vector (camera axes) and odometer scale.
    pub shared: ([f64; 3], f64),
    /// The round.
    pub round: RoundSummary,
    /// The adjustment.
    pub adjustment: AdjustReport,
    /// Photos that could not be read.
    pub losses: Vec<Loss>,
}

/// Matches of the fine round, as points with sightings.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct MatchStage {
    /// Points with their first position and sightings.
    pub tracks: Vec<Track>,
    /// The round.
    pub round: RoundSummary,
}

/// The adjusted survey.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct AdjustStage {
    /// Poses and points.
    pub reconstruction: Reconstruction,
    /// Mounting rotation vector (camera axes, radians).
    pub mount_rotvec_rad: [f64; 3],
    /// True metres per odometer metre, minus one.
    pub odometer_scale: f64,
    /// Before pruning.
    pub first: AdjustReport,
    /// After pruning.
    pub last: AdjustReport,
    /// What was pruned.
    pub pruned: PruneCounts,
}

/// Figures of a round of matching.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct RoundSummary {
    /// Pairs of photos that should overlap.
    pub pairs_expected: usize,
    /// Pairs whose matches agree.
    pub pairs_kept: usize,
    /// Pairs searched again in a wider window.
    pub pairs_widened: usize,
    /// Names of pairs that should overlap but gave nothing usable, or of which less than half agrees.
    pub doubtful: Vec<(String, String)>,
    /// Sightings of reference points in other photos.
    pub matches: usize,
    /// Reference points that at least one other photo found.
    pub points: usize,
}

impl RoundSummary {
    fn new(round: &MatchRound, survey: &Survey) -> Self {
        let name = |photo: u32| survey.photos[photo as usize].name.clone();
        let count = |test: fn(&PairReport) -> bool| round.pairs.iter().filter(|pair| test(pair)).count();
        Self {
            pairs_expected: round.pairs.len(),
            pairs_kept: count(|pair| pair.kept),
            pairs_widened: count(|pair| pair.widened),
            doubtful: round
                .pairs
                .iter()
                .filter(|pair| pair.is_doubtful())
                .map(|pair| (name(pair.first), name(pair.second)))
                .collect(),
            matches: round.tracks.iter().map(|track| track.others.len()).sum(),
            points: round.tracks.len(),
        }
    }
}

/// What all pose stages share.
pub struct Solver<'a> {
    survey: &'a Survey,
    profile: Profile<f64>,
    tags: Vec<TagPrior>,
    options: SolveOptions,
}

impl<'a> Solver<'a> {
    /// Prepares a survey.
    ///
    /// # Errors
    /// If the survey's section cannot be built.
    pub fn new(survey: &'a Survey, options: SolveOptions) -> Result<Self> {
        let profile = survey.config.profile.build().context("survey.toml: [tunnel]")?;
        let tags = survey.photos.iter().map(|photo| TagPrior::from_tag(&photo.tag, &survey.config.sigma)).collect();
        Ok(Self { survey, profile, tags, options })
    }

    /// Poses from the tags, and the section's size from the ranges.
    pub fn prior(&self) -> PriorStage {
        let config = &self.survey.config;
        let range_m = config.sigma.range_m;
        PriorStage {
            poses: prior_poses(&self.tags, &config.rig, &self.profile, range_m),
            size: estimate_size(&self.tags, &self.profile, range_m),
        }
    }

    /// The coarse round: photos found within the tags' uncertainty, then a first adjustment.
    ///
    /// # Errors
    /// If the normal equations cannot be solved.
    pub fn coarse(&self, prior: &PriorStage, progress: &StageProgress) -> Result<CoarseStage> {
        let sigmas = vec![self.prior_sigmas(); prior.poses.len()];
        let config = MatchConfig::wide(MatchConfig::native_m(&self.profile, &self.survey.config.camera.camera));
        let (round, losses) = self.round(&prior.poses, &sigmas, &config, progress);
        let points = self.points_on_wall(&round.tracks, &prior.poses);
        let weights = Weights { pixel_px: COARSE_MATCH_PX, loss: ROBUST, surface_m: SURFACE_M };
        let shared = self.nominal();
        let adjusted = adjust(&self.problem(&prior.poses, &points, shared), &weights)?;
        Ok(CoarseStage {
            doubtful: round.doubtful_photos(adjusted.poses.len()),
            poses: adjusted.poses,
            shared: (adjusted.shared.mount_rotvec.into(), adjusted.shared.odometer_scale),
            round: RoundSummary::new(&round, self.survey),
            adjustment: adjusted.report,
            losses,
        })
    }

    /// One standard deviation of a prior pose: optical centre (metres) and rotation (radians).
    fn prior_sigmas(&self) -> [f64; 2] {
        let sigma = &self.survey.config.sigma;
        // The section position rests on two or three ranges; along the axis neighbours are an odometer step apart.
        [1.5 * sigma.range_m, sigma.shaft_rad.hypot(sigma.attitude_rad).hypot(sigma.mount_rad)]
    }

    /// The fine round, at the photos' own resolution.
    pub fn fine(&self, coarse: &CoarseStage, progress: &StageProgress) -> MatchStage {
        let config = MatchConfig::fine(MatchConfig::native_m(&self.profile, &self.survey.config.camera.camera));
        let mut sigmas = vec![COARSE_SIGMAS; coarse.poses.len()];
        for &photo in &coarse.doubtful {
            sigmas[photo as usize] = self.prior_sigmas();
        }
        let (round, _) = self.round(&coarse.poses, &sigmas, &config, progress);
        let points = self.points_on_wall(&round.tracks, &coarse.poses);
        let tracks = points.iter().map(|(position, seen)| track_of(position, seen, 0.0)).collect();
        MatchStage { tracks, round: RoundSummary::new(&round, self.survey) }
    }

    /// Adjustment, pruning, adjustment.
    ///
    /// # Errors
    /// If the normal equations cannot be solved or a mask cannot be read.
    pub fn adjust(&self, coarse: &CoarseStage, matches: &MatchStage) -> Result<AdjustStage> {
        let camera = &self.survey.config.camera.camera;
        let mut points = flat(&matches.tracks);
        let weights = Weights { pixel_px: FINE_MATCH_PX, loss: ROBUST, surface_m: SURFACE_M };
        let (mount_rotvec, odometer_scale) = (Vector3::from(coarse.shared.0), coarse.shared.1);
        let shared = Shared { mount_rotvec, odometer_scale, ..self.nominal() };
        let first = adjust(&self.problem(&coarse.poses, &points, shared), &weights)?;
        points.positions_mut().copy_from_slice(&first.points);
        // The matches' noise is what the first adjustment leaves (median of a two-dimensional normal: 1.18 sigma).
        let measured_px = first.report.median_after_px / 1.18;
        let weights = Weights { pixel_px: measured_px.clamp(LEAST_MATCH_PX, FINE_MATCH_PX), ..weights };
        let pruning = self.pruning();
        let masks = if pruning.mask { self.masks()? } else { Vec::new() };
        let pruned = prune(&mut points, &first.poses, camera, &self.profile, &masks, &pruning);
        let last = adjust(&self.problem(&first.poses, &points, first.shared), &weights)?;
        points.positions_mut().copy_from_slice(&last.points);
        let problem = self.problem(&last.poses, &points, last.shared);
        let sigmas = Covariances::at(&problem, &weights)?.pose_sigmas();
        let registered = registered(&points, last.poses.len());
        let poses = self.survey.photos.iter().enumerate().map(|(index, photo)| PhotoPose {
            photo: photo.name.clone(),
            tunnel_from_cam: last.poses[index],
            position_sigma_m: sigmas[index].position_m,
            rotation_sigma_rad: sigmas[index].rotation_rad,
            status: if registered[index] { PoseStatus::Adjusted } else { PoseStatus::PriorOnly },
        });
        let poses = poses.collect();
        let tracks = points.iter();
        let tracks = tracks.map(|(at, seen)| track_of(at, seen, error_px(&problem, at, seen))).collect();
        let profile = self.survey.config.profile.clone();
        Ok(AdjustStage {
            reconstruction: Reconstruction { poses, tracks, camera: *camera, profile },
            mount_rotvec_rad: last.shared.mount_rotvec.into(),
            odometer_scale: last.shared.odometer_scale,
            first: first.report,
            last: last.report,
            pruned,
        })
    }

    fn pruning(&self) -> Pruning {
        let (low, high) = self.profile.bounds();
        let across_m = (high - low).min();
        Pruning {
            mask: self.options.prune_mask,
            // A fifth of the radius: pipes, brackets and bulges are wall; what floats farther inside is not.
            off_surface_m: self.options.prune_surface.then_some(0.1 * across_m),
            reprojection_px: self.options.prune_reprojection.then_some(4.0 * FINE_MATCH_PX),
        }
    }

    fn masks(&self) -> Result<Vec<Option<Mask>>> {
        (0..self.survey.photos.len()).map(|photo| Ok(photo_mask(self.survey, photo)?)).collect()
    }

    fn nominal(&self) -> Shared {
        Shared::nominal(&self.survey.config.camera.camera, &self.survey.config.rig)
    }

    fn problem<'b>(&'b self, poses: &'b [Isometry3<f64>], tracks: &'b Tracks, shared: Shared) -> Problem<'b> {
        let config = &self.survey.config;
        Problem {
            camera: &config.camera.camera,
            profile: &self.profile,
            rig: &config.rig,
            sigma: config.sigma,
            tags: &self.tags,
            poses,
            tracks,
            shared,
            shared_sigmas: SharedSigmas::of_tags(&config.sigma),
            readout_s: 0.0,
        }
    }

    fn round(
        &self,
        poses: &[Isometry3<f64>],
        sigmas: &[[f64; 2]],
        config: &MatchConfig,
        progress: &StageProgress,
    ) -> (MatchRound, Vec<Loss>) {
        let views: Vec<ViewPose> = poses
            .iter()
            .zip(sigmas)
            .map(|(pose, &[position_sigma_m, rotation_sigma_rad])| ViewPose {
                tunnel_from_cam: *pose,
                position_sigma_m,
                rotation_sigma_rad,
            })
            .collect();
        let photos = SurveyPhotos::new(self.survey, self.options.prune_mask);
        let camera = &self.survey.config.camera.camera;
        let round = match_round(&self.profile, camera, &views, &photos, config, &|done| progress.set(done));
        let name = |photo: usize| self.survey.photos[photo].path.display().to_string();
        let losses = photos.faults().into_iter().map(|(photo, why)| Loss::new(name(photo), why)).collect();
        (round, losses)
    }

    /// Star tracks as points, placed where the reference pixel's ray meets the nominal wall.
    fn points_on_wall(&self, tracks: &[StarTrack], poses: &[Isometry3<f64>]) -> Tracks {
        let camera = &self.survey.config.camera.camera;
        let place = |track: &StarTrack| -> Option<Point3<f64>> {
            let pose = &poses[track.reference.photo as usize];
            let direction = pose.rotation * camera.unproject(&Vector2::from(track.reference.pixel))?;
            let centre = pose.translation.vector;
            let hit = self.profile.ray_cast(centre.yz(), direction.yz())?;
            Some(Point3::from(centre + direction * hit.distance))
        };
        let mut points = Tracks::default();
        for track in tracks {
            let Some(position) = place(track) else { continue };
            let mut sightings: BTreeMap<u32, [f64; 2]> =
                track.others.iter().map(|found| (found.sighting.photo, found.sighting.pixel)).collect();
            sightings.insert(track.reference.photo, track.reference.pixel);
            points.push(position, sightings.into_iter().map(|(photo, pixel)| observation(photo, pixel)));
        }
        points
    }
}

fn observation(photo: u32, pixel: [f64; 2]) -> Observation {
    Observation { photo, pixel: pixel.map(|value| value as f32) }
}

fn track_of(position: &Point3<f64>, seen: &[Observation], error_px: f64) -> Track {
    let sighting = |seen: &Observation| Sighting { photo: seen.photo, pixel: seen.pixel.map(f64::from) };
    Track { position: *position, sightings: seen.iter().map(sighting).collect(), error_px }
}

fn flat(tracks: &[Track]) -> Tracks {
    let mut points = Tracks::default();
    for track in tracks {
        points.push(track.position, track.sightings.iter().map(|seen| observation(seen.photo, seen.pixel)));
    }
    points
}

/// Root mean square reprojection error of a point.
fn error_px(problem: &Problem<'_>, position: &Point3<f64>, seen: &[Observation]) -> f64 {
    let squared = seen.iter().map(|seen| {
        let in_cam = problem.poses[seen.photo as usize].inverse_transform_point(position).coords;
        let pixel = Vector2::from(seen.pixel.map(f64::from));
        problem.camera.project(&in_cam).map_or(0.0, |projected| (projected - pixel).norm_squared())
    });
    (squared.sum::<f64>() / seen.len().max(1) as f64).sqrt()
}
