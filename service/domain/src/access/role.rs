//! Roles of a person, tool or robot, each including the ones below it.

use serde::{Deserialize, Serialize};
use strum::{EnumString, IntoStaticStr, VariantArray};

/// Role of a caller. Viewer, operator, approver and admin each include the one before; a robot may
/// only pull its own calibration and acknowledge it.
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
    /// One robot: fetches and acknowledges its own calibration.
    Robot,
    /// Reads.
    Viewer,
    /// Registers robots, attaches notes, proposes.
    Operator,
    /// Approves what somebody else has proposed, rolls back, freezes deployments.
    Approver,
    /// Manages users, tokens and settings too.
    Admin,
}

impl Role {
    /// Every role.
    pub const ALL: &'static [Self] = <Self as VariantArray>::VARIANTS;

    /// The name in documents, in the database and on the command line.
    pub fn as_str(self) -> &'static str {
        self.into()
    }

    /// Parses the name of a role.
    pub fn parse(name: &str) -> Option<Self> {
        name.parse().ok()
    }
}
