//! The checks of one robot.

mod state;

use fleetcal_model::{Pose2, RobotTime, SpeedMeasuredAt, Stream, VehicleModel};
use fleetcal_odometry::Scan;
use fleetcal_odometry::lidar_odometry::{OdometryPose, Tracking};

use crate::cause::{Cause, Check};
use crate::finding::{Finding, Moment, Patience, Suspicion};
use crate::grid::{Channel, Grid};
use crate::motion::Motion;
use crate::naming::{self, Known};
use crate::pose_watch::PoseWatch;
use crate::scan_watch::ScanWatch;
use crate::stamps::AgeWatch;
use crate::steering_wrap::SteeringWrap;
use crate::stream::{StreamReport, StreamWatch, away_s};

/// The LiDAR's way from one look at the motion to the next, m: nearer ones while a cause is suspected.
const LOOK_EVERY_M: f64 = 5.0;
const LOOK_EVERY_SUSPECTED_M: f64 = 2.5;
/// Way of the wheels between two looks where the LiDAR stands, m.
const LOOK_EVERY_WHEELS_M: f64 = 5.0;
/// Time from one look at the streams or the motion to the next, s.
const LOOK_EVERY_S: f64 = 1.0;
/// Time of both streams from which their ages are compared, s, and messages of each.
const ALIGNED_AFTER_S: f64 = 3.0;
const ALIGNED_MESSAGES_MIN: u64 = 10;
/// Streams of which the ages differ by more are compared by arrival, s.
const ALIGN_MIN_S: f64 = 1.0;
/// Longest time between two poses that give a motion of the LiDAR, s.
const MOTION_GAP_MAX_S: f64 = 1.0;
/// Way over which a loss of LiDAR odometry may show in the motion, m.
const LOST_OF_LATE_M: f64 = 60.0;
/// Names of the vehicle's own frame.
const VEHICLE_FRAMES: [&str; 3] = ["base_link", "base_footprint", "base"];
/// Wait for a stream that does not come, s.
const MISSING_AFTER_S: f64 = 10.0;

/// The vehicle as it was described.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Described {
    /// Its steering geometry.
    pub model: VehicleModel,
    /// Place where its speed is measured.
    pub speed_measured_at: SpeedMeasuredAt,
    /// Distance between the axles, m.
    pub wheelbase_m: f64,
    /// Yaw of the LiDAR by the drawing, rad, where there is one.
    pub nominal_yaw_rad: Option<f64>,
}

/// Parts common to all messages.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Head<'m> {
    /// The stream that carries it.
    pub stream: Stream,
    /// Its header stamp.
    pub stamp: RobotTime,
    /// Name of its frame.
    pub frame: &'m str,
    /// Name of the frame that is at a pose, where the message states it.
    pub child_frame: Option<&'m str>,
    /// Time of arrival, ns, by a clock that is the same for all streams.
    pub arrival_ns: i64,
}

/// The checks of one robot, message by message.
#[derive(Debug, Clone)]
pub struct Checks {
    described: Described,
    streams: [Option<StreamWatch>; Stream::COUNT],
    began_ns: Option<i64>,
    now_ns: i64,
    looked_at_ns: i64,
    looked_at_motion_ns: i64,
    /// `true` if the streams are sound enough to judge the motion.
    is_sound: bool,
    ages: AgeWatch,
    scans: ScanWatch,
    poses: PoseWatch,
    /// Frame of the vehicle that poses name as theirs, of [`VEHICLE_FRAMES`].
    vehicle_frame: Option<&'static str>,
    wrap: SteeringWrap,
    /// Shift of the LiDAR's stamps, s, once it is known.
    aligned_s: Option<f64>,
    origin: Option<RobotTime>,
    grid: Grid,
    last_pose: Option<(RobotTime, Pose2)>,
    /// Way at which LiDAR odometry lost its way last, m.
    lost_at_m: Option<f64>,
    way_m: f64,
    wheels_way_m: f64,
    last_speed: Option<(RobotTime, f64)>,
    looked_way_m: f64,
    looked_wheels_way_m: f64,
    motion: Option<Motion>,
    patience: Patience,
    /// `true` if only the streams are looked at.
    rests: bool,
}

