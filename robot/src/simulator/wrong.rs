//! Wrong inputs: what integrators do to the messages of a robot that is right.

use std::collections::VecDeque;
use std::f64::consts::{FRAC_PI_2, TAU};

use rand::Rng;
use rand_chacha::ChaCha8Rng;

use super::check::SettingRefused;
use super::config::{LidarOutput, SimulationConfig};
use super::message::{DriveSample, Emitted, LidarPose, Scan, SimulatedMessage};
use super::plane::Pose2;
use super::pose_sensor::PoseSettings;
use super::random::{Stream, stream};
use super::route::Route;
use super::simulation::Simulation;
use fleetcal_model::VehicleModel;

/// Time of the drive after which what happens once happens, s.
pub const HAPPENS_AFTER_S: f64 = 20.0;
/// Ratio of a steering column, and radius of a wheel, m.
const COLUMN: f64 = 14.8;
const WHEEL_RADIUS_M: f64 = 0.15;
/// Lead of a command before the wheel, and time constant of a filtered angle, s.
const COMMAND_AHEAD_S: f64 = 0.25;
const FILTER_S: f64 = 0.4;
/// Half the track over the wheelbase of a linkage.
const LINKAGE: f64 = 0.375;
/// Speed below which a blind encoder shows none, m/s.
const BLIND_MPS: f64 = 0.8;
/// Segments of a turn.
const SEGMENTS: usize = 12;
/// Spread of stamps that are made on reception, s.
const RECEPTION_S: f64 = 0.16;

macro_rules! wrong_inputs {
    ($($input:ident, $name:literal, $doc:literal;)+) => {
        /// One wrong input.
        #[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
        pub enum WrongInput {
            $(#[doc = $doc] $input,)+
        }

        impl WrongInput {
            /// All of them.
            pub const ALL: &'static [Self] = &[$(Self::$input,)+];

            /// Its name, as `--wrong` takes it.
            pub const fn name(self) -> &'static str {
                match self {
                    $(Self::$input => $name,)+
                }
            }

            /// Its description in words.
            pub const fn words(self) -> &'static str {
                match self {
                    $(Self::$input => $doc,)+
                }
            }
        }
    };
}

wrong_inputs! {
    SteeringSign, "steering_sign", "Steering angle positive to the right, or the steered axle at the rear";
    SpeedSign, "speed_sign", "Speed positive in reverse";
    BothSigns, "both_signs", "Both signs wrong";
    MirroredScan, "mirrored_scan", "Scanner upside down";
    Degrees, "degrees", "Steering angle in degrees";
    Column, "column", "Angle of a steering column, 14.8 times that of the wheel";
    Gear, "gear", "Angle of a shaft that turns twice as far as the wheel";
    QuarterTurn, "quarter_turn", "Steering angle 90° straight ahead";
    WrappedRadians, "wrapped_radians", "Steering angle from 0 to 2π";
    WrappedDegrees, "wrapped_degrees", "Steering angle from 0 to 360°";
    KilometresPerHour, "km_h", "Speed in km/h";
    MillimetresPerSecond, "mm_s", "Speed in mm/s";
    WheelRadians, "wheel_rad_s", "Speed in rad/s of the wheel";
    Diameter, "diameter", "Wheel's diameter taken for its radius";
    UnsignedSpeed, "unsigned_speed", "Speed without sign, with reversals";
    SpeedZero, "speed_zero", "Speed always 0";
    SpeedStuck, "speed_stuck", "Speed always the same";
    SpeedBlind, "speed_blind", "Speed 0 below 0.8 m/s";
    SteeringStuck, "steering_stuck", "Steering angle always the same";
    LongWheelbase, "long_wheelbase", "Wheelbase 30 % too long";
    ShortWheelbase, "short_wheelbase", "Wheelbase half as long, or both axles steer";
    ToldBicycle, "told_bicycle", "A tricycle described as bicycle";
    ToldTricycle, "told_tricycle", "A bicycle described as tricycle";
    LinkageWheel, "linkage_wheel", "Angle of the left wheel of a linkage";
    Command, "command", "Commanded steering angle, 250 ms ahead of the wheel";
    FilteredAngle, "filtered_angle", "Steering angle filtered over 0.4 s";
    OtherVehicle, "other_vehicle", "Wheels of another vehicle";
    ScansAhead, "scans_ahead", "Scans stamped 3 s ahead";
    ScansSlightlyAhead, "scans_slightly_ahead", "Scans stamped 0.5 s ahead";
    TimeZone, "time_zone", "Scans stamped in another time zone";
    ClockStep, "clock_step", "Clock of the scans steps by 100 ms once";
    ClockBack, "clock_back", "All clocks go back by 2 s once";
    WholeSeconds, "whole_seconds", "Scans stamped in whole seconds";
    Microseconds, "microseconds", "Microseconds of the stamp in nanosec";
    ReceptionStamps, "reception_stamps", "Scans stamped on reception";
    ScansEnd, "scans_end", "Scans end";
    WheelsEnd, "wheels_end", "Wheel odometry ends";
    Millimetres, "millimetres", "Ranges in millimetres";
    FewReturns, "few_returns", "Ranges beyond 1 m are lost";
    OneRange, "one_range", "No return sent as 29.96 m";
    OwnBody, "own_body", "Seven beams in ten hit the robot";
    BeamTimes, "beam_times", "Time from beam to beam a third of the truth";
    RepeatedScans, "repeated_scans", "Each scan twice, under two stamps";
    TwoFrames, "two_frames", "Two scanners on one topic, of two frames";
    Segments, "segments", "A topic of segments of 30°";
    RepeatedPoses, "repeated_poses", "Each pose five times, under new stamps";
    JumpingPoses, "jumping_poses", "Pose in a map that jumps every 15 s";
    BasePose, "base_pose", "Pose of the rear axle sent as the LiDAR's";
}

