//! Record of a roll-out, and its states.

use fleetcal_domain::access::{Access, Actor, Authentication, Grant, Role};
use fleetcal_domain::limits;
use fleetcal_model::{RobotId, RolloutId, Version, WallTime};
use serde::{Deserialize, Serialize};
use strum::{EnumString, IntoStaticStr, VariantArray};
use thiserror::Error;

use crate::member::{Counts, Followed, Lost};
use crate::plan::WavePlan;

/// State of a roll-out.
#[derive(
    Debug,
    Clone,
    Copy,
    PartialEq,
    Eq,
    Hash,
    Serialize,
    Deserialize,
    EnumString,
    IntoStaticStr,
    VariantArray,
)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
#[serde(rename_all = "snake_case")]
#[strum(serialize_all = "snake_case")]
pub enum RolloutState {
    /// Releases the robots of the waves that have begun.
    Running,
    /// Paused by a person: releases no robot.
    Paused,
    /// Halted, by a person or by itself: releases no robot.
    Halted,
    /// Finished: every robot has an outcome.
    Finished,
}

/// Event of a roll-out.
#[derive(Debug, Clone, PartialEq)]
pub enum Event {
    /// Pause by a person.
    Pause,
    /// Continuation by a person, who has read the counts of each wave.
    Resume(Vec<Counts>),
    /// Halt, by a person or by itself.
    Halt,
    /// Begin of the next wave.
    BeginWave,
    /// End.
    Finish,
}

impl Event {
    /// The name in refusals.
    const fn name(&self) -> &'static str {
        match self {
            Self::Pause => "paused",
            Self::Resume(_) => "resumed",
            Self::Halt => "halted",
            Self::BeginWave => "continued",
            Self::Finish => "finished",
        }
    }
}

impl RolloutState {
    /// Every state.
    pub const ALL: &'static [Self] = <Self as VariantArray>::VARIANTS;

    /// The name in documents and in the database.
    pub fn as_str(self) -> &'static str {
        self.into()
    }

    /// Parses the name of a state.
    pub fn parse(name: &str) -> Option<Self> {
        name.parse().ok()
    }

    /// State after an event.
    ///
    /// # Errors
    /// [`RolloutRefused::State`] if the event does not fit the state.
    pub const fn after(self, event: &Event) -> Result<Self, RolloutRefused> {
        match (self, event) {
            (Self::Running, Event::Pause) => Ok(Self::Paused),
            (Self::Paused | Self::Halted, Event::Resume(_)) | (Self::Running, Event::BeginWave) => {
                Ok(Self::Running)
            }
            (Self::Running | Self::Paused, Event::Halt) => Ok(Self::Halted),
            (Self::Running, Event::Finish) => Ok(Self::Finished),
            (state, event) => Err(RolloutRefused::State {
                state,
                event: event.name(),
            }),
        }
    }
}

/// Reason for which a roll-out was not changed, or released no robot.
#[derive(Debug, Clone, PartialEq, Eq, Error)]
pub enum RolloutRefused {
    /// Unknown number.
    #[error("no roll-out {0} is known")]
    Unknown(RolloutId),
    /// Event that does not fit the state.
    #[error("the roll-out is {}, and cannot be {event}", name(*state))]
    State {
        /// State of the roll-out.
        state: RolloutState,
        /// Event that was refused, a participle.
        event: &'static str,
    },
    /// Roll-out that changed since it was read.
    #[error("the roll-out is at version {found} now: it has changed since you opened it")]
    Stale {
        /// Present version.
        found: Version,
    },
    /// Robots lost since a person read the halted roll-out.
    #[error(
        "wave {wave} has {} failed robots and {} left out now: more than you accept",
        now.failed,
        now.left_out
    )]
    MoreLost {
        /// Number of the wave, from 1.
        wave: usize,
        /// Robots of the wave that are lost now.
        now: Lost,
    },
    /// Robot whose proposal another roll-out releases.
    #[error("roll-out {other}, which goes on, has the proposal of robot {robot}")]
    Taken {
        /// The other roll-out, running or paused.
        other: RolloutId,
        /// The robot.
        robot: RobotId,
    },
    /// Roll-out beyond the number of those that go on at once.
    #[error(
        "{} roll-outs are running or paused, and no more can be",
        limits::ROLLOUTS_RUNNING_MAX
    )]
    TooMany,
    /// Decision without a reason.
    #[error("reason: got nothing, expected why, in words")]
    ReasonMissing,
    /// Release of a robot whose wave has not begun, or while the roll-out does not run.
    #[error("the roll-out does not release this robot now")]
    NotReleased,
    /// Release for a person or token that may not approve any more.
    #[error("{0}, who started the roll-out, may not approve any more")]
    MayNotApprove(String),
}

