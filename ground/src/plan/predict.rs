//! What the planned flight's images will show: how often each place of the wall is seen, and how finely.

use std::f64::consts::TAU;

use adit_geometry::SectionVector;
use adit_geometry::coverage::{Scene, WallLine, resolution};
use adit_geometry::profile::{Part, Piece, Profile};
use nalgebra::{Isometry3, Point3, Translation3, Vector3};
use rayon::prelude::*;
use serde::Serialize;

use super::bounds::Setting;
use crate::texture::{Coverage, Lattice, Rgba8, measure, picture};

/// Side of the cells that are counted.
const CELL_M: f64 = 0.02;
/// Longest flight that is counted cell by cell. A longer one repeats its middle.
const LONGEST_M: f64 = 30.0;
/// Pixels above this are called coarse.
const COARSE_MM: f64 = 5.0;
/// Wall lines and places along one turn's advance at which pixels are measured.
const LINES: u32 = 240;
const PLACES: u32 = 12;

/// Predicted number of photos per wall cell.
pub(super) struct Prediction {
    pub(super) coverage: Coverage,
    pub(super) picture: Rgba8,
}

/// Size of a pixel on the wall, in the photo that shows the place best, along its coarser direction.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct PixelSize {
    /// Where it is finest.
    pub min_mm: f64,
    /// Half of the wall is shown at least as finely.
    pub median_mm: f64,
    /// Where it is coarsest.
    pub max_mm: f64,
    /// Share of the wall where it is coarser than 5 mm, and cracks of some millimetres are missed.
    pub coarse_share: f64,
}

/// Pixel sizes over the section.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct PixelSizes {
    /// Of the whole wall.
    pub wall: PixelSize,
    /// Of its named parts, in order of arc length.
    pub parts: Vec<(Part, PixelSize)>,
}

/// The stretch of a flight of `length_m` that is counted cell by cell.
pub(super) fn counted_m(length_m: f64) -> f64 {
    length_m.min(LONGEST_M)
}

/// Counts the photos that see each cell of the first `length_m`: of an endless flight, or of `photos` from x = 0 on.
///
/// `lever_forward_m`: the optical centre ahead of the body origin.
pub(super) fn coverage(profile: &Profile<f64>, scene: &Scene<'_, f64>, flown: Flown, length_m: f64) -> Prediction {
    // The lattice takes a quarter of its cells' side.
    let lattice = Lattice::coarse(profile.perimeter_m(), CELL_M / 4.0, 0.0, length_m);
    let lines: Vec<Option<WallLine<f64>>> =
        (0..lattice.columns).map(|column| scene.wall_line(lattice.s_m(column as i64))).collect();
    let mut counts = vec![0_u16; lattice.columns * lattice.rows];
    counts.par_chunks_exact_mut(lattice.columns).enumerate().for_each(|(row, counts)| {
        let x_m = lattice.x_m(row as i64) - flown.lever_forward_m;
        for (count, line) in counts.iter_mut().zip(&lines) {
            let views = line.as_ref().map_or(0, |line| match flown.photos {
                Some(photos) => line.views_at_within(flown.step_m, x_m, photos),
                None => line.views_at(flown.step_m, x_m),
            });
            *count = u16::try_from(views).unwrap_or(u16::MAX);
        }
    });
    let stretch = [0.0, length_m];
    Prediction { coverage: measure(&counts, &lattice, profile, stretch), picture: picture(&counts, &lattice, stretch) }
}

/// A flight along the axis.
#[derive(Clone, Copy, Debug)]
pub(super) struct Flown {
    pub(super) step_m: f64,
    /// `None`: endless.
    pub(super) photos: Option<u32>,
    pub(super) lever_forward_m: f64,
}

/// Measures pixels on the wall of an endless flight on the axis. `None` if no photo shows the wall.
pub(super) fn pixel_sizes(setting: &Setting<'_>, scene: &Scene<'_, f64>, step_m: f64) -> Option<PixelSizes> {
    let spacing_m = setting.profile.perimeter_m() / f64::from(LINES);
    let samples: Vec<(Part, f64)> = (0..LINES)
        .into_par_iter()
        .filter_map(|index| scene.wall_line((f64::from(index) + 0.5) * spacing_m))
        .flat_map_iter(|line| {
            let part = setting.profile.pieces().get(line.surface.piece).map_or(Part::Lining, Piece::part);
            (0..PLACES).filter_map(move |place| {
                let turn_m = step_m * f64::from(setting.mission.survey.rig.images_per_turn);
                let finest = finest_mm(setting, &line, step_m, turn_m * f64::from(place) / f64::from(PLACES));
                finest.map(|finest| (part, finest))
            })
        })
        .collect();
    let wall = spread(samples.iter().map(|(_, mm)| *mm).collect())?;
    let mut parts: Vec<(Part, PixelSize)> = Vec::new();
    for (part, _) in &samples {
        if !parts.iter().any(|(known, _)| known == part) {
            let of_part = samples.iter().filter(|(other, _)| other == part).map(|(_, mm)| *mm).collect();
            parts.extend(spread(of_part).map(|size| (*part, size)));
        }
    }
    Some(PixelSizes { wall, parts })
}

/// The pixel of the photo that shows the line's point at `x_m` best.
fn finest_mm(setting: &Setting<'_>, line: &WallLine<f64>, step_m: f64, x_m: f64) -> Option<f64> {
    let survey = &setting.mission.survey;
    let rig = &survey.rig;
    let (wall, normal) = (line.surface.point, line.surface.normal);
    let point = Point3::new(x_m, wall.x, wall.y);
    let normal = Vector3::new(0.0, normal.x, normal.y);
    let images = f64::from(rig.images_per_turn);
    let turn_m = step_m * images;
    line.views
        .iter()
        .flat_map(|view| {
            let first_m = step_m * f64::from(view.image) + rig.lever_forward_m;
            let nearest = ((x_m - first_m) / turn_m).floor();
            let shaft_rad = TAU * f64::from(view.image) / images;
            [nearest, nearest + 1.0].map(|turn| (shaft_rad, first_m - rig.lever_forward_m + turn * turn_m))
        })
        .filter_map(|(shaft_rad, body_x_m)| {
            let tunnel_from_body = Isometry3::from(Translation3::new(body_x_m, 0.0, 0.0));
            let tunnel_from_cam = tunnel_from_body * rig.body_from_cam(shaft_rad);
            resolution(&survey.camera.camera, &tunnel_from_cam, &point, &normal)
        })
        .map(|pixel| pixel.coarsest_m_per_px * 1000.0)
        .reduce(f64::min)
}

fn spread(mut samples_mm: Vec<f64>) -> Option<PixelSize> {
    samples_mm.sort_by(f64::total_cmp);
    let median_mm = *samples_mm.get(samples_mm.len() / 2)?;
    let coarse = samples_mm.iter().filter(|mm| **mm > COARSE_MM).count();
    let coarse_share = coarse as f64 / samples_mm.len() as f64;
    Some(PixelSize { min_mm: *samples_mm.first()?, median_mm, max_mm: *samples_mm.last()?, coarse_share })
}

/// On the axis.
pub(super) fn axis() -> SectionVector<f64> {
    SectionVector::zeros()
}