impl WrongInput {
    /// The input of a name.
    pub fn by_name(name: &str) -> Option<Self> {
        Self::ALL.iter().copied().find(|input| input.name() == name)
    }

    /// Returns `true` if a robot has to send scans to show it, `false` if poses; `None` if either will do.
    pub const fn needs_scans(self) -> Option<bool> {
        match self {
            Self::Millimetres
            | Self::FewReturns
            | Self::OneRange
            | Self::OwnBody
            | Self::BeamTimes
            | Self::RepeatedScans
            | Self::TwoFrames
            | Self::Segments => Some(true),
            Self::RepeatedPoses | Self::JumpingPoses | Self::BasePose => Some(false),
            _ => None,
        }
    }

    /// Changes the robot where the wrong input is one of the vehicle.
    pub fn configure(self, config: &mut SimulationConfig) {
        match self {
            Self::ToldBicycle => config.vehicle.model = VehicleModel::Tricycle,
            Self::ToldTricycle => config.vehicle.model = VehicleModel::Bicycle,
            Self::UnsignedSpeed => config.route = Route::aisles_with_reversals(),
            Self::BasePose => config.vehicle.lidar_in_base = Pose2::IDENTITY,
            _ => {}
        }
    }

    /// Model and wheelbase, m, that the vehicle is described with.
    pub fn described(self, model: VehicleModel, wheelbase_m: f64) -> (VehicleModel, f64) {
        match self {
            Self::ToldBicycle => (VehicleModel::Bicycle, wheelbase_m),
            Self::ToldTricycle => (VehicleModel::Tricycle, wheelbase_m),
            Self::LongWheelbase => (model, 1.3 * wheelbase_m),
            Self::ShortWheelbase => (model, 0.5 * wheelbase_m),
            _ => (model, wheelbase_m),
        }
    }
}

/// A message as it arrives.
#[derive(Debug, Clone, PartialEq)]
pub struct Delivered {
    /// Time of arrival, ns.
    pub arrival_ns: i64,
    /// The message.
    pub message: SimulatedMessage,
    /// Name of its frame.
    pub frame: &'static str,
}

/// Makes inputs wrong, message by message.
#[derive(Debug)]
pub struct WrongInputs {
    inputs: Vec<WrongInput>,
    start_ns: i64,
    random: ChaCha8Rng,
    /// Wheel odometry that waits for the angle that comes later.
    waiting: VecDeque<(i64, DriveSample)>,
    filtered_rad: Option<f64>,
    other: Option<Simulation>,
    held_pose: Option<Pose2>,
    lidar_messages: usize,
}

impl WrongInputs {
    /// Wrong inputs of a robot.
    ///
    /// # Errors
    /// Names the setting of another vehicle that cannot be.
    pub fn new(inputs: &[WrongInput], config: &SimulationConfig) -> Result<Self, SettingRefused> {
        let other = if inputs.contains(&WrongInput::OtherVehicle) {
            let mut other = config.clone();
            other.seed = config.seed.wrapping_add(1);
            other.route = Route::aisles_with_reversals();
            other.speed.period_s = 11.0;
            other.lidar = LidarOutput::Poses(PoseSettings::default());
            Some(Simulation::new(other)?)
        } else {
            None
        };
        Ok(Self {
            inputs: inputs.to_vec(),
            start_ns: config.start_stamp_ns,
            random: stream(config.seed, Stream::WrongInputs),
            waiting: VecDeque::new(),
            filtered_rad: None,
            other,
            held_pose: None,
            lidar_messages: 0,
        })
    }

