//! The wall as textured chunks: boxes of the panorama, each with a mesh on the measured wall and a picture.
//!
//! # Frame
//! Model space is glTF's: right-handed, y up, metres: X = tunnel y (right), Y = -tunnel z (up), Z = -tunnel x, so that a
//! viewer's camera at rest looks forward along the tunnel. Normals point inwards, front faces are seen from inside.

use adit_geometry::profile::Profile;
use rayon::prelude::*;

use super::error::ModelError;
use crate::surface::{SurfaceStore, SurfaceWindow, WallPlace};
use crate::texture::{PanoramaGrid, PixelBox, Rgba8, TileReader};

/// Pixels around a chunk's own that its picture repeats from its neighbours, so that filtering shows no seam.
const MARGIN_PX: usize = 4;
/// Colour of what no photo saw, where it shares a facet with what was seen.
const UNSEEN: [u8; 3] = [128; 3];
/// Two places closer than this are one.
const SAME_M: f64 = 1e-7;

/// Choices for meshes and pictures.
#[derive(Clone, Copy, Debug)]
pub(super) struct ChunkOptions {
    pub(super) largest_texture_px: usize,
    pub(super) texture_budget_px: u64,
    pub(super) sagitta_m: f64,
    pub(super) facet_m: f64,
    pub(super) jpeg_quality: u8,
}

/// A box of the panorama that becomes one mesh and one picture.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct ChunkBox {
    pub(super) level: u32,
    pub(super) column: usize,
    pub(super) row: usize,
    pub(super) width: usize,
    pub(super) height: usize,
}

/// A vertex in model space, relative to its chunk's origin.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Vertex {
    pub(super) position: [f32; 3],
    pub(super) normal: [f32; 3],
    pub(super) uv: [f32; 2],
}

/// A mesh with its picture.
pub(super) struct Chunk {
    pub(super) name: String,
    /// Place of the chunk's origin in model space.
    pub(super) origin: [f32; 3],
    pub(super) vertices: Vec<Vertex>,
    /// Three per triangle.
    pub(super) indices: Vec<u32>,
    pub(super) jpeg: Vec<u8>,
}

/// Divides the panorama into boxes at the finest level that the budget allows.
pub(super) fn plan(reader: &TileReader, options: &ChunkOptions) -> Vec<ChunkBox> {
    let fits = |level: &u32| {
        let (width, height) = reader.size(*level);
        width as u64 * height as u64 <= options.texture_budget_px
    };
    let level = (0..=reader.last_level()).rev().find(fits).unwrap_or(0);
    let (width, height) = reader.size(level);
    let side = options.largest_texture_px.saturating_sub(2 * MARGIN_PX).max(1);
    let parts = |length: usize| {
        let count = length.div_ceil(side);
        (0..count).map(move |part| (length * part / count, length * (part + 1) / count))
    };
    parts(height)
        .flat_map(|(row, row_end)| {
            parts(width).map(move |(column, column_end)| ChunkBox {
                level,
                column,
                row,
                width: column_end - column,
                height: row_end - row,
            })
        })
        .collect()
}

/// Makes the chunk of a box, or `None` if no photo saw any of it.
pub(super) fn chunk(
    area: &ChunkBox,
    reader: &TileReader,
    grid: &PanoramaGrid,
    surface: &SurfaceStore,
    options: &ChunkOptions,
) -> Result<Option<Chunk>, ModelError> {
    let picture = read_with_margin(reader, area)?;
    let scale = (1_u64 << (reader.last_level() - area.level)) as f64 * grid.texel_m();
    let place = Placement { area: *area, s0_m: grid.s0_m, x0_m: grid.x0_m, scale };
    let window = surface.window([area.row, area.row + area.height].map(|row| place.x_m(row as f64)))?;
    let (vertices, indices) = mesh(&place, &picture, &window, grid, options);
    if indices.is_empty() {
        return Ok(None);
    }
    let jpeg = encode(&picture, options.jpeg_quality)?;
    Ok(Some(Chunk {
        name: format!("wall-{:05}-{:05}", area.row, area.column),
        origin: [0.0, 0.0, -(place.x_m(area.row as f64) as f32)],
        vertices,
        indices,
        jpeg,
    }))
}

