use rand::rngs::StdRng;
use rand::{Rng, SeedableRng};

use super::*;

const MS: i64 = 1_000_000;
const START_NS: i64 = 1_760_000_000_000_000_000;

/// Makes a message with a unique content.
fn sent(stamp_ns: i64, origin: u64) -> Sent {
    Sent {
        stamp: RobotTime(START_NS + stamp_ns),
        content: (stamp_ns * 1_000) as u64 + origin,
        origin: Some(Origin(origin)),
        steering_rad: None,
    }
}

/// Returns the number of messages before two senders are detected.
fn seen_after(messages: impl IntoIterator<Item = Sent>) -> Option<usize> {
    let mut senders = Senders::default();
    let mut messages = messages.into_iter();
    messages.position(|message| senders.take(Stream::WheelOdometry, &message))
}

/// Makes the messages of one robot with their times of arrival: 100 each second over one
/// connection.
fn robot(origin: u64, phase_ns: i64, clock_ns: i64, seed: u64) -> Vec<(i64, Sent)> {
    let mut random = StdRng::seed_from_u64(seed);
    let at = (0..600).map(|number| {
        let jitter = random.random_range(-100_000..=100_000);
        number * 10 * MS + phase_ns + jitter
    });
    at.map(|at| (at, sent(at + clock_ns, origin))).collect()
}

fn in_order(mut messages: Vec<(i64, Sent)>) -> impl Iterator<Item = Sent> {
    messages.sort_by_key(|(at, _)| *at);
    messages.into_iter().map(|(_, message)| message)
}

#[test]
fn stamps_alone_never_tell_two_senders() {
    let mut random = StdRng::seed_from_u64(1);
    let mut jitter = move || random.random_range(-30..=30) * MS;
    let mut stamps_of: Vec<Box<dyn FnMut(i64) -> i64>> = vec![
        Box::new(|number| number * 10 * MS),
        Box::new(|number| (number * 3 + 1) / 2 * 10 * MS),
        Box::new(|number| number / 2 * 133 * MS + number % 2 * 33 * MS),
        Box::new(|number| number / 100 * 1_000 * MS),
        Box::new(|_| 0),
        Box::new(move |number| number * 20 * MS + jitter()),
        Box::new(|number| (number % 2 * 500 + number * 10) * MS),
        Box::new(|number| -number * 10 * MS),
    ];
    for (pattern, stamp_of) in stamps_of.iter_mut().enumerate() {
        for origin in [None, Some(Origin(1))] {
            let messages = (0..2_000).map(|number| Sent {
                stamp: RobotTime(START_NS + stamp_of(number)),
                content: number as u64,
                origin,
                // It turns from one side to the other every second, as fast as a wheel can.
                steering_rad: Some((0.06 * number as f64).sin().clamp(-0.5, 0.5)),
            });
            assert_eq!(seen_after(messages), None, "pattern {pattern}, {origin:?}");
        }
    }
}

#[test]
fn two_robots_on_two_connections_are_seen_within_a_second_whatever_their_clocks_say() {
    for seed in 0..50 {
        let mut random = StdRng::seed_from_u64(seed);
        let phase_ns = random.random_range(0..10 * MS);
        let clocks = [0, 3, 20, 700, 5_000, 3_600_000].map(|ms| [ms, -ms]);
        for clock_ms in clocks.into_iter().flatten() {
            let mut both = robot(1, 0, 0, seed);
            both.extend(robot(2, phase_ns, clock_ms * MS, seed + 1_000));
            let after = seen_after(in_order(both));
            assert!(
                after.is_some_and(|messages| messages <= 210),
                "seed {seed}, {clock_ms} ms: {after:?}"
            );
        }
    }
}

#[test]
fn two_robots_that_say_the_same_stamps_are_seen_by_what_they_say() {
    let coarse = (0..200).flat_map(|number| [1, 2].map(|origin| (number, origin)));
    let messages = coarse.map(|(number, origin)| Sent {
        stamp: RobotTime(START_NS),
        content: (number * 2 + origin) as u64,
        ..sent(0, origin as u64)
    });
    assert!(seen_after(messages).is_some_and(|after| after <= 210));
}

#[test]
fn one_that_sends_less_is_seen_by_its_connection() {
    let now_and_then = (0..400).map(|number| sent(number * 5 * MS, u64::from(number % 50 == 40)));
    let after = seen_after(now_and_then);
    assert!(after.is_some_and(|messages| messages < 200), "{after:?}");
    // With another clock, one in ten.
    let now_and_then = (0..400).map(|number| {
        let is_second = number % 10 == 4;
        let clock_ms = if is_second { -5_000 } else { 0 };
        sent((number * 5 + clock_ms) * MS, u64::from(is_second))
    });
    let after = seen_after(now_and_then);
    assert!(after.is_some_and(|messages| messages <= 250), "{after:?}");
}

#[test]
fn a_robot_that_connects_again_is_one() {
    // Each time over a connection of its own, however often.
    let again = (0..400).map(|number| sent(number * 5 * MS, number as u64 / 3));
    assert_eq!(seen_after(again), None);
    // What waited on the connection before is read beside what comes over the next one.
    let before = (0..88).map(|number| sent(number * 5 * MS, 0));
    let both = (0..12).flat_map(|number| [(100 + number, 1), (88 + number, 0)]);
    let both = both.map(|(number, origin)| sent(number * 5 * MS, origin));
    let after = (112..400).map(|number| sent(number * 5 * MS, 1));
    assert_eq!(seen_after(before.chain(both).chain(after)), None);
}

