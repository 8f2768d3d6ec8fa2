//! Messages of a robot or a tool besides its streams: events, and cross-track errors.

use fleetcal_model::{NoteKind, RobotTime};
use serde::{Deserialize, Serialize};

/// A note in a robot's history, on `{root}/{robot}/event`.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct RobotEvent {
    /// Kind of the event.
    pub kind: NoteKind,
    /// Time of the event, ns since 1970, by the robot's clock.
    pub stamp_ns: RobotTime,
    /// Details, for people.
    #[serde(default)]
    pub note: String,
}

/// Cross-track error of a robot, on `{root}/{robot}/cross_track_error`.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct CrossTrackError {
    /// Time of the measurement, ns since 1970, by the robot's clock.
    pub stamp_ns: RobotTime,
    /// Distance of the rear axle's centre from the path, m, positive when left of it.
    pub value_m: f64,
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_event_reads_as_documented() {
        let text = r#"{"kind":"reassembled","stamp_ns":5,"note":"new LiDAR bracket"}"#;
        let event: RobotEvent = serde_json::from_str(text).unwrap();
        assert_eq!(event.kind, NoteKind::Reassembled);
        assert_eq!(serde_json::to_string(&event).unwrap(), text);
        assert!(serde_json::from_str::<RobotEvent>(r#"{"kind":"power_on","stamp_ns":5}"#).is_ok());
    }

    #[test]
    fn unknown_fields_and_kinds_are_named() {
        let error = |text| {
            serde_json::from_str::<RobotEvent>(text)
                .unwrap_err()
                .to_string()
        };
        assert!(error(r#"{"kind":"power_on","stamp_ns":5,"when":1}"#).contains("`when`"));
        assert!(error(r#"{"kind":"exploded","stamp_ns":5}"#).contains("`exploded`"));
        assert!(error(r#"{"kind":"power_on"}"#).contains("`stamp_ns`"));
    }
}
