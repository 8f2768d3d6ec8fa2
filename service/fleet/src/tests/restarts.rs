//! Restarts of a robot's task: what is stored, how often, and where another one goes on.

use fleetcal_domain::approval::Policy;
use fleetcal_domain::robot::RobotState;
use fleetcal_estimator::Status;
use fleetcal_estimator::estimate::{Cause, Change, ChangeKind};
use fleetcal_model::Parameter;

use super::cluster::Instance;
use super::*;

const CALIBRATED: Status = Status::Converged;

/// Makes the estimate of an estimator with all parameters at one status.
fn estimate_of(calibrator: &Calibrator, stamp: RobotTime, status: Status) -> Effect {
    let mut estimate = calibrator.estimate();
    estimate.stamp = stamp;
    for parameter in &mut estimate.parameters {
        parameter.status = status;
    }
    Effect::Estimate(Box::new(estimate))
}

/// Replaces the estimator's step: after 100 s of messages the robot is calibrated.
fn calibrated_after_100_s(calibrator: &mut Calibrator, event: Event) -> Vec<Effect> {
    let Event::WheelOdometry(sample) = &event else {
        return Vec::new();
    };
    let stamp = sample.stamp();
    let is_known = stamp.seconds_since(RobotTime(BEGIN_NS)) >= 100.0;
    let status = if is_known {
        CALIBRATED
    } else {
        Status::Learning
    };
    calibrator.step(event);
    vec![estimate_of(calibrator, stamp, status)]
}

/// Replaces the estimator's step: everything is known, and the steering offset is the length of the
/// session.
fn counting(calibrator: &mut Calibrator, event: Event) -> Vec<Effect> {
    let Event::WheelOdometry(sample) = &event else {
        return Vec::new();
    };
    let stamp = sample.stamp();
    calibrator.step(event);
    let mut effect = estimate_of(calibrator, stamp, CALIBRATED);
    if let Effect::Estimate(estimate) = &mut effect
        && let Some(first) = estimate.parameters.first_mut()
    {
        first.value = calibrator.duration_s();
    }
    vec![effect]
}

