//! One subscriber for each key expression that some robot's topics have.
//!
//! All have the same callback, which Zenoh calls in the order in which a robot has sent. Where
//! several match a key, each is called: the table says which of them takes the message for which
//! robot.

use std::collections::{BTreeMap, BTreeSet};

use zenoh::pubsub::Subscriber;
use zenoh::sample::{Locality, Sample};
use zenoh::{Result, Session};

use super::Ros2;
use crate::ingest;

/// Subscribers by their key expressions.
#[derive(Debug, Default)]
pub struct Subscriptions {
    declared: BTreeMap<String, Subscriber<()>>,
}

impl Subscriptions {
    /// Subscribes to the table's wanted key expressions alone.
    pub async fn follow(&mut self, session: &Session, ros2: &Ros2) -> Result<()> {
        let wanted = ros2.table().wanted_expressions();
        self.declare(session, ros2, &wanted).await?;
        let gone: Vec<String> = self
            .declared
            .keys()
            .filter(|&text| !wanted.contains(text))
            .cloned()
            .collect();
        for text in gone {
            if let Some(subscriber) = self.declared.remove(&text) {
                subscriber.undeclare().await?;
            }
        }
        Ok(())
    }

    async fn declare(
        &mut self,
        session: &Session,
        ros2: &Ros2,
        wanted: &BTreeSet<String>,
    ) -> Result<()> {
        for text in wanted {
            if self.declared.contains_key(text) {
                continue;
            }
            let (own, expression) = (ros2.clone(), text.clone());
            let subscriber = session
                .declare_subscriber(text.clone())
                .allowed_origin(Locality::Remote)
                .callback(move |sample| take(&own, &expression, &sample))
                .await?;
            self.declared.insert(text.clone(), subscriber);
        }
        Ok(())
    }

    /// Undeclares all of them.
    pub async fn close(self) {
        for (_, subscriber) in self.declared {
            super::warn_if_refused(subscriber.undeclare().await);
        }
    }
}

/// Processes a message from the subscriber of `expression`. It runs on Zenoh's receiving threads
/// and never blocks.
fn take(ros2: &Ros2, expression: &str, sample: &Sample) {
    let key = sample.key_expr().as_str();
    let fleet = &ros2.shared.fleet;
    let table = ros2.table();
    if table.is_own(key) {
        return;
    }
    let routes = table.routes(key);
    drop(table);
    if routes.is_empty() {
        fleet.count_foreign_key();
    }
    // What has another expression is heard and taken by another subscriber.
    for route in routes.iter().filter(|route| route.expression == expression) {
        ros2.seen_at(&route.robot, route.prefix, route.layout);
        let (robot, of) = (&route.robot, route.message_type);
        ingest::offer(fleet, robot, route.stream, of, sample);
    }
}
