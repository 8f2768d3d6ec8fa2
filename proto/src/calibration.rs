//! The approved calibration on its way to a robot, and the robot's answer.
//!
//! The approved calibration travels as an [`Envelope`]: hash and Ed25519 signature are over the exact bytes
//! of its `document` string, which is a [`CalibrationDocument`] in JSON. Values are absolute, never
//! a residual on top of what the robot already applies.

use serde::{Deserialize, Serialize};

use fleetcal_model::{
    CalibrationCovariance, Generation, Pose2, RevisionId, RobotId, RobotTime, SteeringTable,
};

/// A signed document: a calibration, or another text that the service signs.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct Envelope {
    /// The document in JSON, byte for byte in its hashed and signed form.
    pub document: String,
    /// SHA-256 of the document's bytes, lower-case hexadecimal.
    pub sha256: String,
    /// Id of the service's key that signed it.
    pub key_id: String,
    /// Ed25519 signature of the document's bytes, base64.
    pub signature: String,
}

/// Schema of a calibration document.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub enum CalibrationSchema {
    /// The first version.
    #[default]
    #[serde(rename = "fleetcal.calibration/1")]
    V1,
}

/// Frame of the LiDAR's pose.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub enum CalibrationFrame {
    /// The rear axle's centre, x forward, y left, yaw counter-clockwise.
    #[default]
    RearAxle,
}

/// Calibration values, or their sigmas. Values that were not estimated are absent.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct CalibrationValues {
    /// `steering_true = steering_measured - steering_offset`, rad, left positive.
    pub steering_offset_rad: f64,
    /// The LiDAR's position along x of the frame, m.
    pub lidar_x_m: f64,
    /// The LiDAR's position along y of the frame, m.
    pub lidar_y_m: f64,
    /// The LiDAR's heading in the frame, rad.
    pub lidar_yaw_rad: f64,
    /// True speed over measured speed.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub speed_scale: Option<f64>,
    /// Distance between the axles, m.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub wheelbase_m: Option<f64>,
    /// True steering angle (less its offset) over the measured one.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub steering_gain: Option<f64>,
    /// Delay of a motion in the wheel odometry against the LiDAR's, s.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub time_offset_s: Option<f64>,
}

impl CalibrationValues {
    /// Returns the present values, each with its name on the wire.
    pub fn fields(&self) -> impl Iterator<Item = (&'static str, f64)> + use<> {
        [
            ("steering_offset_rad", Some(self.steering_offset_rad)),
            ("lidar_x_m", Some(self.lidar_x_m)),
            ("lidar_y_m", Some(self.lidar_y_m)),
            ("lidar_yaw_rad", Some(self.lidar_yaw_rad)),
            ("speed_scale", self.speed_scale),
            ("wheelbase_m", self.wheelbase_m),
            ("steering_gain", self.steering_gain),
            ("time_offset_s", self.time_offset_s),
        ]
        .into_iter()
        .filter_map(|(name, value)| value.map(|value| (name, value)))
    }
}

/// Calibration that was approved for one robot: the content of an [`Envelope`].
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct CalibrationDocument {
    /// Schema of the document.
    pub schema: CalibrationSchema,
    /// Id of the robot that it is for.
    pub robot: RobotId,
    /// Number that grows with every approval; a robot applies only a higher one than its own.
    pub generation: Generation,
    /// The generation it was compared with; `None` if the robot had none.
    pub base_generation: Option<Generation>,
    /// The revision of the calibration that was approved.
    pub revision: RevisionId,
    /// Time of the approval, RFC 3339 in UTC.
    pub approved_at: String,
    /// Approver.
    pub approved_by: String,
    /// The values, absolute.
    pub values: CalibrationValues,
    /// Their standard deviations under the same names and units.
    pub sigmas: CalibrationValues,
    /// Covariance of the errors of the four values that every calibration has, where it was
    /// estimated. It was added later: older readers ignore it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub covariance: Option<CalibrationCovariance>,
    /// Curve of the steering that belongs to the values, for information: `values` compensate without it. It was
    /// added later: older readers ignore it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub steering_table: Option<SteeringTable>,
    /// The frame of the LiDAR's pose.
    pub frame: CalibrationFrame,
    /// Time after applying at which a robot without a confirmation reverts by itself, s.
    pub confirm_within_s: u32,
    /// Pose of the rear axle's centre in the vehicle's `base_link`, where that frame is configured.
    /// Like the pose below it was added later: older readers ignore it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub rear_axle_in_base_link: Option<Pose2>,
    /// The LiDAR's pose in that frame, by the values.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub lidar_in_base_link: Option<Pose2>,
}

/// Outcome of a calibration on the robot.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub enum AppliedStatus {
    /// The calibration is in use.
    Applied,
    /// The robot will not use it, because of hash, signature, generation or the robot's own limits.
    Refused,
    /// The robot tried to use it and failed.
    Failed,
    /// The robot returned to its former calibration.
    Reverted,
}

/// A robot's acknowledgement, on `{root}/{robot}/calibration/applied`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct Applied {
    /// Generation of the acknowledged document; 0 for the factory calibration.
    pub generation: Generation,
    /// SHA-256 of the document, lower-case hexadecimal; empty for the factory calibration.
    pub sha256: String,
    /// Outcome of the calibration.
    pub status: AppliedStatus,
    /// Reason, for people.
    #[serde(default)]
    pub reason: Option<String>,
    /// Time of the outcome, ns since 1970, by the robot's clock.
    pub applied_at_ns: RobotTime,
    /// Values that the robot now compensates with, if it reports them.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub values: Option<CalibrationValues>,
}

