//! Figures and plots of the poses.

use std::fmt::Write as _;

use adit_geometry::profile::Profile;
use serde::Serialize;

use crate::poses::{PhotoPose, PoseStatus};

/// Poses in a few numbers.
#[derive(Clone, Debug, Serialize)]
pub struct PoseFigures {
    /// Photos whose pose the matches hold.
    pub registered: usize,
    /// Names of those held by their tag alone.
    pub prior_only: Vec<String>,
    /// First and last place along the axis.
    pub x_from_m: f64,
    /// See `x_from_m`.
    pub x_to_m: f64,
    /// Median over photos of the worst axis' standard deviation.
    pub median_position_sigma_mm: f64,
    /// Largest of all.
    pub worst_position_sigma_mm: f64,
    /// Median over photos of the worst axis' standard deviation of the rotation.
    pub median_rotation_sigma_deg: f64,
    /// Largest distance of an optical centre from the axis.
    pub largest_offset_m: f64,
}

/// How well one photo's pose is known.
#[derive(Clone, Copy, Debug, Serialize)]
pub(super) struct PhotoFigures<'a> {
    photo: &'a str,
    status: PoseStatus,
    /// Points that it shares with others.
    matches: usize,
    rms_px: f64,
    /// Share of its matches that the adjustment does not believe.
    doubted_share: f64,
    /// Along x, y, z of the tunnel.
    position_sigma_mm: [f64; 3],
    /// About the camera's axes.
    rotation_sigma_deg: [f64; 3],
}

impl<'a> PhotoFigures<'a> {
    pub(super) fn new(pose: &'a PhotoPose) -> Self {
        Self {
            photo: &pose.photo,
            status: pose.status,
            matches: pose.quality.observations,
            rms_px: pose.quality.rms_px,
            doubted_share: pose.quality.doubted_share,
            position_sigma_mm: pose.position_sigma_m.map(|sigma_m| sigma_m * 1e3),
            rotation_sigma_deg: pose.rotation_sigma_rad.map(f64::to_degrees),
        }
    }
}

impl PoseFigures {
    pub(super) fn new(poses: &[PhotoPose]) -> Self {
        let xs = poses.iter().map(|pose| pose.tunnel_from_cam.translation.x);
        let sigmas_mm: Vec<f64> = poses.iter().map(|pose| worst(&pose.position_sigma_m) * 1e3).collect();
        let rotations_deg: Vec<f64> = poses.iter().map(|pose| worst(&pose.rotation_sigma_rad).to_degrees()).collect();
        let prior_only = poses.iter().filter(|pose| pose.status == PoseStatus::PriorOnly);
        let prior_only: Vec<String> = prior_only.map(|pose| pose.photo.clone()).collect();
        Self {
            registered: poses.len() - prior_only.len(),
            prior_only,
            x_from_m: xs.clone().fold(f64::INFINITY, f64::min),
            x_to_m: xs.fold(f64::NEG_INFINITY, f64::max),
            median_position_sigma_mm: crate::adjust::median(&sigmas_mm),
            worst_position_sigma_mm: worst(&sigmas_mm),
            median_rotation_sigma_deg: crate::adjust::median(&rotations_deg),
            largest_offset_m: poses
                .iter()
                .map(|pose| pose.tunnel_from_cam.translation.vector.yz().norm())
                .fold(0.0, f64::max),
        }
    }
}

fn worst(values: &[f64]) -> f64 {
    values.iter().copied().fold(0.0, f64::max)
}

/// A line of a plot.
pub(super) struct Series<'a> {
    pub(super) class: &'a str,
    pub(super) label: &'a str,
    pub(super) values: Vec<f64>,
}

/// Offset right and down of the optical centre along the tunnel.
pub(super) fn track_svg(poses: &[PhotoPose]) -> String {
    let centres = |axis: usize| poses.iter().map(|pose| pose.tunnel_from_cam.translation.vector[axis] * 1e3).collect();
    let xs: Vec<f64> = poses.iter().map(|pose| pose.tunnel_from_cam.translation.x).collect();
    let series = [
        Series { class: "a", label: "right (y)", values: centres(1) },
        Series { class: "b", label: "down (z)", values: centres(2) },
    ];
    line_plot(&xs, &series, "mm")
}

