//! Calibrations on the wire: what robots ask for, what they are sent, what they answer.

use fleetcal_domain::limits;
use fleetcal_operations::lifecycle::{Lifecycle, OutboxMessage};
use fleetcal_proto::RobotId;
use fleetcal_proto::calibration::Applied;
use fleetcal_proto::key::{Key, Keys, StreamKind};
use serde::Serialize;
use tokio_util::sync::CancellationToken;
use zenoh::bytes::Encoding;
use zenoh::pubsub::Subscriber;
use zenoh::qos::{CongestionControl, Priority};
use zenoh::query::{Query, Queryable};
use zenoh::sample::{Locality, Sample, SampleKind};
use zenoh::{Result, Session, Wait};

use crate::questions::Questions;
use crate::ros2::{self, Ros2};

/// Hears what robots answer. The callback runs on Zenoh's receiving threads and never blocks.
pub async fn hear_answers(
    session: &Session,
    keys: &Keys,
    lifecycle: Lifecycle,
) -> Result<Subscriber<()>> {
    let own_keys = keys.clone();
    session
        .declare_subscriber(keys.stream_of_all(StreamKind::CalibrationApplied))
        .allowed_origin(Locality::Remote)
        .callback(move |sample| {
            if let Ok(Key::Stream { robot, .. }) = own_keys.parse(sample.key_expr().as_str()) {
                take_answer(&lifecycle, &robot, &sample);
            }
        })
        .await
}

fn take_answer(lifecycle: &Lifecycle, robot: &RobotId, sample: &Sample) {
    let payload = sample.payload();
    if sample.kind() != SampleKind::Put || payload.len() > limits::ANSWER_BYTES_MAX {
        let bytes = payload.len();
        lifecycle.refuse_answer(
            robot,
            &format!("no message of an accepted size: {bytes} bytes"),
        );
        return;
    }
    match serde_json::from_slice::<Applied>(&payload.to_bytes()) {
        Ok(applied) => lifecycle.take_answer(robot, applied),
        Err(error) => lifecycle.refuse_answer(robot, &error.to_string()),
    }
}

/// Answers what a robot should hold, from the database.
pub async fn answer_approved(
    session: &Session,
    keys: &Keys,
    lifecycle: Lifecycle,
    questions: &Questions,
) -> Result<Queryable<()>> {
    let own_keys = keys.clone();
    let questions = questions.clone();
    session
        .declare_queryable(keys.stream_of_all(StreamKind::CalibrationApproved))
        .complete(true)
        .callback(move |query| {
            let (lifecycle, keys) = (lifecycle.clone(), own_keys.clone());
            questions.answer(async move { reply_approved(&lifecycle, &keys, &query).await });
        })
        .await
}

async fn reply_approved(lifecycle: &Lifecycle, keys: &Keys, query: &Query) {
    let Ok(Key::Stream { robot, .. }) = keys.parse(query.key_expr().as_str()) else {
        // A question about all robots at once is nobody's own.
        return;
    };
    match lifecycle.approved(&robot).await {
        Ok(Some(envelope)) => {
            reply(
                query,
                keys,
                &robot,
                StreamKind::CalibrationApproved,
                &envelope,
            );
        }
        Ok(None) => {}
        Err(error) => tracing::error!(robot.id = %robot, %error, "a question was not answered"),
    }
}

/// Answers which of a robot's answers is stored.
pub async fn answer_confirmed(
    session: &Session,
    keys: &Keys,
    lifecycle: Lifecycle,
) -> Result<Queryable<()>> {
    let own_keys = keys.clone();
    session
        .declare_queryable(keys.stream_of_all(StreamKind::CalibrationConfirmed))
        .complete(true)
        .callback(move |query| {
            if let Ok(Key::Stream { robot, .. }) = own_keys.parse(query.key_expr().as_str())
                && let Some(confirmed) = lifecycle.confirmed(&robot)
            {
                let kind = StreamKind::CalibrationConfirmed;
                reply(&query, &own_keys, &robot, kind, &confirmed);
            }
        })
        .await
}

fn reply<T: Serialize>(query: &Query, keys: &Keys, robot: &RobotId, kind: StreamKind, said: &T) {
    let Ok(json) = serde_json::to_vec(said) else {
        return;
    };
    let reply = query.reply(keys.stream(robot, kind), json);
    if let Err(error) = reply.encoding(Encoding::APPLICATION_JSON).wait() {
        tracing::debug!(robot.id = %robot, error, "a question was not answered");
    }
}

/// Sends what was decided, until `stop`. What is not sent stays in the outbox.
pub async fn send_outbox(
    session: Session,
    keys: Keys,
    lifecycle: Lifecycle,
    ros2: Ros2,
    stop: CancellationToken,
) {
    loop {
        let pause = if send_all(&session, &keys, &lifecycle, &ros2).await {
            limits::POST_EVERY
        } else {
            limits::POST_RETRY
        };
        tokio::select! {
            () = stop.cancelled() => return,
            () = lifecycle.post_comes() => {}
            () = tokio::time::sleep(pause) => {}
        }
    }
}

/// Sends what waits; whether all of it went.
async fn send_all(session: &Session, keys: &Keys, lifecycle: &Lifecycle, ros2: &Ros2) -> bool {
    let entries = match lifecycle.outbox().await {
        Ok(entries) => entries,
        Err(error) => {
            tracing::error!(%error, "the outbox cannot be read");
            return false;
        }
    };
    let mut all = true;
    for (robot, entry) in entries {
        let put = match lifecycle.message(&robot, entry).await {
            Ok(None) => continue,
            Ok(Some(message)) => {
                let put = put(session, keys, &robot, &message).await;
                also_to_ros2(session, ros2, &robot, &message).await;
                put
            }
            Err(error) => Err(error.into()),
        };
        let sent = match put {
            Ok(()) => lifecycle.sent(&robot, entry).await.map_err(Into::into),
            Err(error) => Err(error),
        };
        if let Err(error) = sent {
            all = false;
            tracing::warn!(robot.id = %robot, ?entry, error, "not sent, and tried again");
        }
    }
    all
}

/// On the robot's ROS 2 topic too. Who does not get it there asks for it.
async fn also_to_ros2(session: &Session, ros2: &Ros2, robot: &RobotId, message: &OutboxMessage) {
    let OutboxMessage::Approved(envelope) = message else {
        return;
    };
    if let Err(error) = ros2::calibration::publish(session, ros2, robot, envelope).await {
        tracing::warn!(robot.id = %robot, error, "not sent to the robot's ROS 2 topic");
    }
}

/// Waits for room instead of dropping: a calibration is no estimate that comes again in a second.
async fn put(
    session: &Session,
    keys: &Keys,
    robot: &RobotId,
    message: &OutboxMessage,
) -> Result<()> {
    let (kind, json) = match message {
        OutboxMessage::Approved(envelope) => (
            StreamKind::CalibrationApproved,
            serde_json::to_vec(envelope)?,
        ),
        OutboxMessage::Confirmed(confirmed) => (
            StreamKind::CalibrationConfirmed,
            serde_json::to_vec(confirmed)?,
        ),
    };
    session
        .put(keys.stream(robot, kind), json)
        .encoding(Encoding::APPLICATION_JSON)
        .congestion_control(CongestionControl::Block)
        .priority(Priority::InteractiveHigh)
        .await
}
