//! Serving connections: our own, because `axum::serve` has no timer, no limits, and lets a slow
//! peer hold a connection for ever.

use std::convert::Infallible;
use std::io;
use std::net::IpAddr;
use std::pin::Pin;
use std::sync::Arc;
use std::time::Duration;

use axum::Router;
use axum::body::Body;
use axum::http::{HeaderValue, Request, header};
use axum::response::Response;
use fleetcal_domain::limits;
use hyper::body::{Body as _, Incoming};
use hyper::server::conn::http1;
use hyper::service::service_fn;
use hyper_util::rt::{TokioIo, TokioTimer};
use hyper_util::server::graceful::{GracefulShutdown, Watcher};
use tokio::net::{TcpListener, TcpStream};
use tokio::sync::mpsc;
use tokio_util::sync::CancellationToken;
use tower::ServiceExt;

use super::acceptor::{self, Accepted};
use super::connections::{Connections, Place};
use super::progress::{BodyAwaited, Held, Watched, WritePatience};
use super::refusal::Turned;

/// Interval of the search for connections whose peer is overdue.
const OVERDUE_EVERY: Duration = Duration::from_millis(500);
/// Longest time that requests in progress may take at a shutdown.
const DRAIN_TIMEOUT: Duration = Duration::from_secs(2);

/// Address of this machine that a connection came to.
#[derive(Debug, Clone, Copy)]
pub struct LocalAddress(pub Option<IpAddr>);

/// Routes and responses of the server.
#[derive(Debug, Clone)]
pub struct Served {
    /// The routes.
    pub routes: Router,
    /// True for the path of a probe, which is answered whatever else is in progress.
    pub is_probe: fn(&str) -> bool,
    /// Makes the response to a request without a place. The connection ends with it.
    pub turned_away: fn(Turned) -> Response,
}

/// Future that serves connections until its stop.
pub type Serving = Pin<Box<dyn Future<Output = ()> + Send>>;

/// Begins to accept on a listener; the future serves until `stop`, then lets the requests in
/// progress finish.
///
/// The future is compiled in this crate instead of each that awaits it.
///
/// # Errors
/// The system refuses to create the accepting thread.
pub fn serve(
    listener: TcpListener,
    served: Served,
    connections: Connections,
    stop: CancellationToken,
) -> io::Result<Serving> {
    let accepted = acceptor::begin(listener, connections.clone(), stop.clone())?;
    Ok(Box::pin(serve_all(accepted, served, connections, stop)))
}

async fn serve_all(
    mut accepted: mpsc::Receiver<Accepted>,
    served: Served,
    connections: Connections,
    stop: CancellationToken,
) {
    let graceful = GracefulShutdown::new();
    let cutter = tokio::spawn(cut_overdue(connections, stop));
    // It ends when nothing is accepted any more.
    while let Some((socket, place)) = accepted.recv().await {
        let watcher = graceful.watcher();
        match TcpStream::from_std(socket) {
            Ok(socket) => {
                tokio::spawn(serve_connection(socket, place, served.clone(), watcher));
            }
            Err(error) => tracing::debug!(%error, "a connection was lost"),
        }
    }
    if tokio::time::timeout(DRAIN_TIMEOUT, graceful.shutdown())
        .await
        .is_err()
    {
        tracing::warn!("some HTTP requests were cut off by the shutdown");
    }
    cutter.abort();
}

async fn cut_overdue(connections: Connections, stop: CancellationToken) {
    let mut ticks = tokio::time::interval(OVERDUE_EVERY);
    while !stop.is_cancelled() {
        ticks.tick().await;
        connections.cut_overdue();
    }
}

async fn serve_connection(socket: TcpStream, place: Arc<Place>, served: Served, watcher: Watcher) {
    let local = LocalAddress(socket.local_addr().ok().map(|address| address.ip()));
    let socket = Watched::new(socket, Arc::clone(place.progress()));
    let answered = Arc::clone(&place);
    let service = service_fn(move |request| {
        let (served, place) = (served.clone(), Arc::clone(&answered));
        async move { Ok::<_, Infallible>(answer(served, place, local, request).await) }
    });
    let mut builder = http1::Builder::new();
    builder
        .timer(TokioTimer::new())
        .header_read_timeout(limits::HTTP_HEADER_TIMEOUT)
        .max_buf_size(limits::HTTP_HEADER_BYTES_MAX);
    let serving = watcher.watch(builder.serve_connection(TokioIo::new(socket), service));
    tokio::select! {
        served = serving => if let Err(error) = served {
            // Hyper's own clock may be a moment ahead of the scan.
            if error.is_timeout() {
                place.connections().count(place.progress().header_overdue().into());
            }
            tracing::debug!(%error, "an HTTP connection ended early");
        },
        () = place.cut() => {}
    }
}

/// Answers one request, once there is a place for it.
async fn answer(
    served: Served,
    place: Arc<Place>,
    local: LocalAddress,
    request: Request<Incoming>,
) -> Response {
    let progress = Arc::clone(place.progress());
    let (mut parts, body) = request.into_parts();
    let (trusted, instances) = place.connections().believed();
    let client = place.peer().behind(&parts.headers, trusted, instances);
    progress.request_begins(!body.is_end_stream());
    let under_way = match place.begin(client, (served.is_probe)(parts.uri.path())) {
        Ok(under_way) => under_way,
        Err(reason) => {
            place.connections().count(reason);
            let mut response = (served.turned_away)(reason);
            let close = HeaderValue::from_static("close");
            response.headers_mut().insert(header::CONNECTION, close);
            return response;
        }
    };
    parts.extensions.insert(client);
    parts.extensions.insert(local);
    let body = if body.is_end_stream() {
        Body::new(body)
    } else {
        Held::body(body, BodyAwaited(Arc::clone(&progress)))
    };
    let Ok(response) = served
        .routes
        .oneshot(Request::from_parts(parts, body))
        .await;
    if let Some(WritePatience(patience)) = response.extensions().get() {
        progress.be_patient(*patience);
    }
    response.map(|body| Held::body(body, under_way))
}