impl Checks {
    /// Checks of a vehicle that has sent nothing yet.
    pub fn new(described: Described) -> Self {
        Self {
            described,
            streams: Default::default(),
            began_ns: None,
            now_ns: 0,
            looked_at_ns: 0,
            looked_at_motion_ns: 0,
            is_sound: true,
            ages: AgeWatch::default(),
            scans: ScanWatch::default(),
            poses: PoseWatch::default(),
            vehicle_frame: None,
            wrap: SteeringWrap::default(),
            aligned_s: None,
            origin: None,
            grid: Grid::default(),
            last_pose: None,
            lost_at_m: None,
            way_m: 0.0,
            wheels_way_m: 0.0,
            last_speed: None,
            looked_way_m: 0.0,
            looked_wheels_way_m: 0.0,
            motion: None,
            patience: Patience::default(),
            rests: false,
        }
    }

    /// Adds speed, steering angle or both as they were sent, in whatever unit.
    pub fn take_wheels(&mut self, head: &Head<'_>, speed: Option<f64>, steering: Option<f64>) {
        self.arrive(head);
        if self.rests {
            return;
        }
        if let Some(speed) = speed.filter(|speed| speed.is_finite()) {
            self.ages.take(1, head.stamp, head.arrival_ns);
            if let Some((before, last)) = self.last_speed {
                let time_s = head
                    .stamp
                    .seconds_since(before)
                    .clamp(0.0, MOTION_GAP_MAX_S);
                self.wheels_way_m += 0.5 * (speed + last).abs() * time_s;
                self.scans.moved_to(self.wheels_way_m);
            }
            self.last_speed = Some((head.stamp, speed));
            if let Some(time_s) = self.grid_time_s(head.stamp) {
                self.grid.take(Channel::Speed, time_s, speed);
            }
        }
        if let Some(angle) = steering.filter(|angle| angle.is_finite()) {
            if self.wrap.take(angle) {
                self.grid.forget_steering();
            }
            if let Some(time_s) = self.grid_time_s(head.stamp) {
                // The checks know one geometry: of a wheel behind, the angle that a wheel in front has.
                let ahead_rad = self.described.model.steered_ahead() * self.wrap.unwrapped(angle);
                self.grid.take(Channel::Steering, time_s, ahead_rad);
            }
        }
        if self.wheels_way_m > self.looked_wheels_way_m + LOOK_EVERY_WHEELS_M {
            self.look_at_motion();
        }
    }

    /// Adds a scan, and the time from one scan to the next that it states, s (0 for none). Its pose
    /// follows by [`Checks::take_odometry`].
    pub fn take_scan(&mut self, head: &Head<'_>, scan: &Scan, scan_time_s: f64) {
        self.arrive(head);
        if self.rests {
            return;
        }
        self.ages.take(0, head.stamp, head.arrival_ns);
        self.scans.take(scan, scan_time_s);
    }

    /// Adds the pose of a scan by LiDAR odometry.
    pub fn take_odometry(&mut self, pose: &OdometryPose) {
        if self.rests {
            return;
        }
        if pose.tracking == Tracking::Lost || pose.map_restarted || pose.misled_by.is_some() {
            self.lose_motion();
            if pose.tracking == Tracking::Lost {
                return;
            }
        }
        self.move_to(pose.stamp, pose.lidar_in_odom);
    }

    /// Adds a pose that the robot sends for its LiDAR, and the tilt of the pose's z axis, rad.
    pub fn take_pose(&mut self, head: &Head<'_>, pose: Pose2, tilt_rad: f64) {
        self.arrive(head);
        let name = head.child_frame.and_then(|frame| frame.rsplit('/').next());
        let is_named = |frame: &&str| Some(*frame) == name;
        let vehicles = VEHICLE_FRAMES.into_iter().find(is_named);
        self.vehicle_frame = self.vehicle_frame.or(vehicles);
        if self.rests {
            return;
        }
        let is_finite = [pose.x_m, pose.y_m, pose.yaw_rad, tilt_rad]
            .into_iter()
            .all(f64::is_finite);
        if !is_finite {
            return;
        }
        self.ages.take(0, head.stamp, head.arrival_ns);
        let speed = self.last_speed.map_or(0.0, |(_, speed)| speed);
        self.poses.take(head.stamp, pose, tilt_rad, speed);
        self.move_to(head.stamp, pose);
    }

