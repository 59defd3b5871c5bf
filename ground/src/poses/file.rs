//! poses.csv: the poses as other programs read them; truth/poses.csv is the same without sigmas and status.

use std::collections::HashSet;
use std::fs::File;
use std::io::{self, Write};
use std::path::{Path, PathBuf};

use nalgebra::{Isometry3, Quaternion, Translation3, UnitQuaternion};

use super::{PhotoPose, PoseStatus};
use crate::adjust::PhotoQuality;

/// Columns that every file of poses has.
const POSE_COLUMNS: [&str; 8] = ["photo", "qw", "qx", "qy", "qz", "x_m", "y_m", "z_m"];
/// Columns that a reconstruction adds.
const MORE_COLUMNS: [&str; 9] = [
    "sigma_x_m",
    "sigma_y_m",
    "sigma_z_m",
    "sigma_rx_deg",
    "sigma_ry_deg",
    "sigma_rz_deg",
    "status",
    "matches",
    "rms_px",
];
/// A quaternion whose length is further from 1 was not written as a rotation.
const UNIT_TOLERANCE: f64 = 1e-3;

/// Why a file of poses cannot be read.
#[derive(Debug, thiserror::Error)]
pub enum PosesError {
    /// The file cannot be read.
    #[error("{}: cannot be read", path.display())]
    Io {
        /// The file.
        path: PathBuf,
        /// What the system said.
        source: io::Error,
    },
    /// Not a table.
    #[error("{}: not a CSV table", path.display())]
    Csv {
        /// The file.
        path: PathBuf,
        /// What is wrong.
        source: csv::Error,
    },
    /// A column is missing.
    #[error("{}: no column `{column}`; expected photo,qw,qx,qy,qz,x_m,y_m,z_m and, in results, sigmas and status", path.display())]
    NoColumn {
        /// The file.
        path: PathBuf,
        /// The column.
        column: &'static str,
    },
    /// A cell is wrong.
    #[error("{}:{line}: column `{column}`: found `{found}`, expected {expected}", path.display())]
    Cell {
        /// The file.
        path: PathBuf,
        /// Line from 1.
        line: u64,
        /// Heading.
        column: &'static str,
        /// What stands there.
        found: String,
        /// What should.
        expected: &'static str,
    },
}

/// Writes poses: quaternion `tunnel_from_cam` (w first, w not negative), optical centre in the tunnel frame in metres,
/// standard deviations (metres; degrees about the camera's axes), status, number of matched points and their error.
///
/// # Errors
/// What the writer says.
pub fn write_poses<'a>(out: &mut impl Write, poses: impl IntoIterator<Item = &'a PhotoPose>) -> io::Result<()> {
    let mut writer = csv::WriterBuilder::new().terminator(csv::Terminator::Any(b'\n')).from_writer(out);
    writer.write_record(POSE_COLUMNS.iter().chain(&MORE_COLUMNS)).map_err(io::Error::other)?;
    for pose in poses {
        let q = pose.tunnel_from_cam.rotation.quaternion();
        let q = if q.w < 0.0 { -*q } else { *q };
        let centre = pose.tunnel_from_cam.translation.vector;
        let mut cells = vec![pose.photo.clone()];
        cells.extend([q.w, q.i, q.j, q.k, centre.x, centre.y, centre.z].map(|value| format!("{value:.9}")));
        cells.extend(pose.position_sigma_m.map(|sigma| format!("{sigma:.6}")));
        cells.extend(pose.rotation_sigma_rad.map(|sigma| format!("{:.6}", sigma.to_degrees())));
        cells.push(match pose.status {
            PoseStatus::Adjusted => "adjusted".to_owned(),
            PoseStatus::PriorOnly => "prior-only".to_owned(),
        });
        cells.push(pose.quality.observations.to_string());
        cells.push(format!("{:.4}", pose.quality.rms_px));
        writer.write_record(&cells).map_err(io::Error::other)?;
    }
    writer.flush()
}

/// Reads poses. Without sigma columns the sigmas are zero, without a status column every pose counts as adjusted
/// (so truth/poses.csv can be read too).
///
/// # Errors
/// [`PosesError`] naming file, line and column.
pub fn read_poses(path: &Path) -> Result<Vec<PhotoPose>, PosesError> {
    let file = File::open(path).map_err(|source| PosesError::Io { path: path.to_owned(), source })?;
    let csv_error = |source| PosesError::Csv { path: path.to_owned(), source };
    let mut reader = csv::ReaderBuilder::new().trim(csv::Trim::All).from_reader(io::BufReader::new(file));
    let headings = reader.headers().map_err(csv_error)?.clone();
    let column = |name: &str| headings.iter().position(|heading| heading.trim_start_matches('\u{feff}') == name);
    if let Some(missing) = POSE_COLUMNS.into_iter().find(|name| column(name).is_none()) {
        return Err(PosesError::NoColumn { path: path.to_owned(), column: missing });
    }
    let mut seen = HashSet::new();
    let mut poses = Vec::new();
    for record in reader.records() {
        let record = record.map_err(csv_error)?;
        let row = Row { path, record: &record, column: &column };
        let pose = row.parse()?;
        if !seen.insert(pose.photo.clone()) {
            return Err(row.wrong("photo", "a photo that no other line has"));
        }
        poses.push(pose);
    }
    Ok(poses)
}

struct Row<'a, F: Fn(&str) -> Option<usize>> {
    path: &'a Path,
    record: &'a csv::StringRecord,
    column: &'a F,
}

