//! Presence of the instances, and whether robots reach this one.

use fleetcal_domain::limits::CLUSTER_LOOK_EVERY;
use fleetcal_proto::key::Key;
use tokio::time::MissedTickBehavior;
use zenoh::Result;
use zenoh::pubsub::Subscriber;
use zenoh::sample::{Sample, SampleKind};

use super::ClusterParts;

/// Follows the tokens of instances, including those that were there before.
pub async fn watch_services(of: &ClusterParts) -> Result<Subscriber<()>> {
    let (keys, report) = (of.parts.keys.clone(), of.report.clone());
    let own = of.cluster.instance().clone();
    let take = move |sample: Sample| {
        let Ok(Key::Service(instance)) = keys.parse(sample.key_expr().as_str()) else {
            return;
        };
        let stands = sample.kind() == SampleKind::Put;
        if instance == own {
            // What is left of the process before it.
            return;
        }
        report.send_if_modified(|report| report.note_token(instance, stands));
    };
    let tokens = of.parts.session.liveliness();
    let tokens = tokens.declare_subscriber(of.parts.keys.service_of_all());
    tokens.history(true).callback(take).await
}

/// Follows whether robots reach this instance: over itself, or over a router to which it is
/// connected.
pub async fn watch_link(of: ClusterParts) {
    let mut ticks = tokio::time::interval(CLUSTER_LOOK_EVERY);
    ticks.set_missed_tick_behavior(MissedTickBehavior::Delay);
    loop {
        tokio::select! {
            () = of.parts.stop.cancelled() => break,
            _ = ticks.tick() => {}
        }
        let linked = of.listens || of.parts.session.info().routers_zid().await.next().is_some();
        note_linked(&of, linked);
    }
    note_linked(&of, false);
}

fn note_linked(of: &ClusterParts, linked: bool) {
    let changed = of.report.send_if_modified(|report| {
        let changed = report.linked != linked;
        report.linked = linked;
        changed
    });
    if changed && !linked && !of.parts.stop.is_cancelled() {
        tracing::warn!("no Zenoh router is reached: robots are left to others");
    }
}
