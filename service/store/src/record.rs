//! Records of the store, free of any database.

use std::num::TryFromIntError;

use fleetcal_domain::robot::{CrossTrack, RobotConfig};
use fleetcal_model::{
    EventId, Generation, Parameter, ParameterStatus, RobotTime, Version, WallTime,
};
use fleetcal_proto::RobotId;
use fleetcal_proto::estimate::EstimateDocument;
use serde::{Deserialize, Serialize};
use strum::{EnumString, IntoStaticStr, VariantArray};

/// Number of parameters of a row.
pub const PARAMETERS: usize = Parameter::ALL.len();

/// Record of one robot.
#[derive(Debug, Clone, PartialEq)]
pub struct RobotRecord {
    /// Id of the robot.
    pub id: RobotId,
    /// Configuration of the robot; `None` before the first one.
    pub config: Option<RobotConfig>,
    /// Version, incremented with every change of `config`; 0 before the first one.
    pub version: Version,
    /// Person or tool that gave the drawing in `config`; `None` if the configuration file did.
    pub drawn_by: Option<String>,
    /// Time of the record's creation, wall time.
    pub created_ns: WallTime,
    /// Time of the last change of `config`, wall time.
    pub updated_ns: WallTime,
}

/// Version of a robot's configuration that a writer expects.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Expected {
    /// Any version, or none.
    Any,
    /// No configuration yet.
    Absent,
    /// This version.
    Version(Version),
}

impl Expected {
    /// True if a configuration at `version` (0: none) is expected.
    pub fn accepts(self, version: Version) -> bool {
        match self {
            Self::Any => true,
            Self::Absent => version == Version(0),
            Self::Version(expected) => version == expected,
        }
    }
}

/// Checkpoint, from which a robot's task continues after a restart.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct CheckpointRecord {
    /// Robot of the checkpoint.
    pub robot: RobotId,
    /// Message time of the state.
    pub stamp_ns: RobotTime,
    /// Time at which the store received it, wall time.
    pub received_ns: WallTime,
    /// State of the task, in the fleet's format.
    pub state: Vec<u8>,
}

/// Cross-track errors of a robot with one calibration.
#[derive(Debug, Clone, PartialEq)]
pub struct CrossTrackRecord {
    /// Robot of the errors.
    pub robot: RobotId,
    /// Generation of the calibration; 0 for the factory calibration.
    pub generation: Generation,
    /// Statistics of the errors.
    pub errors: CrossTrack,
}

/// Latest stored estimate of a robot.
#[derive(Debug, Clone, PartialEq)]
pub struct CurrentRecord {
    /// Estimate of the robot.
    pub estimate: EstimateDocument,
    /// Time at which the store received it, wall time.
    pub received_ns: WallTime,
}

/// Second of a robot's history.
#[derive(Debug, Clone, PartialEq)]
pub struct HistoryRow {
    /// Robot of the row.
    pub robot: RobotId,
    /// Message time, whole seconds since the Unix epoch.
    pub t_s: i64,
    /// Receipt time, whole seconds since the Unix epoch.
    pub received_s: i64,
    /// Value and sigma of each parameter that is estimated, in the order of
    /// [`Parameter::ALL`].
    pub cells: [Option<(f64, f64)>; PARAMETERS],
    /// Status of each parameter.
    pub status: PackedStatus,
    /// Mean normalised innovation squared.
    pub nis: Option<f64>,
}

impl HistoryRow {
    /// Row of an estimate that was received at `received_ns`.
    pub fn of(robot: &RobotId, document: &EstimateDocument, received_ns: WallTime) -> Self {
        let estimated = |name: Parameter| {
            let parameter = document.parameters.get(name);
            let fixed = matches!(
                parameter.status,
                ParameterStatus::Fixed | ParameterStatus::Off
            );
            (!fixed).then_some((parameter.value, parameter.sigma))
        };
        let consistency = &document.consistency;
        Self {
            robot: robot.clone(),
            t_s: document.stamp_ns.whole_s(),
            received_s: received_ns.whole_s(),
            cells: Parameter::ALL.map(estimated),
            status: PackedStatus::of(Parameter::ALL.map(|n| document.parameters.get(n).status)),
            nis: (consistency.samples > 0).then_some(consistency.nis_mean),
        }
    }
}

