//! What an instance does about the rows it has read.

use std::collections::BTreeMap;
use std::time::Duration;

use fleetcal_domain::limits::{
    CLUSTER_CLAIM_OTHERS_AFTER, CLUSTER_MOVES_AT_ONCE_MAX, CLUSTER_OVERLAP,
};
use fleetcal_model::WallTime;
use fleetcal_proto::RobotId;

use crate::assignment::{Assignment, Candidate, assign, score};
use crate::duty::Duty;
use crate::member::{Member, Seat};
use crate::tenure::{ClaimId, Epoch};

/// Who has a robot, as its row says.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Ownership {
    /// Who estimates it; `None` while nobody does.
    pub owner: Option<Seat>,
    /// The epoch of the latest tenure.
    pub epoch: Epoch,
    /// What tells that tenure from every other.
    pub claim: ClaimId,
    /// Who is to have it next, by the owner's word.
    pub heir: Option<Seat>,
    /// Since when the heir hears the robot, by the database's clock; `None` while it does not.
    pub heir_ready: Option<WallTime>,
    /// Since when nobody has it, by the database's clock; `None` while somebody does.
    pub free_since: Option<WallTime>,
    /// Format of the state that its estimator goes on from; 0 where there is none.
    pub checkpoint_format: i64,
}

/// Who has a duty, as its row says.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct DutyOwnership {
    /// Who does it; `None` while nobody does.
    pub owner: Option<Seat>,
    /// Since when nobody does, by the database's clock.
    pub free_since: Option<WallTime>,
}

/// What the rows say at one moment.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Snapshot {
    /// That moment, by the database's clock.
    pub now: WallTime,
    /// Every instance, by its name.
    pub members: Vec<Member>,
    /// Every registered robot.
    pub robots: BTreeMap<RobotId, Ownership>,
    /// Every duty.
    pub duties: BTreeMap<Duty, DutyOwnership>,
}

/// A robot on its way to another instance.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Handover {
    /// Which robot.
    pub robot: RobotId,
    /// Who gets it.
    pub to: Seat,
}

/// What an instance should do now.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct Plan {
    /// Robots that nobody has, to be claimed.
    pub claim: Vec<RobotId>,
    /// Robots of another instance that this one is to have next: hear them, and say so.
    pub prepare: Vec<RobotId>,
    /// Own robots that another one is to have next: name it.
    pub offer: Vec<Handover>,
    /// Own robots that stay after all: name nobody.
    pub withdraw: Vec<RobotId>,
    /// Own robots whose heir has heard them for long enough: store their state, and hand them over.
    pub hand_over: Vec<Handover>,
    /// Own robots that cannot be heard here, and can elsewhere: free them.
    pub give_up: Vec<RobotId>,
    /// Duties that nobody has, to be claimed.
    pub claim_duties: Vec<Duty>,
    /// Own duties that another one should do.
    pub give_up_duties: Vec<Duty>,
}

impl Snapshot {
    /// The instance of this seat, while the rows know it.
    pub fn member(&self, seat: &Seat) -> Option<&Member> {
        self.members.iter().find(|member| member.seat == *seat)
    }

    /// Instances that can take robots: those that robots reach, unless they reach none.
    fn candidates(&self) -> Vec<&Member> {
        let able = |member: &&Member| member.is_live() && !member.draining;
        let anybody_linked = self.members.iter().filter(able).any(|member| member.linked);
        let heard = |member: &&Member| able(member) && (member.linked || !anybody_linked);
        self.members.iter().filter(heard).collect()
    }

    /// How long something has been so.
    fn since(&self, then: Option<WallTime>) -> Option<Duration> {
        let ns = self.now.ns_since(then?);
        Some(Duration::from_nanos(u64::try_from(ns).unwrap_or(0)))
    }
}

/// What the instance `me` should do about what it has read. An instance that the rows do not know
/// does nothing.
pub fn plan(me: &Seat, snapshot: &Snapshot) -> Plan {
    let mut plan = Plan::default();
    let Some(own) = snapshot.member(me).filter(|member| member.is_live()) else {
        return plan;
    };
    let candidates = snapshot.candidates();
    let view = View {
        me,
        snapshot,
        is_candidate: candidates.iter().any(|member| member.seat == *me),
        can_read: own.checkpoint_format,
        assignment: assignment(snapshot, &candidates),
    };
    let mut moves = view.moves_left();
    for (robot, row) in &snapshot.robots {
        if row.owner.as_ref() == Some(me) {
            view.of_own(robot, row, &mut moves, &mut plan);
        } else {
            view.of_others(robot, row, &mut plan);
        }
    }
    for (duty, row) in &snapshot.duties {
        view.of_duty(*duty, row, &candidates, &mut plan);
    }
    plan
}

