//! Incidents in the middle of a drive: a restart, a note, a change, a fault, or messages that
//! arrive otherwise.

use fleetcal_estimator::{Event, Note, NoteKind, RobotTime};
use fleetcal_evaluation::drive::{Robot, event_of};
use fleetcal_robot::simulator::{
    Change, DriveSample, Emitted, Pose2, ScheduledChange, SimulatedMessage,
};

use super::Failure;
use super::lines::Lines;

/// Time of an incident, and of the end of one that is over, s.
const AT_S: f64 = 75.0;
const OVER_S: f64 = 90.0;
/// Silence after which a new session begins, and jump of a clock back, s.
const SILENCE_S: i64 = 900;
const BACK_S: i64 = 30;

/// Incident on a drive.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Incident {
    /// No incident.
    Nothing,
    /// The estimator ends and continues from its checkpoint.
    Restarted,
    /// A note of a power cycle.
    PowerCycled,
    /// A note of a reassembly, after which the LiDAR is elsewhere.
    Reassembled,
    /// The steering's zero jumps by 0.5°.
    SteeringMoved,
    /// The LiDAR is knocked by 20 mm and 1°.
    MountMoved,
    /// A restart while nothing is known yet, and the LiDAR knocked later.
    RestartedEarly,
    /// The robot is silent for a quarter of an hour.
    Silent,
    /// The robot's clock jumps back by half a minute.
    ClockBack,
    /// The steering's reading stands still.
    SteeringStuck,
    /// The wheels are shown at rest.
    WheelsStuck,
    /// Messages come late and twice.
    Disordered,
    /// The estimator begins while the robot drives.
    BegunInMotion,
    /// The LiDAR sees nothing.
    LidarCovered,
}

/// All of them.
pub const INCIDENTS: [Incident; 14] = [
    Incident::Nothing,
    Incident::Restarted,
    Incident::PowerCycled,
    Incident::Reassembled,
    Incident::SteeringMoved,
    Incident::MountMoved,
    Incident::RestartedEarly,
    Incident::Silent,
    Incident::ClockBack,
    Incident::SteeringStuck,
    Incident::WheelsStuck,
    Incident::Disordered,
    Incident::BegunInMotion,
    Incident::LidarCovered,
];

impl Incident {
    /// Schedules the change of the vehicle.
    pub fn prepare(self, robot: &mut Robot) {
        let change = match self {
            Self::SteeringMoved => Change::SteeringOffset(0.5f64.to_radians()),
            Self::MountMoved | Self::RestartedEarly | Self::Reassembled => {
                Change::Mount(Pose2::new(0.02, -0.01, 1f64.to_radians()))
            }
            _ => return,
        };
        let at_s = AT_S;
        robot.simulation.changes = vec![ScheduledChange { at_s, change }];
    }

    /// Time from which the estimator receives messages, s.
    fn heard_from_s(self) -> f64 {
        if self == Self::BegunInMotion {
            20.0
        } else {
            0.0
        }
    }
}

/// An incident on its drive.
#[derive(Debug)]
pub struct Staged {
    incident: Incident,
    has_happened: bool,
    messages: u64,
    held_back: Option<SimulatedMessage>,
    /// The steering that a stuck sensor shows, rad.
    stuck_rad: Option<f64>,
}

impl Staged {
    /// An incident that has not happened yet.
    pub fn of(incident: Incident) -> Self {
        Self {
            incident,
            has_happened: false,
            messages: 0,
            held_back: None,
            stuck_rad: None,
        }
    }

    /// Passes a message of the robot to the estimator as the incident leaves it.
    pub fn take(
        &mut self,
        time_s: f64,
        emitted: Emitted,
        lines: &mut Lines,
    ) -> Result<(), Failure> {
        if time_s < self.incident.heard_from_s() {
            return Ok(());
        }
        let due_s = match self.incident {
            Incident::RestartedEarly => 8.0,
            _ => AT_S,
        };
        if time_s >= due_s && !self.has_happened {
            self.has_happened = true;
            let note = |kind| {
                let stamp = RobotTime(emitted.sent_ns);
                Event::Note(Note { stamp, kind })
            };
            match self.incident {
                Incident::Restarted | Incident::RestartedEarly => lines.restart()?,
                Incident::PowerCycled => lines.step(note(NoteKind::PowerOn)),
                Incident::Reassembled => lines.step(note(NoteKind::Reassembled)),
                _ => {}
            }
        }
        for message in self.disturbed(time_s, emitted.message) {
            if let Some(event) = event_of(&message)? {
                lines.step(event);
            }
        }
        Ok(())
    }

    fn disturbed(&mut self, time_s: f64, message: SimulatedMessage) -> Vec<SimulatedMessage> {
        let is_on = (AT_S..OVER_S).contains(&time_s);
        match self.incident {
            Incident::Silent if time_s >= AT_S => vec![later(message, SILENCE_S)],
            Incident::ClockBack if time_s >= AT_S => vec![later(message, -BACK_S)],
            Incident::SteeringStuck if is_on => vec![self.stuck(message)],
            Incident::WheelsStuck if is_on => vec![at_rest(message)],
            Incident::LidarCovered if is_on => covered(message).into_iter().collect(),
            Incident::Disordered => self.disordered(message),
            _ => vec![message],
        }
    }

    fn stuck(&mut self, message: SimulatedMessage) -> SimulatedMessage {
        let SimulatedMessage::WheelOdometry(mut drive) = message else {
            return message;
        };
        drive.steering_rad = *self.stuck_rad.get_or_insert(drive.steering_rad);
        SimulatedMessage::WheelOdometry(drive)
    }

    fn disordered(&mut self, message: SimulatedMessage) -> Vec<SimulatedMessage> {
        self.messages += 1;
        match self.messages % 25 {
            3 => {
                self.held_back = Some(message);
                Vec::new()
            }
            9 => std::iter::once(message)
                .chain(self.held_back.take())
                .collect(),
            17 => vec![message.clone(), message],
            _ => vec![message],
        }
    }
}

fn later(mut message: SimulatedMessage, by_s: i64) -> SimulatedMessage {
    let stamp_ns = match &mut message {
        SimulatedMessage::WheelOdometry(drive) => &mut drive.stamp_ns,
        SimulatedMessage::Scan(scan) => &mut scan.stamp_ns,
        SimulatedMessage::LidarPose(pose) => &mut pose.stamp_ns,
        SimulatedMessage::CrossTrackError(error) => &mut error.stamp_ns,
    };
    *stamp_ns += by_s * 1_000_000_000;
    message
}

fn at_rest(message: SimulatedMessage) -> SimulatedMessage {
    match message {
        SimulatedMessage::WheelOdometry(drive) => SimulatedMessage::WheelOdometry(DriveSample {
            speed_mps: 0.0,
            ..drive
        }),
        other => other,
    }
}

/// A scan without returns; no pose.
fn covered(message: SimulatedMessage) -> Option<SimulatedMessage> {
    match message {
        SimulatedMessage::Scan(mut scan) => {
            scan.ranges_m.fill(f32::INFINITY);
            Some(SimulatedMessage::Scan(scan))
        }
        SimulatedMessage::LidarPose(_) => None,
        other => Some(other),
    }
}
