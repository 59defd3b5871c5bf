//! From a survey folder to `out/`: stages in a row, each stored, so that a killed run goes on where it was.

mod checkpoint;
mod groups;
mod photos;
mod placing;
mod progress;
mod solve;
mod stages;
mod tag_noise;
mod warnings;

use std::path::PathBuf;

use anyhow::{Context, Result, bail};
use serde::{Deserialize, Serialize};
use serde_json::json;

pub use checkpoint::{Checkpoints, Key};
pub(crate) use groups::{Groups, registered};
pub use progress::{StageProgress, Verbosity};
pub use solve::{SolveOptions, Solver, Start};
pub use stages::{AdjustStage, CoarseStage, MatchStage, PriorStage, RoundSummary, TagSlip};
pub use warnings::Warning;

use crate::files::write_whole;
use crate::model::{self, ModelOptions, ModelReport};
use crate::poses::{PhotoPose, PoseStatus, Reconstruction, write_poses};
use crate::report::{self, ReportInput};
use crate::surface::{self, SurfaceOptions, SurfaceReport, SurfaceStore};
use crate::survey::{self, Loss, Survey};
use crate::texture::{self, TextureOptions, TextureProgress, TextureReport};

/// The stages in order.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize, clap::ValueEnum)]
#[serde(rename_all = "lowercase")]
pub enum Stage {
    /// Poses from the tags alone.
    Prior,
    /// First matches within the tags' uncertainty, first adjustment.
    Coarse,
    /// Matches at the photos' own resolution.
    Match,
    /// Adjustment with pruning.
    Adjust,
    /// The wall's height over its section: rings and relief.
    Surface,
    /// Panorama, sheets, coverage.
    Texture,
    /// GLB, OBJ, PLY, COLMAP.
    Model,
    /// report.html and report.json.
    Report,
}

/// What `adit reconstruct` was asked to do.
#[derive(Clone, Debug)]
pub struct ReconstructOptions {
    /// The survey folder.
    pub survey: PathBuf,
    /// Where results go.
    pub out: PathBuf,
    /// Panorama resolution; the photos' own if `None`.
    pub mm_per_px: Option<f64>,
    /// Last stage to run.
    pub stop_after: Option<Stage>,
    /// Forget earlier results.
    pub fresh: bool,
    /// What the pose stages may do.
    pub solve: SolveOptions,
    /// Bars and lines on standard error.
    pub verbosity: Verbosity,
}

/// What became of a stage.
#[derive(Clone, Debug, Serialize)]
pub struct StageReport {
    /// The stage.
    pub stage: Stage,
    /// Wall-clock time; `None` if an earlier run's result was kept.
    pub seconds: Option<f64>,
    /// What was measured.
    pub figures: serde_json::Value,
}

/// What a run of [`reconstruct`] leaves for the command line; everything else is in `out/`.
#[derive(Clone, Debug, Serialize)]
pub struct Summary {
    /// Photos with a tag.
    pub photos: usize,
    /// Photos whose pose the matches hold; `None` before the adjustment.
    pub registered: Option<usize>,
    /// Figures of every stage that was run or kept.
    pub stages: Vec<StageReport>,
    /// What does not fit; known after the adjustment.
    pub warnings: Vec<Warning>,
    /// Everything that could not be used.
    pub losses: Vec<Loss>,
}

/// Reconstructs a survey.
///
/// # Errors
/// If the survey cannot be used, the output cannot be written, or nothing is left to adjust. What stages finished before
/// stays and is used by the next run.
pub fn reconstruct(options: &ReconstructOptions) -> Result<Summary> {
    let survey = survey::load(&options.survey)?;
    if survey.photos.is_empty() {
        bail!("{}: no photo has a tag, so there is nothing to reconstruct", options.survey.display());
    }
    let checkpoints = Checkpoints::open(&options.out, options.fresh)?;
    let mut run = Run {
        options,
        checkpoints,
        summary: Summary {
            photos: survey.photos.len(),
            registered: None,
            stages: Vec::new(),
            warnings: Vec::new(),
            losses: survey.losses.clone(),
        },
    };
    let ended = run.stages(&survey);
    let stored = run.checkpoints.finish();
    ended.and(stored)?;
    Ok(run.summary)
}

