//! The calibration a simulated robot holds, and what it makes of one that is offered.

use fleetcal_proto::RobotId;
use fleetcal_proto::calibration::{
    Applied as Acknowledgement, AppliedStatus, CalibrationDocument, CalibrationValues, Envelope,
};
use sha2::{Digest, Sha256};

use crate::simulator::{Applied, Pose2};

/// Largest envelope that is read, bytes.
pub(super) const ENVELOPE_BYTES_MAX: usize = 64 * 1024;
/// Largest steering offset the robot believes, rad.
const STEERING_OFFSET_MAX_RAD: f64 = 0.262;
/// Farthest that a LiDAR can sit from where the drawing has it, m and rad.
const MOUNT_POSITION_MAX_M: f64 = 0.5;
const MOUNT_YAW_MAX_RAD: f64 = 0.5;

/// What a robot holds.
#[derive(Debug, Clone)]
pub(super) struct Held {
    robot: RobotId,
    nominal: Pose2,
    generation: u64,
    sha256: String,
    applied: Applied,
    /// Hash of the last document that was refused: it is answered once.
    refused: Option<String>,
}

/// What became of an offer.
#[derive(Debug)]
pub(super) enum Offered {
    /// The robot uses it from now on.
    Taken(Applied),
    /// The robot will not use it, for this reason.
    Refused {
        generation: u64,
        sha256: String,
        reason: String,
    },
    /// The robot holds it already, or a newer one, or has refused it before.
    Known,
    /// It cannot be read at all.
    Unreadable(String),
}

impl Held {
    pub fn new(robot: RobotId, applied: Applied) -> Self {
        Self {
            robot,
            nominal: applied.lidar_in_base,
            generation: 0,
            sha256: String::new(),
            applied,
            refused: None,
        }
    }

    pub fn generation(&self) -> u64 {
        self.generation
    }

    /// Considers an envelope. The signature is not looked at: a simulated robot trusts its router.
    pub fn offer(&mut self, payload: &[u8]) -> Offered {
        if payload.len() > ENVELOPE_BYTES_MAX {
            let length = payload.len();
            return Offered::Unreadable(format!(
                "envelope is {length} bytes long, accepted are at most {ENVELOPE_BYTES_MAX}"
            ));
        }
        let envelope: Envelope = match serde_json::from_slice(payload) {
            Ok(envelope) => envelope,
            Err(error) => return Offered::Unreadable(format!("envelope: {error}")),
        };
        let document: CalibrationDocument = match serde_json::from_str(&envelope.document) {
            Ok(document) => document,
            Err(error) => return Offered::Unreadable(format!("document: {error}")),
        };
        let known = document.generation <= self.generation
            || self.refused.as_ref() == Some(&envelope.sha256);
        if known {
            return Offered::Known;
        }
        if let Some(reason) = self.objection(&envelope, &document) {
            self.refused = Some(envelope.sha256.clone());
            let (generation, sha256) = (document.generation, envelope.sha256);
            return Offered::Refused {
                generation,
                sha256,
                reason,
            };
        }
        self.generation = document.generation;
        self.sha256 = envelope.sha256;
        let CalibrationValues {
            steering_offset_rad,
            lidar_x_m,
            lidar_y_m,
            lidar_yaw_rad,
            ..
        } = document.values;
        let lidar_in_base = Pose2::new(lidar_x_m, lidar_y_m, lidar_yaw_rad);
        self.applied = Applied {
            steering_offset_rad,
            lidar_in_base,
        };
        Offered::Taken(self.applied)
    }

    fn objection(&self, envelope: &Envelope, document: &CalibrationDocument) -> Option<String> {
        let sha256 = format!("{:x}", Sha256::digest(envelope.document.as_bytes()));
        if sha256 != envelope.sha256 {
            return Some(format!(
                "sha256 is {}, the document's is {sha256}",
                envelope.sha256
            ));
        }
        if document.robot != self.robot {
            return Some(format!(
                "robot is {}, this one is {}",
                document.robot, self.robot
            ));
        }
        let values = &document.values;
        let limits = [
            (
                "steering_offset_rad",
                values.steering_offset_rad,
                0.0,
                STEERING_OFFSET_MAX_RAD,
            ),
            (
                "lidar_x_m",
                values.lidar_x_m,
                self.nominal.x_m,
                MOUNT_POSITION_MAX_M,
            ),
            (
                "lidar_y_m",
                values.lidar_y_m,
                self.nominal.y_m,
                MOUNT_POSITION_MAX_M,
            ),
            (
                "lidar_yaw_rad",
                values.lidar_yaw_rad,
                self.nominal.yaw_rad,
                MOUNT_YAW_MAX_RAD,
            ),
        ];
        limits.into_iter().find_map(|(field, value, middle, most)| {
            let inside = (value - middle).abs() <= most;
            (!inside).then(|| format!("{field} is {value}, accepted is {middle} ± {most}"))
        })
    }

