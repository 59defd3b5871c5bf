//! The page for a tablet: the same as on the terminal, over a WebSocket.
//!
//! # Trust
//! As the viewer's ([`crate::view`]): only requests addressed to an IP address or `localhost` are answered, and only the page's
//! own. Whoever can reach an address beyond this machine needs the token too, which the page's address carries. The page takes
//! nothing from its visitors, and shows words of the link as text, never as markup. Nothing is fetched from elsewhere.

mod update;

use std::future::{Future, ready};
use std::net::SocketAddr;
use std::sync::Arc;
use std::time::Duration;

use axum::Router;
use axum::extract::ws::{Message, WebSocket, WebSocketUpgrade};
use axum::extract::{Query, Request, State};
use axum::http::StatusCode;
use axum::http::header::CONTENT_TYPE;
use axum::middleware::{self, Next};
use axum::response::{IntoResponse, Response};
use axum::routing::get;
use serde::Deserialize;
use tokio::net::TcpListener;
use tokio::sync::{Semaphore, watch};
use tokio::time::timeout;

use super::feed::Frame;
use crate::view::{ViewError, guard};
use update::Updates;

/// The page, as `cargo xtask viewer` builds it.
const PAGE: &str = include_str!("../../../viewer/dist/live.html");
const SCRIPT: &str = include_str!("../../../viewer/dist/live.js");
const STYLE: &str = include_str!("../../../viewer/dist/live.css");

/// Pages that are open at once.
const MOST_PAGES: usize = 16;
/// A page that takes nothing for so long is gone.
const PATIENCE: Duration = Duration::from_secs(5);
/// Pages say nothing; what is longer than a greeting is not theirs.
const LONGEST_WORD: usize = 1024;
/// Random bytes of a token: nobody guesses 128 bits.
const TOKEN_BYTES: usize = 16;

/// What a visitor must know.
#[derive(Clone, PartialEq, Eq)]
pub struct Token(String);

impl std::fmt::Debug for Token {
    fn fmt(&self, out: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        // Debugging output ends up in logs.
        out.write_str("Token")
    }
}

impl Token {
    /// A new one.
    ///
    /// # Errors
    /// If the system has no random numbers.
    pub fn random() -> Result<Self, getrandom::Error> {
        let mut bytes = [0; TOKEN_BYTES];
        getrandom::fill(&mut bytes)?;
        Ok(Self(format!("{:032x}", u128::from_be_bytes(bytes))))
    }

    /// Whether this is it; takes the same time whichever letter is wrong.
    fn admits(&self, given: &str) -> bool {
        let differing =
            self.0.bytes().zip(given.bytes()).fold(0, |differing, (ours, theirs)| differing | (ours ^ theirs));
        self.0.len() == given.len() && differing == 0
    }
}

/// The page's server.
#[derive(Clone, Debug)]
pub struct Page {
    shown: watch::Receiver<Arc<Frame>>,
    token: Option<Token>,
    places: Arc<Semaphore>,
}

#[derive(Deserialize)]
struct Visit {
    #[serde(default)]
    token: String,
}

impl Page {
    /// Shows what there is, to whoever knows the token if there is one.
    pub fn new(shown: watch::Receiver<Arc<Frame>>, token: Option<Token>) -> Self {
        Self { shown, token, places: Arc::new(Semaphore::new(MOST_PAGES)) }
    }

    /// The page's address for a visitor.
    pub fn address(&self, at: SocketAddr) -> String {
        match &self.token {
            Some(Token(token)) => format!("http://{at}/?token={token}"),
            None => format!("http://{at}/"),
        }
    }

    /// Answers requests until `stop` completes.
    ///
    /// # Errors
    /// [`ViewError::Serve`] if the system closes the socket.
    pub async fn serve(
        self,
        listener: TcpListener,
        stop: impl Future<Output = ()> + Send + 'static,
    ) -> Result<(), ViewError> {
        let server = axum::serve(listener, self.router());
        tokio::select! {
            // Pages that are open would hold up an end in good order.
            served = server.into_future() => served.map_err(|source| ViewError::Serve { source }),
            () = stop => Ok(()),
        }
    }

    fn router(self) -> Router {
        Router::new()
            .route("/", get(|| ready(fixed("text/html; charset=utf-8", PAGE))))
            .route("/live", get(attend))
            .route_layer(middleware::from_fn_with_state(self.clone(), doorman))
            // No secret is in these.
            .route("/live.js", get(|| ready(fixed("text/javascript; charset=utf-8", SCRIPT))))
            .route("/live.css", get(|| ready(fixed("text/css; charset=utf-8", STYLE))))
            .layer(middleware::from_fn(guard::guard))
            .with_state(self)
    }
}

fn fixed(content_type: &'static str, body: &'static str) -> Response {
    ([(CONTENT_TYPE, content_type)], body).into_response()
}

/// Asks for the token.
async fn doorman(State(page): State<Page>, Query(visit): Query<Visit>, request: Request, next: Next) -> Response {
    match &page.token {
        Some(token) if !token.admits(&visit.token) => {
            let words = "the page's address needs its token: open the address that `adit live` shows";
            (StatusCode::UNAUTHORIZED, words).into_response()
        }
        _ => next.run(request).await,
    }
}

async fn attend(State(page): State<Page>, upgrade: WebSocketUpgrade) -> Response {
    let Ok(place) = Arc::clone(&page.places).try_acquire_owned() else {
        return (StatusCode::SERVICE_UNAVAILABLE, "too many pages are open").into_response();
    };
    upgrade.max_message_size(LONGEST_WORD).on_upgrade(async move |socket| {
        show(socket, page.shown).await;
        drop(place);
    })
}

/// Sends the newest frame whenever there is one and the page has taken the one before.
async fn show(mut socket: WebSocket, mut shown: watch::Receiver<Arc<Frame>>) {
    let mut updates = Updates::default();
    shown.mark_changed();
    loop {
        tokio::select! {
            changed = shown.changed() => {
                let frame = Arc::clone(&shown.borrow_and_update());
                let Some(text) = updates.next(&frame) else { return };
                let sent = timeout(PATIENCE, socket.send(Message::Text(text.into()))).await;
                if changed.is_err() || !matches!(sent, Ok(Ok(()))) {
                    return;
                }
            }
            said = socket.recv() => {
                // Pings are answered by the library; a page has nothing else to say.
                if !matches!(said, Some(Ok(Message::Ping(_) | Message::Pong(_)))) {
                    return;
                }
            }
        }
    }
}

#[cfg(test)]
mod tests;
