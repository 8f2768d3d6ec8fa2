//! Table of the checks and of the causes that each can name.

/// Subject of a check.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Check {
    /// Streams that come and can be read.
    Streams,
    /// Stamps of each stream.
    Stamps,
    /// Clocks of wheel odometry and LiDAR against each other.
    Clocks,
    /// Content of scans.
    Scan,
    /// Content of the LiDAR's poses that the robot sends.
    Pose,
    /// Unit and sign of the speed.
    Speed,
    /// Unit, sign and zero of the steering angle.
    Steering,
    /// Wheelbase that the vehicle was described with.
    Wheelbase,
    /// Model of the vehicle.
    Model,
    /// Delay between steering angle, speed and motion.
    Delay,
    /// Wheels and LiDAR of one vehicle.
    Vehicle,
}

impl Check {
    /// All of them, in the order in which they are shown.
    pub const ALL: [Self; 11] = [
        Self::Streams,
        Self::Stamps,
        Self::Clocks,
        Self::Scan,
        Self::Pose,
        Self::Speed,
        Self::Steering,
        Self::Wheelbase,
        Self::Model,
        Self::Delay,
        Self::Vehicle,
    ];

    /// Returns `true` if its result needs motion.
    pub const fn needs_motion(self) -> bool {
        !matches!(self, Self::Streams | Self::Stamps | Self::Scan)
    }

    /// Its name: `steering` and so on.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Streams => "streams",
            Self::Stamps => "stamps",
            Self::Clocks => "clocks",
            Self::Scan => "scan",
            Self::Pose => "pose",
            Self::Speed => "speed",
            Self::Steering => "steering",
            Self::Wheelbase => "wheelbase",
            Self::Model => "model",
            Self::Delay => "delay",
            Self::Vehicle => "vehicle",
        }
    }
}

/// Span over which a cause has to be seen before it is named.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum Held {
    /// Seconds of message time.
    Seconds(f64),
    /// Metres of the LiDAR's way.
    Metres(f64),
}

/// Row of a cause in the table.
pub(crate) struct Row {
    pub name: &'static str,
    pub check: Check,
    pub held: Held,
    /// `true` if nothing else explains the evidence.
    pub certain: bool,
    /// Remedy.
    pub advice: &'static str,
}

const SOON: Held = Held::Seconds(5.0);
const AT_ONCE: Held = Held::Seconds(0.0);
const DRIVEN: Held = Held::Metres(10.0);
const LONG: Held = Held::Metres(20.0);

