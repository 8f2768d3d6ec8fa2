//! A robot's plan: asked for by whoever looks, drawn up by its task between two messages.

use std::sync::{Arc, Mutex, PoisonError};

use fleetcal_domain::limits;
use fleetcal_estimator::calibrator::{Plan, PlanLimits};
use tokio::sync::oneshot;

/// What of a robot's surroundings is shown.
pub const LIMITS: PlanLimits = PlanLimits {
    reach_m: limits::PLAN_REACH_M,
    surfaces_max: limits::PLAN_SURFACES_MAX,
    trajectory_m: limits::PLAN_TRAJECTORY_M,
    trajectory_points_max: limits::PLAN_TRAJECTORY_POINTS_MAX,
};

/// What an asker is told: nothing while nothing is known.
pub type Answer = Option<Arc<Plan>>;

/// Those who have asked for a robot's plan and wait.
#[derive(Debug, Default)]
pub struct PlanAskers {
    waiting: Mutex<Vec<oneshot::Sender<Answer>>>,
}

impl PlanAskers {
    /// Waits for the plan; `None` when [`limits::PLAN_ASKERS_MAX`] others wait. An answer that
    /// never comes is closed.
    pub fn ask(&self) -> Option<oneshot::Receiver<Answer>> {
        let mut waiting = self.lock();
        waiting.retain(|asker| !asker.is_closed());
        if waiting.len() >= limits::PLAN_ASKERS_MAX {
            return None;
        }
        let (asker, answer) = oneshot::channel();
        waiting.push(asker);
        Some(answer)
    }

    /// Those who wait; to drop them is to tell them that nothing will come.
    pub fn take(&self) -> Vec<oneshot::Sender<Answer>> {
        std::mem::take(&mut *self.lock())
    }

    /// The list is whole after every statement, so the panic of another thread is no reason to stop.
    fn lock(&self) -> std::sync::MutexGuard<'_, Vec<oneshot::Sender<Answer>>> {
        self.waiting.lock().unwrap_or_else(PoisonError::into_inner)
    }
}
