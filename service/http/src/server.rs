//! The accept loop: its own, because `axum::serve` has no timer, no limits, and lets a slow peer
//! hold a connection for ever.

use std::convert::Infallible;
use std::io::{self, ErrorKind};
use std::net::{IpAddr, SocketAddr};
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
use tokio::net::{TcpListener, TcpSocket, TcpStream};
use tokio_util::sync::CancellationToken;
use tower::ServiceExt;

use super::client_address::PeerAddress;
use super::connections::{Connections, Place, Turned};
use super::progress::{BodyAwaited, Held, Watched, WritePatience};

/// Wait after a failed accept, which mostly means that the process has no file left to open.
const ACCEPT_RETRY: Duration = Duration::from_millis(100);
/// Connections whose peer is overdue are looked for this often.
const OVERDUE_EVERY: Duration = Duration::from_millis(500);
/// Requests that are under way at a shutdown may take this long.
const DRAIN_TIMEOUT: Duration = Duration::from_secs(2);

/// Listens on an address, where more connections can wait to be accepted than come at once in a
/// flood: the system answers no further ones, and their clients ask again only after seconds.
///
/// # Errors
/// When the address is in use, or cannot be listened on.
pub fn listen(address: SocketAddr) -> io::Result<TcpListener> {
    let socket = match address {
        SocketAddr::V4(_) => TcpSocket::new_v4()?,
        SocketAddr::V6(_) => TcpSocket::new_v6()?,
    };
    // A restart must not wait for the connections of the run before.
    socket.set_reuseaddr(true)?;
    socket.bind(address)?;
    socket.listen(limits::HTTP_BACKLOG)
}

/// The address of this machine that a connection came to.
#[derive(Debug, Clone, Copy)]
pub struct LocalAddress(pub Option<IpAddr>);

/// What is served.
#[derive(Debug, Clone)]
pub struct Served {
    /// The routes.
    pub routes: Router,
    /// Whether a path is a probe's, which is answered whatever else is under way.
    pub is_probe: fn(&str) -> bool,
    /// The answer to a request without a place. The connection ends with it.
    pub turned_away: fn(Turned) -> Response,
}

/// Serves on a listener until `stop`, then lets requests that are under way finish.
///
/// The future is compiled in this crate, and not in each that awaits it.
pub fn serve(
    listener: TcpListener,
    served: Served,
    connections: Connections,
    stop: CancellationToken,
) -> Pin<Box<dyn Future<Output = ()> + Send>> {
    Box::pin(accept_all(listener, served, connections, stop))
}

async fn accept_all(
    listener: TcpListener,
    served: Served,
    connections: Connections,
    stop: CancellationToken,
) {
    let graceful = GracefulShutdown::new();
    let sweep = tokio::spawn(cut_overdue(connections.clone(), stop.clone()));
    while let Some((socket, place)) = accept(&listener, &connections, &stop).await {
        tokio::spawn(serve_connection(
            socket,
            place,
            served.clone(),
            graceful.watcher(),
        ));
    }
    drop(listener);
    if tokio::time::timeout(DRAIN_TIMEOUT, graceful.shutdown())
        .await
        .is_err()
    {
        tracing::warn!("some HTTP requests were cut off by the shutdown");
    }
    sweep.abort();
}

async fn cut_overdue(connections: Connections, stop: CancellationToken) {
    let mut ticks = tokio::time::interval(OVERDUE_EVERY);
    while !stop.is_cancelled() {
        ticks.tick().await;
        connections.cut_overdue();
    }
}

/// The next connection that has a place; `None` at `stop`. It never waits for a place, or probes
/// would wait behind everybody else.
async fn accept(
    listener: &TcpListener,
    connections: &Connections,
    stop: &CancellationToken,
) -> Option<(TcpStream, Arc<Place>)> {
    let next = async {
        loop {
            match listener.accept().await {
                Ok((socket, peer)) => match connections.admit(PeerAddress(Some(peer.ip()))) {
                    Ok(place) => return (socket, place),
                    Err(reason) => connections.count(reason),
                },
                Err(error) if is_of_peer(error.kind()) => {}
                Err(error) => {
                    tracing::error!(%error, "an HTTP connection could not be accepted");
                    connections.make_room();
                    tokio::time::sleep(ACCEPT_RETRY).await;
                }
            }
        }
    };
    tokio::select! {
        () = stop.cancelled() => None,
        next = next => Some(next),
    }
}

/// Whether an accept failed because the client had gone already.
const fn is_of_peer(kind: ErrorKind) -> bool {
    matches!(
        kind,
        ErrorKind::ConnectionAborted | ErrorKind::ConnectionReset | ErrorKind::ConnectionRefused
    )
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
            if error.is_timeout() {
                place.connections().count(Turned::HeaderTimeout);
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
    let client = place
        .peer()
        .behind(&parts.headers, place.connections().trusted());
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
