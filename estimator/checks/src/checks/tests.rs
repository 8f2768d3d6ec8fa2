//! Streams that end, begin late or carry what is no number.

use super::*;
use crate::finding::State;

const S_NS: i64 = 1_000_000_000;

/// Checks, and the time until which messages were taken, ds.
struct Case {
    checks: Checks,
    now_ds: i64,
}

impl Case {
    fn new() -> Self {
        Self {
            checks: Checks::new(Described {
                model: VehicleModel::Bicycle,
                speed_measured_at: SpeedMeasuredAt::RearAxle,
                wheelbase_m: 1.2,
                nominal_yaw_rad: None,
            }),
            now_ds: 0,
        }
    }

    /// Ten messages a second of these streams, for so many seconds.
    fn send(&mut self, streams: &[Stream], lasts_s: i64) -> &mut Self {
        for _ in 0..10 * lasts_s {
            self.now_ds += 1;
            let stamp = RobotTime(1_000 * S_NS + self.now_ds * S_NS / 10);
            for stream in streams.iter().copied() {
                let head = Head {
                    stream,
                    stamp,
                    frame: "",
                    child_frame: None,
                    arrival_ns: stamp.0,
                };
                match stream {
                    Stream::Steering => self.checks.take_wheels(&head, None, Some(0.0)),
                    Stream::Speed => self.checks.take_wheels(&head, Some(0.0), None),
                    Stream::LidarOdometry => {
                        self.checks.take_pose(&head, Pose2::default(), 0.0);
                    }
                    _ => self.checks.take_wheels(&head, Some(0.0), Some(0.0)),
                }
            }
        }
        self
    }

    /// Causes that are named, each with what was seen.
    fn named(&self) -> Vec<(Cause, String)> {
        let findings = self.checks.findings().into_iter();
        findings
            .filter_map(|finding| Some((finding.cause?, finding.seen)))
            .collect()
    }
}

#[test]
fn steering_that_ends_is_named_though_the_speed_goes_on() {
    let mut case = Case::new();
    let both = [Stream::Speed, Stream::Steering, Stream::LidarOdometry];
    assert_eq!(case.send(&both, 30).named(), []);
    case.send(&[Stream::Speed, Stream::LidarOdometry], 30);
    let [(cause, seen)] = &case.named()[..] else {
        panic!("{:?}", case.named());
    };
    assert_eq!(*cause, Cause::WheelOdometryMissing);
    assert!(seen.starts_with("no steering angle for"), "{seen}");
}

#[test]
fn a_lidar_that_begins_late_is_missing_until_then() {
    let mut case = Case::new();
    case.send(&[Stream::WheelOdometry], 30);
    assert_eq!(case.named()[0].0, Cause::LidarMissing);
    let both = [Stream::WheelOdometry, Stream::LidarOdometry];
    assert_eq!(case.send(&both, 10).named(), []);
}

#[test]
fn a_pose_that_is_no_number_spoils_nothing() {
    let mut case = Case::new();
    let both = [Stream::WheelOdometry, Stream::LidarOdometry];
    case.send(&both, 5);
    let head = Head {
        stream: Stream::LidarOdometry,
        stamp: RobotTime(1_005 * S_NS),
        frame: "",
        child_frame: None,
        arrival_ns: 1_005 * S_NS,
    };
    let pose = Pose2 {
        x_m: f64::NAN,
        ..Pose2::default()
    };
    case.checks.take_pose(&head, pose, 0.0);
    case.send(&both, 5);
    assert!(case.checks.way_m().is_finite());
}

/// Names what is wrong with a vehicle of a wheelbase of 1.2 m that drives bends to both sides,
/// mostly backwards, with its steered wheel behind the fixed axle or before it.
fn causes_of(model: VehicleModel, is_behind: bool) -> Vec<Cause> {
    let lidar_in_base = Pose2::new(-0.3, 0.05, 0.02);
    let named = driven(model, is_behind, &lidar_in_base, "lidar", 90);
    named.into_iter().map(|(_, cause)| cause).collect()
}

/// Names what is wrong with that vehicle, its poses being of a frame at a place on it, after so many
/// seconds.
fn driven(
    model: VehicleModel,
    is_behind: bool,
    lidar_in_base: &Pose2,
    frame: &str,
    lasts_s: i64,
) -> Vec<(State, Cause)> {
    let mut checks = Checks::new(Described {
        model,
        speed_measured_at: SpeedMeasuredAt::RearAxle,
        wheelbase_m: 1.2,
        nominal_yaw_rad: None,
    });
    let (mut x_m, mut y_m, mut yaw_rad) = (0.0_f64, 0.0_f64, 0.0_f64);
    for tick in 0..100 * lasts_s {
        let time_s = tick as f64 * 0.01;
        let speed_mps = -0.9 + 0.3 * (time_s / 7.0).sin();
        let wheel_rad = 0.4 * (time_s / 2.5).sin();
        // A wheel at (at, 0) moves along (v, at w).
        let at_m = if is_behind { -1.2 } else { 1.2 };
        let yaw_rate_radps = speed_mps * wheel_rad.tan() / at_m;
        x_m += 0.01 * speed_mps * yaw_rad.cos();
        y_m += 0.01 * speed_mps * yaw_rad.sin();
        yaw_rad += 0.01 * yaw_rate_radps;
        let stamp = RobotTime(1_000 * S_NS + tick * S_NS / 100);
        let head = |stream| Head {
            stream,
            stamp,
            frame: "base_link",
            child_frame: Some(frame).filter(|_| stream == Stream::LidarOdometry),
            arrival_ns: stamp.0,
        };
        if tick % 2 == 0 {
            let head = head(Stream::WheelOdometry);
            checks.take_wheels(&head, Some(speed_mps), Some(wheel_rad));
        }
        if tick % 10 == 0 {
            let pose = Pose2::new(x_m, y_m, yaw_rad).compose(lidar_in_base);
            checks.take_pose(&head(Stream::LidarOdometry), pose, 0.0);
        }
    }
    let findings = checks.findings().into_iter();
    let named = findings.filter_map(|finding| Some((finding.state, finding.cause?)));
    named.collect()
}

#[test]
fn poses_that_name_the_vehicle_are_doubted_until_they_move_otherwise() {
    let named = |x_m, y_m, frame, lasts_s| {
        let lidar_in_base = Pose2::new(x_m, y_m, 0.0);
        driven(VehicleModel::Bicycle, false, &lidar_in_base, frame, lasts_s)
    };
    let doubted = [(State::Unsure, Cause::PoseFrame)];
    assert_eq!(named(0.4, 0.0, "lidar", 90), []);
    assert_eq!(named(0.4, 0.0, "base_link", 90), doubted);
    assert_eq!(named(0.4, 0.0, "robot/base_footprint", 90), doubted);
    // A LiDAR beside the middle line shows itself by its motion.
    assert_eq!(named(0.4, 0.15, "base_link", 10), doubted);
    assert_eq!(named(0.4, 0.15, "base_link", 90), []);
    // The rear axle's own pose is certain.
    let certain = [(State::Wrong, Cause::BasePose)];
    assert_eq!(named(0.0, 0.0, "base_link", 90), certain);
}

#[test]
fn a_steered_axle_at_the_other_end_than_described_is_named() {
    let sign = [Cause::SteeringSign];
    assert_eq!(causes_of(VehicleModel::RearSteered, true), []);
    assert_eq!(causes_of(VehicleModel::Bicycle, false), []);
    assert_eq!(causes_of(VehicleModel::Bicycle, true), sign);
    assert_eq!(causes_of(VehicleModel::RearSteered, false), sign);
}
