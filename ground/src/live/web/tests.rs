use adit_protocol::mavlink::Severity;
use axum::body::{Body, to_bytes};
use axum::http::Request as Asked;
use serde_json::Value;
use tower::ServiceExt;

use super::*;
use crate::live::enactment::Flight;
use crate::live::picture::Picture;

const HOST: (&str, &str) = ("host", "127.0.0.1:8080");

async fn answer(token: Option<&str>, path: &str, headers: &[(&str, &str)]) -> (StatusCode, String) {
    let (_frames, shown) = watch::channel(Arc::default());
    let page = Page::new(shown, token.map(|token| Token(token.to_owned())));
    let mut request = Asked::get(path);
    for (name, value) in headers {
        request = request.header(*name, *value);
    }
    let response = page.router().oneshot(request.body(Body::empty()).unwrap()).await.unwrap();
    let status = response.status();
    (status, String::from_utf8(to_bytes(response.into_body(), 1 << 20).await.unwrap().to_vec()).unwrap())
}

#[tokio::test]
async fn the_page_is_for_this_machine_without_and_for_others_with_its_token() {
    assert_eq!(answer(None, "/", &[HOST]).await.0, StatusCode::OK);
    for path in ["/", "/live", "/?token=", "/?token=0123", "/?token=01234567x", "/live?token=x", "/live?other=01234567"]
    {
        let (status, words) = answer(Some("01234567"), path, &[HOST]).await;
        assert_eq!(status, StatusCode::UNAUTHORIZED, "{path}");
        assert!(!words.contains("01234567") && words.contains("token"), "{words}");
    }
    let (status, page) = answer(Some("01234567"), "/?token=01234567", &[HOST]).await;
    assert_eq!(status, StatusCode::OK);
    assert!(page.contains("live.js") && !page.contains("http://"), "nothing comes from elsewhere");
    assert_eq!(answer(Some("01234567"), "/live.js", &[HOST]).await.0, StatusCode::OK);
}

#[tokio::test]
async fn pages_of_other_origins_get_no_socket_token_or_not() {
    let socket = [
        HOST,
        ("connection", "upgrade"),
        ("upgrade", "websocket"),
        ("sec-websocket-version", "13"),
        ("sec-websocket-key", "dGhlIHNhbXBsZSBub25jZQ=="),
    ];
    for origin in ["http://evil.example", "http://127.0.0.1:9999", "null"] {
        let headers = [&socket[..], &[("origin", origin)]].concat();
        assert_eq!(answer(None, "/live", &headers).await.0, StatusCode::FORBIDDEN, "{origin}");
        assert_eq!(answer(Some("0"), "/live?token=0", &headers).await.0, StatusCode::FORBIDDEN, "{origin}");
    }
    assert_eq!(answer(None, "/live", &[("host", "rebound.example")]).await.0, StatusCode::FORBIDDEN);
}

#[test]
fn tokens_are_long_and_never_the_same() {
    let (one, other) = (Token::random().unwrap(), Token::random().unwrap());
    assert!(one.0.len() == 2 * TOKEN_BYTES && one != other && one.admits(&one.0) && !one.admits(&other.0));
    assert!(!format!("{one:?}").contains(&one.0));
}

fn update(updates: &mut Updates, flight: &Flight) -> Value {
    let strip = Picture::of(flight.state.strip().unwrap(), &Picture::default());
    let frame = Frame { view: flight.state.show(flight.now), strip: Arc::new(strip) };
    serde_json::from_str(&updates.next(&frame).unwrap()).unwrap()
}

#[test]
fn a_page_gets_the_section_once_and_of_the_strip_what_changed() {
    let (mut flight, mut updates) = (Flight::new(), Updates::default());
    (1..=100).for_each(|capture| flight.photo(capture, true));
    let first = update(&mut updates, &flight);
    assert!(first["outline_m"].as_array().unwrap().len() > 50);
    let stretches = |update: &Value| update["strip"]["stretches"].as_array().unwrap().len();
    assert!(stretches(&first) >= 4);
    let second = update(&mut updates, &flight);
    assert_eq!((stretches(&second), second.get("outline_m")), (0, None));
    flight.photo(101, true);
    let changed = stretches(&update(&mut updates, &flight));
    assert!(changed > 0 && changed < stretches(&first), "{changed}");
}

#[test]
fn markup_in_the_boards_words_reaches_the_page_as_words() {
    let mut flight = Flight::new();
    flight.say(Severity::Error, "<script>alert(1)</script><img src=x onerror=a>");
    let update = update(&mut Updates::default(), &flight);
    assert_eq!(update["view"]["notices"][0]["text"], "<script>alert(1)</script><img src=x onerror=a>");
}

/// A page that takes nothing costs pictures, not memory: only the newest frame is kept for it.
#[tokio::test]
async fn a_page_that_is_slow_gets_the_newest_frame() {
    let (frames, mut shown) = watch::channel(Arc::new(Frame::default()));
    for time_s in 0..1000 {
        let mut frame = Frame::default();
        frame.view.time_s = f64::from(time_s);
        frames.send_replace(Arc::new(frame));
    }
    shown.changed().await.unwrap();
    assert_eq!(shown.borrow_and_update().view.time_s, 999.0);
    assert!(!shown.has_changed().unwrap());
}
