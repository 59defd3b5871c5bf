//! The viewer: a small web server for one reconstruction, and the page that it serves.
//!
//! The page (`ground/viewer/`, TypeScript) is embedded in the program. Everything that knows the section is computed here
//! and sent as plain numbers: the section as a polyline, photos' footprints as polygons on the wall. No formula of
//! `geometry` exists twice.
//!
//! # Trust
//! The server shows files of one folder and writes findings.json beside them. It answers only requests that are
//! addressed to an IP address or `localhost` (a foreign name that resolves to this machine is how a web page gets around
//! the same-origin rule), and only its own page's (`Origin`, `Sec-Fetch-Site`); paths that lead out of the folder, by `..` or by
//! a link, do not exist for it. The page runs under a Content-Security-Policy without inline script. There is no password:
//! who can reach the address can look and can mark findings, so it listens on the loopback address unless told otherwise.

mod api;
mod error;
mod files;
mod footprints;
pub(crate) mod guard;
pub(crate) mod scene;

use std::future::Future;
use std::net::SocketAddr;
use std::path::{Path, PathBuf};

use tokio::net::TcpListener;

use crate::texture::Panorama;

pub use error::ViewError;

/// A reconstruction that can be shown.
#[derive(Clone, Debug)]
pub struct Viewer {
    /// The results; canonical, so that confinement can compare.
    out: PathBuf,
    /// The survey's photos, if they are still beside the results.
    photos: Option<PathBuf>,
    /// What the page calls it.
    name: String,
}

impl Viewer {
    /// Looks whether `out` can be shown.
    ///
    /// # Errors
    /// [`ViewError`], with words that say what to run.
    pub fn open(out: &Path) -> Result<Self, ViewError> {
        let canonical = out.canonicalize().map_err(|source| ViewError::Read { path: out.to_owned(), source })?;
        Panorama::open(&canonical)?;
        let survey = canonical.parent().filter(|folder| folder.join("survey.toml").is_file());
        let photos = survey.map(|folder| folder.join("photos")).and_then(|folder| folder.canonicalize().ok());
        let named = survey.unwrap_or(&canonical).file_name();
        let name = named.map_or_else(|| "survey".to_owned(), |name| name.to_string_lossy().into_owned());
        Ok(Self { out: canonical, photos, name })
    }

    /// Answers requests until `stop` completes and those under way are answered.
    ///
    /// # Errors
    /// If the system closes the socket.
    pub async fn serve(
        self,
        listener: TcpListener,
        stop: impl Future<Output = ()> + Send + 'static,
    ) -> Result<(), ViewError> {
        let served = axum::serve(listener, api::router(self)).with_graceful_shutdown(stop);
        served.await.map_err(|source| ViewError::Serve { source })
    }
}

/// Opens the port.
///
/// # Errors
/// [`ViewError::PortTaken`] if another program listens there; [`ViewError::Listen`] otherwise.
pub async fn listen(address: SocketAddr) -> Result<TcpListener, ViewError> {
    TcpListener::bind(address).await.map_err(|source| match source.kind() {
        std::io::ErrorKind::AddrInUse => ViewError::PortTaken { address },
        _ => ViewError::Listen { address, source },
    })
}
