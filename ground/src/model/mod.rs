//! The textured model in the formats that other programs open, made from the panorama's tiles: GLB, OBJ, PLY.

pub mod colmap;
mod error;
mod glb;
mod mesh;
mod obj;
mod ply;

use std::path::Path;

use rayon::prelude::*;
use serde::{Deserialize, Serialize};

pub use error::ModelError;

use crate::surface::SurfaceStore;
use crate::texture::{PanoramaGrid, TileReader};
use mesh::{Chunk, ChunkOptions};

/// No texture may be larger: the limit of many graphics cards and of the JPEG encoder's care.
const LARGEST_TEXTURE_PX: usize = 8192;

/// What may be chosen.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct ModelOptions {
    /// Longest side of a chunk's texture, at most 8192.
    pub texture_px: usize,
    /// Pixels of all textures together; a longer tunnel gets coarser textures, the panorama keeps the fine ones.
    pub texture_budget_px: u64,
    /// Quality of the textures' JPEGs, 1 to 100.
    pub jpeg_quality: u8,
    /// Largest distance of a facet from the arc that it stands for.
    pub sagitta_m: f64,
    /// Longest side of a facet.
    pub facet_m: f64,
    /// Distance between the points of the point cloud, about (texels are halved until they fit).
    pub point_step_m: f64,
}

impl Default for ModelOptions {
    fn default() -> Self {
        Self {
            texture_px: 4096,
            // 10 m of a 6 m bore at 2 mm are 47 million; a desktop viewer holds a quarter of a gigapixel unpacked.
            texture_budget_px: 100_000_000,
            jpeg_quality: 88,
            sagitta_m: 0.002,
            // A bulge of 50 mm over 0.3 m departs from such a facet by 1.6 mm at most.
            facet_m: 0.075,
            point_step_m: 0.008,
        }
    }
}

/// What the model stage made.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct ModelReport {
    /// Meshes with a texture of their own.
    pub chunks: usize,
    /// Triangles.
    pub triangles: usize,
    /// Resolution of the textures.
    pub texture_mm_per_px: f64,
    /// Size of model.glb.
    pub glb_bytes: u64,
    /// Points of points.ply.
    pub points: u64,
}

/// Writes `model.glb`, `model.obj` (with `model.mtl` and `model_textures/`) and `points.ply` from the tiles in `out`, on the
/// wall `surface`.
///
/// # Errors
/// [`ModelError`] if the tiles cannot be read or a file cannot be written.
pub fn write(
    surface: &SurfaceStore,
    grid: &PanoramaGrid,
    options: &ModelOptions,
    out: &Path,
) -> Result<ModelReport, ModelError> {
    let reader = TileReader::new(&out.join("panorama/tiles"), grid.width_px, grid.height_px);
    let chunk_options = ChunkOptions {
        largest_texture_px: options.texture_px.clamp(64, LARGEST_TEXTURE_PX),
        texture_budget_px: options.texture_budget_px,
        sagitta_m: options.sagitta_m,
        facet_m: options.facet_m,
        jpeg_quality: options.jpeg_quality.clamp(1, 100),
    };
    let boxes = mesh::plan(&reader, &chunk_options);
    let halvings = boxes.first().map_or(0, |area| reader.last_level() - area.level);
    let chunks: Vec<Chunk> = boxes
        .par_iter()
        .filter_map(|area| mesh::chunk(area, &reader, grid, surface, &chunk_options).transpose())
        .collect::<Result<_, _>>()?;
    let glb = out.join("model.glb");
    glb::write(&glb, &chunks)?;
    obj::write(out, &chunks)?;
    let points = ply::write(&out.join("points.ply"), &reader, grid, surface, options.point_step_m)?;
    Ok(ModelReport {
        chunks: chunks.len(),
        triangles: chunks.iter().map(|chunk| chunk.indices.len() / 3).sum(),
        texture_mm_per_px: grid.mm_per_px * f64::from(halvings).exp2(),
        glb_bytes: std::fs::metadata(&glb).map_err(error::at_path(&glb))?.len(),
        points,
    })
}
