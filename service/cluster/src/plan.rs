//! Plan of an instance from the rows that it has read. Pure.

use std::collections::{BTreeMap, BTreeSet};
use std::time::Duration;

use fleetcal_domain::limits::{
    CLUSTER_CLAIM_OTHERS_AFTER, CLUSTER_MOVES_AT_ONCE_MAX, CLUSTER_OVERLAP,
};
use fleetcal_model::WallTime;
use fleetcal_proto::RobotId;

use crate::assignment::{Assignment, Candidate, assign, score};
use crate::duty::Duty;
use crate::hearing::Hearing;
use crate::member::Member;
use crate::tenure::{ClaimId, Epoch, Seat};

/// Ownership of a robot, from its row.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Ownership {
    /// Instance that estimates it; `None` while there is none.
    pub owner: Option<Seat>,
    /// Epoch of the latest tenure.
    pub epoch: Epoch,
    /// Claim that distinguishes that tenure from every other.
    pub claim: ClaimId,
    /// Next owner, named by the present one.
    pub heir: Option<Seat>,
    /// Time from which the heir receives the robot, by the database's clock; `None` while it does
    /// not.
    pub heir_ready: Option<WallTime>,
    /// Time from which it has no owner, by the database's clock; `None` while it has one.
    pub free_since: Option<WallTime>,
    /// Format of its checkpoint; 0 without one.
    pub checkpoint_format: i64,
}

/// Ownership of a duty, from its row.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct DutyOwnership {
    /// Instance that performs it; `None` while there is none.
    pub owner: Option<Seat>,
    /// Time from which it has no owner, by the database's clock.
    pub free_since: Option<WallTime>,
}

/// Snapshot of the rows.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Snapshot {
    /// Time of the snapshot, by the database's clock.
    pub now: WallTime,
    /// Every instance, by its name.
    pub members: Vec<Member>,
    /// Every registered robot.
    pub robots: BTreeMap<RobotId, Ownership>,
    /// Every duty.
    pub duties: BTreeMap<Duty, DutyOwnership>,
}

/// Hand-over of a robot to another instance.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Handover {
    /// The robot.
    pub robot: RobotId,
    /// Next owner.
    pub to: Seat,
}

/// Plan of an instance: its actions now.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct Plan {
    /// Robots without an owner to claim.
    pub claim: Vec<RobotId>,
    /// Robots of other instances whose heir this one is: subscribe to them, and confirm that they
    /// are received.
    pub prepare: Vec<RobotId>,
    /// Robots to hand over, each with its next owner.
    pub offer: Vec<Handover>,
    /// Own robots that stay after all, whose heir is withdrawn.
    pub withdraw: Vec<RobotId>,
    /// Own robots that their heir has received for long enough: store their state, and hand them
    /// over.
    pub hand_over: Vec<Handover>,
    /// Own robots that can be received elsewhere and not here, to release.
    pub give_up: Vec<RobotId>,
    /// Duties without an owner to claim.
    pub claim_duties: Vec<Duty>,
    /// Own duties that another instance should perform, to release.
    pub give_up_duties: Vec<Duty>,
}

impl Snapshot {
    /// Member of this seat, while the rows have it.
    pub fn member(&self, seat: &Seat) -> Option<&Member> {
        self.members.iter().find(|member| member.seat == *seat)
    }

    /// Instances that can have robots: those that robots reach, or all if robots reach none.
    fn candidates(&self) -> Vec<&Member> {
        let able = |member: &&Member| member.is_live() && !member.draining;
        let anybody_linked = self.members.iter().filter(able).any(|member| member.linked);
        let heard = |member: &&Member| able(member) && (member.linked || !anybody_linked);
        self.members.iter().filter(heard).collect()
    }

    /// Time since an event.
    fn since(&self, then: Option<WallTime>) -> Option<Duration> {
        let ns = self.now.ns_since(then?);
        Some(Duration::from_nanos(u64::try_from(ns).unwrap_or(0)))
    }
}

/// Plan of the instance `me` by the rows that it has read. For an instance that the rows lack, it
/// is empty.
pub fn plan(me: &Seat, snapshot: &Snapshot) -> Plan {
    let mut plan = Plan::default();
    let Some(own) = snapshot.member(me).filter(|member| member.is_live()) else {
        return plan;
    };
    let candidates = snapshot.candidates();
    let view = View {
        me,
        own,
        snapshot,
        is_candidate: candidates.iter().any(|member| member.seat == *me),
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

/// Assignment of the robots by these rows.
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
    let reach = Reach::of(snapshot, candidates);
    assign(&of_candidates, &owners.collect(), |seat, robot| {
        let stored = snapshot.robots.get(robot).map(|row| row.checkpoint_format);
        formats.get(seat).copied() >= stored && reach.permits(seat, robot)
    })
}

/// Robots that the candidates receive, while some of them do not receive each other.
struct Reach<'a> {
    snapshot: &'a Snapshot,
    /// Candidates by seat; empty while all of them receive each other.
    candidates: BTreeMap<&'a Seat, &'a Hearing>,
    /// Robots that at least one candidate receives.
    heard: BTreeSet<&'a RobotId>,
}

