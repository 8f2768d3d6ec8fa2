//! Layers around every request: limits, timeouts, security headers, compression.

use std::any::Any;
use std::time::Duration;

use axum::Router;
use axum::extract::{DefaultBodyLimit, Request};
use axum::http::{HeaderName, HeaderValue, Method, Uri, header};
use axum::middleware::{self, Next};
use axum::response::{IntoResponse, Response};
use fleetcal_clock::SharedClock;
use fleetcal_domain::limits;
use fleetcal_metrics::RequestDurations;
use tower::ServiceBuilder;
use tower_http::catch_panic::CatchPanicLayer;
use tower_http::compression::CompressionLayer;
use tower_http::request_id::RequestId;
use tower_http::request_id::{MakeRequestUuid, PropagateRequestIdLayer, SetRequestIdLayer};
use tower_http::trace::{DefaultOnFailure, TraceLayer};
use tracing::{Level, Span, field};

use super::durations;
use super::problem::Problem;
use super::request_head::{self, HeadCheck};

/// Content security policy: scripts, styles and data come from here alone, and nothing inline runs.
const CONTENT_SECURITY_POLICY: &str = "default-src 'none'; script-src 'self'; style-src 'self'; \
    img-src 'self' data:; font-src 'self'; connect-src 'self'; manifest-src 'self'; \
    base-uri 'none'; form-action 'self'; frame-ancestors 'none'";

/// Headers of every answer that does not set its own.
const SECURITY_HEADERS: [(HeaderName, &str); 6] = [
    (header::CONTENT_SECURITY_POLICY, CONTENT_SECURITY_POLICY),
    (header::X_CONTENT_TYPE_OPTIONS, "nosniff"),
    (header::REFERRER_POLICY, "no-referrer"),
    (header::X_FRAME_OPTIONS, "DENY"),
    (
        HeaderName::from_static("cross-origin-opener-policy"),
        "same-origin",
    ),
    (
        HeaderName::from_static("cross-origin-resource-policy"),
        "same-origin",
    ),
];

/// Wraps the routes in the layers that all of them share.
pub(super) fn around(
    routes: Router,
    head: HeadCheck,
    durations: RequestDurations,
    clock: SharedClock,
) -> Router {
    let request_id = HeaderName::from_static("x-request-id");
    let layers = ServiceBuilder::new()
        .layer(SetRequestIdLayer::new(request_id.clone(), MakeRequestUuid))
        .layer(
            TraceLayer::new_for_http()
                .make_span_with(span)
                .on_request(())
                .on_response(answered)
                // A 503 of a service that is starting is no error; what fails says so where it
                // fails.
                .on_failure(DefaultOnFailure::new().level(Level::DEBUG)),
        )
        .layer(middleware::from_fn_with_state(
            (durations, clock),
            durations::measured,
        ))
        .layer(PropagateRequestIdLayer::new(request_id))
        .layer(middleware::from_fn(with_headers))
        .layer(middleware::from_fn_with_state(head, request_head::checked))
        .layer(CompressionLayer::new())
        .layer(CatchPanicLayer::custom(panicked))
        .layer(DefaultBodyLimit::max(limits::HTTP_BODY_BYTES_MAX));
    routes
        .method_not_allowed_fallback(method_refused)
        .layer(layers)
}

/// Largest number of characters of a request's id in the log.
const REQUEST_ID_CHARS_MAX: usize = 64;

/// Span of a request, whose fields are in each of its log lines. It has the route in the router's
/// form, since a path, a query or a header may hold a secret. The guard adds the actor.
fn span(request: &Request) -> Span {
    let id = request.extensions().get::<RequestId>();
    let id = id.and_then(|id| id.header_value().to_str().ok());
    let id: String = id
        .unwrap_or("")
        .chars()
        .take(REQUEST_ID_CHARS_MAX)
        .collect();
    tracing::info_span!(
        "request",
        method = %request.method(),
        route = durations::route(request),
        request_id = id,
        actor = field::Empty,
        status = field::Empty,
    )
}

fn answered(response: &Response, latency: Duration, span: &Span) {
    span.record("status", response.status().as_u16());
    tracing::debug!(latency_s = latency.as_secs_f64(), "answered");
}

/// Aborts a request that takes too long. A write that has begun is completed all the same, so its
/// outcome is unknown at that time.
pub(super) async fn in_time(request: Request, next: Next) -> Response {
    let reads = request.method().is_safe();
    let longest = if reads {
        limits::HTTP_REQUEST_TIMEOUT
    } else {
        limits::HTTP_WRITE_TIMEOUT
    };
    match tokio::time::timeout(longest, next.run(request)).await {
        Ok(response) => response,
        Err(_) if reads => Problem::timed_out().into_response(),
        Err(_) => Problem::outcome_unknown().into_response(),
    }
}

async fn with_headers(request: Request, next: Next) -> Response {
    let mut response = next.run(request).await;
    let headers = response.headers_mut();
    for (name, value) in SECURITY_HEADERS {
        if !headers.contains_key(&name) {
            headers.insert(name, HeaderValue::from_static(value));
        }
    }
    if !headers.contains_key(header::CACHE_CONTROL) {
        headers.insert(header::CACHE_CONTROL, HeaderValue::from_static("no-cache"));
    }
    response
}

async fn method_refused(method: Method, uri: Uri) -> Problem {
    Problem::method_refused(&method, uri.path())
}

#[expect(clippy::needless_pass_by_value, reason = "the layer hands it over")]
fn panicked(cause: Box<dyn Any + Send>) -> Response {
    let words = cause
        .downcast_ref::<String>()
        .map(String::as_str)
        .or_else(|| cause.downcast_ref::<&str>().copied());
    tracing::error!(cause = words.unwrap_or("unknown"), "a request panicked");
    Problem::panicked().into_response()
}