/// Schema of a confirmation.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
pub enum ConfirmationSchema {
    /// The first version.
    #[default]
    #[serde(rename = "fleetcal.confirmation/1")]
    V1,
}

/// An acknowledgement that the service has stored: the content of [`Confirmed::signed`].
///
/// It names exactly one acknowledgement. The time in it is the robot's own and was unknown to
/// others before, so neither the confirmation of another computer's acknowledgement nor a recorded
/// one fits.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct ConfirmationDocument {
    /// Schema of the document.
    pub schema: ConfirmationSchema,
    /// Id of the robot that acknowledged.
    pub robot: RobotId,
    /// Generation of the document that was acknowledged.
    pub generation: Generation,
    /// SHA-256 of that document, lower-case hexadecimal.
    pub sha256: String,
    /// Outcome that the robot reported.
    pub status: AppliedStatus,
    /// The acknowledgement's `applied_at_ns`.
    pub applied_at_ns: RobotTime,
}

impl ConfirmationDocument {
    /// Makes the confirmation of an acknowledgement.
    pub fn of(robot: RobotId, applied: &Applied) -> Self {
        Self {
            schema: ConfirmationSchema::V1,
            robot,
            generation: applied.generation,
            sha256: applied.sha256.clone(),
            status: applied.status,
            applied_at_ns: applied.applied_at_ns,
        }
    }

    /// True if it confirms this acknowledgement.
    pub fn confirms(&self, applied: &Applied) -> bool {
        *self == Self::of(self.robot.clone(), applied)
    }
}

/// Confirmation that the service has stored an acknowledgement, on
/// `{root}/{robot}/calibration/confirmed`.
///
/// Generation and hash beside the signed text are for older agents, and unsigned.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct Confirmed {
    /// Generation of the document.
    pub generation: Generation,
    /// SHA-256 of the document, lower-case hexadecimal.
    pub sha256: String,
    /// A signed text of schema `fleetcal.confirmation/1`, which repeats the acknowledgement's
    /// robot, `generation`, `sha256`, `status` and `applied_at_ns`. Older services lack it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub signed: Option<Envelope>,
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_document_reads_as_documented() {
        let text = concat!(
            r#"{"schema":"fleetcal.calibration/1","robot":"tugger_01","generation":4,"#,
            r#""base_generation":3,"revision":17,"approved_at":"2026-11-21T12:00:00Z","#,
            r#""approved_by":"ana","values":{"steering_offset_rad":0.051,"lidar_x_m":0.434,"#,
            r#""lidar_y_m":-0.016,"lidar_yaw_rad":0.0133,"speed_scale":1.002},"#,
            r#""sigmas":{"steering_offset_rad":0.0002,"lidar_x_m":0.001,"lidar_y_m":0.001,"#,
            r#""lidar_yaw_rad":0.0003,"speed_scale":0.0005},"frame":"rear_axle","#,
            r#""confirm_within_s":600}"#
        );
        let document: CalibrationDocument = serde_json::from_str(text).unwrap();
        assert_eq!(document.values.wheelbase_m, None);
        assert_eq!(document.rear_axle_in_base_link, None);
        assert_eq!(serde_json::to_string(&document).unwrap(), text);
        let in_base_link = concat!(
            r#""confirm_within_s":600,"rear_axle_in_base_link":{"x_m":-0.4,"y_m":0.0,"#,
            r#""yaw_rad":0.0},"lidar_in_base_link":{"x_m":0.034,"y_m":-0.016,"yaw_rad":0.0133}}"#
        );
        let text = text.replace(r#""confirm_within_s":600}"#, in_base_link);
        let document: CalibrationDocument = serde_json::from_str(&text).unwrap();
        let lidar = document.lidar_in_base_link.unwrap();
        assert_eq!((lidar.x_m, lidar.y_m), (0.034, -0.016));
        assert_eq!(serde_json::to_string(&document).unwrap(), text);
        // What a later service adds is passed over, as these were by agents before them.
        let later = text.replace(r#""frame""#, r#""colour":"red","frame""#);
        let read: CalibrationDocument = serde_json::from_str(&later).unwrap();
        assert_eq!(read, document);
        let other = text.replace("calibration/1", "calibration/2");
        let error = serde_json::from_str::<CalibrationDocument>(&other)
            .unwrap_err()
            .to_string();
        assert!(error.contains("fleetcal.calibration/2"), "{error}");
    }

    #[test]
    fn an_acknowledgement_names_its_unknown_fields() {
        let text = r#"{"generation":4,"sha256":"ab","status":"reverted","reason":"no confirmation","applied_at_ns":7}"#;
        let applied: Applied = serde_json::from_str(text).unwrap();
        assert_eq!(applied.status, AppliedStatus::Reverted);
        assert_eq!(serde_json::to_string(&applied).unwrap(), text);
        let wrong = text.replace("\"reason\"", "\"why\"");
        let error = serde_json::from_str::<Applied>(&wrong)
            .unwrap_err()
            .to_string();
        assert!(error.contains("`why`"), "{error}");
    }
}
