//! Two photos on one grid of the wall: which points to search for, where, and which of the finds agree.

use adit_geometry::camera::Camera;
use adit_geometry::profile::Profile;

use super::coherence::{Displacement, PairMotion, displacement_sigma_m};
use super::patch::{Bench, Patch};
use super::search::{Search, SearchSize};
use super::wall::{BLOCK, Footprint, WallGrid};
use super::{MatchConfig, PairReport, Pixels, ViewPose};
use crate::adjust::median;

/// Points of a pair that are searched for in the whole window before the others, about.
const PROBES: usize = 16;

/// Probes of a pair that does not agree at once, before it is given up.
const MOST_PROBES: usize = 48;

/// Share of the probes' matches that must agree for the others to be searched for near their prediction only.
const PROBES_AGREEING: f64 = 0.7;

/// Points at which the uncertainty of a pair's displacement is looked at.
const WINDOW_SAMPLES: usize = 5;

/// A place is expected well enough where this standard deviation, as a share of the half-width of the search, is not
/// exceeded.
const SIGMA_SHARE: f64 = 0.4;

/// A reference point that another photo should see.
#[derive(Clone, Copy, Debug)]
pub(super) struct Candidate {
    /// 0: the pair's first photo holds the reference point, 1: its second.
    pub(super) from: usize,
    /// Its number there.
    pub(super) point: usize,
    /// Its place in that photo's window.
    place: [usize; 2],
    /// Its place in the other photo's window, by the poses.
    predicted: [i64; 2],
    /// Its place on the wall, texels, in the columns of its own photo.
    pub(super) reference: [f64; 2],
}

impl Candidate {
    /// A reference in the second photo that the first one finds is displaced the other way.
    fn sign(&self) -> f64 {
        if self.from == 0 { 1.0 } else { -1.0 }
    }
}

/// A reference point that another photo found.
#[derive(Clone, Copy, Debug)]
pub(super) struct Match {
    pub(super) candidate: Candidate,
    /// Where it was found minus where it was predicted, texels.
    pub(super) displacement: [f64; 2],
}

/// A grid of the wall, and how photos are matched on it.
pub(super) struct Level<'a> {
    pub(super) grid: WallGrid<'a>,
    pub(super) poses: &'a [ViewPose],
    pub(super) config: MatchConfig,
}

impl<'a> Level<'a> {
    pub(super) fn new(
        profile: &'a Profile<f64>,
        camera: &'a Camera<f64>,
        poses: &'a [ViewPose],
        config: MatchConfig,
    ) -> Self {
        let grid = WallGrid::new(profile, camera, config.grid_m, config.max_incidence_rad);
        Self { grid, poses, config }
    }

    pub(super) fn blocks_around(&self) -> i64 {
        self.grid.columns / BLOCK as i64
    }

    pub(super) fn patch(
        &self,
        photo: usize,
        footprint: &Footprint,
        pixels: &Pixels,
        bench: &mut Bench,
        memory: Vec<i8>,
    ) -> Patch {
        Patch::new(&self.grid, &self.poses[photo].tunnel_from_cam, footprint, pixels, &self.config, bench, memory)
    }

    /// Half-width and half-height of the window that the uncertainty of the displacement between the two photos asks for.
    pub(super) fn needed_px(&self, photos: [usize; 2], candidates: &[Candidate]) -> [usize; 2] {
        let poses = photos.map(|photo| &self.poses[photo]);
        let mut sigma_m = [0.0_f64; 2];
        for candidate in candidates.iter().step_by((candidates.len() / WINDOW_SAMPLES).max(1)) {
            if let Some(point) = self.grid.point(candidate.reference[0], candidate.reference[1]) {
                let here_m = displacement_sigma_m(&point, poses);
                sigma_m = [0, 1].map(|axis| sigma_m[axis].max(here_m[axis]));
            }
        }
        sigma_m.map(|sigma_m| (self.config.search_sigmas * sigma_m / self.grid.step_m).ceil() as usize)
    }

    /// That window, or the least.
    pub(super) fn reach_px(&self, needed_px: [usize; 2]) -> [usize; 2] {
        needed_px.map(|needed| needed.max(self.config.min_search_px))
    }

    /// Reference points of both photos that the other should see, by the poses.
    pub(super) fn candidates(&self, pair: [&Patch; 2]) -> Vec<Candidate> {
        let mut candidates = Vec::new();
        for from in [0, 1] {
            let (source, target) = (pair[from], pair[1 - from]);
            // The same wall may be counted a turn apart in the two photos.
            let turns = target.footprint.turns_to(&source.footprint, self.blocks_around()) * BLOCK as i64;
            for (point, &place) in source.points.iter().enumerate() {
                let predicted = [
                    place[0] as i64 + source.origin[0] + turns - target.origin[0],
                    place[1] as i64 + source.origin[1] - target.origin[1],
                ];
                if target.is_usable(predicted) {
                    candidates.push(Candidate {
                        from,
                        point,
                        place,
                        predicted,
                        reference: global_place(source, place),
                    });
                }
            }
        }
        candidates
    }

