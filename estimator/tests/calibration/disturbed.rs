//! Robots that are disturbed otherwise than in their calibration.

use fleetcal_estimator::calibrator::CalibratorConfig;
use fleetcal_robot::simulator::{
    LidarPose, Point, Pose2, Route, SimulatedMessage, SimulationConfig, Slip,
};

use crate::drive::{Driven, drive, drive_disturbed, poses, vehicle_of};

/// Time of the disturbance, s.
pub const BEGIN_S: f64 = 60.0;
/// Length of a run, s.
const DURATION_S: f64 = 120.0;

/// Disturbance of a robot.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Disturbance {
    /// A car of 0.33 m wheelbase at up to 2.4 m/s, its wheels slipping by 1 % and sideways.
    SlippingCar,
    /// One circle after the other, all to the left.
    OneSided,
    /// A loop of straights and left turns.
    LeftLoop,
    /// Steering sensor that stands still at its last reading.
    StuckSteering,
    /// Robot that somebody pushes: the LiDAR moves, the wheels do not turn.
    Pushed,
    /// Wheels that turn in the air: the LiDAR stands.
    WheelLift,
}

/// Drives a robot under this disturbance.
pub fn disturbed(disturbance: Disturbance, seed: u64) -> Driven {
    let mut config = SimulationConfig::figure_eight(seed);
    config.lidar = poses();
    config.vehicle.steering_offset_rad = 0.03;
    config.vehicle.lidar_in_base = Pose2::new(0.434, 0.0046, 0.0126);
    match disturbance {
        Disturbance::SlippingCar => small_car(&mut config),
        Disturbance::OneSided => config.route = Route::circle(Point::new(-11.0, 0.0), 3.0),
        Disturbance::LeftLoop => {
            config.route = Route::left_loop(Point::new(-11.0, 0.0), 9.0, 5.0);
        }
        Disturbance::StuckSteering | Disturbance::Pushed | Disturbance::WheelLift => {}
    }
    config.applied.lidar_in_base = config.vehicle.lidar_in_base;
    let calibrator = CalibratorConfig::of(vehicle_of(&config.vehicle, config.vehicle.wheelbase_m));
    match disturbance {
        Disturbance::StuckSteering => {
            let mut held_rad = None;
            drive_disturbed(config, calibrator, DURATION_S, |time_s, mut message| {
                if let SimulatedMessage::WheelOdometry(drive) = &mut message
                    && time_s >= BEGIN_S
                {
                    drive.steering_rad = *held_rad.get_or_insert(drive.steering_rad);
                }
                vec![message]
            })
        }
        Disturbance::Pushed => {
            drive_disturbed(config, calibrator, DURATION_S, |time_s, mut message| {
                if let SimulatedMessage::WheelOdometry(drive) = &mut message
                    && (BEGIN_S..BEGIN_S + 5.0).contains(&time_s)
                {
                    drive.speed_mps = 0.0;
                }
                vec![message]
            })
        }
        Disturbance::WheelLift => {
            let mut lift = WheelLift::default();
            drive_disturbed(config, calibrator, DURATION_S, move |time_s, message| {
                lift.disturb(time_s, &message)
            })
        }
        _ => drive(config, calibrator, DURATION_S),
    }
}

fn small_car(config: &mut SimulationConfig) {
    config.vehicle.wheelbase_m = 0.33;
    config.vehicle.lidar_in_base = Pose2::new(0.26, 0.01, -0.0225);
    config.vehicle.slip = Slip {
        longitudinal_sigma: 0.01,
        lateral_rad_per_mps2: 0.01,
    };
    config.speed.min_mps = 0.8;
    config.speed.max_mps = 2.4;
    config.speed.acceleration_mps2 = 1.5;
}

/// Holds the LiDAR for five seconds while the wheels turn, and delays all later messages.
#[derive(Default)]
struct WheelLift {
    last_pose: Option<LidarPose>,
    done: bool,
}

impl WheelLift {
    const LENGTH_NS: i64 = 5_000_000_000;

    fn disturb(&mut self, time_s: f64, message: &SimulatedMessage) -> Vec<SimulatedMessage> {
        let later = if self.done { Self::LENGTH_NS } else { 0 };
        match message {
            SimulatedMessage::WheelOdometry(drive) => {
                let mut drive = *drive;
                drive.stamp_ns += later;
                let mut messages = vec![SimulatedMessage::WheelOdometry(drive)];
                if time_s >= BEGIN_S && !self.done {
                    self.done = true;
                    for i in 1..=500 {
                        let mut lifted = drive;
                        lifted.stamp_ns += i * 10_000_000;
                        messages.push(SimulatedMessage::WheelOdometry(lifted));
                        if let Some(mut pose) = self.last_pose.filter(|_| i % 10 == 0) {
                            pose.stamp_ns += i * 10_000_000;
                            messages.push(SimulatedMessage::LidarPose(pose));
                        }
                    }
                }
                messages
            }
            SimulatedMessage::LidarPose(pose) => {
                let mut pose = *pose;
                pose.stamp_ns += later;
                if !self.done {
                    self.last_pose = Some(pose);
                }
                vec![SimulatedMessage::LidarPose(pose)]
            }
            SimulatedMessage::Scan(_) | SimulatedMessage::CrossTrackError(_) => Vec::new(),
        }
    }
}
