//! How finely the planned flight's images will show the wall: in figures, and as a map.

use std::f64::consts::TAU;

use adit_geometry::camera::Camera;
use adit_geometry::coverage::{Scene, WallLine, resolution};
use adit_geometry::profile::{Part, Piece};
use nalgebra::{Isometry3, Point3, Translation3, Vector3};
use rayon::prelude::*;
use serde::Serialize;

use super::bounds::Setting;
use super::predict::Flown;
use crate::texture::{Lattice, Rgba8};

/// Pixels above this are called coarse.
const COARSE_MM: f64 = 5.0;
/// Wall lines and places along one turn's advance at which pixels are measured.
const LINES: u32 = 240;
const PLACES: u32 = 12;
/// Side of the map's cells.
const CELL_M: f64 = 0.05;
/// The map's ends are multiples of this.
const ROUND_MM: f64 = 0.5;
/// Colours of the map from the finest to the coarsest: even steps of the viridis scale (van der Walt and Smith 2015), which
/// the colour-blind and a grey print keep in order.
pub(super) const COLOURS: [[u8; 3]; 5] = [[253, 231, 37], [94, 201, 98], [33, 145, 140], [59, 82, 139], [68, 1, 84]];

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

/// The finest pixel at each place of the wall as a picture, columns around from the crown, rows along the axis; transparent
/// where no photo shows it.
#[derive(Clone, Debug, PartialEq)]
pub struct PixelMap {
    /// One pixel per cell.
    pub(super) picture: Rgba8,
    /// What the first and the last of [`COLOURS`] stand for.
    pub(super) ends_mm: [f64; 2],
}

