//! A question to the service, which may be several instances: one of them may be slow, cut off or
//! behind the others. All are asked, and the newest of what they say counts.

use std::time::Duration;

use fleetcal_model::Generation;
use fleetcal_proto::signing::TrustedKeys;
use tokio::sync::mpsc;
use tokio::time::{Instant, sleep_until};
use tracing::{debug, warn};
use zenoh::Session;
use zenoh::query::{ConsolidationMode, QueryTarget};
use zenoh::sample::Sample;

use super::event::Event;
use crate::session::at_key;
use crate::session_error::SessionError;

/// How long an agent waits for an answer.
const PULL_TIMEOUT: Duration = Duration::from_secs(5);
/// How long it waits for what other instances say once one has answered.
const OTHERS_WITHIN: Duration = Duration::from_millis(500);
/// Answers that wait to be compared.
const ANSWERS_MAX: usize = 16;

/// Reads a message, or says why it cannot be read.
pub(super) type Read = fn(&Sample) -> Result<Event, String>;

/// What an instance said, or why that cannot be read.
type Answer = Result<Event, String>;

/// Where answers go.
#[derive(Debug, Clone)]
pub(super) struct Asker {
    /// The session.
    pub session: Session,
    /// The agent.
    pub sender: mpsc::Sender<Event>,
    /// Whose signatures count: what somebody else signed is newer than nothing.
    pub trusted: Option<TrustedKeys>,
}

impl Asker {
    /// Asks all instances; the newest answer arrives as an event.
    pub async fn ask(&self, key: &str, read: Read) -> Result<(), SessionError> {
        let (sender, answers) = mpsc::channel(ANSWERS_MAX);
        let asked = self.session.get(key).timeout(PULL_TIMEOUT);
        let asked = asked.target(QueryTarget::All);
        let asked = asked.consolidation(ConsolidationMode::None);
        let asked = asked.callback(move |reply| {
            if let Ok(sample) = reply.result() {
                // One that finds no room is of the seventeenth instance.
                drop(sender.try_send(read(sample)));
            }
        });
        asked.await.map_err(at_key(key))?;
        let (sender, trusted) = (self.sender.clone(), self.trusted.clone());
        tokio::spawn(async move {
            let rank = |answer: &Answer| generation(answer, trusted.as_ref());
            hand_on_newest(answers, &sender, rank).await;
        });
        Ok(())
    }
}

/// Hands on the newest of what comes until all have answered or the others have had their time, and
/// what is newer still later.
async fn hand_on_newest(
    mut answers: mpsc::Receiver<Answer>,
    sender: &mpsc::Sender<Event>,
    rank: impl Fn(&Answer) -> Option<Generation>,
) {
    let Some(mut newest) = answers.recv().await else {
        return;
    };
    let until = Instant::now() + OTHERS_WITHIN;
    loop {
        tokio::select! {
            () = sleep_until(until) => break,
            answer = answers.recv() => match answer {
                Some(answer) if rank(&answer) > rank(&newest) => newest = answer,
                Some(_) => {}
                None => break,
            }
        }
    }
    let mut handed_on = rank(&newest);
    hand_on(sender, newest);
    while let Some(answer) = answers.recv().await {
        let rank = rank(&answer);
        if rank > handed_on {
            handed_on = rank;
            hand_on(sender, answer);
        }
    }
}

/// How new an answer is; `None` of one that cannot be believed.
fn generation(answer: &Answer, trusted: Option<&TrustedKeys>) -> Option<Generation> {
    match answer.as_ref().ok()? {
        Event::Offered(envelope) => Some(envelope.open(trusted?).ok()?.generation),
        Event::Confirmed(confirmed) => Some(confirmed.generation),
        _ => None,
    }
}

/// Zenoh's threads must never wait.
pub(super) fn hand_on(sender: &mpsc::Sender<Event>, read: Result<Event, String>) {
    match read {
        Ok(event) => {
            if sender.try_send(event).is_err() {
                debug!("a message found no room: the next pull brings it again");
            }
        }
        Err(reason) => warn!(reason, "a message on a calibration key cannot be read"),
    }
}
