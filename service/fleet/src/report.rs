//! Report of an instance about its robots, for the others.

use std::collections::BTreeMap;
use std::sync::Arc;
use std::time::Duration;

use fleetcal_cluster::{Epoch, InstanceId};
use fleetcal_domain::limits::{DIGEST_BYTES_MAX, REPORT_EVENTS_MAX};
use fleetcal_domain::robot::{
    Counters, CrossTrack, HistoryEvent, PairingReport, RobotState, StreamView, Warning,
};
use fleetcal_model::{AuditId, Generation, RobotId, WallTime};
use fleetcal_proto::estimate::EstimateDocument;
use serde::{Deserialize, Serialize};
use tokio::sync::broadcast;

use crate::live::LiveUpdate;

/// What an instance tells the others of one of its robots: what changes from second to second, and
/// now and then all there is.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct RobotReport {
    /// Which robot.
    pub robot: RobotId,
    /// In which of the robot's tenures; 0 of a robot that nobody has registered.
    pub epoch: Epoch,
    /// Where the robot stands.
    pub state: RobotState,
    /// Whether nothing has come of it for some seconds.
    pub stale: bool,
    /// When it was last heard, by the wall clock of the instance.
    pub last_seen_ns: Option<WallTime>,
    /// Its latest estimate; absent when it was told before, or there is none.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub estimate: Option<Box<EstimateDocument>>,
    /// Up to which note of the audit its estimator has taken them; absent in reports of former versions.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub notes_taken: Option<AuditId>,
    /// All the rest, now and then.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub details: Option<Box<ReportDetails>>,
    /// What happened to it since the report before.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub events: Vec<HistoryEvent>,
}

/// What is told of a robot every few seconds, or when it has changed.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct ReportDetails {
    /// When it was last heard before the instance began to hear it, wall time.
    pub heard_before_ns: Option<WallTime>,
    /// What it sends.
    pub streams: Vec<StreamView>,
    /// What became of its messages.
    pub counters: Counters,
    /// Times that its estimator was restarted after a panic.
    pub estimator_restarts: u32,
    /// How well steering and speed of different topics fit together.
    pub pairing: Option<PairingReport>,
    /// What looks wrong with what it sends.
    pub warnings: Vec<Warning>,
    /// An estimate from nothing but what came since the values of this generation are in use.
    pub verification: Option<(Generation, Box<EstimateDocument>)>,
    /// How well it follows its path, by generation.
    pub cross_tracks: Vec<(Generation, CrossTrack)>,
}

/// What an instance was told of by another one at once: one message.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Digest {
    /// Its robots.
    pub reports: Vec<RobotReport>,
}

impl Digest {
    /// A message without reports: the instance is alive. Former versions read it as an empty digest.
    pub const HEARTBEAT: &[u8] = b"{\"reports\":[]}";

    /// Messages of at most [`DIGEST_BYTES_MAX`] in JSON.
    ///
    /// # Errors
    /// When a report holds a number that JSON has not.
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
    /// When it is none of ours.
    pub fn read(message: &[u8]) -> Result<Self, serde_json::Error> {
        serde_json::from_slice(message)
    }
}

/// What the other instances were told of this one's robots.
#[derive(Debug, Default)]
pub struct Reported {
    pub(crate) live: Option<broadcast::Receiver<LiveUpdate>>,
    pub(crate) robots: BTreeMap<RobotId, Told>,
}

/// What they were told of one robot.
#[derive(Debug)]
pub(crate) struct Told {
    /// When all was told, running time.
    pub whole_at: Duration,
    /// The tenure, state, staleness and when it was heard.
    pub latest: (Epoch, RobotState, bool, Option<WallTime>),
    /// The estimate.
    pub estimate: Option<Arc<EstimateDocument>>,
    /// What of the details is told at once when it changes.
    pub urgent: Urgent,
}

/// What of the details is told at once when it changes.
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
    /// Events since this was last asked, by robot; of each the first few.
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

/// Who sent a report.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Sender<'a> {
    /// The instance.
    pub instance: &'a InstanceId,
    /// Running time at which it came.
    pub at: Duration,
}
