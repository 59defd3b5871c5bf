//! tags.csv: one row per capture, in degrees and metres in the file, in radians and metres here.

use std::fs;
use std::io::{self, Write};
use std::path::Path;

use adit_protocol::tag::{CaptureState, CaptureTag, Ranges, TagFlags};
use adit_protocol::tag_table;

use super::{TagFault, TagsError};

/// The columns of tags.csv, in order.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[expect(missing_docs, reason = "each is the column of its name, described in the format's page")]
pub enum TagColumn {
    Capture,
    Photo,
    State,
    TimeS,
    ShaftDeg,
    RangeUpM,
    RangeRightM,
    RangeDownM,
    RangeLeftM,
    RangeHeadM,
    OdometerM,
    RollDeg,
    PitchDeg,
    YawDeg,
    OffsetYM,
    OffsetZM,
    SpeedMps,
    SpeedLimitMps,
    Flags,
}

impl TagColumn {
    /// The headings, in order.
    pub const NAMES: [&'static str; 19] = tag_table::COLUMNS;

    /// The column's heading.
    pub fn name(self) -> &'static str {
        Self::NAMES[self as usize]
    }
}

/// One row of tags.csv.
#[derive(Clone, Debug, PartialEq)]
pub struct TagRow {
    /// Line in the file, from 1 (the header is line 1).
    pub line: u64,
    /// The photo, as the file names it; `None` if the cell is empty.
    pub photo: Option<String>,
    /// The tag, in SI.
    pub tag: CaptureTag,
}

/// What a row of tags.csv says about a photo: which it is and, unless nothing was measured, its tag.
pub(super) struct Claim {
    pub(super) line: u64,
    pub(super) capture: u32,
    pub(super) photo: Option<String>,
    pub(super) tag: Option<CaptureTag>,
}

impl From<TagRow> for Claim {
    fn from(row: TagRow) -> Self {
        Self { line: row.line, capture: row.tag.capture, photo: row.photo, tag: Some(row.tag) }
    }
}

/// Longest plausible range or offset; a reading in millimetres is far above.
const FARTHEST_M: f64 = 200.0;
/// Fastest plausible vehicle.
const FASTEST_MPS: f64 = 100.0;

/// Reads tags.csv. The rows come in the order of the file.
///
/// # Errors
/// [`TagsError`] naming every wrong line with its column, what was found and what was expected.
pub fn read_tags(path: &Path) -> Result<Vec<TagRow>, TagsError> {
    let bytes = fs::read(path).map_err(|source| TagsError::Io { path: path.to_owned(), source })?;
    let (rows, mut faults) = parse(&bytes);
    if rows.is_empty() && faults.is_empty() {
        return Err(TagsError::Empty { path: path.to_owned() });
    }
    faults.extend(duplicates(&rows));
    if faults.is_empty() { Ok(rows) } else { Err(TagsError::Faults { path: path.to_owned(), faults }) }
}

/// Reads a tags.csv that numbers and names photos but measures nothing; the claims come in the order of the file.
///
/// `None` if any row holds more than number and name, or is wrong in any way: then it is for [`read_tags`] to say so.
pub(super) fn read_names(path: &Path) -> Result<Option<Vec<Claim>>, TagsError> {
    let bytes = fs::read(path).map_err(|source| TagsError::Io { path: path.to_owned(), source })?;
    let mut reader = csv::ReaderBuilder::new().trim(csv::Trim::All).from_reader(bytes.as_slice());
    let headings_match = reader.headers().is_ok_and(|headings| headings.iter().eq(TagColumn::NAMES));
    let claims: Option<Vec<Claim>> = reader
        .records()
        .map(|record| {
            let record = record.ok()?;
            let [number, name] = [TagColumn::Capture, TagColumn::Photo].map(|column| record.get(column as usize));
            let line = record.position().map_or(0, csv::Position::line);
            let capture = number?.parse().ok().filter(|capture| *capture >= 1)?;
            let bare = record.iter().skip(TagColumn::State as usize).all(str::is_empty);
            let photo = name.filter(|name| !name.is_empty()).map(str::to_owned);
            bare.then_some(Claim { line, capture, photo, tag: None })
        })
        .collect();
    let distinct = |claims: &Vec<Claim>| {
        claims.iter().map(|claim| claim.capture).collect::<std::collections::HashSet<_>>().len() == claims.len()
    };
    Ok(claims.filter(|claims| headings_match && !claims.is_empty() && distinct(claims)))
}

