//! Duty that one instance has for the whole cluster.

use strum::{EnumString, IntoStaticStr, VariantArray};

/// Something that one instance does for all robots. It has a row like a robot's.
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
    /// Holds every robot against the rules of alerts.
    Alerts,
    /// Sends messages to webhooks.
    Webhooks,
    /// Deletes what is too old.
    Retention,
    /// Looks for robots that nobody has registered.
    Discovery,
}

impl Duty {
    /// All of them.
    pub const ALL: &'static [Self] = <Self as VariantArray>::VARIANTS;

    /// The name in rows and documents.
    pub fn name(self) -> &'static str {
        self.into()
    }

    /// The duty of this name.
    pub fn parse(name: &str) -> Option<Self> {
        name.parse().ok()
    }
}
