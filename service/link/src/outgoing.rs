//! Outgoing messages: estimates once a second, and the progress with a robot's messages.

use std::collections::BTreeMap;
use std::sync::Arc;
use std::time::Duration;

use fleetcal_cluster::Duty;
use fleetcal_fleet::FleetHandle;
use fleetcal_proto::RobotId;
use fleetcal_proto::estimate::{EstimateDocument, EstimatedBy};
use fleetcal_proto::key::{Key, Keys, StreamKind};
use tokio::time::MissedTickBehavior;
use tokio_util::sync::CancellationToken;
use zenoh::bytes::Encoding;
use zenoh::key_expr::KeyExpr;
use zenoh::query::{Query, Queryable};
use zenoh::{Result, Session, Wait};

use crate::gate::Gate;

/// Time between two estimates of a robot.
const ESTIMATE_EVERY: Duration = Duration::from_secs(1);

/// Publishes every robot's new estimate once a second.
pub async fn publish_estimates(
    session: Session,
    keys: Keys,
    fleet: FleetHandle,
    gate: Gate,
    stop: CancellationToken,
) {
    let mut ticks = tokio::time::interval(ESTIMATE_EVERY);
    ticks.set_missed_tick_behavior(MissedTickBehavior::Delay);
    let mut sent: BTreeMap<RobotId, Arc<EstimateDocument>> = BTreeMap::new();
    loop {
        tokio::select! {
            () = stop.cancelled() => return,
            _ = ticks.tick() => {}
        }
        let mut estimates = fleet.estimates();
        estimates.retain(|robot, _| gate.has(robot));
        for (robot, document) in &estimates {
            let last = sent.get(robot);
            if last.is_none_or(|last| !Arc::ptr_eq(last, document)) {
                put(&session, &keys, document, &gate).await;
            }
        }
        // What was held back leaves when the lease is renewed.
        if gate.may_act() {
            sent = estimates;
        }
    }
}

async fn put(session: &Session, keys: &Keys, document: &EstimateDocument, gate: &Gate) {
    let key = keys.stream(&document.robot, StreamKind::Estimate);
    let json = match gate.membership().tenure(&document.robot) {
        None => serde_json::to_vec(document),
        Some(tenure) => serde_json::to_vec(&EstimateDocument {
            estimated_by: Some(EstimatedBy {
                instance: tenure.seat.instance.as_str().to_owned(),
                epoch: tenure.epoch.0,
            }),
            ..document.clone()
        }),
    };
    let json = match json {
        Ok(json) => json,
        Err(error) => {
            tracing::error!(robot.id = %document.robot, %error, "estimate is no JSON");
            return;
        }
    };
    let put = session.put(key, json).encoding(Encoding::APPLICATION_JSON);
    if !gate.lets(&document.robot) {
        return;
    }
    if let Err(error) = put.await {
        tracing::warn!(robot.id = %document.robot, error, "estimate not sent");
    }
}

/// Answers queries for the progress with a robot's messages, so that a sender can pace itself. Of
/// several instances, the one that estimates the robot answers.
pub async fn answer_progress(
    session: &Session,
    keys: &Keys,
    fleet: FleetHandle,
    gate: Gate,
) -> Result<Queryable<()>> {
    let own_keys = keys.clone();
    session
        .declare_queryable(keys.stream_of_all(StreamKind::Progress))
        .complete(gate.membership().cluster().is_none())
        .callback(move |query| answer(&fleet, &own_keys, &gate, &query))
        .await
}

fn answer(fleet: &FleetHandle, keys: &Keys, gate: &Gate, query: &Query) {
    let asked = query.key_expr();
    let is_stranger = |robot: &RobotId| !fleet.is_registered(robot) && gate.does(Duty::Discovery);
    let is_own = |robot: &RobotId| gate.has(robot) || is_stranger(robot);
    if let Ok(Key::Stream { robot, .. }) = keys.parse(asked.as_str()) {
        // A robot that has sent nothing yet is told so: its sender has to begin somewhere.
        if is_own(&robot) {
            reply(fleet, keys, query, &robot);
        }
        return;
    }
    for robot in fleet.ids().into_iter().filter(is_own) {
        let key = keys.stream(&robot, StreamKind::Progress);
        if KeyExpr::try_from(key).is_ok_and(|key| asked.intersects(&key)) {
            reply(fleet, keys, query, &robot);
        }
    }
}

fn reply(fleet: &FleetHandle, keys: &Keys, query: &Query, robot: &RobotId) {
    let progress = fleet.progress(robot).unwrap_or_default();
    let key = keys.stream(robot, StreamKind::Progress);
    let Ok(json) = serde_json::to_vec(&progress) else {
        return;
    };
    if let Err(error) = query
        .reply(key, json)
        .encoding(Encoding::APPLICATION_JSON)
        .wait()
    {
        tracing::debug!(robot.id = %robot, error, "progress not answered");
    }
}