    /// Notes that a message was refused, with the reason.
    pub fn refuse(&mut self, stream: Stream, arrival_ns: i64, reason: &str) {
        self.pass_to(arrival_ns);
        if let Some(watch) = self.watch(stream, arrival_ns) {
            watch.refuse(reason);
        }
    }

    /// Returns the result of each check: every cause that is named, in the order of the checks, and one entry
    /// for each check that names none.
    pub fn findings(&self) -> Vec<Finding> {
        let named: Vec<Finding> = self.patience.named().collect();
        let mut findings = Vec::new();
        for check in Check::ALL {
            let of_check = named.iter().filter(|finding| finding.check == check);
            let before = findings.len();
            findings.extend(of_check.cloned());
            if findings.len() == before {
                findings.extend(self.unnamed(check));
            }
        }
        findings
    }

    /// Returns a report on each stream that came.
    pub fn streams(&self) -> Vec<StreamReport> {
        self.streams
            .iter()
            .flatten()
            .map(StreamWatch::report)
            .collect()
    }

    /// The LiDAR's way so far, m.
    pub fn way_m(&self) -> f64 {
        self.way_m
    }

    /// Time since the first message, by arrival, s.
    pub(crate) fn time_s(&self) -> f64 {
        self.moment().time_s
    }

    /// Returns `true` if a cause is named.
    pub(crate) fn names_a_cause(&self) -> bool {
        self.patience.named().next().is_some()
    }

    /// Time since the last message of a stream, s; `None` before the first.
    pub(crate) fn quiet_s(&self, stream: Stream, now_ns: i64) -> Option<f64> {
        let watch = self.of(&[stream])?;
        Some(away_s(watch.last_arrival_ns, now_ns))
    }

    /// Looks at the streams alone from now on.
    pub(crate) fn rest(&mut self) {
        self.rests = true;
    }

    /// Returns `true` if only the streams are looked at.
    pub(crate) const fn rests(&self) -> bool {
        self.rests
    }

    /// Bytes held for this robot.
    pub fn memory_bytes(&self) -> usize {
        let streams = self.streams.iter().flatten().map(StreamWatch::memory_bytes);
        size_of::<Self>()
            + streams.sum::<usize>()
            + self.grid.memory_bytes()
            + self.scans.memory_bytes()
            + self.ages.memory_bytes()
            + self.patience.memory_bytes()
    }

    fn watch(&mut self, stream: Stream, arrival_ns: i64) -> Option<&mut StreamWatch> {
        let place = self.streams.get_mut(stream.index())?;
        Some(place.get_or_insert_with(|| StreamWatch::new(stream, arrival_ns)))
    }

    fn arrive(&mut self, head: &Head<'_>) {
        self.pass_to(head.arrival_ns);
        if let Some(watch) = self.watch(head.stream, head.arrival_ns) {
            watch.take(head.stamp, head.frame, head.arrival_ns);
        }
        if self.aligned_s.is_none() {
            self.aligned_s = self.alignment_s();
        }
    }

    /// Looks at the streams when it is time.
    fn pass_to(&mut self, arrival_ns: i64) {
        self.began_ns.get_or_insert(arrival_ns);
        self.now_ns = self.now_ns.max(arrival_ns);
        if away_s(self.looked_at_ns, self.now_ns) < LOOK_EVERY_S {
            return;
        }
        self.looked_at_ns = self.now_ns;
        let found = self.stream_suspicions();
        self.is_sound = !found.iter().any(|of| of.cause.spoils_motion());
        self.patience
            .look(self.moment(), |cause| !is_of_motion(cause), found);
    }

    fn moment(&self) -> Moment {
        Moment {
            way_m: self
                .way_m
                .max(self.wheels_way_m.min(self.way_m + LOOK_EVERY_M)),
            time_s: away_s(self.began_ns.unwrap_or_default(), self.now_ns),
        }
    }

    fn of(&self, streams: &[Stream]) -> Option<&StreamWatch> {
        let of = |stream: &Stream| self.streams.get(stream.index())?.as_ref();
        streams.iter().find_map(of)
    }

    fn lidar(&self) -> Option<&StreamWatch> {
        self.of(&[Stream::Scan, Stream::LidarOdometry])
    }

    fn wheels(&self) -> Option<&StreamWatch> {
        self.of(&[Stream::WheelOdometry, Stream::Speed])
    }

