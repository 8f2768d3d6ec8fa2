//! Task that writes telemetry: it gathers the rows of a second, and writes them in transactions so
//! short that no job waits long for one.

use std::sync::Arc;
use std::sync::atomic::Ordering;
use std::time::Duration;

use fleetcal_clock::SharedClock;
use fleetcal_cluster::ClaimId;
use fleetcal_domain::limits;
use tokio::sync::{mpsc, oneshot};
use tokio::time::{Instant, MissedTickBehavior};

use super::part::Part;
use super::pending::Pending;
use super::retention::Retention;
use super::{Aged, Telemetry, TelemetryWriter};
use crate::counters::{PathCounters, TelemetryCounters};
use crate::error::StoreError;
use crate::retry::{Retry, pause_until};

/// Channel to a waiting caller.
type Reply = oneshot::Sender<Result<(), StoreError>>;

/// Request to the task.
#[derive(Debug)]
pub(crate) enum Offered {
    /// Store a report, with the tenure that it was queued under.
    Keep(Telemetry, Option<ClaimId>),
    /// Write everything that was offered before.
    Flush(Reply),
    /// Write everything that was offered before, then end.
    Close(Reply),
}

/// State of the task.
#[derive(Debug)]
pub(crate) struct TelemetryTask<W> {
    writer: Box<W>,
    clock: SharedClock,
    path: Arc<PathCounters>,
    counters: Arc<TelemetryCounters>,
    pending: Pending,
    retry: Retry,
    retention: Retention,
    part: Arc<Part>,
    /// Rows received since a commit was last tried.
    taken: usize,
    flushes: Vec<Reply>,
    closers: Vec<Reply>,
}

impl<W: TelemetryWriter> TelemetryTask<W> {
    pub(crate) fn new(
        writer: W,
        clock: SharedClock,
        path: Arc<PathCounters>,
        counters: Arc<TelemetryCounters>,
        part: Arc<Part>,
    ) -> Self {
        Self {
            writer: Box::new(writer),
            clock,
            path,
            counters,
            pending: Pending::default(),
            retry: Retry::default(),
            retention: Retention::default(),
            part,
            taken: 0,
            flushes: Vec::new(),
            closers: Vec::new(),
        }
    }

    /// Writes until the store is closed or all its owners are gone.
    pub(crate) async fn run(mut self, mut offers: mpsc::Receiver<Offered>) {
        let mut tick = tokio::time::interval(limits::STORE_FLUSH_EVERY);
        tick.set_missed_tick_behavior(MissedTickBehavior::Delay);
        let mut inbox = Vec::with_capacity(limits::STORE_BATCH_MAX);
        let mut held = true;
        while held && self.closers.is_empty() {
            let retry_at = self.retry.at();
            // What comes while the task pauses waits in the queue, whose limit refuses it.
            let room = retry_at.is_none() || self.taken < limits::STORE_QUEUE_MAX;
            tokio::select! {
                received = offers.recv_many(&mut inbox, limits::STORE_BATCH_MAX), if room => {
                    held = received > 0;
                    self.take(inbox.drain(..));
                    let urgent = !self.flushes.is_empty() || self.pending.is_full();
                    if retry_at.is_none() && urgent {
                        self.write().await;
                    }
                }
                () = pause_until(retry_at), if retry_at.is_some() => {
                    self.write().await;
                }
                _ = tick.tick(), if retry_at.is_none() => {
                    if self.write().await.is_none() {
                        self.prune().await;
                    }
                }
            }
        }
        self.finish(offers).await;
    }

    fn take(&mut self, offered: impl Iterator<Item = Offered>) {
        for one in offered {
            match one {
                Offered::Keep(telemetry, claim) => {
                    let dropped = self.pending.take(telemetry, claim);
                    self.counters.fence(dropped);
                    self.taken += 1;
                }
                Offered::Flush(reply) => self.flushes.push(reply),
                Offered::Close(reply) => self.closers.push(reply),
            }
        }
        self.note_pending();
    }

    fn note_pending(&self) {
        let rows = self.pending.rows();
        self.path.pending.store(rows, Ordering::Relaxed);
    }