macro_rules! causes {
    ($($cause:ident, $name:literal, $check:ident, $held:ident, $certain:literal, $doc:literal, $advice:literal;)+) => {
        /// Cause of a wrong input.
        #[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
        pub enum Cause {
            $(#[doc = $doc] $cause,)+
        }

        impl Cause {
            /// All of them, in the order of their checks.
            pub const ALL: &'static [Self] = &[$(Self::$cause,)+];

            pub(crate) const fn row(self) -> Row {
                match self {
                    $(Self::$cause => Row {
                        name: $name,
                        check: Check::$check,
                        held: $held,
                        certain: $certain,
                        advice: $advice,
                    },)+
                }
            }
        }
    };
}

causes! {
    WheelOdometryMissing, "wheel_odometry_missing", Streams, SOON, true,
        "Wheel odometry does not come.",
        "Check the topic's name and that its publisher runs.";
    LidarMissing, "lidar_missing", Streams, SOON, true,
        "Neither scans nor poses of the LiDAR come.",
        "Check the topic's name and that its publisher runs.";
    Refused, "refused", Streams, SOON, true,
        "Messages are refused.",
        "Send the field as the sentence says.";
    RepeatedStamps, "repeated_stamps", Stamps, SOON, true,
        "Messages have the stamp of the one before.",
        "Stamp each message when it was measured, to a millisecond or better.";
    NanosecondField, "nanosecond_field", Stamps, SOON, true,
        "The nanoseconds of the stamps hold micro- or milliseconds.",
        "Put nanoseconds into header.stamp.nanosec.";
    ReceptionStamps, "reception_stamps", Stamps, SOON, true,
        "Stamps are as uneven as a network.",
        "Stamp messages where they are measured, not where they are received.";
    SteppedClock, "stepped_clock", Stamps, AT_ONCE, true,
        "The clock of a stream is stepped.",
        "Let the clock be slewed, not stepped (chrony, PTP), and see whether the driver restarts.";
    ClockBack, "clock_back", Stamps, AT_ONCE, true,
        "The clock of a stream went back.",
        "Let the clock be slewed, not stepped (chrony, PTP).";
    ClocksApart, "clocks_apart", Clocks, DRIVEN, true,
        "Clocks of scans and wheels are apart, by their motion.",
        "Synchronise the clocks (chrony, PTP), and see that both are in the same time scale.";
    StampsApart, "stamps_apart", Clocks, SOON, true,
        "Clocks of scans and wheels are apart, by their arrival.",
        "Synchronise the clocks (chrony, PTP), and see that both are in the same time scale.";
    Millimetres, "millimetres", Scan, SOON, true,
        "Ranges are not in metres.",
        "Send ranges in metres.";
    FewReturns, "few_returns", Scan, SOON, true,
        "Nearly all beams are without return.",
        "Look at the LiDAR's window and at range_min and range_max.";
    OneRange, "one_range", Scan, SOON, true,
        "Many beams have one and the same range, scan after scan.",
        "Send infinity for no return.";
    OwnBody, "own_body", Scan, SOON, true,
        "Beams hit the robot itself.",
        "Mask these beams in the driver, or look at the LiDAR's cover.";
    SeveralFrames, "several_frames", Scan, SOON, true,
        "One topic carries several frames.",
        "Give each sensor a topic of its own, and choose one.";
    SeveralScanners, "several_scanners", Scan, SOON, true,
        "Scans come more often than one scanner makes them.",
        "Give each scanner a topic of its own, and choose one.";
    Segments, "segments", Scan, SOON, true,
        "Each scan is a segment of a turn.",
        "Choose the topic of whole scans, or join the segments in the driver.";
    RepeatedScans, "repeated_scans", Scan, SOON, true,
        "Scans come again under new stamps.",
        "Publish each scan once.";
    BeamTimes, "beam_times", Scan, SOON, true,
        "The times of the beams contradict the time between scans.",
        "Set time_increment to the time from beam to beam, or to 0.";
    PoseAxes, "pose_axes", Pose, SOON, true,
        "Poses turn about another axis than z.",
        "Send poses in a frame with x forward, y left and z up.";
    PoseJumps, "pose_jumps", Pose, SOON, true,
        "Poses jump.",
        "Send a LiDAR odometry, which does not jump, instead of a pose in a map.";
    RepeatedPoses, "repeated_poses", Pose, SOON, true,
        "Poses come again under new stamps.",
        "Publish each pose once, with the stamp of its scan.";
    BasePose, "base_pose", Pose, DRIVEN, true,
        "Poses are those of the rear axle.",
        "Send the pose of the LiDAR's own frame, before any transform to base_link.";
    PoseFrame, "pose_frame", Pose, SOON, false,
        "Poses name the vehicle's frame.",
        "Send the pose of the LiDAR's own frame, and name that frame in child_frame_id.";
    SpeedZero, "speed_zero", Speed, LONG, true,
        "The speed stays 0 while the LiDAR moves.",
        "Fill in the speed (twist.linear.x), or choose another topic.";
    SpeedStuck, "speed_stuck", Speed, DRIVEN, true,
        "The speed stays the same while the LiDAR's changes.",
        "Look at the encoder and at what publishes the speed.";
    LidarStands, "lidar_stands", Speed, SOON, true,
        "The LiDAR stands while the wheels turn.",
        "Check that scans are of this robot, and that its wheels are on the floor.";
    SpeedUnsigned, "speed_unsigned", Speed, LONG, true,
        "The speed has no sign.",
        "Send a negative speed in reverse.";
    SpeedSign, "speed_sign", Speed, DRIVEN, true,
        "The speed has the wrong sign.",
        "Turn the speed's sign, unless the LiDAR looks backwards: then enter its nominal yaw.";
    SpeedUnit, "speed_unit", Speed, DRIVEN, true,
        "The speed is in another unit.",
        "Send metres a second.";
    SpeedBlind, "speed_blind", Speed, LONG, true,
        "The speed is 0 while the robot moves slowly.",
        "Look at the speed sensor's smallest speed.";
    SteeringWrap, "steering_wrap", Steering, SOON, true,
        "Angles to the right come as nearly a full turn.",
        "Subtract a turn from angles above half a turn.";
    SteeringStuck, "steering_stuck", Steering, DRIVEN, true,
        "The angle stays the same while the vehicle turns.",
        "Look at the steering encoder and at what publishes the angle.";
    SteeringSign, "steering_sign", Steering, DRIVEN, true,
        "Angle and turn have opposite signs.",
        "The angle is positive to the right: turn its sign (steering_gear = -1). Or the steered axle is at the other \
         end: set model = \"rear_steered\" for one at the rear, \"bicycle\" or \"tricycle\" for one in front. Or \
         the scanner is mounted upside down: then something at its left is at negative angles; hold a hand there to tell.";
    SteeringDegrees, "steering_degrees", Steering, DRIVEN, true,
        "The angle is in degrees.",
        "Send radians (steering_gear = 0.0174533).";
    SteeringGear, "steering_gear", Steering, DRIVEN, true,
        "The angle is that of a column or motor.",
        "Set steering_gear, or send the angle of the wheel.";
    SteeringZero, "steering_zero", Steering, DRIVEN, true,
        "The angle's zero is far from straight ahead.",
        "Subtract the angle that the sensor shows straight ahead.";
    SteeringUnrelated, "steering_unrelated", Steering, LONG, true,
        "The vehicle's curve does not follow the angle.",
        "Check that the angle is of this vehicle and measured at the steered wheel.";
    WheelbaseWrong, "wheelbase", Wheelbase, DRIVEN, true,
        "The wheelbase is another one.",
        "Measure the wheelbase; where both axles steer, enter half of it.";
    TurnScale, "turn_scale", Wheelbase, DRIVEN, true,
        "The vehicle turns by another amount than angle and wheelbase say.",
        "Check the wheelbase and the gear of the steering angle; drive wider and narrower turns to tell them apart.";
    Tricycle, "tricycle", Model, LONG, true,
        "The speed is that of the steered wheel.",
        "Set model = \"tricycle\"; of a rear_steered vehicle, speed_measured_at = \"steered_wheel\".";
    Bicycle, "bicycle", Model, LONG, true,
        "The speed is that of the fixed axle.",
        "Set model = \"bicycle\"; of a rear_steered vehicle, speed_measured_at = \"rear_axle\".";
    LinkageWheel, "linkage_wheel", Model, LONG, true,
        "The angle is that of one wheel of a linkage.",
        "Send the angle of the middle: the mean of both wheels' cotangents.";
    Command, "command", Delay, LONG, false,
        "The vehicle follows the angle late.",
        "Send the measured angle instead of the command, or look for play in the linkage.";
    AngleLate, "angle_late", Delay, LONG, false,
        "The angle is late.",
        "Send the angle unfiltered, with the stamp of its measurement.";
    SpeedLate, "speed_late", Delay, LONG, false,
        "The speed is late.",
        "Send the speed unfiltered, with the stamp of its measurement.";
    Backwards, "backwards", Vehicle, DRIVEN, false,
        "The LiDAR looks backwards, or the signs of speed and steering are both wrong.",
        "Enter the LiDAR's nominal yaw where it is mounted backwards; else turn both signs.";
    LidarMisled, "lidar_misled", Vehicle, LONG, false,
        "LiDAR odometry is misled.",
        "Level the LiDAR, which may see the floor, and drive where it sees walls.";
    OtherVehicle, "other_vehicle", Vehicle, LONG, false,
        "Wheels and LiDAR do not move together.",
        "Check that both topics are of the same robot, and that the LiDAR is level and sees walls.";
}

impl Cause {
    /// Its name: `steering_sign` and so on.
    pub const fn name(self) -> &'static str {
        self.row().name
    }

    /// The check that names it.
    pub const fn check(self) -> Check {
        self.row().check
    }

    /// Remedy.
    pub const fn advice(self) -> &'static str {
        self.row().advice
    }

    /// The cause of a name.
    pub fn by_name(name: &str) -> Option<Self> {
        Self::ALL.iter().copied().find(|one| one.name() == name)
    }

    /// Returns `true` if what is estimated from the messages cannot be right: one that does not come spoils
    /// nothing, and one that has more than one explanation may be right.
    pub const fn spoils_values(self) -> bool {
        self.row().certain && !self.ends()
    }

    /// Returns `true` if the cause ends with what shows it: a stream that comes again is missing no more, and
    /// poses that move unlike the vehicle's frame are not of it. All other causes stay until the checks begin
    /// again.
    pub(crate) const fn ends(self) -> bool {
        matches!(
            self,
            Self::WheelOdometryMissing | Self::LidarMissing | Self::PoseFrame
        )
    }

    /// Returns `true` if the motion cannot be judged while it lasts.
    pub(crate) const fn spoils_motion(self) -> bool {
        match self.check() {
            Check::Stamps => !matches!(self, Self::SteppedClock | Self::ClockBack),
            Check::Scan => !matches!(self, Self::BeamTimes),
            Check::Pose => !matches!(self, Self::BasePose | Self::PoseFrame),
            _ => false,
        }
    }

    pub(crate) const fn index(self) -> usize {
        self as usize
    }
}
