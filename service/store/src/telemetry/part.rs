//! Part of an instance in work that a single service does alone.

use std::collections::BTreeSet;
use std::mem;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Mutex, PoisonError};

use fleetcal_proto::RobotId;

/// Part of this process.
#[derive(Debug, Default)]
pub(crate) struct Part {
    /// True if old rows are deleted here.
    deletes: AtomicBool,
    /// Robots that this process has begun to estimate and has not passed to the writer yet.
    adopted: Mutex<BTreeSet<RobotId>>,
}

impl Part {
    /// Makes the part of a service that is alone, or of an instance without any robot yet.
    pub(crate) fn new(is_alone: bool) -> Self {
        Self {
            deletes: AtomicBool::new(is_alone),
            adopted: Mutex::default(),
        }
    }

    pub(crate) fn deletes(&self) -> bool {
        self.deletes.load(Ordering::Relaxed)
    }

    pub(crate) fn set_deletes(&self, deletes: bool) {
        self.deletes.store(deletes, Ordering::Relaxed);
    }

    pub(crate) fn adopt(&self, robots: &[RobotId]) {
        self.adopted().extend(robots.iter().cloned());
    }

    pub(crate) fn take_adopted(&self) -> BTreeSet<RobotId> {
        mem::take(&mut *self.adopted())
    }

    // The set is whole after every statement, so the panic of another thread is no reason to stop.
    fn adopted(&self) -> std::sync::MutexGuard<'_, BTreeSet<RobotId>> {
        self.adopted.lock().unwrap_or_else(PoisonError::into_inner)
    }
}
