//! Lines of what an estimator publishes. Numbers stand with their bits, or as Rust's shortest decimals that
//! read back as the same bits.

use std::fmt::Write;

use fleetcal_estimator::calibrator::TopViewLimits;
use fleetcal_estimator::lidar_odometry::OdometryPose;
use fleetcal_estimator::{
    Calibrator, Checkpoint, Effect, Estimate, Event, Parameter, Pose2, RobotTime,
};

use super::Failure;

/// An estimator, and its publications so far: each effect and pose under its number, so that one
/// more is a difference as one less is.
#[derive(Debug)]
pub struct Lines {
    calibrator: Calibrator,
    text: String,
    published: usize,
    pose: Option<(RobotTime, Pose2)>,
}

impl Lines {
    /// Begins with an estimator at its start.
    pub fn of(calibrator: Calibrator) -> Self {
        Self {
            calibrator,
            text: String::new(),
            published: 0,
            pose: None,
        }
    }

    /// Passes an event to the estimator.
    pub fn step(&mut self, event: Event) {
        for effect in self.calibrator.step(event) {
            if matches!(effect, Effect::LidarMoved(_)) {
                continue;
            }
            self.published += 1;
            match effect {
                Effect::Estimate(estimate) => self.estimate(&estimate),
                other => self.line(format_args!("{other:?}")),
            }
        }
        let pose = self.calibrator.base_pose();
        if pose != self.pose
            && let Some((stamp, base)) = pose
        {
            self.published += 1;
            self.line(format_args!("pose at {} {}", stamp.0, bits_of(base)));
        }
        self.pose = pose;
    }

    /// Ends the estimator, and continues with one from its written checkpoint.
    pub fn restart(&mut self) -> Result<(), Failure> {
        let written = serde_json::to_string(&self.calibrator.checkpoint())?;
        let checkpoint: Checkpoint = serde_json::from_str(&written)?;
        let config = self.calibrator.config().clone();
        self.calibrator = Calibrator::restore(config, &checkpoint)?;
        Ok(())
    }

    /// Ends the session; returns all lines, with the estimator's state at the end.
    pub fn end(mut self) -> String {
        self.step(Event::EndOfSession);
        let estimate = self.calibrator.estimate();
        self.estimate(&estimate);
        for segment in self.calibrator.segments() {
            self.line(format_args!("{segment:?}"));
        }
        for ranked in self.calibrator.next_manoeuvres(None) {
            let (manoeuvre, taken) = (&ranked.advice.manoeuvre, ranked.uncertainty_taken);
            let (taken, gained) = (bits(taken), bits(ranked.information_bits));
            self.line(format_args!("advice {manoeuvre:?} {taken} {gained}"));
        }
        let view = self.calibrator.top_view(&TopViewLimits {
            reach_m: 30.0,
            surfaces_max: 500,
            trajectory_m: 40.0,
            trajectory_points_max: 200,
        });
        let scanner = self.calibrator.scanner();
        let excitation = self.calibrator.excitation().clone();
        self.line(format_args!("{scanner:?}"));
        self.line(format_args!("{excitation:?}"));
        self.line(format_args!("{view:?}"));
        let published = self.published;
        self.line(format_args!("{published} effects and poses in all"));
        self.text
    }

    fn line(&mut self, of: std::fmt::Arguments) {
        // A string takes whatever is written.
        let _infallible = writeln!(self.text, "{} {of}", self.published);
    }

    fn estimate(&mut self, estimate: &Estimate) {
        let at = estimate.stamp.0;
        for parameter in Parameter::ALL {
            let found = estimate.parameter(parameter);
            let (value, sigma) = (bits(found.value), bits(found.sigma));
            let (name, status, needs) = (parameter.name(), found.status, &found.needs);
            self.line(format_args!(
                "{name} {value} ± {sigma} {status:?} {needs:?}"
            ));
        }
        let covariance = estimate
            .covariance
            .rows()
            .map(|row| row.map(bits).join(" "));
        self.line(format_args!("covariance {}", covariance.join(" ")));
        let [time, way] = [estimate.time_s, estimate.distance_m].map(bits);
        let open = estimate.reassembly_open;
        self.line(format_args!(
            "at {at} after {time} s, {way} m, reassembly open {open}"
        ));
        self.line(format_args!("{:?}", estimate.detection));
        self.line(format_args!(
            "{:?} {:?}",
            estimate.consistency, estimate.counts
        ));
        let base = bits_of(estimate.base_in_odom);
        let drive = estimate.drive_now.map(bits).join(" ");
        self.line(format_args!("base {base} drive {drive}"));
    }
}

/// A number's bits and the number.
pub fn bits(number: f64) -> String {
    format!("{:016x}={number:?}", number.to_bits())
}

/// The same of a pose.
pub fn bits_of(pose: Pose2) -> String {
    [pose.x_m, pose.y_m, pose.yaw_rad].map(bits).join(" ")
}

/// Line of one pose of the LiDAR odometry.
pub fn of_odometry(text: &mut String, pose: &OdometryPose) {
    let lidar = bits_of(pose.lidar_in_odom);
    let covariance: Vec<_> = pose.covariance.iter().copied().map(bits).collect();
    let covariance = covariance.join(" ");
    // A string takes whatever is written.
    let _infallible = writeln!(
        text,
        "{} {lidar} covariance {covariance} {pose:?}",
        pose.stamp.0
    );
}
