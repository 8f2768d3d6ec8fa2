//! The Zenoh sessions of a service, as its link counts them for `/metrics` and the health page.

use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Mutex, PoisonError};

/// Reasons why the link closes a session.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum SessionClosed {
    /// Its name or address has as many as it may.
    Share,
    /// All places are taken, and nobody has more of them than it.
    Full,
    /// Another one got its place, whose name or address had fewer.
    MadeRoom,
}

impl SessionClosed {
    /// All reasons.
    pub const ALL: [Self; 3] = [Self::Share, Self::Full, Self::MadeRoom];

    /// Its name in metrics.
    pub fn name(self) -> &'static str {
        match self {
            Self::Share => "share",
            Self::Full => "full",
            Self::MadeRoom => "made_room",
        }
    }
}

/// Counters of Zenoh sessions.
#[derive(Debug, Default)]
pub struct PeerSessions {
    open: AtomicUsize,
    closed: [AtomicUsize; SessionClosed::ALL.len()],
    crowded: Mutex<Option<String>>,
}

impl PeerSessions {
    /// Takes how many sessions are open, and, where all places are taken, who has the most.
    pub fn set_open(&self, open: usize, crowded: Option<String>) {
        self.open.store(open, Ordering::Relaxed);
        *self.crowded.lock().unwrap_or_else(PoisonError::into_inner) = crowded;
    }

    /// Counts a session that the link closes.
    pub fn count_closed(&self, reason: SessionClosed) {
        if let Some(count) = self.closed.get(reason as usize) {
            count.fetch_add(1, Ordering::Relaxed);
        }
    }

    /// Sessions that are open.
    pub fn open(&self) -> usize {
        self.open.load(Ordering::Relaxed)
    }

    /// Sessions that the link closed, by reason.
    pub fn closed(&self) -> [(&'static str, u64); SessionClosed::ALL.len()] {
        SessionClosed::ALL.map(|reason| {
            let count = self.closed.get(reason as usize);
            let count = count.map_or(0, |count| count.load(Ordering::Relaxed));
            (reason.name(), count as u64)
        })
    }

    /// Owner of the most sessions, while all places are taken.
    pub fn crowded(&self) -> Option<String> {
        let crowded = self.crowded.lock();
        crowded.unwrap_or_else(PoisonError::into_inner).clone()
    }
}
