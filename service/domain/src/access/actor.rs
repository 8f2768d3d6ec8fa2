//! Actor of an action, for the audit.

use strum::{IntoStaticStr, VariantArray};

use super::Role;

/// How an actor proved who it is.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, IntoStaticStr, VariantArray)]
#[strum(serialize_all = "snake_case")]
pub enum Authentication {
    /// A person who signed in.
    Session,
    /// An API token.
    Token,
    /// The link that the service printed at its first start.
    SetupLink,
    /// A message over Zenoh under the robot's own key.
    Zenoh,
    /// The service itself.
    Service,
    /// Somebody with the data folder at hand.
    CommandLine,
}

impl Authentication {
    /// All of them.
    pub const ALL: &'static [Self] = <Self as VariantArray>::VARIANTS;

    /// The name in the audit.
    pub fn as_str(self) -> &'static str {
        self.into()
    }
}

/// Who does something.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Actor {
    /// A person's or token's name, a robot's id, or `fleetcal`.
    pub name: String,
    /// How that is known.
    pub authentication: Authentication,
    /// What the actor may do; `None` for the service itself.
    pub role: Option<Role>,
    /// The HTTP request; `None` of whoever sends none.
    pub request: Option<HttpRequest>,
}

/// The HTTP request with which somebody does something.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct HttpRequest {
    /// Its id.
    pub id: Option<String>,
    /// The client's address.
    pub address: Option<String>,
}

/// Header of a request that an instance of a cluster passes on for its caller: that instance's name.
pub const FORWARDED_BY: &str = "x-fleetcal-forwarded-by";

impl Actor {
    /// What a user or token is counted under: a user's sessions are one caller.
    pub fn key(&self) -> String {
        format!("{}\n{}", self.authentication.as_str(), self.name)
    }

    /// The service itself.
    pub fn service() -> Self {
        Self {
            name: "fleetcal".to_owned(),
            authentication: Authentication::Service,
            role: None,
            request: None,
        }
    }

    /// Somebody who runs a command beside the service, and may do what the data folder allows.
    pub fn command_line() -> Self {
        Self {
            name: "command line".to_owned(),
            authentication: Authentication::CommandLine,
            role: Some(Role::Admin),
            request: None,
        }
    }

    /// A robot that speaks under its own keys.
    pub fn robot(id: &fleetcal_proto::RobotId) -> Self {
        Self {
            name: id.as_str().to_owned(),
            authentication: Authentication::Zenoh,
            role: Some(Role::Robot),
            request: None,
        }
    }
}