/// Measures pixels on the wall of an endless flight on the axis. `None` if no photo shows the wall.
pub(super) fn sizes(setting: &Setting<'_>, scene: &Scene<'_, f64>, endless: Flown) -> Option<PixelSizes> {
    let spacing_m = setting.profile.perimeter_m() / f64::from(LINES);
    let images = &Images::new(setting, endless);
    let turn_m = endless.step_m * images.per_turn();
    let samples: Vec<(Part, f64)> = (0..LINES)
        .into_par_iter()
        .filter_map(|index| scene.wall_line((f64::from(index) + 0.5) * spacing_m))
        .flat_map_iter(|line| {
            let part = setting.profile.pieces().get(line.surface.piece).map_or(Part::Lining, Piece::part);
            (0..PLACES).filter_map(move |place| {
                let finest = images.finest_mm(&line, turn_m * f64::from(place) / f64::from(PLACES));
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

/// Measures the finest pixel in each cell of the first `length_m` of a flight. `None` if no photo shows any.
pub(super) fn map(setting: &Setting<'_>, scene: &Scene<'_, f64>, flown: Flown, length_m: f64) -> Option<PixelMap> {
    let images = &Images::new(setting, flown);
    // The lattice takes a quarter of its cells' side.
    let lattice = Lattice::coarse(setting.profile.perimeter_m(), CELL_M / 4.0, 0.0, length_m);
    let lines: Vec<Option<WallLine<f64>>> =
        (0..lattice.columns).map(|column| scene.wall_line(lattice.s_m(column as i64))).collect();
    let finest: Vec<Option<f64>> = (0..lattice.rows)
        .into_par_iter()
        .flat_map_iter(|row| {
            let x_m = lattice.x_m(row as i64);
            lines.iter().map(move |line| images.finest_mm(line.as_ref()?, x_m))
        })
        .collect();
    let seen = || finest.iter().flatten().copied();
    let from_mm = (seen().reduce(f64::min)? / ROUND_MM).floor() * ROUND_MM;
    let to_mm = (seen().reduce(f64::max)? / ROUND_MM).ceil().max(from_mm / ROUND_MM + 1.0) * ROUND_MM;
    let paint = |mm: &Option<f64>| match mm {
        Some(mm) => {
            let [r, g, b] = colour((mm - from_mm) / (to_mm - from_mm));
            [r, g, b, u8::MAX]
        }
        None => [0; 4],
    };
    let data = finest.iter().flat_map(paint).collect();
    let picture = Rgba8 { width: lattice.columns, height: lattice.rows, data };
    Some(PixelMap { picture, ends_mm: [from_mm, to_mm] })
}

/// The colour at a share of the way from the first of [`COLOURS`] to the last.
fn colour(share: f64) -> [u8; 3] {
    let place = share.clamp(0.0, 1.0) * (COLOURS.len() - 1) as f64;
    let index = (place as usize).min(COLOURS.len() - 2);
    let rest = place - index as f64;
    let (from, to) = (COLOURS[index], COLOURS[index + 1]);
    std::array::from_fn(|channel| {
        let [from, to] = [from[channel], to[channel]].map(f64::from);
        (from + (to - from) * rest).round() as u8
    })
}

/// The images of a flight on the axis.
struct Images<'a> {
    camera: &'a Camera<f64>,
    flown: Flown,
    /// One for each image of a turn.
    body_from_cam: Vec<Isometry3<f64>>,
}

impl<'a> Images<'a> {
    fn new(setting: &'a Setting<'_>, flown: Flown) -> Self {
        let survey = &setting.mission.survey;
        let images = survey.rig.images_per_turn;
        let shaft_rad = |image: u16| TAU * f64::from(image) / f64::from(images);
        let body_from_cam = (0..images).map(|image| survey.rig.body_from_cam(shaft_rad(image))).collect();
        Self { camera: &survey.camera.camera, flown, body_from_cam }
    }

    fn per_turn(&self) -> f64 {
        self.body_from_cam.len() as f64
    }

    /// The pixel of the photo that shows the line's point at `x_m` best.
    fn finest_mm(&self, line: &WallLine<f64>, x_m: f64) -> Option<f64> {
        let (wall, normal) = (line.surface.point, line.surface.normal);
        let point = Point3::new(x_m, wall.x, wall.y);
        let normal = Vector3::new(0.0, normal.x, normal.y);
        let shown = line.views.iter().flat_map(|view| {
            let body_from_cam = self.body_from_cam.get(usize::from(view.image));
            let at = self.nearest_m(view.image, x_m).into_iter().flatten();
            at.filter_map(move |body_x_m| {
                let tunnel_from_cam = Translation3::new(body_x_m, 0.0, 0.0) * body_from_cam?;
                resolution(self.camera, &tunnel_from_cam, &point, &normal)
            })
        });
        shown.map(|pixel| pixel.coarsest_m_per_px * 1000.0).reduce(f64::min)
    }

    /// The places of the body before and after `x_m` where this image of the turn is taken.
    fn nearest_m(&self, image: u16, x_m: f64) -> [Option<f64>; 2] {
        let Flown { step_m, photos, lever_forward_m } = self.flown;
        let (first_m, turn_m) = (step_m * f64::from(image), step_m * self.per_turn());
        let nearest = ((x_m - lever_forward_m - first_m) / turn_m).floor();
        // Turns in which a flight of so many photos takes this image.
        let last = photos.map(|photos| ((f64::from(photos) - 1.0 - f64::from(image)) / self.per_turn()).floor());
        [nearest, nearest + 1.0].map(|turn| {
            let turn = last.map_or(turn, |last| turn.max(0.0).min(last));
            (last.is_none() || turn >= 0.0).then_some(first_m + turn * turn_m)
        })
    }
}

fn spread(mut samples_mm: Vec<f64>) -> Option<PixelSize> {
    samples_mm.sort_by(f64::total_cmp);
    let median_mm = *samples_mm.get(samples_mm.len() / 2)?;
    let coarse = samples_mm.iter().filter(|mm| **mm > COARSE_MM).count();
    let coarse_share = coarse as f64 / samples_mm.len() as f64;
    Some(PixelSize { min_mm: *samples_mm.first()?, median_mm, max_mm: *samples_mm.last()?, coarse_share })
}
