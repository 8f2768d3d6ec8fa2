//! Configuration of one robot: its vehicle, its streams and prior knowledge.

use std::f64::consts::TAU;

use fleetcal_estimator::calibrator::CalibratorConfig;
use fleetcal_estimator::point_cloud::PlanarBand;
use fleetcal_estimator::vehicle::SpeedMeasuredAt;
use fleetcal_estimator::{EstimatorSettings, Pose2, Vehicle, VehicleModel};
use fleetcal_model::{Label, Tags};
use fleetcal_proto::message_type::ScanType;
use serde::{Deserialize, Serialize};
use thiserror::Error;

use super::own_settings::OwnSettings;
use crate::streams::RobotStreams;
#[cfg(feature = "openapi")]
use {crate::streams::StreamsFields, fleetcal_estimator::point_cloud::BandFields};

/// Longest wheelbase accepted, m: beyond any vehicle on wheels.
pub const WHEELBASE_MAX_M: f64 = 30.0;
/// Farthest distance of a LiDAR from the rear axle, m.
pub const MOUNT_MAX_M: f64 = 30.0;

/// Reason for which a value in a configuration was refused.
#[derive(Debug, Clone, PartialEq, Error)]
#[error("{key}: got {value}, expected {accepted}")]
pub struct ValueRefused {
    /// Name of the key.
    pub key: &'static str,
    /// Refused value.
    pub value: f64,
    /// Accepted values, in words.
    pub accepted: &'static str,
}

/// Wheelbase of a vehicle, m.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(try_from = "f64", into = "f64")]
pub struct Wheelbase(f64);

impl Wheelbase {
    /// The wheelbase, m.
    pub fn metres(self) -> f64 {
        self.0
    }
}

impl TryFrom<f64> for Wheelbase {
    type Error = ValueRefused;

    fn try_from(metres: f64) -> Result<Self, ValueRefused> {
        if metres > 0.0 && metres <= WHEELBASE_MAX_M {
            Ok(Self(metres))
        } else {
            let accepted = "more than 0 and at most 30 m";
            Err(ValueRefused {
                key: "wheelbase_m",
                value: metres,
                accepted,
            })
        }
    }
}

impl From<Wheelbase> for f64 {
    fn from(wheelbase: Wheelbase) -> Self {
        wheelbase.0
    }
}

/// Pose of a part on the vehicle, from CAD or tape.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(try_from = "Pose2", into = "Pose2")]
pub struct Mount(Pose2);

impl Mount {
    /// The pose.
    pub fn pose(&self) -> Pose2 {
        self.0
    }
}

impl TryFrom<Pose2> for Mount {
    type Error = ValueRefused;

    fn try_from(pose: Pose2) -> Result<Self, ValueRefused> {
        let metres = -MOUNT_MAX_M..=MOUNT_MAX_M;
        let refused = |key, value, accepted| {
            Err(ValueRefused {
                key,
                value,
                accepted,
            })
        };
        if !metres.contains(&pose.x_m) {
            return refused("x_m", pose.x_m, "-30 to 30 m");
        }
        if !metres.contains(&pose.y_m) {
            return refused("y_m", pose.y_m, "-30 to 30 m");
        }
        if !(-TAU..=TAU).contains(&pose.yaw_rad) {
            return refused("yaw_rad", pose.yaw_rad, "radians within one turn");
        }
        Ok(Self(pose))
    }
}

/// Pose of a part on the vehicle.
#[cfg(feature = "openapi")]
#[derive(utoipa::ToSchema)]
#[schema(as = Mount)]
#[expect(dead_code, reason = "the OpenAPI schema of a Mount's limits")]
struct MountSchema {
    /// Position forward of the frame's origin, m.
    #[schema(minimum = -30.0, maximum = 30.0)]
    x_m: f64,
    /// Position left of the frame's origin, m.
    #[schema(minimum = -30.0, maximum = 30.0)]
    y_m: f64,
    /// Heading, counter-clockwise, rad, within one turn.
    yaw_rad: f64,
}

/// Place at which a speed is measured.
// With a type of its own for the rear wheel, which generators of clients name by it.
#[cfg(feature = "openapi")]
#[derive(utoipa::ToSchema)]
#[schema(as = SpeedMeasuredAt, rename_all = "snake_case")]
#[expect(dead_code, reason = "the OpenAPI schema of SpeedMeasuredAt")]
enum SpeedMeasuredAtSchema {
    /// Centre of the rear axle.
    RearAxle,
    /// Steered front wheel.
    SteeredWheel,
    /// One rear wheel.
    RearWheel(RearWheelSchema),
}

