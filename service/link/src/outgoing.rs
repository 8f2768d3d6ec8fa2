//! What goes out: estimates once a second, and how far the service is with a robot's messages.

use std::collections::BTreeMap;
use std::sync::Arc;
use std::time::Duration;

use fleetcal_fleet::FleetHandle;
use fleetcal_proto::RobotId;
use fleetcal_proto::estimate::EstimateDocument;
use fleetcal_proto::key::{Key, Keys, StreamKind};
use tokio::time::MissedTickBehavior;
use tokio_util::sync::CancellationToken;
use zenoh::bytes::Encoding;
use zenoh::key_expr::KeyExpr;
use zenoh::query::{Query, Queryable};
use zenoh::{Result, Session, Wait};

/// Time between two estimates of a robot.
const ESTIMATE_EVERY: Duration = Duration::from_secs(1);

/// Puts every robot's estimate once a second, when there is a new one.
pub async fn publish_estimates(
    session: Session,
    keys: Keys,
    fleet: FleetHandle,
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
        let estimates = fleet.estimates();
        for (robot, document) in &estimates {
            if sent
                .get(robot)
                .is_none_or(|last| !Arc::ptr_eq(last, document))
            {
                put(&session, &keys, document).await;
            }
        }
        sent = estimates;
    }
}

async fn put(session: &Session, keys: &Keys, document: &EstimateDocument) {
    let key = keys.stream(&document.robot, StreamKind::Estimate);
    let json = match serde_json::to_vec(document) {
        Ok(json) => json,
        Err(error) => {
            tracing::error!(robot.id = %document.robot, %error, "estimate is no JSON");
            return;
        }
    };
    if let Err(error) = session
        .put(key, json)
        .encoding(Encoding::APPLICATION_JSON)
        .await
    {
        tracing::warn!(robot.id = %document.robot, error, "estimate not sent");
    }
}

/// Answers how far the service is with a robot's messages, so that a sender can pace itself.
pub async fn answer_progress(
    session: &Session,
    keys: &Keys,
    fleet: FleetHandle,
) -> Result<Queryable<()>> {
    let own_keys = keys.clone();
    session
        .declare_queryable(keys.stream_of_all(StreamKind::Progress))
        .complete(true)
        .callback(move |query| answer(&fleet, &own_keys, &query))
        .await
}

fn answer(fleet: &FleetHandle, keys: &Keys, query: &Query) {
    let asked = query.key_expr();
    if let Ok(Key::Stream { robot, .. }) = keys.parse(asked.as_str()) {
        // A robot that has sent nothing yet is told so: its sender has to begin somewhere.
        reply(fleet, keys, query, &robot);
        return;
    }
    for robot in fleet.ids() {
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
