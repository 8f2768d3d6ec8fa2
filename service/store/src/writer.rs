//! The one task that writes. It gathers what comes within a second into one transaction; whoever
//! waits for an answer is not kept waiting for the second.

use std::collections::HashMap;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};

use fleetcal_clock::SharedClock;
use fleetcal_domain::limits;
use fleetcal_proto::RobotId;
use tokio::sync::mpsc;
use tokio::time::{Instant, MissedTickBehavior};

use super::backend::{Outcomes, Retention, Writer};
use super::command::{Queued, answer};
use super::error::StoreError;
use super::pending::{Lost, Pending};
use super::retry::Retry;

/// Nanoseconds in a second.
const NS_PER_S: i64 = 1_000_000_000;

/// What the writer has done since it was started.
#[derive(Debug, Default)]
pub(super) struct WriterCounters {
    pub(super) commits: AtomicU64,
    pub(super) failed_commits: AtomicU64,
    pub(super) history_rows: AtomicU64,
    pub(super) lost: AtomicU64,
    /// Those of `lost` that were seconds of history.
    pub(super) lost_history: AtomicU64,
    /// Writes that the task has taken and not yet committed.
    pub(super) pending: AtomicU64,
    pub(super) pruned_rows: AtomicU64,
    /// Whether the writer does not get on although the database takes writes.
    pub(super) stuck: AtomicBool,
}

/// The task's state.
#[derive(Debug)]
pub(super) struct WriterTask<W> {
    database: Box<W>,
    clock: SharedClock,
    counters: Arc<WriterCounters>,
    pending: Pending,
    retry: Retry,
    /// Commands taken since the last commit was tried.
    taken: usize,
    /// When the stored estimate of each robot was last written, receipt time.
    current_written_ns: HashMap<RobotId, i64>,
}

impl<W: Writer> WriterTask<W> {
    pub(super) fn new(database: W, clock: SharedClock, counters: Arc<WriterCounters>) -> Self {
        Self {
            database: Box::new(database),
            clock,
            counters,
            pending: Pending::default(),
            retry: Retry::default(),
            taken: 0,
            current_written_ns: HashMap::new(),
        }
    }

    /// Writes until the store is closed or nobody holds it any more.
    pub(super) async fn run(mut self, mut commands: mpsc::Receiver<Queued>) {
        let mut tick = tokio::time::interval(limits::STORE_FLUSH_EVERY);
        tick.set_missed_tick_behavior(MissedTickBehavior::Delay);
        let mut inbox = Vec::with_capacity(limits::STORE_BATCH_MAX);
        let mut held = true;
        while held && self.pending.closers.is_empty() {
            let retry_at = self.retry.at();
            // What comes while the writer pauses waits in the queue, whose limit refuses it.
            let room = retry_at.is_none() || self.taken < limits::STORE_QUEUE_MAX;
            tokio::select! {
                received = commands.recv_many(&mut inbox, limits::STORE_BATCH_MAX), if room => {
                    held = received > 0;
                    self.take(inbox.drain(..));
                    if retry_at.is_none() && self.pending.is_urgent() {
                        self.commit(None).await;
                    }
                }
                () = pause_until(retry_at), if retry_at.is_some() => {
                    self.commit(None).await;
                }
                _ = tick.tick(), if retry_at.is_none() => {
                    let retention = retention(self.clock.now_ns());
                    self.commit(Some(retention)).await;
                }
            }
        }
        self.finish(commands).await;
    }

    fn take(&mut self, commands: impl Iterator<Item = Queued>) {
        for command in commands.filter_map(Queued::in_time) {
            self.pending.take(command);
            self.taken += 1;
        }
        self.note_pending();
    }

    fn note_pending(&self) {
        let rows = self.pending.rows();
        self.counters.pending.store(rows, Ordering::Relaxed);
    }

    /// Writes what is left, counts what cannot be written, and closes the database.
    async fn finish(mut self, mut commands: mpsc::Receiver<Queued>) {
        commands.close();
        while let Some(queued) = commands.recv().await {
            self.take(std::iter::once(queued));
        }
        // The process has little time to end: the pauses begin anew.
        self.retry.reset();
        let mut failure = None;
        for _ in 0..limits::STORE_CLOSE_TRIES {
            pause_until(self.retry.at()).await;
            self.pending.everything = true;
            failure = self.commit(None).await;
            if failure.is_none() {
                break;
            }
        }
        let left = self.pending.left();
        let closers = std::mem::take(&mut self.pending.closers);
        let closed = self.database.close().await;
        if let Err(error) = &closed {
            tracing::error!(%error, "the database could not be closed");
        }
        self.counters.lose(left);
        self.counters.pending.store(0, Ordering::Relaxed);
        let ended = match (left.rows, failure) {
            (0, _) => closed,
            (rows, failure) => Err(StoreError::RowsLost {
                rows,
                source: failure.map(Box::new),
            }),
        };
        for closer in closers {
            answer(closer, ended.clone());
        }
    }