fn name(state: RolloutState) -> &'static str {
    state.as_str()
}

/// Person or token that started a roll-out, and whose approval its waves release.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct Approver {
    /// Name of the user or token.
    pub name: String,
    /// Proof of identity: a session or a token.
    pub authentication: Authentication,
    /// Role at the start, for the audit of the released approvals.
    pub role: Option<Role>,
}

/// Wave of a roll-out.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Wave {
    /// Its plan.
    pub plan: WavePlan,
    /// Number of its robots.
    pub robots: u32,
    /// Time of its begin, ns since 1970, wall time; `None` before it.
    pub begun_ns: Option<WallTime>,
    /// Counts that a person accepted when the halted roll-out was resumed; zero before that.
    #[serde(default)]
    pub accepted: Counts,
}

impl Wave {
    /// Number of robots that must be verified before the next wave begins, as a share of those that
    /// no person accepted as lost.
    pub fn needed(&self) -> u32 {
        let lost = self.accepted.lost().robots();
        self.plan.needed(self.robots.saturating_sub(lost))
    }

    /// Number of robots that may fail, at least those that a person accepted.
    pub fn allowed(&self) -> u32 {
        self.plan.allowed(self.robots).max(self.accepted.failed)
    }
}

/// Latest change of a roll-out.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct Changed {
    /// Person or token, or the service.
    pub by: String,
    /// Time of the change, ns since 1970, wall time.
    pub at_ns: WallTime,
    /// Reason for the change.
    pub reason: Option<String>,
}

/// Staged deployment of the proposals that were pending when it was started.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Rollout {
    /// Number of the roll-out.
    pub id: RolloutId,
    /// Version, incremented with every change.
    pub version: Version,
    /// State of the roll-out.
    pub state: RolloutState,
    /// Query that selected the robots.
    pub q: String,
    /// Waves, in their order; at least one.
    pub waves: Vec<Wave>,
    /// Person or token that started it.
    pub approver: Approver,
    /// Reason for the approvals.
    pub reason: Option<String>,
    /// Time of its start, ns since 1970, wall time.
    pub created_ns: WallTime,
    /// Latest change.
    pub changed: Changed,
}

impl Rollout {
    /// Starts a roll-out of these waves, given with their numbers of robots; the first one begins.
    pub fn start(
        id: RolloutId,
        q: String,
        waves: Vec<(WavePlan, u32)>,
        by: &Actor,
        reason: Option<String>,
        now: WallTime,
    ) -> Self {
        let wave = |(index, (plan, robots)): (usize, (WavePlan, u32))| Wave {
            plan,
            robots,
            begun_ns: (index == 0).then_some(now),
            accepted: Counts::default(),
        };
        Self {
            id,
            version: Version(1),
            state: RolloutState::Running,
            q,
            waves: waves.into_iter().enumerate().map(wave).collect(),
            approver: Approver {
                name: by.name.clone(),
                authentication: by.authentication,
                role: by.role,
            },
            reason: reason.clone(),
            created_ns: now,
            changed: Changed {
                by: by.name.clone(),
                at_ns: now,
                reason,
            },
        }
    }

