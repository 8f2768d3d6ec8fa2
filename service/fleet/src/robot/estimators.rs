//! Instance that estimates a robot, and the report of another one about it.

use std::time::Duration;

use fleetcal_cluster::Epoch;
use fleetcal_domain::robot::{Counters, StreamView};
use fleetcal_model::WallTime;
use fleetcal_proto::estimate::EstimatedBy;

use crate::report::RobotReport;

/// Instance that estimates a robot, and the report of that instance where it is another one.
#[derive(Debug, Default)]
pub(super) struct Estimators {
    /// Highest known epoch: a report with a lower one comes from an instance that was replaced.
    pub(super) epoch: Epoch,
    /// Instance that estimates it, as far as it is known here.
    pub(super) by: Option<EstimatedBy>,
    pub(super) mirror: Option<Mirror>,
}

/// Refusal of a report from an instance that was replaced: the robot is estimated here, or by a
/// later one.
#[derive(Debug, Clone, Copy)]
pub struct Replaced;

/// Last report of another instance.
#[derive(Debug)]
pub(super) struct Mirror {
    /// Running time of its arrival.
    pub(super) at: Duration,
    pub(super) stale: bool,
    pub(super) last_seen_ns: Option<WallTime>,
    pub(super) heard_before_ns: Option<WallTime>,
    pub(super) streams: Vec<StreamView>,
    pub(super) counters: Counters,
}

impl Mirror {
    /// Makes the mirror of a report, with the previous values where it has none.
    pub(super) fn of(at: Duration, report: &RobotReport, before: Option<Self>) -> Self {
        let mirror = Self {
            at,
            stale: report.stale,
            last_seen_ns: report.last_seen_ns,
            heard_before_ns: None,
            streams: Vec::new(),
            counters: Counters::default(),
        };
        match (&report.details, before) {
            (Some(details), _) => Self {
                heard_before_ns: details.heard_before_ns,
                streams: details.streams.clone(),
                counters: details.counters.clone(),
                ..mirror
            },
            (None, Some(before)) => Self {
                heard_before_ns: before.heard_before_ns,
                streams: before.streams,
                counters: before.counters,
                ..mirror
            },
            (None, None) => mirror,
        }
    }
}
