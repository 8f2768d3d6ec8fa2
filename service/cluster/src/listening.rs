//! Subscriptions of an instance on Zenoh, and the instances and robots of the rows that it
//! receives.

use std::collections::{BTreeMap, BTreeSet};
use std::time::Duration;

use fleetcal_domain::limits::{
    CLUSTER_LOOK_EVERY, CLUSTER_ROBOT_UNHEARD_AFTER, CLUSTER_UNHEARD_AFTER,
};
use fleetcal_proto::RobotId;

use crate::InstanceId;
use crate::hearing::Hearing;
use crate::link_report::LinkReport;
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
        let robots = robots_to_hear(me, snapshot, &unheard_instances);
        self.listens_since.retain(|robot, _| robots.contains(robot));
        let mut hearing = Hearing {
            unheard_instances,
            ..Hearing::default()
        };
        for robot in robots {
            let listens_since = *self.listens_since.entry(robot.clone()).or_insert(now);
            let listens_for = now.saturating_sub(listens_since.max(self.steady_since));
            if quiet_for(&robot).is_some_and(|quiet| quiet < CLUSTER_ROBOT_UNHEARD_AFTER) {
                hearing.heard_robots.insert(robot);
            } else if listens_for >= CLUSTER_ROBOT_UNHEARD_AFTER {
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

/// Robots to subscribe to while instances do not receive each other: its own, those of unconnected
/// instances, and those without an owner.
fn robots_to_hear(
    me: &Seat,
    snapshot: &Snapshot,
    unheard: &BTreeSet<InstanceId>,
) -> BTreeSet<RobotId> {
    let says_so = |seat: &Seat| {
        let member = snapshot.member(seat).filter(|member| member.is_live());
        member.is_some_and(|member| member.hearing.unheard_instances.contains(&me.instance))
    };
    let apart = |seat: &Seat| unheard.contains(&seat.instance) || says_so(seat);
    let seats = snapshot.members.iter().map(|member| &member.seat);
    if !seats.into_iter().any(apart) {
        return BTreeSet::new();
    }
    let rows = snapshot.robots.iter();
    let wanted = rows.filter(|(_, row)| match &row.owner {
        Some(owner) => owner == me || apart(owner),
        None => true,
    });
    wanted.map(|(robot, _)| robot.clone()).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::plan::tests::{cluster, robot, seat};

    /// Instances a and b with a robot each, from a's side, and both robots at the router of b.
    struct Cut {
        listening: Listening,
        snapshot: Snapshot,
        link: LinkReport,
        now: Duration,
        /// Robots that a receives.
        sending: BTreeSet<RobotId>,
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
            }
        }

        fn look(&mut self) -> Hearing {
            let sending = &self.sending;
            let quiet = |robot: &RobotId| sending.contains(robot).then_some(Duration::ZERO);
            let Self {
                listening,
                snapshot,
                link,
                now,
                ..
            } = self;
            listening.look(&seat("a"), snapshot, link, *now, quiet)
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
    fn an_instance_that_is_not_heard_is_named_and_its_robots_are_listened_to() {
        let mut cut = Cut::new();
        cut.look_for(CLUSTER_UNHEARD_AFTER);
        cut.link.note_token(seat("b").instance, false);
        cut.sending.remove(&robot(0));
        assert_eq!(cut.look(), Hearing::default(), "it may be back at once");
        let seen = cut.look_for(CLUSTER_UNHEARD_AFTER);
        assert_eq!(seen.unheard_instances, BTreeSet::from([seat("b").instance]));
        assert_eq!(seen.heard_robots, BTreeSet::from([robot(1)]));
        assert_eq!(seen.unheard_robots, BTreeSet::new(), "not yet");
        let seen = cut.look_for(CLUSTER_ROBOT_UNHEARD_AFTER);
        assert_eq!(seen.unheard_robots, BTreeSet::from([robot(0)]));
        cut.link.note_token(seat("b").instance, true);
        assert_eq!(cut.look(), Hearing::default());
        assert_eq!(cut.listening.robots().count(), 0);
    }

    #[test]
    fn who_is_not_heard_by_another_one_listens_as_well() {
        let mut cut = Cut::new();
        let of_b = &mut cut.snapshot.members[1].hearing;
        of_b.unheard_instances.insert(seat("a").instance);
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
