//! Checks of a robot for as long as it sends: runs, with rests between them while nothing is wrong.

use fleetcal_model::{Pose2, Stream};
use fleetcal_odometry::Scan;
use fleetcal_odometry::lidar_odometry::OdometryPose;

use crate::cause::Check;
use crate::checks::{Checks, Described, Head};
use crate::finding::{Finding, State};
use crate::stream::StreamReport;

/// Time and way after which a run is over, s and m.
const RUN_S: f64 = 60.0;
const RUN_M: f64 = 100.0;
/// Time after which a run that names a cause is over, whatever the way, s.
const NAMED_RUN_S: f64 = 180.0;
/// Longest rest after a run that names nothing, s.
const REST_S: f64 = 3_600.0;
/// A stream that was silent for longer may come from another driver now, s.
const PAUSE_S: f64 = 3.0;
/// Time after which a run's own result of a check that needs no motion holds, s, and way for the others, m.
const SETTLED_S: f64 = 30.0;
const SETTLED_M: f64 = 60.0;

/// The checks of one robot, run after run.
///
/// A cause stays named until a later run finds its check ok. Between runs that name nothing only the
/// streams are looked at, for an hour at most, or until a stream pauses or one of them is wrong.
#[derive(Debug, Clone)]
pub struct Watch {
    described: Described,
    run: Checks,
    /// Results until the run has its own.
    former: Vec<Finding>,
    /// Streams of the runs before.
    streams_before: Vec<StreamReport>,
    way_before_m: f64,
    /// Time in the run at which the rest began, s.
    rested_at_s: f64,
}

impl Watch {
    /// A watch of a vehicle that has sent nothing yet, with the causes that were named before.
    pub fn new(described: Described, former: Vec<Finding>) -> Self {
        Self {
            described,
            run: Checks::new(described),
            former,
            streams_before: Vec::new(),
            way_before_m: 0.0,
            rested_at_s: 0.0,
        }
    }

    /// Takes speed, steering angle or both, as [`Checks::take_wheels`] does.
    pub fn take_wheels(&mut self, head: &Head<'_>, speed: Option<f64>, steering: Option<f64>) {
        self.turn(head.stream, head.arrival_ns);
        self.run.take_wheels(head, speed, steering);
    }

    /// Takes a scan, as [`Checks::take_scan`] does.
    pub fn take_scan(&mut self, head: &Head<'_>, scan: &Scan, scan_time_s: f64) {
        self.turn(head.stream, head.arrival_ns);
        self.run.take_scan(head, scan, scan_time_s);
    }

    /// Takes the pose that LiDAR odometry gives a scan.
    pub fn take_odometry(&mut self, pose: &OdometryPose) {
        self.run.take_odometry(pose);
    }

    /// Takes a pose that the robot sends, as [`Checks::take_pose`] does.
    pub fn take_pose(&mut self, head: &Head<'_>, pose: Pose2, tilt_rad: f64) {
        self.turn(head.stream, head.arrival_ns);
        self.run.take_pose(head, pose, tilt_rad);
    }

    /// Notes that a message was refused, and why.
    pub fn refuse(&mut self, stream: Stream, arrival_ns: i64, reason: &str) {
        self.turn(stream, arrival_ns);
        self.run.refuse(stream, arrival_ns, reason);
    }

    /// Returns the result of each check, in their order: that of the run, or that of the run before until then.
    pub fn findings(&self) -> Vec<Finding> {
        let of_run = self.run.findings();
        let mut findings = Vec::new();
        for check in Check::ALL {
            let of = |all: &[Finding]| -> Vec<Finding> {
                let mut of_check = all.to_vec();
                of_check.retain(|finding| finding.check == check);
                of_check
            };
            let (now, before) = (of(&of_run), of(&self.former));
            let holds = before.is_empty() || self.is_settled(check, &now);
            findings.extend(if holds { now } else { before });
        }
        findings
    }

    /// Returns a report on each stream that came: counts of all runs, and the stamps of the last.
    pub fn streams(&self) -> Vec<StreamReport> {
        let mut streams = self.run.streams();
        for before in &self.streams_before {
            match streams.iter_mut().find(|one| one.stream == before.stream) {
                Some(now) => now.add(before),
                None => streams.push(StreamReport {
                    rate_hz: 0.0,
                    ..before.clone()
                }),
            }
        }
        streams.sort_by_key(|one| one.stream.index());
        streams
    }

    /// The LiDAR's way while it was looked at, m.
    pub fn way_m(&self) -> f64 {
        self.way_before_m + self.run.way_m()
    }

    /// Returns `true` while only the streams are looked at.
    pub const fn rests(&self) -> bool {
        self.run.rests()
    }

    /// Bytes held for this robot.
    pub fn memory_bytes(&self) -> usize {
        let former: usize = self.former.iter().map(|one| one.seen.capacity()).sum();
        let frames = |one: &StreamReport| one.frames.iter().map(String::capacity).sum::<usize>();
        let streams: usize = self.streams_before.iter().map(frames).sum();
        size_of::<Self>() - size_of::<Checks>()
            + self.run.memory_bytes()
            + self.former.capacity() * size_of::<Finding>()
            + former
            + self.streams_before.capacity() * size_of::<StreamReport>()
            + streams
    }

