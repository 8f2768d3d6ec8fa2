//! One subscriber for the streams of each robot that is heard, and one for its answers. All have the
//! same callback, which Zenoh calls in the order in which a robot has sent.

use std::collections::{BTreeMap, BTreeSet};

use fleetcal_fleet::FleetHandle;
use fleetcal_operations::lifecycle::Lifecycle;
use fleetcal_proto::RobotId;
use fleetcal_proto::key::{Keys, StreamKind};
use zenoh::key_expr::KeyExpr;
use zenoh::pubsub::Subscriber;
use zenoh::{Result, Session};

use crate::gate::Gate;
use crate::{Parts, answers, ingest, warn_if_refused};

/// The robots to hear.
pub type HeardRobots = BTreeSet<RobotId>;

/// The streams that bring many messages a second.
const FREQUENT: [StreamKind; 3] = [
    StreamKind::WheelOdometry,
    StreamKind::Scan,
    StreamKind::LidarOdometry,
];

/// What is declared for a robot. Zenoh compares a message whose key is not declared with each
/// subscriber of the session, which would cost each message more the more robots an instance has.
#[derive(Debug)]
struct Heard {
    subscribers: [Subscriber<()>; 2],
    /// They are undeclared with this value.
    _frequent: Vec<KeyExpr<'static>>,
}

/// The subscribers that there are.
#[derive(Debug)]
pub struct HeardStreams {
    keys: Keys,
    fleet: FleetHandle,
    lifecycle: Lifecycle,
    gate: Gate,
    declared: BTreeMap<RobotId, Heard>,
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
                let heard = self.declare(session, robot).await?;
                self.declared.insert(robot.clone(), heard);
            }
        }
        let is_gone = |robot: &&RobotId| !wanted.contains(*robot);
        let gone: Vec<_> = self.declared.keys().filter(is_gone).cloned().collect();
        for robot in gone {
            if let Some(heard) = self.declared.remove(&robot) {
                for subscriber in heard.subscribers {
                    subscriber.undeclare().await?;
                }
            }
        }
        Ok(())
    }

    async fn declare(&self, session: &Session, robot: &RobotId) -> Result<Heard> {
        let (keys, fleet) = (&self.keys, self.fleet.clone());
        let streams = keys.stream_of_any_kind(robot);
        let answers = keys.stream(robot, StreamKind::CalibrationApplied);
        let (lifecycle, gate) = (self.lifecycle.clone(), self.gate.clone());
        let mut frequent = Vec::with_capacity(FREQUENT.len());
        for kind in FREQUENT {
            let key = keys.stream(robot, kind);
            frequent.push(session.declare_keyexpr(key).await?);
        }
        Ok(Heard {
            subscribers: [
                ingest::subscribe(session, keys, streams, fleet).await?,
                answers::hear(session, keys, answers, lifecycle, gate).await?,
            ],
            _frequent: frequent,
        })
    }

    /// Ends all of them.
    pub async fn close(self) {
        for heard in self.declared.into_values() {
            for subscriber in heard.subscribers {
                warn_if_refused(subscriber.undeclare().await);
            }
        }
    }
}
