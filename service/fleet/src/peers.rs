//! The Zenoh sessions of a service, as its link counts them for `/metrics` and the health page.

use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Mutex, PoisonError};

/// Reason for which the link closes a session.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum SessionClosed {
    /// Its name or address has as many sessions as it may.
    Share,
    /// All places are taken, and no owner has more of them than the session's.
    Full,
    /// A session of an owner with fewer got its place.
    MadeRoom,
    /// The process holds more memory than it may.
    Memory,
}

impl SessionClosed {
    /// All reasons.
    pub const ALL: [Self; 4] = [Self::Share, Self::Full, Self::MadeRoom, Self::Memory];

    /// Returns its name in metrics.
    pub fn name(self) -> &'static str {
        match self {
            Self::Share => "share",
            Self::Full => "full",
            Self::MadeRoom => "made_room",
            Self::Memory => "memory",
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
    /// Sets the number of open sessions, and describes an owner whose further ones get no place.
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

    /// Returns the number of open sessions.
    pub fn open(&self) -> usize {
        self.open.load(Ordering::Relaxed)
    }

    /// Returns the number of sessions that the link closed, by reason.
    pub fn closed(&self) -> [(&'static str, u64); SessionClosed::ALL.len()] {
        SessionClosed::ALL.map(|reason| {
            let count = self.closed.get(reason as usize);
            let count = count.map_or(0, |count| count.load(Ordering::Relaxed));
            (reason.name(), count as u64)
        })
    }

    /// Returns the description of an owner whose further sessions get no place.
    pub fn crowded(&self) -> Option<String> {
        let crowded = self.crowded.lock();
        crowded.unwrap_or_else(PoisonError::into_inner).clone()
    }
}
