//! Actor of an action, for the audit.

use serde::{Deserialize, Serialize};
use strum::{IntoStaticStr, VariantArray};

use super::Role;

/// Proof of an actor's identity.
#[derive(
    Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize, IntoStaticStr, VariantArray,
)]
#[serde(rename_all = "snake_case")]
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
    /// A person with access to the data folder.
    CommandLine,
}

impl Authentication {
    /// Every kind of authentication.
    pub const ALL: &'static [Self] = <Self as VariantArray>::VARIANTS;

    /// The name in the audit.
    pub fn as_str(self) -> &'static str {
        self.into()
    }
}

/// Originator of an action: a person, token, robot or the service.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Actor {
    /// A person's or token's name, a robot's id, or `fleetcal`.
    pub name: String,
    /// Proof of identity.
    pub authentication: Authentication,
    /// Role of the actor; `None` for the service itself.
    pub role: Option<Role>,
    /// HTTP request; `None` of an actor that sends none.
    pub request: Option<HttpRequest>,
}

/// HTTP request that caused an action.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct HttpRequest {
    /// Id of the request.
    pub id: Option<String>,
    /// The client's address.
    pub address: Option<String>,
}

/// Header of a request that an instance of a cluster passes on for its caller: that instance's name.
pub const FORWARDED_BY: &str = "x-fleetcal-forwarded-by";

impl Actor {
    /// Key of a user or token in counters; all sessions of a user share one.
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

    /// A person who runs a command beside the service, with the rights that the data folder gives.
    pub fn command_line() -> Self {
        Self {
            name: "command line".to_owned(),
            authentication: Authentication::CommandLine,
            role: Some(Role::Admin),
            request: None,
        }
    }

    /// A robot that sends under its own keys.
    pub fn robot(id: &fleetcal_proto::RobotId) -> Self {
        Self {
            name: id.as_str().to_owned(),
            authentication: Authentication::Zenoh,
            role: Some(Role::Robot),
            request: None,
        }
    }
}
