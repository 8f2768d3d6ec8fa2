//! Basis of a robot's estimate, and the part of it that an edit of the robot's configuration keeps.

use fleetcal_estimator::EstimatorSettings;
use fleetcal_estimator::calibrator::CalibratorConfig;
use serde::{Deserialize, Serialize};

use super::config::{RobotConfig, WheelOdometrySignal};
use crate::streams::{Joints, Units};

/// Meaning of the numbers that a robot sends. Topics are not part of it: a topic can be renamed
/// without a new sensor, and a sensor that moved is a change for the estimator to detect.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct Signals {
    /// Kind of the steering angle: raw or compensated.
    wheel_odometry: WheelOdometrySignal,
    /// Joints that angles and speeds are computed from.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    joints: Option<Joints>,
    /// Units of angles and speeds.
    #[serde(default, skip_serializing_if = "Units::are_usual")]
    units: Units,
}

/// Basis of a robot's estimate: while it stays the same, the estimate continues.
#[derive(Debug, Clone, PartialEq)]
pub struct Basis {
    /// Configuration of its estimator.
    pub calibrator: CalibratorConfig,
    /// Meaning of its messages.
    pub signals: Signals,
}

impl RobotConfig {
    /// Basis of this robot's estimate, `defaults` being the settings of `[estimator]`.
    pub fn basis(&self, defaults: &EstimatorSettings) -> Basis {
        Basis {
            calibrator: self.calibrator_config(defaults),
            signals: Signals {
                wheel_odometry: self.wheel_odometry,
                joints: self.streams.joints().cloned(),
                units: self.streams.units(),
            },
        }
    }
}

impl Basis {
    /// Keys of a robot's configuration that differ from `other` and restart its estimate;
    /// empty if it continues.
    pub fn differs_in(&self, other: &Self) -> Vec<&'static str> {
        let (own, others) = (&self.calibrator, &other.calibrator);
        let (vehicle, other_vehicle) = (&own.vehicle, &others.vehicle);
        let (signals, other_signals) = (&self.signals, &other.signals);
        let keys = [
            ("model", vehicle.model != other_vehicle.model),
            (
                "wheelbase_m",
                vehicle.wheelbase_m.to_bits() != other_vehicle.wheelbase_m.to_bits(),
            ),
            (
                "speed_measured_at",
                vehicle.speed_measured_at != other_vehicle.speed_measured_at,
            ),
            (
                "nominal_extrinsics",
                own.nominal_lidar_in_base != others.nominal_lidar_in_base,
            ),
            ("estimator", own.settings != others.settings),
            (
                "wheel_odometry",
                signals.wheel_odometry != other_signals.wheel_odometry,
            ),
            ("streams.joints", signals.joints != other_signals.joints),
            ("streams' gears", signals.units != other_signals.units),
        ];
        let differing = keys.into_iter().filter(|(_, differs)| *differs);
        differing.map(|(key, _)| key).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const FULL: &str = r#"{"model": "bicycle", "wheelbase_m": 1.2,
        "rear_axle_in_base_link": {"x_m": -0.4, "y_m": 0, "yaw_rad": 0},
        "streams": {"steering": {"topic": "joints"}, "speed": {"topic": "odom"},
            "joints": {"steering": "s", "wheels": ["w"], "wheel_radius_m": 0.1}}}"#;

    fn basis(text: &str) -> Basis {
        let config: RobotConfig = serde_json::from_str(text).unwrap();
        config.basis(&EstimatorSettings::default())
    }

    #[test]
    fn a_frame_and_a_topic_leave_an_estimate_and_a_wheel_does_not() {
        for (from, to, expected) in [
            ("-0.4", "-0.5", None),
            ("\"odom\"", "\"wheels/odom\"", None),
            (r#""streams": {"#, r#""streams": {"prefix": "7", "#, None),
            (
                r#""model""#,
                r#""scan_type": "point_cloud2", "model""#,
                None,
            ),
            (r#""model""#, r#""estimator": {}, "model""#, None),
            (
                r#""model""#,
                r#""site": "Hamburg", "vehicle_type": "EKX", "tags": ["a"], "model""#,
                None,
            ),
            (
                r#""model""#,
                r#""speed_measured_at": "rear_axle", "model""#,
                None,
            ),
            ("1.2", "1.3", Some("wheelbase_m")),
            (
                r#""model""#,
                r#""speed_measured_at": {"rear_wheel": {"lateral_m": 0.3}}, "model""#,
                Some("speed_measured_at"),
            ),
            ("0.1}", "0.11}", Some("streams.joints")),
            (
                r#""model""#,
                r#""wheel_odometry": "compensated", "model""#,
                Some("wheel_odometry"),
            ),
            (
                r#""model""#,
                r#""nominal_extrinsics": {"x_m": 0.4, "y_m": 0, "yaw_rad": 0}, "model""#,
                Some("nominal_extrinsics"),
            ),
            (
                r#""model""#,
                r#""estimator": {"pose_sigma_m": 0.01}, "model""#,
                Some("estimator"),
            ),
        ] {
            let edited = FULL.replacen(from, to, 1);
            assert_ne!(edited, FULL);
            let keys = basis(&edited).differs_in(&basis(FULL));
            assert_eq!(keys, expected.into_iter().collect::<Vec<_>>(), "{edited}");
        }
        let tricycle = FULL.replace("bicycle", "tricycle");
        let keys = basis(&tricycle).differs_in(&basis(FULL));
        assert_eq!(keys, ["model", "speed_measured_at"]);
        let equal = basis(FULL) == basis(&FULL.replace("odom", "speed"));
        assert!(equal, "what differs in nothing is equal");
    }
}
