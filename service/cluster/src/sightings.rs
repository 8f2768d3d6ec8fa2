//! Faults of a cluster, from its rows.

use std::collections::{BTreeMap, BTreeSet};
use std::time::Duration;

use fleetcal_domain::alert::{AlertKind, AlertPolicy, Observation, Sighting, Subject};
use fleetcal_domain::limits::{
    CLUSTER_CLOCK_WARNED_BEYOND, CLUSTER_NO_INSTANCE_AFTER, CLUSTER_ROBOTS_NAMED_MAX,
};
use fleetcal_proto::RobotId;

use crate::member::Member;
use crate::plan::{Ownership, Snapshot};

/// Number of bytes of a configuration's hash that are displayed for comparison.
const DIGEST_BYTES_SHOWN: usize = 4;

/// Sightings of the rules about instances and the owners of robots. Each is one sighting of the
/// fleet: the loss of an instance affects many robots at once. Times are the database's, as in the
/// rows.
pub fn cluster_sightings(snapshot: &Snapshot, policy: &AlertPolicy) -> Vec<(Subject, Sighting)> {
    let seen = [
        (AlertKind::NoInstance, no_instance(snapshot)),
        (AlertKind::RoutersCut, routers_cut(snapshot)),
        (
            AlertKind::ConfigurationsDiffer,
            configurations_differ(snapshot),
        ),
        (AlertKind::ClockOff, clock_off(snapshot)),
    ];
    let sightings = seen.map(|(kind, seen)| {
        let seen = seen.filter(|_| !policy.off.contains(&kind));
        (Subject::Fleet, sighting(kind, seen))
    });
    sightings.into()
}

/// Robots without an owner, with the time for which they have had none, by the database's clock.
pub fn homeless(snapshot: &Snapshot) -> impl Iterator<Item = (&RobotId, Duration)> {
    snapshot.robots.iter().filter_map(|(robot, row)| {
        let free_for = match (&row.owner, row.free_since) {
            (None, Some(since)) => snapshot.now.ns_since(since),
            (None, None) => 0,
            (Some(_), _) => return None,
        };
        let free_for = u64::try_from(free_for).unwrap_or(0);
        Some((robot, Duration::from_nanos(free_for)))
    })
}

/// Sighting that fires: its description and robots.
struct Seen {
    what: String,
    robots: Vec<RobotId>,
}

fn sighting(kind: AlertKind, seen: Option<Seen>) -> Sighting {
    let (observation, what, robots) = match seen {
        Some(seen) => (Observation::Firing, seen.what, seen.robots),
        None => (Observation::Clear, String::new(), Vec::new()),
    };
    Sighting {
        kind,
        observation,
        what,
        robots,
    }
}

fn no_instance(snapshot: &Snapshot) -> Option<Seen> {
    let overdue = homeless(snapshot).filter(|(_, free_for)| *free_for >= CLUSTER_NO_INSTANCE_AFTER);
    let robots: Vec<RobotId> = overdue.map(|(robot, _)| robot.clone()).collect();
    if robots.is_empty() {
        return None;
    }
    let names: Vec<_> = robots.iter().map(RobotId::as_str).collect();
    let named = names.get(..CLUSTER_ROBOTS_NAMED_MAX).unwrap_or(&names);
    let more = match names.len() - named.len() {
        0 => String::new(),
        more => format!(" and {more} more"),
    };
    let (count, of) = (robots.len(), snapshot.robots.len());
    let have = if count == 1 { "has" } else { "have" };
    let named = named.join(", ");
    let unreadable = unreadable(snapshot, &robots);
    let what = format!("{count} of {of} robots {have} no instance: {named}{more}{unreadable}");
    Some(Seen { what, robots })
}

/// Remark for robots whose stored state no live instance can read; empty if one can.
fn unreadable(snapshot: &Snapshot, robots: &[RobotId]) -> String {
    let readable = live(snapshot).map(|member| member.checkpoint_format).max();
    let rows = robots.iter().filter_map(|id| snapshot.robots.get(id));
    let format = |row: &Ownership| row.checkpoint_format;
    match (readable, rows.map(format).max()) {
        (Some(readable), Some(stored)) if stored > readable => format!(
            "; a state has format {stored}, and the instances that are there read {readable} at most"
        ),
        _ => String::new(),
    }
}

