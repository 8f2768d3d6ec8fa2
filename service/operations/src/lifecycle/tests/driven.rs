//! Simulated robot that drives through the whole service: mailbox, estimators, lifecycle and store.

use fleetcal_domain::approval::Present;
use fleetcal_fleet::{Arrived, Origin};
use fleetcal_model::{Generation, RobotTime, Stream};
use fleetcal_proto::encoding::Encoding;
use fleetcal_proto::ros::RosMessage;
use fleetcal_robot::fleet::{drive_message, lidar_pose_message};
use fleetcal_robot::simulator::{
    LidarOutput, PoseSettings, ScheduledChange, SimulatedMessage, Simulation, SimulationConfig,
};

use super::*;

/// Steering offset of the robot, rad.
const OFFSET_RAD: f64 = 0.05;
/// Messages that are sent before the robot's task must have processed them.
const BURST: u64 = 32;

/// Robot on the figure-eight whose stamps follow the bench's clock.
pub(super) struct Driver {
    simulation: Simulation,
    pub(super) distance_m: f64,
    /// Connections by which its messages come in turn.
    senders: u64,
}

/// Simulation of a robot on the figure-eight that sends poses.
fn configuration(start_stamp_ns: i64) -> SimulationConfig {
    let mut config = SimulationConfig::figure_eight(5);
    config.start_stamp_ns = start_stamp_ns;
    config.vehicle.steering_offset_rad = OFFSET_RAD;
    config.lidar = LidarOutput::Poses(PoseSettings::default());
    config
}

impl Driver {
    pub(super) fn new(bench: &Bench) -> Self {
        Self::with_clock(bench.clock.now().0)
    }

    /// Driver whose vehicle changes on the way.
    pub(super) fn with_changes(bench: &Bench, changes: Vec<ScheduledChange>) -> Self {
        let mut config = configuration(bench.clock.now().0);
        config.changes = changes;
        Self::of(config)
    }

    /// Driver whose message clock begins at this time.
    fn with_clock(start_stamp_ns: i64) -> Self {
        Self::of(configuration(start_stamp_ns))
    }

    fn of(config: SimulationConfig) -> Self {
        Self {
            simulation: Simulation::new(config).unwrap(),
            distance_m: 0.0,
            senders: 1,
        }
    }

    /// True values of this robot.
    pub(super) fn right_values(&self) -> CalibrationValues {
        let truth = self.simulation.parameters();
        CalibrationValues {
            steering_offset_rad: truth.steering_offset_rad,
            lidar_x_m: truth.lidar_in_base.x_m,
            lidar_y_m: truth.lidar_in_base.y_m,
            lidar_yaw_rad: truth.lidar_in_base.yaw_rad,
            ..CalibrationValues::default()
        }
    }

    /// Drives a second; the lifecycle then applies due commands.
    pub(super) async fn second(&mut self, bench: &Bench) {
        let mut sent = 0;
        for emitted in self.simulation.run(1.0) {
            let (stream, payload) = match &emitted.message {
                SimulatedMessage::WheelOdometry(drive) => {
                    self.distance_m += emitted.truth.speed_mps.abs() * 0.01;
                    (
                        Stream::WheelOdometry,
                        drive_message(drive).unwrap().to_cdr(),
                    )
                }
                SimulatedMessage::LidarPose(pose) => {
                    let message = lidar_pose_message(pose).unwrap();
                    (Stream::LidarOdometry, message.to_cdr())
                }
                _ => continue,
            };
            let arrived = Arrived {
                form: Encoding::Cdr.into(),
                origin: Some(Origin(sent % self.senders)),
            };
            let bytes = payload.len();
            let fleet = &bench.fleet;
            fleet.receive(&robot(), stream, arrived, bytes, || payload);
            sent += 1;
            if sent % BURST == 0 {
                taken(bench).await;
            }
        }
        taken(bench).await;
        bench.clock.advance(Duration::from_secs(1));
        bench.look().await;
    }

    pub(super) async fn metres(&mut self, bench: &Bench, metres: f64) {
        let end_m = self.distance_m + metres;
        while self.distance_m < end_m {
            self.second(bench).await;
        }
    }
}