impl<'a> Reach<'a> {
    fn of(snapshot: &'a Snapshot, candidates: &[&'a Member]) -> Self {
        let is_cut = |member: &&Member| !member.hearing.unheard_instances.is_empty();
        let hearing = candidates.iter().filter(|_| candidates.iter().any(is_cut));
        let candidates: BTreeMap<_, _> = hearing
            .map(|member| (&member.seat, &member.hearing))
            .collect();
        let robots = candidates.values().flat_map(|one| &one.heard_robots);
        Self {
            heard: robots.collect(),
            snapshot,
            candidates,
        }
    }

    /// True if a candidate may have a robot: the present owner, unless it reports that it does not
    /// receive the robot, and any candidate that does. A robot that none receives stays where it
    /// is.
    fn permits(&self, seat: &Seat, robot: &RobotId) -> bool {
        let Some(hearing) = self.candidates.get(seat) else {
            return true;
        };
        let owner = self.snapshot.robots.get(robot);
        let owner = owner.and_then(|row| row.owner.as_ref());
        let owner = owner.filter(|owner| self.candidates.contains_key(owner));
        let is_owner = owner == Some(seat);
        if self.heard.contains(robot) {
            hearing.heard_robots.contains(robot)
                || is_owner && !hearing.unheard_robots.contains(robot)
        } else {
            is_owner || owner.is_none()
        }
    }
}

/// View of one instance.
struct View<'a> {
    me: &'a Seat,
    own: &'a Member,
    snapshot: &'a Snapshot,
    /// True if it can have robots.
    is_candidate: bool,
    assignment: Assignment,
}