    /// Writes the waiting rows, one short transaction after another. A failure is reported to
    /// waiting callers, and returned.
    async fn write(&mut self) -> Option<StoreError> {
        self.taken = 0;
        let adopted = self.part.take_adopted();
        if !adopted.is_empty() {
            self.writer.adopt(adopted, self.clock.now());
        }
        let everything = !self.flushes.is_empty() || !self.closers.is_empty();
        self.pending.choose_current(everything);
        let mut failure = None;
        while let Some(mut batch) = self.pending.next() {
            let rows = batch.rows();
            let began = Instant::now();
            let written = self.writer.write(&mut batch).await;
            self.path.took(began.elapsed());
            self.counters.fence((rows - batch.rows()) as u64);
            match written {
                Ok(()) => {
                    self.path.committed();
                    let written = &self.counters.history_rows;
                    written.fetch_add(batch.history.len() as u64, Ordering::Relaxed);
                    self.note_pending();
                }
                Err(error) => {
                    self.counters.lose(self.pending.take_back(batch));
                    self.failed(&error);
                    failure = Some(error);
                    break;
                }
            }
        }
        if failure.is_none() {
            failure = self.writer.catch_up(everything).await.err();
            match &failure {
                None => self.retry.reset(),
                Some(error) => self.failed(error),
            }
        }
        self.note_pending();
        for flush in self.flushes.drain(..) {
            answer(flush, failure.clone().map_or(Ok(()), Err));
        }
        failure
    }

    fn failed(&mut self, error: &StoreError) {
        self.retry.failed(Instant::now());
        self.path.failed(error);
    }

    /// Deletes old rows, one kind after another.
    async fn prune(&mut self) {
        if !self.part.deletes() {
            return;
        }
        let now = self.clock.now();
        if !self.retention.may_delete(now, self.clock.elapsed()) {
            return;
        }
        for aged in Aged::ALL {
            let before_s = now.whole_s().saturating_sub(kept_s(aged));
            match self.writer.prune(aged, before_s).await {
                Ok(rows) => {
                    let pruned = &self.counters.pruned_rows;
                    pruned.fetch_add(rows, Ordering::Relaxed);
                }
                Err(error) => return self.failed(&error),
            }
        }
    }

    /// Writes the remaining rows, counts those that cannot be written, and closes the database.
    async fn finish(mut self, mut offers: mpsc::Receiver<Offered>) {
        offers.close();
        while let Some(offered) = offers.recv().await {
            self.take(std::iter::once(offered));
        }
        // The process has little time to end: the pauses begin again.
        self.retry.reset();
        let mut failure = None;
        for _ in 0..limits::STORE_CLOSE_TRIES {
            pause_until(self.retry.at()).await;
            failure = self.write().await;
            if failure.is_none() {
                break;
            }
        }
        let left = self.pending.left();
        let closed = self.writer.close().await;
        if let Err(error) = &closed {
            tracing::error!(%error, "the database could not be closed");
        }
        self.counters.lose(left);
        self.path.pending.store(0, Ordering::Relaxed);
        let ended = match (left.rows, failure) {
            (0, _) => closed,
            (rows, failure) => Err(StoreError::RowsLost {
                rows,
                source: failure.map(Box::new),
            }),
        };
        for closer in self.closers {
            answer(closer, ended.clone());
        }
    }
}

fn answer(reply: Reply, result: Result<(), StoreError>) {
    if reply.send(result).is_err() {
        tracing::debug!("the caller of a write no longer waits for its end");
    }
}

/// Time for which rows are kept, s.
fn kept_s(aged: Aged) -> i64 {
    let kept: Duration = match aged {
        Aged::Seconds => limits::HISTORY_SECONDS_KEPT,
        Aged::Minutes => limits::HISTORY_MINUTES_KEPT,
        Aged::Hours | Aged::Events => limits::HISTORY_HOURS_KEPT,
        Aged::Answers => limits::IDEMPOTENCY_KEPT,
        Aged::Alerts => limits::ALERTS_KEPT,
        Aged::Certificates => limits::CERTIFICATES_KEPT,
    };
    i64::try_from(kept.as_secs()).unwrap_or(i64::MAX)
}
