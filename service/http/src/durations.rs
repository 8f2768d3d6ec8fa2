//! Durations of requests, by route.

use std::fmt;

use axum::extract::{MatchedPath, Request, State};
use axum::http::{Method, StatusCode};
use axum::middleware::Next;
use axum::response::Response;
use fleetcal_clock::SharedClock;
use prometheus_client::encoding::{DescriptorEncoder, EncodeLabelSet, EncodeMetric};
use prometheus_client::metrics::MetricType;
use prometheus_client::metrics::family::Family;
use prometheus_client::metrics::histogram::Histogram;

/// Upper bounds of the buckets, s: from answers out of memory to the longest request.
const BUCKETS_S: [f64; 10] = [
    0.001, 0.0025, 0.005, 0.01, 0.025, 0.05, 0.1, 0.25, 1.0, 10.0,
];

/// Labels of a request. Each has few values, whatever the request.
#[derive(Debug, Clone, PartialEq, Eq, Hash, EncodeLabelSet)]
struct Labels {
    method: &'static str,
    route: String,
    status: &'static str,
}

/// Durations of requests until their answer began.
#[derive(Debug, Clone)]
pub struct RequestDurations {
    families: Family<Labels, Histogram, fn() -> Histogram>,
    clock: SharedClock,
}

impl RequestDurations {
    /// Makes an empty collection.
    pub fn new(clock: SharedClock) -> Self {
        Self {
            families: Family::new_with_constructor(|| Histogram::new(BUCKETS_S)),
            clock,
        }
    }

    /// Encodes the histograms.
    ///
    /// # Errors
    /// The encoder's failure.
    pub fn encode(&self, out: &mut DescriptorEncoder<'_>) -> fmt::Result {
        let name = "fleetcal_http_request_duration_seconds";
        let help = "Time from a request's header until its answer begins";
        let kind = MetricType::Histogram;
        self.families
            .encode(out.encode_descriptor(name, help, None, kind)?)
    }
}

/// Route of a request in the router's form; `other` for pages and unknown paths.
pub fn route(request: &Request) -> &str {
    let matched = request.extensions().get::<MatchedPath>();
    matched.map_or("other", MatchedPath::as_str)
}

/// Measures the duration of a request.
pub async fn measured(
    State(durations): State<RequestDurations>,
    request: Request,
    next: Next,
) -> Response {
    let began = durations.clock.elapsed();
    let method = method(request.method());
    let route = route(&request).to_owned();
    let response = next.run(request).await;
    let took = durations.clock.elapsed().saturating_sub(began);
    let labels = Labels {
        method,
        route,
        status: class(response.status()),
    };
    let families = durations.families.get_or_create(&labels);
    families.observe(took.as_secs_f64());
    response
}

/// Name of a method from a fixed set, which no client can extend.
fn method(method: &Method) -> &'static str {
    match *method {
        Method::GET => "GET",
        Method::HEAD => "HEAD",
        Method::POST => "POST",
        Method::PUT => "PUT",
        Method::PATCH => "PATCH",
        Method::DELETE => "DELETE",
        Method::OPTIONS => "OPTIONS",
        _ => "other",
    }
}

const fn class(status: StatusCode) -> &'static str {
    match status.as_u16() {
        100..=199 => "1xx",
        200..=299 => "2xx",
        300..=399 => "3xx",
        400..=499 => "4xx",
        _ => "5xx",
    }
}