    /// Returns `true` if the run's own result of a check holds against the one before.
    fn is_settled(&self, check: Check, now: &[Finding]) -> bool {
        let is_named = now.iter().any(|finding| finding.cause.is_some());
        let is_open = now.iter().any(|finding| finding.state == State::NotYet);
        let is_due = self.run.time_s() >= SETTLED_S
            && (!check.needs_motion() || self.run.way_m() >= SETTLED_M);
        is_named || is_due && !is_open
    }

    /// Begins a run or a rest where it is time, before a message of a stream is taken.
    fn turn(&mut self, stream: Stream, arrival_ns: i64) {
        let time_s = self.run.time_s();
        if self.run.rests() {
            let quiet_s = self.run.quiet_s(stream, arrival_ns);
            let is_other = quiet_s.is_none_or(|quiet_s| quiet_s > PAUSE_S);
            if is_other || self.run.names_a_cause() || time_s > self.rested_at_s + REST_S {
                self.begin_run();
            }
            return;
        }
        let is_over = time_s >= RUN_S && self.run.way_m() >= RUN_M;
        if !(is_over || time_s >= NAMED_RUN_S && self.run.names_a_cause()) {
            return;
        }
        if self.findings().iter().any(|one| one.cause.is_some()) {
            self.begin_run();
        } else {
            self.former.clear();
            self.rested_at_s = time_s;
            self.run.rest();
        }
    }

    fn begin_run(&mut self) {
        self.former = self.findings();
        self.streams_before = self.streams();
        self.way_before_m = self.way_m();
        self.run = Checks::new(self.described);
    }
}

#[cfg(test)]
mod tests {
    use fleetcal_model::{RobotTime, SpeedMeasuredAt, VehicleModel};

    use super::*;
    use crate::cause::Cause;

    /// A robot that sends poses of its LiDAR, 20 a second, at about 1 m/s.
    struct Robot {
        watch: Watch,
        time_s: f64,
        base: Pose2,
    }

    impl Robot {
        fn new() -> Self {
            let described = Described {
                model: VehicleModel::Bicycle,
                speed_measured_at: SpeedMeasuredAt::RearAxle,
                wheelbase_m: 1.2,
                nominal_yaw_rad: None,
            };
            Self {
                watch: Watch::new(described, Vec::new()),
                time_s: 0.0,
                base: Pose2::IDENTITY,
            }
        }

        /// Drives for a time with speeds in this unit.
        fn drive(&mut self, for_s: f64, unit: f64) {
            let end_s = self.time_s + for_s;
            while self.time_s < end_s {
                self.time_s += 0.05;
                let arrival_ns = (self.time_s * 1e9) as i64;
                let head = |stream| Head {
                    stream,
                    stamp: RobotTime(arrival_ns),
                    frame: "",
                    child_frame: None,
                    arrival_ns,
                };
                let speed_mps = 1.0 + 0.4 * (0.7 * self.time_s).sin();
                let curve = 0.4 * (0.3 * self.time_s).sin();
                let step_m = 0.05 * speed_mps;
                let step = Pose2::new(step_m, 0.0, curve * step_m);
                self.base = self.base.compose(&step);
                let pose = self.base.compose(&Pose2::new(0.5, 0.1, 0.02));
                let (speed, steering) = (Some(unit * speed_mps), Some((1.2 * curve).atan()));
                self.watch
                    .take_wheels(&head(Stream::WheelOdometry), speed, steering);
                self.watch
                    .take_pose(&head(Stream::LidarOdometry), pose, 0.0);
            }
        }

        fn causes(&self) -> Vec<Cause> {
            let findings = self.watch.findings();
            findings.iter().filter_map(|one| one.cause).collect()
        }
    }

    #[test]
    fn a_cause_stays_until_a_later_run_finds_its_check_ok() {
        let mut robot = Robot::new();
        robot.drive(120.0, 3.6);
        assert_eq!(robot.causes(), [Cause::SpeedUnit]);
        robot.drive(40.0, 3.6);
        assert_eq!(robot.causes(), [Cause::SpeedUnit]);
        let messages = |robot: &Robot| robot.watch.streams()[0].messages;
        let before = messages(&robot);
        robot.drive(250.0, 1.0);
        assert_eq!(robot.causes(), []);
        assert!(robot.watch.rests());
        assert!(messages(&robot) > before + 4_900);
    }

    #[test]
    fn a_robot_that_is_right_is_looked_at_again_after_a_rest_or_a_pause() {
        let mut robot = Robot::new();
        robot.drive(99.0, 1.0);
        assert!(!robot.watch.rests());
        robot.drive(5.0, 1.0);
        assert!(robot.watch.rests());
        robot.time_s += 5.0;
        robot.drive(1.0, 1.0);
        assert!(!robot.watch.rests());
        robot.drive(110.0, 1.0);
        assert!(robot.watch.rests());
        robot.drive(REST_S, 1.0);
        assert!(!robot.watch.rests());
        robot.drive(110.0, 3.6);
        assert_eq!(robot.causes(), [Cause::SpeedUnit]);
        assert!(robot.watch.memory_bytes() < 20_000);
    }

    #[test]
    fn a_cause_that_was_named_before_holds_until_the_check_is_ok() {
        let mut robot = Robot::new();
        let former = vec![Finding::named_before(Cause::SpeedUnit, String::new())];
        robot.watch = Watch::new(robot.watch.described, former);
        robot.drive(50.0, 1.0);
        assert_eq!(robot.causes(), [Cause::SpeedUnit]);
        robot.drive(20.0, 1.0);
        assert_eq!(robot.causes(), []);
    }
}
