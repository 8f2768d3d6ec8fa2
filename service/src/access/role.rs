//! What a person, tool or robot may do, in steps.

use serde::{Deserialize, Serialize};

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
    utoipa::ToSchema,
)]
#[serde(rename_all = "snake_case")]
pub enum Role {
    /// One robot: pulls and acknowledges its own calibration.
    Robot,
    /// Reads.
    Viewer,
    /// Registers robots, attaches notes, proposes.
    Operator,
    /// Approves what somebody else has proposed, rolls back, stops the site.
    Approver,
    /// Users, tokens and settings too.
    Admin,
}

impl Role {
    /// All of them.
    pub const ALL: [Self; 5] = [
        Self::Robot,
        Self::Viewer,
        Self::Operator,
        Self::Approver,
        Self::Admin,
    ];

    /// The name in documents, in the database and on the command line.
    pub const fn as_str(self) -> &'static str {
        match self {
            Self::Robot => "robot",
            Self::Viewer => "viewer",
            Self::Operator => "operator",
            Self::Approver => "approver",
            Self::Admin => "admin",
        }
    }

    /// The role of this name.
    pub fn parse(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|role| role.as_str() == name)
    }
}
