//! What a person should know before trusting the poses: everything that contradicts something else.
//!
//! A wrong result is never silent as long as the tags are better than the error: a photo that slipped by a brick disagrees with
//! its tag, with its neighbours' matches, or has hardly any.

use std::fmt;

use nalgebra::Vector3;
use serde::{Deserialize, Serialize};

use super::groups::pair_shares;
use super::solve::Solver;
use super::stages::{CoarseStage, PriorStage, RoundSummary};
use super::tag_noise::TagNoise;
use crate::adjust::Problem;
use crate::poses::{PhotoPose, PoseStatus};
use crate::prior::SizeEstimate;

/// Disagreement, in standard deviations, from which on it is no accident.
const CONTRADICTION: f64 = 5.0;
/// Disagreement of what all photos share with what was said about it, standard deviations.
const SHARED_CONTRADICTION: f64 = 3.0;
/// A photo with fewer matched points is hardly held.
const FEW_MATCHES: usize = 20;
/// Random part of an odometer's step that is no contradiction yet, metres, one standard deviation.
const STEP_SIGMA_M: f64 = 0.015;
/// Error of the camera's model that is worth refining it: some 3 mm in the poses of the samples.
const CAMERA_OFF_PX: f64 = 0.5;
/// Error of a match that the adjustment disputes, pixels.
const DISPUTED_PX: f64 = 1.5;

/// Something that does not fit.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Warning {
    /// The ranges contradict the section's nominal size, and theirs was used.
    SectionSize {
        /// Size that was used over nominal size.
        factor: f64,
        /// Its standard deviation, by the ranges.
        sigma: f64,
    },
    /// The first poses come from the photos' features: where the section says nothing, their frame is a convention.
    NoTags,
    /// No photo was matched, as asked.
    TagsOnly,
    /// No row of tags.csv names the photo; its pose rests on its neighbours and its matches.
    NoTag {
        /// The photo.
        photo: String,
    },
    /// The photo's matches contradict its tag; that of another capture was used, or none.
    TagSlipped {
        /// The photo.
        photo: String,
        /// So many captures later (negative: earlier); `None`: no tag fits.
        captures: Option<i32>,
    },
    /// The pose and the photo's tag exclude each other.
    TagContradicted {
        /// The photo.
        photo: String,
        /// Which of the tag's readings.
        reading: Reading,
        /// Disagreement in the reading's standard deviations.
        sigmas: f64,
    },
    /// The pose rests on the tag alone.
    PriorOnly {
        /// The photo.
        photo: String,
    },
    /// Few points hold the photo, or most of them disagree.
    WeaklyHeld {
        /// The photo.
        photo: String,
        /// Points that it shares with others.
        matches: usize,
        /// Share of them that the adjustment does not believe.
        doubted_share: f64,
    },
    /// Two photos should overlap, but gave no matches, or most of their matches are disputed.
    PairDisputed {
        /// The earlier photo.
        first: String,
        /// The later photo.
        second: String,
    },
    /// A kind of reading is noisier than survey.toml says; the result's own uncertainty was raised accordingly.
    TagsNoisier {
        /// Which readings.
        reading: Reading,
        /// Noise over stated noise.
        times: f64,
    },
    /// The photos contradict the camera's model in survey.toml, which was not refined.
    CameraContradicted {
        /// Largest error of the model over a photo, about.
        off_px: f64,
    },
    /// Something that all photos share is not what survey.toml says.
    SharedContradicted {
        /// What.
        what: SharedUnknown,
        /// Disagreement in standard deviations.
        sigmas: f64,
    },
}

/// A reading of a tag.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Reading {
    /// Shaft angle and attitude.
    Rotation,
    /// The ranges' position in the section.
    Ranges,
    /// The way since the photo before.
    Odometer,
}

/// An unknown that all photos share.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum SharedUnknown {
    /// The camera's mounting, or the zero of the shaft angle: they cannot be told apart on a circle.
    Mounting,
    /// The odometer's scale.
    OdometerScale,
}

