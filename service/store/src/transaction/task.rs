//! Task that runs jobs, in the order of their arrival.

use std::sync::Arc;
use std::sync::atomic::Ordering;

use fleetcal_domain::limits;
use tokio::sync::{mpsc, oneshot};
use tokio::time::Instant;

use super::RecordWriter;
use super::job::Waiting;
use crate::counters::PathCounters;
use crate::error::StoreError;
use crate::retry::{Retry, pause_until};

/// Request to the task.
#[derive(Debug)]
pub(crate) enum Asked {
    /// Run a job.
    Run(Waiting),
    /// Run the jobs requested before, and end.
    Close(oneshot::Sender<Result<(), StoreError>>),
}

/// State of the task.
#[derive(Debug)]
pub(crate) struct JobsTask<W> {
    writer: Box<W>,
    counters: Arc<PathCounters>,
    retry: Retry,
    jobs: Vec<Waiting>,
    closers: Vec<oneshot::Sender<Result<(), StoreError>>>,
}

impl<W: RecordWriter> JobsTask<W> {
    pub(crate) fn new(writer: W, counters: Arc<PathCounters>) -> Self {
        Self {
            writer: Box::new(writer),
            counters,
            retry: Retry::default(),
            jobs: Vec::new(),
            closers: Vec::new(),
        }
    }

    /// Runs jobs until the store is closed or all its owners are gone.
    pub(crate) async fn run(mut self, mut inbox: mpsc::Receiver<Asked>) {
        let mut asked = Vec::with_capacity(limits::STORE_JOBS_AT_ONCE_MAX);
        loop {
            // What comes while the task pauses waits in the queue, whose limit refuses it.
            pause_until(self.retry.at()).await;
            if inbox
                .recv_many(&mut asked, limits::STORE_JOBS_AT_ONCE_MAX)
                .await
                == 0
            {
                break;
            }
            for one in asked.drain(..) {
                match one {
                    Asked::Run(job) => self.jobs.push(job),
                    Asked::Close(closer) => self.closers.push(closer),
                }
            }
            self.commit().await;
            if !self.closers.is_empty() {
                // The process has little time to end.
                self.retry.reset();
                inbox.close();
            }
        }
        let closed = self.writer.close().await;
        if let Err(error) = &closed {
            tracing::error!(%error, "the database could not be closed");
        }
        for closer in self.closers {
            if closer.send(closed.clone()).is_err() {
                tracing::debug!("the caller no longer waits for the store to close");
            }
        }
    }

    /// Runs the received jobs and reports their outcomes to the waiting callers.
    async fn commit(&mut self) {
        if self.jobs.is_empty() {
            return;
        }
        let pending = self.jobs.len() as u64;
        self.counters.pending.store(pending, Ordering::Relaxed);
        let began = Instant::now();
        let ended = self.writer.run(&mut self.jobs).await;
        self.counters.took(began.elapsed());
        match &ended {
            Ok(()) => {
                self.retry.reset();
                self.counters.committed();
            }
            Err(error) => {
                self.retry.failed(Instant::now());
                self.counters.failed(error);
            }
        }
        self.counters.pending.store(0, Ordering::Relaxed);
        for job in self.jobs.drain(..) {
            job.answer(ended.clone());
        }
    }
}
