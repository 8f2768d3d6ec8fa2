//! Robots that another instance takes on while they drive: the estimator has every message once.

use fleetcal_model::{Counts, Parameter};
use fleetcal_proto::ros::{LaserScan, Odometry, Pose, Quaternion};
use fleetcal_robot::simulator::{
    LidarOutput, PoseSettings, SimulatedMessage, Simulation, SimulationConfig,
};
use rand::rngs::StdRng;
use rand::{Rng, SeedableRng};

use super::cluster::Instance;
use super::*;

/// Largest difference of a sigma from that of the twin that was not moved, as a share of it.
const SIGMA_SHIFT_MAX: f64 = 0.05;
/// Largest difference of an estimate, in sigmas. A state holds neither the anchor of the filter nor
/// the readings that waited for their drive samples: a move costs some tenths of a second of
/// measurements.
const SHIFT_MAX: f64 = 0.15;

/// A message in flight.
#[derive(Clone)]
struct Sent {
    stream: Stream,
    payload: Vec<u8>,
    at_ns: i64,
}

fn header(stamp_ns: i64) -> Header {
    Header {
        stamp: Time::from_ns(stamp_ns).unwrap(),
        frame_id: "odom".to_owned(),
    }
}

/// Returns the messages of a simulated robot, in the order of sending.
fn sent(config: SimulationConfig, duration_s: f64) -> Vec<Sent> {
    let mut simulation = Simulation::new(config).unwrap();
    let emitted = simulation.run(duration_s).into_iter();
    let sent = emitted.filter_map(|one| {
        let (stream, payload) = match one.message {
            SimulatedMessage::WheelOdometry(sample) => {
                let message = AckermannDriveStamped {
                    header: header(sample.stamp_ns),
                    drive: AckermannDrive {
                        speed: sample.speed_mps as f32,
                        steering_angle: sample.steering_rad as f32,
                        ..AckermannDrive::default()
                    },
                };
                (Stream::WheelOdometry, message.to_cdr())
            }
            SimulatedMessage::LidarPose(pose) => {
                let mut message = Odometry {
                    header: header(pose.stamp_ns),
                    ..Odometry::default()
                };
                message.pose.pose = Pose {
                    orientation: Quaternion::from_yaw(pose.pose.yaw_rad),
                    ..Pose::default()
                };
                message.pose.pose.position.x = pose.pose.x_m;
                message.pose.pose.position.y = pose.pose.y_m;
                (Stream::LidarOdometry, message.to_cdr())
            }
            SimulatedMessage::Scan(scan) => {
                let message = LaserScan {
                    header: header(scan.stamp_ns),
                    angle_min: scan.angle_min_rad as f32,
                    angle_max: -scan.angle_min_rad as f32,
                    angle_increment: scan.angle_increment_rad as f32,
                    time_increment: scan.time_increment_s as f32,
                    scan_time: scan.scan_time_s as f32,
                    range_min: scan.range_min_m as f32,
                    range_max: scan.range_max_m as f32,
                    ranges: scan.ranges_m.into(),
                    intensities: Vec::new().into(),
                };
                (Stream::Scan, message.to_cdr())
            }
            SimulatedMessage::CrossTrackError(_) => return None,
        };
        Some(Sent {
            stream,
            payload,
            at_ns: one.sent_ns,
        })
    });
    sent.collect()
}

fn poses(seed: u64) -> SimulationConfig {
    let mut config = SimulationConfig::figure_eight(seed);
    config.vehicle.steering_offset_rad = 0.05;
    config.lidar = LidarOutput::Poses(PoseSettings::default());
    config
}

fn scans(seed: u64) -> SimulationConfig {
    let mut config = SimulationConfig::figure_eight(seed);
    config.vehicle.steering_offset_rad = 0.05;
    config
}

/// Sends the messages until a time to all of these, and waits for those that process them.
async fn send_until(to: &[&Bench], working: &[&Bench], left: &mut &[Sent], until_ns: i64) {
    while let Some((first, rest)) = left.split_first() {
        if first.at_ns > until_ns {
            return;
        }
        *left = rest;
        for bench in to {
            bench.send("robot", first.stream, &first.payload);
        }
        if first.stream != Stream::WheelOdometry {
            for bench in working {
                bench.worked_off("robot").await;
            }
        }
    }
}

