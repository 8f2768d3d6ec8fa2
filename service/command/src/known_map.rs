//! The flags of a known map and a known start in it.

use std::path::PathBuf;
use std::str::FromStr;

use clap::Args;
use fleetcal_estimator::{LidarOdometry, Pose2};

use crate::CommandError;
use crate::map_server;

/// A known map, and the LiDAR's start in it.
#[derive(Debug, Clone, Default, Args)]
pub struct KnownMapArguments {
    /// Localise in a known map: the YAML file of ROS's `map_server`, its image beside it
    #[arg(long, value_name = "MAP.yaml", requires = "start")]
    pub map: Option<PathBuf>,
    /// The LiDAR's pose in the map at the first scan, within half a metre and 15 degrees
    #[arg(
        long,
        value_name = "X,Y,YAW_DEG",
        requires = "map",
        allow_hyphen_values = true
    )]
    pub start: Option<Start>,
}

/// A start in the form of a flag: metres and degrees.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Start(Pose2);

impl FromStr for Start {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let numbers: Vec<f64> = text
            .split(',')
            .map_while(|part| part.trim().parse().ok())
            .filter(|number: &f64| number.is_finite())
            .collect();
        match numbers.as_slice() {
            [x_m, y_m, yaw_deg] if text.matches(',').count() == 2 => {
                Ok(Self(Pose2::new(*x_m, *y_m, yaw_deg.to_radians())))
            }
            _ => Err("expected three numbers: metres, metres, degrees".to_owned()),
        }
    }
}

impl KnownMapArguments {
    /// Makes the LiDAR odometry that the flags describe.
    ///
    /// # Errors
    /// The map cannot be read or used.
    pub fn lidar_odometry(&self) -> Result<LidarOdometry, CommandError> {
        let (Some(map), Some(Start(start))) = (&self.map, self.start) else {
            return Ok(LidarOdometry::default());
        };
        let grid = map_server::read(map)?;
        Ok(LidarOdometry::with_map(&grid, start)?)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_start_is_three_numbers() {
        let start: Start = "1.5, -2,90".parse().expect("three numbers");
        assert!((start.0.yaw_rad - std::f64::consts::FRAC_PI_2).abs() < 1e-12);
        assert!((start.0.x_m - 1.5).abs() < 1e-12 && (start.0.y_m + 2.0).abs() < 1e-12);
        for text in [
            "",
            "1,2",
            "1,2,3,4",
            "1,2,north",
            "1,2,nan",
            "1,,2",
            "1,2,3,",
        ] {
            let reason = text.parse::<Start>().expect_err(text);
            assert!(reason.contains("metres, metres, degrees"));
        }
    }
}
