//! Condition of an alert, and its duration.

use fleetcal_model::WallTime;
use serde::{Deserialize, Serialize};
use strum::{EnumString, IntoStaticStr, VariantArray};

/// Condition of an alert, with the time at which it began, ns since 1970, wall time.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(tag = "state", rename_all = "snake_case", deny_unknown_fields)]
pub enum Condition {
    /// Problem absent or resolved.
    Normal {
        /// Begin of the condition.
        since_ns: WallTime,
    },
    /// Problem present for less than the alert's delay.
    Pending {
        /// Begin of the condition.
        since_ns: WallTime,
    },
    /// Problem present.
    Alerting {
        /// Begin of the condition.
        since_ns: WallTime,
    },
    /// Problem absent for less than the recovery delay.
    Recovering {
        /// Begin of the condition.
        since_ns: WallTime,
    },
    /// Problem present when last observed, and not observable now.
    NoData {
        /// Begin of the condition.
        since_ns: WallTime,
    },
}

/// Name of a [`Condition`].
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
    /// Problem absent or resolved.
    Normal,
    /// Problem present for less than the alert's delay.
    Pending,
    /// Problem present.
    Alerting,
    /// Problem absent for less than the recovery delay.
    Recovering,
    /// Problem present when last observed, and not observable now.
    NoData,
}

impl ConditionName {
    /// Every condition.
    pub const ALL: &'static [Self] = <Self as VariantArray>::VARIANTS;

    /// The name in documents and in the database.
    pub fn as_str(self) -> &'static str {
        self.into()
    }

    /// Parses the name of a condition.
    pub fn parse(name: &str) -> Option<Self> {
        name.parse().ok()
    }
}

/// Observation of a rule.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Observation {
    /// Problem present.
    Firing,
    /// Problem absent.
    Clear,
    /// Observed quantity unavailable.
    Unknown,
}

impl Observation {
    /// Every observation.
    pub const ALL: [Self; 3] = [Self::Firing, Self::Clear, Self::Unknown];
}

/// Delays before an observation changes the condition.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Periods {
    /// Delay from the first observation of the problem to the alert.
    pub pending_ns: i64,
    /// Delay from the first observation without the problem to the alert's end.
    pub recovering_ns: i64,
}

impl Periods {
    /// Delays of a fact, which holds and ends at once.
    pub const NONE: Self = Self {
        pending_ns: 0,
        recovering_ns: 0,
    };
}

impl Condition {
    /// Name of the condition.
    pub const fn name(self) -> ConditionName {
        match self {
            Self::Normal { .. } => ConditionName::Normal,
            Self::Pending { .. } => ConditionName::Pending,
            Self::Alerting { .. } => ConditionName::Alerting,
            Self::Recovering { .. } => ConditionName::Recovering,
            Self::NoData { .. } => ConditionName::NoData,
        }
    }

    /// Begin of the condition.
    pub const fn since(self) -> WallTime {
        match self {
            Self::Normal { since_ns }
            | Self::Pending { since_ns }
            | Self::Alerting { since_ns }
            | Self::Recovering { since_ns }
            | Self::NoData { since_ns } => since_ns,
        }
    }

    /// Condition after an observation at `now`.
    ///
    /// A wall clock that was set back lengthens a period and never makes it negative.
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
