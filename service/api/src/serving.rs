//! Routes on the service's own accept loop.

use std::io;

use axum::Router;
use axum::http::StatusCode;
use axum::response::{IntoResponse, Response};
use fleetcal_http::{Connections, Served, Serving, Turned};
use tokio::net::TcpListener;
use tokio_util::sync::CancellationToken;

use super::health;
use super::problem::Problem;

/// Begins to accept on a listener; the future serves `routes` until `stop`, then lets requests that
/// are under way finish.
///
/// # Errors
/// If the system has no thread for the accept loop.
pub fn serve(
    listener: TcpListener,
    routes: Router,
    connections: Connections,
    stop: CancellationToken,
) -> io::Result<Serving> {
    let served = Served {
        routes,
        is_probe: health::is_probe,
        turned_away,
    };
    fleetcal_http::serve(listener, served, connections, stop)
}

/// Answer to a request without a place.
fn turned_away(reason: Turned) -> Response {
    let (status, code, detail) = match reason {
        Turned::AddressRequests => (
            StatusCode::TOO_MANY_REQUESTS,
            "too_many_requests",
            "too many requests from this address are under way",
        ),
        _ => (
            StatusCode::SERVICE_UNAVAILABLE,
            "busy",
            "too many requests are under way",
        ),
    };
    Problem::new(status, code, detail).into_response()
}
