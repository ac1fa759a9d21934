//! HTTP server of the page: embedded files, and one websocket per page.
//!
//! It runs on a thread of its own. A connection that sends no request in time is closed, and so is
//! every connection beyond [`CONNECTIONS`].

use crate::access::{is_own_host, is_own_origin};
use crate::assets::{ASSETS, Asset, PAGE};
use crate::hub::Hub;
use crate::page;
use axum::Router;
use axum::extract::ws::WebSocketUpgrade;
use axum::extract::{Request, State};
use axum::http::{HeaderMap, HeaderValue, StatusCode, header};
use axum::middleware::Next;
use axum::response::{IntoResponse as _, Response};
use axum::routing::get;
use hyper_util::rt::{TokioIo, TokioTimer};
use hyper_util::service::TowerToHyperService;
use std::net::{SocketAddr, TcpListener};
use std::sync::Arc;
use std::thread::JoinHandle;
use std::time::Duration;
use tokio::sync::{Semaphore, oneshot};

/// Connections that are served simultaneously.
pub const CONNECTIONS: usize = 64;

/// Pages that are open simultaneously, whoever opens them.
pub const PAGES: usize = 16;

/// Further pages, which have to show the key of a control link: others cannot keep the stop away
/// from the operator.
pub const CONTROL_PAGES: usize = 16;

/// Longest time from the start of a connection to the end of its request's header.
const HEADER_PATIENCE: Duration = Duration::from_secs(5);

/// Longest life of a connection that is not upgraded to a websocket.
const REQUEST_PATIENCE: Duration = Duration::from_secs(20);

/// Largest header of a request, bytes.
const LARGEST_HEADER: usize = 16 * 1024;

/// Longest message of a page, bytes.
const LONGEST_MESSAGE: usize = 4 * 1024;

/// The page may load its own files and open its own websocket, and nothing else.
const POLICY: &str = "default-src 'none'; script-src 'self'; style-src 'self'; \
                      img-src 'self' blob:; connect-src 'self'; base-uri 'none'; \
                      form-action 'none'; frame-ancestors 'none'";

/// Reason why the page cannot be served.
#[derive(Debug, thiserror::Error)]
pub enum LiveError {
    /// The address cannot be listened on.
    #[error("cannot serve the page on {address}: {reason}")]
    Listen {
        /// Address.
        address: SocketAddr,
        /// Cause and way out, in words.
        reason: String,
    },
    /// The address can be reached from other computers, and the page has no control link.
    #[error(
        "{0} can be reached from other computers: add --control, so that only the printed link \
         opens the page, or keep 127.0.0.1 and use `ssh -L`"
    )]
    Open(SocketAddr),
    /// The address of a stream without a key can be reached from other computers.
    #[error(
        "{0} can be reached from other computers, and this stream has no key: keep 127.0.0.1 and \
         use `ssh -L`"
    )]
    Reachable(SocketAddr),
    /// The system refuses a thread or random bytes.
    #[error("cannot serve the page: {0}")]
    System(String),
}

/// Running server. Dropping it closes all pages.
#[derive(Debug)]
pub struct Server {
    address: SocketAddr,
    end: Option<oneshot::Sender<()>>,
    thread: Option<JoinHandle<()>>,
}

/// State of the request handlers.
#[derive(Clone)]
struct Site {
    hub: Arc<Hub>,
    address: SocketAddr,
    pages: Arc<Semaphore>,
    control_pages: Arc<Semaphore>,
}

impl Server {
    /// Listens on `address`, on a free port if its port is 0. Call [`Server::start`] to serve.
    ///
    /// # Errors
    /// [`LiveError::Listen`], for instance if another program has the port; [`LiveError::Open`] if
    /// other computers reach the address, unless `has_control`.
    pub fn listen(address: SocketAddr, has_control: bool) -> Result<TcpListener, LiveError> {
        if !address.ip().is_loopback() && !has_control {
            return Err(LiveError::Open(address));
        }
        TcpListener::bind(address).map_err(|cause| {
            let reason = match cause.kind() {
                std::io::ErrorKind::AddrInUse => "the port is in use by another program, perhaps \
                     another run with a page; open that page, or choose another port with \
                     --listen ADDR:PORT"
                    .to_owned(),
                std::io::ErrorKind::AddrNotAvailable => {
                    "this computer has no such address; use 127.0.0.1".to_owned()
                }
                std::io::ErrorKind::PermissionDenied => {
                    "the system does not allow it; choose a port from 1024 on".to_owned()
                }
                _ => cause.to_string(),
            };
            LiveError::Listen { address, reason }
        })
    }

    /// Serves the pages of `hub` until the server is dropped.
    ///
    /// # Errors
    /// [`LiveError::System`] if its thread cannot be started.
    pub fn start(listener: TcpListener, hub: Arc<Hub>) -> Result<Self, LiveError> {
        let failed = |cause: std::io::Error| LiveError::System(cause.to_string());
        let address = listener.local_addr().map_err(failed)?;
        listener.set_nonblocking(true).map_err(failed)?;
        let runtime = tokio::runtime::Builder::new_current_thread()
            .enable_all()
            .build()
            .map_err(failed)?;
        let (end, ended) = oneshot::channel();
        let run = move || {
            runtime.block_on(async move {
                tokio::select! {
                    () = serve(listener, hub, address) => {}
                    _ = ended => {}
                }
            });
            // Tasks of open pages end with the runtime.
            runtime.shutdown_background();
        };
        let name = "live page".to_owned();
        let thread = std::thread::Builder::new().name(name).spawn(run);
        Ok(Self {
            address,
            end: Some(end),
            thread: Some(thread.map_err(failed)?),
        })
    }

