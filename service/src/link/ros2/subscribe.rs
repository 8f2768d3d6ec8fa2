//! One subscriber for each key expression that some robot's topics have.
//!
//! All have the same callback, which Zenoh calls in the order in which a robot has sent.

use std::collections::{BTreeMap, BTreeSet};

use zenoh::key_expr::KeyExpr;
use zenoh::pubsub::Subscriber;
use zenoh::sample::{Locality, Sample};
use zenoh::{Result, Session};

use super::Ros2;
use crate::link::ingest;

/// The subscribers that there are, by their key expressions.
#[derive(Debug, Default)]
pub struct Subscriptions {
    declared: BTreeMap<String, Subscriber<()>>,
}

/// A key expression, and those that count first where they overlap, so that no message is taken
/// twice.
#[derive(Debug)]
struct Wanted {
    expression: KeyExpr<'static>,
    first: Vec<KeyExpr<'static>>,
}

impl Subscriptions {
    /// Subscribes to what the table wants now, and to nothing else.
    pub async fn follow(&mut self, session: &Session, ros2: &Ros2) -> Result<()> {
        let (usual, of_robots) = {
            let table = ros2.table();
            (table.usual_expressions(), table.robot_expressions())
        };
        let wanted = wanted(&usual, &of_robots)?;
        let gone: Vec<String> = self
            .declared
            .keys()
            .filter(|&text| !wanted.contains_key(text))
            .cloned()
            .collect();
        for text in gone {
            if let Some(subscriber) = self.declared.remove(&text) {
                subscriber.undeclare().await?;
            }
        }
        for (text, Wanted { expression, first }) in wanted {
            if self.declared.contains_key(&text) {
                continue;
            }
            let own = ros2.clone();
            let subscriber = session
                .declare_subscriber(expression)
                .allowed_origin(Locality::Remote)
                .callback(move |sample| {
                    let key = sample.key_expr();
                    if !first.iter().any(|other| other.intersects(key)) {
                        take(&own, &sample);
                    }
                })
                .await?;
            self.declared.insert(text, subscriber);
        }
        Ok(())
    }

    /// Ends all of them.
    pub async fn close(self) {
        for (_, subscriber) in self.declared {
            super::warn_if_refused(subscriber.undeclare().await);
        }
    }
}

/// What to subscribe to: nothing that another holds whole. Those of single robots overlap with
/// none of each other.
fn wanted(
    usual: &BTreeSet<String>,
    of_robots: &BTreeSet<String>,
) -> Result<BTreeMap<String, Wanted>> {
    let mut all: BTreeMap<String, Wanted> = BTreeMap::new();
    let mut before: Vec<KeyExpr<'static>> = Vec::new();
    for text in usual {
        let expression = KeyExpr::try_from(text.clone())?;
        let others = usual.iter().filter(|&other| other != text);
        let mut others = others.filter_map(|other| KeyExpr::try_from(other.clone()).ok());
        if others.any(|other| other.includes(&expression)) {
            continue;
        }
        let overlaps = before.iter().filter(|other| other.intersects(&expression));
        let first = overlaps.cloned().collect();
        before.push(expression.clone());
        all.insert(text.clone(), Wanted { expression, first });
    }
    for text in of_robots {
        let expression = KeyExpr::try_from(text.clone())?;
        if before.iter().any(|other| other.includes(&expression)) {
            continue;
        }
        let overlaps = before.iter().filter(|other| other.intersects(&expression));
        let first = overlaps.cloned().collect();
        all.insert(text.clone(), Wanted { expression, first });
    }
    Ok(all)
}

/// It runs on Zenoh's receiving threads and never blocks.
fn take(ros2: &Ros2, sample: &Sample) {
    let key = sample.key_expr().as_str();
    let fleet = &ros2.shared.fleet;
    let table = ros2.table();
    if table.is_own(key) {
        return;
    }
    let Some(route) = table.route(key) else {
        drop(table);
        fleet.count_foreign_key();
        return;
    };
    drop(table);
    ros2.seen_at(&route.robot, route.prefix, route.layout);
    ingest::offer(
        fleet,
        &route.robot,
        route.stream,
        route.message_type,
        sample,
    );
}

#[cfg(test)]
mod tests {
    use super::*;

    fn set(texts: &[&str]) -> BTreeSet<String> {
        texts.iter().map(|&text| text.to_owned()).collect()
    }

    #[test]
    fn no_message_can_be_taken_twice() {
        let usual = set(&["*/*/scan/T/*", "*/scan/T/*", "*/site/*/T/*", "*/scan"]);
        let robots = set(&[
            "*/tugger_01/scan/T/*",
            "*/tugger_01/front/T/*",
            "7/scan",
            "0/*/site/T/*",
        ]);
        let wanted = wanted(&usual, &robots).unwrap();
        let texts: Vec<&str> = wanted.keys().map(String::as_str).collect();
        assert_eq!(
            texts,
            [
                "*/*/scan/T/*",
                "*/scan",
                "*/scan/T/*",
                "*/site/*/T/*",
                "*/tugger_01/front/T/*",
                "0/*/site/T/*",
            ]
        );
        for key in [
            "0/tugger_01/scan/T/h",
            "0/site/scan/T/h",
            "0/site/site/T/h",
            "7/scan",
            "0/tugger_01/front/T/h",
        ] {
            let key = KeyExpr::try_from(key).unwrap();
            let takes = |of: &&Wanted| {
                of.expression.intersects(&key) && !of.first.iter().any(|of| of.intersects(&key))
            };
            assert_eq!(wanted.values().filter(takes).count(), 1, "{key}");
        }
    }
}