fn parse(bytes: &[u8]) -> (Vec<TagRow>, Vec<TagFault>) {
    let bytes = bytes.strip_prefix(b"\xef\xbb\xbf").unwrap_or(bytes);
    let mut reader =
        csv::ReaderBuilder::new().has_headers(false).flexible(true).trim(csv::Trim::All).from_reader(bytes);
    let (mut rows, mut faults) = (Vec::new(), Vec::new());
    let mut lines = LineCounter { bytes, counted_to: 0, line: 1 };
    let mut header_seen = false;
    for record in reader.byte_records() {
        // Reading from memory with flexible lengths cannot fail.
        let Ok(record) = record else { break };
        let line = lines.line_of(record.position().map_or(0, |position| position.byte() as usize));
        let cells: Vec<String> = record.iter().map(|cell| String::from_utf8_lossy(cell).into_owned()).collect();
        if !header_seen {
            header_seen = true;
            faults.extend(check_header(line, &cells));
            if !faults.is_empty() {
                break;
            }
        } else if cells.len() == TagColumn::NAMES.len() {
            let mut row = Row { line, cells: &cells, faults: &mut faults };
            rows.extend(row.parse());
        } else {
            faults.push(TagFault {
                line,
                column: "capture",
                found: format!("a row of {} cells", cells.len()),
                expected: "19 cells as in the header line",
            });
        }
    }
    (rows, faults)
}

/// Finds line numbers for growing byte offsets. (The csv reader's own count is off by one after CRLF and empty lines.)
struct LineCounter<'a> {
    bytes: &'a [u8],
    counted_to: usize,
    line: u64,
}

impl LineCounter<'_> {
    /// The line of the first byte from `offset` on that is no line break.
    fn line_of(&mut self, offset: usize) -> u64 {
        let rest = self.bytes.get(offset..).unwrap_or_default();
        let start = offset + rest.iter().take_while(|byte| matches!(byte, b'\r' | b'\n')).count();
        let passed = self.bytes.get(self.counted_to..start).unwrap_or_default();
        self.line += passed.split(|&byte| byte == b'\n').count().saturating_sub(1) as u64;
        self.counted_to = start;
        self.line
    }
}

fn check_header(line: u64, cells: &[String]) -> Vec<TagFault> {
    let mut faults: Vec<TagFault> = TagColumn::NAMES
        .iter()
        .enumerate()
        .filter(|(i, name)| cells.get(*i).is_none_or(|cell| cell != *name))
        .map(|(i, name)| TagFault {
            line,
            column: name,
            found: cells.get(i).cloned().unwrap_or_default(),
            expected: "this heading, in this place",
        })
        .collect();
    if let Some(extra) = cells.get(TagColumn::NAMES.len()) {
        faults.push(TagFault { line, column: "flags", found: extra.clone(), expected: "no further column" });
    }
    faults
}

fn duplicates(rows: &[TagRow]) -> Vec<TagFault> {
    let mut seen = std::collections::HashSet::new();
    rows.iter()
        .filter(|row| !seen.insert(row.tag.capture))
        .map(|row| TagFault {
            line: row.line,
            column: TagColumn::Capture.name(),
            found: row.tag.capture.to_string(),
            expected: "a number that no other row has",
        })
        .collect()
}

/// One row while it is being parsed.
struct Row<'a> {
    line: u64,
    cells: &'a [String],
    faults: &'a mut Vec<TagFault>,
}

