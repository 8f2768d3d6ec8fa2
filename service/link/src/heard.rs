//! One subscriber for the streams of each robot that is heard, and one for all robots' answers, which
//! are rare. Those of streams have one callback, which Zenoh calls in the order in which a robot has
//! sent.

use std::collections::{BTreeMap, BTreeSet};

use fleetcal_fleet::FleetHandle;
use fleetcal_operations::lifecycle::Lifecycle;
use fleetcal_proto::RobotId;
use fleetcal_proto::key::{Keys, StreamKind};
use zenoh::pubsub::{Publisher, Subscriber};
use zenoh::{Result, Session};

use crate::gate::Gate;
use crate::{Parts, answers, ingest, warn_if_refused};

/// Robots whose messages are wanted.
pub type HeardRobots = BTreeSet<RobotId>;

/// Streams with many messages a second.
const FREQUENT: [StreamKind; 3] = [
    StreamKind::WheelOdometry,
    StreamKind::Scan,
    StreamKind::LidarOdometry,
];
/// Robots whose keys are declared at once: each declaration is compared with all others.
const KEYS_AT_ONCE_MAX: usize = 32;

/// Declarations for a robot.
#[derive(Debug)]
struct Heard {
    streams: Subscriber<()>,
    /// Publishers on the frequent keys of a robot that sends, to which nothing is ever published.
    /// Zenoh compares a message whose key is undeclared with all keys that it knows, in this
    /// session and in the router before it: the cost grows with the number of robots, and a session
    /// that keeps naming keys delays the messages of others. A publisher declares its key in both,
    /// and to no other router. They are undeclared with this value.
    frequent: Vec<Publisher<'static>>,
}

/// Subscribers of the robots' streams.
#[derive(Debug)]
pub struct HeardStreams {
    keys: Keys,
    fleet: FleetHandle,
    lifecycle: Lifecycle,
    gate: Gate,
    /// Subscriber of all robots' acknowledgements; the gate admits those of this instance's robots.
    answers: Option<Subscriber<()>>,
    declared: BTreeMap<RobotId, Heard>,
}

impl HeardStreams {
    /// Makes it without any subscriber.
    pub fn new(parts: &Parts) -> Self {
        let parts = parts.clone();
        Self {
            keys: parts.keys,
            fleet: parts.fleet,
            lifecycle: parts.lifecycle,
            gate: parts.gate,
            answers: None,
            declared: BTreeMap::new(),
        }
    }

    /// Subscribes to these robots alone.
    ///
    /// # Errors
    /// Zenoh refuses to declare or undeclare something.
    pub async fn follow(&mut self, session: &Session, wanted: &HeardRobots) -> Result<()> {
        if self.answers.is_none() {
            self.answers = Some(self.hear_answers(session).await?);
        }
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
                heard.streams.undeclare().await?;
            }
        }
        Ok(())
    }

    async fn hear_answers(&self, session: &Session) -> Result<Subscriber<()>> {
        let keys = &self.keys;
        let answers = keys.stream_of_all(StreamKind::CalibrationApplied);
        let (lifecycle, gate) = (self.lifecycle.clone(), self.gate.clone());
        answers::hear(session, keys, answers, lifecycle, gate).await
    }

    async fn declare(&self, session: &Session, robot: &RobotId) -> Result<Heard> {
        let (keys, fleet) = (&self.keys, self.fleet.clone());
        let streams = keys.stream_of_any_kind(robot);
        Ok(Heard {
            streams: ingest::subscribe(session, keys, streams, fleet).await?,
            frequent: Vec::new(),
        })
    }

    /// Declares the keys of some robots that have begun to send.
    ///
    /// # Errors
    /// Zenoh refuses a declaration.
    pub async fn declare_frequent(&mut self, session: &Session) -> Result<()> {
        let (keys, fleet) = (&self.keys, &self.fleet);
        let open = self.declared.iter_mut();
        let open =
            open.filter(|(robot, heard)| heard.frequent.is_empty() && fleet.is_sending(robot));
        for (robot, heard) in open.take(KEYS_AT_ONCE_MAX) {
            let mut frequent = Vec::with_capacity(FREQUENT.len());
            for kind in FREQUENT {
                let key = keys.stream(robot, kind);
                let key = session.declare_keyexpr(key).await?;
                frequent.push(session.declare_publisher(key).await?);
            }
            heard.frequent = frequent;
        }
        Ok(())
    }

    /// Undeclares all of them.
    pub async fn close(self) {
        // A robot's keys go after its subscriber, which messages reach by them.
        for heard in self.declared.into_values() {
            warn_if_refused(heard.streams.undeclare().await);
        }
        if let Some(answers) = self.answers {
            warn_if_refused(answers.undeclare().await);
        }
    }
}
