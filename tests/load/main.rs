//! How much a fleet costs: 50 robots at 100 Hz and 10 Hz × 1024 beams on one machine.

use fleetcal_proto::RobotId;
use fleetcal_robot::replay::{Rate, ReplayOptions, replay};
use fleetcal_tests::recording;
use fleetcal_tests::service::{Service, now};
use tempfile::TempDir;
use tokio::task::JoinSet;

/// Robots at once.
const ROBOTS: usize = 50;
/// Seconds that each of them drives, in real time.
const DURATION_S: f64 = 20.0;

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn fifty_robots_lose_no_drive_sample() {
    let folder = TempDir::new().unwrap();
    let path = folder.path().join("robot.mcap");
    recording::simulated(&path, DURATION_S);
    let names: Vec<String> = (1..=ROBOTS)
        .map(|number| format!("robot_{number:02}"))
        .collect();
    let names: Vec<&str> = names.iter().map(String::as_str).collect();
    let service = Service::start(&names);
    let (cpu_s, began) = (service.cpu_s(), now());
    let mut robots = JoinSet::new();
    for name in &names {
        let mut options = ReplayOptions::new(path.clone(), vec![service.endpoint()]);
        options.robot = Some(RobotId::parse(name).unwrap());
        options.rate = Rate::Times(1.0);
        robots.spawn(async move { replay(options, |_| {}).await });
    }
    let summaries = robots.join_all().await;
    let cpu_s = service.cpu_s() - cpu_s;
    let took_s = began.elapsed().as_secs_f64();
    let (mut drive_samples, mut scans) = (0, 0);
    for summary in summaries {
        let summary = summary.unwrap();
        let counters = service.accounts_of(summary.robot.as_str());
        assert_eq!(counters["shed_drive"], 0, "{}: {counters}", summary.robot);
        assert_eq!(counters["refused"], 0, "{}: {counters}", summary.robot);
        assert_eq!(counters["received"], summary.drive_samples + summary.scans);
        drive_samples += summary.drive_samples;
        scans += summary.scans;
    }
    let robot_seconds = ROBOTS as f64 * DURATION_S;
    println!(
        "{ROBOTS} robots, {drive_samples} drive samples and {scans} scans in {took_s:.1} s: \
         {:.2} ms of CPU time per robot-second, {:.2} cores in all, {} MiB",
        1e3 * cpu_s / robot_seconds,
        cpu_s / took_s,
        service.memory_bytes() >> 20,
    );
}