/// A rear wheel.
#[cfg(feature = "openapi")]
#[derive(utoipa::ToSchema)]
#[schema(as = RearWheel)]
#[expect(dead_code, reason = "the OpenAPI schema of SpeedMeasuredAt")]
struct RearWheelSchema {
    /// Distance of the wheel to the left of the axle's centre, m.
    lateral_m: f64,
}

impl From<Mount> for Pose2 {
    fn from(mount: Mount) -> Self {
        mount.0
    }
}

/// Kind of steering angle in a robot's wheel odometry.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub enum WheelOdometrySignal {
    /// Raw angle, as the sensor measures it.
    #[default]
    Raw,
    /// Angle minus the offset that the robot applies, which the service adds back.
    Compensated,
}

/// Settings of a robot's scans.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct ScanSettings {
    /// Message type of scans that do not state it.
    pub scan_type: ScanType,
    /// Band of clouds that is used.
    pub band: PlanarBand,
}

/// Vehicle of a robot and prior knowledge of it. Only `model` and `wheelbase_m` are required;
/// unknown keys are refused by name.
// The keys of `[[robot]]` in `fleetcal.toml` (beside `id`) and of the body of
// `PUT /api/v1/robots/{id}`, whose description in OpenAPI these comments are.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct RobotConfig {
    /// Steering of the vehicle.
    pub model: VehicleModel,
    /// Distance between the axles, m, more than 0 and at most 30.
    #[cfg_attr(feature = "openapi", schema(value_type = f64, exclusive_minimum = 0.0, maximum = 30.0, examples(1.2)))]
    pub wheelbase_m: Wheelbase,
    /// Place at which the speed is measured; by default the model's usual one.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[cfg_attr(feature = "openapi", schema(nullable, required = false, value_type = Option<SpeedMeasuredAtSchema>))]
    pub speed_measured_at: Option<SpeedMeasuredAt>,
    /// Pose of the LiDAR in `base` (rear-axle centre, x forward, y left) from CAD or tape.
    #[serde(default, alias = "nominal", skip_serializing_if = "Option::is_none")]
    #[cfg_attr(feature = "openapi", schema(nullable, required = false, value_type = Option<MountSchema>))]
    pub nominal_extrinsics: Option<Mount>,
    /// Kind of steering angle in the wheel odometry; `raw` unless given.
    #[serde(default, alias = "drive")]
    pub wheel_odometry: WheelOdometrySignal,
    /// Pose of the rear axle in the vehicle's `base_link`; documents then also give
    /// `lidar_in_base_link`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[cfg_attr(feature = "openapi", schema(nullable, required = false, value_type = Option<MountSchema>))]
    pub rear_axle_in_base_link: Option<Mount>,
    /// Message type of scans that do not state it; `laser_scan` unless given.
    #[serde(default)]
    pub scan_type: ScanType,
    /// Band of a 3D scanner's clouds that is used; the default band unless given.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[cfg_attr(feature = "openapi", schema(nullable, required = false, value_type = Option<BandFields>))]
    pub point_cloud: Option<PlanarBand>,
    /// Site of the robot, 1 to 64 characters.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[cfg_attr(feature = "openapi", schema(nullable, required = false, value_type = Option<String>, min_length = 1, max_length = 64, examples("Hamburg")))]
    pub site: Option<Label>,
    /// Type of the vehicle by its maker, 1 to 64 characters.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[cfg_attr(feature = "openapi", schema(nullable, required = false, value_type = Option<String>, min_length = 1, max_length = 64, examples("EKX 516")))]
    pub vehicle_type: Option<Label>,
    /// Further groups of the robot: at most 16 tags, each 1 to 64 characters.
    #[serde(default, skip_serializing_if = "Tags::is_empty")]
    #[cfg_attr(feature = "openapi", schema(required = false, value_type = Vec<String>, max_items = 16))]
    pub tags: Tags,
    /// ROS 2 topics of the robot, if they differ from those of `[ros2]`.
    #[serde(default, skip_serializing_if = "RobotStreams::is_default")]
    #[cfg_attr(feature = "openapi", schema(required = false, value_type = StreamsFields))]
    pub streams: RobotStreams,
    /// Settings of this robot's estimator, with the keys of `[estimator]` in `fleetcal.toml`, which
    /// gives the other ones.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[cfg_attr(feature = "openapi", schema(nullable, required = false, value_type = Option<Object>))]
    pub estimator: Option<OwnSettings>,
}

