//! Previews of unregistered robots: what is kept of their messages, and for how long.

use super::*;

fn preview(bench: &Bench) -> Preview {
    bench.fleet.preview(&id("a"), vehicle()).unwrap()
}

fn counted(preview: &Preview) -> u64 {
    preview
        .checks
        .streams
        .first()
        .map_or(0, |stream| stream.messages)
}

#[tokio::test]
async fn messages_are_kept_from_the_first_request_until_nobody_asks() {
    let bench = bench(&[]);
    bench.send("a", Stream::WheelOdometry, &drive(0));
    assert_eq!(counted(&preview(&bench)), 0);
    for number in 1..=10 {
        bench.send("a", Stream::WheelOdometry, &drive(number));
        bench.send("stranger", Stream::WheelOdometry, &drive(number));
    }
    bench.send("a", Stream::Event, b"{}");
    assert_eq!(counted(&preview(&bench)), 10);
    assert_eq!(bench.view("a").counters.ignored, 12);
    bench.check_accounts("a");
    assert_eq!(bench.fleet.previewed_streams().len(), 1);
    bench.clock.advance(limits::PREVIEW_KEPT);
    crate::watch::look(&bench.fleet.fleet, true);
    assert_eq!(bench.fleet.previewed_streams().len(), 0);
    assert_eq!(counted(&preview(&bench)), 0);
}

#[tokio::test]
async fn each_configuration_of_a_robot_has_its_own_preview() {
    let bench = bench(&[]);
    let metres = |number: u32| Wheelbase::try_from(1.0 + 0.1 * f64::from(number)).unwrap();
    let by = |name: &str, number: u32| {
        let config = RobotConfig::of_vehicle(VehicleModel::Bicycle, metres(number));
        bench.clock.advance(Duration::from_secs(1));
        bench.fleet.preview(&id(name), config)
    };
    for name in ["a", "b"] {
        bench.send(name, Stream::WheelOdometry, &drive(0));
    }
    // Two operators look by turns, and neither begins again.
    for number in 1..=4 {
        for config in [1, 2] {
            let shown = by("a", config).unwrap();
            assert_eq!(counted(&shown), number - 1, "{config}");
        }
        bench.send("a", Stream::WheelOdometry, &drive(number as i64));
    }
    // The least recent of a robot with several gives way, to another robot too.
    for config in 3..=limits::PREVIEWS_MAX as u32 {
        by("a", config).unwrap();
    }
    by("a", 1).unwrap();
    by("b", 1).unwrap();
    assert_eq!(counted(&by("a", 1).unwrap()), 4);
    assert_eq!(bench.fleet.previewed_streams().len(), 2);
    assert_eq!(counted(&by("a", 2).unwrap()), 0);
}

#[tokio::test]
async fn what_waits_is_bounded_in_messages_and_bytes() {
    let bench = bench(&[]);
    bench.send("a", Stream::WheelOdometry, &drive(0));
    preview(&bench);
    let count = limits::PREVIEW_MESSAGES_MAX as i64 + 7;
    for number in 0..count {
        bench.send("a", Stream::WheelOdometry, &drive(number));
    }
    assert_eq!(preview(&bench).dropped, 7);
    let large = vec![0; limits::payload_bytes_max(Stream::Scan)];
    let room = limits::PREVIEW_BYTES_MAX / large.len();
    for _ in 0..room + 3 {
        bench.send("a", Stream::Scan, &large);
    }
    assert_eq!(preview(&bench).dropped, 7 + 3);
}

#[tokio::test]
async fn a_registered_robot_has_no_preview_any_more() {
    let bench = bench(&[]);
    bench.send("a", Stream::WheelOdometry, &drive(0));
    let changed = bench.fleet.configured();
    preview(&bench);
    assert!(changed.has_changed().unwrap());
    bench.fleet.configure(&id("a"), vehicle()).unwrap();
    assert!(bench.fleet.previewed_streams().is_empty());
    let refused = bench.fleet.preview(&id("a"), vehicle()).unwrap_err();
    assert_eq!(refused, FleetRefused::Registered(id("a")));
    let refused = bench.fleet.preview(&id("b"), vehicle()).unwrap_err();
    assert_eq!(refused, FleetRefused::UnknownRobot(id("b")));
}