struct Run<'a> {
    options: &'a ReconstructOptions,
    checkpoints: Checkpoints,
    summary: Summary,
}

impl Run<'_> {
    fn stages(&mut self, survey: &Survey) -> Result<()> {
        let photos = survey.photos.len();
        let solver = Solver::new(survey, self.options.solve)?;
        let key = Key::of_survey(survey)?.then("prior", &self.options.solve.start)?;
        let prior = self.stage(Stage::Prior, key, photos, &[], |_| solver.prior(), say_prior)?;
        let solver = solver.with_section(&prior)?;
        if self.ends_with(Stage::Prior) {
            return Ok(());
        }
        if self.options.solve.start == Start::TagsOnly {
            return self.picture_tags_only(survey, &solver.tags_only(&prior), key);
        }
        let key = key.then("coarse", &self.options.solve)?;
        let coarse =
            self.stage(Stage::Coarse, key, photos, &[], |progress| solver.coarse(&prior, progress), say_coarse)?;
        self.summary.losses.extend(coarse.losses.iter().cloned());
        if self.ends_with(Stage::Coarse) {
            return Ok(());
        }
        let key = key.then("match", &())?;
        let matches =
            self.stage(Stage::Match, key, photos, &[], |progress| Ok(solver.fine(&coarse, progress)), say_match)?;
        if self.ends_with(Stage::Match) {
            return Ok(());
        }
        let key = key.then("adjust", &())?;
        let adjusted =
            self.stage(Stage::Adjust, key, photos, &[], |_| solver.adjust(&prior, &coarse, matches), say_adjust)?;
        let poses = &adjusted.reconstruction.poses;
        self.summary.warnings.clone_from(&adjusted.warnings);
        self.write_poses(poses)?;
        self.summary.registered = Some(poses.iter().filter(|pose| pose.status == PoseStatus::Adjusted).count());
        if self.ends_with(Stage::Adjust) {
            return Ok(());
        }
        drop(solver);
        self.picture_stages(survey, &adjusted.reconstruction, key)
    }

    /// Everything after the prior poses where photos are not matched.
    fn picture_tags_only(&mut self, survey: &Survey, reconstruction: &Reconstruction, key: Key) -> Result<()> {
        self.summary.warnings.push(Warning::TagsOnly);
        self.write_poses(&reconstruction.poses)?;
        if self.options.stop_after.is_some_and(|stage| stage < Stage::Surface) {
            return Ok(());
        }
        self.picture_stages(survey, reconstruction, key)
    }

    fn picture_stages(&mut self, survey: &Survey, reconstruction: &Reconstruction, key: Key) -> Result<()> {
        let key = self.surface(survey, reconstruction, key)?;
        if self.ends_with(Stage::Surface) {
            return Ok(());
        }
        let out = &self.options.out;
        // Photos that were not matched cannot measure the wall: it is the section.
        let open_surface = || match self.options.solve.start {
            Start::TagsOnly => SurfaceStore::flat(&reconstruction.profile),
            _ => SurfaceStore::open(out),
        };
        let options = TextureOptions { mm_per_px: self.options.mm_per_px, ..TextureOptions::default() };
        let key = key.then("texture", &options)?;
        let files = ["panorama/panorama.json", "panorama/tiles/panorama.dzi", "coverage.json"];
        let compute = |progress: &StageProgress| {
            let tell = |event| match event {
                TextureProgress::Total(total) => progress.restart(total),
                TextureProgress::Step => progress.tick(),
            };
            let surface = open_surface()?;
            Ok(texture::build(survey, reconstruction, &surface, &options, out, &tell)?)
        };
        let textured = self.stage(Stage::Texture, key, 0, &files, compute, say_texture)?;
        self.summary.losses.extend(textured.losses.iter().cloned());
        if self.ends_with(Stage::Texture) {
            return Ok(());
        }
        let options = ModelOptions::default();
        let key = key.then("model", &options)?;
        let files = ["model.glb", "model.obj", "points.ply", "colmap/points3D.txt"];
        let compute = |_: &StageProgress| {
            model::colmap::write(reconstruction, &out.join("colmap"))?;
            Ok(model::write(open_surface()?, &textured.grid, &options, out)?)
        };
        self.stage(Stage::Model, key, 0, &files, compute, say_model)?;
        if self.ends_with(Stage::Model) {
            return Ok(());
        }
        self.report(survey, reconstruction, &textured)
    }

    /// Measures the wall, if photos were matched; returns the key of what follows.
    fn surface(&mut self, survey: &Survey, reconstruction: &Reconstruction, key: Key) -> Result<Key> {
        if self.options.solve.start == Start::TagsOnly {
            return key.then("no surface", &());
        }
        let out = &self.options.out;
        let options = SurfaceOptions::default();
        let key = key.then("surface", &options)?;
        let files = ["surface/surface.json", "relief.tif", "relief.png"];
        let compute = |progress: &StageProgress| {
            let tell = |done: usize, total: usize| if done == 0 { progress.restart(total) } else { progress.tick() };
            Ok(surface::build(survey, reconstruction, &options, out, &tell)?)
        };
        let surface = self.stage(Stage::Surface, key, 0, &files, compute, say_surface)?;
        self.summary.losses.extend(surface.losses.iter().cloned());
        Ok(key)
    }

    /// Written anew each time: it says what this run did.
    fn report(&mut self, survey: &Survey, reconstruction: &Reconstruction, texture: &TextureReport) -> Result<()> {
        let progress = StageProgress::start(self.options.verbosity, Stage::Report.name(), 0);
        self.summary.losses.sort_by(|a, b| (&a.what, &a.why).cmp(&(&b.what, &b.why)));
        self.summary.losses.dedup();
        let input = ReportInput {
            survey,
            reconstruction,
            texture,
            stages: &self.summary.stages,
            warnings: &self.summary.warnings,
            losses: &self.summary.losses,
        };
        report::write(&input, &self.options.out)?;
        let seconds = progress.finish("report.html, report.json").as_secs_f64();
        self.summary.stages.push(StageReport {
            stage: Stage::Report,
            seconds: Some(seconds),
            figures: serde_json::Value::Null,
        });
        Ok(())
    }

    fn write_poses(&self, poses: &[PhotoPose]) -> Result<()> {
        let mut table = Vec::new();
        write_poses(&mut table, poses)?;
        let path = self.options.out.join("poses.csv");
        write_whole(&path, &table).with_context(|| format!("cannot write {}", path.display()))
    }

    fn ends_with(&self, stage: Stage) -> bool {
        self.options.stop_after == Some(stage)
    }

    /// Runs a stage, or takes what an earlier run left of it if `files` are all still there.
    fn stage<T: Serialize + serde::de::DeserializeOwned>(
        &mut self,
        stage: Stage,
        key: Key,
        total: usize,
        files: &[&str],
        compute: impl FnOnce(&StageProgress) -> Result<T>,
        say: fn(&T) -> (String, serde_json::Value),
    ) -> Result<T> {
        let name = stage.name();
        let progress = StageProgress::start(self.options.verbosity, name, total);
        let all_there = files.iter().all(|file| self.options.out.join(file).exists());
        if all_there && let Some(kept) = self.checkpoints.load::<T>(name, key) {
            let (line, figures) = say(&kept);
            progress.finish(&format!("{line}, kept from an earlier run"));
            self.summary.stages.push(StageReport { stage, seconds: None, figures });
            return Ok(kept);
        }
        let result = compute(&progress).with_context(|| format!("stage {name} failed"))?;
        self.checkpoints.store(name, key, &result)?;
        let (line, figures) = say(&result);
        let seconds = progress.finish(&line).as_secs_f64();
        self.summary.stages.push(StageReport { stage, seconds: Some(seconds), figures });
        Ok(result)
    }
}

