//! What each pose stage leaves for the next: stored in `out/stages`.

use adit_geometry::profile::ProfileSpec;
use serde::{Deserialize, Serialize};

use super::warnings::Warning;
use crate::adjust::{AdjustReport, PruneCounts, Shared, Tracks};
use crate::matching::{PairReport, ViewPose};
use crate::poses::Reconstruction;
use crate::prior::{SizeEstimate, TagPrior};
use crate::survey::{Loss, Survey};

/// Poses as the tags alone give them.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct PriorStage {
    /// What the tags say, one per photo.
    pub tags: Vec<TagPrior>,
    /// Poses and their uncertainty, one per photo.
    pub views: Vec<ViewPose>,
    /// The section's size by the ranges.
    pub size: Option<SizeEstimate>,
    /// The section that is used from here on: the nominal one, or of the size that the ranges gave where they contradict it.
    pub profile: ProfileSpec<f64>,
    /// The poses come from tags, not from the photos' features.
    pub tagged: bool,
    /// Photos whose features found no place.
    pub losses: Vec<Loss>,
}

/// Poses after a round of matching and an adjustment.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct CoarseStage {
    /// Poses and their uncertainty, one per photo.
    pub views: Vec<ViewPose>,
    /// Photos that hang together; the others stand by their tags.
    pub placed: Vec<bool>,
    /// Tags as they are believed now.
    pub tags: Vec<TagPrior>,
    /// Photos whose tag turned out to be wrong.
    pub slips: Vec<TagSlip>,
    /// What all photos share.
    pub shared: Shared,
    /// The rounds.
    pub round: RoundSummary,
    /// The last adjustment.
    pub adjustment: AdjustReport,
    /// Photos that could not be read.
    pub losses: Vec<Loss>,
}

/// A tag that its photo's matches contradict.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct TagSlip {
    /// The photo.
    pub photo: u32,
    /// The tag that fits is that of so many captures later; `None` if none fits and the photo was placed without one.
    pub captures: Option<i32>,
}

/// Matches of the fine round, as points with sightings.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct MatchStage {
    /// Points with their first position and sightings.
    pub tracks: Tracks,
    /// The round.
    pub round: RoundSummary,
}

/// The adjusted survey.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct AdjustStage {
    /// Poses and points.
    pub reconstruction: Reconstruction,
    /// What all photos share.
    pub shared: Shared,
    /// What a person should know before trusting the poses.
    pub warnings: Vec<Warning>,
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
    pub(super) fn new(pairs: &[PairReport], tracks: &Tracks, survey: &Survey) -> Self {
        let name = |photo: u32| survey.photos[photo as usize].name.clone();
        let count = |test: fn(&PairReport) -> bool| pairs.iter().filter(|pair| test(pair)).count();
        Self {
            pairs_expected: pairs.len(),
            pairs_kept: count(|pair| pair.kept),
            pairs_widened: count(|pair| pair.widened),
            doubtful: pairs
                .iter()
                .filter(|pair| pair.is_doubtful())
                .map(|pair| (name(pair.first), name(pair.second)))
                .collect(),
            matches: tracks.observations().len() - tracks.len(),
            points: tracks.len(),
        }
    }
}