/// Waits until the robot's task has processed all messages.
async fn taken(bench: &Bench) {
    while bench.fleet.robot(&robot()).unwrap().counters.waiting > 0 {
        tokio::time::sleep(Duration::from_millis(1)).await;
    }
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn what_was_learnt_of_two_senders_is_approved_by_nobody() {
    let bench = Bench::open(Policy::default()).await;
    let mut driver = Driver::new(&bench);
    let is_proposed = || bench.lifecycle.ledger(&robot()).open.is_some();
    for _ in 0..120 {
        if is_proposed() {
            break;
        }
        driver.second(&bench).await;
    }
    assert!(is_proposed());
    driver.senders = 2;
    driver.second(&bench).await;
    assert_eq!(bench.lifecycle.present(&robot()), Present::TwoSenders);
    assert!(!is_proposed());
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_robot_keeps_what_a_person_rolled_it_back_to_over_200_m() {
    let bench = Bench::open(Policy::default()).await;
    let mut driver = Driver::new(&bench);
    let (right, factory) = (driver.right_values(), values(0.0));
    let reported = Applied {
        generation: Generation(0),
        sha256: String::new(),
        status: AppliedStatus::Applied,
        reason: None,
        applied_at_ns: RobotTime(bench.clock.now().0),
        values: Some(factory),
    };
    let robot = robot();
    let actor = Actor::robot(&robot);
    let heard = bench.lifecycle.acknowledge(&robot, reported, actor);
    heard.await.unwrap();
    driver.second(&bench).await;
    bench.propose_values(right, None).await;
    bench.agree().await;
    bench.drive_in_verification().await;
    driver.metres(&bench, 90.0).await;
    assert_eq!(bench.latest().await.state, DeploymentState::Verified);

    // No earlier calibration was verified: it goes back to its factory values.
    bench.roll_back().await.unwrap();
    assert_eq!(bench.drive_in_verification().await, Generation(2));
    driver.metres(&bench, 210.0).await;

    let latest = bench.latest().await;
    assert_eq!(latest.state, DeploymentState::Kept);
    assert!(
        !latest.verification.as_ref().unwrap().within,
        "the estimate disagrees"
    );
    let asked = latest.roll_back.unwrap();
    assert_eq!(
        (asked.by.as_str(), asked.reason.as_str()),
        ("ana", "it weaves")
    );
    assert_eq!(asked.values, factory);
    let ledger = bench.lifecycle.ledger(&robot);
    assert_eq!(
        ledger.shadow.generation_last,
        Generation(2),
        "nothing else was sent"
    );
    assert!(ledger.shadow.in_sync());
    assert_eq!(ledger.shadow.in_use.as_ref().unwrap().values, factory);
}

/// Case of a scale of the LiDAR's ranges, which leaves its distance to the axle uncertain by 0.5 %,
/// but alike for the values in use and for those that verify them: an uncertainty beyond the
/// tolerance must not prevent verification.
#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn values_of_a_lidar_far_from_the_axle_are_verified() {
    let bench = Bench::open(Policy::default()).await;
    let mut config = configuration(bench.clock.now().0);
    config.vehicle.lidar_in_base.x_m = 1.2;
    let mut driver = Driver::of(config);
    driver.second(&bench).await;
    bench.propose_values(driver.right_values(), None).await;
    bench.agree().await;
    bench.drive_in_verification().await;
    driver.metres(&bench, 90.0).await;
    let latest = bench.latest().await;
    assert_eq!(latest.state, DeploymentState::Verified);
    let [_, sigma_x_m, ..] = latest.verification.as_ref().unwrap().sigma;
    assert!((1e-4..5e-3).contains(&sigma_x_m), "{sigma_x_m}");
}

/// Year, ns.
const YEAR_NS: i64 = 365 * 86_400 * 1_000_000_000;

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_robot_is_verified_whatever_its_message_clock_shows() {
    // Simulated time that begins at the epoch, no NTP since years, and a clock that is ahead.
    for start_ns in [
        |_| 1_000_000_000,
        |now| now - 5 * YEAR_NS,
        |now| now + YEAR_NS,
    ] as [fn(i64) -> i64; 3]
    {
        let bench = Bench::open(Policy::default()).await;
        let start_ns = start_ns(bench.clock.now().0);
        let mut driver = Driver::with_clock(start_ns);
        driver.second(&bench).await;
        bench.propose_values(driver.right_values(), None).await;
        bench.agree().await;
        bench.drive_in_verification().await;
        let before_m = driver.distance_m;
        driver.metres(&bench, 90.0).await;
        let latest = bench.latest().await;
        assert_eq!(latest.state, DeploymentState::Verified, "{start_ns}");
        let driven_m = latest.verification.as_ref().unwrap().distance_m;
        assert!(
            driven_m <= driver.distance_m - before_m,
            "what was driven before counts: {driven_m} m"
        );
    }
}