    /// Roll-out after an event.
    ///
    /// # Errors
    /// [`RolloutRefused::State`] if the event does not fit its state.
    pub fn after(&self, event: &Event, changed: Changed) -> Result<Self, RolloutRefused> {
        let mut after = self.clone();
        after.state = self.state.after(event)?;
        after.version = self.version.next();
        match event {
            Event::BeginWave => {
                let next = after.waves.iter_mut().find(|wave| wave.begun_ns.is_none());
                if let Some(wave) = next {
                    wave.begun_ns = Some(changed.at_ns);
                }
            }
            // Who resumes after a pause has accepted nothing: too many failures halt it again.
            Event::Resume(counts) if self.state == RolloutState::Halted => {
                for (wave, counts) in after.waves.iter_mut().zip(counts) {
                    wave.accepted = *counts;
                }
            }
            Event::Resume(_) | Event::Pause | Event::Halt | Event::Finish => {}
        }
        after.changed = changed;
        Ok(after)
    }

    /// Compares the robots that are lost now with those that a person has read. Only who resumes a
    /// halted roll-out accepts them. Waves beyond `read` are read as without losses.
    ///
    /// # Errors
    /// [`RolloutRefused::MoreLost`] about the first wave with more of them.
    pub fn check_read(&self, counts: &[Counts], read: &[Lost]) -> Result<(), RolloutRefused> {
        if self.state != RolloutState::Halted {
            return Ok(());
        }
        let read = read
            .iter()
            .copied()
            .chain(std::iter::repeat(Lost::default()));
        for ((counts, read), wave) in counts.iter().zip(read).zip(1..) {
            let now = counts.lost();
            if !read.covers(now) {
                return Err(RolloutRefused::MoreLost { wave, now });
            }
        }
        Ok(())
    }

    /// True if a wave, numbered from 1, has begun.
    pub fn has_begun(&self, wave: u32) -> bool {
        let index = (wave as usize).checked_sub(1);
        let wave = index.and_then(|index| self.waves.get(index));
        wave.is_some_and(|wave| wave.begun_ns.is_some())
    }

    /// Allows the approval of a robot of a wave to be released now. `account` is the present grant
    /// and time of creation of the approver's account, if it counts.
    ///
    /// # Errors
    /// [`RolloutRefused::NotReleased`] or [`RolloutRefused::MayNotApprove`].
    pub fn may_release(
        &self,
        wave: u32,
        account: Option<(&Grant, WallTime)>,
    ) -> Result<(), RolloutRefused> {
        if self.state != RolloutState::Running || !self.has_begun(wave) {
            return Err(RolloutRefused::NotReleased);
        }
        // A later account of the same name is somebody else.
        let may = |(grant, created_ns): (&Grant, WallTime)| {
            created_ns <= self.created_ns && Access::Approver.permits(grant, None)
        };
        if !account.is_some_and(may) {
            return Err(RolloutRefused::MayNotApprove(self.approver.name.clone()));
        }
        Ok(())
    }

    /// Numbers of the robots of each wave by stage.
    pub fn counts(&self, robots: &[Followed]) -> Vec<Counts> {
        let mut counts = vec![Counts::default(); self.waves.len()];
        for robot in robots {
            let wave = robot.member.wave;
            if let Some(counts) = counts.get_mut(wave.saturating_sub(1) as usize) {
                counts.add(robot.stage(self.has_begun(wave)));
            }
        }
        counts
    }

    /// Reason of the approvals that a wave releases.
    pub fn reason_of(&self, wave: u32) -> String {
        let (id, waves) = (self.id, self.waves.len());
        let reason = self.reason.as_deref();
        let reason = reason.map_or_else(String::new, |reason| format!(": {reason}"));
        format!("roll-out {id}, wave {wave} of {waves}{reason}")
    }
}
