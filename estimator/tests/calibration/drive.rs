//! A simulated robot driven past a calibrator.

use fleetcal_estimator::calibrator::CalibratorConfig;
use fleetcal_estimator::estimate::Change;
use fleetcal_estimator::stream::ScanShape;
use fleetcal_estimator::{
    Calibrator, DriveSample, Effect, Estimate, Event, LidarPose, Parameter, Pose2, RobotTime, Scan,
    Vehicle,
};
use fleetcal_robot::simulator::{
    LidarOutput, PoseSettings, SimulatedMessage, Simulation, SimulationConfig, TrueParameters,
    VehicleTruth,
};
use nalgebra::{Matrix3, Matrix4, Vector4};

/// Result of a drive.
pub struct Driven {
    pub calibrator: Calibrator,
    /// Every estimate, with the true parameters of its time.
    pub estimates: Vec<(Estimate, TrueParameters)>,
    pub changes: Vec<Change>,
    /// Changes published again once their amount was known.
    pub sized: Vec<Change>,
}

impl Driven {
    /// The last estimate not after a time.
    pub fn at(&self, time_s: f64) -> &(Estimate, TrueParameters) {
        self.estimates
            .iter()
            .rev()
            .find(|(e, _)| e.time_s <= time_s)
            .unwrap()
    }

    pub fn last(&self) -> &(Estimate, TrueParameters) {
        self.estimates.last().unwrap()
    }
}

/// The true value of a parameter.
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

/// Error of one parameter, the yaw the short way round.
pub fn error_of(parameter: Parameter, estimate: &Estimate, truth: &TrueParameters) -> f64 {
    let error = estimate.parameter(parameter).value - truth_of(parameter, truth);
    if parameter == Parameter::LidarYaw {
        fleetcal_estimator::geometry::wrap_angle_rad(error)
    } else {
        error
    }
}

/// The four calibration parameters.
pub const FOUR: [Parameter; 4] = [
    Parameter::SteeringOffset,
    Parameter::LidarX,
    Parameter::LidarY,
    Parameter::LidarYaw,
];

/// Normalised estimation error squared of the four, 4 degrees of freedom. `systematic` adds the
/// systematic errors, as every sigma that leaves the estimator does.
pub fn nees(calibrator: &Calibrator, truth: &TrueParameters, systematic: bool) -> f64 {
    let filter = calibrator.filter().unwrap();
    let error = Vector4::from_iterator(
        FOUR.iter()
            .map(|&p| error_of(p, &calibrator.estimate(), truth)),
    );
    let mut covariance: Matrix4<f64> = filter
        .parameter_covariance()
        .fixed_view::<4, 4>(0, 0)
        .into_owned();
    if systematic {
        let sigma = &calibrator.config().settings.systematic_sigma;
        for (i, p) in FOUR.iter().enumerate() {
            covariance[(i, i)] += sigma.get(*p).powi(2);
        }
    }
    error.dot(&covariance.cholesky().unwrap().solve(&error))
}

/// The same of the published estimate: by the covariance that leaves the estimator.
pub fn published_nees(estimate: &Estimate, truth: &TrueParameters) -> f64 {
    let error = Vector4::from(FOUR.map(|p| error_of(p, estimate, truth)));
    let covariance = Matrix4::from_fn(|i, j| estimate.covariance.rows()[i][j]);
    error.dot(&covariance.cholesky().unwrap().solve(&error))
}

/// LiDAR poses instead of scans: fast, and with white noise, as the filter assumes.
pub fn poses() -> LidarOutput {
    LidarOutput::Poses(PoseSettings {
        position_sigma_m: 0.003,
        yaw_sigma_rad: 5e-4,
        ..PoseSettings::default()
    })
}

/// The vehicle as its owner knows it: model and wheelbase, nothing else.
pub fn vehicle_of(truth: &VehicleTruth, wheelbase_m: f64) -> Vehicle {
    Vehicle::new(truth.model, wheelbase_m)
}

/// Drives a simulation past a calibrator of the given configuration.
pub fn drive(config: SimulationConfig, calibrator: CalibratorConfig, duration_s: f64) -> Driven {
    drive_disturbed(config, calibrator, duration_s, |_, message| vec![message])
}

/// The same with every message replaced by the result of `disturb` at its time (s).
pub fn drive_disturbed(
    config: SimulationConfig,
    calibrator: CalibratorConfig,
    duration_s: f64,
    mut disturb: impl FnMut(f64, SimulatedMessage) -> Vec<SimulatedMessage>,
) -> Driven {
    let start_ns = config.start_stamp_ns;
    let mut simulation = Simulation::new(config).unwrap();
    let mut calibrator = Calibrator::new(calibrator);
    let (mut estimates, mut changes, mut sized) = (Vec::new(), Vec::new(), Vec::new());
    loop {
        let emitted = simulation.advance();
        let time_s = (emitted.sent_ns - start_ns) as f64 * 1e-9;
        if time_s > duration_s {
            break;
        }
        let disturbed = disturb(time_s, emitted.message);
        for effect in disturbed
            .into_iter()
            .filter_map(event_of)
            .flat_map(|event| calibrator.step(event))
        {
            match effect {
                Effect::Estimate(estimate) => estimates.push((*estimate, simulation.parameters())),
                Effect::Change(change) => changes.push(*change),
                Effect::ChangeSized(change) => sized.push(*change),
                Effect::Dropped(_) | Effect::LidarMoved(_) | Effect::SessionStarted(_) => {}
            }
        }
    }
    Driven {
        calibrator,
        estimates,
        changes,
        sized,
    }
}

/// Event of a simulated message.
pub fn event_of(message: SimulatedMessage) -> Option<Event> {
    match message {
        SimulatedMessage::WheelOdometry(d) => Some(Event::WheelOdometry(
            DriveSample::new(RobotTime(d.stamp_ns), d.speed_mps, d.steering_rad).unwrap(),
        )),
        SimulatedMessage::Scan(s) => {
            let shape = ScanShape {
                angle_min_rad: s.angle_min_rad,
                angle_increment_rad: s.angle_increment_rad,
                time_increment_s: s.time_increment_s,
                range_min_m: s.range_min_m,
                range_max_m: s.range_max_m,
            };
            Some(Event::Scan(
                Scan::new(RobotTime(s.stamp_ns), shape, s.ranges_m.into()).unwrap(),
            ))
        }
        SimulatedMessage::LidarPose(p) => {
            let covariance = p.covariance.map(|c| Matrix3::from_fn(|i, j| c[i][j]));
            let pose = Pose2::new(p.pose.x_m, p.pose.y_m, p.pose.yaw_rad);
            Some(Event::LidarPose(
                LidarPose::new(RobotTime(p.stamp_ns), pose, covariance).unwrap(),
            ))
        }
        SimulatedMessage::CrossTrackError(_) => None,
    }
}
