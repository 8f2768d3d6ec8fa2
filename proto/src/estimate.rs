//! Document of a robot's calibration: one schema for `fleetcal calibrate --json`,
//! for `{root}/{robot}/estimate` and for the HTTP API.
//!
//! All numbers are finite; JSON has no other.

use std::collections::BTreeMap;

use fleetcal_model::{
    CalibrationCovariance, Cause, ChangeKind, Consistency, Counts, Detection, Motions, Parameter,
    ParameterStatus, Pose2, RobotId, RobotTime, SigmaTerm, SteeringTable, Unit, VehicleModel,
};
use serde::{Deserialize, Serialize};

use crate::description::DescriptionDocument;

/// Estimate of one parameter: `P` of the documents.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct ParameterDocument {
    /// Value, in `unit`.
    pub value: f64,
    /// Standard deviation, in `unit`.
    pub sigma: f64,
    /// Unit of both.
    pub unit: Unit,
    /// Status of the estimate.
    pub status: ParameterStatus,
    /// Motion that would improve the estimate, in words; `None` if it needs none.
    pub needs: Option<String>,
}

/// All parameters of a calibration.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct Parameters {
    /// `steering_true = steering_measured - steering_offset`, left positive.
    pub steering_offset: ParameterDocument,
    /// The LiDAR's position along x of `base`.
    pub lidar_x: ParameterDocument,
    /// The LiDAR's position along y of `base`.
    pub lidar_y: ParameterDocument,
    /// The LiDAR's heading in `base`.
    pub lidar_yaw: ParameterDocument,
    /// True speed over measured speed.
    pub speed_scale: ParameterDocument,
    /// Distance between the axles.
    pub wheelbase: ParameterDocument,
    /// Delay of a motion in the wheel odometry against the LiDAR's.
    pub time_offset: ParameterDocument,
    /// True steering angle (less its offset) over the measured one.
    pub steering_gain: ParameterDocument,
}

impl Parameters {
    /// Returns one parameter by its name.
    pub fn get(&self, name: Parameter) -> &ParameterDocument {
        match name {
            Parameter::SteeringOffset => &self.steering_offset,
            Parameter::LidarX => &self.lidar_x,
            Parameter::LidarY => &self.lidar_y,
            Parameter::LidarYaw => &self.lidar_yaw,
            Parameter::SpeedScale => &self.speed_scale,
            Parameter::Wheelbase => &self.wheelbase,
            Parameter::TimeOffset => &self.time_offset,
            Parameter::SteeringGain => &self.steering_gain,
        }
    }

    /// Iterates over all parameters, to change them.
    pub fn iter_mut(&mut self) -> impl Iterator<Item = &mut ParameterDocument> {
        let Self {
            steering_offset,
            lidar_x,
            lidar_y,
            lidar_yaw,
            speed_scale,
            wheelbase,
            time_offset,
            steering_gain,
        } = self;
        [
            steering_offset,
            lidar_x,
            lidar_y,
            lidar_yaw,
            speed_scale,
            wheelbase,
            time_offset,
            steering_gain,
        ]
        .into_iter()
    }

    /// Iterates over all parameters with their names, in the order of [`Parameter::ALL`].
    pub fn iter(&self) -> impl Iterator<Item = (Parameter, &ParameterDocument)> {
        Parameter::ALL
            .into_iter()
            .map(|name| (name, self.get(name)))
    }
}

/// State of one robot's calibration now, on `{root}/{robot}/estimate` once a second and from `GET
/// /api/v1/robots/{id}/estimate`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct EstimateDocument {
    /// Id of the robot.
    pub robot: RobotId,
    /// Time of the estimate, ns since 1970, by the robot's clock.
    pub stamp_ns: RobotTime,
    /// Seconds since the session's first message.
    pub time_s: f64,
    /// Distance driven in the session, m.
    pub distance_m: f64,
    /// The parameters.
    pub parameters: Parameters,
    /// True if somebody has reported a reassembly, and the calibration is not known again since;
    /// absent otherwise.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub reassembly_open: bool,
    /// Covariance of the errors of the four parameters of a calibration; absent in documents of
    /// older services.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub covariance: Option<CalibrationCovariance>,
    /// Curve of the steering at the angles that were driven, for information; absent in documents of older
    /// services.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub steering_table: Option<SteeringTable>,
    /// State of the detection of changes, by cause; absent in documents of older services.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub detection: Option<Detection>,
    /// Consistency of the filter.
    pub consistency: Consistency,
    /// Numbers of messages so far.
    pub counts: Counts,
    /// Distance in each kind of motion that the estimate rests on; absent in documents of older
    /// services.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub motions: Option<Motions>,
    /// The LiDAR's pose in the vehicle's `base_link`, where that frame is configured.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub lidar_in_base_link: Option<Pose2>,
    /// Instance of a cluster that estimates the robot; absent where one service has all robots.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub estimated_by: Option<EstimatedBy>,
}

