//! Digests of robots that instances exchange.

use fleetcal_cluster::{HEARTBEAT_EVERY, InstanceId};
use fleetcal_domain::limits;
use fleetcal_fleet::{Digest, Reported};
use fleetcal_proto::key::Key;
use tokio::sync::mpsc;
use tokio::task::JoinHandle;
use tokio::time::MissedTickBehavior;
use zenoh::Result;
use zenoh::bytes::Encoding;
use zenoh::pubsub::Subscriber;
use zenoh::qos::Priority;
use zenoh::sample::{Locality, Sample, SampleKind};

use super::ClusterParts;

/// Publishes this instance's reports to the other instances until the link ends.
pub async fn tell(of: ClusterParts) {
    let key = of.parts.keys.digest(of.cluster.instance());
    let mut ticks = tokio::time::interval(limits::DIGEST_EVERY);
    ticks.set_missed_tick_behavior(MissedTickBehavior::Delay);
    let mut told = Reported::default();
    loop {
        tokio::select! {
            () = of.parts.stop.cancelled() => return,
            _ = ticks.tick() => {}
        }
        let messages = match Digest::messages(&of.parts.fleet.reports(&mut told)) {
            Ok(messages) => messages,
            Err(error) => {
                tracing::error!(%error, "what is told of the robots is no JSON");
                continue;
            }
        };
        for message in messages {
            let put = of.parts.session.put(&key, message);
            let put = put.encoding(Encoding::APPLICATION_JSON);
            if !of.parts.gate.may_act() {
                break;
            }
            if let Err(error) = put.await {
                tracing::warn!(error, "other instances are not told of the robots");
            }
        }
    }
}

/// Sends heartbeats until the link ends. They contain nothing about robots, so they bypass the
/// gate.
pub async fn send_heartbeats(of: ClusterParts) {
    let key = of.parts.keys.digest(of.cluster.instance());
    let mut ticks = tokio::time::interval(HEARTBEAT_EVERY);
    ticks.set_missed_tick_behavior(MissedTickBehavior::Delay);
    loop {
        tokio::select! {
            () = of.parts.stop.cancelled() => return,
            _ = ticks.tick() => {}
        }
        let put = of.parts.session.put(&key, Digest::HEARTBEAT);
        let put = put.encoding(Encoding::APPLICATION_JSON);
        // It must not wait behind data, or be batched with it.
        let put = put.priority(Priority::RealTime).express(true);
        if let Err(error) = put.await {
            tracing::debug!(error, "a heartbeat was not sent");
        }
    }
}

/// Subscribes to the other instances' digests. The callback runs on Zenoh's receiving threads and
/// waits for nothing but the report's lock.
pub async fn hear(of: &ClusterParts) -> Result<(Subscriber<()>, JoinHandle<()>)> {
    let (sender, waiting) = mpsc::channel(limits::DIGESTS_WAITING_MAX);
    let (keys, own) = (of.parts.keys.clone(), of.cluster.instance().clone());
    let (report, clock) = (of.report.clone(), of.parts.clock.clone());
    let take = move |sample: Sample| {
        let payload = sample.payload();
        let fits = payload.len() <= limits::DIGEST_BYTES_MAX;
        let Ok(Key::Digest(instance)) = keys.parse(sample.key_expr().as_str()) else {
            return;
        };
        if sample.kind() != SampleKind::Put || instance == own || !fits {
            return;
        }
        let message = payload.to_bytes();
        if *message == *Digest::HEARTBEAT {
            report.send_if_modified(|report| {
                report.note_heartbeat(instance, clock.uptime());
                // Nobody waits for the next one.
                false
            });
            return;
        }
        let message = message.into_owned();
        if sender.try_send((instance, message)).is_err() {
            tracing::debug!("what another instance told found no room: it is told again");
        }
    };
    let subscriber = of
        .parts
        .session
        .declare_subscriber(of.parts.keys.digest_of_all())
        .allowed_origin(Locality::Remote)
        .callback(take)
        .await?;
    let reading = tokio::spawn(read(of.clone(), waiting));
    Ok((subscriber, reading))
}

async fn read(of: ClusterParts, mut waiting: mpsc::Receiver<(InstanceId, Vec<u8>)>) {
    loop {
        let message = tokio::select! {
            () = of.parts.stop.cancelled() => return,
            message = waiting.recv() => message,
        };
        let Some((instance, message)) = message else {
            return;
        };
        match Digest::read(&message) {
            Ok(digest) => of.parts.fleet.take_reports(&instance, digest.reports),
            Err(error) => {
                let instance = instance.as_str();
                tracing::warn!(instance, %error, "what an instance tells cannot be read");
            }
        }
    }
}
