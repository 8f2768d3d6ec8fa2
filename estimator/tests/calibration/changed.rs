//! Robots on which something changes in mid-run.

use fleetcal_estimator::calibrator::CalibratorConfig;
use fleetcal_estimator::estimate::Cause;
use fleetcal_robot::simulator::{Change, LidarOutput, Pose2, ScheduledChange, SimulationConfig};

use crate::drive::{Driven, drive, vehicle_of};

/// Time of the change, s.
pub const CHANGE_S: f64 = 60.0;

/// Drives a figure-eight on which `change` happens, until `duration_s`.
pub fn changed(seed: u64, change: Change, lidar: Option<LidarOutput>, duration_s: f64) -> Driven {
    let mut config = SimulationConfig::figure_eight(seed);
    config.vehicle.steering_offset_rad = 0.03;
    config.vehicle.lidar_in_base = Pose2::new(0.434, 0.0046, 0.72f64.to_radians());
    config.applied.lidar_in_base = config.vehicle.lidar_in_base;
    config.changes = vec![ScheduledChange {
        at_s: CHANGE_S,
        change,
    }];
    if let Some(lidar) = lidar {
        config.lidar = lidar;
    }
    let calibrator = CalibratorConfig::of(vehicle_of(&config.vehicle, config.vehicle.wheelbase_m));
    drive(config, calibrator, duration_s)
}

/// Detection of a change.
pub struct Found {
    /// Cause that was named.
    pub cause: Cause,
    /// Time from the change to its flag, s.
    pub delay_s: f64,
    /// Way from the change to its flag, m.
    pub delay_m: f64,
    /// Number of events.
    pub events: usize,
}

/// The first event that was flagged after the change.
pub fn found(run: &Driven) -> Option<Found> {
    let flagged = run.changes.first()?;
    let way_m = |time_s: f64| run.at(time_s).0.distance_m;
    Some(Found {
        cause: flagged.cause,
        delay_s: flagged.time_s - CHANGE_S,
        delay_m: way_m(flagged.time_s) - way_m(CHANGE_S),
        events: run.changes.len(),
    })
}
