//! Checks of the settings of a simulation.

use std::f64::consts::TAU;
use std::ops::RangeInclusive;

use thiserror::Error;

use super::config::{LidarOutput, LocalisationNoise, SimulationConfig};
use super::lidar::{BEAMS_MAX, BEAMS_MIN, LidarSettings};
use super::people::PEOPLE_MAX;
use super::pose_sensor::PoseSettings;

/// Error of an impossible setting.
#[derive(Debug, Clone, PartialEq, Error)]
#[error("{field}: got {value}, expected {accepted}")]
pub struct SettingRefused {
    /// Name of the setting.
    pub field: &'static str,
    /// Its value.
    pub value: f64,
    /// Accepted values.
    pub accepted: &'static str,
}

/// A setting, its value, the accepted range, and the same in words.
pub(super) type Setting = (&'static str, f64, RangeInclusive<f64>, &'static str);

impl SimulationConfig {
    /// Checks every number.
    ///
    /// # Errors
    /// Names the first impossible setting.
    pub fn check(&self) -> Result<(), SettingRefused> {
        self.check_vehicle()?;
        self.check_mounts()?;
        self.check_speed()?;
        let drive = &self.drive;
        let people = 0.0..=PEOPLE_MAX as f64;
        check([
            ("drive.rate_hz", drive.rate_hz, 1.0..=1000.0, "1 to 1000 Hz"),
            (
                "drive.speed_sigma_mps",
                drive.speed_sigma_mps,
                0.0..=1.0,
                "0 to 1 m/s",
            ),
            (
                "drive.steering_sigma_rad",
                drive.steering_sigma_rad,
                0.0..=1.0,
                "0 to 1 rad",
            ),
            (
                "drive.steering_step_rad",
                drive.steering_step_rad,
                0.0..=1.0,
                "0 to 1 rad",
            ),
            (
                "people.count",
                self.people.count as f64,
                people,
                "at most 60",
            ),
            (
                "route.length_m",
                self.route.length_m(),
                1.0..=1e6,
                "1 m or more",
            ),
        ])?;
        for scheduled in &self.changes {
            check([("changes.at_s", scheduled.at_s, 0.0..=1e9, "0 s or later")])?;
        }
        match &self.lidar {
            LidarOutput::Scans(lidar) => check_lidar(lidar)?,
            LidarOutput::Poses(poses) => check_poses(poses)?,
        }
        self.imperfections.check(&self.vehicle, &self.lidar)
    }

    fn check_vehicle(&self) -> Result<(), SettingRefused> {
        let vehicle = &self.vehicle;
        let slip = vehicle.slip;
        let (longitudinal, lateral) = (slip.longitudinal_sigma, slip.lateral_rad_per_mps2);
        check([
            (
                "vehicle.wheelbase_m",
                vehicle.wheelbase_m,
                0.1..=20.0,
                "0.1 to 20 m",
            ),
            (
                "vehicle.steering_gain",
                vehicle.steering_gain,
                0.5..=2.0,
                "0.5 to 2",
            ),
            (
                "vehicle.speed_scale",
                vehicle.speed_scale,
                0.5..=2.0,
                "0.5 to 2",
            ),
            (
                "vehicle.time_offset_s",
                vehicle.time_offset_s,
                -1.0..=1.0,
                "-1 to 1 s",
            ),
            (
                "vehicle.steering_lag_s",
                vehicle.steering_lag_s,
                0.0..=2.0,
                "0 to 2 s",
            ),
            (
                "vehicle.steering_limit_rad",
                vehicle.steering_limit_rad,
                0.1..=1.5,
                "0.1 to 1.5 rad",
            ),
            (
                "vehicle.slip.longitudinal_sigma",
                longitudinal,
                0.0..=0.2,
                "0 to 0.2",
            ),
            (
                "vehicle.slip.lateral_rad_per_mps2",
                lateral,
                0.0..=0.2,
                "0 to 0.2 rad s²/m",
            ),
        ])
    }

