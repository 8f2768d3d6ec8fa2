//! Subscriptions of an instance on Zenoh, and the instances and robots of the rows that it
//! receives.

use std::collections::{BTreeMap, BTreeSet};
use std::time::Duration;

use fleetcal_domain::limits::{
    CLUSTER_ALL_HEARD_AFTER, CLUSTER_LOOK_EVERY, CLUSTER_ROBOT_UNHEARD_AFTER,
    CLUSTER_UNHEARD_AFTER, SENDING_WITHIN,
};
use fleetcal_proto::RobotId;

use crate::InstanceId;
use crate::hearing::Hearing;
use crate::link_report::LinkReport;
use crate::member::Member;
use crate::plan::Snapshot;
use crate::tenure::Seat;

/// Largest distance of two looks that may be compared: with a longer one the process was held up,
/// and messages of that time are still unread.
const LOOKS_APART_MAX: Duration = CLUSTER_LOOK_EVERY.saturating_mul(2);

/// Memory of an instance that determines which others it receives.
#[derive(Debug, Default)]
pub struct Listening {
    looked_at: Duration,
    /// Begin of the time in which it has looked without being held up.
    steady_since: Duration,
    /// Begin of the time in which each other instance is not received.
    missing_since: BTreeMap<InstanceId, Duration>,
    /// Begin of the time in which it and another instance do not receive each other.
    apart_since: Option<Duration>,
    /// Begin of its subscription to each robot.
    listens_since: BTreeMap<RobotId, Duration>,
}

impl Listening {
    /// Determines what it receives at `now`, running time; `quiet_for` returns the time since the
    /// latest message of a robot.
    pub fn look(
        &mut self,
        me: &Seat,
        snapshot: &Snapshot,
        link: &LinkReport,
        now: Duration,
        quiet_for: impl Fn(&RobotId) -> Option<Duration>,
    ) -> Hearing {
        if now.saturating_sub(self.looked_at) > LOOKS_APART_MAX {
            self.steady_since = now;
        }
        self.looked_at = now;
        let unheard_instances = self.unheard(me, snapshot, link, now);
        let apart = seats_apart(me, snapshot, &unheard_instances);
        let robots = robots_to_hear(me, snapshot, &apart);
        self.listens_since.retain(|robot, _| robots.contains(robot));
        self.apart_since = (!apart.is_empty()).then(|| self.apart_since.unwrap_or(now));
        let apart_for = now.saturating_sub(self.apart_since.unwrap_or(now));
        let mut hearing = Hearing {
            unheard_instances,
            ..Hearing::default()
        };
        for robot in robots {
            let listens_since = *self.listens_since.entry(robot.clone()).or_insert(now);
            let listens_for = now.saturating_sub(listens_since.max(self.steady_since));
            let quiet = quiet_for(&robot);
            if quiet.is_some_and(|quiet| quiet < CLUSTER_ROBOT_UNHEARD_AFTER) {
                hearing.heard_robots.insert(robot);
            } else if listens_for >= CLUSTER_ROBOT_UNHEARD_AFTER && is_missed(quiet, apart_for) {
                hearing.unheard_robots.insert(robot);
            }
        }
        hearing
    }

    /// Robots that it subscribes to.
    pub fn robots(&self) -> impl Iterator<Item = &RobotId> {
        self.listens_since.keys()
    }

    /// True if it subscribes to a robot.
    pub fn listens_to(&self, robot: &RobotId) -> bool {
        self.listens_since.contains_key(robot)
    }

    /// Other instances that were not received for long enough.
    fn unheard(
        &mut self,
        me: &Seat,
        snapshot: &Snapshot,
        link: &LinkReport,
        now: Duration,
    ) -> BTreeSet<InstanceId> {
        let others = snapshot.members.iter();
        let others = others.filter(|member| member.seat != *me && member.is_live());
        let missing: BTreeSet<_> = others
            .filter(|member| member.linked && !link.hears(&member.seat.instance, now))
            .map(|member| member.seat.instance.clone())
            .collect();
        self.missing_since.retain(|one, _| missing.contains(one));
        for instance in missing {
            self.missing_since.entry(instance).or_insert(now);
        }
        let long = self.missing_since.iter().filter(|(_, since)| {
            now.saturating_sub(self.steady_since.max(**since)) >= CLUSTER_UNHEARD_AFTER
        });
        long.map(|(instance, _)| instance.clone()).collect()
    }
}

