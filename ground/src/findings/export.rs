//! Findings for other programs: CSV, JSON in the manner of `GeoJSON`, XML in the manner of EN 13508-2.

use std::fmt::Write as _;
use std::io;

use adit_geometry::SectionVector;
use adit_geometry::profile::{Profile, ProfileSpec};
use serde_json::{Value, json};

use super::{Finding, Findings};

/// From this length on a finding is continuous: coded by its start and its end (EN 13508-2, Annex C, code J).
const CONTINUOUS_M: f64 = 1.0;

/// Writes one line per finding.
///
/// Text that a spreadsheet would take for a formula gets an apostrophe in front.
///
/// # Errors
/// What the writer says.
pub fn to_csv(out: &mut impl io::Write, findings: &Findings) -> io::Result<()> {
    let mut writer = csv::WriterBuilder::new().from_writer(out);
    let header =
        ["id", "kind", "en13508_code", "severity", "x_from_m", "x_to_m", "clock_from", "clock_to", "note", "snapshot"];
    writer.write_record(header)?;
    for Finding { id, observation, snapshot } in &findings.findings {
        let note = &observation.note;
        let formula = note.starts_with(['=', '+', '-', '@', '\t', '\r']);
        writer.write_record([
            id.to_string(),
            kind_name(observation.kind),
            observation.kind.en13508().0.to_owned(),
            observation.severity.to_string(),
            format!("{:.3}", observation.x_from_m),
            format!("{:.3}", observation.x_to_m),
            format!("{:.2}", observation.clock_from),
            format!("{:.2}", observation.clock_to),
            if formula { format!("'{note}") } else { note.clone() },
            snapshot.clone().unwrap_or_default(),
        ])?;
    }
    writer.flush()
}

/// Returns a `FeatureCollection` whose coordinates are `[x_m, s_m]` on the unrolled wall (not degrees: the one deviation from
/// `GeoJSON`, and the collection says so). A box over the seam at the crown has `s` beyond the perimeter.
pub fn to_geojson(findings: &Findings, profile: &Profile<f64>) -> Value {
    let features: Vec<Value> = findings
        .findings
        .iter()
        .map(|finding| {
            let seen = &finding.observation;
            let s_from = s_at_clock(profile, seen.clock_from);
            let mut s_to = s_at_clock(profile, seen.clock_to);
            if s_to < s_from {
                s_to += profile.perimeter_m();
            }
            let ring = [
                [seen.x_from_m, s_from],
                [seen.x_to_m, s_from],
                [seen.x_to_m, s_to],
                [seen.x_from_m, s_to],
                [seen.x_from_m, s_from],
            ];
            json!({
                "type": "Feature",
                "id": finding.id,
                "geometry": {"type": "Polygon", "coordinates": [ring]},
                "properties": finding,
            })
        })
        .collect();
    json!({
        "type": "FeatureCollection",
        "coordinates": "[x_m, s_m]: metres along the tunnel's axis; arc length from the crown, clockwise looking forward",
        "perimeter_m": profile.perimeter_m(),
        "inspection": findings.inspection,
        "features": features,
    })
}

/// Returns the findings in the structure of EN 13508-2:2003+A1:2011, Annex B: root `DATA`, file header `ZA`, one inspection
/// `ZB` with header fields, an observation `ZC` per finding, elements in alphabetical order, version 2010.
///
/// Distances are metres along the axis in the tunnel frame, clock positions whole hours, as the standard has them. It has no
/// severity: that goes with the note into the remarks. Fields of the header that nobody filled in are left out, though
/// the standard wants some of them (reference, date).
pub fn to_en13508_xml(findings: &Findings, spec: &ProfileSpec<f64>, profile: &Profile<f64>) -> String {
    let about = &findings.inspection;
    let (low, high) = profile.bounds();
    let millimetres = |metres: f64| format!("{:.0}", metres * 1000.0);
    let mut text = "<?xml version=\"1.0\" encoding=\"UTF-8\"?>\n<DATA>\n  <ZA>\n".to_owned();
    element(&mut text, 4, "A2", "en");
    element(&mut text, 4, "A6", "2010");
    text.push_str("  </ZA>\n  <ZB>\n");
    let header = [
        ("AAA", about.reference.clone()),
        ("AAD", about.from_node.clone()),
        ("AAF", about.to_node.clone()),
        ("AAJ", about.location.clone()),
        ("ABA", "EN 13508-2:2003+A1:2011".to_owned()),
        ("ABF", about.date.clone()),
        ("ABH", about.inspector.clone()),
        ("ACA", shape_code(spec).to_owned()),
        ("ACB", millimetres(high.y - low.y)),
        ("ACC", millimetres(high.x - low.x)),
    ];
    for (name, value) in header.iter().filter(|(_, value)| !value.is_empty()) {
        element(&mut text, 4, name, value);
    }
    let mut continuous = 0;
    for finding in &findings.findings {
        let seen = &finding.observation;
        if seen.x_to_m - seen.x_from_m < CONTINUOUS_M {
            observation(&mut text, finding, seen.x_from_m, None);
        } else {
            continuous += 1;
            observation(&mut text, finding, seen.x_from_m, Some(format!("A{continuous:02}")));
            observation(&mut text, finding, seen.x_to_m, Some(format!("B{continuous:02}")));
        }
    }
    text.push_str("  </ZB>\n</DATA>\n");
    text
}

