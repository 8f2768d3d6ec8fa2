//! Restarts of the service while a deployment is under way.

use fleetcal_domain::robot::{RobotState, RobotView};
use fleetcal_robot::simulator::{Change, Pose2, ScheduledChange};

use super::driven::Driver;
use super::*;
use fleetcal_domain::approval::Present;

/// State of the robot.
fn standing(bench: &Bench) -> RobotState {
    bench.fleet.robot(&robot()).unwrap().state
}

/// Drives until the robot has this state, two minutes at most.
async fn drive_until(bench: &Bench, driver: &mut Driver, state: RobotState) {
    for _ in 0..120 {
        if standing(bench) == state {
            return;
        }
        driver.second(bench).await;
    }
    panic!("state: got {:?}, expected {state:?}", standing(bench));
}

/// Waits until the robot's view has the stored estimate.
async fn restored(bench: &Bench) {
    shown(bench, |view| view.estimate.as_ref().map(drop)).await;
}

/// Waits until the robot's view satisfies a condition.
async fn shown<T>(bench: &Bench, what: impl Fn(&RobotView) -> Option<T>) -> T {
    for _ in 0..2_000 {
        if let Some(found) = what(&bench.fleet.robot(&robot()).unwrap()) {
            return found;
        }
        tokio::time::sleep(Duration::from_millis(1)).await;
    }
    panic!("the robot does not show it");
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_verification_run_goes_on() {
    let bench = Bench::open(Policy::default()).await;
    let mut driver = Driver::new(&bench);
    driver.second(&bench).await;
    bench.propose_values(driver.right_values(), None).await;
    bench.agree().await;
    let generation = bench.drive_in_verification().await;
    driver.metres(&bench, 50.0).await;
    assert_eq!(bench.state(), Some(DeploymentState::Verifying));

    let bench = bench.restart().await;
    let stored = bench.store.load_checkpoints().await.unwrap();
    let sizes: Vec<_> = stored.iter().map(|record| record.state.len()).collect();
    assert!(matches!(sizes[..], [1..=20_000]), "{sizes:?} bytes");
    // Before anything comes.
    let (of, estimate) = shown(&bench, |view| view.verification.clone()).await;
    assert_eq!(of, generation);
    assert!(estimate.distance_m > 45.0, "{} m", estimate.distance_m);
    // One that begins from nothing would have to drive 60 m again.
    driver.metres(&bench, 40.0).await;
    let latest = bench.latest().await;
    assert_eq!(latest.state, DeploymentState::Verified);
    let driven_m = latest.verification.as_ref().unwrap().distance_m;
    assert!((60.0..=90.0).contains(&driven_m), "{driven_m} m");
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_difference_that_stood_still_need_not_do_so_again() {
    let policy = Policy {
        stable_for_s: 30.0,
        ..Policy::default()
    };
    let bench = Bench::open(policy).await;
    let mut driver = Driver::new(&bench);
    drive_until(&bench, &mut driver, RobotState::Calibrated).await;
    let seconds = async |bench: &Bench, driver: &mut Driver, seconds: usize| {
        for _ in 0..seconds {
            driver.second(bench).await;
        }
    };
    seconds(&bench, &mut driver, 20).await;
    let is_proposed = |bench: &Bench| bench.lifecycle.ledger(&robot()).open.is_some();

    let bench = bench.restart().await;
    restored(&bench).await;
    seconds(&bench, &mut driver, 5).await;
    assert!(!is_proposed(&bench), "it stood still for 25 s");
    seconds(&bench, &mut driver, 10).await;
    let state = standing(&bench);
    assert!(is_proposed(&bench), "it stood still for 35 s: {state:?}");
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_robot_that_has_changed_stays_so_until_it_is_known_again() {
    let bench = Bench::open(Policy::default()).await;
    let knock = ScheduledChange {
        at_s: 60.0,
        change: Change::Mount(Pose2::new(0.1, 0.1, 0.1)),
    };
    let mut driver = Driver::with_changes(&bench, vec![knock]);
    drive_until(&bench, &mut driver, RobotState::Calibrated).await;
    drive_until(&bench, &mut driver, RobotState::Changed).await;

    let bench = bench.restart().await;
    restored(&bench).await;
    assert_eq!(standing(&bench), RobotState::Changed);
    assert_eq!(bench.lifecycle.present(&robot()), Present::VehicleChanged);
    drive_until(&bench, &mut driver, RobotState::Calibrated).await;
}
