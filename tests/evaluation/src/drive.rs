//! A simulated robot driven past a calibrator.

use std::ops::ControlFlow;
use std::sync::Arc;

use fleetcal_estimator::calibrator::CalibratorConfig;
use fleetcal_estimator::estimate::Change;
use fleetcal_estimator::geometry::{Pose2, wrap_angle_rad};
use fleetcal_estimator::stream::{FieldRefused, ScanShape};
use fleetcal_estimator::{
    Calibrator, DriveSample, Effect, Estimate, Event, LidarPose, Parameter, RobotTime, Scan,
};
use fleetcal_robot::simulator::{
    Emitted, Pose2 as TruePose, SimulatedMessage, Simulation, SimulationConfig, TrueParameters,
};
use nalgebra::{Matrix3, Matrix4, Vector4};

use crate::error::EvaluationError;

/// The four parameters of the paper.
pub const FOUR: [Parameter; 4] = [
    Parameter::LidarX,
    Parameter::LidarY,
    Parameter::LidarYaw,
    Parameter::SteeringOffset,
];

/// A robot's truth, and the configuration of its calibrator.
#[derive(Debug, Clone)]
pub struct Robot {
    /// True configuration.
    pub simulation: SimulationConfig,
    /// Configuration of the calibrator.
    pub calibrator: CalibratorConfig,
    /// Time from which its calibrator receives its messages, s: it may begin while the robot
    /// drives.
    pub heard_from_s: f64,
}

/// Result of a drive.
#[derive(Debug, Clone)]
pub struct Driven {
    /// The calibrator at the end.
    pub calibrator: Calibrator,
    /// Every estimate, with the true parameters at its time.
    pub estimates: Vec<(Estimate, TrueParameters)>,
    /// Changes and faults that were flagged.
    pub changes: Vec<Change>,
}

/// Event of a drive for an observer.
#[derive(Debug, Clone, Copy)]
pub enum Seen<'a> {
    /// A message, with the truth behind it and the estimator's event, if it makes one.
    Message(&'a Emitted, Option<&'a Event>),
    /// An estimate, with the calibrator that made it.
    Estimate(&'a Estimate, &'a Calibrator),
}

/// Drives a robot past its calibrator.
///
/// # Errors
/// Names the setting or message that is refused.
pub fn drive(robot: Robot, duration_s: f64) -> Result<Driven, EvaluationError> {
    drive_watched(robot, duration_s, |_, _, _| ControlFlow::Continue(()))
}

/// Drives a robot with an observer, which receives the time (s), may change the robot's
/// calibration, and may end the drive.
///
/// # Errors
/// Names the setting or message that is refused.
pub fn drive_watched(
    robot: Robot,
    duration_s: f64,
    mut watch: impl FnMut(f64, Seen, &mut Simulation) -> ControlFlow<()>,
) -> Result<Driven, EvaluationError> {
    let start_ns = robot.simulation.start_stamp_ns;
    let heard_from_s = robot.heard_from_s;
    let mut simulation = Simulation::new(robot.simulation)?;
    let mut calibrator = Calibrator::new(robot.calibrator);
    let (mut estimates, mut changes) = (Vec::new(), Vec::new());
    loop {
        let emitted = simulation.advance();
        let time_s = (emitted.sent_ns - start_ns) as f64 * 1e-9;
        if time_s > duration_s {
            break;
        }
        let event = event_of(&emitted.message)?;
        let message = Seen::Message(&emitted, event.as_ref());
        if watch(time_s, message, &mut simulation).is_break() {
            break;
        }
        let heard = event.filter(|_| time_s >= heard_from_s);
        let effects = heard.map(|event| calibrator.step(event));
        let mut ends = false;
        for effect in effects.into_iter().flatten() {
            match effect {
                Effect::Estimate(estimate) => {
                    let seen = Seen::Estimate(&estimate, &calibrator);
                    ends |= watch(time_s, seen, &mut simulation).is_break();
                    estimates.push((*estimate, simulation.parameters()));
                }
                Effect::Change(change) => changes.push(*change),
                Effect::ChangeSized(_)
                | Effect::Dropped(_)
                | Effect::LidarMoved(_)
                | Effect::SessionStarted(_) => {}
            }
        }
        if ends {
            break;
        }
    }
    Ok(Driven {
        calibrator,
        estimates,
        changes,
    })
}

/// Returns the true cross-track errors (m, left positive, ten a second) of a robot that follows its
/// route by its applied calibration, from one time to another (s), without calibrating.
///
/// # Errors
/// Names the setting that is refused.
pub fn cross_track_errors(
    config: SimulationConfig,
    from_s: f64,
    to_s: f64,
) -> Result<Vec<f64>, EvaluationError> {
    let start_ns = config.start_stamp_ns;
    let mut simulation = Simulation::new(config)?;
    let mut errors = CrossTrack::default();
    loop {
        let emitted = simulation.advance();
        let time_s = (emitted.sent_ns - start_ns) as f64 * 1e-9;
        if time_s > to_s {
            return Ok(errors.values_m);
        }
        if time_s >= from_s {
            errors.see(&emitted);
        }
    }
}