    /// What the robot uses now, for the service.
    pub fn acknowledgement(&self, now_ns: i64) -> Acknowledgement {
        let Pose2 { x_m, y_m, yaw_rad } = self.applied.lidar_in_base;
        Acknowledgement {
            generation: self.generation,
            sha256: self.sha256.clone(),
            status: AppliedStatus::Applied,
            reason: None,
            applied_at_ns: now_ns,
            values: Some(CalibrationValues {
                steering_offset_rad: self.applied.steering_offset_rad,
                lidar_x_m: x_m,
                lidar_y_m: y_m,
                lidar_yaw_rad: yaw_rad,
                ..CalibrationValues::default()
            }),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn held() -> Held {
        let lidar_in_base = Pose2::new(0.434, 0.0, 0.0);
        let applied = Applied {
            steering_offset_rad: 0.0,
            lidar_in_base,
        };
        Held::new(RobotId::parse("tugger_01").unwrap(), applied)
    }

    fn document(robot: &str, generation: u64, steering_offset_rad: f64) -> String {
        format!(
            r#"{{"schema":"fleetcal.calibration/1","robot":"{robot}","generation":{generation},
            "base_generation":null,"revision":1,"approved_at":"2026-01-01T00:00:00Z",
            "approved_by":"ana","values":{{"steering_offset_rad":{steering_offset_rad},
            "lidar_x_m":0.44,"lidar_y_m":0.01,"lidar_yaw_rad":0.02}},
            "sigmas":{{"steering_offset_rad":0.001,"lidar_x_m":0.001,"lidar_y_m":0.001,
            "lidar_yaw_rad":0.001}},"frame":"rear_axle","confirm_within_s":600}}"#
        )
    }

    fn envelope(document: &str) -> Vec<u8> {
        let sha256 = format!("{:x}", Sha256::digest(document.as_bytes()));
        let envelope = Envelope {
            document: document.to_owned(),
            sha256,
            key_id: "k".to_owned(),
            signature: String::new(),
        };
        serde_json::to_vec(&envelope).unwrap()
    }

    #[test]
    fn only_a_higher_generation_is_taken() {
        let mut held = held();
        let Offered::Taken(applied) = held.offer(&envelope(&document("tugger_01", 2, 0.05))) else {
            panic!("the first one is taken");
        };
        assert!((applied.steering_offset_rad - 0.05).abs() < 1e-12);
        assert!((applied.lidar_in_base.x_m - 0.44).abs() < 1e-12);
        for generation in [1, 2] {
            let offered = held.offer(&envelope(&document("tugger_01", generation, 0.01)));
            assert!(
                matches!(offered, Offered::Known),
                "{generation}: {offered:?}"
            );
        }
        let acknowledgement = held.acknowledgement(7);
        assert_eq!(acknowledgement.generation, 2);
        let values = acknowledgement.values.unwrap();
        assert!((values.steering_offset_rad - 0.05).abs() < 1e-12);
    }

    #[test]
    fn what_a_robot_refuses_is_answered_once_with_the_reason() {
        let cases = [
            (
                envelope(&document("tugger_02", 1, 0.05)),
                "robot is tugger_02",
            ),
            (
                envelope(&document("tugger_01", 1, 0.4)),
                "steering_offset_rad is 0.4",
            ),
        ];
        let torn = String::from_utf8(envelope(&document("tugger_01", 1, 0.05))).unwrap();
        let torn = torn.replace("0.44", "0.45").into_bytes();
        for (payload, wanted) in cases.into_iter().chain([(torn, "sha256 is")]) {
            let mut held = held();
            match held.offer(&payload) {
                Offered::Refused {
                    reason,
                    generation: 1,
                    ..
                } => {
                    assert!(reason.contains(wanted), "{reason}");
                }
                other => panic!("{wanted}: {other:?}"),
            }
            assert!(matches!(held.offer(&payload), Offered::Known));
            assert_eq!(held.generation(), 0);
        }
        assert!(matches!(held().offer(b"{}"), Offered::Unreadable(_)));
        assert!(matches!(
            held().offer(&vec![b' '; 1 << 20]),
            Offered::Unreadable(_)
        ));
    }
}