impl Stage {
    /// The stage's name on the command line, on disk and on screen.
    pub fn name(self) -> &'static str {
        match self {
            Self::Prior => "prior",
            Self::Coarse => "coarse",
            Self::Match => "match",
            Self::Adjust => "adjust",
            Self::Surface => "surface",
            Self::Texture => "texture",
            Self::Model => "model",
            Self::Report => "report",
        }
    }
}

fn say_prior(stage: &PriorStage) -> (String, serde_json::Value) {
    let size = match &stage.size {
        None if !stage.tagged => "placed by their features, without tags".to_owned(),
        None => "too few ranges to check the section's size".to_owned(),
        Some(size) => {
            let warning = if size.contradicts_nominal() { "; used instead of it: CHECK survey.toml" } else { "" };
            let percent = (size.factor - 1.0) * 100.0;
            format!("ranges give {percent:+.2} % +- {:.2} % of the nominal section{warning}", size.sigma * 100.0)
        }
    };
    (format!("{} photos; {size}", stage.views.len()), json!({ "size": stage.size }))
}

fn say_round(round: &RoundSummary) -> String {
    let doubtful = match round.doubtful.len() {
        0 => String::new(),
        count => format!(", {count} doubtful"),
    };
    format!("{} matches in {} of {} pairs{doubtful}", round.matches, round.pairs_kept, round.pairs_expected)
}

