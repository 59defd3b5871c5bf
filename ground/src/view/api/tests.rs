use std::fs;
use std::path::Path as FilePath;

use adit_geometry::profile::ProfileSpec;
use axum::body::{Body, to_bytes};
use axum::http::Request;
use serde_json::Value;
use tower::ServiceExt as _;

use super::*;
use crate::texture::{PanoramaGrid, write_png};

/// A survey folder with the least that can be shown, a photo, and a secret outside.
fn survey() -> (tempfile::TempDir, Router) {
    let folder = tempfile::tempdir().unwrap();
    let survey = folder.path().join("survey");
    let out = survey.join("out");
    fs::create_dir_all(out.join("panorama/tiles/panorama_files/0")).unwrap();
    fs::create_dir_all(survey.join("photos")).unwrap();
    fs::write(folder.path().join("secret.json"), "{}").unwrap();
    fs::write(survey.join("survey.toml"), "").unwrap();
    fs::write(survey.join("photos/A.JPG"), [0xFF, 0xD8, 0xFF]).unwrap();
    let spec = ProfileSpec::Circle { radius_m: 1.0 };
    let grid = PanoramaGrid::new(spec.build().unwrap().perimeter_m(), 20.0, 0.0, 4.0);
    fs::write(out.join("panorama/panorama.json"), grid.to_json(&spec).to_string()).unwrap();
    write_png(&out.join("panorama/tiles/panorama_files/0/0_0.png"), 1, 1, &[1, 2, 3, 255]).unwrap();
    let router = router(Viewer::open(&out).unwrap());
    (folder, router)
}

async fn ask(router: &Router, method: &str, path: &str, body: Option<Value>) -> (StatusCode, Value) {
    let request = Request::builder().method(method).uri(path).header("host", "127.0.0.1:1");
    let request = match body {
        Some(json) => request.header("content-type", "application/json").body(Body::from(json.to_string())),
        None => request.body(Body::empty()),
    };
    let response = router.clone().oneshot(request.unwrap()).await.unwrap();
    let status = response.status();
    assert!(response.headers()["content-security-policy"].to_str().unwrap().contains("default-src 'none'"));
    let bytes = to_bytes(response.into_body(), 1 << 20).await.unwrap();
    (status, serde_json::from_slice(&bytes).unwrap_or(Value::Null))
}

fn example() -> Value {
    json!({"observation": findings::example()})
}

#[tokio::test]
async fn the_scene_says_what_is_there_and_notes_what_is_not() {
    let (_folder, router) = survey();
    let (status, scene) = ask(&router, "GET", "/api/scene", None).await;
    assert_eq!(status, StatusCode::OK);
    assert_eq!((&scene["name"], &scene["tile_px"], &scene["relief"]), (&json!("survey"), &json!(256), &Value::Null));
    assert_eq!(scene["last_level"], 9);
    let notes = scene["notes"].to_string();
    assert!(notes.contains("poses.csv") && notes.contains("coverage.json"), "{notes}");
}

#[tokio::test]
async fn tiles_and_photos_are_served_and_nothing_from_outside() {
    let (folder, router) = survey();
    let status = async |path: &str| ask(&router, "GET", path, None).await.0;
    assert_eq!(status("/files/panorama/tiles/panorama_files/0/0_0.png").await, StatusCode::OK);
    assert_eq!(status("/photos/A.JPG").await, StatusCode::OK);
    assert_eq!(status("/files/panorama/tiles/panorama_files/9/0_0.png").await, StatusCode::NOT_FOUND);
    assert!(folder.path().join("secret.json").is_file());
    for path in [
        "/files/../../secret.json",
        "/files/..%2F..%2Fsecret.json",
        "/files/%2e%2e/%2e%2e/secret.json",
        "/files/panorama/..%5c..%5c..%5csecret.json",
        "/files//etc/hostname.json",
        "/files/%2Fetc%2Fhostname.json",
        "/photos/..%2Fout%2Fpanorama%2Fpanorama.json",
        "/photos/..%2F..%2Fsecret.json",
    ] {
        assert_eq!(status(path).await, StatusCode::FORBIDDEN, "{path}");
    }
}

