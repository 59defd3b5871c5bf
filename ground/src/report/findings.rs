//! What an inspector marked in the viewer, for the page.

use std::path::Path;

use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use serde::Serialize;

use crate::findings::{Finding, FindingsError, Inspection, Store};

/// At most so many pictures are put into the page, of the gravest findings first: each is some 100 kB.
const MOST_PICTURES: usize = 60;

/// Findings along the tunnel, and what is known of the inspection.
#[derive(Serialize)]
pub(super) struct Told {
    inspection: Inspection,
    findings: Vec<ToldFinding>,
    pictures_left_out: usize,
}

#[derive(Serialize)]
struct ToldFinding {
    #[serde(flatten)]
    finding: Finding,
    /// The snapshot as a data address.
    picture: Option<String>,
}

/// Reads `findings.json` and its pictures; a picture that is not there is left out.
///
/// # Errors
/// If findings.json is there and cannot be understood.
pub(super) fn told(out: &Path) -> Result<Told, FindingsError> {
    let mut found = Store::new(out).load()?;
    found.findings.sort_by_key(|finding| std::cmp::Reverse(finding.observation.severity));
    let mut told = Told { inspection: found.inspection, findings: Vec::new(), pictures_left_out: 0 };
    for (rank, finding) in found.findings.into_iter().enumerate() {
        let wanted = finding.snapshot.as_ref().filter(|_| rank < MOST_PICTURES);
        told.pictures_left_out += usize::from(finding.snapshot.is_some() && wanted.is_none());
        let jpeg = wanted.and_then(|name| std::fs::read(out.join(name)).ok());
        let picture = jpeg.map(|jpeg| format!("data:image/jpeg;base64,{}", STANDARD.encode(jpeg)));
        told.findings.push(ToldFinding { finding, picture });
    }
    told.findings.sort_by(|a, b| a.finding.observation.x_from_m.total_cmp(&b.finding.observation.x_from_m));
    Ok(told)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::findings::{Kind, Observation};

    #[test]
    fn findings_come_in_the_order_of_the_tunnel_with_their_pictures() {
        let folder = tempfile::tempdir().unwrap();
        let store = Store::new(folder.path());
        let seen = |x_from_m: f64| Observation {
            kind: Kind::Crack,
            severity: 3,
            note: "<wet>".into(),
            x_from_m,
            x_to_m: x_from_m + 0.1,
            clock_from: 2.0,
            clock_to: 3.0,
        };
        store.add(seen(4.0), Some(&STANDARD.encode([0xff, 0xd8, 0xff, 0xe0]))).unwrap();
        store.add(seen(1.0), None).unwrap();
        let told = told(folder.path()).unwrap();
        let places: Vec<f64> = told.findings.iter().map(|told| told.finding.observation.x_from_m).collect();
        assert_eq!(places, [1.0, 4.0]);
        assert!(told.findings[0].picture.is_none());
        assert!(told.findings[1].picture.as_ref().unwrap().starts_with("data:image/jpeg;base64,/9j"));
        assert_eq!(told.pictures_left_out, 0);
    }
}
