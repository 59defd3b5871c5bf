//! panorama.json read back: the grid and the section that it lies on.

use std::fs;
use std::io;
use std::path::Path;

use adit_geometry::profile::{ChainVertex, Profile, ProfileSpec};
use serde::Deserialize;

use super::error::{TextureError, at_path};
use super::grid::PanoramaGrid;

/// The unrolled wall.
pub(crate) struct Panorama {
    pub(crate) grid: PanoramaGrid,
    pub(crate) spec: ProfileSpec<f64>,
    pub(crate) profile: Profile<f64>,
}

#[derive(Deserialize)]
struct Raw {
    #[serde(flatten)]
    grid: PanoramaGrid,
    profile: RawProfile,
}

/// The keys of survey.toml's `[tunnel]`.
#[derive(Deserialize)]
#[serde(tag = "profile", rename_all = "kebab-case")]
enum RawProfile {
    Circle { radius_m: f64 },
    Rectangle { width_m: f64, height_m: f64, axis_height_m: f64 },
    Underpass { width_m: f64, wall_m: f64, rise_m: f64, axis_height_m: f64 },
    Horseshoe { width_m: f64, wall_m: f64, axis_height_m: f64 },
    Chain { points: Vec<[f64; 2]>, bulges: Vec<f64> },
}

impl RawProfile {
    fn spec(self) -> ProfileSpec<f64> {
        match self {
            Self::Circle { radius_m } => ProfileSpec::Circle { radius_m },
            Self::Rectangle { width_m, height_m, axis_height_m } => {
                ProfileSpec::Rectangle { width_m, height_m, axis_height_m }
            }
            Self::Underpass { width_m, wall_m, rise_m, axis_height_m } => {
                ProfileSpec::Underpass { width_m, wall_m, rise_m, axis_height_m }
            }
            Self::Horseshoe { width_m, wall_m, axis_height_m } => {
                ProfileSpec::Horseshoe { width_m, wall_m, axis_height_m }
            }
            Self::Chain { points, bulges } => {
                let bulges = bulges.into_iter().chain(std::iter::repeat(0.0));
                let vertices = points.into_iter().zip(bulges);
                let vertices = vertices.map(|([y_m, z_m], bulge)| ChainVertex { y_m, z_m, bulge });
                // A longer chain than fits is another perimeter, which `read` refuses.
                ProfileSpec::Chain { vertices: vertices.take(adit_geometry::profile::MAX_PIECES).collect() }
            }
        }
    }
}

impl Panorama {
    /// Reads `out/panorama/panorama.json`.
    ///
    /// # Errors
    /// [`TextureError::NoPanorama`] if there is none; others if it is damaged.
    pub(crate) fn open(out: &Path) -> Result<Self, TextureError> {
        let path = out.join("panorama/panorama.json");
        let text = match fs::read_to_string(&path) {
            Ok(text) => text,
            Err(error) if error.kind() == io::ErrorKind::NotFound => {
                let inner = out.join("out/panorama/panorama.json").is_file();
                let hint = if inner { " (this is the survey: its results are in its folder out/)" } else { "" };
                return Err(TextureError::NoPanorama { out: out.to_owned(), hint });
            }
            Err(error) => return Err(at_path(&path)(error)),
        };
        let raw: Raw =
            serde_json::from_str(&text).map_err(|source| TextureError::Json { path: path.clone(), source })?;
        let (grid, spec) = (raw.grid, raw.profile.spec());
        let profile = spec.build()?;
        let wrong = |what| Err(TextureError::Damaged { path: path.clone(), what });
        if !(grid.mm_per_px > 0.0 && grid.width_px > 0 && grid.height_px > 0 && grid.x0_m.is_finite()) {
            return wrong("a size is not positive");
        }
        if (grid.s_m(grid.width_px as f64) - grid.s0_m - profile.perimeter_m()).abs() > grid.texel_m() {
            return wrong("its columns do not go once around the section");
        }
        Ok(Self { grid, spec, profile })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn written(spec: &ProfileSpec<f64>) -> tempfile::TempDir {
        let folder = tempfile::tempdir().unwrap();
        let grid = PanoramaGrid::new(spec.build().unwrap().perimeter_m(), 5.0, -1.0, 2.0);
        fs::create_dir(folder.path().join("panorama")).unwrap();
        fs::write(folder.path().join("panorama/panorama.json"), grid.to_json(spec).to_string()).unwrap();
        folder
    }

    #[test]
    fn every_section_is_read_as_it_was_written() {
        let vertex = |y_m, z_m, bulge| ChainVertex { y_m, z_m, bulge };
        let vertices = [vertex(1.0, -1.0, 0.0), vertex(1.0, 1.0, 0.2), vertex(-1.0, 1.0, 0.0), vertex(-1.0, -1.0, 0.5)];
        for spec in [
            ProfileSpec::Circle { radius_m: 3.0 },
            ProfileSpec::Rectangle { width_m: 4.0, height_m: 3.0, axis_height_m: 1.4 },
            ProfileSpec::Underpass { width_m: 4.0, wall_m: 2.5, rise_m: 1.0, axis_height_m: 1.4 },
            ProfileSpec::Horseshoe { width_m: 4.0, wall_m: 2.5, axis_height_m: 1.4 },
            ProfileSpec::Chain { vertices: vertices.into_iter().collect() },
        ] {
            let folder = written(&spec);
            assert_eq!(Panorama::open(folder.path()).unwrap().spec, spec);
        }
    }

    #[test]
    fn a_folder_without_panorama_is_told_what_to_run() {
        let folder = tempfile::tempdir().unwrap();
        let message = Panorama::open(folder.path()).err().unwrap().to_string();
        assert!(message.contains("adit reconstruct") && message.contains("texture"), "{message}");
        fs::create_dir_all(folder.path().join("out/panorama")).unwrap();
        fs::write(folder.path().join("out/panorama/panorama.json"), "{}").unwrap();
        assert!(
            Panorama::open(folder.path()).err().unwrap().to_string().contains("its results are in its folder out/")
        );
    }

    #[test]
    fn a_width_that_does_not_go_around_is_refused() {
        let folder = written(&ProfileSpec::Circle { radius_m: 3.0 });
        let path = folder.path().join("panorama/panorama.json");
        let text = fs::read_to_string(&path).unwrap().replace("\"radius_m\":3.0", "\"radius_m\":3.1");
        fs::write(&path, text).unwrap();
        assert!(matches!(Panorama::open(folder.path()), Err(TextureError::Damaged { .. })));
    }
}
