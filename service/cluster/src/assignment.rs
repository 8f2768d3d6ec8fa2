//! Assignment of robots to instances: even shares, and as few moves as they allow.

use std::cmp::Reverse;
use std::collections::BTreeMap;

use fleetcal_proto::RobotId;
use sha2::{Digest, Sha256};

use crate::InstanceId;
use crate::tenure::Seat;

/// Instance that should estimate each robot.
pub type Assignment = BTreeMap<RobotId, Seat>;

/// Instance that can have robots, with its weight.
#[derive(Debug, Clone, Copy)]
pub struct Candidate<'a> {
    /// Seat of the instance.
    pub seat: &'a Seat,
    /// Weight in the distribution of robots, at least 1.
    pub capacity: u32,
}

/// Assigns each robot to an instance. Shares are proportional to capacity, to within one robot. An
/// owner keeps its robots within its share; robots that move, and those without an owner, go to
/// instances with room in the order of rendezvous hashing (Thaler and Ravishankar, 1998). All
/// instances that have read the same rows compute the same result.
///
/// `robots` has the present owner of each robot; `can_have` is true if an instance can continue
/// from a robot's stored state, and receives it. A robot that no candidate can have is absent from
/// the result.
pub fn assign(
    candidates: &[Candidate<'_>],
    robots: &BTreeMap<RobotId, Option<&Seat>>,
    can_have: impl Fn(&Seat, &RobotId) -> bool,
) -> Assignment {
    let mut owned: BTreeMap<&Seat, Vec<&RobotId>> = BTreeMap::new();
    for candidate in candidates {
        owned.entry(candidate.seat).or_default();
    }
    let mut homeless = Vec::new();
    for (robot, owner) in robots {
        let keeps = owner.filter(|seat| can_have(seat, robot));
        match keeps.and_then(|seat| owned.get_mut(seat)) {
            Some(of_owner) => of_owner.push(robot),
            None => homeless.push(robot),
        }
    }
    let mut room = shares(candidates, &owned, robots.len());
    let mut assignment = Assignment::new();
    // Step 1: who has a robot keeps it, the ones that suit best first.
    for (seat, mut of_owner) in owned {
        let share = room.entry(seat).or_default();
        of_owner.sort_by_cached_key(|robot| Reverse(score(&seat.instance, robot.as_str())));
        let kept = of_owner.len().min(*share);
        *share -= kept;
        homeless.extend(of_owner.split_off(kept));
        assignment.extend(
            of_owner
                .into_iter()
                .map(|robot| (robot.clone(), seat.clone())),
        );
    }
    // Step 2: the others go where there is room.
    homeless.sort_unstable();
    for robot in homeless {
        let able = |seat: &&Seat| can_have(seat, robot);
        let suits = |seat: &&Seat| score(&seat.instance, robot.as_str());
        let with_room = room.iter().filter(|(_, left)| **left > 0);
        let best = with_room
            .map(|(seat, _)| *seat)
            .filter(able)
            .max_by_key(suits);
        // Beyond its share rather than not at all.
        let best = best.or_else(|| {
            let all = candidates.iter().map(|candidate| candidate.seat);
            all.filter(able).max_by_key(suits)
        });
        if let Some(seat) = best {
            if let Some(left) = room.get_mut(seat) {
                *left = left.saturating_sub(1);
            }
            assignment.insert(robot.clone(), seat.clone());
        }
    }
    assignment
}

/// Number of robots of each candidate: its share by capacity, as whole numbers that add up to all
/// robots. The remainder of the rounding goes to those with the most robots, so that none moves
/// because of it.
fn shares<'a>(
    candidates: &[Candidate<'a>],
    owned: &BTreeMap<&'a Seat, Vec<&RobotId>>,
    robots: usize,
) -> BTreeMap<&'a Seat, usize> {
    let weight = |candidate: &Candidate<'_>| u128::from(candidate.capacity.max(1));
    let total: u128 = candidates.iter().map(weight).sum();
    let mut shares: BTreeMap<&Seat, usize> = BTreeMap::new();
    let mut given = 0;
    for candidate in candidates {
        let share = robots as u128 * weight(candidate) / total.max(1);
        let share = usize::try_from(share).unwrap_or(robots);
        given += share;
        shares.insert(candidate.seat, share);
    }
    let mut order: Vec<&Seat> = candidates.iter().map(|candidate| candidate.seat).collect();
    let surplus = |seat: &Seat| {
        let has = owned.get(seat).map_or(0, Vec::len);
        has.saturating_sub(shares.get(seat).copied().unwrap_or(0))
    };
    order.sort_by_cached_key(|seat| (Reverse(surplus(seat)), (*seat).clone()));
    for seat in order.into_iter().take(robots.saturating_sub(given)) {
        *shares.entry(seat).or_default() += 1;
    }
    shares
}