/// The box's pixels and [`MARGIN_PX`] around them; around the wall the picture goes on at the other side.
fn read_with_margin(reader: &TileReader, area: &ChunkBox) -> Result<Rgba8, ModelError> {
    let (width, height) = reader.size(area.level);
    let mut out = Rgba8::new(area.width + 2 * MARGIN_PX, area.height + 2 * MARGIN_PX);
    let row = area.row.saturating_sub(MARGIN_PX);
    let rows = (area.row + area.height + MARGIN_PX).min(height) - row;
    let read = |column: usize, width: usize| reader.read(area.level, PixelBox { column, row, width, height: rows });
    let first = area.column as i64 - MARGIN_PX as i64;
    let mut at = 0;
    while at < out.width {
        let column = (first + at as i64).rem_euclid(width as i64) as usize;
        let run = (width - column).min(out.width - at);
        let part = read(column, run)?;
        for line in 0..rows {
            let target = ((row + MARGIN_PX - area.row + line) * out.width + at) * 4;
            out.data[target..target + run * 4].copy_from_slice(&part.data[line * run * 4..][..run * 4]);
        }
        at += run;
    }
    Ok(out)
}

/// Where a box of a level lies on the wall.
struct Placement {
    area: ChunkBox,
    s0_m: f64,
    x0_m: f64,
    /// Metres per pixel of the level.
    scale: f64,
}

impl Placement {
    fn x_m(&self, row: f64) -> f64 {
        self.x0_m + row * self.scale
    }

    /// Texture coordinates of a place on the wall.
    fn uv(&self, s_m: f64, x_m: f64) -> [f32; 2] {
        let column = (s_m - self.s0_m) / self.scale - self.area.column as f64 + MARGIN_PX as f64;
        let row = (x_m - self.x0_m) / self.scale - self.area.row as f64 + MARGIN_PX as f64;
        let (width, height) = (self.area.width + 2 * MARGIN_PX, self.area.height + 2 * MARGIN_PX);
        [(column / width as f64) as f32, (row / height as f64) as f32]
    }
}

/// A run of places around the wall without a corner between them.
type Run = Vec<f64>;

fn mesh(
    place: &Placement,
    picture: &Rgba8,
    surface: &SurfaceWindow,
    grid: &PanoramaGrid,
    options: &ChunkOptions,
) -> (Vec<Vertex>, Vec<u32>) {
    let area = &place.area;
    let s_from_m = place.s0_m + area.column as f64 * place.scale;
    let s_to_m = (place.s0_m + (area.column + area.width) as f64 * place.scale).min(grid.perimeter_m);
    let x_from_m = place.x_m(area.row as f64);
    let x_to_m = place.x_m((area.row + area.height) as f64).min(grid.x_m(grid.height_px as f64));
    let steps = ((x_to_m - x_from_m) / options.facet_m).ceil().max(1.0) as usize;
    let xs: Vec<f64> = (0..=steps).map(|step| x_from_m + (x_to_m - x_from_m) * step as f64 / steps as f64).collect();
    let mut vertices = Vec::new();
    let mut indices = Vec::new();
    for run in runs(surface.profile(), s_from_m, s_to_m, options) {
        let first = vertices.len() as u32;
        for &x_m in &xs {
            for (index, &s_m) in run.iter().enumerate() {
                // Inside the run's piece, so that a corner's two sides keep their own normals.
                let inner = if index == 0 { s_m + SAME_M } else { s_m - SAME_M };
                vertices.push(vertex(surface, inner, [x_m, x_from_m], place.uv(s_m, x_m)));
            }
        }
        let stride = run.len() as u32;
        for (row, x) in xs.windows(2).enumerate() {
            for (column, s) in run.windows(2).enumerate() {
                if is_seen(picture, place.uv(s[0], x[0]), place.uv(s[1], x[1])) {
                    let a = first + row as u32 * stride + column as u32;
                    let [b, c, d] = [a + 1, a + stride, a + stride + 1];
                    indices.extend([a, c, b, b, c, d]);
                }
            }
        }
    }
    without_unused(&vertices, indices)
}

