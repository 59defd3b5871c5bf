//! Files of the survey, and of nothing else.

use std::fs;
use std::io;
use std::path::{Path, PathBuf};

/// No picture is larger; a file that is would only fill the browser's memory.
const LARGEST_BYTES: u64 = 256 << 20;

/// Why a file is not served.
#[derive(Debug, thiserror::Error)]
pub(super) enum FileError {
    /// It leads out, or is no file that the page has any use for.
    #[error("`{wanted}` is not a file of this survey that the viewer serves")]
    Refused { wanted: String },
    /// Not there.
    #[error("`{wanted}` is missing")]
    Missing { wanted: String },
    /// Larger than anything that the page shows.
    #[error("`{wanted}` has {bytes} bytes, at most {LARGEST_BYTES} are served")]
    TooLarge { wanted: String, bytes: u64 },
    /// There, but the system says no.
    #[error("`{wanted}` cannot be read: {source}")]
    Read { wanted: String, source: io::Error },
}

/// A file's bytes and what they are.
pub(super) struct Served {
    pub(super) bytes: Vec<u8>,
    pub(super) content_type: &'static str,
}

/// Reads `wanted`, a path with `/` relative to `root` (canonical).
pub(super) fn read(root: &Path, wanted: &str) -> Result<Served, FileError> {
    let refused = || FileError::Refused { wanted: wanted.to_owned() };
    let failed = |source: io::Error| match source.kind() {
        io::ErrorKind::NotFound | io::ErrorKind::NotADirectory => FileError::Missing { wanted: wanted.to_owned() },
        _ => FileError::Read { wanted: wanted.to_owned(), source },
    };
    let content_type = content_type(wanted).ok_or_else(refused)?;
    let path = confined(root, wanted).ok_or_else(refused)?;
    let path = path.canonicalize().map_err(failed)?;
    // A link that leads out has been followed by now.
    if !path.starts_with(root) {
        return Err(refused());
    }
    let about = fs::metadata(&path).map_err(failed)?;
    if !about.is_file() {
        return Err(refused());
    }
    if about.len() > LARGEST_BYTES {
        return Err(FileError::TooLarge { wanted: wanted.to_owned(), bytes: about.len() });
    }
    let bytes = fs::read(&path).map_err(failed)?;
    Ok(Served { bytes, content_type })
}

/// Joins plain names only: no `..`, no absolute path, no drive, no hidden file.
fn confined(root: &Path, wanted: &str) -> Option<PathBuf> {
    let plain = |name: &str| !name.is_empty() && !name.starts_with('.') && !name.contains(['\\', ':', '\0']);
    wanted.split('/').all(plain).then(|| root.join(wanted))
}

fn content_type(name: &str) -> Option<&'static str> {
    let ending = name.rsplit_once('.')?.1.to_ascii_lowercase();
    match ending.as_str() {
        "png" => Some("image/png"),
        "jpg" | "jpeg" => Some("image/jpeg"),
        "json" => Some("application/json"),
        "csv" => Some("text/csv; charset=utf-8"),
        _ => None,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn folder() -> (tempfile::TempDir, PathBuf) {
        let folder = tempfile::tempdir().unwrap();
        let root = folder.path().join("out");
        fs::create_dir_all(root.join("tiles")).unwrap();
        fs::write(root.join("tiles/0_0.png"), "inside").unwrap();
        fs::write(folder.path().join("secret.json"), "outside").unwrap();
        let root = root.canonicalize().unwrap();
        (folder, root)
    }

    #[test]
    fn a_file_inside_is_served_with_its_type() {
        let (_folder, root) = folder();
        let served = read(&root, "tiles/0_0.png").unwrap();
        assert_eq!((served.bytes.as_slice(), served.content_type), (b"inside".as_slice(), "image/png"));
    }

    #[test]
    fn whatever_leads_out_is_refused() {
        let (folder, root) = folder();
        let absolute = folder.path().join("secret.json").display().to_string();
        for wanted in [
            "../secret.json",
            "tiles/../../secret.json",
            "./tiles/0_0.png",
            "tiles//0_0.png",
            "..\\secret.json",
            "C:/secret.json",
            ".hidden.json",
            "",
            "/",
            &absolute,
        ] {
            assert!(matches!(read(&root, wanted), Err(FileError::Refused { .. })), "{wanted}");
        }
    }

    #[cfg(unix)]
    #[test]
    fn a_link_is_followed_inside_and_refused_outside() {
        let (folder, root) = folder();
        std::os::unix::fs::symlink(root.join("tiles/0_0.png"), root.join("inside.png")).unwrap();
        std::os::unix::fs::symlink(folder.path().join("secret.json"), root.join("leak.json")).unwrap();
        std::os::unix::fs::symlink(folder.path(), root.join("up")).unwrap();
        assert!(read(&root, "inside.png").is_ok());
        assert!(matches!(read(&root, "leak.json"), Err(FileError::Refused { .. })));
        assert!(matches!(read(&root, "up/secret.json"), Err(FileError::Refused { .. })));
    }

    #[test]
    fn what_is_not_there_is_missing_and_other_kinds_do_not_exist() {
        let (_folder, root) = folder();
        assert!(matches!(read(&root, "tiles/9_9.png"), Err(FileError::Missing { .. })));
        fs::write(root.join("stage.bin"), "x").unwrap();
        assert!(matches!(read(&root, "stage.bin"), Err(FileError::Refused { .. })));
        assert!(matches!(read(&root, "tiles"), Err(FileError::Refused { .. })));
    }
}
