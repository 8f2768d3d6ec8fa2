//! Plays a cut between two routers through the plans of the instances at both sides.

#![expect(clippy::unwrap_used, reason = "a test that cannot go on fails")]

use std::collections::{BTreeMap, BTreeSet};
use std::time::Duration;

use fleetcal_cluster::{
    ClaimId, Epoch, HEARTBEAT_EVERY, Hearing, Incarnation, InstanceId, LinkReport, Listening,
    Member, Ownership, Plan, Seat, Snapshot, plan,
};
use fleetcal_domain::limits::{CLUSTER_LEASE, CLUSTER_LOOK_EVERY};
use fleetcal_model::WallTime;
use fleetcal_proto::RobotId;

/// Robots of the fleet.
const ROBOTS: usize = 2_000;
/// Time within which an instance that receives a robot has it, as docs/cluster.md promises.
const SERVED_WITHIN: Duration = Duration::from_secs(10);
/// Time of the snapshot at the cut, wall time of the database.
const CUT_AT: WallTime = WallTime(1_000_000_000_000);
const NAMES: [&str; 2] = ["a", "b"];

fn seat(side: usize) -> Seat {
    Seat {
        instance: InstanceId::parse(NAMES[side]).unwrap(),
        incarnation: Incarnation(1),
    }
}

fn member(side: usize) -> Member {
    Member {
        seat: seat(side),
        lease_left: CLUSTER_LEASE,
        is_ended: false,
        capacity: 1,
        draining: false,
        linked: true,
        hearing: Hearing::default(),
        url: String::new(),
        program: String::new(),
        checkpoint_format: 1,
        config_sha256: Vec::new(),
        clock_ahead_ns: 0,
        joined_ns: 0,
    }
}

/// An instance at one side.
struct Instance {
    seat: Seat,
    listening: Listening,
    link: LinkReport,
    /// Receipt of the latest message of each robot, running time.
    received_at: BTreeMap<RobotId, Duration>,
}

/// Two instances, each at a router of its own, and the routers cut from each other.
struct Cut {
    snapshot: Snapshot,
    instances: [Instance; 2],
    /// Side at which each robot sends.
    sends_at: BTreeMap<RobotId, usize>,
    /// Running time of both.
    now: Duration,
    since: Duration,
}

impl Cut {
    /// Makes a cut of instances that have robots by turns; `sends_at` returns the side of a robot.
    fn new(sends_at: impl Fn(usize) -> usize) -> Self {
        let ids = (0..ROBOTS).map(|number| RobotId::parse(&format!("tugger_{number}")).unwrap());
        let ids: Vec<RobotId> = ids.collect();
        let now = Duration::from_secs(100);
        let row = |number: usize| Ownership {
            owner: Some(seat(number % 2)),
            epoch: Epoch(1),
            claim: ClaimId(1),
            heir: None,
            heir_ready: None,
            free_since: None,
            checkpoint_format: 1,
        };
        let rows = ids.iter().cloned().enumerate();
        let snapshot = Snapshot {
            now: CUT_AT,
            members: vec![member(0), member(1)],
            robots: rows.map(|(number, id)| (id, row(number))).collect(),
            duties: BTreeMap::new(),
        };
        let sides = ids.iter().cloned().enumerate();
        let instance = |side: usize| {
            let mut link = LinkReport::default();
            link.linked = true;
            link.note_token(seat(1 - side).instance, true);
            link.note_heartbeat(seat(1 - side).instance, now);
            let own = ids.iter().skip(side).step_by(2);
            Instance {
                seat: seat(side),
                listening: Listening::default(),
                link,
                received_at: own.map(|id| (id.clone(), now)).collect(),
            }
        };
        Self {
            snapshot,
            instances: [instance(0), instance(1)],
            sends_at: sides.map(|(number, id)| (id, sends_at(number))).collect(),
            now,
            since: now,
        }
    }