    /// Returns the shift of the LiDAR's stamps, once both streams have come for long enough.
    fn alignment_s(&self) -> Option<f64> {
        let (lidar, wheels) = (self.lidar()?, self.wheels()?);
        let enough = |watch: &StreamWatch| watch.messages >= ALIGNED_MESSAGES_MIN;
        let time_s = away_s(self.began_ns?, self.now_ns);
        if time_s < ALIGNED_AFTER_S || !enough(lidar) || !enough(wheels) {
            return None;
        }
        let apart_s = self.ages.apart_s()?;
        Some(if apart_s.abs() > ALIGN_MIN_S {
            apart_s
        } else {
            0.0
        })
    }

    /// Time in the grid of a stamp of the wheels.
    fn grid_time_s(&mut self, stamp: RobotTime) -> Option<f64> {
        self.aligned_s?;
        Some(stamp.seconds_since(*self.origin.get_or_insert(stamp)))
    }

    fn lose_motion(&mut self) {
        let Some((stamp, _)) = self.last_pose.take() else {
            return;
        };
        self.lost_at_m = Some(self.way_m);
        if let Some(aligned_s) = self.aligned_s
            && let Some(time_s) = self.grid_time_s(stamp.plus_seconds(aligned_s))
        {
            self.grid.lose_motion(None, time_s);
        }
    }

    fn move_to(&mut self, stamp: RobotTime, pose: Pose2) {
        let Some((before, last)) = self.last_pose.replace((stamp, pose)) else {
            return;
        };
        let time_s = stamp.seconds_since(before);
        if time_s <= 0.0 || time_s > MOTION_GAP_MAX_S {
            return;
        }
        let step = last.between(&pose).log();
        self.way_m += step.x.hypot(step.y);
        self.scans.moved_to(self.way_m);
        self.scans.turned_to(pose.yaw_rad);
        let Some(aligned_s) = self.aligned_s else {
            return;
        };
        let from = self.grid_time_s(before.plus_seconds(aligned_s));
        let to = self.grid_time_s(stamp.plus_seconds(aligned_s));
        if let (Some(from_s), Some(to_s)) = (from, to) {
            let velocity = [step.x, step.y, step.z].map(|length| length / time_s);
            self.grid.take_motion(from_s, to_s, velocity);
        }
        let way_m = if self.patience.suspects() {
            LOOK_EVERY_SUSPECTED_M
        } else {
            LOOK_EVERY_M
        };
        if self.way_m > self.looked_way_m + way_m {
            self.look_at_motion();
        }
    }

    fn look_at_motion(&mut self) {
        if away_s(self.looked_at_motion_ns, self.now_ns) < LOOK_EVERY_S {
            return;
        }
        self.looked_at_motion_ns = self.now_ns;
        self.looked_way_m = self.way_m;
        self.looked_wheels_way_m = self.wheels_way_m;
        if !self.is_sound {
            return;
        }
        let Some(motion) = Motion::of(&self.grid, self.described.wheelbase_m) else {
            return;
        };
        let known = Known {
            is_at_steered_wheel: self.described.speed_measured_at == SpeedMeasuredAt::SteeredWheel,
            wheelbase_m: self.described.wheelbase_m,
            nominal_yaw_rad: self.described.nominal_yaw_rad,
            aligned_s: self.aligned_s.unwrap_or_default(),
            way_m: self.way_m,
            wheels_way_m: self.wheels_way_m,
            lost_its_way: self
                .lost_at_m
                .is_some_and(|at_m| self.way_m - at_m < LOST_OF_LATE_M),
            sends_poses: self.of(&[Stream::LidarOdometry]).is_some(),
        };
        let found = naming::suspicions(&motion, &known);
        self.motion = Some(motion);
        self.patience.look(self.moment(), is_of_motion, found);
    }

