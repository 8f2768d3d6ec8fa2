//! Link of an agent to the service over a robot's Zenoh session.
//!
//! The subscribers stand before the first question, so that nothing falls between the two. What is
//! pushed is a hint: whatever is lost comes with the next question.

use std::hash::{DefaultHasher, Hash, Hasher};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

use fleetcal_proto::calibration::{Applied, Confirmed};
use fleetcal_proto::key_change::{KEY_CHANGE_BYTES_MAX, KEY_CHANGES_MAX, KeyAnnouncement};
use fleetcal_proto::offer::{Offered, QUESTION_BYTES, Question};
use fleetcal_proto::signing::TrustedKeys;
use fleetcal_proto::{Encoding, Keys, RobotId, StreamKind};
use tokio::runtime::Handle;
use tokio::sync::{mpsc, watch};
use zenoh::Session;
use zenoh::pubsub::{Publisher, Subscriber};
use zenoh::sample::{Sample, SampleKind};

use super::event::Event;
use super::question::{Answer, Asker, hand_on};
use crate::session::{at_key, publisher};
use crate::session_error::SessionError;

/// Time within which robots turn to a further service after one was there: each at its own moment.
const TURN_WITHIN: Duration = Duration::from_secs(10);
/// Messages that wait for the agent; those beyond come again with the next pull.
const INCOMING_MAX: usize = 8;
/// Longest confirmation that is read, bytes.
const CONFIRMED_BYTES_MAX: usize = 4096;
/// Longest announcement of changes of key that is read, bytes.
const KEY_ANNOUNCEMENT_BYTES_MAX: usize = KEY_CHANGES_MAX * KEY_CHANGE_BYTES_MAX;

/// Declarations of a robot's calibration keys.
#[derive(Debug)]
pub(crate) struct CalibrationLink {
    asker: Asker,
    applied: Publisher<'static>,
    approved_key: String,
    confirmed_key: String,
    /// Subscribers, active while they live.
    _subscribers: [Subscriber<()>; 3],
}

impl CalibrationLink {
    /// Declares the keys. Incoming messages arrive in the receiver. Of several answers to one
    /// query, the newest that a key in `trusted` has signed is used.
    pub async fn declare(
        session: &Session,
        keys: &Keys,
        robot: &RobotId,
        trusted: Option<watch::Receiver<TrustedKeys>>,
    ) -> Result<(Self, mpsc::Receiver<Event>), SessionError> {
        let (sender, incoming) = mpsc::channel(INCOMING_MAX);
        let approved_key = keys.stream(robot, StreamKind::CalibrationApproved);
        let confirmed_key = keys.stream(robot, StreamKind::CalibrationConfirmed);
        let applied = StreamKind::CalibrationApplied;
        let link = Self {
            applied: publisher(session, keys, robot, applied, Encoding::Json).await?,
            _subscribers: [
                subscribe(session, &approved_key, sender.clone(), pushed).await?,
                subscribe(session, &confirmed_key, sender.clone(), confirmed).await?,
                watch_services(session, &keys.service_of_all(), robot, sender.clone()).await?,
            ],
            asker: Asker {
                session: session.clone(),
                sender,
                trusted,
            },
            approved_key,
            confirmed_key,
        };
        Ok((link, incoming))
    }

    /// Sends an acknowledgement to the service.
    pub async fn acknowledge(&self, answer: &Applied) -> Result<(), SessionError> {
        let key = self.applied.key_expr().as_str();
        let payload = serde_json::to_vec(answer).map_err(|error| SessionError::Key {
            key: key.to_owned(),
            reason: error.to_string(),
        })?;
        self.applied.put(payload).await.map_err(at_key(key))
    }

    /// Queries the approved document; it arrives as [`Event::Offered`].
    pub async fn ask_approved(&self) -> Result<(), SessionError> {
        let key = &self.approved_key;
        let mut bytes = [0; QUESTION_BYTES];
        getrandom::fill(&mut bytes).map_err(|error| SessionError::Key {
            key: key.clone(),
            reason: error.to_string(),
        })?;
        let question = Question::from_bytes(bytes);
        let answers = Some(question.clone());
        let read = move |sample: &Sample| offered(sample, answers.clone());
        self.asker.ask(key, Some(&question), read).await
    }