impl Row<'_> {
    /// `None` if a cell without which there is no tag is wrong; the fault is recorded.
    fn parse(&mut self) -> Option<TagRow> {
        use TagColumn as C;
        let faults_before = self.faults.len();
        let capture = self.capture();
        let state = self.state();
        let time_s = self.required(C::TimeS, (0.0, 1e9), "seconds since the board's start, not negative");
        let shaft_deg = self.required(C::ShaftDeg, (-1e7, 1e7), "an angle in degrees");
        let ranges = Ranges {
            up_m: self.range(C::RangeUpM),
            right_m: self.range(C::RangeRightM),
            down_m: self.range(C::RangeDownM),
            left_m: self.range(C::RangeLeftM),
        };
        let range_head_m = self.range(C::RangeHeadM);
        let odometer_m = self.number(C::OdometerM, (-1e6, 1e6), "metres").map(|v| v as f32);
        let attitude_deg = self.together(
            [C::RollDeg, C::PitchDeg, C::YawDeg],
            (-360.0, 360.0),
            "degrees; roll, pitch and yaw all given or all empty",
        );
        let offset_m = self.together(
            [C::OffsetYM, C::OffsetZM],
            (-FARTHEST_M, FARTHEST_M),
            "metres; offset_y_m and offset_z_m both given or both empty",
        );
        let speed_mps = self.number(C::SpeedMps, (-FASTEST_MPS, FASTEST_MPS), "metres per second").map(|v| v as f32);
        let limit = (0.0, FASTEST_MPS);
        let speed_limit_mps = self.number(C::SpeedLimitMps, limit, "metres per second, not negative").map(|v| v as f32);
        let flags = self.flags();
        if self.faults.len() > faults_before {
            return None;
        }
        let tag = CaptureTag {
            capture: capture?,
            state: state?,
            time_us: (time_s? * 1e6).round() as u64,
            shaft_rad: shaft_deg?.to_radians() as f32,
            ranges,
            range_head_m,
            odometer_m,
            attitude_rad: attitude_deg.map(|angles| angles.map(|deg| deg.to_radians() as f32)),
            offset_m: offset_m.map(|offset| offset.map(|m| m as f32)),
            speed_mps,
            speed_limit_mps,
            flags,
        };
        let photo = self.cell(C::Photo);
        Some(TagRow { line: self.line, photo: (!photo.is_empty()).then(|| photo.to_owned()), tag })
    }

    fn cell(&self, column: TagColumn) -> &str {
        self.cells.get(column as usize).map_or("", String::as_str)
    }

    fn fault(&mut self, column: TagColumn, expected: &'static str) {
        let found = self.cell(column).to_owned();
        self.faults.push(TagFault { line: self.line, column: column.name(), found, expected });
    }

    fn capture(&mut self) -> Option<u32> {
        let parsed = self.cell(TagColumn::Capture).parse().ok().filter(|&capture| capture >= 1);
        if parsed.is_none() {
            self.fault(TagColumn::Capture, "a whole number from 1");
        }
        parsed
    }

    fn state(&mut self) -> Option<CaptureState> {
        match self.cell(TagColumn::State) {
            "commanded" => Some(CaptureState::Commanded),
            "busy" => Some(CaptureState::Busy),
            "confirmed" => Some(CaptureState::Confirmed),
            _ => {
                self.fault(TagColumn::State, "commanded, busy or confirmed");
                None
            }
        }
    }

    fn required(&mut self, column: TagColumn, bounds: (f64, f64), expected: &'static str) -> Option<f64> {
        if self.cell(column).is_empty() {
            self.fault(column, expected);
            return None;
        }
        self.number(column, bounds, expected)
    }

    fn number(&mut self, column: TagColumn, (low, high): (f64, f64), expected: &'static str) -> Option<f64> {
        let cell = self.cell(column);
        if cell.is_empty() {
            return None;
        }
        let parsed = cell.parse().ok().filter(|value: &f64| (low..=high).contains(value));
        if parsed.is_none() {
            self.fault(column, expected);
        }
        parsed
    }

    fn range(&mut self, column: TagColumn) -> Option<f32> {
        self.number(column, (1e-3, FARTHEST_M), "a distance in metres, up to 200, or an empty cell").map(|m| m as f32)
    }

    /// Cells that mean something only together.
    fn together<const N: usize>(
        &mut self,
        columns: [TagColumn; N],
        bounds: (f64, f64),
        expected: &'static str,
    ) -> Option<[f64; N]> {
        let faults_before = self.faults.len();
        let values = columns.map(|column| self.number(column, bounds, expected));
        let given = values.iter().flatten().count();
        if given > 0 && given < N && self.faults.len() == faults_before {
            for (column, value) in columns.into_iter().zip(values) {
                if value.is_none() {
                    self.fault(column, expected);
                }
            }
        }
        (given == N).then(|| values.map(Option::unwrap_or_default))
    }

    fn flags(&mut self) -> TagFlags {
        let mut flags = TagFlags::default();
        let words: Vec<String> = self
            .cell(TagColumn::Flags)
            .split([' ', '|', ';'])
            .filter(|word| !word.is_empty())
            .map(str::to_owned)
            .collect();
        for word in words {
            match TagFlags::NAMES.iter().find(|(name, _)| *name == word) {
                Some((_, flag)) => flags = flags.with(*flag),
                None => self.fault(
                    TagColumn::Flags,
                    "overspeed, shaft-moving, centring-lost, retry, sensor-fault, joined by `|`",
                ),
            }
        }
        flags
    }
}

