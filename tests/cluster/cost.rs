//! Cost of a cluster above one service: CPU of its processes a second and robot.

use std::time::Duration;

use fleetcal_contract::own_server::number;
use fleetcal_tests::service::{now, wait_for};

use crate::cluster::Cluster;
use crate::process::Process;
use crate::watch::Watch;

/// Largest additional cost of a robot, ms of CPU a second.
const MORE_MS_MAX: f64 = 0.5;
/// Time that robots drive before the measurement.
const WARM_UP: Duration = Duration::from_secs(20);

/// Measures the CPU of processes for each second and robot, ms, with a subscriber to all estimates.
async fn measured(cluster: &Cluster, processes: &[&Process], robots: usize, seconds: usize) -> f64 {
    let _robots = cluster.drive();
    let watch = Watch::start(&cluster.routers).await;
    let used = || processes.iter().map(|one| one.cpu_s()).sum::<f64>();
    std::thread::sleep(WARM_UP);
    let before = used();
    std::thread::sleep(Duration::from_secs(seconds as u64));
    let cost = (used() - before) * 1e3 / (robots * seconds) as f64;
    let since = now().checked_sub(Duration::from_secs(3)).unwrap();
    let heard = watch.owners(since);
    assert_eq!(heard.len(), robots, "not all robots are estimated");
    cost
}

async fn of_one(robots: usize, seconds: usize) -> f64 {
    let cluster = Cluster::new(&["a"], robots).await;
    let service = cluster.start_alone();
    measured(&cluster, &[&service], robots, seconds).await
}

async fn of_two(robots: usize, seconds: usize) -> f64 {
    let cluster = Cluster::new(&["a", "b"], robots).await;
    let instances = [cluster.start("a", 0), cluster.start("b", 1)];
    let half = (robots / 2) as u64;
    wait_for("even shares", || {
        let shares = instances[1].shares()?;
        (shares.len() == 2 && shares.values().all(|share| *share == half)).then_some(())
    });
    let processes = [&instances[0].process, &instances[1].process];
    measured(&cluster, &processes, robots, seconds).await
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn two_instances_cost_little_more_than_one_service() {
    let robots = number("CLUSTER_COST_ROBOTS", 60);
    let seconds = number("CLUSTER_COST_SECONDS", 60);
    let rounds = number("CLUSTER_COST_ROUNDS", 3);
    let mut more = Vec::new();
    for round in 1..=rounds {
        let one = of_one(robots, seconds).await;
        let two = of_two(robots, seconds).await;
        more.push(two - one);
        println!(
            "round {round}: one service {one:.2} ms, two instances {two:.2} ms a robot-second, \
             {:+.2} ms",
            two - one
        );
    }
    let mean = more.iter().sum::<f64>() / more.len() as f64;
    println!(
        "{robots} robots for {seconds} s, {rounds} times: two instances cost {mean:+.2} ms of CPU a \
         robot-second (at most {MORE_MS_MAX} ms)"
    );
    assert!(mean <= MORE_MS_MAX, "{more:?}");
}