    fn check_mounts(&self) -> Result<(), SettingRefused> {
        for offset_rad in [
            self.vehicle.steering_offset_rad,
            self.applied.steering_offset_rad,
        ] {
            check([(
                "steering_offset_rad",
                offset_rad,
                -0.5..=0.5,
                "-0.5 to 0.5 rad",
            )])?;
        }
        for mount in [self.vehicle.lidar_in_base, self.applied.lidar_in_base] {
            check([
                ("lidar_in_base.x_m", mount.x_m, -20.0..=20.0, "-20 to 20 m"),
                ("lidar_in_base.y_m", mount.y_m, -20.0..=20.0, "-20 to 20 m"),
                (
                    "lidar_in_base.yaw_rad",
                    mount.yaw_rad,
                    -7.0..=7.0,
                    "-7 to 7 rad",
                ),
            ])?;
        }
        Ok(())
    }

    fn check_speed(&self) -> Result<(), SettingRefused> {
        let speed = &self.speed;
        let LocalisationNoise {
            position_sigma_m,
            yaw_sigma_rad,
        } = self.localisation;
        let fastest = speed.min_mps..=10.0;
        check([
            ("speed.rest_s", speed.rest_s, 0.0..=1e9, "0 s or more"),
            ("speed.min_mps", speed.min_mps, 0.0..=10.0, "0 to 10 m/s"),
            ("speed.max_mps", speed.max_mps, fastest, "min_mps to 10 m/s"),
            ("speed.period_s", speed.period_s, 0.1..=1e6, "0.1 s or more"),
            (
                "speed.acceleration_mps2",
                speed.acceleration_mps2,
                0.01..=10.0,
                "0.01 to 10 m/s²",
            ),
            (
                "localisation.position_sigma_m",
                position_sigma_m,
                0.0..=1.0,
                "0 to 1 m",
            ),
            (
                "localisation.yaw_sigma_rad",
                yaw_sigma_rad,
                0.0..=0.5,
                "0 to 0.5 rad",
            ),
        ])
    }
}

fn check_lidar(lidar: &LidarSettings) -> Result<(), SettingRefused> {
    let beams = f64::from(BEAMS_MIN)..=f64::from(BEAMS_MAX);
    let view = 0.1..=TAU + 1e-6;
    let range_max = lidar.range_min_m..=1e3;
    check([
        ("lidar.beams", f64::from(lidar.beams), beams, "8 to 16384"),
        ("lidar.rate_hz", lidar.rate_hz, 0.5..=100.0, "0.5 to 100 Hz"),
        (
            "lidar.field_of_view_rad",
            lidar.field_of_view_rad,
            view,
            "0.1 to 2 pi rad",
        ),
        (
            "lidar.range_min_m",
            lidar.range_min_m,
            0.0..=100.0,
            "0 to 100 m",
        ),
        (
            "lidar.range_max_m",
            lidar.range_max_m,
            range_max,
            "range_min_m to 1000 m",
        ),
        (
            "lidar.range_sigma_m",
            lidar.range_sigma_m,
            0.0..=1.0,
            "0 to 1 m",
        ),
        (
            "lidar.dropped_beams",
            lidar.dropped_beams,
            0.0..=1.0,
            "0 to 1",
        ),
        ("lidar.phase_s", lidar.phase_s, 0.0..=10.0, "0 to 10 s"),
    ])
}

fn check_poses(poses: &PoseSettings) -> Result<(), SettingRefused> {
    check([
        (
            "poses.rate_hz",
            poses.rate_hz,
            0.5..=1000.0,
            "0.5 to 1000 Hz",
        ),
        (
            "poses.position_sigma_m",
            poses.position_sigma_m,
            0.0..=1.0,
            "0 to 1 m",
        ),
        (
            "poses.yaw_sigma_rad",
            poses.yaw_sigma_rad,
            0.0..=1.0,
            "0 to 1 rad",
        ),
        (
            "poses.position_walk_m",
            poses.position_walk_m,
            0.0..=1.0,
            "0 to 1 m",
        ),
        (
            "poses.yaw_walk_rad",
            poses.yaw_walk_rad,
            0.0..=1.0,
            "0 to 1 rad",
        ),
        ("poses.phase_s", poses.phase_s, 0.0..=10.0, "0 to 10 s"),
    ])
}

pub(super) fn check<const N: usize>(settings: [Setting; N]) -> Result<(), SettingRefused> {
    for (field, value, range, accepted) in settings {
        if !range.contains(&value) {
            return Err(SettingRefused {
                field,
                value,
                accepted,
            });
        }
    }
    Ok(())
}