impl<F: Fn(&str) -> Option<usize>> Row<'_, F> {
    fn parse(&self) -> Result<PhotoPose, PosesError> {
        let photo = self.cell("photo").unwrap_or_default().to_owned();
        if photo.is_empty() {
            return Err(self.wrong("photo", "a photo's name"));
        }
        let [w, i, j, k] = ["qw", "qx", "qy", "qz"].map(|name| self.number(name));
        let quaternion = Quaternion::new(w?, i?, j?, k?);
        if (quaternion.norm() - 1.0).abs() > UNIT_TOLERANCE {
            return Err(self.wrong("qw", "a quaternion of length 1"));
        }
        let [x, y, z] = ["x_m", "y_m", "z_m"].map(|name| self.number(name));
        let centre = Translation3::new(x?, y?, z?);
        let [sx, sy, sz, rx, ry, rz, _, matches, rms_px] = MORE_COLUMNS.map(|name| self.optional(name));
        let status = match self.cell("status") {
            None | Some("adjusted") => PoseStatus::Adjusted,
            Some("prior-only") => PoseStatus::PriorOnly,
            Some(_) => return Err(self.wrong("status", "adjusted or prior-only")),
        };
        Ok(PhotoPose {
            photo,
            tunnel_from_cam: Isometry3::from_parts(centre, UnitQuaternion::from_quaternion(quaternion)),
            position_sigma_m: [sx?, sy?, sz?],
            rotation_sigma_rad: [rx?.to_radians(), ry?.to_radians(), rz?.to_radians()],
            status,
            quality: PhotoQuality { observations: matches? as usize, rms_px: rms_px?, ..PhotoQuality::default() },
        })
    }

    fn cell(&self, name: &str) -> Option<&str> {
        (self.column)(name).and_then(|index| self.record.get(index))
    }

    fn number(&self, name: &'static str) -> Result<f64, PosesError> {
        let value = self.cell(name).and_then(|cell| cell.parse::<f64>().ok()).filter(|value| value.is_finite());
        value.ok_or_else(|| self.wrong(name, "a number"))
    }

    /// Zero where the column is missing or empty.
    fn optional(&self, name: &'static str) -> Result<f64, PosesError> {
        if name == "status" || self.cell(name).is_none_or(str::is_empty) { Ok(0.0) } else { self.number(name) }
    }

    fn wrong(&self, column: &'static str, expected: &'static str) -> PosesError {
        PosesError::Cell {
            path: self.path.to_owned(),
            line: self.record.position().map_or(0, csv::Position::line),
            column,
            found: self.cell(column).unwrap_or_default().to_owned(),
            expected,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn pose(photo: &str, angle_rad: f64, status: PoseStatus) -> PhotoPose {
        PhotoPose {
            photo: photo.to_owned(),
            tunnel_from_cam: Isometry3::from_parts(
                Translation3::new(1.5, -0.25, 0.125),
                UnitQuaternion::from_euler_angles(angle_rad, 0.2, -0.3),
            ),
            position_sigma_m: [0.001, 0.002, 0.003],
            rotation_sigma_rad: [0.01, 0.02, 0.03],
            status,
            quality: PhotoQuality { observations: 214, rms_px: 0.0625, doubted_share: 0.0 },
        }
    }

    fn read(text: &[u8]) -> Result<Vec<PhotoPose>, PosesError> {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("poses.csv");
        std::fs::write(&path, text).unwrap();
        read_poses(&path)
    }

    #[test]
    fn poses_come_back_as_they_were_written() {
        let poses = [pose("A.JPG", 0.1, PoseStatus::Adjusted), pose("B.JPG", 3.0, PoseStatus::PriorOnly)];
        let mut text = Vec::new();
        write_poses(&mut text, &poses).unwrap();
        let back = read(&text).unwrap();
        for (was, is) in poses.iter().zip(&back) {
            assert_eq!((&was.photo, was.status), (&is.photo, is.status));
            assert!(was.tunnel_from_cam.rotation.angle_to(&is.tunnel_from_cam.rotation) < 1e-7);
            assert!((was.tunnel_from_cam.translation.vector - is.tunnel_from_cam.translation.vector).norm() < 1e-8);
            assert!((was.rotation_sigma_rad[2] - is.rotation_sigma_rad[2]).abs() < 1e-7);
        }
    }

    #[test]
    fn a_file_without_sigmas_reads_as_truth() {
        let poses = read(b"photo,qw,qx,qy,qz,x_m,y_m,z_m\nA.JPG,1,0,0,0,1,2,3\n").unwrap();
        assert_eq!((poses[0].status, poses[0].position_sigma_m), (PoseStatus::Adjusted, [0.0; 3]));
    }

    #[test]
    fn a_wrong_cell_is_named_by_line_and_column() {
        let message =
            read(b"photo,qw,qx,qy,qz,x_m,y_m,z_m\nA,1,0,0,0,1,2,3\nB,1,0,0,0,1,oops,3\n").unwrap_err().to_string();
        assert!(message.contains("poses.csv:3: column `y_m`: found `oops`"), "{message}");
        let message = read(b"photo,qw,qx,qy,qz,x_m,y_m,z_m\nA,1,1,0,0,1,2,3\n").unwrap_err().to_string();
        assert!(message.contains("length 1"), "{message}");
        let message = read(b"photo,qw,qx,qy,x_m,y_m,z_m\n").unwrap_err().to_string();
        assert!(message.contains("`qz`"), "{message}");
    }
}
