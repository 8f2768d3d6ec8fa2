//! Counters of the two paths to the database.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::time::Duration;

use prometheus_client::metrics::histogram::Histogram;

use crate::error::StoreError;

/// Upper bounds of the buckets of transactions, s: from a commit without a sync to the busy timeout
/// of a database that another process holds.
const BUCKETS_S: [f64; 10] = [0.001, 0.0025, 0.005, 0.01, 0.025, 0.05, 0.1, 0.5, 2.5, 10.0];

/// Counters of one path since it was started.
#[derive(Debug)]
pub(crate) struct PathCounters {
    /// Durations of its transactions, committed and failed.
    pub(crate) durations: Histogram,
    pub(crate) commits: AtomicU64,
    pub(crate) failed_commits: AtomicU64,
    /// Writes that its task has received and not yet committed.
    pub(crate) pending: AtomicU64,
}

impl Default for PathCounters {
    fn default() -> Self {
        Self {
            durations: Histogram::new(BUCKETS_S),
            commits: AtomicU64::new(0),
            failed_commits: AtomicU64::new(0),
            pending: AtomicU64::new(0),
        }
    }
}

impl PathCounters {
    /// Counts the duration of a transaction.
    pub(crate) fn took(&self, duration: Duration) {
        self.durations.observe(duration.as_secs_f64());
    }

    /// Counts a commit.
    pub(crate) fn committed(&self) {
        self.commits.fetch_add(1, Ordering::Relaxed);
    }

    /// Counts and logs a failed commit.
    pub(crate) fn failed(&self, error: &StoreError) {
        self.failed_commits.fetch_add(1, Ordering::Relaxed);
        tracing::error!(%error, source = ?std::error::Error::source(error), "a commit failed");
    }
}

/// Counters of telemetry's rows.
#[derive(Debug, Default)]
pub(crate) struct TelemetryCounters {
    pub(crate) history_rows: AtomicU64,
    pub(crate) lost: AtomicU64,
    /// Seconds of history among the lost rows.
    pub(crate) lost_history: AtomicU64,
    pub(crate) pruned_rows: AtomicU64,
    pub(crate) fenced: AtomicU64,
}

/// Rows that were lost.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Lost {
    pub(crate) rows: u64,
    /// Seconds of history among them.
    pub(crate) history: u64,
}

impl TelemetryCounters {
    /// Counts rows that were not written because another instance has their robots by now.
    pub(crate) fn fence(&self, rows: u64) {
        self.fenced.fetch_add(rows, Ordering::Relaxed);
    }

    /// Counts and logs lost rows.
    pub(crate) fn lose(&self, lost: Lost) {
        if lost.rows == 0 {
            return;
        }
        self.lost.fetch_add(lost.rows, Ordering::Relaxed);
        self.lost_history.fetch_add(lost.history, Ordering::Relaxed);
        let Lost { rows, history } = lost;
        tracing::error!(rows, history, "rows are lost because the database fails");
    }
}

/// Counters of the store.
#[derive(Debug, Default)]
pub(crate) struct Counters {
    pub(crate) records: Arc<PathCounters>,
    pub(crate) telemetry: Arc<PathCounters>,
    pub(crate) rows: Arc<TelemetryCounters>,
    /// True if one of the paths does not progress although the database accepts writes.
    pub(crate) stuck: Arc<AtomicBool>,
}