fn session_s(bench: &Bench) -> Option<f64> {
    let estimate = bench.view("robot").estimate?;
    Some(estimate.parameters.get(Parameter::SteeringOffset).value)
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn an_edit_of_a_frame_or_a_topic_keeps_the_calibration_and_one_of_the_vehicle_does_not() {
    let bench = bench_with(&["robot"], BTreeMap::new(), counting);
    seconds(&bench, 0, 100).await;
    let before_s = session_s(&bench).unwrap();
    assert!(before_s > 90.0, "{before_s} s");
    let edit = |edited: &str| -> RobotConfig {
        let mut config = serde_json::to_value(vehicle()).unwrap();
        let edited: serde_json::Value = serde_json::from_str(edited).unwrap();
        let both = (config.as_object_mut(), edited.as_object());
        if let (Some(config), Some(edited)) = both {
            config.extend(edited.clone());
        }
        serde_json::from_value(config).unwrap()
    };
    let axle = r#"{"rear_axle_in_base_link": {"x_m": -0.4, "y_m": 0, "yaw_rad": 0}}"#;
    let topic = r#"{"streams": {"scan": {"topic": "front/scan"}}}"#;
    for (number, edited) in [(0, axle), (1, topic)] {
        let configured = bench.fleet.configure(&id("robot"), edit(edited));
        assert_eq!(configured, Ok(Configured::GoesOn), "{edited}");
        let view = bench.view("robot");
        assert_eq!(view.state, RobotState::Calibrated, "{edited}");
        assert!(view.estimate.is_some(), "{edited}");
        seconds(&bench, 100 + number, 101 + number).await;
        assert!(session_s(&bench).unwrap() > before_s, "{edited}");
        let in_base_link = bench.view("robot").estimate.unwrap().lidar_in_base_link;
        assert_eq!(in_base_link.is_some(), edited == axle, "{edited}");
    }
    // So does a restart of the service, by the edited configuration.
    let bench = restarted(bench, counting).await;
    seconds(&bench, 103, 104).await;
    assert!(session_s(&bench).unwrap() > before_s);

    let configured = bench
        .fleet
        .configure(&id("robot"), edit(r#"{"wheelbase_m": 1.3}"#));
    assert_eq!(configured, Ok(Configured::BeginsAgain(vec!["wheelbase_m"])));
    assert_eq!(bench.view("robot").state, RobotState::NoData);
    seconds(&bench, 104, 106).await;
    assert!(session_s(&bench).unwrap() < 5.0);
}

/// Replaces the estimator's step: every message shows a change of the calibration.
fn changing(calibrator: &mut Calibrator, event: Event) -> Vec<Effect> {
    let Event::WheelOdometry(sample) = &event else {
        return Vec::new();
    };
    let stamp = sample.stamp();
    calibrator.step(event);
    let change = Change {
        kind: ChangeKind::CalibrationChanged,
        cause: Cause::Steering,
        stamp,
        time_s: 0.0,
        onset_s: 0.0,
        change: Vec::new(),
    };
    let change = Effect::Change(Box::new(change));
    vec![change, estimate_of(calibrator, stamp, Status::Learning)]
}

/// Sends one message for each second of an interval.
async fn seconds(bench: &Bench, from_s: i64, to_s: i64) {
    for second in from_s..to_s {
        bench.send("robot", Stream::WheelOdometry, &drive(second * 100));
        bench.worked_off("robot").await;
    }
}

/// Stops a bench and starts another one from its stored state.
async fn restarted(bench: Bench, step: Step) -> Bench {
    bench.fleet.stop().await;
    let checkpoints = bench.kept.checkpoints.lock().unwrap().clone();
    bench_with(&["robot"], checkpoints, step)
}

/// Returns the times since the beginning at which checkpoints were stored since the last call, s.
fn stored_s(bench: &Bench) -> Vec<i64> {
    let stamps = std::mem::take(&mut *bench.kept.checkpointed.lock().unwrap());
    let seconds = |stamp: RobotTime| (stamp.0 - BEGIN_NS) / 1_000_000_000;
    stamps.into_iter().map(seconds).collect()
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn checkpoints_are_stored_every_10_s_until_all_is_known_and_decided() {
    let bench = bench_with(&["robot"], BTreeMap::new(), calibrated_after_100_s);
    seconds(&bench, 0, 35).await;
    assert_eq!(stored_s(&bench), [0, 10, 20, 30], "it learns");
    seconds(&bench, 35, 300).await;
    let learning = [40, 50, 60, 70, 80, 90];
    assert_eq!(stored_s(&bench)[..6], learning);
    seconds(&bench, 300, 400).await;
    stored_s(&bench);
    seconds(&bench, 400, 600).await;
    let calibrated = stored_s(&bench);
    let gaps: Vec<_> = calibrated.windows(2).map(|two| two[1] - two[0]).collect();
    assert_eq!(gaps, [60, 60], "it is calibrated: {calibrated:?}");

    let policy = Policy::default();
    assert!(!bench.fleet.has_stable_estimate(&id("robot"), &policy));
    seconds(&bench, 600, 640).await;
    let pending = stored_s(&bench);
    assert_eq!(pending.len(), 4, "a candidate waits: {pending:?}");
    assert!(bench.fleet.has_stable_estimate(&id("robot"), &policy));

    let in_verification = Some((Generation(3), RobotTime(7)));
    bench.fleet.use_values(&id("robot"), &[], in_verification);
    seconds(&bench, 640, 680).await;
    let verifying = stored_s(&bench);
    assert_eq!(verifying.len(), 4, "it verifies: {verifying:?}");
    bench.fleet.use_values(&id("robot"), &[], None);
    seconds(&bench, 680, 730).await;
    assert!(stored_s(&bench).is_empty(), "nothing is under way");
    bench.fleet.stop().await;
    assert_eq!(stored_s(&bench), [729], "the service stops");
}

/// Checks the interval of checkpoints, since a takeover loses whatever an instance has not stored.
#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn an_instance_of_a_cluster_stores_a_calibrated_robot_every_10_s_too() {
    let robots = BTreeMap::from([(id("robot"), vehicle())]);
    let a = Instance::stepping("a", robots, calibrated_after_100_s);
    a.adopt("robot", 1, None);
    seconds(&a.bench, 0, 200).await;
    assert_eq!(a.bench.view("robot").state, RobotState::Calibrated);
    stored_s(&a.bench);
    seconds(&a.bench, 200, 240).await;
    assert_eq!(stored_s(&a.bench).len(), 4);
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn values_in_verification_are_judged_by_all_that_was_driven_with_them() {
    let first = bench(&["robot"]);
    let in_verification = Some((Generation(3), RobotTime(7)));
    first.fleet.use_values(&id("robot"), &[], in_verification);
    let send = async |bench: &Bench, from: i64, to: i64| {
        for number in from..to {
            bench.send("robot", Stream::WheelOdometry, &drive(number));
            bench.worked_off("robot").await;
        }
    };
    send(&first, 0, 600).await;
    let second = restarted(first, Calibrator::step).await;
    second.restored("robot").await;
    assert_eq!(
        second.view("robot").verification,
        None,
        "nobody asks for it"
    );
    second.fleet.use_values(&id("robot"), &[], in_verification);
    let samples = |bench: &Bench| {
        let (generation, estimate) = bench.view("robot").verification?;
        (generation == Generation(3)).then_some(estimate.counts.drive_samples)
    };
    for _ in 0..2_000 {
        if samples(&second).is_some() {
            break;
        }
        tokio::time::sleep(Duration::from_millis(1)).await;
    }
    let before = samples(&second).expect("it is shown before anything comes");
    assert!((400..=500).contains(&before), "{before} samples");
    send(&second, 600, 900).await;
    let after = samples(&second).unwrap();
    assert!((650..=800).contains(&after), "{after} samples");

    // Values that were applied meanwhile are judged by what comes after that alone.
    let third = restarted(second, Calibrator::step).await;
    let another = Some((Generation(4), RobotTime(8)));
    third.fleet.use_values(&id("robot"), &[], another);
    send(&third, 900, 1_200).await;
    let (generation, estimate) = third.view("robot").verification.unwrap();
    assert_eq!(generation, Generation(4));
    assert!(estimate.counts.drive_samples <= 200);
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_robot_that_has_changed_is_shown_so_after_a_restart() {
    let first = bench_with(&["robot"], BTreeMap::new(), changing);
    seconds(&first, 0, 15).await;
    assert_eq!(first.view("robot").state, RobotState::Changed);
    let second = restarted(first, calibrated_after_100_s).await;
    second.restored("robot").await;
    assert_eq!(second.view("robot").state, RobotState::Changed);
    seconds(&second, 15, 20).await;
    assert_eq!(second.view("robot").state, RobotState::Changed);
    seconds(&second, 100, 101).await;
    assert_eq!(second.view("robot").state, RobotState::Calibrated);
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_robot_with_bytes_of_an_unknown_format_learns_anew() {
    let checkpoints = BTreeMap::from([(id("robot"), vec![0xff, 1, 2])]);
    let bench = bench_with(&["robot"], checkpoints, Calibrator::step);
    seconds(&bench, 0, 15).await;
    assert_eq!(bench.view("robot").counters.processed, 15);
    assert_eq!(bench.view("robot").state, RobotState::Learning);
    assert_eq!(stored_s(&bench), [0, 10]);
}

#[test]
fn a_robot_is_registered_once_it_is_configured() {
    let robot = crate::robot::Robot::new(id("robot"), None);
    assert_eq!(robot.state(), RobotState::Unregistered);
    let config = RobotConfig::of_vehicle(VehicleModel::Bicycle, Wheelbase::try_from(1.3).unwrap());
    robot.set_config(config, &EstimatorSettings::default());
    assert_eq!(
        robot.state(),
        RobotState::NoData,
        "before its task has begun"
    );
}
