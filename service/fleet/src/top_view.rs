//! A robot's top view: asked for by those who look, drawn up by its task between two messages.

use std::sync::{Arc, Mutex, PoisonError};

use fleetcal_domain::limits;
use fleetcal_estimator::calibrator::{TopView, TopViewLimits};
use tokio::sync::oneshot;

/// Message time for which repeated requests get the same view, s.
pub const EVERY_S: f64 = limits::TOP_VIEW_EVERY_S;

/// Limits of the shown surroundings.
pub const LIMITS: TopViewLimits = TopViewLimits {
    reach_m: limits::TOP_VIEW_REACH_M,
    surfaces_max: limits::TOP_VIEW_SURFACES_MAX,
    trajectory_m: limits::TOP_VIEW_TRAJECTORY_M,
    trajectory_points_max: limits::TOP_VIEW_TRAJECTORY_POINTS_MAX,
};

/// Answer to a request: nothing while nothing is known.
pub type Answer = Option<Arc<TopView>>;

/// Waiting requests for a robot's top view.
#[derive(Debug, Default)]
pub struct TopViewAskers {
    waiting: Mutex<Vec<oneshot::Sender<Answer>>>,
}

impl TopViewAskers {
    /// Queues a request for the view; `None` if [`limits::TOP_VIEW_ASKERS_MAX`] others wait. A
    /// request that will not be answered has its channel closed.
    pub fn ask(&self) -> Option<oneshot::Receiver<Answer>> {
        let mut waiting = self.lock();
        waiting.retain(|asker| !asker.is_closed());
        if waiting.len() >= limits::TOP_VIEW_ASKERS_MAX {
            return None;
        }
        let (asker, answer) = oneshot::channel();
        waiting.push(asker);
        Some(answer)
    }

    /// Removes and returns the waiting requests; dropping one closes its channel.
    pub fn take(&self) -> Vec<oneshot::Sender<Answer>> {
        std::mem::take(&mut *self.lock())
    }

    /// Locks the list. It is whole after every statement, so the panic of another thread is no
    /// reason to stop.
    fn lock(&self) -> std::sync::MutexGuard<'_, Vec<oneshot::Sender<Answer>>> {
        self.waiting.lock().unwrap_or_else(PoisonError::into_inner)
    }
}