/// Instance of a cluster that estimates a robot.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct EstimatedBy {
    /// Its name.
    pub instance: String,
    /// Number that grows with each instance that begins to estimate the robot. Of two estimates,
    /// ignore the one with the lower epoch: it comes from an instance that was replaced.
    pub epoch: i64,
}

/// Detected change or fault: one of `events`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct ChangeDocument {
    /// Kind of the event.
    pub kind: ChangeKind,
    /// Cause of the event.
    pub cause: Cause,
    /// Time of its detection, in seconds since the session's first message.
    pub time_s: f64,
    /// Time of its onset, in seconds since the session's first message.
    pub onset_s: f64,
    /// Time of its detection, ns since 1970, by the robot's clock.
    pub stamp_ns: RobotTime,
    /// New value less old value of each parameter that moved, in the parameter's unit.
    pub change: BTreeMap<Parameter, f64>,
}

/// Stretch of a session between changes.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct Segment {
    /// Its first second, since the session's first message.
    pub from_s: f64,
    /// Its last second.
    pub to_s: f64,
    /// The parameters at its end.
    pub parameters: Parameters,
}

/// Vehicle of a calibration.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct VehicleDocument {
    /// Steering geometry and place of the speed measurement.
    pub model: VehicleModel,
    /// Distance from the rear axle to the steered axle as configured, m.
    pub wheelbase_m: f64,
}

/// Cost of a calibration.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct Timing {
    /// Median time of one scan's LiDAR odometry and update, ms.
    pub scan_median_ms: f64,
    /// The 99th percentile of these times, ms.
    pub scan_p99_ms: f64,
    /// Total CPU time, s.
    pub cpu_s: f64,
    /// Seconds of recording processed in one second.
    pub realtime_factor: f64,
}

/// Report that `fleetcal calibrate --json` prints.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct CalibrationReport {
    /// [`CalibrationReport::SCHEMA_VERSION`] of the program that printed it.
    pub schema_version: u32,
    /// Id of the robot.
    pub robot: RobotId,
    /// The vehicle.
    pub vehicle: VehicleDocument,
    /// Configuration that the robot's own description implies; absent without a description.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[cfg_attr(feature = "openapi", schema(nullable, required = false))]
    pub description: Option<DescriptionDocument>,
    /// Length of the recording, s.
    pub duration_s: f64,
    /// Distance driven, m.
    pub distance_m: f64,
    /// Drive samples used.
    pub drive_samples: u64,
    /// Scans or LiDAR poses used.
    pub scans: u64,
    /// Scans that were unusable.
    pub scans_rejected: u64,
    /// Parameters of the vehicle at the end.
    pub parameters: Parameters,
    /// Covariance of the errors of the four parameters of a calibration.
    pub covariance: CalibrationCovariance,
    /// Terms of each sigma in `parameters`: why it is as wide as it is. None of a parameter that is off.
    #[serde(default)]
    pub sigma_terms: BTreeMap<Parameter, Vec<SigmaTerm>>,
    /// Curve of the steering at the angles that were driven, for information.
    #[serde(default)]
    pub steering_table: SteeringTable,
    /// State of the detection of changes at the end, by cause.
    pub detection: Detection,
    /// Consistency of the filter.
    pub consistency: Consistency,
    /// Changes and faults, oldest first.
    pub events: Vec<ChangeDocument>,
    /// The stretches between changes, oldest first.
    pub segments: Vec<Segment>,
    /// Cost of the calibration.
    pub timing: Timing,
}

