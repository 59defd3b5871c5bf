//! Why there is nothing to see.

use std::io;
use std::net::SocketAddr;
use std::path::PathBuf;

use adit_geometry::profile::ProfileError;

use crate::findings::FindingsError;
use crate::poses::PosesError;

/// Why the viewer cannot show something.
#[derive(Debug, thiserror::Error)]
pub enum ViewError {
    /// No panorama there.
    #[error(
        "{}: no panorama (panorama/panorama.json); run `adit reconstruct SURVEY` to its texture stage (without \
         --stop-after, or with --stop-after texture) and view the folder it names as results{}", out.display(), hint
    )]
    NoPanorama {
        /// The folder.
        out: PathBuf,
        /// What else may be meant.
        hint: &'static str,
    },
    /// A file cannot be read.
    #[error("{}: cannot be read", path.display())]
    Read {
        /// The file.
        path: PathBuf,
        /// What the system said.
        source: io::Error,
    },
    /// A file does not hold what it should.
    #[error("{}: not understood", path.display())]
    Json {
        /// The file.
        path: PathBuf,
        /// What is wrong.
        source: serde_json::Error,
    },
    /// Figures of the results are missing or contradict each other.
    #[error("{}: {what}; run `adit reconstruct` again with --fresh", path.display())]
    Panorama {
        /// The file.
        path: PathBuf,
        /// What is wrong.
        what: &'static str,
    },
    /// The section cannot be built.
    #[error("{}: the section", path.display())]
    Profile {
        /// The file.
        path: PathBuf,
        /// What is wrong.
        source: ProfileError,
    },
    /// The poses cannot be read.
    #[error(transparent)]
    Poses(#[from] PosesError),
    /// colmap/cameras.txt is not ours.
    #[error("{}: no camera `1 MODEL WIDTH HEIGHT PARAMS` of a known model", path.display())]
    Camera {
        /// The file.
        path: PathBuf,
    },
    /// Findings cannot be read or kept.
    #[error(transparent)]
    Findings(#[from] FindingsError),
    /// Another program listens there.
    #[error(
        "{address}: another program listens on this port; choose another with --listen, or --listen {}:0 for any free one",
        address.ip()
    )]
    PortTaken {
        /// The address.
        address: SocketAddr,
    },
    /// The address cannot be used.
    #[error("{address}: cannot listen there")]
    Listen {
        /// The address.
        address: SocketAddr,
        /// What the system said.
        source: io::Error,
    },
    /// The socket failed.
    #[error("the server stopped")]
    Serve {
        /// What the system said.
        source: io::Error,
    },
}
