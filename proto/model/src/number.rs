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
            /// The one after it.
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
    /// The number of a deployment to a robot; it only grows. 0 is the factory calibration.
    Generation(u64);
    /// How often a record was changed; a change names the version that it was decided on.
    Version(u64);
    /// Names a set of values with its evidence.
    RevisionId(u64);
    /// Names a proposal.
    ProposalId(u64);
    /// Names a deployment.
    DeploymentId(u64);
    /// Names an alert.
    AlertId(u64);
    /// Names a webhook.
    WebhookId(u64);
    /// Names a message on its way to a webhook.
    DeliveryId(u64);
    /// Names a user.
    UserId(i64);
    /// Names a token.
    TokenId(i64);
    /// Names an event in a robot's history.
    EventId(i64);
    /// Names an entry of the audit.
    AuditId(i64);
}

impl Generation {
    /// What a robot uses before anything was deployed to it.
    pub const FACTORY: Self = Self(0);

    /// Whether it is the factory calibration.
    pub fn is_factory(self) -> bool {
        self == Self::FACTORY
    }
}