/// Ends the robot's session: the merger releases its waiting events, and the state is stored.
async fn end_session(bench: &Bench) {
    let stored = || bench.kept.checkpointed.lock().unwrap().len();
    let before = stored();
    bench.clock.advance(limits::SESSION_ENDS_AFTER);
    for _ in 0..4_000 {
        if stored() > before {
            return;
        }
        tokio::time::sleep(Duration::from_millis(1)).await;
    }
    panic!("the session does not end");
}

/// Returns a robot's estimate after all messages were processed.
fn estimate(bench: &Bench) -> Arc<EstimateDocument> {
    bench.view("robot").estimate.unwrap()
}

/// Returns the largest differences of two estimates and of their sigmas, as shares of sigma.
fn shifts(a: &EstimateDocument, b: &EstimateDocument) -> [f64; 2] {
    let of = |name: Parameter| {
        let (a, b) = (a.parameters.get(name), b.parameters.get(name));
        let sigma = b.sigma.max(1e-12);
        [
            (a.value - b.value).abs() / sigma,
            (a.sigma - b.sigma).abs() / sigma,
        ]
    };
    let known = [
        Parameter::SteeringOffset,
        Parameter::LidarX,
        Parameter::LidarY,
        Parameter::LidarYaw,
        Parameter::SpeedScale,
    ];
    let both = known.map(of);
    [0, 1].map(|of| both.iter().map(|both| both[of]).fold(0.0, f64::max))
}

/// Result of a drive.
struct Driven {
    counts: Counts,
    twins: Counts,
    shifts: [f64; 2],
}

fn seconds(s: f64) -> i64 {
    (s * 1e9) as i64
}

