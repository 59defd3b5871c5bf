//! `adit calibrate`.

use std::path::PathBuf;

use adit_ground::calibrate::{Board, BoardError, Model, calibrate, write};
use adit_ground::pipeline::{StageProgress, Verbosity};
use anyhow::{Context, Result, bail};
use clap::Args;

use super::{Answer, Common, positive, print};

/// Calibrate a camera from photos of a chessboard, with markers or without: focal lengths, principal point, distortion.
///
/// Finds the board's inner corners in every JPEG below PHOTOS, fits the camera model asked for (and the other one, for
/// comparison), and prints the camera table for survey.toml and mission.toml, with the standard deviation of every number:
/// "formal" from the corners' scatter, "jackknife" from fits without one photo each, which is the honest one. Photos that
/// were not used are named with the reason; hints say what to photograph in addition.
///
/// The answer is no (exit code 1) if there are too few boards for a camera, or a limit given is exceeded.
#[derive(Debug, Args)]
#[command(after_help = "Examples:\n  adit calibrate DCIM/100GOPRO --board 8x6\n  \
    adit calibrate photos --board charuco:8x6:DICT_4X4_50\n  \
    adit calibrate photos --board 9x6 --square-mm 30 --model kannala-brandt --out calibration --json")]
pub(super) struct Arguments {
    /// The folder of photos, all from one camera in one mode
    #[arg(value_name = "PHOTOS")]
    photos: PathBuf,
    /// Inner corners in a row and in a column (one fewer than squares), as 8x6; with markers in the white squares as
    /// charuco:8x6:4x4 (or 5x5, 6x6, `DICT_4X4_50`): of such a board any part may be in view
    #[arg(long, value_name = "BOARD", value_parser = board)]
    board: Board,
    /// Edge of a square; distances depend on it, the camera does not
    #[arg(long, value_name = "MM", value_parser = positive, default_value_t = 25.0)]
    square_mm: f64,
    /// The lens's model
    #[arg(long, value_enum, default_value_t = Model::BrownConrady)]
    model: Model,
    /// Where camera.toml, calibration.json, calibration.html (every photo with its corners) and undistorted.jpg go
    /// [default: nothing is written]
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    /// Largest allowed root mean square error
    #[arg(long, value_name = "PX", value_parser = positive)]
    max_rms_px: Option<f64>,
}

/// A board whose squares are of no size yet.
fn board(text: &str) -> Result<Board, BoardError> {
    Board::parse(text, 1.0)
}

pub(super) fn run(arguments: &Arguments, common: &Common) -> Result<Answer> {
    let board = Board { square_m: arguments.square_mm / 1000.0, ..arguments.board };
    if let Some(out) = &arguments.out
        && out.starts_with(&arguments.photos)
    {
        bail!(
            "{}: lies in the folder of photos, and its pictures would be taken for photos; give --out another",
            out.display()
        );
    }
    let progress = StageProgress::start(Verbosity::Talk, "corners", 0);
    let calibration = calibrate(&arguments.photos, board, arguments.model, &|done, total| {
        progress.restart(total);
        progress.set(done);
    })?;
    let used = calibration.photos.iter().filter(|photo| photo.unused.is_none()).count();
    progress.finish(&format!("{used} of {} photos used", calibration.photos.len()));
    if let Some(out) = &arguments.out {
        write(&calibration, out).with_context(|| format!("{}: cannot be written", out.display()))?;
        eprintln!("pictures and camera.toml are in {}", out.display());
    }
    let figures = calibration.figures();
    print(&figures, common)?;
    let Some(camera) = &figures.camera else {
        match calibration.other_fit {
            Some(_) => eprintln!("adit: no camera of this model: see the hint"),
            None => eprintln!("adit: no camera: {used} photos with the board, tilted by turns, are too few"),
        }
        return Ok(Answer::No);
    };
    if let Some(limit_px) = arguments.max_rms_px.filter(|limit_px| camera.rms_px > *limit_px) {
        eprintln!("adit: the root mean square error is {:.3} px, asked for at most {limit_px}", camera.rms_px);
        return Ok(Answer::No);
    }
    Ok(Answer::Yes)
}