/// Writes rows of tags.csv with its header. The lines of the rows are not looked at.
///
/// Angles get 4 decimals (1e-4 degrees), lengths 4 (0.1 mm), times 6.
///
/// # Errors
/// What the writer says.
pub fn write_tags<'a>(out: &mut impl Write, rows: impl IntoIterator<Item = &'a TagRow>) -> io::Result<()> {
    let mut writer = csv::WriterBuilder::new().terminator(csv::Terminator::Any(b'\n')).from_writer(out);
    writer.write_record(TagColumn::NAMES).map_err(io::Error::other)?;
    for row in rows {
        writer.write_record(tag_table::cells(row.photo.as_deref(), &row.tag)).map_err(io::Error::other)?;
    }
    writer.flush()
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    const HEADER: &str = "capture,photo,state,time_s,shaft_deg,range_up_m,range_right_m,range_down_m,range_left_m,\
                          range_head_m,odometer_m,roll_deg,pitch_deg,yaw_deg,offset_y_m,offset_z_m,speed_mps,\
                          speed_limit_mps,flags";

    fn faults_of(text: &str) -> Vec<String> {
        let (rows, mut faults) = parse(text.as_bytes());
        faults.extend(duplicates(&rows));
        faults.iter().map(|f| format!("{} {} `{}`", f.line, f.column, f.found)).collect()
    }

    #[test]
    fn a_row_is_read_into_si_units() {
        let text =
            format!("{HEADER}\r\n7,A.JPG,busy,1.5,540,3.024,,,2.95,,0.1,1,2,-3,0.1,-0.2,0.3,0.4,retry|overspeed\r\n");
        let (rows, faults) = parse(text.as_bytes());
        assert_eq!(faults, []);
        let tag = rows[0].tag;
        assert_eq!((rows[0].line, rows[0].photo.as_deref()), (2, Some("A.JPG")));
        assert_eq!((tag.capture, tag.state, tag.time_us), (7, CaptureState::Busy, 1_500_000));
        assert!((tag.shaft_rad - 3.0 * std::f32::consts::PI).abs() < 1e-6);
        assert_eq!((tag.ranges.up_m, tag.ranges.right_m), (Some(3.024), None));
        assert!((tag.attitude_rad.unwrap()[2] + 3.0_f32.to_radians()).abs() < 1e-7);
        assert_eq!(tag.flags, TagFlags::RETRY.with(TagFlags::OVERSPEED));
    }

    #[test]
    fn every_bad_cell_is_named_with_line_and_column() {
        let text = format!(
            "{HEADER}\n0,A.JPG,confirmed,1,2,,,,,,,,,,,,,,\n2,B.JPG,seen,1,2,3024,,,,,,1,,,,,,,\n3,C.JPG,busy,,x,,,,,,,,,,,,,,odd\n4,D\n"
        );
        assert_eq!(
            faults_of(&text),
            [
                "2 capture `0`",
                "3 state `seen`",
                "3 range_up_m `3024`",
                "3 pitch_deg ``",
                "3 yaw_deg ``",
                "4 time_s ``",
                "4 shaft_deg `x`",
                "4 flags `odd`",
                "5 capture `a row of 2 cells`",
            ]
        );
    }

    #[test]
    fn a_heading_in_another_unit_is_named() {
        let text = HEADER.replace("shaft_deg", "shaft_rad");
        assert_eq!(faults_of(&text), ["1 shaft_deg `shaft_rad`"]);
    }

    #[test]
    fn a_capture_that_comes_twice_is_a_fault() {
        let text = format!("{HEADER}\n1,A,busy,1,2,,,,,,,,,,,,,,\n1,B,busy,1,2,,,,,,,,,,,,,,\n");
        assert_eq!(faults_of(&text), ["3 capture `1`"]);
    }

    #[test]
    fn not_a_number_is_no_measurement() {
        let text = format!("{HEADER}\n1,A,busy,nan,inf,,,,,,,,,,,,,,\n");
        assert_eq!(faults_of(&text), ["2 time_s `nan`", "2 shaft_deg `inf`"]);
    }

    fn optional(low: f32, high: f32) -> impl Strategy<Value = Option<f32>> {
        proptest::option::of(low..high)
    }

    fn any_tag() -> impl Strategy<Value = CaptureTag> {
        let ranges = [(); 5].map(|()| optional(0.01, 100.0));
        let poses = (
            proptest::option::of(prop::array::uniform3(-3.0_f32..3.0)),
            proptest::option::of(prop::array::uniform2(-9.0_f32..9.0)),
        );
        let speeds = (optional(-5.0, 5.0), optional(0.0, 5.0), optional(-100.0, 1000.0));
        (1_u32.., 0_usize..3, 0_u64..10_000_000_000, -1000.0_f32..1000.0, ranges, poses, speeds, 0_u16..32).prop_map(
            |(
                capture,
                state,
                time_us,
                shaft_rad,
                r,
                (attitude_rad, offset_m),
                (speed_mps, limit, odometer_m),
                bits,
            )| {
                CaptureTag {
                    capture,
                    state: [CaptureState::Commanded, CaptureState::Busy, CaptureState::Confirmed][state],
                    time_us,
                    shaft_rad,
                    ranges: Ranges { up_m: r[0], right_m: r[1], down_m: r[2], left_m: r[3] },
                    range_head_m: r[4],
                    odometer_m,
                    attitude_rad,
                    offset_m,
                    speed_mps,
                    speed_limit_mps: limit,
                    flags: TagFlags(bits),
                }
            },
        )
    }

    proptest! {
        #[test]
        fn what_is_written_is_read_back_to_the_last_decimal(tags in prop::collection::vec(any_tag(), 1..20)) {
            let rows: Vec<TagRow> =
                tags.iter().map(|&tag| TagRow { line: 0, photo: Some(format!("G{}.JPG", tag.capture)), tag }).collect();
            let mut first = Vec::new();
            write_tags(&mut first, &rows).unwrap();
            let (read, faults) = parse(&first);
            prop_assert_eq!(faults, []);
            for (was, is) in rows.iter().zip(&read) {
                prop_assert_eq!(was.tag.time_us, is.tag.time_us);
                prop_assert_eq!((was.tag.capture, was.tag.state, was.tag.flags), (is.tag.capture, is.tag.state, is.tag.flags));
                prop_assert!((was.tag.shaft_rad - is.tag.shaft_rad).abs() <= 1e-6 + was.tag.shaft_rad.abs() * 2e-7);
                prop_assert_eq!(was.tag.ranges.up_m.is_some(), is.tag.ranges.up_m.is_some());
                prop_assert!((was.tag.ranges.left_m.unwrap_or(0.0) - is.tag.ranges.left_m.unwrap_or(0.0)).abs() < 6e-5);
                prop_assert_eq!(was.tag.offset_m.is_some(), is.tag.offset_m.is_some());
            }
        }

        #[test]
        fn any_bytes_are_answered(bytes in prop::collection::vec(any::<u8>(), 0..300)) {
            let (rows, faults) = parse(&bytes);
            prop_assert!(rows.len() + faults.len() <= bytes.len() + 19);
        }
    }
}