    fn size(&self, reach: [usize; 2]) -> SearchSize {
        SearchSize { half: self.config.template_px / 2, reach, min_ncc: self.config.min_ncc }
    }

    /// Half-width of the search around a prediction from probes.
    fn narrow_px(&self) -> usize {
        self.config.gate_px.ceil() as usize + 2
    }

    /// The motion of a pair that explains its matches, of which each may be off by the window.
    fn motion(&self, photos: [usize; 2], matches: &[Match], reach_px: [usize; 2]) -> PairMotion<'a> {
        self.motion_of(photos, &self.displacements(matches), reach_px)
    }

    fn motion_of(&self, photos: [usize; 2], found: &[Displacement], reach_px: [usize; 2]) -> PairMotion<'a> {
        let poses = photos.map(|photo| &self.poses[photo]);
        let reach_m = reach_px[0].max(reach_px[1]) as f64 * self.grid.step_m;
        PairMotion::fit(found, poses, reach_m, self.gate_m())
    }

    pub(super) fn displacements(&self, matches: &[Match]) -> Vec<Displacement> {
        matches.iter().filter_map(|one| self.displacement(one)).collect()
    }

    pub(super) fn gate_m(&self) -> f64 {
        self.config.gate_px * self.grid.step_m
    }

    fn agrees(&self, motion: &PairMotion<'_>, one: &Match) -> bool {
        self.displacement(one).is_some_and(|displacement| motion.agrees(&displacement, self.gate_m()))
    }

    fn displacement(&self, one: &Match) -> Option<Displacement> {
        let point = self.grid.point(one.candidate.reference[0], one.candidate.reference[1])?;
        let sign = one.candidate.sign();
        // Good to a third of the gate; templates that overlap share what they say.
        let independent = (self.config.cell_px as f64 / self.config.template_px as f64).powi(2).min(1.0);
        let information = 9.0 * independent / (self.gate_m() * self.gate_m());
        Some(Displacement {
            point,
            information,
            found_m: one.displacement.map(|texels| sign * texels * self.grid.step_m),
        })
    }

    fn predicted_offset(&self, motion: &PairMotion<'_>, candidate: &Candidate) -> Option<[i64; 2]> {
        let point = self.grid.point(candidate.reference[0], candidate.reference[1])?;
        let texels = motion.displacement_m(&point) * (candidate.sign() / self.grid.step_m);
        Some([texels.x.round() as i64, texels.y.round() as i64])
    }
}

/// A pair about to be searched.
pub(super) struct PairSearch<'a> {
    pub(super) level: &'a Level<'a>,
    pub(super) photos: [usize; 2],
    pub(super) pair: [&'a Patch; 2],
    pub(super) candidates: &'a [Candidate],
}

/// What is known of a pair, besides its poses, before its points are searched for.
#[derive(Debug, Default)]
pub(super) struct Hint {
    /// What agrees with one motion of the pair.
    pub(super) found: Vec<Displacement>,
    /// That is good to this, metres.
    pub(super) gate_m: f64,
}

