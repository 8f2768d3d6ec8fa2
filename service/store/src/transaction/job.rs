//! Job of a transaction, and the request that waits for it.

use std::fmt;

use async_trait::async_trait;
use fleetcal_domain::limits;
use tokio::sync::oneshot;
use tokio::time::Instant;

use super::Records;
use crate::error::StoreError;

/// Job on records, done wholly or not at all.
///
/// A database may run a job more than once, for instance after a serialisation failure: each run
/// begins with the records as they were, and only the last one counts. So a job changes nothing but
/// the records, and brings along the times and random numbers that it needs.
#[async_trait]
pub trait Job: fmt::Debug + Send + Sync + 'static {
    /// Result for the caller once it is committed.
    type Done: Send + 'static;

    /// Runs the job.
    ///
    /// # Errors
    /// A refusal, or the database's failure; everything that this job wrote is undone.
    async fn run(&self, records: &mut dyn Records) -> Result<Self::Done, StoreError>;
}

/// Job that waits for its turn, with the caller that waits for its end.
#[derive(Debug)]
pub struct Waiting {
    job: Box<dyn Attempt>,
    asked_at: Instant,
    /// Outcome of its own transaction, if it has one.
    settled: Option<Result<(), StoreError>>,
}

impl Waiting {
    /// Makes a waiting job, and the channel of its outcome.
    pub fn new<J: Job>(job: J) -> (Self, oneshot::Receiver<Result<J::Done, StoreError>>) {
        let (reply, ended) = oneshot::channel();
        let job = Asked {
            job,
            done: None,
            reply,
        };
        let waiting = Self {
            job: Box::new(job),
            asked_at: Instant::now(),
            settled: None,
        };
        (waiting, ended)
    }

    /// Runs the job with these records. The caller undoes the writes of a failed job, which may
    /// then be run again.
    ///
    /// # Errors
    /// Those of the job, and [`StoreError::Late`] if the caller has been answered meanwhile: so
    /// nothing is changed long after its request was answered.
    pub async fn attempt(&mut self, records: &mut dyn Records) -> Result<(), StoreError> {
        if self.asked_at.elapsed() > limits::STORE_ANSWER_WITHIN {
            self.job.fail(StoreError::Late);
            return Err(StoreError::Late);
        }
        self.job.attempt(records).await
    }

    /// Sets the outcome of a transaction that was this job's alone.
    pub fn settle(&mut self, committed: Result<(), StoreError>) {
        self.settled = Some(committed);
    }

    /// Reports the outcome to the waiting caller: that of its last attempt, if its transaction was
    /// committed. The transaction is the job's own, if it had one, or else the one that all shared.
    pub fn answer(self, committed: Result<(), StoreError>) {
        self.job.answer(self.settled.unwrap_or(committed));
    }
}

/// Job with its type erased.
#[async_trait]
trait Attempt: fmt::Debug + Send {
    async fn attempt(&mut self, records: &mut dyn Records) -> Result<(), StoreError>;
    fn fail(&mut self, error: StoreError);
    fn answer(self: Box<Self>, committed: Result<(), StoreError>);
}

/// Job with the outcome of its last attempt and its waiting caller.
struct Asked<J: Job> {
    job: J,
    done: Option<Result<J::Done, StoreError>>,
    reply: oneshot::Sender<Result<J::Done, StoreError>>,
}

impl<J: Job> fmt::Debug for Asked<J> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.job.fmt(f)
    }
}

#[async_trait]
impl<J: Job> Attempt for Asked<J> {
    async fn attempt(&mut self, records: &mut dyn Records) -> Result<(), StoreError> {
        let done = self.job.run(records).await;
        let ended = done.as_ref().map(|_| ()).map_err(Clone::clone);
        self.done = Some(done);
        ended
    }

    fn fail(&mut self, error: StoreError) {
        self.done = Some(Err(error));
    }

    fn answer(self: Box<Self>, committed: Result<(), StoreError>) {
        let done = self.done.unwrap_or(Err(StoreError::Closed));
        let answer = committed.and(done);
        if self.reply.send(answer).is_err() {
            tracing::debug!("the caller of a job no longer waits for its end");
        }
    }
}