    /// Returns the messages that arrive of one that the robot sends: none, one or several.
    pub fn deliver(&mut self, emitted: Emitted) -> Vec<Delivered> {
        let arrival_ns = emitted.sent_ns;
        let messages = match emitted.message {
            SimulatedMessage::WheelOdometry(drive) => self.wheels(arrival_ns, drive),
            SimulatedMessage::Scan(scan) => self.scans(arrival_ns, scan),
            SimulatedMessage::LidarPose(pose) => self.poses(arrival_ns, pose),
            error @ SimulatedMessage::CrossTrackError(_) => vec![(arrival_ns, error)],
        };
        let numbers = self.lidar_messages;
        let two_frames = self.has(WrongInput::TwoFrames) && numbers.is_multiple_of(2);
        let frame = |message: &SimulatedMessage| match message {
            SimulatedMessage::WheelOdometry(_) => "base",
            SimulatedMessage::Scan(_) if two_frames => "lidar_rear",
            _ => "lidar",
        };
        let delivered = |(arrival_ns, message): (i64, SimulatedMessage)| Delivered {
            arrival_ns,
            frame: frame(&message),
            message,
        };
        messages.into_iter().map(delivered).collect()
    }

    fn has(&self, input: WrongInput) -> bool {
        self.inputs.contains(&input)
    }

    fn has_happened(&self, arrival_ns: i64) -> bool {
        (arrival_ns - self.start_ns) as f64 * 1e-9 > HAPPENS_AFTER_S
    }

    fn wheels(&mut self, arrival_ns: i64, mut drive: DriveSample) -> Vec<(i64, SimulatedMessage)> {
        if let Some(of_other) = self.other.as_mut().map(next_of_wheels) {
            (drive.speed_mps, drive.steering_rad) = (of_other.speed_mps, of_other.steering_rad);
        }
        if self.has(WrongInput::WheelsEnd) && self.has_happened(arrival_ns) {
            return Vec::new();
        }
        let has_happened = self.has_happened(arrival_ns);
        for input in self.inputs.clone() {
            self.change_wheels(input, has_happened, &mut drive);
        }
        if !self.has(WrongInput::Command) {
            return vec![(arrival_ns, SimulatedMessage::WheelOdometry(drive))];
        }
        let steering_rad = drive.steering_rad;
        self.waiting.push_back((arrival_ns, drive));
        let is_due = |(first_ns, _): &mut (i64, DriveSample)| {
            (arrival_ns - *first_ns) as f64 * 1e-9 >= COMMAND_AHEAD_S
        };
        let due = self.waiting.pop_front_if(is_due);
        let commanded = due.map(|(arrival_ns, drive)| {
            let drive = DriveSample {
                steering_rad,
                ..drive
            };
            (arrival_ns, SimulatedMessage::WheelOdometry(drive))
        });
        commanded.into_iter().collect()
    }

    fn change_wheels(&mut self, input: WrongInput, has_happened: bool, drive: &mut DriveSample) {
        use WrongInput as Input;
        let (speed, angle) = (&mut drive.speed_mps, &mut drive.steering_rad);
        match input {
            Input::SteeringSign => *angle = -*angle,
            Input::SpeedSign => *speed = -*speed,
            Input::BothSigns => (*speed, *angle) = (-*speed, -*angle),
            Input::Degrees => *angle = angle.to_degrees(),
            Input::Column => *angle *= COLUMN,
            Input::Gear => *angle *= 2.0,
            Input::QuarterTurn => *angle += FRAC_PI_2,
            Input::WrappedRadians => *angle = angle.rem_euclid(TAU),
            Input::WrappedDegrees => *angle = angle.to_degrees().rem_euclid(360.0),
            Input::KilometresPerHour => *speed *= 3.6,
            Input::MillimetresPerSecond => *speed *= 1e3,
            Input::WheelRadians => *speed /= WHEEL_RADIUS_M,
            Input::Diameter => *speed *= 2.0,
            Input::UnsignedSpeed => *speed = speed.abs(),
            Input::SpeedZero => *speed = 0.0,
            Input::SpeedStuck => *speed = 0.5,
            Input::SpeedBlind if speed.abs() < BLIND_MPS => *speed = 0.0,
            Input::SteeringStuck => *angle = 0.02,
            Input::LinkageWheel => *angle = (angle.tan() / (1.0 - LINKAGE * angle.tan())).atan(),
            Input::FilteredAngle => {
                let filtered_rad = self.filtered_rad.get_or_insert(*angle);
                *filtered_rad += (*angle - *filtered_rad) * 0.01 / FILTER_S;
                *angle = *filtered_rad;
            }
            Input::ClockBack if has_happened => drive.stamp_ns -= 2_000_000_000,
            _ => {}
        }
    }

