//! What a reconstruction has left: opened part by part, so that poses can be exported before there is a panorama.

use std::cell::OnceCell;
use std::fs;
use std::io::ErrorKind;
use std::path::{Path, PathBuf};

use super::error::{ExportError, at_path};
use crate::model::{ModelError, TexturedWall};
use crate::pipeline::{AdjustStage, Checkpoints, Stage};
use crate::poses::Reconstruction;
use crate::surface::SurfaceStore;
use crate::texture::Panorama;

/// A reconstruction's folder.
pub(super) struct Finished {
    out: PathBuf,
    reconstruction: OnceCell<Reconstruction>,
    wall: OnceCell<TexturedWall>,
}

impl Finished {
    pub(super) fn new(out: &Path) -> Self {
        Self { out: out.to_owned(), reconstruction: OnceCell::new(), wall: OnceCell::new() }
    }

    /// Poses, points, camera and section, read when first asked for.
    pub(super) fn reconstruction(&self) -> Result<&Reconstruction, ExportError> {
        if let Some(known) = self.reconstruction.get() {
            return Ok(known);
        }
        let path = Checkpoints::file(&self.out, Stage::Adjust.name());
        let content = self.left_by(Stage::Adjust, &path)?;
        let stage: AdjustStage = Checkpoints::decode(&content).ok_or_else(|| self.damaged(&path))?;
        Ok(self.reconstruction.get_or_init(|| stage.reconstruction))
    }

    /// The panorama, opened when first asked for.
    pub(super) fn wall(&self) -> Result<&TexturedWall, ExportError> {
        if let Some(known) = self.wall.get() {
            return Ok(known);
        }
        self.file("panorama/panorama.json", Stage::Texture)?;
        let Panorama { grid, .. } = Panorama::open(&self.out)?;
        let surface = self.surface()?;
        Ok(self.wall.get_or_init(|| TexturedWall::new(surface, &grid, &self.out)))
    }

    /// The measured wall; the section itself where the reconstruction is older than stage surface.
    fn surface(&self) -> Result<SurfaceStore, ExportError> {
        let surface = if self.out.join("surface").exists() {
            SurfaceStore::open(&self.out)
        } else {
            SurfaceStore::flat(&self.reconstruction()?.profile)
        };
        Ok(surface.map_err(ModelError::from)?)
    }

    /// A file that is exported as it is.
    pub(super) fn file(&self, name: &str, stage: Stage) -> Result<PathBuf, ExportError> {
        let path = self.out.join(name);
        if path.exists() { Ok(path) } else { Err(self.missing(stage, &path)) }
    }

    fn left_by(&self, stage: Stage, path: &Path) -> Result<Vec<u8>, ExportError> {
        match fs::read(path) {
            Err(error) if error.kind() == ErrorKind::NotFound => Err(self.missing(stage, path)),
            read => read.map_err(at_path(path)),
        }
    }

    fn missing(&self, stage: Stage, path: &Path) -> ExportError {
        ExportError::Missing { path: path.to_owned(), out: self.out.clone(), stage: stage.name() }
    }

    fn damaged(&self, path: &Path) -> ExportError {
        ExportError::Damaged { path: path.to_owned(), out: self.out.clone() }
    }
}
