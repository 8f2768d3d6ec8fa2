//! Values in verification: an estimator that begins from nothing when a robot begins to use them.
//!
//! What the robot's own estimator says rests on what led to the proposal. A second one that has
//! seen nothing of that proves the values, or does not. It is told what is known of the scanner:
//! that belongs to the sensor, and no calibration changes it.
//!
//! It begins by the robot's messages alone: the acknowledgement is a place among them, and the
//! agent's clock may be years away from their stamps (simulated time, no NTP).

use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::Arc;

use fleetcal_estimator::calibrator::CalibratorConfig;
use fleetcal_estimator::calibrator::CheckpointRefused;
use fleetcal_estimator::lidar_odometry::LearntScanner;
use fleetcal_estimator::{
    Calibrator, Checkpoint, Effect, Estimate, Event, RobotTime, without_range_scale,
};
use fleetcal_model::Generation;
use serde::{Deserialize, Serialize};

use super::document;
use super::robot::Robot;
use fleetcal_domain::limits::IN_FLIGHT_S;

/// Start of the messages that count.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
enum Start {
    /// Open: no message has come since the acknowledgement.
    Open,
    /// Messages before this stamp may have been sent before the acknowledgement.
    At(RobotTime),
    /// Every message counts.
    Begun,
}

impl Start {
    /// Returns the start after a message, which counts if the result is [`Start::Begun`].
    fn after(self, stamp: RobotTime) -> Self {
        let later = || {
            Self::At(RobotTime(
                stamp.0.saturating_add((IN_FLIGHT_S * 1e9) as i64),
            ))
        };
        match self {
            Self::Open => later(),
            Self::At(from) if stamp >= from => Self::Begun,
            // Farther back than messages overtake each other: the clock was set.
            Self::At(from) if from.seconds_since(stamp) > 3.0 * IN_FLIGHT_S => later(),
            Self::At(_) | Self::Begun => self,
        }
    }
}

/// The estimator of the values in verification.
#[derive(Debug)]
pub struct VerificationRun {
    generation: Generation,
    since: RobotTime,
    start: Start,
    calibrator: Box<Calibrator>,
}

/// Stored verification run, to continue after a restart of the service.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct StoredRun {
    generation: Generation,
    since: RobotTime,
    start: Start,
    calibrator: Checkpoint,
}

impl VerificationRun {
    /// Returns the state to be stored.
    pub fn to_stored(&self) -> StoredRun {
        StoredRun {
            generation: self.generation,
            since: self.since,
            start: self.start,
            calibrator: self.calibrator.checkpoint(),
        }
    }

    /// Restores a stored run; it continues if the same values are still in verification.
    ///
    /// # Errors
    /// The estimator's state belongs to another version.
    pub fn restore(
        config: &CalibratorConfig,
        stored: &StoredRun,
    ) -> Result<Self, CheckpointRefused> {
        let calibrator = Calibrator::restore(config.clone(), &stored.calibrator)?;
        Ok(Self {
            generation: stored.generation,
            since: stored.since,
            start: stored.start,
            calibrator: Box::new(calibrator),
        })
    }

    /// Shows the result so far, if it concerns the values in verification: after a restart, before
    /// the robot sends anything.
    pub fn show(&self, robot: &Robot) {
        let estimate = self.calibrator.estimate();
        let is_due = robot.in_verification() == Some((self.generation, self.since));
        if is_due && estimate.stamp.0 > 0 {
            self.tell(robot, &estimate);
        }
    }

    fn tell(&self, robot: &Robot, estimate: &Estimate) {
        // The values were measured by the LiDAR that they are compared with.
        let compared = without_range_scale(estimate.clone());
        let mut document = document::estimate_document(&robot.id, &compared);
        document.motions = Some(document::motions(&self.calibrator));
        if let Some(finding) = robot.checks().spoiling() {
            document::give_way(&mut document, finding);
        }
        if document::is_finite(&document) {
            robot.set_fresh(self.generation, Arc::new(document));
        }
    }

    /// Follows the values in verification: begins with the `scanner` that the robot's own estimator
    /// has learnt, continues, or ends.
    pub fn follow(
        current: Option<Self>,
        robot: &Robot,
        config: &CalibratorConfig,
        scanner: impl FnOnce() -> Option<LearntScanner>,
    ) -> Option<Self> {
        let (generation, since) = robot.in_verification()?;
        current
            .filter(|verification_run| {
                verification_run.generation == generation && verification_run.since == since
            })
            .or_else(|| {
                let calibrator = Calibrator::new(config.clone());
                let calibrator = match scanner() {
                    Some(scanner) => calibrator.with_scanner(scanner),
                    None => calibrator,
                };
                Some(Self {
                    generation,
                    since,
                    start: Start::Open,
                    calibrator: Box::new(calibrator),
                })
            })
    }

    /// Processes an event of the robot since the values are in use. Returns `None` if the estimator
    /// failed.
    pub fn take(mut self, robot: &Robot, event: &Event) -> Option<Self> {
        if let Some(stamp) = stamp_of(event) {
            self.start = self.start.after(stamp);
        }
        if self.start != Start::Begun {
            return Some(self);
        }
        let calibrator = &mut self.calibrator;
        let stepped = catch_unwind(AssertUnwindSafe(|| calibrator.step(event.clone())));
        let Ok(effects) = stepped else {
            tracing::error!(robot.id = %robot.id, "the estimator of the values in verification panicked");
            return None;
        };
        for effect in effects {
            if let Effect::Estimate(estimate) = effect {
                self.tell(robot, &estimate);
            }
        }
        Some(self)
    }
}

fn stamp_of(event: &Event) -> Option<RobotTime> {
    match event {
        Event::WheelOdometry(sample) => Some(sample.stamp()),
        Event::Scan(scan) => Some(scan.stamp()),
        Event::LidarPose(pose) => Some(pose.stamp()),
        Event::Note(_) | Event::EndOfSession => None,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn at(seconds: f64) -> RobotTime {
        RobotTime((seconds * 1e9) as i64)
    }

    /// Returns the stamp of the first message that counts.
    fn first_that_counts(stamps_s: &[f64]) -> Option<f64> {
        let mut start = Start::Open;
        stamps_s.iter().copied().find(|stamp_s| {
            start = start.after(at(*stamp_s));
            start == Start::Begun
        })
    }

    #[test]
    fn a_run_begins_behind_what_was_in_flight() {
        assert_eq!(first_that_counts(&[10.0, 10.5, 10.9, 11.0]), Some(11.0));
        // One that was overtaken does not move the start.
        assert_eq!(first_that_counts(&[10.0, 9.2, 10.9, 11.1]), Some(11.1));
        assert_eq!(first_that_counts(&[10.0, 10.9]), None);
    }

    #[test]
    fn a_clock_that_is_set_back_begins_the_run_by_its_new_time() {
        assert_eq!(first_that_counts(&[500.0, 0.0, 0.9, 1.0]), Some(1.0));
        assert_eq!(first_that_counts(&[0.0, 1.8e9]), Some(1.8e9));
    }
}