impl CalibrationReport {
    /// Version that grows by one whenever a field is renamed, removed or changes its meaning. An
    /// added field does not change it.
    pub const SCHEMA_VERSION: u32 = 2;
}

#[cfg(test)]
mod tests {
    use fleetcal_model::DetectionState;

    use super::*;

    fn parameters() -> Parameters {
        let p = |name: Parameter| ParameterDocument {
            value: 0.1,
            sigma: 0.2,
            unit: name.unit(),
            status: ParameterStatus::Learning,
            needs: None,
        };
        Parameters {
            steering_offset: p(Parameter::SteeringOffset),
            lidar_x: p(Parameter::LidarX),
            lidar_y: p(Parameter::LidarY),
            lidar_yaw: p(Parameter::LidarYaw),
            speed_scale: p(Parameter::SpeedScale),
            wheelbase: p(Parameter::Wheelbase),
            time_offset: p(Parameter::TimeOffset),
            steering_gain: p(Parameter::SteeringGain),
        }
    }

    fn keys(value: &serde_json::Value) -> Vec<&str> {
        value
            .as_object()
            .unwrap()
            .keys()
            .map(String::as_str)
            .collect()
    }

    fn report() -> CalibrationReport {
        CalibrationReport {
            schema_version: CalibrationReport::SCHEMA_VERSION,
            robot: RobotId::parse("tugger_01").unwrap(),
            vehicle: VehicleDocument {
                model: VehicleModel::Bicycle,
                wheelbase_m: 1.2,
            },
            description: Some(DescriptionDocument::default()),
            duration_s: 1.0,
            distance_m: 2.0,
            drive_samples: 3,
            scans: 4,
            scans_rejected: 5,
            parameters: parameters(),
            covariance: CalibrationCovariance::default(),
            sigma_terms: BTreeMap::new(),
            steering_table: SteeringTable::default(),
            detection: Detection::of_all(DetectionState::Watching),
            consistency: Consistency::default(),
            events: vec![ChangeDocument {
                kind: ChangeKind::CalibrationChanged,
                cause: Cause::LidarMount,
                time_s: 90.5,
                onset_s: 90.0,
                stamp_ns: RobotTime(7),
                change: BTreeMap::from([(Parameter::LidarX, 0.02)]),
            }],
            segments: vec![Segment {
                from_s: 0.0,
                to_s: 90.0,
                parameters: parameters(),
            }],
            timing: Timing::default(),
        }
    }

    #[test]
    fn a_report_has_the_documented_names() {
        let report = report();
        let json = serde_json::to_value(&report).unwrap();
        let mut names = keys(&json);
        names.sort_unstable();
        assert_eq!(
            names,
            [
                "consistency",
                "covariance",
                "description",
                "detection",
                "distance_m",
                "drive_samples",
                "duration_s",
                "events",
                "parameters",
                "robot",
                "scans",
                "scans_rejected",
                "schema_version",
                "segments",
                "sigma_terms",
                "steering_table",
                "timing",
                "vehicle"
            ]
        );
        // Whoever changes the names above raises it.
        assert_eq!(json["schema_version"], 2);
        assert_eq!(json["vehicle"]["model"], "bicycle");
        assert_eq!(json["events"][0]["cause"], "lidar_mount");
        assert_eq!(json["events"][0]["change"]["lidar_x"], 0.02);
        assert_eq!(json["parameters"]["speed_scale"]["unit"], "1");
        assert_eq!(json["parameters"]["lidar_yaw"]["status"], "learning");
        assert!(json["parameters"]["lidar_yaw"]["needs"].is_null());
        assert_eq!(
            serde_json::from_value::<CalibrationReport>(json).unwrap(),
            report
        );
    }

    #[test]
    fn parameters_are_found_by_name() {
        let json = serde_json::to_value(parameters()).unwrap();
        for (name, document) in parameters().iter() {
            let found: ParameterDocument =
                serde_json::from_value(json[name.name()].clone()).unwrap();
            assert_eq!(&found, document);
            assert_eq!(serde_json::to_value(name).unwrap(), name.name());
        }
    }
}