impl fmt::Display for Warning {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::SectionSize { factor, sigma } => write!(
                out,
                "the ranges contradict the section's size in survey.toml: {:+.2} % +- {:.2} % was used; check the drawing",
                (factor - 1.0) * 100.0,
                sigma * 100.0
            ),
            Self::NoTags => write!(
                out,
                "no tags were used: x starts at the first photo, and on a circle its roll is a convention; \
                 the scale is that of the section in survey.toml"
            ),
            Self::TagsOnly => write!(
                out,
                "no photo was matched, as asked: each stands where its tag puts it, and neighbours meet on the wall only as well \
                 as their tags do"
            ),
            Self::NoTag { photo } => write!(out, "{photo}: no tag; its pose rests on its neighbours and its matches"),
            Self::TagSlipped { photo, captures: Some(captures) } => {
                write!(out, "{photo}: its matches contradict its tag; that of {captures:+} captures was used")
            }
            Self::TagSlipped { photo, captures: None } => {
                write!(out, "{photo}: its matches contradict its tag, which was not used")
            }
            Self::TagContradicted { photo, reading, sigmas } => {
                let reading = match reading {
                    Reading::Rotation => "shaft angle or attitude",
                    Reading::Ranges => "ranges",
                    Reading::Odometer => "odometer step",
                };
                write!(out, "{photo}: the pose contradicts its tag's {reading} by {sigmas:.0} standard deviations")
            }
            Self::PriorOnly { photo } => write!(out, "{photo}: no matches hold it; its pose is that of its tag"),
            Self::WeaklyHeld { photo, matches, doubted_share } => write!(
                out,
                "{photo}: weakly held, {matches} matched points, {:.0} % of them disputed",
                doubted_share * 100.0
            ),
            Self::PairDisputed { first, second } => {
                write!(out, "{first} and {second} should overlap, but do not agree on what they see")
            }
            Self::TagsNoisier { reading, times } => {
                let reading = match reading {
                    Reading::Rotation => "shaft angles or attitudes",
                    Reading::Ranges => "ranges",
                    Reading::Odometer => "odometer",
                };
                write!(out, "the tags' {reading} are {times:.1} times as noisy as [sigma] in survey.toml says")
            }
            Self::CameraContradicted { off_px } => write!(
                out,
                "the photos contradict [camera] in survey.toml by some {off_px:.1} px: calibrate it, or set refine = true"
            ),
            Self::SharedContradicted { what, sigmas } => {
                let what = match what {
                    SharedUnknown::Mounting => "the camera's mounting (or the shaft angle's zero)",
                    SharedUnknown::OdometerScale => "the odometer's scale",
                };
                write!(out, "{what} is {sigmas:.1} standard deviations from what survey.toml says")
            }
        }
    }
}

/// A result about to be judged.
pub(super) struct Judged<'a> {
    pub(super) solver: &'a Solver<'a>,
    pub(super) prior: &'a PriorStage,
    pub(super) coarse: &'a CoarseStage,
    /// The fine round.
    pub(super) round: &'a RoundSummary,
    /// At the adjusted poses, points and shared unknowns.
    pub(super) problem: &'a Problem<'a>,
    pub(super) poses: &'a [PhotoPose],
    /// How noisy the tags are.
    pub(super) noise: TagNoise,
    /// By how much the photos would have the camera's model other than it is; `None` where it was refined.
    pub(super) camera_off_px: Option<f64>,
}

