//! Figures for Prometheus, as `OpenMetrics` text: families of the whole process, those
//! of a [`cluster`], and those of [`robots`], of which there may be thousands.

pub mod cluster;
mod durations;
pub mod robots;

use std::fmt;

use prometheus_client::encoding::{DescriptorEncoder, EncodeMetric};
use prometheus_client::metrics::MetricType;
use prometheus_client::metrics::counter::ConstCounter;
use prometheus_client::metrics::gauge::ConstGauge;

pub use durations::{RequestDurations, RequestLabels};

/// Writes a family of gauges, one for each value of a label.
///
/// # Errors
/// The text cannot be written.
pub fn gauges<'a>(
    out: &mut DescriptorEncoder<'_>,
    name: &str,
    help: &str,
    label: &str,
    values: impl Iterator<Item = (&'a str, u64)>,
) -> fmt::Result {
    let mut family = out.encode_descriptor(name, help, None, MetricType::Gauge)?;
    for (value, count) in values {
        ConstGauge::new(count as f64).encode(family.encode_family(&[(label, value)])?)?;
    }
    Ok(())
}

/// Writes a counter; the encoder ends its name in `_total`.
///
/// # Errors
/// The text cannot be written.
pub fn counter(out: &mut DescriptorEncoder<'_>, name: &str, help: &str, value: u64) -> fmt::Result {
    let counter = ConstCounter::new(value);
    counter.encode(out.encode_descriptor(name, help, None, MetricType::Counter)?)
}

/// Writes a gauge.
///
/// # Errors
/// The text cannot be written.
pub fn gauge(out: &mut DescriptorEncoder<'_>, name: &str, help: &str, value: f64) -> fmt::Result {
    let gauge = ConstGauge::new(value);
    gauge.encode(out.encode_descriptor(name, help, None, MetricType::Gauge)?)
}

/// Writes a family of counters, one for each set of labels.
///
/// # Errors
/// The text cannot be written.
pub fn counters<'a>(
    out: &mut DescriptorEncoder<'_>,
    name: &str,
    help: &str,
    values: impl Iterator<Item = ([(&'a str, &'a str); 1], u64)>,
) -> fmt::Result {
    let mut family = out.encode_descriptor(name, help, None, MetricType::Counter)?;
    for (labels, value) in values {
        ConstCounter::new(value).encode(family.encode_family(&labels)?)?;
    }
    Ok(())
}