/// Who should have which robot by these rows.
fn assignment(snapshot: &Snapshot, candidates: &[&Member]) -> Assignment {
    let of_candidates: Vec<_> = candidates
        .iter()
        .map(|member| Candidate {
            seat: &member.seat,
            capacity: member.capacity,
        })
        .collect();
    let formats: BTreeMap<&Seat, i64> = candidates
        .iter()
        .map(|member| (&member.seat, member.checkpoint_format))
        .collect();
    let owners = snapshot.robots.iter();
    let owners = owners.map(|(robot, row)| (robot.clone(), row.owner.as_ref()));
    assign(&of_candidates, &owners.collect(), |seat, robot| {
        let stored = snapshot.robots.get(robot).map(|row| row.checkpoint_format);
        formats.get(seat).copied() >= stored
    })
}

/// What one instance sees.
struct View<'a> {
    me: &'a Seat,
    snapshot: &'a Snapshot,
    /// Whether it can take robots.
    is_candidate: bool,
    /// The newest format of a checkpoint that it can read.
    can_read: i64,
    assignment: Assignment,
}

impl View<'_> {
    /// How many more robots may be on their way from here at once.
    fn moves_left(&self) -> usize {
        let rows = self.snapshot.robots.values();
        let under_way =
            rows.filter(|row| row.owner.as_ref() == Some(self.me) && row.heir.is_some());
        CLUSTER_MOVES_AT_ONCE_MAX.saturating_sub(under_way.count())
    }

    fn of_own(&self, robot: &RobotId, row: &Ownership, moves: &mut usize, plan: &mut Plan) {
        let target = self.assignment.get(robot).filter(|seat| *seat != self.me);
        let is_cut_off = !self.is_candidate
            && self
                .snapshot
                .member(self.me)
                .is_some_and(|own| !own.linked && !own.draining);
        match (target, &row.heir) {
            (Some(_), _) if is_cut_off => plan.give_up.push(robot.clone()),
            (Some(target), Some(heir)) if target == heir => {
                let heard_for = self.snapshot.since(row.heir_ready);
                if heard_for.is_some_and(|heard_for| heard_for >= CLUSTER_OVERLAP) {
                    plan.hand_over.push(handover(robot, target));
                }
            }
            (Some(target), heir) if heir.is_some() || *moves > 0 => {
                if heir.is_none() {
                    *moves -= 1;
                }
                plan.offer.push(handover(robot, target));
            }
            (None, Some(_)) => plan.withdraw.push(robot.clone()),
            (Some(_) | None, _) => {}
        }
    }

    fn of_others(&self, robot: &RobotId, row: &Ownership, plan: &mut Plan) {
        if row.owner.is_some() {
            if row.heir.as_ref() == Some(self.me) && row.heir_ready.is_none() {
                plan.prepare.push(robot.clone());
            }
            return;
        }
        let is_own = self.assignment.get(robot) == Some(self.me);
        if is_own || (self.may_take(row.free_since) && row.checkpoint_format <= self.can_read) {
            plan.claim.push(robot.clone());
        }
    }

    /// Whether whoever should take something has had its time.
    fn may_take(&self, free_since: Option<WallTime>) -> bool {
        let free_for = self.snapshot.since(free_since);
        self.is_candidate && free_for.is_some_and(|free_for| free_for >= CLUSTER_CLAIM_OTHERS_AFTER)
    }

    fn of_duty(&self, duty: Duty, row: &DutyOwnership, candidates: &[&Member], plan: &mut Plan) {
        match &row.owner {
            Some(owner) if owner == self.me && !self.is_candidate => {
                if !candidates.is_empty() {
                    plan.give_up_duties.push(duty);
                }
            }
            Some(_) => {}
            None => {
                let suits = |member: &&&Member| score(&member.seat.instance, duty.name());
                let best = candidates.iter().max_by_key(suits);
                let is_own = best.is_some_and(|member| member.seat == *self.me);
                if is_own || self.may_take(row.free_since) {
                    plan.claim_duties.push(duty);
                }
            }
        }
    }
}

fn handover(robot: &RobotId, to: &Seat) -> Handover {
    Handover {
        robot: robot.clone(),
        to: to.clone(),
    }
}