/// True cross-track errors, one of ten drive messages.
#[derive(Debug, Clone, Default)]
pub struct CrossTrack {
    /// The errors, m, left positive.
    pub values_m: Vec<f64>,
    messages: usize,
}

impl CrossTrack {
    /// Adds the error of a message.
    pub fn see(&mut self, emitted: &Emitted) {
        if let SimulatedMessage::WheelOdometry(_) = emitted.message {
            if self.messages.is_multiple_of(10) {
                self.values_m
                    .push(emitted.truth_when_sent.cross_track_error_m);
            }
            self.messages += 1;
        }
    }
}

/// Converts a simulated message to the estimator's event.
///
/// # Errors
/// Names the field that is refused.
pub fn event_of(message: &SimulatedMessage) -> Result<Option<Event>, FieldRefused> {
    Ok(match message {
        SimulatedMessage::WheelOdometry(drive) => Some(Event::WheelOdometry(DriveSample::new(
            RobotTime(drive.stamp_ns),
            drive.speed_mps,
            drive.steering_rad,
        )?)),
        SimulatedMessage::Scan(scan) => {
            let shape = ScanShape {
                angle_min_rad: scan.angle_min_rad,
                angle_increment_rad: scan.angle_increment_rad,
                time_increment_s: scan.time_increment_s,
                range_min_m: scan.range_min_m,
                range_max_m: scan.range_max_m,
            };
            let ranges_m: Arc<[f32]> = scan.ranges_m.as_slice().into();
            let scan = Scan::new(RobotTime(scan.stamp_ns), shape, ranges_m)?;
            Some(Event::Scan(scan))
        }
        SimulatedMessage::LidarPose(pose) => {
            let covariance = pose.covariance.map(|rows| {
                let [[xx, xy, xt], [yx, yy, yt], [tx, ty, tt]] = rows;
                Matrix3::new(xx, xy, xt, yx, yy, yt, tx, ty, tt)
            });
            let stamp = RobotTime(pose.stamp_ns);
            let pose = LidarPose::new(stamp, estimators_pose(&pose.pose), covariance)?;
            Some(Event::LidarPose(pose))
        }
        SimulatedMessage::CrossTrackError(_) => None,
    })
}

/// Converts a pose of the simulator to the estimator's type.
pub fn estimators_pose(pose: &TruePose) -> Pose2 {
    Pose2::new(pose.x_m, pose.y_m, pose.yaw_rad)
}

/// Converts a pose of the estimator to the simulator's type.
pub fn simulators_pose(pose: &Pose2) -> TruePose {
    TruePose::new(pose.x_m, pose.y_m, pose.yaw_rad)
}

/// Returns the true value of a parameter.
pub fn truth_of(parameter: Parameter, truth: &TrueParameters) -> f64 {
    match parameter {
        Parameter::SteeringOffset => truth.steering_offset_rad,
        Parameter::LidarX => truth.lidar_in_base.x_m,
        Parameter::LidarY => truth.lidar_in_base.y_m,
        Parameter::LidarYaw => truth.lidar_in_base.yaw_rad,
        Parameter::SpeedScale => truth.speed_scale,
        Parameter::Wheelbase => truth.wheelbase_m,
        Parameter::TimeOffset => truth.time_offset_s,
        Parameter::SteeringGain => truth.steering_gain,
    }
}

/// Returns the error of a value of a parameter, the yaw the short way round.
pub fn error_of(parameter: Parameter, value: f64, truth: &TrueParameters) -> f64 {
    let error = value - truth_of(parameter, truth);
    match parameter {
        Parameter::LidarYaw => wrap_angle_rad(error),
        _ => error,
    }
}

/// Returns the mount of an estimate.
pub fn mount_of(estimate: &Estimate) -> Pose2 {
    Pose2::new(
        estimate.parameter(Parameter::LidarX).value,
        estimate.parameter(Parameter::LidarY).value,
        estimate.parameter(Parameter::LidarYaw).value,
    )
}

/// Returns the normalised estimation error squared of the four, 4 degrees of freedom: by the
/// filter's covariance and the systematic part that averaging cannot remove. `None` before the
/// filter has started.
pub fn nees(calibrator: &Calibrator, truth: &TrueParameters) -> Option<f64> {
    let filter = calibrator.filter()?;
    let covariance = filter.parameter_covariance();
    let systematic = &calibrator.config().settings.systematic_sigma;
    let four = Matrix4::from_fn(|row, column| {
        let (a, b) = (FOUR[row], FOUR[column]);
        let more = if row == column {
            systematic.get(a).powi(2)
        } else {
            0.0
        };
        covariance[(a.index(), b.index())] + more
    });
    let error = Vector4::from_fn(|i, _| error_of(FOUR[i], filter.value(FOUR[i]), truth));
    Some(error.dot(&four.cholesky()?.solve(&error)))
}
