//! What an agent says and hears over a robot's Zenoh session.
//!
//! The subscribers stand before the first question, so that nothing falls between the two. What is
//! pushed is a hint: whatever is lost comes with the next question.

use std::time::Duration;

use fleetcal_proto::calibration::{Applied, Confirmed, Envelope};
use fleetcal_proto::{Encoding, Keys, RobotId, StreamKind};
use tokio::sync::mpsc;
use tracing::{debug, warn};
use zenoh::Session;
use zenoh::pubsub::{Publisher, Subscriber};
use zenoh::sample::{Sample, SampleKind};

use super::event::Event;
use crate::session::{at_key, publisher};
use crate::session_error::SessionError;

/// How long an agent waits for an answer.
const PULL_TIMEOUT: Duration = Duration::from_secs(5);
/// Messages that wait for the agent; one that finds no room comes again with the next pull.
const INCOMING_MAX: usize = 8;
/// Longest confirmation that is read, bytes.
const CONFIRMED_BYTES_MAX: usize = 4096;

/// A robot's calibration keys, declared.
#[derive(Debug)]
pub(crate) struct CalibrationLink {
    session: Session,
    applied: Publisher<'static>,
    approved_key: String,
    confirmed_key: String,
    sender: mpsc::Sender<Event>,
    /// Held for what they do while they live.
    _subscribers: [Subscriber<()>; 3],
}

impl CalibrationLink {
    /// Declares them. What comes in arrives in the receiver.
    pub async fn declare(
        session: &Session,
        keys: &Keys,
        robot: &RobotId,
    ) -> Result<(Self, mpsc::Receiver<Event>), SessionError> {
        let (sender, incoming) = mpsc::channel(INCOMING_MAX);
        let approved_key = keys.stream(robot, StreamKind::CalibrationApproved);
        let confirmed_key = keys.stream(robot, StreamKind::CalibrationConfirmed);
        let applied = StreamKind::CalibrationApplied;
        let link = Self {
            applied: publisher(session, keys, robot, applied, Encoding::Json).await?,
            _subscribers: [
                subscribe(session, &approved_key, sender.clone(), offered).await?,
                subscribe(session, &confirmed_key, sender.clone(), confirmed).await?,
                watch_services(session, &keys.service_of_all(), sender.clone()).await?,
            ],
            session: session.clone(),
            approved_key,
            confirmed_key,
            sender,
        };
        Ok((link, incoming))
    }

    /// Answers the service.
    pub async fn acknowledge(&self, answer: &Applied) -> Result<(), SessionError> {
        let key = self.applied.key_expr().as_str();
        let payload = serde_json::to_vec(answer).map_err(|error| SessionError::Key {
            key: key.to_owned(),
            reason: error.to_string(),
        })?;
        self.applied.put(payload).await.map_err(at_key(key))
    }

    /// Asks for the approved document; it arrives as [`Event::Offered`].
    pub async fn ask_approved(&self) -> Result<(), SessionError> {
        self.ask(&self.approved_key, offered).await
    }

    /// Asks which answer is stored; it arrives as [`Event::Confirmed`].
    pub async fn ask_confirmed(&self) -> Result<(), SessionError> {
        self.ask(&self.confirmed_key, confirmed).await
    }

    async fn ask(&self, key: &str, read: Read) -> Result<(), SessionError> {
        let sender = self.sender.clone();
        let asked = self.session.get(key).timeout(PULL_TIMEOUT);
        let asked = asked.callback(move |reply| {
            if let Ok(sample) = reply.result() {
                hand_on(&sender, read(sample));
            }
        });
        asked.await.map_err(at_key(key))
    }
}

/// Reads a message, or says why it cannot be read.
type Read = fn(&Sample) -> Result<Event, String>;

fn offered(sample: &Sample) -> Result<Event, String> {
    let envelope = Envelope::from_json(&sample.payload().to_bytes());
    envelope
        .map(Event::Offered)
        .map_err(|error| error.to_string())
}

fn confirmed(sample: &Sample) -> Result<Event, String> {
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
    read: Read,
) -> Result<Subscriber<()>, SessionError> {
    let subscribed = session.declare_subscriber(key.to_owned());
    let subscribed = subscribed.callback(move |sample| {
        if sample.kind() == SampleKind::Put {
            hand_on(&sender, read(&sample));
        }
    });
    subscribed.await.map_err(at_key(key))
}

async fn watch_services(
    session: &Session,
    key: &str,
    sender: mpsc::Sender<Event>,
) -> Result<Subscriber<()>, SessionError> {
    let tokens = session.liveliness().declare_subscriber(key.to_owned());
    let watched = tokens.history(true).callback(move |sample| {
        if sample.kind() == SampleKind::Put {
            hand_on(&sender, Ok(Event::ServiceUp));
        }
    });
    watched.await.map_err(at_key(key))
}

/// Zenoh's threads must never wait.
fn hand_on(sender: &mpsc::Sender<Event>, read: Result<Event, String>) {
    match read {
        Ok(event) => {
            if sender.try_send(event).is_err() {
                debug!("a message found no room: the next pull brings it again");
            }
        }
        Err(reason) => warn!(reason, "a message on a calibration key cannot be read"),
    }
}