/// True if a robot that was quiet for this long may be at the other side: it was sending when the
/// instances lost each other, or may have begun to send there since. A cell of parked robots is not
/// subscribed to for a short loss.
fn is_missed(quiet: Option<Duration>, apart_for: Duration) -> bool {
    let quiet_before = quiet.map(|quiet| quiet.saturating_sub(apart_for));
    quiet_before.is_some_and(|before| before < CLUSTER_UNHEARD_AFTER + SENDING_WITHIN)
        || apart_for >= CLUSTER_ALL_HEARD_AFTER
}

/// Other instances that this one does not receive, or that do not receive it.
fn seats_apart<'a>(
    me: &Seat,
    snapshot: &'a Snapshot,
    unheard: &BTreeSet<InstanceId>,
) -> BTreeSet<&'a Seat> {
    let says_so = |member: &Member| {
        member.is_live() && member.hearing.unheard_instances.contains(&me.instance)
    };
    let members = snapshot.members.iter();
    let apart = members.filter(|one| unheard.contains(&one.seat.instance) || says_so(one));
    apart.map(|member| &member.seat).collect()
}

/// Robots to subscribe to while instances do not receive each other: its own, those that another
/// side reports as not received there, and those without an owner.
fn robots_to_hear(me: &Seat, snapshot: &Snapshot, apart: &BTreeSet<&Seat>) -> BTreeSet<RobotId> {
    if apart.is_empty() {
        return BTreeSet::new();
    }
    let misses = |owner: &Seat, robot: &RobotId| {
        let member = snapshot.member(owner);
        member.is_some_and(|member| member.hearing.unheard_robots.contains(robot))
    };
    let rows = snapshot.robots.iter();
    let wanted = rows.filter(|(robot, row)| match &row.owner {
        Some(owner) => owner == me || apart.contains(owner) && misses(owner, robot),
        None => true,
    });
    wanted.map(|(robot, _)| robot.clone()).collect()
}

#[cfg(test)]
mod tests {
    use fleetcal_domain::limits::CLUSTER_ZENOH_LEASE;

    use super::*;
    use crate::plan::tests::{cluster, robot, seat};

    /// Instances a and b with a robot each, from a's side.
    struct Cut {
        listening: Listening,
        snapshot: Snapshot,
        link: LinkReport,
        now: Duration,
        /// Robots that a would receive.
        sending: BTreeSet<RobotId>,
        received_at: BTreeMap<RobotId, Duration>,
    }

    impl Cut {
        fn new() -> Self {
            let mut link = LinkReport::default();
            link.note_token(seat("b").instance, true);
            Self {
                listening: Listening::default(),
                snapshot: cluster(&["a", "b"], &[Some("a"), Some("b")]),
                link,
                now: Duration::from_secs(100),
                sending: BTreeSet::from([robot(0), robot(1)]),
                received_at: BTreeMap::new(),
            }
        }

        fn look(&mut self) -> Hearing {
            let now = self.now;
            for robot in &self.sending {
                self.received_at.insert(robot.clone(), now);
            }
            let received_at = &self.received_at;
            let quiet = |robot: &RobotId| Some(now.saturating_sub(*received_at.get(robot)?));
            let (snapshot, link) = (&self.snapshot, &self.link);
            self.listening.look(&seat("a"), snapshot, link, now, quiet)
        }

        /// Looks for this long; returns the last result.
        fn look_for(&mut self, lasts: Duration) -> Hearing {
            let end = self.now + lasts;
            while self.now < end {
                self.now += CLUSTER_LOOK_EVERY;
                self.look();
            }
            self.look()
        }

        /// Reports in the row of b that it does not receive its robot.
        fn b_misses_its_robot(&mut self) {
            let of_b = &mut self.snapshot.members[1].hearing;
            of_b.unheard_robots.insert(robot(1));
        }
    }