    /// Both instances look at the same rows and act; the rows then have what they did.
    fn look(&mut self) {
        self.now += CLUSTER_LOOK_EVERY;
        self.snapshot.now = CUT_AT.plus(self.lasts());
        let seen = self.snapshot.clone();
        for side in 0..self.instances.len() {
            let hearing = self.hearing(side, &seen);
            self.snapshot.members[side].hearing = hearing;
            let plan = plan(&seat(side), &seen);
            self.act(side, &plan);
        }
    }

    fn hearing(&mut self, side: usize, seen: &Snapshot) -> Hearing {
        let one = &mut self.instances[side];
        let is_subscribed = |id: &RobotId, row: &Ownership| {
            let seats = [&row.owner, &row.heir];
            seats.contains(&&Some(one.seat.clone())) || one.listening.listens_to(id)
        };
        for (id, row) in &seen.robots {
            if self.sends_at[id] == side && is_subscribed(id, row) {
                one.received_at.insert(id.clone(), self.now);
            }
        }
        let (now, received_at) = (self.now, &one.received_at);
        let quiet = |id: &RobotId| Some(now.saturating_sub(*received_at.get(id)?));
        let (listening, link) = (&mut one.listening, &one.link);
        listening.look(&one.seat, seen, link, now, quiet)
    }

    fn act(&mut self, side: usize, plan: &Plan) {
        let now = self.snapshot.now;
        let rows = &mut self.snapshot.robots;
        let mut change = |id: &RobotId, change: &dyn Fn(&mut Ownership)| {
            rows.get_mut(id).into_iter().for_each(change);
        };
        for id in &plan.claim {
            change(id, &|row| row.owner = Some(seat(side)));
        }
        for id in &plan.prepare {
            change(id, &|row| row.heir_ready = Some(now));
        }
        for one in &plan.offer {
            change(&one.robot, &|row| row.heir = Some(one.to.clone()));
        }
        for id in &plan.withdraw {
            change(id, &|row| (row.heir, row.heir_ready) = (None, None));
        }
        for one in &plan.hand_over {
            change(&one.robot, &|row| {
                row.owner = Some(one.to.clone());
                (row.heir, row.heir_ready) = (None, None);
            });
        }
        for id in &plan.give_up {
            change(id, &|row| (row.owner, row.free_since) = (None, Some(now)));
        }
    }

    /// Number of robots whose owner does not receive them.
    fn unserved(&self) -> usize {
        let rows = self.snapshot.robots.iter();
        let unserved = rows.filter(|(id, row)| row.owner != Some(seat(self.sends_at[*id])));
        unserved.count()
    }

    fn lasts(&self) -> Duration {
        self.now.saturating_sub(self.since)
    }

    /// Looks until all robots are served; returns the time that this took.
    fn until_all_are_served(&mut self) -> Duration {
        while self.unserved() > 0 && self.lasts() < 6 * SERVED_WITHIN {
            self.look();
        }
        self.lasts()
    }

    fn owners(&self) -> BTreeSet<(&RobotId, Option<&Seat>)> {
        let rows = self.snapshot.robots.iter();
        rows.map(|(id, row)| (id, row.owner.as_ref())).collect()
    }
}

#[test]
fn a_large_fleet_is_served_within_ten_seconds_of_a_cut() {
    assert!(HEARTBEAT_EVERY < CLUSTER_LOOK_EVERY, "a look sees none");
    // All robots at one side, and half of each instance's at the other.
    let sides: [fn(usize) -> usize; 2] = [|_| 0, |number| number / 2 % 2];
    for sends_at in sides {
        let mut cut = Cut::new(sends_at);
        let unserved = cut.unserved();
        let took = cut.until_all_are_served();
        println!("{unserved} of {ROBOTS} robots are served again after {took:?}");
        assert_eq!(cut.unserved(), 0, "after {took:?}");
        assert!(took <= SERVED_WITHIN, "{took:?}");
        // They stay there for as long as the cut lasts.
        let owners = format!("{:?}", cut.owners());
        while cut.lasts() < SERVED_WITHIN {
            cut.look();
        }
        assert_eq!(format!("{:?}", cut.owners()), owners);
    }
}
