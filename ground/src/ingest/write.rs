//! The survey folder on disk: whole files only, photos first, ingest.json last.

use std::collections::HashSet;
use std::fs;
use std::io;
use std::path::Path;

use adit_protocol::mission::Mission;

use super::card::CardPhoto;
use super::flight::log_names;
use super::pairing::Pairing;
use super::{IngestError, IngestOptions, IngestReport};
use crate::files;
use crate::report::MISSION_FILE;
use crate::survey::{TagRow, write_tags};

/// The file that says that a folder is ingest's own, and complete.
const REPORT: &str = "ingest.json";

/// Refuses a folder that holds somebody else's survey, and one inside the card.
pub(super) fn check_out(out: &Path, card: &Path) -> Result<(), IngestError> {
    for (name, found) in
        [("tags.csv", "tags.csv without ingest.json"), ("survey.toml", "survey.toml without ingest.json")]
    {
        if out.join(name).exists() && !out.join(REPORT).exists() && !out.join(partial(REPORT)).exists() {
            return Err(IngestError::ForeignSurvey { path: out.to_owned(), found });
        }
    }
    fs::create_dir_all(out).map_err(|source| IngestError::Write { path: out.to_owned(), source })?;
    let real = |path: &Path| path.canonicalize().unwrap_or_else(|_| path.to_owned());
    if real(out).starts_with(real(card)) || real(card).starts_with(real(out).join("photos")) {
        return Err(IngestError::OutIsCard { path: out.to_owned() });
    }
    Ok(())
}

/// Names of the paired photos inside the survey: the file's own name, with its folder where that is not unique.
pub(super) fn survey_names(photos: &[CardPhoto], pairing: &Pairing) -> Vec<String> {
    let paired: Vec<&str> = pairing.pairs.iter().map(|pair| photos[pair.photo].name.as_str()).collect();
    let flat: HashSet<String> = paired.iter().map(|name| file_name(name).to_ascii_lowercase()).collect();
    let unique = flat.len() == paired.len();
    paired.iter().map(|name| if unique { file_name(name) } else { name }.to_owned()).collect()
}

fn file_name(name: &str) -> &str {
    name.rsplit('/').next().unwrap_or(name)
}

/// Writes photos, logs, survey.toml, mission.toml, tags.csv, ingest.json, in this order.
pub(super) fn write_survey(
    options: &IngestOptions,
    mission: &Mission,
    photos: &[CardPhoto],
    pairing: &Pairing,
    rows: &[TagRow],
    report: &IngestReport,
) -> Result<(), IngestError> {
    let out = &options.out;
    let json = serde_json::to_vec_pretty(report).map_err(io::Error::other);
    let json = json.map_err(|source| IngestError::Write { path: out.join(REPORT), source })?;
    // The mark of a folder that is being made; a stopped run is taken up by the next.
    write_whole(&out.join(partial(REPORT)), b"")?;
    remove_stale(out, rows)?;
    for pair in &pairing.pairs {
        let Some(name) = rows.get(pair.capture).and_then(|row| row.photo.as_ref()) else { continue };
        place(&photos[pair.photo].path, &out.join("photos").join(name))?;
    }
    for (path, name) in log_names(&options.logs) {
        place(&path, &out.join("log").join(name))?;
    }
    write_config(&out.join("survey.toml"), mission.survey.to_toml().as_bytes())?;
    // What was planned, for the report: a copy, for the file may be changed for the next flight.
    let planned = fs::read(&options.mission);
    let planned = planned.map_err(|source| IngestError::MissionFile { path: options.mission.clone(), source })?;
    write_config(&out.join(MISSION_FILE), &planned)?;
    let mut tags = Vec::new();
    write_tags(&mut tags, rows).map_err(|source| IngestError::Write { path: out.join("tags.csv"), source })?;
    write_whole(&out.join("tags.csv"), &tags)?;
    write_whole(&out.join(REPORT), &json)?;
    let mark = out.join(partial(REPORT));
    fs::remove_file(&mark).map_err(|source| IngestError::Write { path: mark, source })
}

fn partial(name: &str) -> String {
    format!("{name}.partial")
}

/// Removes photos that an earlier ingest placed and this one does not want. Only names in its ingest.json, only links.
fn remove_stale(out: &Path, rows: &[TagRow]) -> Result<(), IngestError> {
    #[derive(serde::Deserialize)]
    struct Earlier {
        pairs: Vec<EarlierPair>,
    }
    #[derive(serde::Deserialize)]
    struct EarlierPair {
        photo: String,
    }
    let Some(earlier) =
        fs::read(out.join(REPORT)).ok().and_then(|bytes| serde_json::from_slice::<Earlier>(&bytes).ok())
    else {
        return Ok(());
    };
    let wanted: HashSet<&str> = rows.iter().filter_map(|row| row.photo.as_deref()).collect();
    for pair in earlier.pairs {
        let inside = !pair.photo.split('/').any(|part| part == "..") && !Path::new(&pair.photo).is_absolute();
        let path = out.join("photos").join(&pair.photo);
        if inside && !wanted.contains(pair.photo.as_str()) && path.is_file() {
            fs::remove_file(&path).map_err(|source| IngestError::Write { path, source })?;
        }
    }
    Ok(())
}

/// Puts a file at its place in the survey: a hard link where the file system can, else a copy. What is there already
/// with the same content stays.
fn place(from: &Path, to: &Path) -> Result<(), IngestError> {
    let write_error = |source| IngestError::Write { path: to.to_owned(), source };
    if same_content(from, to) {
        return Ok(());
    }
    if let Some(folder) = to.parent() {
        fs::create_dir_all(folder).map_err(write_error)?;
    }
    let beside = files::beside(to);
    if beside.exists() {
        fs::remove_file(&beside).map_err(write_error)?;
    }
    if fs::hard_link(from, &beside).is_err() {
        fs::copy(from, &beside).map_err(write_error)?;
    }
    fs::rename(&beside, to).map_err(write_error)
}

/// Same file, or same bytes.
fn same_content(a: &Path, b: &Path) -> bool {
    let (Ok(a_about), Ok(b_about)) = (fs::metadata(a), fs::metadata(b)) else { return false };
    if a_about.len() != b_about.len() {
        return false;
    }
    matches!((fs::read(a), fs::read(b)), (Ok(a), Ok(b)) if a == b)
}

/// Writes survey.toml or mission.toml; one that was edited since is kept beside it.
fn write_config(path: &Path, text: &[u8]) -> Result<(), IngestError> {
    match fs::read(path) {
        Ok(there) if there == text => return Ok(()),
        Ok(_) => {
            let kept = path.with_extension("toml.earlier");
            fs::rename(path, &kept).map_err(|source| IngestError::Write { path: kept, source })?;
        }
        Err(_) => {}
    }
    write_whole(path, text)
}

fn write_whole(path: &Path, content: &[u8]) -> Result<(), IngestError> {
    files::write_whole(path, content).map_err(|source| IngestError::Write { path: path.to_owned(), source })
}
