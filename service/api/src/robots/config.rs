//! How `GET` and `PUT /robots/{id}` describe a robot's configuration.

use fleetcal_model::VehicleModel;

/// A robot's vehicle and what is known of it beforehand. Only `model` and `wheelbase_m` have to be
/// given; unknown keys are refused by name.
#[derive(utoipa::ToSchema)]
#[schema(as = RobotConfig)]
#[expect(
    dead_code,
    reason = "the schema of config::RobotConfig, which a test compares with it"
)]
pub(super) struct RobotConfigSchema {
    /// How the vehicle steers.
    model: VehicleModel,
    /// Distance between the axles, m, more than 0 and at most 30.
    #[schema(exclusive_minimum = 0.0, maximum = 30.0, examples(1.2))]
    wheelbase_m: f64,
    /// Where the speed is measured; where the model usually measures it unless given.
    #[schema(nullable, required = false)]
    speed_measured_at: Option<SpeedMeasuredAtSchema>,
    /// The LiDAR's pose in `base` (rear-axle centre, x forward, y left) from CAD or tape.
    #[schema(nullable, required = false)]
    nominal: Option<MountSchema>,
    /// Whether the wheel odometry carries the raw steering angle; `raw` unless given.
    #[schema(required = false)]
    wheel_odometry: WheelOdometrySignalSchema,
    /// The rear axle in the vehicle's `base_link`.
    #[schema(nullable, required = false)]
    rear_axle_in_base_link: Option<MountSchema>,
    /// Which message its scans are, where they do not say so themselves; `laser_scan` unless given.
    #[schema(required = false)]
    scan_type: ScanTypeSchema,
    /// What is taken of the clouds of a 3D scanner: the keys of `point_cloud` in `fleetcal.toml`.
    #[schema(nullable, required = false)]
    point_cloud: Option<PlanarBandSchema>,
    /// Its ROS 2 topics, where they are not the usual ones.
    #[schema(required = false)]
    streams: StreamsSchema,
    /// Settings of this robot's estimator, with the keys of `[estimator]` in `fleetcal.toml`;
    /// the service's own unless given.
    #[schema(nullable, required = false, value_type = Option<Object>)]
    estimator: Option<serde_json::Value>,
}

/// The pose of a part on the vehicle.
#[derive(utoipa::ToSchema)]
#[schema(as = Mount)]
#[expect(dead_code, reason = "a schema")]
pub(super) struct MountSchema {
    /// Forward of the frame's origin, m.
    #[schema(minimum = -30.0, maximum = 30.0)]
    x_m: f64,
    /// To its left, m.
    #[schema(minimum = -30.0, maximum = 30.0)]
    y_m: f64,
    /// Heading, counter-clockwise, rad, within one turn.
    yaw_rad: f64,
}

/// Whether wheel odometry carries the sensor's raw steering angle.
#[derive(utoipa::ToSchema)]
#[schema(as = WheelOdometrySignal, rename_all = "snake_case")]
#[expect(dead_code, reason = "a schema")]
pub(super) enum WheelOdometrySignalSchema {
    /// As the sensor measures it.
    Raw,
    /// Less the offset that the robot applies, which the service adds back.
    Compensated,
}

/// A message that a scan may be.
#[derive(utoipa::ToSchema)]
#[schema(as = ScanType)]
#[expect(dead_code, reason = "a schema")]
pub(super) enum ScanTypeSchema {
    /// `sensor_msgs/msg/LaserScan`.
    #[schema(rename = "laser_scan")]
    LaserScan,
    /// `sensor_msgs/msg/PointCloud2`.
    #[schema(rename = "point_cloud2")]
    PointCloud2,
}

/// The band of heights in the LiDAR's frame that makes a planar scan of a cloud.
#[derive(utoipa::ToSchema)]
#[schema(as = PlanarBand)]
#[expect(dead_code, reason = "a schema")]
pub(super) struct PlanarBandSchema {
    /// Lowest height taken, m; −0.5 unless given.
    #[schema(required = false, minimum = -50.0, maximum = 50.0)]
    height_min_m: f64,
    /// Highest height taken, m; 0.5 unless given.
    #[schema(required = false, minimum = -50.0, maximum = 50.0)]
    height_max_m: f64,
    /// What is nearer is the robot itself, m; 0.3 unless given.
    #[schema(required = false, minimum = 0.0, maximum = 300.0)]
    range_min_m: f64,
    /// What is farther is left out, m; 60 unless given.
    #[schema(required = false, minimum = 0.0, maximum = 300.0)]
    range_max_m: f64,
    /// What is this near to floor or ceiling belongs to it, m; 0.1 unless given.
    #[schema(required = false, minimum = 0.0, maximum = 1.0)]
    clearance_m: f64,
    /// Beams of a whole turn; as many as the cloud has columns unless given, else 1024.
    #[schema(nullable, required = false, minimum = 90, maximum = 16384)]
    beams: Option<u32>,
    /// Takes all points as measured at the stamp, for a cloud that was deskewed before.
    #[schema(required = false)]
    ignore_times: bool,
}