/// Drops vertices that no triangle uses.
fn without_unused(vertices: &[Vertex], mut indices: Vec<u32>) -> (Vec<Vertex>, Vec<u32>) {
    let mut renamed = vec![u32::MAX; vertices.len()];
    let mut kept = Vec::new();
    for index in &mut indices {
        let new = &mut renamed[*index as usize];
        if *new == u32::MAX {
            *new = kept.len() as u32;
            kept.push(vertices[*index as usize]);
        }
        *index = *new;
    }
    (kept, indices)
}

/// The vertex at a station, counted in model space from the station of the chunk's origin.
fn vertex(surface: &SurfaceWindow, s_m: f64, [x_m, origin_x_m]: [f64; 2], uv: [f32; 2]) -> Vertex {
    let WallPlace { position, normal } = surface.point(s_m, x_m);
    Vertex {
        position: [position.y as f32, -position.z as f32, -(x_m - origin_x_m) as f32],
        normal: [normal.y as f32, -normal.z as f32, -normal.x as f32],
        uv,
    }
}

/// Divides `[from, to]` at corners, and each piece so finely that chords stay within the sagitta of the arc.
fn runs(profile: &Profile<f64>, from_m: f64, to_m: f64, options: &ChunkOptions) -> Vec<Run> {
    profile
        .pieces()
        .iter()
        .filter_map(|piece| {
            let start_m = piece.start_s_m().max(from_m);
            let end_m = (piece.start_s_m() + piece.length_m()).min(to_m);
            if end_m - start_m <= 2.0 * SAME_M {
                return None;
            }
            let mut count = ((end_m - start_m) / options.facet_m).ceil().max(1.0) as usize;
            if piece.is_planar() {
                // Facets are kept small only so that unseen ones can be left out.
                count = count.max(1);
            } else {
                while sagitta_m(profile, start_m, (end_m - start_m) / count as f64) > options.sagitta_m {
                    count *= 2;
                }
            }
            Some((0..=count).map(|step| start_m + (end_m - start_m) * step as f64 / count as f64).collect())
        })
        .collect()
}

/// Distance of the wall from the chord over `[start_m, start_m + length_m]`, in the middle.
fn sagitta_m(profile: &Profile<f64>, start_m: f64, length_m: f64) -> f64 {
    let at = |s_m: f64| profile.at(s_m).map(|surface| surface.point);
    let ends = (at(start_m + SAME_M), at(start_m + length_m * 0.5), at(start_m + length_m - SAME_M));
    let (Some(a), Some(middle), Some(b)) = ends else { return 0.0 };
    ((a + b) * 0.5 - middle).norm()
}

/// Tells whether any pixel between two corners (texture coordinates) was seen.
fn is_seen(picture: &Rgba8, a: [f32; 2], b: [f32; 2]) -> bool {
    let range = |from: f32, to: f32, length: usize| {
        let pixel = |share: f32| (share * length as f32).max(0.0) as usize;
        pixel(from).min(length - 1)..(pixel(to) + 1).min(length)
    };
    let columns = range(a[0], b[0], picture.width);
    range(a[1], b[1], picture.height).any(|row| columns.clone().any(|column| picture.at(column, row)[3] >= 128))
}

fn encode(picture: &Rgba8, quality: u8) -> Result<Vec<u8>, ModelError> {
    let rgb: Vec<u8> = picture
        .data
        .par_chunks_exact(4)
        .flat_map_iter(|p| if p[3] >= 128 { [p[0], p[1], p[2]] } else { UNSEEN })
        .collect();
    let mut jpeg = Vec::new();
    let failed = |source| ModelError::Jpeg { width_px: picture.width, height_px: picture.height, source };
    // The options allow at most 8192 px per side.
    let (width, height) = (picture.width as u16, picture.height as u16);
    jpeg_encoder::Encoder::new(&mut jpeg, quality)
        .encode(&rgb, width, height, jpeg_encoder::ColorType::Rgb)
        .map_err(failed)?;
    Ok(jpeg)
}

