//! Roles of a person, tool or robot, in steps.

use serde::{Deserialize, Serialize};
use strum::{EnumString, IntoStaticStr, VariantArray};

/// What somebody may do. The first four include each other from left to right; a robot may only
/// pull its own calibration and acknowledge it.
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
pub enum Role {
    /// One robot: pulls and acknowledges its own calibration.
    Robot,
    /// Reads.
    Viewer,
    /// Registers robots, attaches notes, proposes.
    Operator,
    /// Approves what somebody else has proposed, rolls back, freezes deployments.
    Approver,
    /// Users, tokens and settings too.
    Admin,
}

impl Role {
    /// All of them.
    pub const ALL: &'static [Self] = <Self as VariantArray>::VARIANTS;

    /// The name in documents, in the database and on the command line.
    pub fn as_str(self) -> &'static str {
        self.into()
    }

    /// The role of this name.
    pub fn parse(name: &str) -> Option<Self> {
        name.parse().ok()
    }
}
