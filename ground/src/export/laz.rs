//! points.laz: LAS 1.4, point format 2, compressed, with normals as extra bytes; written row by row.
//!
//! Programs for LAS take z for a height, so here it points up: x forward, y left, z up (the tunnel frame turned by half a
//! turn about its x axis), metres in steps of 0.1 mm.

use std::fs::File;
use std::io::{self, BufWriter, Seek, SeekFrom, Write};
use std::path::Path;
use std::sync::{Arc, Mutex, PoisonError};

use las::point::Format;
use las::{Builder, PointDataBuilder, Transform, Vector, Vlr, Writer};

use super::error::{ExportError, at_path};
use super::z_up;
use crate::model::{DensePoint, PointSource};

/// Smallest step of a coordinate: finer than any pixel.
const STEP_M: f64 = 1e-4;
/// Smallest step of a normal's component.
const NORMAL_STEP: f64 = 1e-4;
/// First return of one.
const ONE_RETURN: u8 = 0b00_001_001;

/// Writes the points; returns how many there are.
pub(super) fn write(path: &Path, source: &PointSource<'_>, tick: &dyn Fn()) -> Result<u64, ExportError> {
    let failed = |source| ExportError::Las { path: path.to_owned(), source };
    let header = header(source).map_err(failed)?;
    let mut slab = PointDataBuilder::new().for_header(&header).build();
    let transforms = *header.transforms();
    let record = slab.record_len();
    let fault = Fault::default();
    let file = Sturdy::new(File::create(path).map_err(at_path(path))?, fault.clone());
    let mut writer = Writer::new(file, header).map_err(failed)?;
    let count = source.stream(tick, |points| {
        let bytes = slab.resize_for(points.len());
        for (bytes, point) in bytes.chunks_exact_mut(record).zip(points) {
            encode(point, &transforms, bytes).map_err(failed)?;
        }
        writer.write_points(&slab).map_err(failed)?;
        fault.check().map_err(at_path(path))
    })?;
    writer.close().map_err(failed)?;
    let mut file = writer.into_inner().map_err(failed)?;
    file.flush().map_err(at_path(path))?;
    fault.check().map_err(at_path(path))?;
    Ok(count)
}

fn header(source: &PointSource<'_>) -> las::Result<las::Header> {
    let mut builder = Builder::from((1, 4));
    concat!("adit ", env!("CARGO_PKG_VERSION")).clone_into(&mut builder.generating_software);
    "x forward, y left, z up".clone_into(&mut builder.system_identifier);
    builder.point_format = Format { has_color: true, extra_bytes: 6, is_compressed: true, ..Format::default() };
    let axis = |offset: f64| Transform { scale: STEP_M, offset };
    builder.transforms = Vector { x: axis(source.bounds_m().0[0].floor()), y: axis(0.0), z: axis(0.0) };
    builder.vlrs.push(Vlr {
        user_id: "LASF_Spec".to_owned(),
        record_id: 4,
        description: "normals".to_owned(),
        data: ["NormalX", "NormalY", "NormalZ"].map(extra_bytes).concat(),
    });
    builder.into_header()
}

/// Describes a scaled 16-bit value: LAS 1.4 R15, table 24.
fn extra_bytes(name: &str) -> Vec<u8> {
    /// Signed 16-bit.
    const TYPE: u8 = 4;
    /// The scale counts.
    const OPTIONS: u8 = 1 << 3;
    let mut record = vec![0; 192];
    record[2] = TYPE;
    record[3] = OPTIONS;
    record[4..4 + name.len()].copy_from_slice(name.as_bytes());
    record[112..120].copy_from_slice(&NORMAL_STEP.to_le_bytes());
    record
}

/// Point format 2: LAS 1.4 R15, table 9.
fn encode(point: &DensePoint, transforms: &Vector<Transform>, record: &mut [u8]) -> las::Result<()> {
    let [x, y, z] = z_up(point.position_m);
    let mut out = &mut record[..];
    let mut put = |bytes: &[u8]| {
        let (head, tail) = std::mem::take(&mut out).split_at_mut(bytes.len());
        head.copy_from_slice(bytes);
        out = tail;
    };
    put(&transforms.x.inverse(x)?.to_le_bytes());
    put(&transforms.y.inverse(y)?.to_le_bytes());
    put(&transforms.z.inverse(z)?.to_le_bytes());
    // Intensity; then returns, classification, scan angle, user data, source.
    put(&[0, 0]);
    put(&[ONE_RETURN, 0, 0, 0, 0, 0]);
    for channel in point.colour {
        // 255 becomes 65535.
        put(&(u16::from(channel) * 257).to_le_bytes());
    }
    for component in z_up(point.normal) {
        put(&((f64::from(component) / NORMAL_STEP).round() as i16).to_le_bytes());
    }
    Ok(())
}

/// The first failure of a [`Sturdy`] file.
#[derive(Clone, Default)]
struct Fault(Arc<Mutex<Option<io::Error>>>);

impl Fault {
    fn check(&self) -> io::Result<()> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner).take().map_or(Ok(()), Err)
    }
}

/// A file that keeps its first failure for [`Fault::check`] and from then on only counts: [`Writer`] panics when it is dropped
/// and cannot write its header, on a full disk for one.
struct Sturdy {
    file: BufWriter<File>,
    fault: Fault,
    failed: bool,
    place: u64,
    length: u64,
}

impl Sturdy {
    fn new(file: File, fault: Fault) -> Self {
        Self { file: BufWriter::new(file), fault, failed: false, place: 0, length: 0 }
    }

    fn attempt(&mut self, act: impl FnOnce(&mut BufWriter<File>) -> io::Result<()>) {
        if !self.failed
            && let Err(error) = act(&mut self.file)
        {
            self.failed = true;
            *self.fault.0.lock().unwrap_or_else(PoisonError::into_inner) = Some(error);
        }
    }
}

impl Write for Sturdy {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.attempt(|file| file.write_all(bytes));
        self.place += bytes.len() as u64;
        self.length = self.length.max(self.place);
        Ok(bytes.len())
    }

    fn flush(&mut self) -> io::Result<()> {
        self.attempt(Write::flush);
        Ok(())
    }
}

impl Seek for Sturdy {
    fn seek(&mut self, to: SeekFrom) -> io::Result<u64> {
        let (base, step) = match to {
            SeekFrom::Start(place) => (place, 0),
            SeekFrom::Current(step) => (self.place, step),
            SeekFrom::End(step) => (self.length, step),
        };
        self.place = base.checked_add_signed(step).ok_or(io::ErrorKind::InvalidInput)?;
        let place = self.place;
        self.attempt(|file| file.seek(SeekFrom::Start(place)).map(|_| ()));
        Ok(place)
    }
}