fn say_coarse(stage: &CoarseStage) -> (String, serde_json::Value) {
    let report = &stage.adjustment;
    let line = format!(
        "{}; error {:.1} -> {:.2} px",
        say_round(&stage.round),
        report.median_before_px,
        report.median_after_px
    );
    (line, json!({ "round": stage.round, "adjustment": report }))
}

fn say_match(stage: &MatchStage) -> (String, serde_json::Value) {
    (say_round(&stage.round), json!({ "round": stage.round }))
}

fn say_adjust(stage: &AdjustStage) -> (String, serde_json::Value) {
    let poses = &stage.reconstruction.poses;
    let registered = poses.iter().filter(|pose| pose.status == PoseStatus::Adjusted).count();
    let line = format!(
        "{registered} of {} photos registered, {} points, error {:.2} -> {:.3} px (median)",
        poses.len(),
        stage.last.points,
        stage.first.median_before_px,
        stage.last.median_after_px
    );
    let figures = json!({
        "registered": registered,
        "mount_deg": <[f64; 3]>::from(stage.shared.mount_rotvec).map(f64::to_degrees),
        "odometer_scale": stage.shared.odometer_scale,
        "profile_size": stage.shared.profile_size,
        "before_pruning": stage.first,
        "after_pruning": stage.last,
        "pruned": stage.pruned,
    });
    (line, figures)
}

fn say_surface(report: &SurfaceReport) -> (String, serde_json::Value) {
    let ovality = report.median_ovality_percent.map_or_else(String::new, |percent| format!(", ovality {percent:.2} %"));
    let line = format!(
        "{:.1} m2 known in cells of {:.0} mm, relief {:+.1} to {:+.1} mm{ovality}",
        report.known_area_m2, report.cell_mm, report.deepest.height_mm, report.highest.height_mm
    );
    (line, json!(report))
}

fn say_texture(report: &TextureReport) -> (String, serde_json::Value) {
    let grid = &report.grid;
    let line = format!(
        "{} x {} px at {:.2} mm, {:.1} % of the wall seen, {} holes",
        grid.width_px,
        grid.height_px,
        grid.mm_per_px,
        report.coverage.seen_share[0] * 100.0,
        report.coverage.hole_count
    );
    (line, json!(report))
}

fn say_model(report: &ModelReport) -> (String, serde_json::Value) {
    let line = format!("{} triangles in {} chunks, {} points", report.triangles, report.chunks, report.points);
    (line, json!(report))
}
