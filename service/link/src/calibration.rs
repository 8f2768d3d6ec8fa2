//! Calibrations on the wire: what robots ask for, what they are sent, what they answer.

use fleetcal_domain::limits;
use fleetcal_operations::lifecycle::{Lifecycle, OutboxMessage};
use fleetcal_proto::RobotId;
use fleetcal_proto::key::{Key, Keys, StreamKind};
use fleetcal_proto::offer::{QUESTION_BYTES, Question};
use serde::Serialize;
use tokio_util::sync::CancellationToken;
use zenoh::bytes::Encoding;
use zenoh::qos::{CongestionControl, Priority};
use zenoh::query::{Query, Queryable};
use zenoh::{Result, Session, Wait};

use crate::gate::Gate;
use crate::questions::Questions;
use crate::ros2::{self, Ros2};

/// Context in which robots' queries are answered.
#[derive(Debug, Clone, Copy)]
pub struct Asked<'a> {
    /// The session.
    pub session: &'a Session,
    /// The keys under the configured root.
    pub keys: &'a Keys,
    /// Source of the answers.
    pub lifecycle: &'a Lifecycle,
    /// Queue of the queries.
    pub questions: &'a Questions,
    /// True if no other queryable is needed for a complete answer.
    pub complete: bool,
}

impl Asked<'_> {
    /// Declares a queryable that answers queries of a kind by `answer`.
    async fn declare<A: Future<Output = ()> + Send + 'static>(
        &self,
        kind: StreamKind,
        answer: fn(Lifecycle, Keys, Query) -> A,
    ) -> Result<Queryable<()>> {
        let (lifecycle, keys) = (self.lifecycle.clone(), self.keys.clone());
        let questions = self.questions.clone();
        self.session
            .declare_queryable(self.keys.stream_of_all(kind))
            .complete(self.complete)
            .callback(move |query| {
                questions.answer(answer(lifecycle.clone(), keys.clone(), query));
            })
            .await
    }
}

/// Answers queries for a robot's offer, from the database.
pub async fn answer_approved(asked: &Asked<'_>) -> Result<Queryable<()>> {
    let kind = StreamKind::CalibrationApproved;
    asked.declare(kind, reply_approved).await
}

async fn reply_approved(lifecycle: Lifecycle, keys: Keys, query: Query) {
    let Ok(Key::Stream { robot, .. }) = keys.parse(query.key_expr().as_str()) else {
        // A question about all robots at once is nobody's own.
        return;
    };
    let kind = StreamKind::CalibrationApproved;
    // First: what follows is signed with the new key.
    if let Some(announcement) = lifecycle.key_announcement() {
        reply(&query, &keys, &robot, kind, &announcement);
    }
    match lifecycle.approved(&robot, question_of(&query)).await {
        Ok(Some(offered)) => {
            reply(&query, &keys, &robot, kind, &offered);
        }
        Ok(None) => {}
        Err(error) => tracing::error!(robot.id = %robot, %error, "a question was not answered"),
    }
}

/// Returns the number in a robot's query, which its answer repeats; queries of older agents have
/// none.
fn question_of(query: &Query) -> Option<Question> {
    let payload = query.payload()?;
    if payload.len() != 2 * QUESTION_BYTES {
        return None;
    }
    Question::parse(&payload.try_to_string().ok()?).ok()
}

/// Answers queries for the confirmation of a robot's stored acknowledgement.
pub async fn answer_confirmed(asked: &Asked<'_>) -> Result<Queryable<()>> {
    let kind = StreamKind::CalibrationConfirmed;
    asked.declare(kind, reply_confirmed).await
}

async fn reply_confirmed(lifecycle: Lifecycle, keys: Keys, query: Query) {
    let Ok(Key::Stream { robot, .. }) = keys.parse(query.key_expr().as_str()) else {
        return;
    };
    let kind = StreamKind::CalibrationConfirmed;
    match lifecycle.latest_confirmed(&robot).await {
        Ok(Some(confirmed)) => reply(&query, &keys, &robot, kind, &confirmed),
        Ok(None) => {}
        Err(error) => tracing::error!(robot.id = %robot, %error, "a question was not answered"),
    }
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

/// Sender of the outbox.
#[derive(Debug)]
pub struct Post {
    /// The session.
    pub session: Session,
    /// The keys under the configured root.
    pub keys: Keys,
    /// Owner of the outbox.
    pub lifecycle: Lifecycle,
    /// ROS 2 topics of the robots.
    pub ros2: Ros2,
    /// Gate of outgoing messages.
    pub gate: Gate,
}

impl Post {
    /// Sends the outbox messages until `stop`. Unsent ones stay in the outbox.
    pub async fn send_outbox(self, stop: CancellationToken) {
        loop {
            let pause = if self.send_all().await {
                limits::POST_EVERY
            } else {
                limits::POST_RETRY
            };
            tokio::select! {
                () = stop.cancelled() => return,
                () = self.lifecycle.post_comes() => {}
                () = tokio::time::sleep(pause) => {}
            }
        }
    }

    /// Sends the outbox messages of the robots of this process; returns whether all were sent.
    async fn send_all(&self) -> bool {
        let entries = match self.lifecycle.outbox().await {
            Ok(entries) => entries,
            Err(error) => {
                tracing::error!(%error, "the outbox cannot be read");
                return false;
            }
        };
        let own = |(robot, _): &(RobotId, _)| self.gate.has(robot);
        let mut all = true;
        for (robot, entry) in entries.into_iter().filter(own) {
            let put = match self.lifecycle.message(&robot, entry).await {
                Ok(None) => continue,
                Ok(Some(_)) if !self.gate.lets(&robot) => return false,
                Ok(Some(message)) => {
                    let put = self.put(&robot, &message).await;
                    self.also_to_ros2(&robot, &message).await;
                    put
                }
                Err(error) => Err(error.into()),
            };
            let sent = match put {
                Ok(()) => {
                    let sent = self.lifecycle.sent(&robot, entry).await;
                    sent.map_err(Into::into)
                }
                Err(error) => Err(error),
            };
            if let Err(error) = sent {
                all = false;
                tracing::warn!(robot.id = %robot, ?entry, error, "not sent, and tried again");
            }
        }
        all
    }

    /// Publishes the message on the robot's ROS 2 topic too. A robot that misses it there queries
    /// for it.
    async fn also_to_ros2(&self, robot: &RobotId, message: &OutboxMessage) {
        let OutboxMessage::Approved(offered) = message else {
            return;
        };
        let told = ros2::calibration::publish(&self.session, &self.ros2, robot, offered);
        if let Err(error) = told.await {
            tracing::warn!(robot.id = %robot, error, "not sent to the robot's ROS 2 topic");
        }
    }

    /// Publishes an outbox message. It waits for room instead of dropping, because a calibration,
    /// unlike an estimate, is not repeated each second.
    async fn put(&self, robot: &RobotId, message: &OutboxMessage) -> Result<()> {
        let (kind, json) = match message {
            OutboxMessage::Approved(offered) => (
                StreamKind::CalibrationApproved,
                serde_json::to_vec(offered)?,
            ),
            OutboxMessage::Confirmed(confirmed) => (
                StreamKind::CalibrationConfirmed,
                serde_json::to_vec(confirmed)?,
            ),
        };
        let put = self
            .session
            .put(self.keys.stream(robot, kind), json)
            .encoding(Encoding::APPLICATION_JSON)
            .congestion_control(CongestionControl::Block)
            .priority(Priority::InteractiveHigh);
        if !self.gate.lets(robot) {
            return Err("the robot is another instance's by now".into());
        }
        put.await
    }
}
