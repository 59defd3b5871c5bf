//! Why there is nothing to see.

use std::io;
use std::net::SocketAddr;
use std::path::PathBuf;

use crate::findings::FindingsError;
use crate::poses::PosesError;
use crate::texture::TextureError;

/// Why the viewer cannot show something.
#[derive(Debug, thiserror::Error)]
pub enum ViewError {
    /// No panorama there, or a damaged one.
    #[error(transparent)]
    Texture(#[from] TextureError),
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
    Coverage {
        /// The file.
        path: PathBuf,
        /// What is wrong.
        what: &'static str,
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
