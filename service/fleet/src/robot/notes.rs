//! Notes about a robot: the last one that its estimator has taken, and whether a reassembly is open.

use std::sync::atomic::Ordering;

use fleetcal_model::AuditId;

use super::{Robot, lock};

impl Robot {
    /// Sets whether a reported reassembly is open.
    pub fn set_reassembly_open(&self, is_open: bool) {
        lock(&self.status).reassembly_open = is_open;
    }

    /// True if a reported reassembly is open.
    pub fn is_reassembly_open(&self) -> bool {
        lock(&self.status).reassembly_open
    }

    /// Sets the last note that its estimator has processed: the shown estimate is no older.
    pub fn set_notes_taken(&self, until: AuditId) {
        lock(&self.status).notes_taken = Some(until);
    }

    /// Returns the last note that its estimator has processed.
    pub fn notes_taken(&self) -> Option<AuditId> {
        lock(&self.status).notes_taken
    }

    /// Requests the notes that its task has not received.
    pub fn want_notes(&self) {
        self.wants_notes.store(true, Ordering::Relaxed);
    }

    /// True if notes were requested since the last call.
    pub fn wanted_notes(&self) -> bool {
        self.wants_notes.swap(false, Ordering::Relaxed)
    }
}
