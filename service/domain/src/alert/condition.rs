//! Condition of an alert, and its duration.

use fleetcal_model::WallTime;
use serde::{Deserialize, Serialize};
use strum::{EnumString, IntoStaticStr, VariantArray};

/// Where an alert stands. The times are when that began, ns since 1970, wall time.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(tag = "state", rename_all = "snake_case", deny_unknown_fields)]
pub enum Condition {
    /// Nothing is wrong, or no more.
    Normal {
        /// Since when.
        since_ns: WallTime,
    },
    /// Something is wrong, but not yet for long enough to call anybody.
    Pending {
        /// Since when.
        since_ns: WallTime,
    },
    /// Something is wrong.
    Alerting {
        /// Since when.
        since_ns: WallTime,
    },
    /// It is no longer wrong, but not yet for long enough to believe it.
    Recovering {
        /// Since when.
        since_ns: WallTime,
    },
    /// It was wrong when it was last seen; nothing tells whether it still is.
    NoData {
        /// Since when.
        since_ns: WallTime,
    },
}

/// The name of a [`Condition`].
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
#[cfg_attr(feature = "openapi", schema(as = AlertState))]
#[strum(serialize_all = "snake_case")]
pub enum ConditionName {
    /// Nothing is wrong any more.
    Normal,
    /// Wrong, but not yet for long enough.
    Pending,
    /// Wrong.
    Alerting,
    /// No longer wrong, but not yet for long enough.
    Recovering,
    /// Wrong when it was last seen; nothing tells whether it still is.
    NoData,
}

impl ConditionName {
    /// All of them.
    pub const ALL: &'static [Self] = <Self as VariantArray>::VARIANTS;

    /// The name in documents and in the database.
    pub fn as_str(self) -> &'static str {
        self.into()
    }

    /// The condition of this name.
    pub fn parse(name: &str) -> Option<Self> {
        name.parse().ok()
    }
}

/// What a rule sees.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Observation {
    /// Something is wrong.
    Firing,
    /// Nothing is wrong.
    Clear,
    /// What the rule looks at is not there.
    Unknown,
}

impl Observation {
    /// All of them.
    pub const ALL: [Self; 3] = [Self::Firing, Self::Clear, Self::Unknown];
}

/// How long something has to last before it counts.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Periods {
    /// Wrong for so long before it alerts.
    pub pending_ns: i64,
    /// No longer wrong for so long before it is over.
    pub recovering_ns: i64,
}

impl Periods {
    /// What is a fact at once, and over at once.
    pub const NONE: Self = Self {
        pending_ns: 0,
        recovering_ns: 0,
    };
}

impl Condition {
    /// The condition's name.
    pub const fn name(self) -> ConditionName {
        match self {
            Self::Normal { .. } => ConditionName::Normal,
            Self::Pending { .. } => ConditionName::Pending,
            Self::Alerting { .. } => ConditionName::Alerting,
            Self::Recovering { .. } => ConditionName::Recovering,
            Self::NoData { .. } => ConditionName::NoData,
        }
    }

    /// When it began.
    pub const fn since(self) -> WallTime {
        match self {
            Self::Normal { since_ns }
            | Self::Pending { since_ns }
            | Self::Alerting { since_ns }
            | Self::Recovering { since_ns }
            | Self::NoData { since_ns } => since_ns,
        }
    }

    /// The condition after a rule has looked at `now`.
    ///
    /// A wall clock that was set back makes a period longer, never negative.
    #[must_use]
    pub fn after(self, observation: Observation, now: WallTime, periods: Periods) -> Self {
        use Observation as O;
        let alerting = Self::Alerting { since_ns: now };
        let normal = Self::Normal { since_ns: now };
        match (self, observation) {
            (Self::Normal { .. }, O::Firing) if periods.pending_ns <= 0 => alerting,
            (Self::Normal { .. }, O::Firing) => Self::Pending { since_ns: now },
            (Self::Pending { since_ns }, O::Firing)
                if now.ns_since(since_ns) >= periods.pending_ns =>
            {
                alerting
            }
            // What was never alerted and is not seen any more was nothing.
            (Self::Pending { .. }, O::Clear | O::Unknown) => normal,
            (Self::Recovering { .. } | Self::NoData { .. }, O::Firing) => alerting,
            (Self::Alerting { .. } | Self::NoData { .. }, O::Clear)
                if periods.recovering_ns <= 0 =>
            {
                normal
            }
            (Self::Alerting { .. } | Self::NoData { .. }, O::Clear) => {
                Self::Recovering { since_ns: now }
            }
            (Self::Recovering { since_ns }, O::Clear)
                if now.ns_since(since_ns) >= periods.recovering_ns =>
            {
                normal
            }
            (Self::Alerting { .. } | Self::Recovering { .. }, O::Unknown) => {
                Self::NoData { since_ns: now }
            }
            (Self::Normal { .. }, O::Clear | O::Unknown)
            | (Self::Pending { .. } | Self::Alerting { .. }, O::Firing)
            | (Self::Recovering { .. }, O::Clear)
            | (Self::NoData { .. }, O::Unknown) => self,
        }
    }
}