    /// Queries the stored acknowledgement; it arrives as [`Event::Confirmed`].
    pub async fn ask_confirmed(&self) -> Result<(), SessionError> {
        self.asker.ask(&self.confirmed_key, None, confirmed).await
    }
}

fn pushed(sample: &Sample) -> Answer {
    offered(sample, None)
}

fn offered(sample: &Sample, answers: Option<Question>) -> Answer {
    let payload = sample.payload().to_bytes();
    match Offered::from_json(&payload) {
        Ok(offered) => Ok(Event::Offered { offered, answers }),
        Err(error) => key_announced(&payload).ok_or_else(|| error.to_string()),
    }
}

fn key_announced(payload: &[u8]) -> Option<Event> {
    if payload.len() > KEY_ANNOUNCEMENT_BYTES_MAX {
        return None;
    }
    let announcement: KeyAnnouncement = serde_json::from_slice(payload).ok()?;
    Some(Event::KeyChanged(announcement.key_changes))
}

fn confirmed(sample: &Sample) -> Answer {
    let payload = sample.payload();
    if payload.len() > CONFIRMED_BYTES_MAX {
        let length = payload.len();
        return Err(format!(
            "confirmation: got {length} bytes, expected at most {CONFIRMED_BYTES_MAX}"
        ));
    }
    let confirmed: Result<Confirmed, _> = serde_json::from_slice(&payload.to_bytes());
    confirmed
        .map(Event::Confirmed)
        .map_err(|error| format!("confirmation: {error}"))
}

async fn subscribe(
    session: &Session,
    key: &str,
    sender: mpsc::Sender<Event>,
    read: fn(&Sample) -> Answer,
) -> Result<Subscriber<()>, SessionError> {
    let subscribed = session.declare_subscriber(key.to_owned());
    let subscribed = subscribed.callback(move |sample| {
        if sample.kind() == SampleKind::Put {
            hand_on(&sender, read(&sample));
        }
    });
    subscribed.await.map_err(at_key(key))
}

/// Reports the appearance of a service: at once for the first, and at the robot's own moment for
/// later ones, as all robots notice them together.
async fn watch_services(
    session: &Session,
    key: &str,
    robot: &RobotId,
    sender: mpsc::Sender<Event>,
) -> Result<Subscriber<()>, SessionError> {
    let tokens = session.liveliness().declare_subscriber(key.to_owned());
    let (runtime, robot) = (Handle::current(), robot.clone());
    let was_there = AtomicBool::new(false);
    let waits = Arc::new(AtomicBool::new(false));
    let watched = tokens.history(true).callback(move |sample| {
        if sample.kind() != SampleKind::Put {
            return;
        }
        if !was_there.swap(true, Ordering::Relaxed) {
            hand_on(&sender, Ok(Event::ServiceUp));
        } else if !waits.swap(true, Ordering::Relaxed) {
            let turn = turn(&robot, sample.key_expr().as_str());
            let (sender, waits) = (sender.clone(), Arc::clone(&waits));
            runtime.spawn(async move {
                tokio::time::sleep(turn).await;
                waits.store(false, Ordering::Relaxed);
                hand_on(&sender, Ok(Event::ServiceUp));
            });
        }
    });
    watched.await.map_err(at_key(key))
}

/// Returns the delay with which a robot turns to a service that appeared: different for each robot.
fn turn(robot: &RobotId, token: &str) -> Duration {
    let mut hasher = DefaultHasher::new();
    (robot.as_str(), token).hash(&mut hasher);
    let within_ms = u64::try_from(TURN_WITHIN.as_millis()).unwrap_or(u64::MAX);
    Duration::from_millis(hasher.finish() % within_ms)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn robots_turn_to_a_service_one_after_another() {
        let turns = (0..1_000).map(|number| {
            let robot = RobotId::parse(&format!("tugger_{number}")).unwrap();
            turn(&robot, "fleet/@service/a").as_secs()
        });
        let mut in_second = [0; 10];
        for second in turns {
            in_second[second as usize] += 1;
        }
        assert!(
            in_second.iter().all(|robots| (60..140).contains(robots)),
            "{in_second:?}"
        );
    }
}