    /// The stamp of a message of the LiDAR; `None` where it does not come.
    fn lidar_stamp_ns(&mut self, arrival_ns: i64, stamp_ns: i64) -> Option<i64> {
        use WrongInput as Input;
        self.lidar_messages += 1;
        let has_happened = self.has_happened(arrival_ns);
        let second_ns = 1_000_000_000;
        let mut stamp_ns = stamp_ns;
        for input in self.inputs.clone() {
            stamp_ns = match input {
                Input::ScansAhead => stamp_ns + 3 * second_ns,
                Input::ScansSlightlyAhead => stamp_ns + second_ns / 2,
                Input::TimeZone => stamp_ns + 3_600 * second_ns,
                Input::ClockStep if has_happened => stamp_ns + second_ns / 10,
                Input::ClockBack if has_happened => stamp_ns - 2 * second_ns,
                Input::WholeSeconds => stamp_ns.div_euclid(second_ns) * second_ns,
                Input::Microseconds => {
                    let whole_ns = stamp_ns.div_euclid(second_ns) * second_ns;
                    whole_ns + (stamp_ns - whole_ns) / 1_000
                }
                Input::ReceptionStamps => {
                    stamp_ns + (self.random.random_range(0.0..RECEPTION_S) * 1e9) as i64
                }
                Input::ScansEnd if has_happened => return None,
                _ => stamp_ns,
            };
        }
        Some(stamp_ns)
    }

    fn scans(&mut self, arrival_ns: i64, mut scan: Scan) -> Vec<(i64, SimulatedMessage)> {
        let Some(stamp_ns) = self.lidar_stamp_ns(arrival_ns, scan.stamp_ns) else {
            return Vec::new();
        };
        scan.stamp_ns = stamp_ns;
        for input in &self.inputs {
            change_scan(*input, &mut scan);
        }
        if self.has(WrongInput::RepeatedScans) {
            let later = 30_000_000;
            let again = Scan {
                stamp_ns: scan.stamp_ns + later,
                ..scan.clone()
            };
            let [first, second] = [scan, again].map(SimulatedMessage::Scan);
            return vec![(arrival_ns, first), (arrival_ns + later, second)];
        }
        if self.has(WrongInput::Segments) {
            return segments(arrival_ns, &scan);
        }
        vec![(arrival_ns, SimulatedMessage::Scan(scan))]
    }

    fn poses(&mut self, arrival_ns: i64, mut pose: LidarPose) -> Vec<(i64, SimulatedMessage)> {
        let Some(stamp_ns) = self.lidar_stamp_ns(arrival_ns, pose.stamp_ns) else {
            return Vec::new();
        };
        pose.stamp_ns = stamp_ns;
        let Pose2 { x_m, y_m, yaw_rad } = pose.pose;
        if self.has(WrongInput::MirroredScan) {
            pose.pose = Pose2::new(x_m, -y_m, -yaw_rad);
        }
        if self.has(WrongInput::RepeatedPoses) {
            if self.lidar_messages % 5 == 1 {
                self.held_pose = Some(pose.pose);
            }
            pose.pose = self.held_pose.unwrap_or(pose.pose);
        }
        let seconds = (arrival_ns - self.start_ns) / 1_000_000_000;
        if self.has(WrongInput::JumpingPoses) && seconds / 15 % 2 == 1 {
            pose.pose = Pose2::new(0.2, 0.0, 2f64.to_radians()).compose(&pose.pose);
        }
        vec![(arrival_ns, SimulatedMessage::LidarPose(pose))]
    }
}

/// The next drive sample of a vehicle, which sends as many as any other.
fn next_of_wheels(simulation: &mut Simulation) -> DriveSample {
    loop {
        if let SimulatedMessage::WheelOdometry(drive) = simulation.advance().message {
            return drive;
        }
    }
}

