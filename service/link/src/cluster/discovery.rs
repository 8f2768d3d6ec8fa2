//! Listens now and then to robots that nobody has registered. One instance does it for all.

use fleetcal_cluster::Duty;
use fleetcal_domain::limits::{DISCOVERY_EVERY, DISCOVERY_FOR};
use fleetcal_proto::key::StreamKind;
use zenoh::Result;
use zenoh::pubsub::Subscriber;

use super::ClusterParts;
use crate::{ingest, warn_if_refused};

/// Streams by which such a robot is found: it sends one of them.
const STREAMS: [StreamKind; 2] = [StreamKind::Scan, StreamKind::LidarOdometry];

/// Listens while it is this instance's duty, until the link ends.
pub async fn listen(of: ClusterParts) {
    loop {
        let pause = if of.parts.gate.does(Duty::Discovery) {
            listen_once(&of).await;
            DISCOVERY_EVERY.saturating_sub(DISCOVERY_FOR)
        } else {
            DISCOVERY_FOR
        };
        tokio::select! {
            () = of.parts.stop.cancelled() => return,
            () = tokio::time::sleep(pause) => {}
        }
    }
}

async fn listen_once(of: &ClusterParts) {
    let mut subscribers = Vec::new();
    for stream in STREAMS {
        match subscribe(of, stream).await {
            Ok(subscriber) => subscribers.push(subscriber),
            Err(error) => tracing::warn!(error, "robots that nobody has registered are not heard"),
        }
    }
    tokio::select! {
        () = of.parts.stop.cancelled() => {}
        () = tokio::time::sleep(DISCOVERY_FOR) => {}
    }
    for subscriber in subscribers {
        warn_if_refused(subscriber.undeclare().await);
    }
}

async fn subscribe(of: &ClusterParts, stream: StreamKind) -> Result<Subscriber<()>> {
    let (keys, fleet) = (of.parts.keys.clone(), of.parts.fleet.clone());
    ingest::subscribe_strangers(&of.parts.session, &keys, keys.stream_of_all(stream), fleet).await
}
