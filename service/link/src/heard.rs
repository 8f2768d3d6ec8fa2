//! One subscriber for the streams of each robot that is heard, and one for its answers. All have the
//! same callback, which Zenoh calls in the order in which a robot has sent.

use std::collections::{BTreeMap, BTreeSet};

use fleetcal_fleet::FleetHandle;
use fleetcal_operations::lifecycle::Lifecycle;
use fleetcal_proto::RobotId;
use fleetcal_proto::key::{Keys, StreamKind};
use zenoh::pubsub::Subscriber;
use zenoh::{Result, Session};

use crate::gate::Gate;
use crate::{Parts, answers, ingest, warn_if_refused};

/// The robots to hear.
pub type HeardRobots = BTreeSet<RobotId>;

/// The subscribers that there are.
#[derive(Debug)]
pub struct HeardStreams {
    keys: Keys,
    fleet: FleetHandle,
    lifecycle: Lifecycle,
    gate: Gate,
    declared: BTreeMap<RobotId, [Subscriber<()>; 2]>,
}

impl HeardStreams {
    /// None yet.
    pub fn new(parts: &Parts) -> Self {
        let parts = parts.clone();
        Self {
            keys: parts.keys,
            fleet: parts.fleet,
            lifecycle: parts.lifecycle,
            gate: parts.gate,
            declared: BTreeMap::new(),
        }
    }

    /// Subscribes to these robots, and to no others.
    ///
    /// # Errors
    /// When Zenoh refuses to declare or undeclare something.
    pub async fn follow(&mut self, session: &Session, wanted: &HeardRobots) -> Result<()> {
        for robot in wanted {
            if !self.declared.contains_key(robot) {
                let subscribers = self.declare(session, robot).await?;
                self.declared.insert(robot.clone(), subscribers);
            }
        }
        let is_gone = |robot: &&RobotId| !wanted.contains(*robot);
        let gone: Vec<_> = self.declared.keys().filter(is_gone).cloned().collect();
        for robot in gone {
            for subscriber in self.declared.remove(&robot).into_iter().flatten() {
                subscriber.undeclare().await?;
            }
        }
        Ok(())
    }

    async fn declare(&self, session: &Session, robot: &RobotId) -> Result<[Subscriber<()>; 2]> {
        let (keys, fleet) = (&self.keys, self.fleet.clone());
        let streams = keys.stream_of_any_kind(robot);
        let answers = keys.stream(robot, StreamKind::CalibrationApplied);
        let (lifecycle, gate) = (self.lifecycle.clone(), self.gate.clone());
        Ok([
            ingest::subscribe(session, keys, streams, fleet).await?,
            answers::hear(session, keys, answers, lifecycle, gate).await?,
        ])
    }

    /// Ends all of them.
    pub async fn close(self) {
        for subscriber in self.declared.into_values().flatten() {
            warn_if_refused(subscriber.undeclare().await);
        }
    }
}
