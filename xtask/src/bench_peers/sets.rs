//! The sets that are compared: the samples, and those that `adit-sim survey` makes.

use std::fs;
use std::io;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result, bail};
use crc::{CRC_64_XZ, Crc};

use super::{bal, program, text};
use crate::shell::{run, top};

/// Where made sets are kept between runs.
const FOLDER: &str = "target/bench-sets";

/// One set.
#[derive(Clone, Copy, Debug)]
pub(super) struct Set {
    pub(super) name: &'static str,
    source: Source,
    /// Whether the peer is tried on it too.
    pub(super) for_peer: bool,
    /// Whether it belongs to a run that names no sets.
    by_default: bool,
}

#[derive(Clone, Copy, Debug)]
enum Source {
    /// A folder of `shared/samples`.
    Sample,
    /// A kind of `adit-sim survey`, and the number of photos where it is not the kind's own.
    Made(&'static str, Option<u32>),
}

/// The table of sets.
const SETS: [Set; 15] = [
    sample("cylinder-brick-spiral"),
    sample("cylinder-concrete-spiral"),
    sample("underpass-spiral"),
    made("brick"),
    made("panorama"),
    made("concrete"),
    made("tiles"),
    made("jitter"),
    made("spiral"),
    made("cylindrical"),
    made("trolley"),
    made("imperfect"),
    made("identical-bricks"),
    Set { name: SHORT, source: Source::Made("long", Some(230)), for_peer: false, by_default: false },
    Set { name: LONG, source: Source::Made("long", None), for_peer: false, by_default: false },
];

/// The first tenth of [`LONG`].
pub(super) const SHORT: &str = "long-230";
/// 2,300 photos over 220 m.
pub(super) const LONG: &str = "long-2300";
/// The name that chooses both on the command line.
const BOTH_LONG: &str = "long";

const fn sample(name: &'static str) -> Set {
    Set { name, source: Source::Sample, for_peer: true, by_default: true }
}

const fn made(name: &'static str) -> Set {
    Set { name, source: Source::Made(name, None), for_peer: true, by_default: true }
}

/// The sets of these names, in the table's order.
pub(super) fn chosen(names: Option<&[String]>) -> Result<Vec<Set>> {
    let Some(names) = names else { return Ok(SETS.into_iter().filter(|set| set.by_default).collect()) };
    let known = |name: &String| {
        [BOTH_LONG, bal::NAME].contains(&name.as_str()) || SETS.iter().any(|set| set.name == name.as_str())
    };
    if let Some(unknown) = names.iter().find(|name| !known(name)) {
        let all: Vec<&str> = SETS.iter().map(|set| set.name).chain([BOTH_LONG, bal::NAME]).collect();
        bail!("no set is called {unknown}; there are {}", all.join(", "));
    }
    let wanted = |set: &Set| {
        let is_long = [SHORT, LONG].contains(&set.name);
        names.iter().any(|name| name == set.name || (is_long && name == BOTH_LONG))
    };
    Ok(SETS.into_iter().filter(wanted).collect())
}

/// A file or folder of the samples, beside the checkout or above it.
pub(super) fn sample_path(name: &str) -> Option<PathBuf> {
    top().ancestors().map(|folder| folder.join("shared/samples").join(name)).find(|path| path.exists())
}

impl Set {
    /// The set's survey folder, made if need be; `None` for a sample that is not here.
    pub(super) fn folder(&self) -> Result<Option<PathBuf>> {
        let Source::Made(kind, photos) = self.source else { return Ok(sample_path(self.name)) };
        let folder = top().join(FOLDER).join(self.name);
        let mark = top().join(FOLDER).join(format!("{}.finished", self.name));
        if !mark.exists() {
            let out = text(&folder);
            let photos = photos.map(|photos| photos.to_string());
            let mut arguments = vec!["survey", kind, "--out", &out, "--no-texture", "--force"];
            arguments.extend(photos.iter().flat_map(|photos| ["--photos", photos.as_str()]));
            run(&program("adit-sim"), &arguments)?;
            fs::write(&mark, "").with_context(|| format!("cannot write {}", mark.display()))?;
        }
        Ok(Some(folder))
    }
}

/// Digest of what a reconstruction reads: survey.toml, tags.csv, photos and masks by name and content.
pub(super) fn digest(survey: &Path) -> Result<u64> {
    let crc = Crc::<u64>::new(&CRC_64_XZ);
    let mut digest = crc.digest();
    for file in files(survey).with_context(|| format!("cannot list {}", survey.display()))? {
        digest.update(text(file.strip_prefix(survey).unwrap_or(&file)).as_bytes());
        digest.update(&fs::read(&file).with_context(|| format!("cannot read {}", file.display()))?);
    }
    Ok(digest.finalize())
}

fn files(survey: &Path) -> io::Result<Vec<PathBuf>> {
    let mut files = vec![survey.join("survey.toml"), survey.join("tags.csv")];
    let mut open = vec![survey.join("photos"), survey.join("masks")];
    while let Some(folder) = open.pop() {
        if !folder.is_dir() {
            continue;
        }
        for entry in fs::read_dir(folder)? {
            let path = entry?.path();
            if path.is_dir() { open.push(path) } else { files.push(path) }
        }
    }
    files.sort();
    Ok(files)
}
