//! Durations of requests, by route.

use axum::extract::{MatchedPath, Request, State};
use axum::middleware::Next;
use axum::response::Response;
use fleetcal_clock::SharedClock;
use fleetcal_metrics::{RequestDurations, RequestLabels};

/// Route of a request in the router's form; `other` for pages and unknown paths.
pub(super) fn route(request: &Request) -> &str {
    let matched = request.extensions().get::<MatchedPath>();
    matched.map_or("other", MatchedPath::as_str)
}

/// Measures the duration of a request.
pub(super) async fn measured(
    State((durations, clock)): State<(RequestDurations, SharedClock)>,
    request: Request,
    next: Next,
) -> Response {
    let began = clock.elapsed();
    let (method, route) = (request.method().clone(), route(&request).to_owned());
    let response = next.run(request).await;
    let labels = RequestLabels::new(method.as_str(), route, response.status().as_u16());
    durations.observe(&labels, clock.elapsed().saturating_sub(began));
    response
}