/// Drives a robot that is moved at these seconds, beside a twin that stays where it is.
async fn drive_with_moves(all: &[Sent], moves_s: &[f64], chance: &mut StdRng) -> Driven {
    let twin = bench(&["robot"]);
    let instances = ["a", "b"].map(|name| Instance::new(name, &["robot"]));
    let [mut from, mut to] = [&instances[0], &instances[1]];
    from.adopt("robot", 1, None);
    let mut left = all;
    let begin_ns = all.first().unwrap().at_ns;
    for (number, at_s) in moves_s.iter().enumerate() {
        let at_ns = begin_ns + seconds(*at_s);
        let (own, twins) = (&from.bench, &twin);
        send_until(&[own, twins], &[own, twins], &mut left, at_ns).await;
        // Both hear the robot.
        to.bench.fleet.hear(&[id("robot")]);
        let all = [own, twins, &to.bench];
        let overlap_ns = at_ns + seconds(1.0 + chance.random_range(0.0..0.4));
        send_until(&all, &[own, twins], &mut left, overlap_ns).await;
        // What is on its way when the task ends waits in its mailbox.
        let waiting_ns = overlap_ns + seconds(chance.random_range(0.0..0.06));
        send_until(&all, &[twins], &mut left, waiting_ns).await;
        let stored = from.release("robot", Keep::State).await;
        // Nobody works until the state is read.
        let nobody_ns = waiting_ns + seconds(chance.random_range(0.0..2.0));
        send_until(&all, &[twins], &mut left, nobody_ns).await;
        to.adopt("robot", number as i64 + 2, stored);
        to.bench.worked_off("robot").await;
        to.bench.check_accounts("robot");
        (from, to) = (to, from);
    }
    let benches = [&from.bench, &twin];
    send_until(&benches, &benches, &mut left, i64::MAX).await;
    for bench in benches {
        bench.worked_off("robot").await;
        end_session(bench).await;
    }
    let (moved, undisturbed) = (estimate(&from.bench), estimate(&twin));
    Driven {
        counts: moved.counts,
        twins: undisturbed.counts,
        shifts: shifts(&moved, &undisturbed),
    }
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_drive_that_is_cut_by_a_move_has_every_message_once() {
    let mut worst = [0.0_f64; 2];
    for seed in 0..12 {
        let mut chance = StdRng::seed_from_u64(seed);
        let all = sent(poses(seed), 100.0);
        let at_s = chance.random_range(20.0..80.0);
        let driven = drive_with_moves(&all, &[at_s], &mut chance).await;
        let Driven {
            counts,
            twins,
            shifts: [shift, of_sigma],
        } = driven;
        println!("seed {seed}: moved at {at_s:.3} s, {shift:.4} and {of_sigma:.4} of sigma");
        assert_eq!(counts, twins, "seed {seed}, moved at {at_s} s");
        worst = [worst[0].max(shift), worst[1].max(of_sigma)];
    }
    println!("worst: {worst:?}");
    assert!(worst[0] <= SHIFT_MAX, "{worst:?} of sigma");
    assert!(worst[1] <= SIGMA_SHIFT_MAX, "{worst:?} of sigma");
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_robot_with_scans_is_moved_back_and_forth() {
    let mut chance = StdRng::seed_from_u64(7);
    let all = sent(scans(7), 90.0);
    let driven = drive_with_moves(&all, &[25.0, 40.0, 60.0], &mut chance).await;
    let Driven {
        counts,
        twins,
        shifts,
    } = driven;
    println!("moved three times: {shifts:?} of sigma, {counts:?}");
    assert_eq!(counts.drive_samples, twins.drive_samples);
    assert_eq!(counts.scans, twins.scans);
    assert_eq!((counts.late, counts.duplicates), (0, 0));
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn what_a_robot_sent_last_is_not_lost_when_it_stands_still() {
    let all = sent(poses(3), 30.0);
    let twin = bench(&["robot"]);
    let [a, b] = ["a", "b"].map(|name| Instance::new(name, &["robot"]));
    a.adopt("robot", 1, None);
    let mut left = &all[..];
    let benches = [&a.bench, &twin];
    send_until(&benches, &benches, &mut left, i64::MAX).await;
    // The next instance hears nothing of it any more.
    b.bench.fleet.hear(&[id("robot")]);
    a.bench.worked_off("robot").await;
    a.bench.clock.advance(limits::CLUSTER_OVERLAP);
    let stored = a.release("robot", Keep::State).await;
    b.adopt("robot", 2, stored);
    b.bench.restored("robot").await;
    end_session(&twin).await;
    assert_eq!(estimate(&b.bench).counts, estimate(&twin).counts);
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn who_takes_over_from_a_dead_instance_goes_on_from_what_that_stored() {
    let all = sent(poses(5), 160.0);
    let twin = bench(&["robot"]);
    let [a, b] = ["a", "b"].map(|name| Instance::new(name, &["robot"]));
    a.adopt("robot", 1, None);
    let begin_ns = all.first().unwrap().at_ns;
    let at = |second: f64| begin_ns + seconds(second);
    let mut left = &all[..];
    let driving = [&a.bench, &twin];
    send_until(&driving, &driving, &mut left, at(90.0)).await;
    let stored = {
        let checkpoints = a.bench.kept.checkpoints.lock().unwrap();
        checkpoints.get(&id("robot")).cloned()
    };
    let stored_at = *a.bench.kept.checkpointed.lock().unwrap().last().unwrap();
    // It is dead for six seconds, and the robot is heard by nobody.
    send_until(&[&twin], &[&twin], &mut left, at(96.0)).await;
    b.bench.fleet.hear(&[id("robot")]);
    send_until(&[&b.bench, &twin], &[&twin], &mut left, at(96.5)).await;
    b.adopt("robot", 2, stored);
    b.bench.worked_off("robot").await;
    let driving = [&b.bench, &twin];
    send_until(&driving, &driving, &mut left, i64::MAX).await;
    for bench in driving {
        bench.worked_off("robot").await;
        end_session(bench).await;
    }
    let (after, twins) = (estimate(&b.bench), estimate(&twin));
    let lost = twins.counts.drive_samples - after.counts.drive_samples;
    // What had left the merger when the state was stored is in it.
    let expected_s = RobotTime(at(96.0)).seconds_since(stored_at);
    let (lost_s, shifts) = (lost as f64 / 100.0, shifts(&after, &twins));
    println!("{lost_s:.2} s of messages are lost, {shifts:?} of sigma a minute later");
    assert!(
        (lost_s - expected_s).abs() < 0.7,
        "{lost_s} s, expected {expected_s} s"
    );
    assert_eq!((after.counts.late, after.counts.duplicates), (0, 0));
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn what_finds_no_room_before_a_task_begins_is_counted() {
    let a = Instance::new("a", &["robot"]);
    a.bench.fleet.hear(&[id("robot")]);
    let many = limits::HEARD_WHEEL_ODOMETRY_MAX as i64 + 100;
    for number in 0..many {
        a.bench.send("robot", Stream::WheelOdometry, &drive(number));
    }
    assert_eq!(
        a.bench.view("robot").counters.received,
        0,
        "it is another's"
    );
    a.adopt("robot", 1, None);
    a.bench.worked_off("robot").await;
    let counters = a.bench.view("robot").counters;
    assert_eq!(counters.dropped_wheel_odometry, 100);
    assert_eq!(counters.received, many as u64);
    a.bench.check_accounts("robot");
}
