//! Instance that estimates a robot, and the report of another one about it.

use std::time::Duration;

use fleetcal_cluster::Epoch;
use fleetcal_domain::robot::{Counters, StreamView};
use fleetcal_model::WallTime;
use fleetcal_proto::estimate::EstimatedBy;

use crate::report::RobotReport;

/// Which instance estimates a robot, and what it says where that is another one.
#[derive(Debug, Default)]
pub(super) struct Estimators {
    /// The highest epoch that was heard of: what comes with a lower one is of an instance that was
    /// replaced.
    pub(super) epoch: Epoch,
    /// Who estimates it, as far as is known here.
    pub(super) by: Option<EstimatedBy>,
    pub(super) mirror: Option<Mirror>,
}

/// A report is of an instance that was replaced: the robot is estimated here, or by a later one.
#[derive(Debug, Clone, Copy)]
pub struct Replaced;

/// What another instance reported last.
#[derive(Debug)]
pub(super) struct Mirror {
    /// When, running time.
    pub(super) at: Duration,
    pub(super) stale: bool,
    pub(super) last_seen_ns: Option<WallTime>,
    pub(super) heard_before_ns: Option<WallTime>,
    pub(super) streams: Vec<StreamView>,
    pub(super) counters: Counters,
}

impl Mirror {
    /// What a report says, and what it leaves as it was before.
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