    /// Writes what waits. A failure is told to those who wait, and is the result.
    async fn commit(&mut self, retention: Option<Retention>) -> Option<StoreError> {
        self.taken = 0;
        self.pending.batch.retention = retention;
        self.choose_current();
        let now_ns = self.clock.now_ns();
        if !self.pending.waiting.is_empty() {
            self.pending.batch.probe_ns = Some(now_ns);
        }
        let result = self.database.commit(&self.pending.batch).await;
        let failure = match result {
            Ok(outcomes) => {
                self.retry.reset();
                self.committed(outcomes);
                None
            }
            Err(error) => {
                self.retry.failed(Instant::now());
                self.failed(&error);
                Some(error)
            }
        };
        self.note_pending();
        failure
    }

    /// Takes the latest estimates whose turn has come into the batch: a robot's estimate is
    /// replaced every few seconds, not every second.
    fn choose_current(&mut self) {
        let everything = self.pending.everything;
        let every_ns = i64::try_from(limits::STORE_CURRENT_EVERY.as_nanos()).unwrap_or(i64::MAX);
        let written = &mut self.current_written_ns;
        let due = |robot: &RobotId, received_ns: i64| match written.get(robot) {
            Some(last_ns) => everything || received_ns.saturating_sub(*last_ns) >= every_ns,
            None => true,
        };
        let chosen: Vec<_> = self
            .pending
            .current
            .extract_if(|robot, (_, received_ns)| due(robot, *received_ns))
            .collect();
        for (robot, (estimate, received_ns)) in chosen {
            written.insert(robot, received_ns);
            self.pending.batch.current.push((estimate, received_ns));
        }
    }

    fn committed(&mut self, outcomes: Outcomes) {
        let batch = std::mem::take(&mut self.pending.batch);
        let counters = &self.counters;
        counters.commits.fetch_add(1, Ordering::Relaxed);
        counters
            .history_rows
            .fetch_add(batch.history.len() as u64, Ordering::Relaxed);
        counters
            .pruned_rows
            .fetch_add(outcomes.pruned, Ordering::Relaxed);
        for (reply, outcome) in self.pending.events.drain(..).zip(outcomes.events) {
            if let Some(reply) = reply {
                answer(reply, outcome);
            }
        }
        for (reply, outcome) in self.pending.robots.drain(..).zip(outcomes.robots) {
            answer(reply, outcome);
        }
        for (reply, outcome) in self.pending.users.drain(..).zip(outcomes.users) {
            answer(reply, outcome);
        }
        for (reply, outcome) in self.pending.tokens.drain(..).zip(outcomes.tokens) {
            answer(reply, outcome);
        }
        for (reply, outcome) in self.pending.decisions.drain(..).zip(outcomes.decisions) {
            answer(reply, outcome);
        }
        for (reply, outcome) in self.pending.holds.drain(..).zip(outcomes.holds) {
            answer(reply, outcome);
        }
        for (reply, outcome) in self.pending.policies.drain(..).zip(outcomes.policies) {
            answer(reply, outcome);
        }
        for (reply, outcome) in self.pending.alerts.drain(..).zip(outcomes.alerts) {
            answer(reply, outcome);
        }
        for (reply, outcome) in self.pending.webhooks.drain(..).zip(outcomes.webhooks) {
            answer(reply, outcome);
        }
        self.pending.everything = false;
        for reply in self.pending.waiting.drain(..) {
            answer(reply, Ok(()));
        }
    }

    /// Tells those who wait, and keeps the rest for the next transaction as far as it may grow.
    fn failed(&mut self, error: &StoreError) {
        self.counters.failed_commits.fetch_add(1, Ordering::Relaxed);
        tracing::error!(%error, source = ?std::error::Error::source(error), "a commit failed");
        let lost = self.pending.refuse(error);
        self.counters.lose(lost);
    }
}

impl WriterCounters {
    /// Counts rows that are lost, and says so.
    fn lose(&self, lost: Lost) {
        if lost.rows == 0 {
            return;
        }
        self.lost.fetch_add(lost.rows, Ordering::Relaxed);
        self.lost_history.fetch_add(lost.history, Ordering::Relaxed);
        let Lost { rows, history } = lost;
        tracing::error!(rows, history, "rows are lost because the database fails");
    }
}

/// Waits until an instant; not at all without one.
async fn pause_until(at: Option<Instant>) {
    if let Some(at) = at {
        tokio::time::sleep_until(at).await;
    }
}

/// What is too old at `now_ns`.
fn retention(now_ns: i64) -> Retention {
    let now_s = now_ns.div_euclid(NS_PER_S);
    let before = |kept: std::time::Duration| {
        now_s.saturating_sub(i64::try_from(kept.as_secs()).unwrap_or(i64::MAX))
    };
    Retention {
        seconds_before: before(limits::HISTORY_SECONDS_KEPT),
        minutes_before: before(limits::HISTORY_MINUTES_KEPT),
        hours_before: before(limits::HISTORY_HOURS_KEPT),
        idempotency_before: before(limits::IDEMPOTENCY_KEPT),
        alerts_before: before(limits::ALERTS_KEPT),
        rows_max: limits::RETENTION_ROWS_MAX,
    }
}