impl Judged<'_> {
    /// Everything that does not fit, the survey's own first, then photo by photo.
    pub(super) fn warnings(&self) -> Vec<Warning> {
        let mut warnings = self.of_survey();
        let survey = self.solver.survey;
        for (photo, pose) in survey.photos.iter().zip(self.poses) {
            if photo.tag.is_none() && self.prior.tagged {
                warnings.push(Warning::NoTag { photo: photo.name.clone() });
            }
            if pose.status == PoseStatus::PriorOnly {
                warnings.push(Warning::PriorOnly { photo: photo.name.clone() });
            } else if pose.quality.observations < FEW_MATCHES || pose.quality.doubted_share > 0.5 {
                warnings.push(Warning::WeaklyHeld {
                    photo: photo.name.clone(),
                    matches: pose.quality.observations,
                    doubted_share: pose.quality.doubted_share,
                });
            }
        }
        let slipped = self.coarse.slips.iter();
        warnings.extend(slipped.map(|slip| Warning::TagSlipped {
            photo: survey.photos[slip.photo as usize].name.clone(),
            captures: slip.captures,
        }));
        self.of_tags(&mut warnings);
        self.of_pairs(&mut warnings);
        warnings
    }

    fn of_survey(&self) -> Vec<Warning> {
        let shared = &self.problem.shared;
        let sigma = &self.solver.survey.config.sigma;
        let mut warnings = Vec::new();
        if let Some(off_px) = self.camera_off_px.filter(|&off_px| off_px > CAMERA_OFF_PX) {
            warnings.push(Warning::CameraContradicted { off_px });
        }
        if !self.prior.tagged {
            warnings.push(Warning::NoTags);
            return warnings;
        }
        if let Some(size) = self.prior.size.filter(SizeEstimate::contradicts_nominal) {
            let factor = size.factor * shared.profile_size;
            warnings.push(Warning::SectionSize { factor, sigma: size.sigma });
        }
        let rotation = self.noise.rotation.into_iter().fold(1.0, f64::max);
        for (reading, times) in [(Reading::Rotation, rotation), (Reading::Ranges, self.noise.range)] {
            if times > 1.0 {
                warnings.push(Warning::TagsNoisier { reading, times });
            }
        }
        let nominal = Vector3::from(self.solver.survey.config.rig.mount_rotvec_rad);
        let mounting = (shared.mount_rotvec - nominal).amax() / sigma.mount_rad.max(1e-9);
        let scale = shared.odometer_scale.abs() / sigma.odometer_m_per_m.max(1e-9);
        for (what, sigmas) in [(SharedUnknown::Mounting, mounting), (SharedUnknown::OdometerScale, scale)] {
            if sigmas > SHARED_CONTRADICTION {
                warnings.push(Warning::SharedContradicted { what, sigmas });
            }
        }
        warnings
    }

    /// Poses against the tags that were believed.
    fn of_tags(&self, warnings: &mut Vec<Warning>) {
        if !self.prior.tagged {
            return;
        }
        let tags = &self.coarse.tags;
        let views = self.solver.views(tags, &self.problem.shared);
        let mut before: Option<(f64, f64, usize)> = None;
        for (index, ((pose, view), tag)) in self.poses.iter().zip(&views).zip(tags).enumerate() {
            let mut contradicted = |reading, sigmas: f64| {
                if sigmas > CONTRADICTION {
                    warnings.push(Warning::TagContradicted { photo: pose.photo.clone(), reading, sigmas });
                }
            };
            let turned = (pose.tunnel_from_cam.rotation * view.tunnel_from_cam.rotation.inverse()).scaled_axis();
            let sigmas = |axis: usize| turned[axis].abs() / tag.rotation_sigma_rad[axis].max(1e-9);
            contradicted(Reading::Rotation, (0..3).map(sigmas).fold(0.0, f64::max));
            let moved = pose.tunnel_from_cam.translation.vector - view.tunnel_from_cam.translation.vector;
            if tag.beams.len() >= 2 {
                let sigmas = |axis: usize| moved[axis].abs() / view.position_sigma_m[axis].max(1e-9);
                contradicted(Reading::Ranges, sigmas(1).max(sigmas(2)));
            }
            if let Some(odometer_m) = tag.odometer_m {
                let x_m = pose.tunnel_from_cam.translation.x;
                if let Some((x0_m, odometer0_m, index0)) = before {
                    let way_m = odometer_m - odometer0_m;
                    let off_m = x_m - x0_m - (1.0 + self.problem.shared.odometer_scale) * way_m;
                    let tilt_m = self.problem.shared.lever_m[0].abs() * self.problem.sigma.attitude_rad;
                    let sigma_m = (STEP_SIGMA_M * ((index - index0) as f64).sqrt()).hypot(tilt_m);
                    contradicted(Reading::Odometer, off_m.abs() / sigma_m);
                }
                before = Some((x_m, odometer_m, index));
            }
        }
    }

    fn of_pairs(&self, warnings: &mut Vec<Warning>) {
        let poses = self.problem.poses;
        let disputed_px = DISPUTED_PX * self.solver.matched_px();
        let shares = pair_shares(self.problem.tracks, poses, &self.problem.shared.camera, disputed_px);
        let disputed = shares.iter().filter(|(_, share)| share.is_disputed()).map(|(photos, _)| {
            let [first, second] = photos.map(|photo| self.poses[photo as usize].photo.clone());
            (first, second)
        });
        let mut pairs: Vec<(String, String)> = self.round.doubtful.iter().cloned().chain(disputed).collect();
        pairs.sort();
        pairs.dedup();
        warnings.extend(pairs.into_iter().map(|(first, second)| Warning::PairDisputed { first, second }));
    }
}