#[cfg(test)]
mod tests {
    use adit_geometry::profile::ProfileSpec;

    use super::*;

    fn options() -> ChunkOptions {
        ChunkOptions {
            largest_texture_px: 256,
            texture_budget_px: 1_000_000,
            sagitta_m: 0.002,
            facet_m: 0.5,
            jpeg_quality: 80,
        }
    }

    fn underpass() -> ProfileSpec<f64> {
        ProfileSpec::Underpass { width_m: 4.0, wall_m: 2.5, rise_m: 1.0, axis_height_m: 1.4 }
    }

    fn whole_mesh(spec: &ProfileSpec<f64>) -> (Vec<Vertex>, Vec<u32>) {
        let store = SurfaceStore::flat(spec).unwrap();
        let profile = store.profile();
        let grid = PanoramaGrid::new(profile.perimeter_m(), 20.0, -1.0, 2.0);
        let area = ChunkBox { level: 0, column: 0, row: 0, width: grid.width_px, height: grid.height_px };
        let (width, height) = (area.width + 2 * MARGIN_PX, area.height + 2 * MARGIN_PX);
        let picture = Rgba8 { width, height, data: vec![255; width * height * 4] };
        let place = Placement { area, s0_m: 0.0, x0_m: grid.x0_m, scale: grid.texel_m() };
        mesh(&place, &picture, &store.window([-1.0, 2.0]).unwrap(), &grid, &options())
    }

    #[test]
    fn normals_point_inwards_and_front_faces_are_seen_from_inside() {
        let (vertices, indices) = whole_mesh(&underpass());
        for triangle in indices.chunks_exact(3) {
            let [a, b, c] = [0, 1, 2].map(|corner| vertices[triangle[corner] as usize]);
            let vector = |v: Vertex| nalgebra::Vector3::from(v.position);
            let facing = (vector(b) - vector(a)).cross(&(vector(c) - vector(a)));
            let to_axis = -vector(a) - nalgebra::Vector3::new(0.0, 0.0, -vector(a).z);
            assert!(facing.dot(&nalgebra::Vector3::from(a.normal)) > 0.0, "{a:?} {b:?} {c:?}");
            assert!(nalgebra::Vector3::from(a.normal).dot(&to_axis) > 0.0, "{a:?}");
        }
    }

    #[test]
    fn vertices_lie_on_the_wall_with_their_own_texture_coordinates() {
        let profile = underpass().build().unwrap();
        let grid = PanoramaGrid::new(profile.perimeter_m(), 20.0, -1.0, 2.0);
        let width = (grid.width_px + 2 * MARGIN_PX) as f64;
        for vertex in whole_mesh(&underpass()).0 {
            let column = f64::from(vertex.uv[0]) * width - MARGIN_PX as f64;
            let wall = profile.at((grid.s_m(column)).min(grid.perimeter_m - 1e-6)).unwrap().point;
            let offset = [wall.x - f64::from(vertex.position[0]), -wall.y - f64::from(vertex.position[1])];
            assert!(offset.iter().all(|o| o.abs() < 1e-4), "{vertex:?} {wall:?}");
        }
    }

    #[test]
    fn corners_are_kept_sharp() {
        let (vertices, _) = whole_mesh(&underpass());
        let corner = |v: &&Vertex| (v.position[0] - 2.0).abs() < 1e-4 && (v.position[1] + 1.4).abs() < 1e-4;
        let normals: Vec<[f32; 3]> = vertices.iter().filter(corner).map(|v| v.normal).collect();
        assert!(normals.iter().any(|n| n[0] < -0.99) && normals.iter().any(|n| n[1] > 0.99), "{normals:?}");
    }

    #[test]
    fn boxes_cover_the_level_within_the_texture_limit() {
        let reader = TileReader::new(std::path::Path::new("nowhere"), 1500, 900);
        let boxes = plan(&reader, &options());
        assert_eq!(boxes.iter().map(|b| b.width * b.height).sum::<usize>(), 750 * 450);
        assert!(boxes.iter().all(|b| b.width.max(b.height) + 2 * MARGIN_PX <= 256 && b.level == 10));
    }
}
