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

/// Parameters of a row.
pub const PARAMETERS: usize = Parameter::ALL.len();

/// One robot as the store knows it.
#[derive(Debug, Clone, PartialEq)]
pub struct RobotRecord {
    /// Its id.
    pub id: RobotId,
    /// Its configuration; `None` while nobody has described it.
    pub config: Option<RobotConfig>,
    /// Goes up by one with every change of `config`; 0 while there is none.
    pub version: Version,
    /// The person or tool that gave the drawing in `config`; `None` where the configuration file did.
    pub drawn_by: Option<String>,
    /// When the store first heard of it, wall time.
    pub created_ns: WallTime,
    /// When `config` last changed, wall time.
    pub updated_ns: WallTime,
}

/// Which version of a robot's configuration a writer has seen.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Expected {
    /// Whatever is there is overwritten.
    Any,
    /// There is no configuration yet.
    Absent,
    /// This version.
    Version(Version),
}

impl Expected {
    /// Whether a configuration at `version` (0: none) is what was expected.
    pub fn accepts(self, version: Version) -> bool {
        match self {
            Self::Any => true,
            Self::Absent => version == Version(0),
            Self::Version(expected) => version == expected,
        }
    }
}

/// The state from which a robot's task goes on after a restart.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct CheckpointRecord {
    /// Whose.
    pub robot: RobotId,
    /// Message time of the state.
    pub stamp_ns: RobotTime,
    /// When it was handed to the store, wall time.
    pub received_ns: WallTime,
    /// The state, in the fleet's format.
    pub state: Vec<u8>,
}

/// How well a robot follows its path with one calibration.
#[derive(Debug, Clone, PartialEq)]
pub struct CrossTrackRecord {
    /// Whose.
    pub robot: RobotId,
    /// Generation of the calibration; 0 for what it drove with at first.
    pub generation: Generation,
    /// The errors.
    pub errors: CrossTrack,
}

/// The latest estimate the store has of a robot.
#[derive(Debug, Clone, PartialEq)]
pub struct CurrentRecord {
    /// The estimate.
    pub estimate: EstimateDocument,
    /// When it was handed to the store, wall time.
    pub received_ns: WallTime,
}

/// One second of a robot's history.
#[derive(Debug, Clone, PartialEq)]
pub struct HistoryRow {
    /// Whose.
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
    /// The row of an estimate that was received at `received_ns`.
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

/// Bits that one parameter's status has.
const STATUS_BITS: usize = 4;

/// Status of every parameter in one number of the database, four bits each, the first parameter lowest. A
/// parameter that came later than a row has the bits of `Off` there.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct PackedStatus(u64);

impl PackedStatus {
    /// The status of as many parameters as the database's signed number has room for; of more it does not
    /// compile.
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

    /// As the database has it.
    ///
    /// # Errors
    /// When it is negative, which none is that was written.
    pub fn stored(number: i64) -> Result<Self, TryFromIntError> {
        u64::try_from(number).map(Self)
    }

    /// The number that is stored.
    pub fn number(self) -> i64 {
        self.0.cast_signed()
    }

    /// One parameter's status; `None` for bits that no status has.
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

/// What happened to a robot.
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
    /// The estimator found that the vehicle is no longer the one that was calibrated.
    CalibrationChanged,
    /// After a reassembly the calibration came out equal.
    CalibrationConfirmed,
    /// After a reassembly the calibration is known, and there was none before to compare it with.
    CalibrationLearned,
    /// A sensor or the LiDAR odometry failed for a while.
    Fault,
    /// Parts were taken off and put back.
    Reassembled,
    /// Other work was done on the robot.
    Maintenance,
    /// The robot was switched on.
    PowerOn,
    /// The robot's clock jumped back: a new session began.
    SessionStarted,
    /// The robot's configuration was given or changed: its estimator began from nothing.
    Configured,
    /// The robot's estimator failed and was restarted.
    EstimatorRestarted,
    /// The robot's estimator failed too often and was stopped.
    EstimatorStopped,
    /// The service was started and went on from the robot's stored state.
    ServiceStarted,
    /// A calibration was proposed.
    Proposed,
    /// Enough people have agreed to a proposal.
    Approved,
    /// A proposal ended without approval.
    ProposalClosed,
    /// The present estimate took the place of what was proposed; approvals already given are void.
    ProposalRefreshed,
    /// The approved calibration was offered to the robot.
    Offered,
    /// The robot uses the approved calibration.
    Applied,
    /// The robot did not take the approved calibration, or not keep it.
    NotApplied,
    /// A verification estimate agrees with what the robot uses.
    Verified,
    /// A verification estimate disagrees with what the robot uses.
    VerificationFailed,
    /// The robot did not move enough to tell.
    Inconclusive,
    /// The former calibration is on its way back.
    RollingBack,
    /// The robot uses its former calibration again.
    RolledBack,
    /// The robot did not take its former calibration.
    RollbackFailed,
}

impl EventKind {
    /// All of them.
    pub const ALL: &'static [Self] = <Self as VariantArray>::VARIANTS;

    /// The name in documents and in the database.
    pub fn as_str(self) -> &'static str {
        self.into()
    }

    /// The kind of this name.
    pub fn parse(name: &str) -> Option<Self> {
        name.parse().ok()
    }
}

/// Who says that something happened.
#[derive(
    Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize, IntoStaticStr,
)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
#[serde(rename_all = "snake_case")]
#[strum(serialize_all = "snake_case")]
pub enum EventSource {
    /// The estimator.
    Estimator,
    /// The robot or a tool beside it.
    Robot,
    /// The service.
    Service,
    /// A person or a tool of the site, over HTTP.
    Person,
}

impl EventSource {
    /// The name in documents and in the database.
    pub fn as_str(self) -> &'static str {
        self.into()
    }

    /// The source of this name.
    pub fn parse(name: &str) -> Option<Self> {
        [Self::Estimator, Self::Robot, Self::Service, Self::Person]
            .into_iter()
            .find(|source| source.as_str() == name)
    }
}

/// Something that happened, before it has a place in the history.
#[derive(Debug, Clone, PartialEq)]
pub struct NewEvent {
    /// To whom.
    pub robot: RobotId,
    /// What.
    pub kind: EventKind,
    /// When, message time.
    pub stamp_ns: RobotTime,
    /// When the service learnt of it, wall time.
    pub received_ns: WallTime,
    /// Who says so.
    pub source: EventSource,
    /// The person's or tool's name.
    pub author: Option<String>,
    /// In words.
    pub note: Option<String>,
    /// What belongs to its kind.
    pub details: Option<serde_json::Value>,
}

/// Something that happened, in its place in the history.
#[derive(Debug, Clone, PartialEq)]
pub struct EventRecord {
    /// Its number; later events have higher ones.
    pub id: EventId,
    /// Whether it was there before and is only told again.
    pub repeated: bool,
    /// What happened.
    pub event: NewEvent,
}

/// What makes a repeated request recognisable.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct IdempotencyKey {
    /// The `Idempotency-Key` of the request.
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

    /// As many as are ever asked for: the ninth was lost, and the first eight were read of other bits.
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
