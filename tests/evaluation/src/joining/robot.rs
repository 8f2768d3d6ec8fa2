//! A simulated robot before the checks.

use fleetcal_checks::{Checks, Described, Finding, Head, State};
use fleetcal_estimator::{Event, LidarOdometry};
use fleetcal_model::Stream;
use fleetcal_robot::simulator::{
    Delivered, SimulatedMessage, Simulation, SimulationConfig, WrongInput, WrongInputs,
};

use crate::drive::event_of;
use crate::error::EvaluationError;

/// A robot's checks, and the LiDAR odometry that they read.
#[derive(Debug)]
pub struct Checked {
    /// The checks.
    pub checks: Checks,
    odometry: LidarOdometry,
}

impl Checked {
    /// Checks of a vehicle that was described so.
    pub fn new(described: Described) -> Self {
        Self {
            checks: Checks::new(described),
            odometry: LidarOdometry::default(),
        }
    }

    /// Takes a message, as `fleetcal doctor` does.
    pub fn take(&mut self, delivered: &Delivered) {
        let (message, arrival_ns) = (&delivered.message, delivered.arrival_ns);
        let head = |stream| Head {
            stream,
            stamp: fleetcal_model::RobotTime(message.stamp_ns()),
            frame: delivered.frame,
            child_frame: None,
            arrival_ns,
        };
        if let SimulatedMessage::WheelOdometry(drive) = message {
            let (speed, steering) = (Some(drive.speed_mps), Some(drive.steering_rad));
            self.checks
                .take_wheels(&head(Stream::WheelOdometry), speed, steering);
        }
        let (stream, scan_time_s) = match message {
            SimulatedMessage::WheelOdometry(_) => (Stream::WheelOdometry, 0.0),
            SimulatedMessage::Scan(scan) => (Stream::Scan, scan.scan_time_s),
            SimulatedMessage::LidarPose(_) => (Stream::LidarOdometry, 0.0),
            SimulatedMessage::CrossTrackError(_) => return,
        };
        match event_of(message) {
            Err(refused) => self.checks.refuse(stream, arrival_ns, &refused.to_string()),
            Ok(Some(Event::Scan(scan))) => {
                self.checks.take_scan(&head(stream), &scan, scan_time_s);
                if let Some(pose) = self.odometry.process(&scan) {
                    self.checks.take_odometry(&pose);
                }
            }
            Ok(Some(Event::LidarPose(pose))) => {
                self.checks.take_pose(&head(stream), pose.pose(), 0.0);
            }
            Ok(_) => {}
        }
    }

    /// Causes that are named.
    pub fn named(&self) -> Vec<Finding> {
        let is_named = |finding: &Finding| matches!(finding.state, State::Wrong | State::Unsure);
        self.checks
            .findings()
            .into_iter()
            .filter(is_named)
            .collect()
    }
}

/// Drives a robot with wrong inputs before its checks.
///
/// # Errors
/// Names the setting of the robot that is refused.
pub fn drive(
    mut config: SimulationConfig,
    inputs: &[WrongInput],
    duration_s: f64,
) -> Result<Checked, EvaluationError> {
    let (mut model, mut wheelbase_m) = (config.vehicle.model, config.configured_wheelbase_m());
    for input in inputs {
        input.configure(&mut config);
        (model, wheelbase_m) = input.described(model, wheelbase_m);
    }
    let mut checked = Checked::new(Described {
        model,
        speed_measured_at: model.speed_measured_at(),
        wheelbase_m,
        nominal_yaw_rad: None,
    });
    let mut wrong = WrongInputs::new(inputs, &config)?;
    let end_ns = config.start_stamp_ns + (duration_s * 1e9) as i64;
    let mut simulation = Simulation::new(config)?;
    while simulation.stamp_ns() < end_ns {
        for delivered in wrong.deliver(simulation.advance()) {
            checked.take(&delivered);
        }
    }
    Ok(checked)
}