impl PairSearch<'_> {
    /// [`Self::run`], a second time in a wider window if the first leaves doubt.
    pub(super) fn run_widening(
        &self,
        reach_px: [usize; 2],
        search: &mut Search,
        report: &mut PairReport,
    ) -> Vec<Match> {
        let mut matches = self.run(reach_px, search, report);
        let widen = self.level.config.widen;
        if report.is_doubtful() && widen > 1.0 {
            let wider_px = reach_px.map(|reach| (reach as f64 * widen).round() as usize);
            let mut again = PairReport { widened: true, ..*report };
            let found = self.run(wider_px, search, &mut again);
            report.widened = true;
            if again.agreeing > report.agreeing {
                (*report, matches) = (again, found);
            }
        }
        matches
    }

    /// Searches the pair's points in a window and keeps what agrees with one motion.
    ///
    /// A few probes are searched for in the whole window. If they clearly agree, the others are near their prediction; if
    /// even the most probes hardly agree, the others would not either.
    pub(super) fn run(&self, reach_px: [usize; 2], search: &mut Search, report: &mut PairReport) -> Vec<Match> {
        let level = self.level;
        let (wide, narrow) = (level.size(reach_px), level.size([level.narrow_px(); 2]));
        let count = self.candidates.len();
        let worth_probing = 2 * narrow.reach[0].max(narrow.reach[1]) < reach_px[0].max(reach_px[1]);
        let mut probed = vec![false; count];
        let mut matches = Vec::new();
        let mut tries = 0;
        let mut clear = None;
        for most in if worth_probing { [PROBES, MOST_PROBES] } else { [count; 2] } {
            let stride = (count / most.max(1)).max(1);
            for index in (0..count).step_by(stride) {
                if !std::mem::replace(&mut probed[index], true) {
                    tries += 1;
                    matches.extend(self.find(&self.candidates[index], [0, 0], &wide, search));
                }
            }
            if !worth_probing {
                break;
            }
            let motion = level.motion(self.photos, &matches, reach_px);
            let agreeing = matches.iter().filter(|one| level.agrees(&motion, one)).count();
            if agreeing as f64 >= (PROBES_AGREEING * matches.len() as f64).max(0.5 * PROBES as f64) {
                clear = Some(motion);
                break;
            }
            if tries >= MOST_PROBES && agreeing < level.config.min_agreeing {
                report.matched = matches.len() as u32;
                return Vec::new();
            }
        }
        for (candidate, _) in self.candidates.iter().zip(&probed).filter(|(_, probed)| !**probed) {
            let offset = clear.as_ref().and_then(|motion| level.predicted_offset(motion, candidate));
            matches.extend(match offset {
                Some(offset) => self.find(candidate, offset, &narrow, search),
                None => self.find(candidate, [0, 0], &wide, search),
            });
        }
        self.agreeing(matches, reach_px, report)
    }

    /// Searches each point not farther than `most_px` from where the hint, and the points found so far, expect it; only
    /// where that expectation is good enough, which grows from the hint's places outwards.
    ///
    /// The matches are not kept if together they contradict the hint.
    pub(super) fn run_near(
        &self,
        hint: &Hint,
        most_px: usize,
        reach_px: [usize; 2],
        search: &mut Search,
        report: &mut PairReport,
    ) -> Vec<Match> {
        let level = self.level;
        let size = level.size([most_px; 2]);
        let most_sigma_m = SIGMA_SHARE * most_px as f64 * level.grid.step_m;
        let mut open: Vec<&Candidate> = self.candidates.iter().collect();
        let mut found = hint.found.clone();
        let mut matches = Vec::new();
        loop {
            let motion = level.motion_of(self.photos, &found, reach_px);
            let is_near = |candidate: &Candidate| {
                let [column, row] = candidate.reference;
                level.grid.point(column, row).is_some_and(|point| motion.sigma_m(&point) <= most_sigma_m)
            };
            let (near, far): (Vec<_>, Vec<_>) = open.into_iter().partition(|candidate| is_near(candidate));
            let find = |candidate: &&Candidate| {
                let offset = level.predicted_offset(&motion, candidate)?;
                self.find(candidate, offset, &size, search)
            };
            let new: Vec<Match> = near.iter().filter_map(find).collect();
            found.extend(level.displacements(&new));
            open = far;
            let ends = new.is_empty() || open.is_empty();
            matches.extend(new);
            if ends {
                break;
            }
        }
        let matches = self.agreeing(matches, reach_px, report);
        let motion = level.motion(self.photos, &matches, reach_px);
        let confirmed = hint.found.iter().filter(|one| motion.agrees(one, hint.gate_m)).count();
        report.kept &= 2 * confirmed >= hint.found.len();
        matches
    }

    /// Keeps those of all matches that agree with one motion.
    fn agreeing(&self, mut matches: Vec<Match>, reach_px: [usize; 2], report: &mut PairReport) -> Vec<Match> {
        let level = self.level;
        report.matched = matches.len() as u32;
        let motion = level.motion(self.photos, &matches, reach_px);
        matches.retain(|one| level.agrees(&motion, one));
        report.agreeing = matches.len() as u32;
        report.shift_m = [0, 1].map(|axis| {
            let shifts: Vec<f64> = matches.iter().map(|one| one.candidate.sign() * one.displacement[axis]).collect();
            median(&shifts) * level.grid.step_m
        });
        let least = (level.config.min_agreeing_share * f64::from(report.matched)).max(level.config.min_agreeing as f64);
        report.kept = f64::from(report.agreeing) >= least;
        matches
    }

    fn find(&self, candidate: &Candidate, offset: [i64; 2], size: &SearchSize, search: &mut Search) -> Option<Match> {
        let (source, target) = (self.pair[candidate.from], self.pair[1 - candidate.from]);
        let middle = [0, 1].map(|axis| candidate.predicted[axis] + offset[axis]);
        let peak = search.find(source, candidate.place, target, middle, size)?;
        let displacement = [0, 1].map(|axis| peak.offset[axis] + offset[axis] as f64);
        Some(Match { candidate: *candidate, displacement })
    }
}

pub(super) fn global_place(patch: &Patch, point: [usize; 2]) -> [f64; 2] {
    [0, 1].map(|axis| (patch.origin[axis] + point[axis] as i64) as f64)
}
