//! Telemetry that waits for the next transaction.

use std::collections::HashMap;

use fleetcal_cluster::ClaimId;
use fleetcal_domain::limits;
use fleetcal_model::{ParameterStatus, WallTime};
use fleetcal_proto::RobotId;
use fleetcal_proto::estimate::EstimateDocument;

use super::{Batch, Telemetry};
use crate::accounts::CredentialUse;
use crate::counters::Lost;
use crate::record::HistoryRow;

/// Telemetry that waits for the next transaction.
#[derive(Debug, Default)]
pub(super) struct Pending {
    batch: Batch,
    /// Latest estimates that are not due yet.
    current: HashMap<RobotId, (EstimateDocument, WallTime)>,
    /// Last write of each robot's stored estimate, receipt time.
    current_written_ns: HashMap<RobotId, WallTime>,
    /// Tenure that each robot's rows were queued under.
    claims: HashMap<RobotId, ClaimId>,
}

impl Pending {
    /// Adds telemetry that was queued under `claim`. Returns the number of dropped rows: those of
    /// the robot's former tenures, which ended with this one's begin.
    pub(super) fn take(&mut self, telemetry: Telemetry, claim: Option<ClaimId>) -> u64 {
        let dropped = match (telemetry.robot(), claim) {
            (Some(robot), Some(claim)) => self.begin(robot, claim),
            _ => 0,
        };
        self.keep(telemetry);
        dropped
    }

    /// Drops rows of a robot's tenures before this one; returns their number.
    fn begin(&mut self, robot: &RobotId, claim: ClaimId) -> u64 {
        let former = self.claims.insert(robot.clone(), claim);
        if former.is_none_or(|former| former == claim) {
            return 0;
        }
        let before = self.rows();
        self.batch.retain(|other| other != robot);
        self.current.remove(robot);
        before - self.rows()
    }

    fn keep(&mut self, telemetry: Telemetry) {
        match telemetry {
            Telemetry::History(estimate, received_ns) => self.take_second(*estimate, received_ns),
            Telemetry::Checkpoint(record) => {
                let checkpoints = &mut self.batch.checkpoints;
                checkpoints.retain(|earlier| earlier.robot != record.robot);
                checkpoints.push(record);
            }
            Telemetry::CrossTrack(record) => {
                let cross_tracks = &mut self.batch.cross_tracks;
                cross_tracks.retain(|earlier| {
                    earlier.robot != record.robot || earlier.generation != record.generation
                });
                cross_tracks.push(*record);
            }
            Telemetry::Event(write) => self.batch.events.push(*write),
            Telemetry::Use(used) => {
                let earlier = |earlier: &CredentialUse| earlier.credential == used.credential;
                self.batch.uses.retain(|known| !earlier(known));
                self.batch.uses.push(used);
            }
        }
    }

    /// Adds a second of history, which is the robot's latest estimate too.
    fn take_second(&mut self, estimate: EstimateDocument, received_ns: WallTime) {
        let robot = estimate.robot.clone();
        let row = HistoryRow::of(&robot, &estimate, received_ns);
        self.batch.history.push(row);
        self.current.insert(robot, (estimate, received_ns));
    }

    /// True if more rows wait than should.
    pub(super) fn is_full(&self) -> bool {
        self.batch.history.len() >= limits::STORE_BATCH_MAX
    }

    /// Moves the latest estimates that are due to the batch: a robot's stored estimate is replaced
    /// every few seconds while it is learnt, every minute afterwards, and at once if `everything`
    /// is to be written.
    pub(super) fn choose_current(&mut self, everything: bool) {
        let written = &mut self.current_written_ns;
        let due = |estimate: &EstimateDocument, received_ns: WallTime| {
            let Some(last_ns) = written.get(&estimate.robot) else {
                return true;
            };
            // A clock that was set back must not keep it waiting until it is as late again.
            everything || !(0..every_ns(estimate)).contains(&received_ns.ns_since(*last_ns))
        };
        let chosen: Vec<_> = self
            .current
            .extract_if(|_, (estimate, received_ns)| due(estimate, *received_ns))
            .collect();
        for (robot, (estimate, received_ns)) in chosen {
            written.insert(robot, received_ns);
            self.batch.current.push((estimate, received_ns));
        }
    }

    /// Removes and returns the rows of the next transaction; `None` without any.
    pub(super) fn next(&mut self) -> Option<Batch> {
        let mut batch = self.batch.take_first(limits::STORE_TELEMETRY_ROWS_MAX);
        if !self.claims.is_empty() {
            let claims = batch.robots().filter_map(|robot| {
                let claim = self.claims.get(robot)?;
                Some((robot.clone(), *claim))
            });
            batch.claims = claims.collect();
        }
        (!batch.is_empty()).then_some(batch)
    }

    /// Takes back rows that could not be written, and keeps the newest if there are too many.
    /// Returns the lost rows.
    pub(super) fn take_back(&mut self, mut batch: Batch) -> Lost {
        batch.claims.clear();
        self.batch.put_back(batch);
        for (estimate, received_ns) in self.batch.current.drain(..) {
            self.current_written_ns.remove(&estimate.robot);
            self.current
                .entry(estimate.robot.clone())
                .or_insert((estimate, received_ns));
        }
        let history = drop_oldest(&mut self.batch.history);
        let events = drop_oldest(&mut self.batch.events);
        let uses = drop_oldest(&mut self.batch.uses);
        Lost {
            rows: history + events + uses,
            history,
        }
    }

    /// Number of waiting rows.
    pub(super) fn rows(&self) -> u64 {
        (self.batch.rows() + self.current.len()) as u64
    }

    /// Rows that are lost if nothing more is written.
    pub(super) fn left(&self) -> Lost {
        Lost {
            rows: self.rows(),
            history: self.batch.history.len() as u64,
        }
    }
}

/// Time between two writes of an estimate, ns.
fn every_ns(estimate: &EstimateDocument) -> i64 {
    let mut parameters = estimate.parameters.iter();
    let learns = parameters.any(|(_, parameter)| parameter.status == ParameterStatus::Learning);
    let every = if learns {
        limits::STORE_CURRENT_EVERY
    } else {
        limits::STORE_CURRENT_LEARNT_EVERY
    };
    i64::try_from(every.as_nanos()).unwrap_or(i64::MAX)
}

/// Drops the oldest entries of a list beyond its limit; returns their number.
fn drop_oldest<T>(list: &mut Vec<T>) -> u64 {
    let lost = list.len().saturating_sub(limits::STORE_QUEUE_MAX);
    list.drain(..lost);
    lost as u64
}
