//! Notes about a robot: the last one that its estimator has taken, and whether a reassembly is open.

use std::sync::atomic::Ordering;

use fleetcal_model::AuditId;

use super::{Robot, lock};

impl Robot {
    /// Sets whether a reported reassembly is open.
    pub fn set_reassembly_open(&self, is_open: bool) {
        lock(&self.status).reassembly_open = is_open;
    }

    /// Sets the last note that its estimator has taken: the estimate that it shows is no older.
    pub fn set_notes_taken(&self, until: AuditId) {
        lock(&self.status).notes_taken = Some(until);
    }

    /// The last note that its estimator has taken.
    pub fn notes_taken(&self) -> Option<AuditId> {
        lock(&self.status).notes_taken
    }

    /// Asks for the notes that its task was not brought.
    pub fn want_notes(&self) {
        self.wants_notes.store(true, Ordering::Relaxed);
    }

    /// True if they were asked for since the last call.
    pub fn wanted_notes(&self) -> bool {
        self.wants_notes.swap(false, Ordering::Relaxed)
    }
}
