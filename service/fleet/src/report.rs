//! Report of an instance about its robots, for the others.

use std::collections::BTreeMap;
use std::sync::Arc;
use std::time::Duration;

use fleetcal_cluster::{Epoch, InstanceId};
use fleetcal_domain::limits::{DIGEST_BYTES_MAX, REPORT_EVENTS_MAX};
use fleetcal_domain::robot::{
    ChecksReport, Counters, CrossTrack, HistoryEvent, PairingReport, RobotState, StreamView,
    Warning,
};
use fleetcal_model::{AuditId, Generation, RobotId, WallTime};
use fleetcal_proto::estimate::EstimateDocument;
use serde::{Deserialize, Serialize};
use tokio::sync::broadcast;

use crate::live::LiveUpdate;

/// Report of an instance on one of its robots: the frequently changing part, and now and then all
/// details.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct RobotReport {
    /// The robot.
    pub robot: RobotId,
    /// Epoch of the robot's tenure; 0 for an unregistered robot.
    pub epoch: Epoch,
    /// State of the robot.
    pub state: RobotState,
    /// True if nothing has come from it for some seconds.
    pub stale: bool,
    /// Time of its last message, by the wall clock of the instance.
    pub last_seen_ns: Option<WallTime>,
    /// Its latest estimate; absent if an earlier report had it, or there is none.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub estimate: Option<Box<EstimateDocument>>,
    /// Number of the last note of the audit that its estimator has processed; absent in reports of
    /// former versions.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub notes_taken: Option<AuditId>,
    /// Remaining details, now and then.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub details: Option<Box<ReportDetails>>,
    /// Events of the robot since the previous report.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub events: Vec<HistoryEvent>,
}

/// Details of a robot, reported every few seconds, or when they have changed.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct ReportDetails {
    /// Time of its last message before the instance began to receive it, wall time.
    pub heard_before_ns: Option<WallTime>,
    /// Its streams.
    pub streams: Vec<StreamView>,
    /// Counters of its messages by outcome.
    pub counters: Counters,
    /// Restarts of its estimator after a panic.
    pub estimator_restarts: u32,
    /// Quality of the pairing of steering and speed of different topics.
    pub pairing: Option<PairingReport>,
    /// Warnings about its messages.
    pub warnings: Vec<Warning>,
    /// Causes that its joining checks name.
    #[serde(default)]
    pub checks: ChecksReport,
    /// An estimate from those messages alone that came since the values of this generation are in
    /// use.
    pub verification: Option<(Generation, Box<EstimateDocument>)>,
    /// Its cross-track errors, by generation.
    pub cross_tracks: Vec<(Generation, CrossTrack)>,
}

/// Message with several reports of one instance to another.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Digest {
    /// Reports on its robots.
    pub reports: Vec<RobotReport>,
}

impl Digest {
    /// Message without reports, which shows that the instance is alive. Former versions read it as
    /// an empty digest.
    pub const HEARTBEAT: &[u8] = b"{\"reports\":[]}";

    /// Splits reports into messages of at most [`DIGEST_BYTES_MAX`] in JSON.
    ///
    /// # Errors
    /// A report holds a number that JSON cannot represent.
    pub fn messages(reports: &[RobotReport]) -> Result<Vec<Vec<u8>>, serde_json::Error> {
        const OPEN: &[u8] = b"{\"reports\":[";
        const CLOSE: &[u8] = b"]}";
        let mut messages: Vec<Vec<u8>> = Vec::new();
        for report in reports {
            let report = serde_json::to_vec(report)?;
            let fits = |message: &&mut Vec<u8>| {
                message.len() + 1 + report.len() + CLOSE.len() <= DIGEST_BYTES_MAX
            };
            if let Some(message) = messages.last_mut().filter(fits) {
                message.push(b',');
                message.extend(report);
            } else {
                messages.push([OPEN, report.as_slice()].concat());
            }
        }
        for message in &mut messages {
            message.extend_from_slice(CLOSE);
        }
        Ok(messages)
    }

    /// Reads a message.
    ///
    /// # Errors
    /// The message is not a digest.
    pub fn read(message: &[u8]) -> Result<Self, serde_json::Error> {
        serde_json::from_slice(message)
    }
}

/// Record of the reports that the other instances have received on this one's robots.
#[derive(Debug, Default)]
pub struct Reported {
    pub(crate) live: Option<broadcast::Receiver<LiveUpdate>>,
    pub(crate) robots: BTreeMap<RobotId, Told>,
}

/// Last report on one robot.
#[derive(Debug)]
pub(crate) struct Told {
    /// Running time of the last complete report.
    pub whole_at: Duration,
    /// Tenure, state, staleness and time of the last message.
    pub latest: (Epoch, RobotState, bool, Option<WallTime>),
    /// The estimate.
    pub estimate: Option<Arc<EstimateDocument>>,
    /// Details that are reported at once when they change.
    pub urgent: Urgent,
}

/// Details that are reported at once when they change.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Urgent {
    /// Warnings.
    pub warnings: Vec<Warning>,
    /// The estimate of the values in verification.
    pub verification: Option<(Generation, Arc<EstimateDocument>)>,
    /// Restarts of the estimator.
    pub restarts: u32,
}

impl Reported {
    /// Returns the events since the last call by robot, the first few of each.
    pub(crate) fn take_events(&mut self) -> BTreeMap<RobotId, Vec<HistoryEvent>> {
        let mut events: BTreeMap<RobotId, Vec<HistoryEvent>> = BTreeMap::new();
        let Some(live) = &mut self.live else {
            return events;
        };
        loop {
            match live.try_recv() {
                // What people note, every instance reads in the audit.
                Ok(LiveUpdate::Event {
                    robot,
                    event,
                    author: None,
                }) => {
                    let of_robot = events.entry(robot).or_default();
                    if of_robot.len() < REPORT_EVENTS_MAX {
                        of_robot.push(HistoryEvent::clone(&event));
                    }
                }
                Ok(_) => {}
                Err(broadcast::error::TryRecvError::Lagged(lost)) => {
                    tracing::warn!(lost, "events are not told to other instances");
                }
                Err(_) => return events,
            }
        }
    }
}

/// Sender of a report.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Sender<'a> {
    /// The instance.
    pub instance: &'a InstanceId,
    /// Running time of its arrival.
    pub at: Duration,
}
