//! Numbers that name something: each has a type, so that none is taken for another.

use std::fmt;
use std::num::ParseIntError;
use std::str::FromStr;

use serde::{Deserialize, Serialize};

macro_rules! numbers {
    ($($(#[$doc:meta])+ $name:ident($of:ty);)+) => {$(
        $(#[$doc])+
        #[derive(
            Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Default, Serialize, Deserialize,
        )]
        #[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
        #[serde(transparent)]
        pub struct $name(pub $of);

        impl $name {
            /// Returns the next number.
            #[must_use]
            pub const fn next(self) -> Self {
                Self(self.0.saturating_add(1))
            }
        }

        impl FromStr for $name {
            type Err = ParseIntError;

            fn from_str(text: &str) -> Result<Self, ParseIntError> {
                text.parse().map(Self)
            }
        }

        impl fmt::Display for $name {
            fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
                self.0.fmt(formatter)
            }
        }
    )+};
}

numbers! {
    /// Number of a deployment to a robot; it only grows. 0 is the factory calibration.
    Generation(u64);
    /// Number of changes of a record; a change names the version that it was decided on.
    Version(u64);
    /// Number of a set of values with its evidence.
    RevisionId(u64);
    /// Number of a proposal.
    ProposalId(u64);
    /// Number of a deployment.
    DeploymentId(u64);
    /// Number of a roll-out.
    RolloutId(u64);
    /// Number of an alert.
    AlertId(u64);
    /// Number of a webhook.
    WebhookId(u64);
    /// Number of a message to a webhook.
    DeliveryId(u64);
    /// Number of a user.
    UserId(i64);
    /// Number of a token.
    TokenId(i64);
    /// Number of an event in a robot's history.
    EventId(i64);
    /// Number of an entry of the audit.
    AuditId(i64);
}

impl Generation {
    /// Calibration that a robot uses before any deployment.
    pub const FACTORY: Self = Self(0);

    /// True if it is the factory calibration.
    pub fn is_factory(self) -> bool {
        self == Self::FACTORY
    }
}