impl RobotConfig {
    /// Configuration of a robot of which only the vehicle is known.
    pub fn of_vehicle(model: VehicleModel, wheelbase_m: Wheelbase) -> Self {
        Self {
            model,
            wheelbase_m,
            speed_measured_at: None,
            nominal_extrinsics: None,
            wheel_odometry: WheelOdometrySignal::Raw,
            rear_axle_in_base_link: None,
            scan_type: ScanType::default(),
            point_cloud: None,
            site: None,
            vehicle_type: None,
            tags: Tags::default(),
            streams: RobotStreams::default(),
            estimator: None,
        }
    }

    /// Settings of its scans.
    pub fn scans(&self) -> ScanSettings {
        ScanSettings {
            scan_type: self.scan_type,
            band: self.point_cloud.unwrap_or_default(),
        }
    }

    /// Vehicle, in the estimator's form.
    pub fn vehicle(&self) -> Vehicle {
        let mut vehicle = Vehicle::new(self.model, self.wheelbase_m.metres());
        if let Some(place) = self.speed_measured_at {
            vehicle.speed_measured_at = place;
        }
        vehicle
    }

    /// Configuration of this robot's estimator, `defaults` being the settings of `[estimator]`.
    pub fn calibrator_config(&self, defaults: &EstimatorSettings) -> CalibratorConfig {
        CalibratorConfig {
            vehicle: self.vehicle(),
            nominal_lidar_in_base: self.nominal_extrinsics.map(|mount| mount.pose()),
            settings: match &self.estimator {
                Some(own) => own.in_use(defaults),
                None => defaults.clone(),
            },
        }
    }
}

#[cfg(all(test, feature = "openapi"))]
mod tests {
    use utoipa::PartialSchema;

    use super::*;

    #[test]
    fn its_schema_requires_no_more_than_the_vehicle() {
        let schema = serde_json::to_value(RobotConfig::schema()).unwrap();
        assert_eq!(
            schema["required"],
            serde_json::json!(["model", "wheelbase_m"])
        );
        let streams = serde_json::to_value(StreamsFields::schema()).unwrap();
        assert_eq!(streams["required"], serde_json::Value::Null);
    }

    #[test]
    fn nominal_extrinsics_are_read_under_their_former_name_and_written_under_the_new_one() {
        let former = r#"{"model": "bicycle", "wheelbase_m": 1.2,
            "nominal": {"x_m": 0.4, "y_m": 0, "yaw_rad": 3.1}}"#;
        let config: RobotConfig = serde_json::from_str(former).unwrap();
        let pose = config.nominal_extrinsics.unwrap().pose();
        assert_eq!(pose, Pose2::new(0.4, 0.0, 3.1));
        let written = serde_json::to_value(&config).unwrap();
        assert_eq!(written["nominal_extrinsics"]["x_m"], 0.4);
        assert!(written.get("nominal").is_none());
    }

    #[test]
    fn every_key_is_accepted() {
        for text in [
            r#"{"model": "bicycle", "wheelbase_m": 1.2}"#,
            r#"{"model": "tricycle", "wheelbase_m": 1.2, "speed_measured_at": "rear_axle",
                "nominal_extrinsics": {"x_m": 0.4, "y_m": 0, "yaw_rad": 3.1}, "wheel_odometry": "compensated",
                "rear_axle_in_base_link": {"x_m": -0.4, "y_m": 0, "yaw_rad": 0},
                "scan_type": "point_cloud2",
                "site": "Hamburg", "vehicle_type": "EKX 516", "tags": ["night shift"],
                "point_cloud": {"height_min_m": -0.2, "height_max_m": 1, "range_min_m": 0.5,
                    "range_max_m": 40, "clearance_m": 0.05, "beams": 720, "ignore_times": true},
                "streams": {"prefix": "7", "scan": {"topic": "front/scan"},
                    "steering": {"topic": "joints", "type": "sensor_msgs/msg/JointState"},
                    "speed": {"topic": "odom", "type": "nav_msgs/msg/Odometry"},
                    "joints": {"steering": "s", "steering_gear": 1, "wheels": ["w"],
                        "wheel_radius_m": 0.1, "wheel_gear": 1}},
                "estimator": {}}"#,
            r#"{"model": "bicycle", "wheelbase_m": 1.2,
                "speed_measured_at": {"rear_wheel": {"lateral_m": 0.3}}}"#,
        ] {
            serde_json::from_str::<RobotConfig>(text).unwrap();
        }
    }
}
