//! The vocabulary of fleetcal: what every other crate names in the same words.
//!
//! One definition for each thing that stands in the estimator, on the wire, in the database and in
//! documents: its variants, its name in text and its JSON form. Pure: no I/O, no clock, no async.
//!
//! SI units and radians; units stand last in names. Transforms are named `a_from_b`.

pub mod change;
pub mod consistency;
pub mod covariance;
pub mod label;
pub mod number;
pub mod parameter;
pub mod plane;
pub mod robot_id;
pub mod sigma;
pub mod steering_table;
pub mod stream;
pub mod time;
pub mod vehicle;

pub use change::{Cause, ChangeKind, Detection, DetectionState, NoteKind};
pub use consistency::{Consistency, Innovation, ModelFit, NisNoise};
pub use covariance::CalibrationCovariance;
pub use label::{LABEL_CHARS_MAX, Label, LabelRefused, TAGS_MAX, Tags};
pub use number::{
    AlertId, AuditId, DeliveryId, DeploymentId, EventId, Generation, ProposalId, RevisionId,
    RolloutId, TokenId, UserId, Version, WebhookId,
};
pub use parameter::{Counts, Motions, Parameter, ParameterStatus, Unit};
pub use plane::{Point, Pose2, wrap_angle_rad};
pub use robot_id::{RobotId, RobotIdRefused};
pub use sigma::{SigmaEffect, SigmaSource, SigmaTerm};
pub use steering_table::{SteeringPoint, SteeringTable, SteeringTableStatus};
pub use stream::Stream;
pub use time::{RobotTime, WallTime};
pub use vehicle::{SpeedMeasuredAt, VehicleModel};