/// Pairs of live instances of which one does not receive the other.
fn routers_cut(snapshot: &Snapshot) -> Option<Seen> {
    let parts = live(snapshot).flat_map(|member| {
        let unheard = member.hearing.unheard_instances.iter();
        unheard.map(|other| {
            let (name, other) = (member.seat.instance.as_str(), other.as_str());
            format!("{name} does not receive {other}")
        })
    });
    let parts: Vec<_> = parts.collect();
    (!parts.is_empty()).then(|| Seen {
        what: format!("the routers are cut apart: {}", parts.join(", ")),
        robots: Vec::new(),
    })
}

fn configurations_differ(snapshot: &Snapshot) -> Option<Seen> {
    let mut having: BTreeMap<&[u8], BTreeSet<&str>> = BTreeMap::new();
    for member in live(snapshot) {
        let of_hash = having.entry(&member.config_sha256).or_default();
        of_hash.insert(member.seat.instance.as_str());
    }
    if having.len() < 2 {
        return None;
    }
    let parts = having.iter().map(|(hash, names)| {
        let names: Vec<_> = names.iter().copied().collect();
        format!("{} of {}", digits(hash), names.join(", "))
    });
    let parts: Vec<_> = parts.collect();
    Some(Seen {
        what: format!("the instances' configurations differ: {}", parts.join("; ")),
        robots: Vec::new(),
    })
}

/// First digits of a hash.
fn digits(hash: &[u8]) -> String {
    let shown = hash.iter().take(DIGEST_BYTES_SHOWN);
    let number = shown.fold(0_u32, |number, byte| (number << 8) | u32::from(*byte));
    format!("{number:08x}")
}

fn clock_off(snapshot: &Snapshot) -> Option<Seen> {
    let parts = live(snapshot).filter_map(|member| {
        let ahead = Duration::from_nanos(member.clock_ahead_ns.unsigned_abs());
        if ahead <= CLUSTER_CLOCK_WARNED_BEYOND {
            return None;
        }
        let (name, seconds) = (member.seat.instance.as_str(), ahead.as_secs_f64());
        let side = if member.clock_ahead_ns > 0 {
            "ahead of"
        } else {
            "behind"
        };
        Some(format!("{name} is {seconds:.1} s {side} the database"))
    });
    let parts: Vec<_> = parts.collect();
    (!parts.is_empty()).then(|| Seen {
        what: format!("clocks are off: {}", parts.join(", ")),
        robots: Vec::new(),
    })
}

fn live(snapshot: &Snapshot) -> impl Iterator<Item = &Member> {
    snapshot.members.iter().filter(|member| member.is_live())
}

#[cfg(test)]
mod tests {
    use fleetcal_model::WallTime;

    use super::*;
    use crate::InstanceId;
    use crate::hearing::Hearing;
    use crate::tenure::{ClaimId, Epoch, Incarnation, Seat};

    const S: i64 = 1_000_000_000;

    fn seat(name: &str) -> Seat {
        Seat {
            instance: InstanceId::parse(name).unwrap(),
            incarnation: Incarnation(1),
        }
    }

    fn member(name: &str) -> Member {
        Member {
            seat: seat(name),
            lease_left: Duration::from_secs(5),
            is_ended: false,
            capacity: 1,
            draining: false,
            linked: true,
            hearing: Hearing::default(),
            url: String::new(),
            program: String::new(),
            checkpoint_format: 2,
            config_sha256: vec![0xab; 32],
            clock_ahead_ns: 0,
            joined_ns: 0,
        }
    }

    /// Snapshot of two instances at second 100, and of robots that are free since a second each, or
    /// have an owner.
    fn snapshot(free_since_s: &[Option<i64>]) -> Snapshot {
        let robots = free_since_s.iter().enumerate().map(|(number, since_s)| {
            let row = Ownership {
                owner: since_s.is_none().then(|| seat("a")),
                epoch: Epoch(1),
                claim: ClaimId(1),
                heir: None,
                heir_ready: None,
                free_since: since_s.map(|since_s| WallTime(since_s * S)),
                checkpoint_format: 1,
            };
            (RobotId::parse(&format!("tugger_{number}")).unwrap(), row)
        });
        Snapshot {
            now: WallTime(100 * S),
            members: vec![member("a"), member("b")],
            robots: robots.collect(),
            duties: BTreeMap::new(),
        }
    }

