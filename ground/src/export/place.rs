//! Results take their place whole: made under another name beside it, then renamed.

use std::fs;
use std::path::{Path, PathBuf};

use super::error::{ExportError, at_path};
use crate::files::beside;

/// Where results go.
pub(super) struct Destination {
    folder: PathBuf,
    replace: bool,
}

impl Destination {
    /// Prepares the folder; refuses it if one of the `names` is there and may not be replaced.
    pub(super) fn open<'a>(
        folder: &Path,
        replace: bool,
        names: impl IntoIterator<Item = &'a str>,
    ) -> Result<Self, ExportError> {
        for name in names {
            let path = folder.join(name);
            if path.exists() && !replace {
                return Err(ExportError::Exists { path });
            }
        }
        fs::create_dir_all(folder).map_err(at_path(folder))?;
        Ok(Self { folder: folder.to_owned(), replace })
    }

    /// Makes a file or folder: `write` makes it under the name that it is given.
    ///
    /// # Errors
    /// What `write` says; nothing is left of what it made, and what was there before is as it was.
    pub(super) fn place<T>(
        &self,
        name: &str,
        write: impl FnOnce(&Path) -> Result<T, ExportError>,
    ) -> Result<(PathBuf, T), ExportError> {
        let path = self.folder.join(name);
        let new = beside(&path);
        // What a killed run has left.
        remove(&new)?;
        let made = write(&new).and_then(|made| self.take_place(&new, &path).map(|()| made));
        if made.is_err() {
            // The first error is the one to tell; where this fails too, the name says that it is not finished.
            let _ = remove(&new);
        }
        Ok((path, made?))
    }

    fn take_place(&self, new: &Path, path: &Path) -> Result<(), ExportError> {
        if new.is_file() {
            fs::File::open(new).and_then(|file| file.sync_all()).map_err(at_path(new))?;
        } else if self.replace && path.is_dir() {
            // A folder cannot be renamed onto another one.
            let mut old = path.to_owned();
            old.as_mut_os_string().push(".old");
            remove(&old)?;
            fs::rename(path, &old).map_err(at_path(path))?;
            fs::rename(new, path).map_err(at_path(path))?;
            return remove(&old);
        }
        fs::rename(new, path).map_err(at_path(path))
    }
}

fn remove(path: &Path) -> Result<(), ExportError> {
    let removed = if path.is_dir() {
        fs::remove_dir_all(path)
    } else if path.exists() {
        fs::remove_file(path)
    } else {
        Ok(())
    };
    removed.map_err(at_path(path))
}

/// Bytes of a file, or of all files in a folder.
pub(super) fn bytes(path: &Path) -> Result<u64, ExportError> {
    if !path.is_dir() {
        return Ok(fs::metadata(path).map_err(at_path(path))?.len());
    }
    let entries = fs::read_dir(path).map_err(at_path(path))?;
    entries.map(|entry| bytes(&entry.map_err(at_path(path))?.path())).sum()
}

/// Number of files in a folder.
pub(super) fn count(folder: &Path) -> Result<usize, ExportError> {
    let entries = fs::read_dir(folder).map_err(at_path(folder))?;
    entries
        .map(|entry| {
            let path = entry.map_err(at_path(folder))?.path();
            if path.is_dir() { count(&path) } else { Ok(1) }
        })
        .sum()
}

/// Copies a file, or a folder with everything in it.
pub(super) fn copy(from: &Path, to: &Path, tick: &dyn Fn()) -> Result<(), ExportError> {
    if !from.is_dir() {
        fs::copy(from, to).map_err(at_path(to))?;
        tick();
        return Ok(());
    }
    fs::create_dir_all(to).map_err(at_path(to))?;
    for entry in fs::read_dir(from).map_err(at_path(from))? {
        let entry = entry.map_err(at_path(from))?;
        copy(&entry.path(), &to.join(entry.file_name()), tick)?;
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn names(folder: &Path) -> Vec<String> {
        let mut names: Vec<String> =
            fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().file_name().into_string().unwrap()).collect();
        names.sort();
        names
    }

    fn write(content: &'static str) -> impl FnOnce(&Path) -> Result<(), ExportError> {
        move |path| fs::write(path, content).map_err(at_path(path))
    }

    #[test]
    fn what_is_there_is_replaced_only_if_asked_for() {
        let folder = tempfile::tempdir().unwrap();
        let open = |replace| Destination::open(folder.path(), replace, ["a"]);
        open(false).unwrap().place("a", write("1")).unwrap();
        assert!(matches!(open(false), Err(ExportError::Exists { .. })));
        open(true).unwrap().place("a", write("2")).unwrap();
        assert_eq!(fs::read(folder.path().join("a")).unwrap(), b"2");
    }

    #[test]
    fn a_failure_half_way_leaves_what_was_there_and_nothing_else() {
        let folder = tempfile::tempdir().unwrap();
        let destination = Destination::open(folder.path(), true, ["a"]).unwrap();
        destination.place("a", write("old")).unwrap();
        let failed = destination.place("a", |path| {
            write("half")(path)?;
            Err::<(), _>(ExportError::Exists { path: path.to_owned() })
        });
        assert!(failed.is_err());
        assert_eq!(fs::read(folder.path().join("a")).unwrap(), b"old");
        assert_eq!(names(folder.path()), ["a"]);
    }

    #[test]
    fn a_folder_replaces_the_old_one_whole() {
        let folder = tempfile::tempdir().unwrap();
        let destination = Destination::open(folder.path(), true, []).unwrap();
        for name in ["first", "second"] {
            let make = |path: &Path| {
                fs::create_dir(path).map_err(at_path(path))?;
                write("x")(&path.join(name))
            };
            destination.place("d", make).unwrap();
        }
        assert_eq!(names(folder.path()), ["d"]);
        assert_eq!(names(&folder.path().join("d")), ["second"]);
        assert_eq!(bytes(&folder.path().join("d")).unwrap(), 1);
    }
}