fn observation(text: &mut String, finding: &Finding, x_m: f64, continuous: Option<String>) {
    let seen = &finding.observation;
    let (code, characterisation) = seen.kind.en13508();
    let remark = format!("severity {} of 5. {}", seen.severity, seen.note);
    let fields = [
        ("A", Some(code.to_owned())),
        ("B", characterisation.map(str::to_owned)),
        ("F", Some(remark)),
        ("G", Some(hour(seen.clock_from))),
        ("H", Some(hour(seen.clock_to))),
        ("I", Some(format!("{x_m:.2}"))),
        ("J", continuous),
        ("M", finding.snapshot.clone()),
    ];
    text.push_str("    <ZC>\n");
    for (name, value) in fields {
        if let Some(value) = value {
            element(text, 6, name, value.trim_end());
        }
    }
    text.push_str("    </ZC>\n");
}

/// Hours as the standard writes them: 01 to 12.
fn hour(clock: f64) -> String {
    let hour = clock.round() as u32 % 12;
    format!("{:02}", if hour == 0 { 12 } else { hour })
}

/// Header code ACA.
fn shape_code(spec: &ProfileSpec<f64>) -> &'static str {
    match spec {
        ProfileSpec::Circle { .. } => "A",
        ProfileSpec::Rectangle { .. } => "B",
        ProfileSpec::Underpass { .. } | ProfileSpec::Horseshoe { .. } => "E",
        ProfileSpec::Chain { .. } => "Z",
    }
}

fn element(text: &mut String, indent: usize, name: &str, value: &str) {
    // Writing to a string cannot fail.
    let _ = writeln!(text, "{:indent$}<{name}>{}</{name}>", "", escaped(value));
}

/// Text for XML: markup escaped, characters that XML 1.0 cannot hold left out.
fn escaped(value: &str) -> String {
    let mut text = String::with_capacity(value.len());
    for character in value.chars() {
        match character {
            '&' => text.push_str("&amp;"),
            '<' => text.push_str("&lt;"),
            '>' => text.push_str("&gt;"),
            '\t' | '\n' => text.push(character),
            '\u{FFFE}' | '\u{FFFF}' => {}
            other if other.is_control() => {}
            other => text.push(other),
        }
    }
    text
}

fn kind_name(kind: super::Kind) -> String {
    serde_json::to_value(kind).ok().and_then(|name| name.as_str().map(str::to_owned)).unwrap_or_default()
}

/// Arc length where the wall is met in the direction of a clock position.
fn s_at_clock(profile: &Profile<f64>, clock: f64) -> f64 {
    let (sin, cos) = (clock / 12.0 * std::f64::consts::TAU).sin_cos();
    let hit = profile.ray_cast(SectionVector::zeros(), SectionVector::new(sin, -cos));
    hit.map_or(0.0, |hit| hit.surface.s_m)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::findings::{Observation, example};

    fn findings(observations: impl IntoIterator<Item = Observation>) -> Findings {
        let list = observations.into_iter().zip(1..);
        Findings {
            findings: list.map(|(observation, id)| Finding { id, observation, snapshot: None }).collect(),
            ..Findings::default()
        }
    }

    fn circle() -> (ProfileSpec<f64>, Profile<f64>) {
        let spec = ProfileSpec::Circle { radius_m: 3.0 };
        let profile = spec.build().unwrap();
        (spec, profile)
    }

    #[test]
    fn csv_is_read_back_whatever_the_note_says() {
        let note = "=HYPERLINK(\"http://x\"), \"quoted\"\nsecond line";
        let mut text = Vec::new();
        to_csv(&mut text, &findings([Observation { note: note.to_owned(), ..example() }])).unwrap();
        let mut reader = csv::Reader::from_reader(text.as_slice());
        let row = reader.records().next().unwrap().unwrap();
        assert_eq!(
            row.iter().take(8).collect::<Vec<_>>(),
            ["1", "crack", "BAB", "3", "1.250", "1.500", "11.00", "1.00"]
        );
        assert_eq!(&row[8], format!("'{note}"));
    }

    #[test]
    fn a_box_over_the_crown_goes_on_beyond_the_perimeter() {
        let (_, profile) = circle();
        let json = to_geojson(&findings([example()]), &profile);
        let ring = &json["features"][0]["geometry"]["coordinates"][0];
        let s = |corner: usize| ring[corner][1].as_f64().unwrap() / profile.perimeter_m() * 12.0;
        assert!((s(0) - 11.0).abs() < 1e-9 && (s(2) - 13.0).abs() < 1e-9, "{ring}");
        assert_eq!(ring[0], ring[4]);
        assert_eq!(json["features"][0]["properties"]["kind"], "crack");
    }

    #[test]
    fn xml_has_codes_hours_and_both_ends_of_what_is_long() {
        let (spec, profile) = circle();
        let long = Observation { x_to_m: 9.75, note: "<b>&\u{0}".to_owned(), ..example() };
        let mut all = findings([example(), long]);
        all.inspection.reference = "S-12 <east>".to_owned();
        let xml = to_en13508_xml(&all, &spec, &profile);
        insta::assert_snapshot!(xml);
    }
}