    #[test]
    fn who_hears_all_instances_listens_to_no_others_robots() {
        let mut cut = Cut::new();
        let long = Duration::from_secs(20);
        assert_eq!(cut.look_for(long), Hearing::default());
        assert_eq!(cut.listening.robots().count(), 0);
        // Its own robot is switched off.
        cut.sending.clear();
        assert_eq!(cut.look_for(long), Hearing::default());
    }

    #[test]
    fn an_instance_that_is_not_heard_is_named_and_the_robots_that_it_misses_are_listened_to() {
        let mut cut = Cut::new();
        cut.look_for(CLUSTER_UNHEARD_AFTER);
        cut.link.note_token(seat("b").instance, false);
        cut.sending.remove(&robot(0));
        assert_eq!(cut.look(), Hearing::default(), "it may be back at once");
        let seen = cut.look_for(CLUSTER_UNHEARD_AFTER);
        assert_eq!(seen.unheard_instances, BTreeSet::from([seat("b").instance]));
        assert!(!cut.listening.listens_to(&robot(1)), "b receives it");
        cut.b_misses_its_robot();
        let seen = cut.look();
        assert_eq!(seen.heard_robots, BTreeSet::from([robot(1)]));
        assert_eq!(seen.unheard_robots, BTreeSet::new(), "not yet");
        let seen = cut.look_for(CLUSTER_ROBOT_UNHEARD_AFTER);
        assert_eq!(seen.unheard_robots, BTreeSet::from([robot(0)]));
        cut.link.note_token(seat("b").instance, true);
        assert_eq!(cut.look(), Hearing::default());
        assert_eq!(cut.listening.robots().count(), 0);
    }

    #[test]
    fn parked_robots_are_missed_once_they_may_have_begun_to_send_elsewhere() {
        let mut cut = Cut::new();
        cut.look();
        cut.sending.clear();
        cut.look_for(Duration::from_mins(1));
        cut.link.note_token(seat("b").instance, false);
        let began = cut.now;
        let seen = cut.look_for(CLUSTER_UNHEARD_AFTER + CLUSTER_ROBOT_UNHEARD_AFTER);
        assert_eq!(seen.unheard_instances.len(), 1);
        assert_eq!(seen.unheard_robots, BTreeSet::new());
        let seen = cut.look_for(CLUSTER_ALL_HEARD_AFTER);
        assert_eq!(seen.unheard_robots, BTreeSet::from([robot(0)]));
        assert!(cut.now < began + Duration::from_secs(25));
    }

    #[test]
    fn an_instance_whose_heartbeats_are_late_on_a_busy_machine_is_still_heard() {
        let mut cut = Cut::new();
        for _ in 0..10 {
            cut.link.note_token(seat("b").instance, false);
            let late = CLUSTER_ZENOH_LEASE.saturating_sub(CLUSTER_LOOK_EVERY * 2);
            assert_eq!(cut.look_for(late), Hearing::default());
            assert_eq!(cut.listening.robots().count(), 0);
            cut.link.note_token(seat("b").instance, true);
            cut.look();
        }
    }

    #[test]
    fn who_is_not_heard_by_another_one_listens_as_well() {
        let mut cut = Cut::new();
        let of_b = &mut cut.snapshot.members[1].hearing;
        of_b.unheard_instances.insert(seat("a").instance);
        cut.b_misses_its_robot();
        let seen = cut.look();
        assert_eq!(seen.unheard_instances, BTreeSet::new());
        assert_eq!(seen.heard_robots, cut.sending);
    }

    #[test]
    fn who_was_held_up_says_nothing_against_others() {
        let mut cut = Cut::new();
        cut.look_for(CLUSTER_UNHEARD_AFTER);
        cut.link.note_token(seat("b").instance, false);
        cut.sending.clear();
        cut.look_for(CLUSTER_UNHEARD_AFTER + CLUSTER_ROBOT_UNHEARD_AFTER);
        cut.now += Duration::from_secs(5);
        assert_eq!(cut.look(), Hearing::default());
    }
}
