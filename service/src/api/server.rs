//! The accept loop: its own, because `axum::serve` has no timer and lets a slow header hold a
//! connection for ever.

use std::io::ErrorKind;
use std::sync::Arc;
use std::time::Duration;

use axum::{Extension, Router};
use hyper::server::conn::http1;
use hyper_util::rt::{TokioIo, TokioTimer};
use hyper_util::server::graceful::{GracefulShutdown, Watcher};
use hyper_util::service::TowerToHyperService;
use tokio::net::{TcpListener, TcpStream};
use tokio::sync::{OwnedSemaphorePermit, Semaphore};
use tokio_util::sync::CancellationToken;
use tower::Layer;

use super::access::PeerAddress;
use crate::limits;

/// Wait after a failed accept, which mostly means that the process has no file left to open.
const ACCEPT_RETRY: Duration = Duration::from_millis(100);
/// Requests that are under way at a shutdown may take this long.
const DRAIN_TIMEOUT: Duration = Duration::from_secs(2);

/// Serves `routes` on a listener until `stop`, then lets requests that are under way finish.
pub async fn serve(listener: TcpListener, routes: Router, stop: CancellationToken) {
    let graceful = GracefulShutdown::new();
    let places = Arc::new(Semaphore::new(limits::HTTP_CONNECTIONS_MAX));
    while let Some((connection, place)) = accept(&listener, &places, &stop).await {
        tokio::spawn(serve_connection(
            connection,
            place,
            routes.clone(),
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
}

/// The next connection, once there is a place for it; `None` at `stop`.
async fn accept(
    listener: &TcpListener,
    places: &Arc<Semaphore>,
    stop: &CancellationToken,
) -> Option<(TcpStream, OwnedSemaphorePermit)> {
    let next = async {
        let place = Arc::clone(places).acquire_owned().await.ok()?;
        loop {
            match listener.accept().await {
                Ok((connection, _)) => return Some((connection, place)),
                Err(error) if is_of_peer(error.kind()) => {}
                Err(error) => {
                    tracing::error!(%error, "an HTTP connection could not be accepted");
                    tokio::time::sleep(ACCEPT_RETRY).await;
                }
            }
        }
    };
    tokio::select! {
        () = stop.cancelled() => None,
        next = next => next,
    }
}

/// Whether an accept failed because the client had gone already.
const fn is_of_peer(kind: ErrorKind) -> bool {
    matches!(
        kind,
        ErrorKind::ConnectionAborted | ErrorKind::ConnectionReset | ErrorKind::ConnectionRefused
    )
}

async fn serve_connection(
    connection: TcpStream,
    place: OwnedSemaphorePermit,
    routes: Router,
    watcher: Watcher,
) {
    let peer = PeerAddress(connection.peer_addr().ok().map(|address| address.ip()));
    let routes = Extension(peer).layer(routes);
    let mut builder = http1::Builder::new();
    builder
        .timer(TokioTimer::new())
        .header_read_timeout(limits::HTTP_HEADER_TIMEOUT)
        .max_buf_size(limits::HTTP_HEADER_BYTES_MAX);
    let serving =
        builder.serve_connection(TokioIo::new(connection), TowerToHyperService::new(routes));
    if let Err(error) = watcher.watch(serving).await {
        tracing::debug!(%error, "an HTTP connection ended early");
    }
    drop(place);
}
