//! The report: report.json for programs, report.html (self-contained, printable) for people.

mod figures;
mod findings;
mod flight;
mod picture;
mod planned;

use std::path::{Path, PathBuf};

use adit_geometry::profile::Profile;
use minijinja::Environment;
use serde::Serialize;
use serde_json::{Value, json};

use figures::PhotoFigures;
pub use figures::PoseFigures;
use flight::{Flight, FlightFigures};
pub(crate) use picture::{jpeg_address, wall_address};
pub(crate) use planned::MISSION_FILE;
use planned::PlannedFigures;

use crate::pipeline::{StageReport, Warning};
use crate::poses::Reconstruction;
use crate::survey::{Loss, Survey};
use crate::texture::{PhotoGain, Seams, TextureReport};

/// Longest side of the report's pictures.
const PICTURE_PX: usize = 1600;
/// So many holes are listed in the HTML; all are in coverage.json.
const LISTED_HOLES: usize = 20;

/// Everything the report speaks of.
pub struct ReportInput<'a> {
    /// The survey.
    pub survey: &'a Survey,
    /// Poses, points, camera, section.
    pub reconstruction: &'a Reconstruction,
    /// What the texture stage made.
    pub texture: &'a TextureReport,
    /// Figures of every stage before the report.
    pub stages: &'a [StageReport],
    /// What does not fit.
    pub warnings: &'a [Warning],
    /// Everything that could not be used.
    pub losses: &'a [Loss],
}

