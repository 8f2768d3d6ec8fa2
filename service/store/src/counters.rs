//! What the two paths to the database have done.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};

use crate::error::StoreError;

/// What one path has done since it was started.
#[derive(Debug, Default)]
pub(crate) struct PathCounters {
    pub(crate) commits: AtomicU64,
    pub(crate) failed_commits: AtomicU64,
    /// Writes that its task has taken and not yet committed.
    pub(crate) pending: AtomicU64,
}

impl PathCounters {
    /// Counts a commit.
    pub(crate) fn committed(&self) {
        self.commits.fetch_add(1, Ordering::Relaxed);
    }

    /// Counts a commit that failed, and logs why.
    pub(crate) fn failed(&self, error: &StoreError) {
        self.failed_commits.fetch_add(1, Ordering::Relaxed);
        tracing::error!(%error, source = ?std::error::Error::source(error), "a commit failed");
    }
}

/// What telemetry has met besides.
#[derive(Debug, Default)]
pub(crate) struct TelemetryCounters {
    pub(crate) history_rows: AtomicU64,
    pub(crate) lost: AtomicU64,
    /// Those of `lost` that were seconds of history.
    pub(crate) lost_history: AtomicU64,
    pub(crate) pruned_rows: AtomicU64,
}

/// Rows that were lost.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Lost {
    pub(crate) rows: u64,
    /// Seconds of history among them.
    pub(crate) history: u64,
}

impl TelemetryCounters {
    /// Counts rows that are lost, and says so.
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

/// Everything that is counted.
#[derive(Debug, Default)]
pub(crate) struct Counters {
    pub(crate) records: Arc<PathCounters>,
    pub(crate) telemetry: Arc<PathCounters>,
    pub(crate) rows: Arc<TelemetryCounters>,
    /// Whether one of the paths does not get on although the database takes writes.
    pub(crate) stuck: Arc<AtomicBool>,
}
