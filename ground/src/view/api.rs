//! The server's addresses and what answers there.

use std::future::ready;
use std::sync::{Arc, Mutex, PoisonError};

use axum::extract::{DefaultBodyLimit, Path, State};
use axum::http::StatusCode;
use axum::http::header::{CONTENT_DISPOSITION, CONTENT_TYPE};
use axum::response::{IntoResponse, Response};
use axum::routing::{get, put};
use axum::{Json, Router, middleware};
use serde::Deserialize;
use serde_json::json;

use super::Viewer;
use super::error::ViewError;
use super::files::{self, FileError};
use super::{guard, scene};
use crate::findings::{self, FindingsError, Inspection, Observation, Store};
use crate::texture::Panorama;

/// The page, as `cargo xtask viewer` builds it.
const PAGE: &str = include_str!("../../viewer/dist/index.html");
const SCRIPT: &str = include_str!("../../viewer/dist/viewer.js");
const STYLE: &str = include_str!("../../viewer/dist/viewer.css");

/// A finding with its picture: a JPEG of a screen in base64 stays well below.
const LARGEST_BODY_BYTES: usize = 4 << 20;

struct Shared {
    viewer: Viewer,
    /// Read, change and write must not interleave.
    findings: Mutex<Store>,
}

type Server = State<Arc<Shared>>;

/// A new finding as the page sends it.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct NewFinding {
    observation: Observation,
    /// A JPEG in base64.
    snapshot: Option<String>,
}

/// All routes, guarded.
pub(super) fn router(viewer: Viewer) -> Router {
    let findings = Mutex::new(Store::new(&viewer.out));
    Router::new()
        .route("/", get(|| ready(fixed("text/html; charset=utf-8", PAGE))))
        .route("/viewer.js", get(|| ready(fixed("text/javascript; charset=utf-8", SCRIPT))))
        .route("/viewer.css", get(|| ready(fixed("text/css; charset=utf-8", STYLE))))
        .route("/api/scene", get(scene))
        .route("/api/findings", get(list).post(add))
        .route("/api/findings/{id}", put(change).delete(remove))
        .route("/api/inspection", put(describe))
        .route("/api/export/{file}", get(export))
        .route("/files/{*path}", get(file))
        .route("/photos/{name}", get(photo))
        .layer(DefaultBodyLimit::max(LARGEST_BODY_BYTES))
        .layer(middleware::from_fn(guard::guard))
        .with_state(Arc::new(Shared { viewer, findings }))
}

fn fixed(content_type: &'static str, body: &'static str) -> Response {
    ([(CONTENT_TYPE, content_type)], body).into_response()
}

/// Runs what waits for the disk on a thread that may wait.
async fn waiting<T: IntoResponse + Send + 'static>(work: impl FnOnce() -> T + Send + 'static) -> Response {
    match tokio::task::spawn_blocking(work).await {
        Ok(answer) => answer.into_response(),
        Err(_) => refusal(StatusCode::INTERNAL_SERVER_ERROR, "the server failed on this request; see its terminal"),
    }
}

async fn scene(State(shared): Server) -> Response {
    waiting(move || scene::read(&shared.viewer).map(Json)).await
}

async fn list(State(shared): Server) -> Response {
    waiting(move || shared.with_store(Store::load).map(Json)).await
}

async fn add(State(shared): Server, Json(new): Json<NewFinding>) -> Response {
    waiting(move || {
        let added = shared.with_store(|store| store.add(new.observation, new.snapshot.as_deref()));
        added.map(|finding| (StatusCode::CREATED, Json(finding)))
    })
    .await
}

async fn change(State(shared): Server, Path(id): Path<u32>, Json(observation): Json<Observation>) -> Response {
    waiting(move || shared.with_store(|store| store.change(id, observation)).map(Json)).await
}

async fn remove(State(shared): Server, Path(id): Path<u32>) -> Response {
    waiting(move || shared.with_store(|store| store.remove(id)).map(|()| StatusCode::NO_CONTENT)).await
}

async fn describe(State(shared): Server, Json(inspection): Json<Inspection>) -> Response {
    waiting(move || shared.with_store(|store| store.describe(inspection)).map(|()| StatusCode::NO_CONTENT)).await
}

async fn export(State(shared): Server, Path(file): Path<String>) -> Response {
    waiting(move || shared.export(&file)).await
}

async fn file(State(shared): Server, Path(path): Path<String>) -> Response {
    waiting(move || files::read(&shared.viewer.out, &path)).await
}

async fn photo(State(shared): Server, Path(name): Path<String>) -> Response {
    waiting(move || match &shared.viewer.photos {
        Some(folder) => files::read(folder, &name),
        None => Err(FileError::Missing { wanted: name }),
    })
    .await
}

impl Shared {
    fn with_store<T>(&self, work: impl FnOnce(&Store) -> Result<T, FindingsError>) -> Result<T, ViewError> {
        // The store keeps nothing in memory that a panic could have left half done.
        let store = self.findings.lock().unwrap_or_else(PoisonError::into_inner);
        Ok(work(&store)?)
    }

    fn export(&self, file: &str) -> Result<Response, ViewError> {
        let all = self.with_store(Store::load)?;
        let panorama = Panorama::open(&self.viewer.out)?;
        let (content_type, body) = match file {
            "findings.csv" => {
                let mut text = Vec::new();
                findings::to_csv(&mut text, &all)
                    .map_err(|source| ViewError::Read { path: "findings.csv".into(), source })?;
                ("text/csv; charset=utf-8", text)
            }
            "findings.geojson" => {
                let json = findings::to_geojson(&all, &panorama.profile);
                ("application/geo+json", format!("{json:#}\n").into_bytes())
            }
            "findings.xml" => {
                let xml = findings::to_en13508_xml(&all, &panorama.spec, &panorama.profile);
                ("application/xml", xml.into_bytes())
            }
            _ => return Ok(refusal(StatusCode::NOT_FOUND, "findings.csv, findings.geojson or findings.xml")),
        };
        let disposition = format!("attachment; filename=\"{file}\"");
        Ok(([(CONTENT_TYPE, content_type.to_owned()), (CONTENT_DISPOSITION, disposition)], body).into_response())
    }
}

fn refusal(status: StatusCode, message: &str) -> Response {
    (status, Json(json!({"error": message}))).into_response()
}

impl IntoResponse for ViewError {
    fn into_response(self) -> Response {
        let status = match &self {
            Self::Findings(FindingsError::Refused(_) | FindingsError::Full) => StatusCode::UNPROCESSABLE_ENTITY,
            Self::Findings(FindingsError::Unknown { .. }) => StatusCode::NOT_FOUND,
            _ => StatusCode::INTERNAL_SERVER_ERROR,
        };
        refusal(status, &scene::chain(&self))
    }
}

impl IntoResponse for files::Served {
    fn into_response(self) -> Response {
        ([(CONTENT_TYPE, self.content_type)], self.bytes).into_response()
    }
}

impl IntoResponse for FileError {
    fn into_response(self) -> Response {
        let status = match &self {
            Self::Refused { .. } => StatusCode::FORBIDDEN,
            Self::Missing { .. } => StatusCode::NOT_FOUND,
            Self::TooLarge { .. } | Self::Read { .. } => StatusCode::INTERNAL_SERVER_ERROR,
        };
        refusal(status, &self.to_string())
    }
}

#[cfg(test)]
mod tests;
