//! A question to the service, which may be several instances: one of them may be slow, cut off or
//! behind the others. All are asked, and the newest of what they say counts.

use std::time::Duration;

use fleetcal_model::Generation;
use fleetcal_proto::offer::Question;
use fleetcal_proto::signing::TrustedKeys;
use tokio::sync::{mpsc, watch};
use tokio::time::{Instant, sleep_until};
use tracing::{debug, warn};
use zenoh::Session;
use zenoh::bytes::Encoding;
use zenoh::query::{ConsolidationMode, QueryTarget};
use zenoh::sample::Sample;

use super::event::Event;
use crate::session::at_key;
use crate::session_error::SessionError;

/// Longest wait of an agent for an answer.
const PULL_TIMEOUT: Duration = Duration::from_secs(5);
/// Wait for other instances once one has answered.
const OTHERS_WITHIN: Duration = Duration::from_millis(500);
/// Answers that wait for comparison.
const ANSWERS_MAX: usize = 16;

/// Answer of an instance, or the reason why it cannot be read.
pub(super) type Answer = Result<Event, String>;

/// Sender of queries.
#[derive(Debug, Clone)]
pub(super) struct Asker {
    /// The session.
    pub session: Session,
    /// Channel to the agent.
    pub sender: mpsc::Sender<Event>,
    /// Keys whose signatures are trusted now: answers of other signers rank lowest.
    pub trusted: Option<watch::Receiver<TrustedKeys>>,
}

impl Asker {
    /// Queries all instances; the newest answer arrives as an event. A query with a number gets an
    /// answer with that number, signed.
    pub async fn ask(
        &self,
        key: &str,
        question: Option<&Question>,
        read: impl Fn(&Sample) -> Answer + Send + Sync + 'static,
    ) -> Result<(), SessionError> {
        let (sender, answers) = mpsc::channel(ANSWERS_MAX);
        let agent = self.sender.clone();
        let asked = self.session.get(key).timeout(PULL_TIMEOUT);
        let asked = asked.target(QueryTarget::All);
        let mut asked = asked.consolidation(ConsolidationMode::None);
        if let Some(question) = question {
            asked = asked
                .payload(question.as_str())
                .encoding(Encoding::TEXT_PLAIN);
        }
        let asked = asked.callback(move |reply| {
            match reply.result().map(&read) {
                // Before the answer, which may be signed with the new key.
                Ok(Ok(change @ Event::KeyChanged(_))) => hand_on(&agent, Ok(change)),
                // One that finds no room is of the seventeenth instance.
                Ok(answer) => drop(sender.try_send(answer)),
                Err(_) => {}
            }
        });
        asked.await.map_err(at_key(key))?;
        let (sender, trusted) = (self.sender.clone(), self.trusted.clone());
        tokio::spawn(async move {
            let rank = |answer: &Answer| {
                let trusted = trusted.as_ref().map(|trusted| trusted.borrow().clone());
                rank(answer, trusted.as_ref())
            };
            hand_on_newest(answers, &sender, rank).await;
        });
        Ok(())
    }
}

/// Passes on the newest answer once all have answered or the others' time is over, and any newer
/// one later.
async fn hand_on_newest(
    mut answers: mpsc::Receiver<Answer>,
    sender: &mpsc::Sender<Event>,
    rank: impl Fn(&Answer) -> Option<Rank>,
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

/// Rank of an answer: first whether the service offers the document now, which older instances do
/// not, then its generation.
type Rank = (bool, Generation);

/// Ranks an answer; `None` for one that cannot be trusted.
fn rank(answer: &Answer, trusted: Option<&TrustedKeys>) -> Option<Rank> {
    match answer.as_ref().ok()? {
        Event::Offered { offered, answers } => {
            let offer = offered.open_offer(trusted?).ok();
            let is_wanted = offer.is_some_and(|offer| offer.question == *answers);
            let generation = offered.envelope.open(trusted?).ok()?.generation;
            Some((is_wanted, generation))
        }
        Event::Confirmed(confirmed) => Some((true, confirmed.open(trusted?).ok()?.generation)),
        _ => None,
    }
}

/// Passes on an answer without waiting, as Zenoh's threads must not wait.
pub(super) fn hand_on(sender: &mpsc::Sender<Event>, read: Answer) {
    match read {
        Ok(event) => {
            if sender.try_send(event).is_err() {
                debug!("a message found no room: the next pull brings it again");
            }
        }
        Err(reason) => warn!(reason, "a message on a calibration key cannot be read"),
    }
}
