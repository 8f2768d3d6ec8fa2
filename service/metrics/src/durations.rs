//! Durations of requests, by route.

use std::fmt;
use std::time::Duration;

use prometheus_client::encoding::{DescriptorEncoder, EncodeLabelSet, EncodeMetric};
use prometheus_client::metrics::MetricType;
use prometheus_client::metrics::family::Family;
use prometheus_client::metrics::histogram::Histogram;

/// Upper bounds of the buckets, s: from answers out of memory to the longest request.
const BUCKETS_S: [f64; 10] = [
    0.001, 0.0025, 0.005, 0.01, 0.025, 0.05, 0.1, 0.25, 1.0, 10.0,
];

/// Methods that a label names.
const METHODS: [&str; 7] = ["GET", "HEAD", "POST", "PUT", "PATCH", "DELETE", "OPTIONS"];

/// Labels of a request. Each has few values, whatever the request.
#[derive(Debug, Clone, PartialEq, Eq, Hash, EncodeLabelSet)]
pub struct RequestLabels {
    method: &'static str,
    route: String,
    status: &'static str,
}

impl RequestLabels {
    /// Makes the labels of a request with a route in the router's form, and of the status of its
    /// answer. A method of a client's own is `other`.
    pub fn new(method: &str, route: String, status: u16) -> Self {
        let known = METHODS.into_iter().find(|known| *known == method);
        Self {
            method: known.unwrap_or("other"),
            route,
            status: match status {
                100..=199 => "1xx",
                200..=299 => "2xx",
                300..=399 => "3xx",
                400..=499 => "4xx",
                _ => "5xx",
            },
        }
    }
}

/// Durations of requests until their answer began.
#[derive(Debug, Clone)]
pub struct RequestDurations(Family<RequestLabels, Histogram, fn() -> Histogram>);

impl Default for RequestDurations {
    fn default() -> Self {
        Self(Family::new_with_constructor(|| Histogram::new(BUCKETS_S)))
    }
}

impl RequestDurations {
    /// Adds the duration of a request.
    pub fn observe(&self, labels: &RequestLabels, took: Duration) {
        self.0.get_or_create(labels).observe(took.as_secs_f64());
    }

    /// Encodes the histograms.
    ///
    /// # Errors
    /// The encoder's failure.
    pub fn encode(&self, out: &mut DescriptorEncoder<'_>) -> fmt::Result {
        let name = "fleetcal_http_request_duration_seconds";
        let help = "Time from a request's header until its answer begins";
        let kind = MetricType::Histogram;
        self.0
            .encode(out.encode_descriptor(name, help, None, kind)?)
    }
}
