//! Values on trial: an estimator that begins from nothing when a robot begins to use them.
//!
//! What the robot's own estimator says rests on what led to the proposal. A second one that has
//! seen nothing of that proves the values, or does not.

use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::Arc;

use fleetcal_estimator::calibrator::CalibratorConfig;
use fleetcal_estimator::{Calibrator, Effect, Event};

use super::document;
use super::robot::Robot;

/// The estimator of the values on trial.
#[derive(Debug)]
pub struct Trial {
    generation: u64,
    since_ns: i64,
    calibrator: Box<Calibrator>,
}

impl Trial {
    /// Follows what is on trial: begins, goes on, or ends.
    pub fn follow(current: Option<Self>, robot: &Robot, config: &CalibratorConfig) -> Option<Self> {
        let (generation, since_ns) = robot.on_trial()?;
        current
            .filter(|trial| trial.generation == generation && trial.since_ns == since_ns)
            .or_else(|| {
                Some(Self {
                    generation,
                    since_ns,
                    calibrator: Box::new(Calibrator::new(config.clone())),
                })
            })
    }

    /// Takes what the robot sent since the values are in use. `None` when the estimator failed.
    pub fn take(mut self, robot: &Robot, event: &Event) -> Option<Self> {
        if stamp_ns(event).is_some_and(|stamp_ns| stamp_ns < self.since_ns) {
            return Some(self);
        }
        let calibrator = &mut self.calibrator;
        let stepped = catch_unwind(AssertUnwindSafe(|| calibrator.step(event.clone())));
        let Ok(effects) = stepped else {
            tracing::error!(robot.id = %robot.id, "the estimator of the values on trial panicked");
            return None;
        };
        for effect in effects {
            if let Effect::Estimate(estimate) = effect {
                let document = document::estimate_document(&robot.id, &estimate);
                if document::is_finite(&document) {
                    robot.set_fresh(self.generation, Arc::new(document));
                }
            }
        }
        Some(self)
    }
}

fn stamp_ns(event: &Event) -> Option<i64> {
    match event {
        Event::Drive(sample) => Some(sample.stamp().0),
        Event::Sweep(sweep) => Some(sweep.stamp().0),
        Event::LidarPose(pose) => Some(pose.stamp().0),
        Event::Note(_) | Event::EndOfSession => None,
    }
}