#[test]
fn a_robot_behind_two_bridges_is_one() {
    for seed in 0..50 {
        let mut random = StdRng::seed_from_u64(seed);
        // Either may be first, and each loses one in twenty.
        let messages: Vec<_> = (0..1_000)
            .flat_map(|number| {
                let first = random.random_range(0..2);
                [first, 1 - first].map(|origin| Sent {
                    content: number as u64,
                    ..sent(number * 5 * MS, origin)
                })
            })
            .collect();
        let kept = messages.into_iter().filter(|_| random.random_bool(0.95));
        assert_eq!(seen_after(kept), None, "seed {seed}");
    }
    // One of them brings everything a quarter of a second later, and was there before the service.
    for start in [0, 50] {
        let late = (start..1_000).flat_map(|number| [(number, 0), (number - 50, 1)]);
        let late = late.filter(|(number, _)| *number >= 0);
        let late = late.map(|(number, origin)| Sent {
            content: number as u64,
            ..sent(number * 5 * MS, origin)
        });
        assert_eq!(seen_after(late), None, "from {start}");
    }
}

/// Returns a steering angle on a winding route, rad, with the noise of a poor encoder.
fn winding(number: i64, phase_rad: f64, random: &mut StdRng) -> f64 {
    let noise_rad = 0.005 * (random.random::<f64>() - 0.5);
    0.3 * (0.01 * number as f64 + phase_rad).sin() + noise_rad
}

#[test]
fn two_robots_behind_one_router_are_seen_by_what_they_say() {
    for seed in 0..50 {
        let mut random = StdRng::seed_from_u64(seed);
        let messages: Vec<Sent> = (0..400)
            .flat_map(|number| [0.0, 2.0].map(|phase_rad| (number, phase_rad)))
            .map(|(number, phase_rad)| Sent {
                steering_rad: Some(winding(number, phase_rad, &mut random)),
                ..sent(number * 10 * MS, 1)
            })
            .collect();
        let after = seen_after(messages);
        assert!(after.is_some_and(|after| after <= 200), "{seed}: {after:?}");
    }
}

#[test]
fn an_angle_that_is_coarse_or_noisy_is_that_of_one_wheel() {
    let mut random = StdRng::seed_from_u64(1);
    let mut winding = |number: i64| winding(number, 0.0, &mut random);
    let mut noise = StdRng::seed_from_u64(2);
    let mut angle_of: Vec<Box<dyn FnMut(i64) -> f64 + '_>> = vec![
        Box::new(&mut winding),
        // Steps of 3 degrees, and an encoder between two of them.
        Box::new(|number| (20.0 * 0.3 * (0.01 * number as f64).sin()).round() / 20.0),
        Box::new(|number| 0.05 * (number % 2) as f64),
        // Three degrees of noise.
        Box::new(move |_| 0.1 * (noise.random::<f64>() - 0.5)),
        // About half a turn, where an encoder's angle wraps.
        Box::new(|number| std::f64::consts::PI * [1.0, -1.0][number as usize % 2]),
        // From stop to stop.
        Box::new(|number| if number / 10 % 2 == 0 { 0.4 } else { -0.4 }),
    ];
    for (kind, angle_of) in angle_of.iter_mut().enumerate() {
        let messages = (0..4_000).map(|number| Sent {
            steering_rad: Some(angle_of(number)),
            ..sent(number * 10 * MS, 1)
        });
        assert_eq!(seen_after(messages), None, "angle {kind}");
    }
}

#[test]
fn messages_that_did_not_come_are_counted_by_the_steps_around_them() {
    let mut senders = Senders::default();
    let mut missing = 0;
    for number in (0..1_000_i64).filter(|number| number % 100 < 90 || *number < 100) {
        senders.take(Stream::WheelOdometry, &sent(number * 10 * MS, 1));
        missing += senders.missing(Stream::WheelOdometry);
    }
    // Nine times ten; the last gap has no message behind it.
    assert_eq!(missing, 80);
    // A robot that stopped for a minute.
    senders.take(Stream::WheelOdometry, &sent(70_000 * MS, 1));
    assert_eq!(senders.missing(Stream::WheelOdometry), 0);
}

#[test]
fn there_is_one_again_when_the_second_has_gone() {
    for (steering_rad, calm) in [(None, CALM_MESSAGES), (Some(0.3), CALM_MESSAGES_BY_ANGLES)] {
        let mut senders = Senders::default();
        let mut take = |number: i64, origin: u64| {
            let side = if origin == 1 { 1.0 } else { -1.0 };
            let origin = if steering_rad.is_some() { 0 } else { origin };
            senders.take(
                Stream::WheelOdometry,
                &Sent {
                    steering_rad: steering_rad.map(|angle| side * angle),
                    ..sent(number * 10 * MS, origin)
                },
            )
        };
        for number in 0..40 {
            take(2 * number, 1);
            take(2 * number + 1, 2);
        }
        let mut alone = (100..).take_while(|number| take(*number, 1));
        let still = alone.by_ref().count() as u32;
        let window = (TURNS_WINDOW.max(ANGLES_WINDOW)) as u32;
        assert!((calm - 1..calm + window).contains(&still), "{still}");
    }
}