    fn seen(snapshot: &Snapshot, kind: AlertKind) -> Option<Sighting> {
        let all = cluster_sightings(snapshot, &AlertPolicy::default());
        let (subject, one) = all.into_iter().find(|(_, one)| one.kind == kind).unwrap();
        assert_eq!(subject, Subject::Fleet);
        (one.observation == Observation::Firing).then_some(one)
    }

    #[test]
    fn a_cluster_as_it_should_be_has_no_alert() {
        let whole = snapshot(&[None, None]);
        let all = cluster_sightings(&whole, &AlertPolicy::default());
        assert_eq!(all.len(), 4);
        assert!(
            all.iter()
                .all(|(_, one)| one.observation == Observation::Clear)
        );
    }

    #[test]
    fn a_robot_without_an_instance_is_told_of_after_fifteen_seconds() {
        let kind = AlertKind::NoInstance;
        assert_eq!(seen(&snapshot(&[None, Some(86)]), kind), None);
        let overdue = seen(&snapshot(&[None, Some(85), Some(99)]), kind).unwrap();
        assert_eq!(overdue.what, "1 of 3 robots has no instance: tugger_1");
        assert_eq!(overdue.robots.len(), 1);
        let many = seen(&snapshot(&[Some(1); 10]), kind).unwrap();
        assert!(many.what.ends_with("tugger_7 and 2 more"), "{}", many.what);
        assert_eq!(many.robots.len(), 10);
    }

    #[test]
    fn a_state_that_nobody_can_read_is_named() {
        let mut newer = snapshot(&[Some(1)]);
        for row in newer.robots.values_mut() {
            row.checkpoint_format = 3;
        }
        let what = seen(&newer, AlertKind::NoInstance).unwrap().what;
        assert_eq!(
            what,
            "1 of 1 robots has no instance: tugger_0; a state has format 3, and the instances that \
             are there read 2 at most"
        );
    }

    #[test]
    fn configurations_of_live_instances_are_compared() {
        let mut differing = snapshot(&[]);
        differing.members[1].config_sha256 = vec![0x01; 32];
        let what = seen(&differing, AlertKind::ConfigurationsDiffer)
            .unwrap()
            .what;
        assert_eq!(
            what,
            "the instances' configurations differ: 01010101 of b; abababab of a"
        );
        differing.members[1].lease_left = Duration::ZERO;
        assert_eq!(seen(&differing, AlertKind::ConfigurationsDiffer), None);
    }

    #[test]
    fn instances_that_do_not_receive_each_other_are_named() {
        let mut cut = snapshot(&[]);
        let (a, b) = (seat("a").instance, seat("b").instance);
        cut.members[0].hearing.unheard_instances.insert(b);
        cut.members[1].hearing.unheard_instances.insert(a);
        let what = seen(&cut, AlertKind::RoutersCut).unwrap().what;
        assert_eq!(
            what,
            "the routers are cut apart: a does not receive b, b does not receive a"
        );
        cut.members[1].lease_left = Duration::ZERO;
        cut.members[0].lease_left = Duration::ZERO;
        assert_eq!(seen(&cut, AlertKind::RoutersCut), None);
    }

    #[test]
    fn a_clock_more_than_a_second_off_is_told_of() {
        let mut off = snapshot(&[]);
        off.members[0].clock_ahead_ns = S;
        assert_eq!(seen(&off, AlertKind::ClockOff), None);
        off.members[0].clock_ahead_ns = S + 1;
        off.members[1].clock_ahead_ns = -12 * S;
        let what = seen(&off, AlertKind::ClockOff).unwrap().what;
        assert_eq!(
            what,
            "clocks are off: a is 1.0 s ahead of the database, b is 12.0 s behind the database"
        );
    }

    #[test]
    fn a_kind_that_is_off_is_not_told_of() {
        let policy = AlertPolicy {
            off: vec![AlertKind::NoInstance],
            ..AlertPolicy::default()
        };
        let all = cluster_sightings(&snapshot(&[Some(1)]), &policy);
        assert!(
            all.iter()
                .all(|(_, one)| one.observation == Observation::Clear)
        );
    }
}
