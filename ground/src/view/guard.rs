//! Who is answered: the page itself, and nobody's page on another site.

use std::net::IpAddr;

use axum::extract::Request;
use axum::http::header::{CONTENT_SECURITY_POLICY, HOST, HeaderName, ORIGIN, REFERRER_POLICY, X_CONTENT_TYPE_OPTIONS};
use axum::http::{HeaderMap, HeaderValue, StatusCode};
use axum::middleware::Next;
use axum::response::{IntoResponse, Response};

/// Own script and style, pictures of our own and from memory, nothing else from anywhere.
const POLICY: &str = "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' blob: data:; \
                      connect-src 'self'; base-uri 'none'; form-action 'none'; frame-ancestors 'none'";

/// Why a request is not answered.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub(super) enum Foreign {
    /// A name that may resolve to anything.
    #[error("this server is reached by its IP address or as localhost only")]
    Host,
    /// A page of another origin asks.
    #[error("requests of other sites are refused")]
    Origin,
}

/// Refuses foreign requests, and tells the browser what the page may do.
pub(crate) async fn guard(request: Request, next: Next) -> Response {
    let is_page = request.uri().path() == "/";
    let mut response = match judge(request.headers(), is_page) {
        Ok(()) => next.run(request).await,
        Err(foreign) => (StatusCode::FORBIDDEN, foreign.to_string()).into_response(),
    };
    let headers = response.headers_mut();
    headers.insert(CONTENT_SECURITY_POLICY, HeaderValue::from_static(POLICY));
    headers.insert(X_CONTENT_TYPE_OPTIONS, HeaderValue::from_static("nosniff"));
    headers.insert(REFERRER_POLICY, HeaderValue::from_static("no-referrer"));
    headers.insert(HeaderName::from_static("cross-origin-resource-policy"), HeaderValue::from_static("same-origin"));
    headers.entry("cache-control").or_insert(HeaderValue::from_static("no-cache"));
    response
}

/// Judges by `Host`, `Origin` and, where the browser sends it, `Sec-Fetch-Site`. A link to the page itself is no harm.
fn judge(headers: &HeaderMap, is_page: bool) -> Result<(), Foreign> {
    let text = |name: HeaderName| headers.get(name).map(|value| value.to_str().unwrap_or("?"));
    let host = text(HOST).filter(|host| is_ours(host)).ok_or(Foreign::Host)?;
    if text(ORIGIN).is_some_and(|origin| origin.strip_prefix("http://") != Some(host)) {
        return Err(Foreign::Origin);
    }
    let site = text(HeaderName::from_static("sec-fetch-site"));
    if !is_page && site.is_some_and(|site| site != "same-origin" && site != "none") {
        return Err(Foreign::Origin);
    }
    Ok(())
}

/// An address needs no name service, so nobody else can point it here. Any port: it may be forwarded.
fn is_ours(host: &str) -> bool {
    let name = match host.rsplit_once(':') {
        Some((name, port)) if !port.contains(']') => name,
        _ => host,
    };
    let bare = name.strip_prefix('[').and_then(|name| name.strip_suffix(']')).unwrap_or(name);
    name.eq_ignore_ascii_case("localhost") || bare.parse::<IpAddr>().is_ok()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn judged(headers: &[(&'static str, &'static str)], is_page: bool) -> Result<(), Foreign> {
        let pairs =
            headers.iter().map(|(name, value)| (HeaderName::from_static(name), HeaderValue::from_static(value)));
        judge(&pairs.collect(), is_page)
    }

    #[test]
    fn addresses_and_localhost_are_ours_and_names_are_not() {
        for host in ["127.0.0.1:8080", "localhost:1", "LOCALHOST", "[::1]:8080", "[::1]", "192.168.1.7:80"] {
            assert!(is_ours(host), "{host}");
        }
        for host in ["evil.example", "evil.example:8080", "localhost.evil.example", "127.0.0.1.evil.example", "", ":80"]
        {
            assert!(!is_ours(host), "{host}");
        }
    }

    #[test]
    fn other_origins_are_refused_another_port_of_this_machine_included() {
        assert_eq!(judged(&[("host", "127.0.0.1:80")], false), Ok(()));
        let ours = [("host", "127.0.0.1:8080"), ("origin", "http://127.0.0.1:8080")];
        assert_eq!(judged(&ours, false), Ok(()));
        for origin in ["http://127.0.0.1:3000", "https://evil.example", "null", "http://localhost:8080"] {
            assert_eq!(
                judged(&[("host", "127.0.0.1:8080"), ("origin", origin)], true),
                Err(Foreign::Origin),
                "{origin}"
            );
        }
        assert_eq!(judged(&[("origin", "http://127.0.0.1")], false), Err(Foreign::Host));
    }

    #[test]
    fn a_picture_on_another_site_is_refused_and_a_link_to_the_page_is_not() {
        for site in ["cross-site", "same-site"] {
            let headers = [("host", "127.0.0.1:8080"), ("sec-fetch-site", site)];
            assert_eq!(judged(&headers, false), Err(Foreign::Origin));
            assert_eq!(judged(&headers, true), Ok(()));
        }
        let own = [("host", "127.0.0.1:8080"), ("sec-fetch-site", "same-origin")];
        assert_eq!(judged(&own, false), Ok(()));
    }
}