/// Why a report cannot be written.
#[derive(Debug, thiserror::Error)]
pub enum ReportError {
    /// A file cannot be written.
    #[error("cannot write {}", path.display())]
    Io {
        /// The file.
        path: PathBuf,
        /// What the system said.
        source: std::io::Error,
    },
    /// The panorama cannot be read back.
    #[error("the panorama's tiles")]
    Panorama(#[from] crate::texture::TextureError),
    /// The section cannot be built.
    #[error("the survey's section")]
    Profile(#[from] adit_geometry::profile::ProfileError),
    /// A picture cannot be encoded.
    #[error("a picture of the report")]
    Picture(#[from] jpeg_encoder::EncodingError),
    /// The figures cannot be encoded.
    #[error("report.json")]
    Json(#[from] serde_json::Error),
    /// What an inspector marked cannot be read.
    #[error("the findings")]
    Findings(#[from] crate::findings::FindingsError),
    /// The page's template fails.
    #[error("the report's template")]
    Template(#[from] minijinja::Error),
}

/// The content of report.json.
#[derive(Serialize)]
struct Report<'a> {
    format: u32,
    program: String,
    survey: String,
    profile: Value,
    photos: usize,
    poses: PoseFigures,
    planned: Option<PlannedFigures>,
    flight: &'a FlightFigures,
    stages: &'a [StageReport],
    coverage: &'a crate::texture::Coverage,
    native_mm_per_px: f64,
    resolution: &'a crate::texture::Resolution,
    texture: TextureFigures<'a>,
    seeds: Seeds,
    warnings: Vec<Told<'a>>,
    losses: &'a [Loss],
    photo_quality: Vec<PhotoFigures<'a>>,
}

/// Where chance comes in: nothing is drawn but samples of matches, and the flight where it was simulated.
#[derive(Serialize)]
struct Seeds {
    /// Of the two-view geometry, where photos are matched by their features.
    two_view: u64,
    /// Of a simulated set: what stands in truth/set.json; absent for real ones.
    simulated: Option<Value>,
}

impl Seeds {
    fn of(survey: &Survey) -> Self {
        let truth = std::fs::read(survey.folder.join("truth/set.json")).ok();
        let truth: Option<Value> = truth.and_then(|bytes| serde_json::from_slice(&bytes).ok());
        let simulated = truth.and_then(|truth| truth.get("seed").cloned());
        Self { two_view: crate::correspond::Verify::default().seed, simulated }
    }
}

/// Exposures and seams.
#[derive(Serialize)]
struct TextureFigures<'a> {
    seams: Seams,
    tone_rms_before: f64,
    tone_rms_after: f64,
    corner_brightness: f64,
    gains: &'a [PhotoGain],
}

impl<'a> TextureFigures<'a> {
    fn new(texture: &'a TextureReport) -> Self {
        Self {
            seams: texture.seams,
            tone_rms_before: texture.tone_rms_before,
            tone_rms_after: texture.tone_rms_after,
            corner_brightness: texture.corner_brightness,
            gains: &texture.gains,
        }
    }
}

/// A warning with its words.
#[derive(Serialize)]
struct Told<'a> {
    message: String,
    warning: &'a Warning,
}

/// Writes report.json and report.html to `out`.
///
/// # Errors
/// [`ReportError`] says what failed.
pub fn write(input: &ReportInput<'_>, out: &Path) -> Result<(), ReportError> {
    let profile = input.reconstruction.profile.build()?;
    let flight = Flight::new(input.survey, input.reconstruction, &profile);
    let report = Report {
        format: 1,
        program: format!("adit {}", env!("CARGO_PKG_VERSION")),
        survey: input.survey.folder.display().to_string(),
        profile: crate::texture::profile_json(&input.reconstruction.profile),
        photos: input.survey.photos.len(),
        poses: PoseFigures::new(&input.reconstruction.poses),
        planned: PlannedFigures::new(input),
        flight: &flight.figures,
        stages: input.stages,
        coverage: &input.texture.coverage,
        native_mm_per_px: input.texture.native_mm_per_px,
        resolution: &input.texture.resolution,
        texture: TextureFigures::new(input.texture),
        seeds: Seeds::of(input.survey),
        warnings: input.warnings.iter().map(|warning| Told { message: warning.to_string(), warning }).collect(),
        losses: input.losses,
        photo_quality: input.reconstruction.poses.iter().map(PhotoFigures::new).collect(),
    };
    let json = serde_json::to_string_pretty(&report)?;
    save(&out.join("report.json"), json.as_bytes())?;
    let page = page(input, &report, &flight, &profile, out)?;
    save(&out.join("report.html"), page.as_bytes())
}

fn save(path: &Path, content: &[u8]) -> Result<(), ReportError> {
    std::fs::write(path, content).map_err(|source| ReportError::Io { path: path.to_owned(), source })
}

fn page(
    input: &ReportInput<'_>,
    report: &Report<'_>,
    flight: &Flight,
    profile: &Profile<f64>,
    out: &Path,
) -> Result<String, ReportError> {
    let mut environment = Environment::new();
    // The name's ending turns HTML escaping on for every value.
    environment.add_template("planned.html", include_str!("planned.html"))?;
    environment.add_template("report.html", include_str!("report.html"))?;
    let grid = &input.texture.grid;
    let surface = figures_of(input.stages, "surface");
    // A picture that an earlier run left says nothing of this one.
    let relief = (!surface.is_null()).then(|| picture::map(&out.join("relief.png"), PICTURE_PX)).transpose()?;
    let figures = json!({
        "report": report,
        "texture": input.texture,
        "holes": input.texture.coverage.holes.iter().take(LISTED_HOLES).collect::<Vec<_>>(),
        "panorama": picture::panorama(grid, &out.join("panorama/tiles"), PICTURE_PX)?,
        "coverage_picture": picture::map(&out.join("coverage.png"), PICTURE_PX)?,
        "surface": surface,
        "relief_picture": relief,
        "coverage_colours": crate::texture::COVERAGE_COLOURS,
        "resolution_picture": picture::map(&out.join("resolution.png"), PICTURE_PX)?,
        "resolution_colours": crate::texture::RESOLUTION_COLOURS,
        "findings": findings::told(out)?,
        "track_svg": figures::track_svg(&input.reconstruction.poses),
        "section_svg": figures::section_svg(profile, &input.reconstruction.poses),
        "speed_svg": flight.speed_svg,
        "water_svg": flight.water_svg,
        "sigma_svg": figures::sigma_svg(&input.reconstruction.poses),
        "length_m": grid.height_px as f64 * grid.texel_m(),
        "adjust": figures_of(input.stages, "adjust"),
        "prior": figures_of(input.stages, "prior"),
        "coarse": figures_of(input.stages, "coarse"),
        "matching": figures_of(input.stages, "match"),
    });
    Ok(environment.get_template("report.html")?.render(minijinja::value::Serde(&figures))?)
}

fn figures_of(stages: &[StageReport], name: &str) -> Value {
    stages.iter().find(|stage| stage.stage.name() == name).map_or(Value::Null, |stage| stage.figures.clone())
}