    /// Returns the address that the page is served on.
    pub fn address(&self) -> SocketAddr {
        self.address
    }

    /// Returns the URL of the page for a browser on this computer; with a token, the control link.
    pub fn url(address: SocketAddr, token: Option<&str>) -> String {
        let mut place = address;
        if address.ip().is_unspecified() {
            place.set_ip(std::net::Ipv4Addr::LOCALHOST.into());
        }
        match token {
            Some(token) => format!("http://{place}/#control={token}"),
            None => format!("http://{place}/"),
        }
    }
}

impl Drop for Server {
    fn drop(&mut self) {
        drop(self.end.take());
        if let Some(thread) = self.thread.take() {
            let _ = thread.join();
        }
    }
}

/// Accepts connections until the end.
async fn serve(listener: TcpListener, hub: Arc<Hub>, address: SocketAddr) {
    let Ok(listener) = tokio::net::TcpListener::from_std(listener) else {
        return;
    };
    let site = Site {
        hub,
        address,
        pages: Arc::new(Semaphore::new(PAGES)),
        control_pages: Arc::new(Semaphore::new(CONTROL_PAGES)),
    };
    let router = router(site);
    let connections = Arc::new(Semaphore::new(CONNECTIONS));
    loop {
        let Ok((stream, _)) = listener.accept().await else {
            // The system is out of files for the moment.
            tokio::time::sleep(Duration::from_millis(50)).await;
            continue;
        };
        let Ok(permit) = Arc::clone(&connections).try_acquire_owned() else {
            continue;
        };
        // A page gets each message at once.
        let _ = stream.set_nodelay(true);
        let service = TowerToHyperService::new(router.clone());
        tokio::spawn(async move {
            let connection = hyper::server::conn::http1::Builder::new()
                .timer(TokioTimer::new())
                .header_read_timeout(HEADER_PATIENCE)
                .max_buf_size(LARGEST_HEADER)
                .serve_connection(TokioIo::new(stream), service)
                .with_upgrades();
            // An upgraded connection leaves this task at once; its page has a permit of its own.
            let _ = tokio::time::timeout(REQUEST_PATIENCE, connection).await;
            drop(permit);
        });
    }
}

fn router(site: Site) -> Router {
    let mut router = Router::new()
        .route("/", get(|| async { file(PAGE) }))
        .route("/live", get(live))
        .route("/state.json", get(state));
    for asset in ASSETS {
        router = router.route(asset.path, get(move || async move { file(asset) }));
    }
    router
        .layer(axum::middleware::from_fn_with_state(site.clone(), guard))
        .with_state(site)
}

/// Refuses requests that were not meant for this server, and adds the headers of every response.
async fn guard(State(site): State<Site>, request: Request, next: Next) -> Response {
    let host = text(request.headers(), header::HOST);
    let mut response = match is_own_host(host, site.address) {
        true => next.run(request).await,
        false => refuse(
            StatusCode::FORBIDDEN,
            "this host name is not this computer's; use 127.0.0.1 or localhost",
        ),
    };
    let headers = response.headers_mut();
    for (name, value) in [
        (header::CONTENT_SECURITY_POLICY, POLICY),
        (header::X_CONTENT_TYPE_OPTIONS, "nosniff"),
        (header::REFERRER_POLICY, "no-referrer"),
        (header::CACHE_CONTROL, "no-store"),
        (header::X_FRAME_OPTIONS, "DENY"),
    ] {
        headers.insert(name, HeaderValue::from_static(value));
    }
    for (name, value) in [
        ("cross-origin-opener-policy", "same-origin"),
        ("cross-origin-resource-policy", "same-origin"),
    ] {
        headers.insert(name, HeaderValue::from_static(value));
    }
    response
}

/// Opens the websocket of a page.
async fn live(State(site): State<Site>, headers: HeaderMap, upgrade: WebSocketUpgrade) -> Response {
    let (origin, host) = (text(&headers, header::ORIGIN), text(&headers, header::HOST));
    if !is_own_origin(origin, host) {
        return refuse(StatusCode::FORBIDDEN, "only the page itself may connect");
    }
    let for_all = site.pages.try_acquire_owned();
    let is_open = for_all.is_ok() && site.address.ip().is_loopback();
    let Ok(permit) = for_all.or_else(|_| site.control_pages.try_acquire_owned()) else {
        let reason = "too many pages are open; close one";
        return refuse(StatusCode::SERVICE_UNAVAILABLE, reason);
    };
    upgrade
        .max_message_size(LONGEST_MESSAGE)
        .max_frame_size(LONGEST_MESSAGE)
        .on_upgrade(move |socket| async move {
            page::attend(socket, site.hub, is_open).await;
            drop(permit);
        })
}

/// Returns the latest state without samples, for scripts on this computer.
async fn state(State(site): State<Site>) -> Response {
    if !site.address.ip().is_loopback() {
        return refuse(StatusCode::FORBIDDEN, "only on 127.0.0.1");
    }
    let (state, _, _) = site.hub.state_since(u64::MAX, 0);
    (
        [(header::CONTENT_TYPE, "application/json")],
        state.to_string(),
    )
        .into_response()
}

fn file(asset: Asset) -> Response {
    ([(header::CONTENT_TYPE, asset.kind)], asset.text).into_response()
}

fn refuse(status: StatusCode, reason: &'static str) -> Response {
    (status, format!("{reason}\n")).into_response()
}

fn text(headers: &HeaderMap, name: header::HeaderName) -> Option<&str> {
    headers.get(name).and_then(|value| value.to_str().ok())
}
