//! Duty that one instance has for the whole cluster.

use strum::{EnumString, IntoStaticStr, VariantArray};

/// Duty that one instance performs for all robots. It has a row like a robot's.
#[derive(
    Debug,
    Clone,
    Copy,
    PartialEq,
    Eq,
    PartialOrd,
    Ord,
    Hash,
    EnumString,
    IntoStaticStr,
    VariantArray,
)]
#[strum(serialize_all = "snake_case")]
pub enum Duty {
    /// Evaluates the alert rules for every robot.
    Alerts,
    /// Sends messages to webhooks.
    Webhooks,
    /// Deletes old records.
    Retention,
    /// Discovers robots that are not registered.
    Discovery,
}

impl Duty {
    /// Every duty.
    pub const ALL: &'static [Self] = <Self as VariantArray>::VARIANTS;

    /// The name in rows and documents.
    pub fn name(self) -> &'static str {
        self.into()
    }

    /// Parses the name of a duty.
    pub fn parse(name: &str) -> Option<Self> {
        name.parse().ok()
    }
}
