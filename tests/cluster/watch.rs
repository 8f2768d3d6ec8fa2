//! Somebody who listens to all robots' estimates.

use std::collections::{BTreeMap, BTreeSet};
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};

use fleetcal_proto::calibration::Envelope;
use fleetcal_proto::estimate::EstimateDocument;
use fleetcal_tests::service::now;
use serde_json::Value;
use zenoh::pubsub::Subscriber;
use zenoh::{Config, Session};

use crate::checker::{Estimated, Evidence, Offered};

/// A received estimate.
#[derive(Debug, Clone)]
pub struct Heard {
    /// Time of arrival.
    pub at: Instant,
    /// The robot.
    pub robot: String,
    /// The instance; empty from a service that is alone.
    pub instance: String,
    /// The epoch; 0 from a service that is alone.
    pub epoch: i64,
}

/// Listener to all robots' estimates; see the module.
#[derive(Debug)]
pub struct Watch {
    heard: Arc<Mutex<Vec<Heard>>>,
    offered: Arc<Mutex<Vec<Offered>>>,
    _session: Session,
    _subscribers: [Subscriber<()>; 2],
}

impl Watch {
    /// Listens at some of these routers.
    pub async fn start(routers: &[String]) -> Self {
        let mut config = Config::default();
        for (key, value) in [
            ("mode", serde_json::json!("client")),
            ("connect/endpoints", serde_json::json!(routers)),
            ("scouting/multicast/enabled", serde_json::json!(false)),
        ] {
            config.insert_json5(key, &value.to_string()).unwrap();
        }
        let session = zenoh::open(config).await.unwrap();
        let heard = Arc::new(Mutex::new(Vec::new()));
        let list = Arc::clone(&heard);
        let subscriber = session
            .declare_subscriber("fleet/*/estimate")
            .callback(move |sample| {
                let document: EstimateDocument =
                    serde_json::from_slice(&sample.payload().to_bytes()).unwrap();
                let by = document.estimated_by.map(|by| (by.instance, by.epoch));
                let (instance, epoch) = by.unwrap_or_default();
                list.lock().unwrap().push(Heard {
                    at: now(),
                    robot: document.robot.to_string(),
                    instance,
                    epoch,
                });
            })
            .await
            .unwrap();
        let offered = Arc::new(Mutex::new(Vec::new()));
        let list = Arc::clone(&offered);
        let approved = session
            .declare_subscriber("fleet/*/calibration/approved")
            .callback(move |sample| {
                let envelope: Envelope =
                    serde_json::from_slice(&sample.payload().to_bytes()).unwrap();
                let document: Value = serde_json::from_str(&envelope.document).unwrap();
                list.lock().unwrap().push(Offered {
                    robot: document["robot"].as_str().unwrap().to_owned(),
                    generation: document["generation"].as_u64().unwrap(),
                    sha256: envelope.sha256,
                });
            })
            .await
            .unwrap();
        Self {
            heard,
            offered,
            _session: session,
            _subscribers: [subscriber, approved],
        }
    }

    /// Adds all received messages to the evidence.
    pub fn read(&self, into: &mut Evidence) {
        let heard = self.heard.lock().unwrap();
        let estimated = heard.iter().map(|one| Estimated {
            robot: one.robot.clone(),
            by: one.instance.clone(),
            epoch: one.epoch,
        });
        into.estimates = estimated.collect();
        into.documents.clone_from(&self.offered.lock().unwrap());
    }

    /// Returns the messages since, in order of arrival.
    pub fn since(&self, then: Instant) -> Vec<Heard> {
        let heard = self.heard.lock().unwrap();
        heard.iter().filter(|one| one.at >= then).cloned().collect()
    }

    /// Returns the time of the first estimate of each robot since.
    pub fn first_since(&self, then: Instant) -> BTreeMap<String, Instant> {
        let mut first = BTreeMap::new();
        for one in self.since(then) {
            first.entry(one.robot).or_insert(one.at);
        }
        first
    }

    /// Returns the instances of each robot's estimates since.
    pub fn owners(&self, then: Instant) -> BTreeMap<String, BTreeSet<String>> {
        let mut owners: BTreeMap<String, BTreeSet<String>> = BTreeMap::new();
        for one in self.since(then) {
            owners.entry(one.robot).or_default().insert(one.instance);
        }
        owners
    }

    /// Returns, for each robot, the time from `then` until its first estimate from another instance
    /// than `gone`; `None` while one has none.
    pub fn taken_over(&self, then: Instant, gone: &str, of: &[String]) -> Option<Vec<Duration>> {
        let since = self.since(then);
        let first = |robot: &String| {
            let mut others = since
                .iter()
                .filter(|one| one.robot == *robot && one.instance != gone);
            others.next().map(|one| one.at - then)
        };
        of.iter().map(first).collect()
    }

    /// Counts the estimates that came after one of the same robot with a higher epoch, by robot.
    pub fn stale(&self, then: Instant) -> BTreeMap<String, usize> {
        let mut highest: BTreeMap<String, i64> = BTreeMap::new();
        let mut stale = BTreeMap::new();
        for one in self.since(then) {
            let known = highest.entry(one.robot.clone()).or_insert(one.epoch);
            if one.epoch < *known {
                *stale.entry(one.robot).or_insert(0) += 1;
            } else {
                *known = one.epoch;
            }
        }
        stale
    }

    /// Returns the longest time between two estimates of each robot since.
    pub fn gaps(&self, then: Instant) -> BTreeMap<String, Duration> {
        let mut last: BTreeMap<String, Instant> = BTreeMap::new();
        let mut gaps: BTreeMap<String, Duration> = BTreeMap::new();
        for one in self.since(then) {
            if let Some(before) = last.insert(one.robot.clone(), one.at) {
                let gap = gaps.entry(one.robot).or_default();
                *gap = (*gap).max(one.at - before);
            }
        }
        gaps
    }
}