/// Rendezvous score of an instance for a subject, independent of the others.
pub(crate) fn score(instance: &InstanceId, subject: &str) -> u64 {
    let mut hasher = Sha256::new();
    hasher.update(instance.as_str().as_bytes());
    hasher.update([0]);
    hasher.update(subject.as_bytes());
    let digest = hasher.finalize();
    let first = digest.first_chunk::<8>();
    first.map_or(0, |bytes| u64::from_be_bytes(*bytes))
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::tenure::Incarnation;

    fn seat(name: &str) -> Seat {
        Seat {
            instance: InstanceId::parse(name).unwrap(),
            incarnation: Incarnation(1),
        }
    }

    fn seats(count: usize) -> Vec<Seat> {
        (0..count).map(|n| seat(&format!("instance_{n}"))).collect()
    }

    fn candidates(seats: &[Seat]) -> Vec<Candidate<'_>> {
        let of = |seat| Candidate { seat, capacity: 1 };
        seats.iter().map(of).collect()
    }

    fn robot(number: usize) -> RobotId {
        RobotId::parse(&format!("tugger_{number}")).unwrap()
    }

    fn nobodys(count: usize) -> BTreeMap<RobotId, Option<&'static Seat>> {
        (0..count).map(|number| (robot(number), None)).collect()
    }

    fn loads(assignment: &Assignment) -> BTreeMap<&Seat, usize> {
        let mut loads = BTreeMap::new();
        for seat in assignment.values() {
            *loads.entry(seat).or_insert(0) += 1;
        }
        loads
    }

    fn all(_: &Seat, _: &RobotId) -> bool {
        true
    }

    #[test]
    fn shares_are_even_to_within_one_robot() {
        for (instances, robots) in [(1, 1), (2, 24), (3, 100), (5, 4_096), (4, 2)] {
            let seats = seats(instances);
            let assignment = assign(&candidates(&seats), &nobodys(robots), all);
            assert_eq!(assignment.len(), robots);
            let loads = loads(&assignment);
            let most = loads.values().max().copied().unwrap();
            assert!(most <= robots.div_ceil(instances), "{loads:?}");
        }
    }

    #[test]
    fn capacity_counts() {
        let seats = seats(2);
        let mut candidates = candidates(&seats);
        candidates[0].capacity = 3;
        let assignment = assign(&candidates, &nobodys(100), all);
        assert_eq!(loads(&assignment)[&seats[0]], 75);
    }

    proptest! {
        /// Property: at most `robots / n` robots, rounded up, move to an instance that joins.
        #[test]
        fn who_joins_gets_its_share_and_nothing_else_moves(
            before in 1_usize..6, robots in 1_usize..300
        ) {
            let seats = seats(before + 1);
            let first = assign(&candidates(&seats[..before]), &nobodys(robots), all);
            let owners = first.iter().map(|(robot, seat)| (robot.clone(), Some(seat))).collect();
            let second = assign(&candidates(&seats), &owners, all);
            let moved = first.iter().filter(|(robot, seat)| second[*robot] != **seat);
            let moved: Vec<_> = moved.map(|(robot, _)| &second[robot]).collect();
            prop_assert!(moved.len() <= robots.div_ceil(before + 1));
            prop_assert!(moved.iter().all(|seat| **seat == seats[before]));
            let third = assign(
                &candidates(&seats),
                &second.iter().map(|(robot, seat)| (robot.clone(), Some(seat))).collect(),
                all,
            );
            prop_assert_eq!(second, third, "what is balanced stays");
        }

        /// Property: of all robots only those of an instance that leaves move.
        #[test]
        fn who_leaves_takes_nobody_elses_robot(before in 2_usize..6, robots in 1_usize..300) {
            let seats = seats(before);
            let first = assign(&candidates(&seats), &nobodys(robots), all);
            let owners = first.iter().map(|(robot, seat)| (robot.clone(), Some(seat))).collect();
            let second = assign(&candidates(&seats[1..]), &owners, all);
            for (robot, seat) in &first {
                prop_assert!(*seat == seats[0] || second[robot] == *seat);
            }
        }
    }

    #[test]
    fn who_cannot_read_a_state_does_not_get_it() {
        let seats = seats(2);
        let newer = |seat: &Seat, _: &RobotId| *seat == seats[1];
        let assignment = assign(&candidates(&seats), &nobodys(10), newer);
        assert_eq!(loads(&assignment), BTreeMap::from([(&seats[1], 10)]));
        let nobody = assign(&candidates(&seats), &nobodys(10), |_, _| false);
        assert!(nobody.is_empty());
    }
}