/// Standard deviation of the optical centre along the tunnel.
pub(super) fn sigma_svg(poses: &[PhotoPose]) -> String {
    let xs: Vec<f64> = poses.iter().map(|pose| pose.tunnel_from_cam.translation.x).collect();
    let labels = [("a", "x"), ("b", "y"), ("c", "z")];
    let series: Vec<Series<'_>> = labels
        .into_iter()
        .enumerate()
        .map(|(axis, (class, label))| Series {
            class,
            label,
            values: poses.iter().map(|pose| pose.position_sigma_m[axis] * 1e3).collect(),
        })
        .collect();
    line_plot(&xs, &series, "mm")
}

pub(super) fn line_plot(xs: &[f64], series: &[Series<'_>], unit: &str) -> String {
    const WIDTH: f64 = 860.0;
    const HEIGHT: f64 = 200.0;
    const LEFT: f64 = 56.0;
    const BOTTOM: f64 = 24.0;
    let bounds = |values: &mut dyn Iterator<Item = f64>| {
        let (low, high) =
            values.fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), value| (low.min(value), high.max(value)));
        if low.is_finite() && high > low { (low, high) } else { (low.min(0.0), low.max(0.0) + 1.0) }
    };
    let (x_low, x_high) = bounds(&mut xs.iter().copied());
    let (low, high) = bounds(&mut series.iter().flat_map(|one| one.values.iter().copied()).chain([0.0]));
    let to_x = |x: f64| LEFT + (x - x_low) / (x_high - x_low) * (WIDTH - LEFT - 8.0);
    let to_y = |y: f64| 8.0 + (high - y) / (high - low) * (HEIGHT - BOTTOM - 8.0);
    let mut svg = format!("<svg viewBox=\"0 0 {WIDTH} {HEIGHT}\" role=\"img\">");
    for step in 0..=4 {
        let share = f64::from(step) / 4.0;
        let (y, x) = (low + share * (high - low), x_low + share * (x_high - x_low));
        // Writing to a string cannot fail.
        let _ = write!(
            svg,
            "<line class=\"grid\" x1=\"{LEFT}\" x2=\"{}\" y1=\"{:.1}\" y2=\"{1:.1}\"/>\
             <text x=\"{}\" y=\"{:.1}\" text-anchor=\"end\">{y:.1}</text>\
             <text x=\"{:.1}\" y=\"{}\" text-anchor=\"middle\">{x:.1} m</text>",
            WIDTH - 8.0,
            to_y(y),
            LEFT - 6.0,
            to_y(y) + 4.0,
            to_x(x).clamp(LEFT, WIDTH - 24.0),
            HEIGHT - 6.0
        );
    }
    for (index, one) in series.iter().enumerate() {
        let points: Vec<String> =
            xs.iter().zip(&one.values).map(|(&x, &y)| format!("{:.1},{:.1}", to_x(x), to_y(y))).collect();
        let _ = write!(
            svg,
            "<polyline class=\"{}\" points=\"{}\"/><text class=\"{0}\" x=\"{}\" y=\"20\">{} / {unit}</text>",
            one.class,
            points.join(" "),
            LEFT + 12.0 + 110.0 * index as f64,
            one.label
        );
    }
    svg + "</svg>"
}

/// The section, looking forward, with every optical centre.
pub(super) fn section_svg(profile: &Profile<f64>, poses: &[PhotoPose]) -> String {
    let (low, high) = profile.bounds();
    let margin = 0.04 * (high - low).norm();
    let samples = 180;
    let outline: Vec<String> = (0..samples)
        .filter_map(|sample| profile.at(profile.perimeter_m() * f64::from(sample) / f64::from(samples)))
        .map(|surface| format!("{:.3},{:.3}", surface.point.x, surface.point.y))
        .collect();
    let mut svg = format!(
        "<svg class=\"section\" viewBox=\"{:.3} {:.3} {:.3} {:.3}\" role=\"img\"><polygon points=\"{}\"/>",
        low.x - margin,
        low.y - margin,
        high.x - low.x + 2.0 * margin,
        high.y - low.y + 2.0 * margin,
        outline.join(" ")
    );
    let radius = 0.006 * (high - low).norm();
    for pose in poses {
        let centre = pose.tunnel_from_cam.translation.vector;
        let _ = write!(svg, "<circle cx=\"{:.4}\" cy=\"{:.4}\" r=\"{radius:.4}\"/>", centre.y, centre.z);
    }
    svg + "</svg>"
}