fn change_scan(input: WrongInput, scan: &mut Scan) {
    use WrongInput as Input;
    let beams = scan.ranges_m.len();
    match input {
        Input::MirroredScan => scan.ranges_m.reverse(),
        Input::Millimetres => {
            for range in &mut scan.ranges_m {
                *range *= 1e3;
            }
            scan.range_max_m *= 1e3;
        }
        Input::FewReturns => {
            for range in scan.ranges_m.iter_mut().filter(|range| **range > 1.0) {
                *range = f32::INFINITY;
            }
        }
        Input::OneRange => {
            for range in scan.ranges_m.iter_mut().filter(|range| **range > 4.0) {
                *range = 29.96;
            }
            scan.range_max_m = 30.0;
        }
        Input::OwnBody => {
            for (number, range) in scan.ranges_m.iter_mut().enumerate() {
                if number * 10 < beams * 7 {
                    *range = 0.3 + 0.01 * (number % 3) as f32;
                }
            }
        }
        Input::BeamTimes => scan.time_increment_s /= 3.0,
        _ => {}
    }
}

/// The parts of a scan as messages of their own.
fn segments(arrival_ns: i64, scan: &Scan) -> Vec<(i64, SimulatedMessage)> {
    let length = scan.ranges_m.len().div_ceil(SEGMENTS).max(1);
    let parts = scan.ranges_m.chunks(length).enumerate();
    parts
        .map(|(number, ranges_m)| {
            let first = (number * length) as f64;
            let later_ns = (first * scan.time_increment_s * 1e9) as i64;
            let segment = Scan {
                stamp_ns: scan.stamp_ns + later_ns,
                angle_min_rad: scan.angle_min_rad + first * scan.angle_increment_rad,
                ranges_m: ranges_m.to_vec(),
                ..scan.clone()
            };
            (arrival_ns + later_ns, SimulatedMessage::Scan(segment))
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn delivered(input: WrongInput, duration_s: f64) -> Vec<Delivered> {
        let mut config = SimulationConfig::figure_eight(1);
        config.lidar = LidarOutput::Poses(PoseSettings::default());
        input.configure(&mut config);
        let mut wrong = WrongInputs::new(&[input], &config).unwrap();
        let mut simulation = Simulation::new(config).unwrap();
        let sent = simulation.run(duration_s).into_iter();
        sent.flat_map(|emitted| wrong.deliver(emitted)).collect()
    }

    fn angles(of: &[Delivered]) -> Vec<f64> {
        let angle = |of: &Delivered| match of.message {
            SimulatedMessage::WheelOdometry(drive) => Some(drive.steering_rad),
            _ => None,
        };
        of.iter().filter_map(angle).collect()
    }

    #[test]
    fn names_are_unique_and_lead_back() {
        for input in WrongInput::ALL {
            assert_eq!(WrongInput::by_name(input.name()), Some(*input));
        }
    }

    #[test]
    fn a_command_is_the_angle_of_a_quarter_of_a_second_later() {
        let true_angles = angles(&delivered(WrongInput::ScansEnd, 10.0));
        let commanded = angles(&delivered(WrongInput::Command, 10.0));
        assert!(commanded.len() > 900);
        assert_eq!(
            commanded[500].total_cmp(&true_angles[525]),
            std::cmp::Ordering::Equal
        );
    }

    #[test]
    fn wheels_of_another_vehicle_are_others() {
        let own = angles(&delivered(WrongInput::ScansEnd, 30.0));
        let other = angles(&delivered(WrongInput::OtherVehicle, 30.0));
        assert_eq!(own.len(), other.len());
        let differ = own
            .iter()
            .zip(&other)
            .filter(|(a, b)| (**a - **b).abs() > 0.05);
        assert!(differ.count() > own.len() / 4);
    }

    #[test]
    fn scans_end_and_clocks_go_back_when_it_is_time() {
        let of_lidar = |of: &Delivered| matches!(of.message, SimulatedMessage::LidarPose(_));
        let ended = delivered(WrongInput::ScansEnd, 30.0);
        let count = ended.iter().filter(|of| of_lidar(of)).count();
        assert!((195..=201).contains(&count), "{count}");
        let back = delivered(WrongInput::ClockBack, 22.0);
        let falls = back
            .windows(2)
            .filter(|pair| pair[1].message.stamp_ns() < pair[0].message.stamp_ns() - 1_000_000_000);
        assert!(falls.count() >= 1);
    }
}
