//! Liveness of the tasks that write. A database that accepts no writes is not their fault and
//! recovers without a restart; a task that does not write although the database accepts writes is
//! stuck.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use fleetcal_domain::limits;
use tokio::sync::mpsc;
use tokio::task::{JoinHandle, JoinSet};
use tokio::time::{Instant, MissedTickBehavior};

use super::counters::PathCounters;
use super::error::StoreError;

/// Task that writes, as seen from outside.
#[derive(Debug)]
pub(super) struct Watched<T> {
    counters: Arc<PathCounters>,
    queue: mpsc::WeakSender<T>,
    commits: u64,
}

impl<T> Watched<T> {
    pub(super) fn new(counters: Arc<PathCounters>, queue: mpsc::WeakSender<T>) -> Self {
        Self {
            counters,
            queue,
            commits: 0,
        }
    }

    /// True if the task has committed since the last look, or has no work.
    fn is_well(&mut self) -> bool {
        let commits = self.counters.commits.load(Ordering::Relaxed);
        let queue = self.queue.upgrade();
        let queued = queue.map_or(0, |queue| queue.max_capacity() - queue.capacity());
        let waiting = queued as u64 + self.counters.pending.load(Ordering::Relaxed);
        let well = commits != self.commits || waiting == 0;
        self.commits = commits;
        well
    }
}

/// Liveness of the tasks that write, checked until they end.
#[derive(Debug)]
pub(super) struct Liveness<J, T> {
    records: Watched<J>,
    telemetry: Watched<T>,
    stuck: Arc<AtomicBool>,
    /// Begin of the time in which new connections have written while a task has not.
    overtaken_since: Option<Instant>,
    /// Write over a new connection that has not ended yet: no other one follows a write that hangs.
    fresh: Option<JoinHandle<Result<(), StoreError>>>,
}

impl<J, T> Liveness<J, T> {
    pub(super) fn new(records: Watched<J>, telemetry: Watched<T>, stuck: Arc<AtomicBool>) -> Self {
        Self {
            records,
            telemetry,
            stuck,
            overtaken_since: None,
            fresh: None,
        }
    }

    /// Checks every [`limits::STORE_LOOK_EVERY`] until both tasks end; `fresh` writes over a
    /// connection of its own.
    pub(super) async fn watch<F>(mut self, mut tasks: JoinSet<()>, fresh: impl Fn() -> F + Send)
    where
        F: Future<Output = Result<(), StoreError>> + Send + 'static,
    {
        let mut ticks = tokio::time::interval(limits::STORE_LOOK_EVERY);
        ticks.set_missed_tick_behavior(MissedTickBehavior::Delay);
        let mut failed = false;
        loop {
            tokio::select! {
                ended = tasks.join_next() => match ended {
                    Some(Ok(())) => {}
                    Some(Err(error)) => {
                        tracing::error!(%error, "a task of the store failed");
                        failed = true;
                        self.stuck.store(true, Ordering::Relaxed);
                    }
                    None => return,
                },
                now = ticks.tick(), if !failed => self.look(now, &fresh).await,
            }
        }
    }

    /// Checks both tasks at `now`.
    async fn look<F>(&mut self, now: Instant, fresh: &(impl Fn() -> F + Send))
    where
        F: Future<Output = Result<(), StoreError>> + Send + 'static,
    {
        // Both are looked at: each look begins where the last one ended.
        let (records, telemetry) = (self.records.is_well(), self.telemetry.is_well());
        if records && telemetry {
            self.overtaken_since = None;
            self.stuck.store(false, Ordering::Relaxed);
            return;
        }
        let write = self.fresh.get_or_insert_with(|| tokio::spawn(fresh()));
        let ended = tokio::time::timeout(limits::STORE_LOOK_EVERY, write).await;
        if ended.is_ok() {
            self.fresh = None;
        }
        if !matches!(ended, Ok(Ok(Ok(())))) {
            self.overtaken_since = None;
            return;
        }
        let since = *self.overtaken_since.get_or_insert(now);
        let overtaken_for = now.duration_since(since);
        let stuck = overtaken_for >= limits::STORE_STUCK_AFTER;
        if stuck && !self.stuck.swap(true, Ordering::Relaxed) {
            let for_s = overtaken_for.as_secs();
            tracing::error!(
                for_s,
                "the writer does not write, though the database accepts writes"
            );
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Bench of a task that has one row in memory and writes or does not, beside an idle one and a
    /// database that accepts writes or does not. The test controls its time.
    struct Bench {
        liveness: Liveness<(), ()>,
        counters: Arc<PathCounters>,
        now: Instant,
        writes: bool,
        takes: bool,
        _queue: mpsc::Sender<()>,
    }

    impl Bench {
        fn new() -> Self {
            let counters = Arc::new(PathCounters::default());
            counters.pending.store(1, Ordering::Relaxed);
            let (queue, _) = mpsc::channel(1);
            let idle = Watched::new(Arc::default(), queue.downgrade());
            let busy = Watched::new(Arc::clone(&counters), queue.downgrade());
            Self {
                liveness: Liveness::new(busy, idle, Arc::default()),
                counters,
                now: Instant::now(),
                writes: true,
                takes: true,
                _queue: queue,
            }
        }

        async fn is_stuck_after(&mut self, seconds: u64) -> bool {
            let takes = self.takes;
            let fresh = || async move { takes.then_some(()).ok_or(StoreError::Closed) };
            for _ in 0..seconds / limits::STORE_LOOK_EVERY.as_secs() {
                let commits = u64::from(self.writes);
                self.counters.commits.fetch_add(commits, Ordering::Relaxed);
                self.now += limits::STORE_LOOK_EVERY;
                self.liveness.look(self.now, &fresh).await;
            }
            self.liveness.stuck.load(Ordering::Relaxed)
        }
    }

    #[tokio::test]
    async fn a_writer_that_stops_beside_a_database_that_works_is_stuck() {
        let mut bench = Bench::new();
        assert!(!bench.is_stuck_after(300).await);
        bench.writes = false;
        assert!(!bench.is_stuck_after(55).await);
        assert!(bench.is_stuck_after(20).await);
        bench.writes = true;
        assert!(!bench.is_stuck_after(10).await);
    }

    #[tokio::test]
    async fn a_database_that_takes_nothing_is_not_the_writers_fault() {
        let mut bench = Bench::new();
        bench.writes = false;
        bench.takes = false;
        assert!(!bench.is_stuck_after(600).await);
        // The database is back, the writer too, a little later.
        bench.takes = true;
        assert!(!bench.is_stuck_after(20).await);
        bench.writes = true;
        assert!(!bench.is_stuck_after(600).await);
    }

    #[tokio::test]
    async fn a_writer_without_work_is_not_stuck() {
        let mut bench = Bench::new();
        bench.writes = false;
        bench.counters.pending.store(0, Ordering::Relaxed);
        assert!(!bench.is_stuck_after(600).await);
    }
}
