//! Each imperfection against its own equation.

mod clocks;
mod golden;
mod lidar;
mod settings;
mod vehicle;

use crate::simulator::{
    DriveSample, DriveSettings, Emitted, Imperfections, LidarOutput, LidarPose, LidarSettings,
    LocalisationNoise, PoseSettings, Scan, SimulatedMessage, Simulation, SimulationConfig, Slip,
};

/// Makes a robot without noise and slip on the figure-eight, with poses for its LiDAR.
fn quiet() -> SimulationConfig {
    let mut config = SimulationConfig::figure_eight(2);
    config.people.count = 0;
    config.vehicle.slip = Slip::default();
    config.drive = DriveSettings {
        speed_sigma_mps: 0.0,
        steering_sigma_rad: 0.0,
        steering_step_rad: 0.0,
        ..DriveSettings::default()
    };
    config.lidar = LidarOutput::Poses(PoseSettings {
        position_sigma_m: 0.0,
        yaw_sigma_rad: 0.0,
        ..PoseSettings::default()
    });
    config
}

/// Makes the same robot with scans whose ranges have no noise.
fn quiet_scans() -> SimulationConfig {
    SimulationConfig {
        lidar: LidarOutput::Scans(LidarSettings {
            range_sigma_m: 0.0,
            ..LidarSettings::default()
        }),
        ..quiet()
    }
}

fn still(mut config: SimulationConfig) -> SimulationConfig {
    config.speed.rest_s = 1e6;
    config.localisation = LocalisationNoise {
        position_sigma_m: 0.0,
        yaw_sigma_rad: 0.0,
    };
    config
}

fn with(mut config: SimulationConfig, imperfections: Imperfections) -> SimulationConfig {
    config.imperfections = imperfections;
    config
}

fn run(config: SimulationConfig, duration_s: f64) -> Vec<Emitted> {
    Simulation::new(config).unwrap().run(duration_s)
}

fn drives(messages: &[Emitted]) -> Vec<(DriveSample, &Emitted)> {
    messages
        .iter()
        .filter_map(|emitted| match emitted.message {
            SimulatedMessage::WheelOdometry(drive) => Some((drive, emitted)),
            _ => None,
        })
        .collect()
}

fn poses(messages: &[Emitted]) -> Vec<(LidarPose, &Emitted)> {
    messages
        .iter()
        .filter_map(|emitted| match emitted.message {
            SimulatedMessage::LidarPose(pose) => Some((pose, emitted)),
            _ => None,
        })
        .collect()
}

fn scans(messages: &[Emitted]) -> Vec<(&Scan, &Emitted)> {
    messages
        .iter()
        .filter_map(|emitted| match &emitted.message {
            SimulatedMessage::Scan(scan) => Some((scan, emitted)),
            _ => None,
        })
        .collect()
}