/// Bits of one parameter's status.
const STATUS_BITS: usize = 4;

/// Status of every parameter in one number of the database, four bits each, the first parameter
/// lowest. A parameter that is newer than a row has the bits of `Off` in it.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct PackedStatus(u64);

impl PackedStatus {
    /// Packs the status of as many parameters as the database's signed number has room for; more of
    /// them do not compile.
    pub fn of<const N: usize>(status: [ParameterStatus; N]) -> Self {
        const { assert!(N * STATUS_BITS < 64, "a column holds no more parameters") };
        let code = |status| match status {
            ParameterStatus::Off => 0,
            ParameterStatus::Fixed => 1,
            ParameterStatus::Learning => 2,
            ParameterStatus::Unobservable => 3,
            ParameterStatus::Converged => 4,
        };
        Self(
            status
                .into_iter()
                .rev()
                .fold(0, |packed, status| (packed << STATUS_BITS) | code(status)),
        )
    }

    /// Reads the database's number.
    ///
    /// # Errors
    /// If it is negative, which no written number is.
    pub fn stored(number: i64) -> Result<Self, TryFromIntError> {
        u64::try_from(number).map(Self)
    }

    /// Number to be stored.
    pub fn number(self) -> i64 {
        self.0.cast_signed()
    }

    /// Status of one parameter; `None` for unused bits.
    pub fn get(self, parameter: Parameter) -> Option<ParameterStatus> {
        self.at(parameter.index())
    }

    fn at(self, position: usize) -> Option<ParameterStatus> {
        match (self.0 >> (STATUS_BITS * position)) & 0xf {
            0 => Some(ParameterStatus::Off),
            1 => Some(ParameterStatus::Fixed),
            2 => Some(ParameterStatus::Learning),
            3 => Some(ParameterStatus::Unobservable),
            4 => Some(ParameterStatus::Converged),
            _ => None,
        }
    }
}

/// Kind of event in a robot's history.
#[derive(
    Debug,
    Clone,
    Copy,
    PartialEq,
    Eq,
    PartialOrd,
    Ord,
    Hash,
    Serialize,
    Deserialize,
    EnumString,
    IntoStaticStr,
    VariantArray,
)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
#[serde(rename_all = "snake_case")]
#[strum(serialize_all = "snake_case")]
pub enum EventKind {
    /// Detection that the vehicle is no longer the one that was calibrated.
    CalibrationChanged,
    /// Calibration found equal after a reassembly.
    CalibrationConfirmed,
    /// Calibration learnt after a reassembly, without an earlier one to compare it with.
    CalibrationLearned,
    /// Failure of a sensor or of the LiDAR odometry that lasted.
    Fault,
    /// Removal and refitting of parts.
    Reassembled,
    /// Other work on the robot.
    Maintenance,
    /// Power-on of the robot.
    PowerOn,
    /// New session, as the robot's clock jumped back.
    SessionStarted,
    /// First or new configuration of the robot: its estimator started from scratch.
    Configured,
    /// Restart of the robot's estimator after a failure.
    EstimatorRestarted,
    /// Stop of the robot's estimator after too many failures.
    EstimatorStopped,
    /// Start of the service, which continued from the robot's checkpoint.
    ServiceStarted,
    /// Proposal of a calibration.
    Proposed,
    /// Approval of a proposal by enough people.
    Approved,
    /// End of a proposal without approval.
    ProposalClosed,
    /// Replacement of the proposed values by the present estimate; approvals already given are
    /// void.
    ProposalRefreshed,
    /// Offer of the approved calibration to the robot.
    Offered,
    /// Application of the approved calibration by the robot.
    Applied,
    /// Refusal, failure or reversion of the approved calibration by the robot.
    NotApplied,
    /// Agreement of a verification estimate with the values in use.
    Verified,
    /// Disagreement of a verification estimate with the values in use.
    VerificationFailed,
    /// End of a verification without a verdict, after too little motion.
    Inconclusive,
    /// Begin of a return to the former calibration.
    RollingBack,
    /// Return of the robot to its former calibration.
    RolledBack,
    /// Failed return of the robot to its former calibration.
    RollbackFailed,
}

impl EventKind {
    /// Every kind.
    pub const ALL: &'static [Self] = <Self as VariantArray>::VARIANTS;

