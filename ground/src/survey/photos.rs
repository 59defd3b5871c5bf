//! Finding files below a folder: photos (flat or in DCIM folders) and masks.

use std::fs;
use std::io;
use std::path::{Path, PathBuf};

/// A JPEG below a photo folder.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct FoundPhoto {
    /// Path relative to the folder, joined by `/`.
    pub name: String,
    /// Path to the file.
    pub path: PathBuf,
}

/// Folders deeper than this are not looked into (`DCIM/100GOPRO/` needs two levels).
const DEEPEST: usize = 4;

/// Returns every JPEG (`.jpg`, `.jpeg`, any case) below `folder`, sorted by name. Hidden files are left out.
///
/// # Errors
/// What the system says if a folder cannot be read.
pub fn find_photos(folder: &Path) -> io::Result<Vec<FoundPhoto>> {
    let found = find_files(folder, &["jpg", "jpeg"])?;
    Ok(found.into_iter().map(|(name, path)| FoundPhoto { name, path }).collect())
}

/// Returns `(name, path)` of every file below `folder` whose extension is one of `extensions`, sorted by name.
pub(super) fn find_files(folder: &Path, extensions: &[&str]) -> io::Result<Vec<(String, PathBuf)>> {
    let mut found = Vec::new();
    collect(folder, "", extensions, DEEPEST, &mut found)?;
    found.sort();
    Ok(found)
}

fn collect(
    folder: &Path,
    prefix: &str,
    extensions: &[&str],
    levels: usize,
    found: &mut Vec<(String, PathBuf)>,
) -> io::Result<()> {
    for entry in fs::read_dir(folder)? {
        let path = entry?.path();
        // Names that are not UTF-8 cannot stand in tags.csv; no camera writes them.
        let Some(file_name) = path.file_name().and_then(|name| name.to_str()) else { continue };
        if file_name.starts_with('.') {
            continue;
        }
        let name = format!("{prefix}{file_name}");
        if path.is_dir() {
            if levels > 0 {
                collect(&path, &format!("{name}/"), extensions, levels - 1, found)?;
            }
        } else if path.extension().is_some_and(|e| extensions.iter().any(|wanted| e.eq_ignore_ascii_case(wanted))) {
            found.push((name, path));
        }
    }
    Ok(())
}

/// Finds the photos that tags.csv names among the files that are there.
pub(super) struct PhotoIndex {
    photos: Vec<FoundPhoto>,
    taken: Vec<bool>,
}

/// What became of a name that was looked up.
pub(super) enum Lookup {
    /// The photo; its index.
    Found(usize),
    /// No such file.
    Missing,
    /// Several folders hold a file of this name.
    Ambiguous,
    /// Another capture has it already.
    Taken,
}

impl PhotoIndex {
    pub(super) fn new(photos: Vec<FoundPhoto>) -> Self {
        Self { taken: vec![false; photos.len()], photos }
    }

    pub(super) fn photo(&self, index: usize) -> &FoundPhoto {
        &self.photos[index]
    }

    /// Looks for `name`: as it stands, then with other letter case or `.jpeg` for `.jpg`, then by file name alone.
    pub(super) fn take(&mut self, name: &str) -> Lookup {
        let wanted = name.replace('\\', "/");
        let exact = self.photos.iter().position(|photo| photo.name == wanted);
        let index = match exact.map_or_else(|| self.search(&wanted), Lookup::Found) {
            Lookup::Found(index) => index,
            other => return other,
        };
        if std::mem::replace(&mut self.taken[index], true) { Lookup::Taken } else { Lookup::Found(index) }
    }

    fn search(&self, wanted: &str) -> Lookup {
        let wanted = fold(wanted);
        for equal in [|have: &str, want: &str| have == want, |have: &str, want: &str| last_part(have) == want] {
            let mut hits = (0..self.photos.len()).filter(|&i| equal(&fold(&self.photos[i].name), &wanted));
            match (hits.next(), hits.next()) {
                (Some(only), None) => return Lookup::Found(only),
                (Some(_), Some(_)) => return Lookup::Ambiguous,
                (None, _) => {}
            }
        }
        Lookup::Missing
    }

    /// Returns the photos that no capture asked for, each with the last one before it (by name) that a capture asked for
    /// and the first one after it.
    pub(super) fn left_over(&self) -> impl Iterator<Item = (&FoundPhoto, [Option<&FoundPhoto>; 2])> {
        let taken = |index: &usize| self.taken[*index];
        (0..self.photos.len()).filter(move |index| !taken(index)).map(move |index| {
            let beside = [(0..index).rev().find(taken), (index..self.photos.len()).find(taken)];
            (&self.photos[index], beside.map(|beside| beside.map(|index| &self.photos[index])))
        })
    }
}

fn fold(name: &str) -> String {
    let lower = name.to_ascii_lowercase();
    lower.strip_suffix(".jpeg").map_or(lower.clone(), |stem| format!("{stem}.jpg"))
}

fn last_part(name: &str) -> &str {
    name.rsplit('/').next().unwrap_or(name)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn index(names: &[&str]) -> PhotoIndex {
        PhotoIndex::new(
            names.iter().map(|name| FoundPhoto { name: (*name).to_owned(), path: PathBuf::from(name) }).collect(),
        )
    }

    #[test]
    fn a_photo_is_found_by_other_case_and_by_file_name_alone() {
        let mut photos = index(&["100GOPRO/GOPR0001.JPG", "101GOPRO/GOPR0002.jpeg"]);
        assert!(matches!(photos.take("GOPR0002.jpg"), Lookup::Found(1)));
        assert!(matches!(photos.take("100gopro/gopr0001.jpg"), Lookup::Found(0)));
        assert!(matches!(photos.take("GOPR0001.JPG"), Lookup::Taken));
        assert!(matches!(photos.take("GOPR0003.JPG"), Lookup::Missing));
    }

    #[test]
    fn the_same_file_name_in_two_folders_is_ambiguous_unless_the_folder_is_given() {
        let mut photos = index(&["100GOPRO/GOPR0001.JPG", "101GOPRO/GOPR0001.JPG"]);
        assert!(matches!(photos.take("GOPR0001.JPG"), Lookup::Ambiguous));
        assert!(matches!(photos.take("101GOPRO/GOPR0001.JPG"), Lookup::Found(1)));
        assert_eq!(photos.left_over().count(), 1);
    }

    #[test]
    fn photos_are_found_in_nested_folders_without_hidden_and_other_files() {
        let folder = tempfile::tempdir().unwrap();
        let dcim = folder.path().join("DCIM/100GOPRO");
        fs::create_dir_all(&dcim).unwrap();
        for name in ["GOPR0002.JPG", "GOPR0001.jpg", "._GOPR0001.jpg", "GOPR0003.THM"] {
            fs::write(dcim.join(name), b"").unwrap();
        }
        let names: Vec<String> = find_photos(folder.path()).unwrap().into_iter().map(|photo| photo.name).collect();
        assert_eq!(names, ["DCIM/100GOPRO/GOPR0001.jpg", "DCIM/100GOPRO/GOPR0002.JPG"]);
    }
}
