//! points.e57: ASTM E2807 with colours, and with normals by the extension `nor` of libe57.org; written row by row.
//!
//! As in points.laz z points up: x forward, y left, z up, metres.

use std::path::Path;

use e57::{E57Writer, Extension, Record, RecordDataType, RecordName, RecordValue};
use sha2::{Digest, Sha256};

use super::error::ExportError;
use super::z_up;
use crate::model::PointSource;

/// Namespace and address of the extension for normals.
const NORMALS: (&str, &str) = ("nor", "http://www.libe57.org/E57_NOR_surface_normals.txt");

/// Writes the points; returns how many there are.
pub(super) fn write(path: &Path, source: &PointSource<'_>, tick: &dyn Fn()) -> Result<u64, ExportError> {
    let failed = |source| ExportError::E57 { path: path.to_owned(), source };
    let mut writer = E57Writer::from_file(path, &guid("file", source)).map_err(failed)?;
    writer.register_extension(Extension::new(NORMALS.0, NORMALS.1)).map_err(failed)?;
    let mut cloud = writer.add_pointcloud(&guid("wall", source), prototype()).map_err(failed)?;
    cloud.set_name(Some("wall".to_owned()));
    cloud.set_description(Some("x forward along the tunnel, y left, z up; metres; normals inwards".to_owned()));
    let count = source.stream(tick, |points| {
        for point in points {
            let position = z_up(point.position_m).map(|metres| RecordValue::Single(metres as f32));
            let colour = point.colour.map(|channel| RecordValue::Integer(channel.into()));
            let normal = z_up(point.normal).map(RecordValue::Single);
            cloud.add_point(position.into_iter().chain(colour).chain(normal).collect()).map_err(failed)?;
        }
        Ok::<_, ExportError>(())
    })?;
    cloud.finalize().map_err(failed)?;
    writer.finalize().map_err(failed)?;
    Ok(count)
}

fn prototype() -> Vec<Record> {
    let single = || RecordDataType::Single { min: None, max: None };
    let byte = || RecordDataType::Integer { min: 0, max: 255 };
    let normal = |name: &str| RecordName::Unknown { namespace: NORMALS.0.to_owned(), name: name.to_owned() };
    let names = [
        (RecordName::CartesianX, single()),
        (RecordName::CartesianY, single()),
        (RecordName::CartesianZ, single()),
        (RecordName::ColorRed, byte()),
        (RecordName::ColorGreen, byte()),
        (RecordName::ColorBlue, byte()),
        (normal("normalX"), single()),
        (normal("normalY"), single()),
        (normal("normalZ"), single()),
    ];
    names.map(|(name, data_type)| Record { name, data_type }).into()
}

/// An identifier that the same wall gets again: the same export gives the same bytes.
fn guid(part: &str, source: &PointSource<'_>) -> String {
    let mut digest = Sha256::new();
    digest.update(format!("adit {part} {:?} {}", source.bounds_m(), source.step_m()));
    let number = digest.finalize().first_chunk().map_or(0, |bytes| u128::from_be_bytes(*bytes));
    let hex = format!("{number:032X}");
    format!("{{{}-{}-{}-{}-{}}}", &hex[..8], &hex[8..12], &hex[12..16], &hex[16..20], &hex[20..])
}
