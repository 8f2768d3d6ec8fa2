//! Robots that apply values themselves, in use or in verification.

use super::*;

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_compensated_robot_is_not_estimated_from_half_the_truth() {
    let bench = bench(&[]);
    let config = RobotConfig {
        wheel_odometry: WheelOdometrySignal::Compensated,
        ..vehicle()
    };
    bench.fleet.configure(&id("robot"), config).unwrap();
    bench.send("robot", Stream::WheelOdometry, &drive(0));
    bench.worked_off("robot").await;
    let counters = bench.view("robot").counters;
    assert_eq!((counters.processed, counters.refused), (0, 1));
    assert!(counters.last_refusal.unwrap().contains("compensated"));
}

#[expect(
    clippy::needless_pass_by_value,
    reason = "has the signature of what it takes the place of"
)]
/// Replaces the estimator's step: publishes the received steering angle as the steering offset.
fn telling(calibrator: &mut Calibrator, event: Event) -> Vec<Effect> {
    let Event::WheelOdometry(sample) = event else {
        return Vec::new();
    };
    let mut estimate = calibrator.estimate();
    estimate.stamp = sample.stamp();
    if let Some(first) = estimate.parameters.first_mut() {
        first.value = sample.steering_rad();
    }
    vec![Effect::Estimate(Box::new(estimate))]
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn what_a_compensated_robot_takes_off_is_added_back_from_that_moment_on() {
    let config = RobotConfig {
        wheel_odometry: WheelOdometrySignal::Compensated,
        ..vehicle()
    };
    let bench = bench_of(
        BTreeMap::from([(id("robot"), config)]),
        BTreeMap::new(),
        telling,
    );
    let used = |since, generation, steering_offset_rad| UsedValues {
        since,
        generation,
        values: CalibrationValues {
            steering_offset_rad,
            ..CalibrationValues::default()
        },
    };
    // The agent's clock is years ahead of that of the messages.
    let since = |second: i64| RobotTime(2 * BEGIN_NS + second);
    let before = used(since(0), Generation(0), 0.01);
    let then = used(since(2), Generation(4), 0.05);
    bench.fleet.use_values(&id("robot"), &[before], None);
    let mut told = Vec::new();
    for number in 0..4 {
        if number == 2 {
            bench.fleet.use_values(&id("robot"), &[before, then], None);
        }
        bench.send("robot", Stream::WheelOdometry, &drive(number));
        bench.worked_off("robot").await;
        let estimate = bench.view("robot").estimate.unwrap();
        told.push(estimate.parameters.steering_offset.value);
    }
    let sent = told[0] - 0.01;
    for (told, offset) in told.iter().zip([0.01, 0.01, 0.05, 0.05]) {
        assert!((told - sent - offset).abs() < 1e-6, "{told:?}");
    }
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn values_on_trial_are_judged_by_an_estimator_of_their_own() {
    let bench = bench(&["robot"]);
    for number in 0..100 {
        bench.send("robot", Stream::WheelOdometry, &drive(number));
    }
    // It is heard of behind what waits, and its clock is not that of the messages.
    let since_ns = 7;
    bench.fleet.use_values(
        &id("robot"),
        &[],
        Some((Generation(3), RobotTime(since_ns))),
    );
    bench.worked_off("robot").await;
    assert_eq!(bench.view("robot").verification, None, "nothing came since");
    for number in 100..800 {
        bench.send("robot", Stream::WheelOdometry, &drive(number));
        bench.worked_off("robot").await;
    }
    let (generation, verification) = bench
        .view("robot")
        .verification
        .expect("an estimate of its own");
    let all = bench.view("robot").estimate.unwrap();
    assert_eq!(generation, Generation(3));
    let late = all.counts.drive_samples - verification.counts.drive_samples;
    assert!(
        (200..=300).contains(&late),
        "{late} came before or were in flight"
    );
    assert!(verification.distance_m < all.distance_m);
    bench.fleet.use_values(&id("robot"), &[], None);
    assert_eq!(
        bench.view("robot").verification,
        None,
        "the verification_run is over"
    );
}
