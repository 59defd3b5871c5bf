//! `adit export`.

use std::fmt;
use std::path::PathBuf;

use adit_ground::export::{ExportOptions, Exported, Format, TiffCompression, export};
use adit_ground::pipeline::Verbosity;
use anyhow::Result;
use clap::Args;
use serde::Serialize;

use super::{Answer, Common, positive, print};

/// Write a reconstruction's results in the formats of other programs.
///
/// Takes what `adit reconstruct` left in OUT: poses from stage adjust on, everything else from stage texture on. Files take
/// their names when they are whole; what is there is replaced only with --force.
///
/// Axes, all in metres. colmap, ply, poses: the tunnel frame (x forward, y right, z down). laz, e57: x forward, y left, z up.
/// obj, glb: x right, y up, -z forward. tiff: X is the arc length from the crown, clockwise looking forward, Y is minus the
/// distance along the axis, so that the picture is not mirrored.
#[derive(Debug, Args)]
#[command(after_help = "Examples:\n  adit export survey/out --format glb,laz\n  \
    adit export survey/out --format tiff --compression jpeg --out delivery\n  \
    adit export survey/out --format glb --mm-per-px 1 --texture-px 8192 --force\n  \
    adit export survey/out --all --json")]
pub(super) struct Arguments {
    /// The reconstruction's folder
    #[arg(value_name = "OUT")]
    reconstruction: PathBuf,
    /// What to write, separated by commas
    #[arg(long, value_enum, value_name = "FORMAT", value_delimiter = ',', required_unless_present = "all")]
    format: Vec<Format>,
    /// Write all formats (relief where there is one)
    #[arg(long, conflicts_with = "format")]
    all: bool,
    /// Where files go [default: OUT/export]
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    /// Largest size of a pixel of tiff, obj and glb on the wall, in millimetres: the panorama's own, or twice, four times ...
    /// that [default: the panorama's own; obj and glb at most 100 million pixels in all]
    #[arg(long, value_name = "X", value_parser = positive)]
    mm_per_px: Option<f64>,
    /// Longest side of a chunk's texture in obj and glb, in pixels
    #[arg(long, value_name = "N", default_value_t = 4096, value_parser = clap::value_parser!(u16).range(64..=8192))]
    texture_px: u16,
    /// Distance between the points of ply, laz and e57, in millimetres, about
    #[arg(long, value_name = "X", default_value_t = 8.0, value_parser = positive)]
    point_step_mm: f64,
    /// How the pixels of tiff are stored
    #[arg(long, value_enum, value_name = "KIND", default_value_t = TiffCompression::Deflate)]
    compression: TiffCompression,
    /// Quality of JPEG textures and tiles
    #[arg(long, value_name = "N", default_value_t = 88, value_parser = clap::value_parser!(u8).range(1..=100))]
    jpeg_quality: u8,
    /// Replace what is there
    #[arg(long)]
    force: bool,
}

/// What is printed.
#[derive(Serialize)]
struct Figures {
    out: PathBuf,
    files: Vec<Exported>,
}

impl fmt::Display for Figures {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        for file in &self.files {
            let name = file.path.file_name().unwrap_or_default().to_string_lossy();
            writeln!(f, "{name:<14} {:>10.3} MB  {}", file.bytes as f64 / 1e6, file.content)?;
        }
        writeln!(f, "results        {}", self.out.display())
    }
}

pub(super) fn run(arguments: &Arguments, common: &Common) -> Result<Answer> {
    let reconstruction = &arguments.reconstruction;
    let out = arguments.out.clone().unwrap_or_else(|| reconstruction.join("export"));
    let mut formats = if arguments.all { Format::ALL.to_vec() } else { arguments.format.clone() };
    formats
        .retain(|format| !(arguments.all && *format == Format::Relief && !reconstruction.join("relief.tif").exists()));
    let files = export(&ExportOptions {
        mm_per_px: arguments.mm_per_px,
        texture_px: arguments.texture_px.into(),
        point_step_m: arguments.point_step_mm / 1000.0,
        compression: arguments.compression,
        jpeg_quality: arguments.jpeg_quality,
        replace: arguments.force,
        verbosity: Verbosity::Talk,
        ..ExportOptions::new(reconstruction, &out, &formats)
    })?;
    print(&Figures { out, files }, common)?;
    Ok(Answer::Yes)
}