    /// Returns the suspicions from streams and messages, without any motion.
    fn stream_suspicions(&self) -> Vec<Suspicion> {
        let mut found: Vec<Suspicion> = Vec::new();
        for watch in self.streams.iter().flatten() {
            found.extend(watch.suspicions());
        }
        found.extend(self.missing());
        found.extend(self.ages.suspicion());
        let lidar = self.lidar();
        let frames = found
            .iter()
            .filter(|of| of.cause == Cause::SeveralFrames)
            .count();
        found.extend(
            self.scans
                .suspicion(lidar.and_then(|of| of.stamps.period_s()), frames == 0),
        );
        let repeats_scans = found.iter().any(|of| of.cause == Cause::RepeatedScans);
        found.retain(|of| !(repeats_scans && of.cause == Cause::ReceptionStamps));
        if !found.iter().any(|of| of.cause.spoils_motion()) {
            found.extend(self.poses.suspicions());
        }
        found.extend(self.pose_frame());
        if let Some(turn) = self.wrap.turn() {
            let seen =
                format!("angles run from 0 to {turn:.4}: those to the right come as nearly that");
            found.push(Suspicion::new(Cause::SteeringWrap, seen));
        }
        let repeats = found.iter().any(|of| of.cause == Cause::RepeatedStamps);
        let aligned_s = self
            .aligned_s
            .filter(|shift_s| shift_s.abs() > ALIGN_MIN_S && !repeats);
        // Once the motion tells how far clocks are apart, it decides.
        if let Some(apart_s) =
            aligned_s.filter(|_| self.motion.as_ref().is_none_or(|of| of.steering.is_none()))
        {
            let seen = format!(
                "scans are stamped {:+.2} s against wheels that arrive with them{}",
                -apart_s,
                naming::explanation(apart_s)
            );
            found.push(Suspicion::new(Cause::StampsApart, seen));
        }
        // Of one cause there is one word, of the stream that shows it first.
        found.sort_by_key(|of| of.cause.index());
        found.dedup_by_key(|of| of.cause);
        found
    }

    /// Poses that name the vehicle's frame, unless they move otherwise or are found to be the rear axle's.
    fn pose_frame(&self) -> Option<Suspicion> {
        let frame = self.vehicle_frame?;
        let mount = self.motion.as_ref().and_then(|motion| motion.mount);
        let is_elsewhere = mount.is_some_and(|mount| naming::is_off_centre(&mount));
        let is_base = |finding: Finding| finding.cause == Some(Cause::BasePose);
        if is_elsewhere || self.patience.named().any(is_base) {
            return None;
        }
        let seen = format!("the poses name {frame}, and stand for the LiDAR");
        Some(Suspicion::new(Cause::PoseFrame, seen))
    }

    fn missing(&self) -> Vec<Suspicion> {
        let since_s = |watch: Option<&StreamWatch>| {
            let last_ns = watch.map_or(self.began_ns.unwrap_or_default(), |of| of.last_arrival_ns);
            away_s(last_ns, self.now_ns)
        };
        let of_stream = |stream| self.of(&[stream]);
        let (speed, steering) = (of_stream(Stream::Speed), of_stream(Stream::Steering));
        // Without one of the halves there is no sample.
        let (wheels, wheels_s) = match of_stream(Stream::WheelOdometry) {
            None if speed.is_some() || steering.is_some() => {
                let (speed_s, steering_s) = (since_s(speed), since_s(steering));
                let what = if speed_s < steering_s {
                    "steering angle"
                } else {
                    "speed"
                };
                (what, speed_s.max(steering_s))
            }
            whole => ("wheel odometry", since_s(whole)),
        };
        let lidar_s = since_s(self.lidar());
        let seen = |what: &str, away_s: f64| format!("no {what} for {away_s:.0} s");
        let mut found = Vec::new();
        if wheels_s > MISSING_AFTER_S {
            found.push(Suspicion::new(
                Cause::WheelOdometryMissing,
                seen(wheels, wheels_s),
            ));
        }
        if lidar_s > MISSING_AFTER_S {
            found.push(Suspicion::new(
                Cause::LidarMissing,
                seen("scan or pose of the LiDAR", lidar_s),
            ));
        }
        found
    }
}

/// Returns `true` if a cause is looked for in the motion, `false` if in the streams.
fn is_of_motion(cause: Cause) -> bool {
    match cause.check() {
        Check::Streams | Check::Stamps | Check::Scan => false,
        Check::Clocks => cause != Cause::StampsApart,
        Check::Steering => cause != Cause::SteeringWrap,
        Check::Pose => cause == Cause::BasePose,
        Check::Speed | Check::Wheelbase | Check::Model | Check::Delay | Check::Vehicle => true,
    }
}

#[cfg(test)]
mod tests;
