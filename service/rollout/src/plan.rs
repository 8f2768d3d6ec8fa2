//! Plan of a roll-out: which robots a wave takes, and its thresholds.

use fleetcal_domain::limits;
use fleetcal_model::RobotId;
use serde::{Deserialize, Serialize};
use thiserror::Error;

/// Tolerance of a share times a count: such a product is a whole number but for its last bits.
const ROUNDING: f64 = 1e-9;

/// Robots that a wave takes, of those that no earlier wave has.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema), schema(as = WaveTake))]
#[serde(rename_all = "snake_case")]
pub enum Take {
    /// Number of robots, the first ones by id.
    Robots(u32),
    /// Share of all robots of the roll-out, rounded up, the first ones by id; 0.2 is 20 %.
    Share(f64),
    /// Robots that this query selects.
    Q(String),
    /// All that are left.
    Rest,
}

/// Plan of one wave.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
#[serde(deny_unknown_fields)]
pub struct WavePlan {
    /// Robots that the wave takes.
    pub take: Take,
    /// Share of the wave's robots that must be verified before the next wave begins, more than 0
    /// and at most 1.
    #[serde(default = "all")]
    pub verified_share: f64,
    /// Share of the wave's robots that may fail, at least 0 and less than 1: beyond it the roll-out
    /// halts.
    #[serde(default)]
    pub failed_share: f64,
}

const fn all() -> f64 {
    1.0
}

/// Reason for which a plan was refused.
#[derive(Debug, Clone, PartialEq, Error)]
pub enum PlanRefused {
    /// Too few or too many waves.
    #[error("waves: got {count}, expected 1 to {}", limits::ROLLOUT_WAVES_MAX)]
    Count {
        /// Number of waves.
        count: usize,
    },
    /// Number beyond its limits.
    #[error("waves: wave {wave} has {field} {value}, expected {accepted}")]
    Number {
        /// Number of the wave, from 1.
        wave: usize,
        /// Field of the number.
        field: &'static str,
        /// Refused number.
        value: f64,
        /// Accepted numbers, in words.
        accepted: &'static str,
    },
    /// Robots that no wave takes.
    #[error("waves: {count} robots are in no wave, expected a last wave that takes the rest")]
    LeftOver {
        /// Number of the robots.
        count: usize,
    },
    /// No robot at all.
    #[error("q: selects no robot with a proposal that can be rolled out")]
    Nobody,
}

impl WavePlan {
    /// Number of `robots` that must be verified before the next wave begins.
    pub fn needed(&self, robots: u32) -> u32 {
        (self.verified_share * f64::from(robots) - ROUNDING).ceil() as u32
    }

    /// Number of `robots` that may fail.
    pub fn allowed(&self, robots: u32) -> u32 {
        (self.failed_share * f64::from(robots) + ROUNDING).floor() as u32
    }

    fn check(&self, wave: usize) -> Result<(), PlanRefused> {
        let share = |field, value: f64, is_accepted, accepted| {
            if is_accepted {
                return Ok(());
            }
            Err(PlanRefused::Number {
                wave,
                field,
                value,
                accepted,
            })
        };
        let is_share = |value: f64| value > 0.0 && value <= 1.0;
        let verified = self.verified_share;
        let accepted = "more than 0 and at most 1";
        share("verified_share", verified, is_share(verified), accepted)?;
        let failed = self.failed_share;
        let accepted_failed = "at least 0 and less than 1";
        let is_accepted = (0.0..1.0).contains(&failed);
        share("failed_share", failed, is_accepted, accepted_failed)?;
        match self.take {
            Take::Robots(0) => share("take.robots", 0.0, false, "at least 1"),
            Take::Share(value) => share("take.share", value, is_share(value), accepted),
            Take::Robots(_) | Take::Q(_) | Take::Rest => Ok(()),
        }
    }
}

/// Splits `robots` into the waves of a plan, each in their order; waves that no robot is left for
/// are dropped. `selects` is true if a query selects a robot.
///
/// # Errors
/// [`PlanRefused`]: the first fault of the plan, or robots that no wave takes.
pub fn split(
    plan: &[WavePlan],
    robots: Vec<RobotId>,
    selects: impl Fn(&str, &RobotId) -> bool,
) -> Result<Vec<(WavePlan, Vec<RobotId>)>, PlanRefused> {
    let count = plan.len();
    if count == 0 || count > limits::ROLLOUT_WAVES_MAX {
        return Err(PlanRefused::Count { count });
    }
    for (index, wave) in plan.iter().enumerate() {
        wave.check(index + 1)?;
    }
    if robots.is_empty() {
        return Err(PlanRefused::Nobody);
    }
    let total = robots.len() as f64;
    let mut left = robots;
    let mut waves = Vec::new();
    for wave in plan {
        let first = |count: usize| left.split_at(count.min(left.len()));
        let (taken, rest) = match &wave.take {
            Take::Robots(count) => owned(first(*count as usize)),
            Take::Share(share) => owned(first((share * total - ROUNDING).ceil() as usize)),
            Take::Q(q) => left.into_iter().partition(|robot| selects(q, robot)),
            Take::Rest => (left, Vec::new()),
        };
        left = rest;
        if !taken.is_empty() {
            waves.push((wave.clone(), taken));
        }
    }
    match left.len() {
        0 => Ok(waves),
        count => Err(PlanRefused::LeftOver { count }),
    }
}

fn owned((first, rest): (&[RobotId], &[RobotId])) -> (Vec<RobotId>, Vec<RobotId>) {
    (first.to_vec(), rest.to_vec())
}
