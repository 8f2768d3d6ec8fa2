//! Checks of a request's header before any route: its size, and its host.

use axum::extract::{Request, State};
use axum::http::request::Parts;
use axum::http::{StatusCode, header};
use axum::middleware::Next;
use axum::response::{IntoResponse, Response};
use fleetcal_domain::limits;
use fleetcal_http::host::{header_bytes, host, is_ours, local};
use fleetcal_http::{Connections, PublicUrl, Turned};

use super::health;
use super::problem::Problem;

/// Accepted hosts of requests.
#[derive(Debug, Clone)]
pub(super) struct HeadCheck {
    /// Name of this machine.
    pub(super) own_name: String,
    /// Host, and port if any, that other instances use.
    pub(super) among_instances: Option<String>,
    /// Public address of the service.
    pub(super) public_url: Option<PublicUrl>,
    /// Counters of the refusals.
    pub(super) connections: Connections,
}

/// Refuses a header that is too large, and a request for another host.
pub(super) async fn checked(
    State(check): State<HeadCheck>,
    request: Request,
    next: Next,
) -> Response {
    let (parts, body) = request.into_parts();
    let Some((reason, problem)) = refused(&check, &parts) else {
        return next.run(Request::from_parts(parts, body)).await;
    };
    check.connections.count(reason);
    problem.into_response()
}

fn refused(check: &HeadCheck, parts: &Parts) -> Option<(Turned, Problem)> {
    let bytes = header_bytes(parts);
    if bytes > limits::HTTP_HEADER_BYTES_MAX {
        let max = limits::HTTP_HEADER_BYTES_MAX;
        let detail = format!("header: got {bytes} bytes, expected {max} at most");
        let status = StatusCode::REQUEST_HEADER_FIELDS_TOO_LARGE;
        return Some((
            Turned::HeaderBytes,
            Problem::new(status, "header_too_large", detail),
        ));
    }
    let host = host(parts)?;
    let is_public = health::is_probe(parts.uri.path()) || parts.uri.path() == "/metrics";
    // A page that an attacker points here cannot send a token.
    let has_token = parts.headers.contains_key(header::AUTHORIZATION);
    let public_url = check.public_url.as_ref();
    let among = check.among_instances.as_deref();
    let is_ours = || is_ours(host, &check.own_name, public_url, among, local(parts));
    if is_public || has_token || is_ours() {
        return None;
    }
    let expected = match &check.public_url {
        Some(url) => url.authority().to_owned(),
        None => {
            "an address, localhost, this machine's name, or the host of public_url once that is set"
                .to_owned()
        }
    };
    let shown: String = host.chars().take(100).collect();
    let detail = format!("Host: got {shown:?}, expected {expected}");
    let problem = Problem::new(StatusCode::MISDIRECTED_REQUEST, "host_refused", detail);
    Some((Turned::Host, problem.of_field("Host")))
}