    /// The name in documents and in the database.
    pub fn as_str(self) -> &'static str {
        self.into()
    }

    /// Parses the name of a kind.
    pub fn parse(name: &str) -> Option<Self> {
        name.parse().ok()
    }
}

/// Source of an event.
#[derive(
    Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize, IntoStaticStr,
)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
#[serde(rename_all = "snake_case")]
#[strum(serialize_all = "snake_case")]
pub enum EventSource {
    /// Estimator of the robot.
    Estimator,
    /// Robot, or a tool beside it.
    Robot,
    /// Service itself.
    Service,
    /// Person or tool of the site, over HTTP.
    Person,
}

impl EventSource {
    /// The name in documents and in the database.
    pub fn as_str(self) -> &'static str {
        self.into()
    }

    /// Parses the name of a source.
    pub fn parse(name: &str) -> Option<Self> {
        [Self::Estimator, Self::Robot, Self::Service, Self::Person]
            .into_iter()
            .find(|source| source.as_str() == name)
    }
}

/// Event before it has a place in the history.
#[derive(Debug, Clone, PartialEq)]
pub struct NewEvent {
    /// Robot of the event.
    pub robot: RobotId,
    /// Kind of the event.
    pub kind: EventKind,
    /// Time of the event, message time.
    pub stamp_ns: RobotTime,
    /// Time at which the service received it, wall time.
    pub received_ns: WallTime,
    /// Source of the event.
    pub source: EventSource,
    /// Name of the person or tool.
    pub author: Option<String>,
    /// Note, in words.
    pub note: Option<String>,
    /// Details that belong to its kind.
    pub details: Option<serde_json::Value>,
}

/// Event in its place in the history.
#[derive(Debug, Clone, PartialEq)]
pub struct EventRecord {
    /// Number of the event; later events have higher ones.
    pub id: EventId,
    /// True if it was stored before and is repeated.
    pub repeated: bool,
    /// Stored event.
    pub event: NewEvent,
}

/// Idempotency key of a request, by which a repetition is recognised.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct IdempotencyKey {
    /// Value of the request's `Idempotency-Key`.
    pub key: String,
    /// SHA-256 of the request's body.
    pub request_sha256: [u8; 32],
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_status_survives_packing() {
        use ParameterStatus::{Converged, Fixed, Learning, Off, Unobservable};
        let status = [
            Converged,
            Learning,
            Unobservable,
            Fixed,
            Off,
            Fixed,
            Learning,
            Converged,
        ];
        let packed = PackedStatus::of(status);
        assert_eq!(PackedStatus::stored(packed.number()), Ok(packed));
        for (name, expected) in Parameter::ALL.into_iter().zip(status) {
            assert_eq!(packed.get(name), Some(expected), "{name:?}");
        }
        assert_eq!(PackedStatus(0xf).get(Parameter::SteeringOffset), None);
    }

    /// Regression test: a ninth parameter was lost, and the first eight were read from wrong bits.
    #[test]
    fn a_row_has_room_for_more_parameters_than_there_are() {
        use ParameterStatus::{Converged, Fixed, Learning, Off};
        let mut nine = [Learning; 9];
        nine[8] = Converged;
        let packed = PackedStatus::stored(PackedStatus::of(nine).number()).unwrap();
        assert!((0..8).all(|position| packed.at(position) == Some(Learning)));
        assert_eq!(packed.at(8), Some(Converged));
        let most = PackedStatus::of([Fixed; 15]);
        assert!(most.number() > 0);
        assert_eq!(most.at(14), Some(Fixed));
        assert_eq!(
            PackedStatus::stored(0x2222_2222).unwrap().at(8),
            Some(Off),
            "a row of eight"
        );
        assert!(PackedStatus::stored(-1).is_err());
    }

    #[test]
    fn names_of_events_are_those_of_their_documents() {
        for &kind in EventKind::ALL {
            assert_eq!(serde_json::to_value(kind).unwrap(), kind.as_str());
            assert_eq!(EventKind::parse(kind.as_str()), Some(kind));
        }
        assert_eq!(EventKind::parse("exploded"), None);
        assert_eq!(EventSource::parse("person"), Some(EventSource::Person));
        assert_eq!(EventSource::parse(""), None);
    }
}