impl View<'_> {
    /// Number of further hand-overs that may begin here.
    fn moves_left(&self) -> usize {
        let rows = self.snapshot.robots.values();
        let under_way =
            rows.filter(|row| row.owner.as_ref() == Some(self.me) && row.heir.is_some());
        CLUSTER_MOVES_AT_ONCE_MAX.saturating_sub(under_way.count())
    }

    fn of_own(&self, robot: &RobotId, row: &Ownership, moves: &mut usize, plan: &mut Plan) {
        let target = self.assignment.get(robot).filter(|seat| *seat != self.me);
        match (target, &row.heir) {
            (Some(_), _) if self.misses(robot) => plan.give_up.push(robot.clone()),
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

    /// True if this instance does not receive one of its robots, so that an overlap with the next
    /// owner would add nothing, and each moment here is one without an estimate.
    fn misses(&self, robot: &RobotId) -> bool {
        let is_cut_off = !self.is_candidate && !self.own.linked && !self.own.draining;
        is_cut_off || self.own.hearing.unheard_robots.contains(robot)
    }

    fn of_others(&self, robot: &RobotId, row: &Ownership, plan: &mut Plan) {
        if row.owner.is_some() {
            if row.heir.as_ref() == Some(self.me) && row.heir_ready.is_none() {
                plan.prepare.push(robot.clone());
            }
            return;
        }
        let is_own = self.assignment.get(robot) == Some(self.me);
        if is_own
            || (self.may_take(row.free_since)
                && row.checkpoint_format <= self.own.checkpoint_format)
        {
            plan.claim.push(robot.clone());
        }
    }

    /// True if the designated owner of a free robot or duty has had its time to claim it.
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

#[cfg(test)]
pub(crate) mod tests {
    use super::*;
    use crate::InstanceId;
    use crate::hearing::Hearing;
    use crate::tenure::Incarnation;

    const NOW: WallTime = WallTime(1_000_000_000_000);

    pub(crate) fn seat(name: &str) -> Seat {
        Seat {
            instance: InstanceId::parse(name).unwrap(),
            incarnation: Incarnation(3),
        }
    }

    pub(crate) fn robot(number: usize) -> RobotId {
        RobotId::parse(&format!("tugger_{number}")).unwrap()
    }

    fn member(name: &str) -> Member {
        Member {
            seat: seat(name),
            lease_left: Duration::from_secs(4),
            is_ended: false,
            capacity: 1,
            draining: false,
            linked: true,
            hearing: Hearing::default(),
            url: String::new(),
            program: String::new(),
            checkpoint_format: 2,
            config_sha256: Vec::new(),
            clock_ahead_ns: 0,
            joined_ns: 0,
        }
    }

    fn ago(duration: Duration) -> WallTime {
        NOW.minus(duration)
    }

    fn owned(by: Option<&str>) -> Ownership {
        Ownership {
            owner: by.map(seat),
            epoch: Epoch(7),
            claim: ClaimId(1),
            heir: None,
            heir_ready: None,
            free_since: by.is_none().then_some(NOW),
            checkpoint_format: 2,
        }
    }

    /// Cluster in which each robot belongs to the instance at its place in `owners`.
    pub(crate) fn cluster(members: &[&str], owners: &[Option<&str>]) -> Snapshot {
        let robots = owners.iter().enumerate();
        Snapshot {
            now: NOW,
            members: members.iter().map(|name| member(name)).collect(),
            robots: robots
                .map(|(number, owner)| (robot(number), owned(*owner)))
                .collect(),
            duties: BTreeMap::new(),
        }
    }

    fn row(snapshot: &mut Snapshot, number: usize) -> &mut Ownership {
        snapshot.robots.get_mut(&robot(number)).unwrap()
    }

    #[test]
    fn free_robots_are_claimed_once() {
        let snapshot = cluster(&["a", "b"], &[None; 10]);
        let (of_a, of_b) = (plan(&seat("a"), &snapshot), plan(&seat("b"), &snapshot));
        assert_eq!((of_a.claim.len(), of_b.claim.len()), (5, 5));
        assert!(of_a.claim.iter().all(|one| !of_b.claim.contains(one)));
        // Whoever should have taken it does not: another one does.
        let mut late = snapshot;
        for row in late.robots.values_mut() {
            row.free_since = Some(ago(CLUSTER_CLAIM_OTHERS_AFTER));
        }
        assert_eq!(plan(&seat("a"), &late).claim.len(), 10);
    }

    #[test]
    fn a_robot_is_handed_over_after_both_have_heard_it() {
        let mut snapshot = cluster(&["a", "b"], &[Some("a"); 2]);
        let offered = plan(&seat("a"), &snapshot).offer;
        assert_eq!(offered.len(), 1);
        assert_eq!(offered[0].to, seat("b"));
        assert_eq!(plan(&seat("b"), &snapshot), Plan::default());
        let given = offered[0].robot.clone();
        let number = usize::from(given == robot(1));
        row(&mut snapshot, number).heir = Some(seat("b"));
        let prepared = plan(&seat("b"), &snapshot).prepare;
        assert_eq!(prepared, std::slice::from_ref(&given));
        row(&mut snapshot, number).heir_ready = Some(NOW);
        assert_eq!(plan(&seat("b"), &snapshot), Plan::default());
        assert_eq!(plan(&seat("a"), &snapshot), Plan::default());
        row(&mut snapshot, number).heir_ready = Some(ago(CLUSTER_OVERLAP));
        assert_eq!(plan(&seat("a"), &snapshot).hand_over, offered);
        // The heir is gone: it stays.
        snapshot.members[1].lease_left = Duration::ZERO;
        assert_eq!(plan(&seat("a"), &snapshot).withdraw, [given]);
    }

    #[test]
    fn so_many_move_at_once_and_no_more() {
        let owners = vec![Some("a"); 4 * CLUSTER_MOVES_AT_ONCE_MAX];
        let snapshot = cluster(&["a", "b"], &owners);
        let plan = plan(&seat("a"), &snapshot);
        assert_eq!(plan.offer.len(), CLUSTER_MOVES_AT_ONCE_MAX);
    }

    #[test]
    fn who_drains_gives_everything_away() {
        let mut snapshot = cluster(&["a", "b"], &[Some("a"), Some("b")]);
        snapshot.members[0].draining = true;
        let offered = plan(&seat("a"), &snapshot).offer;
        assert_eq!(offered, [handover(&robot(0), &seat("b"))]);
        // Alone, it keeps what nobody takes.
        snapshot.members.truncate(1);
        assert_eq!(plan(&seat("a"), &snapshot), Plan::default());
    }

    #[test]
    fn who_hears_no_robot_gives_up_its_own_where_another_one_does() {
        let mut snapshot = cluster(&["a", "b"], &[Some("a"), Some("b")]);
        snapshot.members[0].linked = false;
        assert_eq!(plan(&seat("a"), &snapshot).give_up, [robot(0)]);
        snapshot.members[1].linked = false;
        assert_eq!(plan(&seat("a"), &snapshot), Plan::default());
    }

    /// Sets the robots that an instance receives, and those that it does not.
    fn hears(snapshot: &mut Snapshot, member: usize, heard: &[usize], unheard: &[usize]) {
        let robots = |numbers: &[usize]| numbers.iter().map(|number| robot(*number)).collect();
        let other = snapshot.members[1 - member].seat.instance.clone();
        snapshot.members[member].hearing = Hearing {
            unheard_instances: BTreeSet::from([other]),
            heard_robots: robots(heard),
            unheard_robots: robots(unheard),
        };
    }

    #[test]
    fn a_robot_goes_to_who_hears_it_when_the_routers_are_cut() {
        let mut snapshot = cluster(&["a", "b"], &[Some("a"), Some("a"), Some("b"), Some("b")]);
        hears(&mut snapshot, 0, &[0, 2], &[1, 3]);
        hears(&mut snapshot, 1, &[1, 3], &[0, 2]);
        assert_eq!(plan(&seat("a"), &snapshot).give_up, [robot(1)]);
        assert_eq!(plan(&seat("b"), &snapshot).give_up, [robot(2)]);
        let mut released = snapshot.clone();
        row(&mut released, 1).owner = None;
        assert_eq!(plan(&seat("a"), &released).claim, []);
        assert_eq!(plan(&seat("b"), &released).claim, [robot(1)]);
        // All robots are at one side: shares do not move them back.
        hears(&mut snapshot, 0, &[0, 1, 2, 3], &[]);
        hears(&mut snapshot, 1, &[], &[0, 1, 2, 3]);
        assert_eq!(plan(&seat("a"), &snapshot), Plan::default());
        for number in [2, 3] {
            row(&mut snapshot, number).owner = Some(seat("a"));
        }
        for name in ["a", "b"] {
            assert_eq!(plan(&seat(name), &snapshot), Plan::default());
        }
        // The cut is over.
        snapshot.members[0].hearing = Hearing::default();
        snapshot.members[1].hearing = Hearing::default();
        assert_eq!(plan(&seat("a"), &snapshot).offer.len(), 2);
    }

    #[test]
    fn a_robot_that_nobody_hears_stays() {
        let mut snapshot = cluster(&["a", "b"], &[Some("a"), Some("a"), Some("a"), None]);
        hears(&mut snapshot, 0, &[], &[0, 1, 2, 3]);
        hears(&mut snapshot, 1, &[], &[0, 1, 2, 3]);
        let (of_a, of_b) = (plan(&seat("a"), &snapshot), plan(&seat("b"), &snapshot));
        assert_eq!(of_a.offer, []);
        let claims = of_a.claim.len() + of_b.claim.len();
        assert_eq!(claims, 1, "what nobody has is taken all the same");
        // Nor does one move whose owner has been frozen, and says nothing.
        hears(&mut snapshot, 1, &[0, 1, 2], &[3]);
        snapshot.members[0].hearing = Hearing::default();
        let stays = plan(&seat("a"), &snapshot).offer;
        assert!(stays.len() <= 1, "its share alone: {stays:?}");
    }

    #[test]
    fn nobody_claims_what_it_cannot_read() {
        let mut snapshot = cluster(&["a"], &[None]);
        row(&mut snapshot, 0).checkpoint_format = 3;
        row(&mut snapshot, 0).free_since = Some(ago(Duration::from_mins(1)));
        assert_eq!(plan(&seat("a"), &snapshot), Plan::default());
    }

    #[test]
    fn who_was_taken_for_dead_does_nothing() {
        let snapshot = cluster(&["b"], &[None, Some("a")]);
        assert_eq!(plan(&seat("a"), &snapshot), Plan::default());
        let mut former = seat("b");
        former.incarnation = Incarnation(2);
        assert_eq!(plan(&former, &snapshot), Plan::default());
    }

    #[test]
    fn a_duty_has_one_holder() {
        let mut snapshot = cluster(&["a", "b"], &[]);
        let free = DutyOwnership {
            owner: None,
            free_since: Some(NOW),
        };
        for duty in Duty::ALL {
            snapshot.duties.insert(*duty, free.clone());
        }
        let both = ["a", "b"].map(|name| plan(&seat(name), &snapshot).claim_duties);
        assert_eq!(both[0].len() + both[1].len(), Duty::ALL.len());
        for row in snapshot.duties.values_mut() {
            row.owner = Some(seat("a"));
        }
        snapshot.members[0].draining = true;
        let given_up = plan(&seat("a"), &snapshot).give_up_duties;
        assert_eq!(given_up, Duty::ALL);
    }
}