#[tokio::test]
async fn a_finding_is_kept_changed_exported_and_removed() {
    let (folder, router) = survey();
    let (status, added) = ask(&router, "POST", "/api/findings", Some(example())).await;
    assert_eq!((status, &added["id"]), (StatusCode::CREATED, &json!(1)));
    let mut changed = example()["observation"].clone();
    changed["note"] = json!("<script>alert(1)</script>");
    assert_eq!(ask(&router, "PUT", "/api/findings/1", Some(changed)).await.0, StatusCode::OK);
    let kept = fs::read_to_string(folder.path().join("survey/out/findings.json")).unwrap();
    assert!(kept.contains("<script>"), "as written, escaped only where it is shown");
    let (_, list) = ask(&router, "GET", "/api/findings", None).await;
    assert_eq!(list["findings"][0]["clock_from"], 11.0);
    let (_, geojson) = ask(&router, "GET", "/api/export/findings.geojson", None).await;
    assert_eq!(geojson["features"][0]["properties"]["severity"], 3);
    assert_eq!(ask(&router, "DELETE", "/api/findings/1", None).await.0, StatusCode::NO_CONTENT);
    assert_eq!(ask(&router, "DELETE", "/api/findings/1", None).await.0, StatusCode::NOT_FOUND);
}

#[tokio::test]
async fn what_is_wrong_or_too_large_is_refused_with_a_reason() {
    let (_folder, router) = survey();
    let mut wrong = example();
    wrong["observation"]["severity"] = json!(9);
    let (status, answer) = ask(&router, "POST", "/api/findings", Some(wrong)).await;
    assert_eq!(status, StatusCode::UNPROCESSABLE_ENTITY);
    assert!(answer["error"].as_str().unwrap().contains("severity is 9"));
    let mut large = example();
    large["snapshot"] = json!("A".repeat(LARGEST_BODY_BYTES));
    assert_eq!(ask(&router, "POST", "/api/findings", Some(large)).await.0, StatusCode::PAYLOAD_TOO_LARGE);
    let (_, list) = ask(&router, "GET", "/api/findings", None).await;
    assert_eq!(list["findings"], json!([]));
}

#[tokio::test]
async fn another_sites_page_can_neither_read_nor_write() {
    let (folder, router) = survey();
    for (host, origin) in [("127.0.0.1:1", "http://evil.example"), ("evil.example:1", "http://evil.example:1")] {
        for (method, path) in [("GET", "/api/scene"), ("POST", "/api/findings"), ("GET", "/files/coverage.png")] {
            let request = Request::builder().method(method).uri(path).header("host", host).header("origin", origin);
            let request = request.header("content-type", "application/json").body(Body::from(example().to_string()));
            let response = router.clone().oneshot(request.unwrap()).await.unwrap();
            assert_eq!(response.status(), StatusCode::FORBIDDEN, "{method} {path} to {host}");
            assert!(!response.headers().contains_key("access-control-allow-origin"));
        }
    }
    assert!(!folder.path().join("survey/out/findings.json").exists());
    // A form of another site can send text, but not JSON.
    let request = Request::builder().method("POST").uri("/api/findings").header("host", "127.0.0.1:1");
    let request = request.header("content-type", "text/plain").body(Body::from(example().to_string())).unwrap();
    assert_eq!(router.oneshot(request).await.unwrap().status(), StatusCode::UNSUPPORTED_MEDIA_TYPE);
}

#[tokio::test]
async fn the_server_ends_when_told_and_a_port_in_use_is_named() {
    let (folder, _) = survey();
    let viewer = Viewer::open(&FilePath::new(folder.path()).join("survey/out")).unwrap();
    let listener = super::super::listen("127.0.0.1:0".parse().unwrap()).await.unwrap();
    let address = listener.local_addr().unwrap();
    let message = super::super::listen(address).await.unwrap_err().to_string();
    assert!(message.contains("another program listens") && message.contains("--listen"), "{message}");
    let (stop, stopped) = tokio::sync::oneshot::channel::<()>();
    let served = tokio::spawn(viewer.serve(listener, async move { drop(stopped.await) }));
    stop.send(()).unwrap();
    served.await.unwrap().unwrap();
}