/// The ROS 2 topics of a robot; what is not given is as `[ros2]` in `fleetcal.toml` says.
#[derive(utoipa::ToSchema)]
#[schema(as = RobotStreams)]
#[expect(dead_code, reason = "a schema")]
pub(super) struct StreamsSchema {
    /// What stands before its topics in Zenoh keys, instead of what the templates say.
    #[schema(nullable, required = false, value_type = Option<String>, examples("7"))]
    prefix: Option<String>,
    /// Wheel odometry, measured steering and speed in one message: `AckermannDriveStamped` or
    /// `JointState`.
    #[schema(nullable, required = false)]
    wheel_odometry: Option<SourceSchema>,
    /// Whether wheel odometry is on the former usual topic, `drive`, where neither this nor `[ros2]`
    /// names one: so for robots that were registered while that was usual.
    #[schema(required = false)]
    former_topic: bool,
    /// Steering alone, with `speed` instead of `wheel_odometry`; paired by stamp.
    #[schema(nullable, required = false)]
    steering: Option<SourceSchema>,
    /// Speed alone: `Odometry`, `TwistStamped`, `JointState` or `AckermannDriveStamped`.
    #[schema(nullable, required = false)]
    speed: Option<SourceSchema>,
    /// `LaserScan` or `PointCloud2`.
    #[schema(nullable, required = false)]
    scan: Option<SourceSchema>,
    /// Poses of the LiDAR instead of scans: `Odometry` or `PoseStamped`.
    #[schema(nullable, required = false)]
    lidar_odometry: Option<SourceSchema>,
    /// Which joints steer and drive, of a `JointState`.
    #[schema(nullable, required = false)]
    joints: Option<JointsSchema>,
}

/// A ROS 2 topic.
#[derive(utoipa::ToSchema)]
#[schema(as = Source)]
#[expect(dead_code, reason = "a schema")]
pub(super) struct SourceSchema {
    /// Its name below the robot, without a slash at the ends.
    #[schema(examples("front/scan"))]
    topic: String,
    /// Its type, where keys, tokens and encodings do not say it.
    #[schema(nullable, required = false, value_type = Option<String>,
        examples("sensor_msgs/msg/LaserScan"))]
    r#type: Option<String>,
}

/// Joints of a `JointState`.
#[derive(utoipa::ToSchema)]
#[schema(as = Joints)]
#[expect(dead_code, reason = "a schema")]
pub(super) struct JointsSchema {
    /// The joint whose position is the steering angle, left positive.
    #[schema(nullable, required = false, value_type = Option<String>)]
    steering: Option<String>,
    /// Steering angle for each radian of the joint; 1 unless given.
    #[schema(required = false)]
    steering_gear: f64,
    /// The joints whose mean velocity is the speed.
    #[schema(required = false)]
    wheels: Vec<String>,
    /// Radius of these wheels, m.
    #[schema(nullable, required = false, value_type = Option<f64>)]
    wheel_radius_m: Option<f64>,
    /// Turns of the wheel for each turn of the joint; 1 unless given.
    #[schema(required = false)]
    wheel_gear: f64,
}

/// Where a speed is measured.
#[derive(utoipa::ToSchema)]
#[schema(as = SpeedMeasuredAt, rename_all = "snake_case")]
#[expect(dead_code, reason = "a schema")]
pub(super) enum SpeedMeasuredAtSchema {
    /// At the rear axle's centre.
    RearAxle,
    /// At the steered front wheel.
    SteeredWheel,
    /// At one rear wheel.
    RearWheel(RearWheelSchema),
}

/// A rear wheel.
#[derive(utoipa::ToSchema)]
#[schema(as = RearWheel)]
#[expect(dead_code, reason = "a schema")]
pub(super) struct RearWheelSchema {
    /// How far the wheel is to the left of the axle's centre, m.
    lateral_m: f64,
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeSet;

    use fleetcal_domain::robot::RobotConfig;
    use utoipa::PartialSchema;

    use super::*;

    #[test]
    fn the_schema_has_the_keys_of_the_configuration() {
        let schema = serde_json::to_value(RobotConfigSchema::schema()).unwrap();
        let described: BTreeSet<_> = schema["properties"].as_object().unwrap().keys().collect();
        let refusal = serde_json::from_str::<RobotConfig>(r#"{"x": 1}"#)
            .unwrap_err()
            .to_string();
        let accepted: BTreeSet<_> = refusal.split('`').skip(3).step_by(2).collect();
        assert_eq!(
            described
                .iter()
                .map(|key| key.as_str())
                .collect::<BTreeSet<_>>(),
            accepted,
            "{refusal}"
        );
        assert_eq!(
            schema["required"],
            serde_json::json!(["model", "wheelbase_m"])
        );
    }

    #[test]
    fn what_the_schema_describes_is_accepted() {
        for text in [
            r#"{"model": "bicycle", "wheelbase_m": 1.2}"#,
            r#"{"model": "tricycle", "wheelbase_m": 1.2, "speed_measured_at": "rear_axle",
                "nominal": {"x_m": 0.4, "y_m": 0, "yaw_rad": 3.1}, "wheel_odometry": "compensated",
                "rear_axle_in_base_link": {"x_m": -0.4, "y_m": 0, "yaw_rad": 0},
                "scan_type": "point_cloud2",
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
