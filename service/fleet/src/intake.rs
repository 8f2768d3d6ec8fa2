//! Intake of a robot's messages: its estimator's events, in the order in which the messages arrive.
//! The live path and `fleetcal calibrate` both use it.

use std::hash::{DefaultHasher, Hash as _, Hasher as _};

use fleetcal_domain::robot::PairingReport;
use fleetcal_estimator::{DriveSample, Event, RobotTime, Vehicle};
use fleetcal_model::{Parameter, ParameterStatus, Stream};
use fleetcal_proto::estimate::EstimateDocument;
use fleetcal_proto::message_type::{Form, MessageType};

use crate::coarse_stamps::StampWatch;
use crate::commanded::SteeringWatch;
use crate::decode::{Decoded, MessageRefused};
use crate::pairing::Pairing;
use crate::reading::{Half, Message, Reading, ReadingSettings, STEERING_BY_TURN_MIN_MPS};
use crate::sighting::Sighting;

/// Messages in a row on a topic of joints that may hold the same half of a drive sample.
const PARTS_MAX: u32 = 200;

/// Result of reading one message.
#[derive(Debug, Clone, PartialEq)]
pub struct Taken {
    /// Its header stamp, or that of the last drive sample in it.
    pub stamp: RobotTime,
    /// Hash of its bytes.
    pub content: u64,
    /// Steering angle in the message, rad; of several the last.
    pub steering_rad: Option<f64>,
    /// Events for the estimator; half of a drive sample may complete none or several.
    pub events: Vec<Decoded>,
}

/// Reader of one robot's messages, which pairs its steering with its speed where they arrive
/// separately.
#[derive(Debug, Default)]
pub struct Intake {
    settings: ReadingSettings,
    /// Pairing of separate steering and speed.
    pairing: Pairing,
    /// Classifier of steering angles: measured or commanded.
    steering: SteeringWatch,
    /// Detector of coarse stamps.
    stamps: StampWatch,
    /// Latest speed of a robot that sends speed and steering separately.
    speed_mps: f64,
    /// Latest steering angle of a robot that sends its yaw rate instead; it is held at rest.
    turned_rad: Option<f64>,
    /// Halves in a row on the topic of wheel odometry, and which: true for steering.
    parts: (u32, bool),
    /// Streams of messages without a stamp.
    unstamped: Vec<Stream>,
}

impl Intake {
    /// Makes the intake of a robot that has sent nothing yet.
    pub fn new(settings: ReadingSettings) -> Self {
        Self {
            settings,
            ..Self::default()
        }
    }

    /// Returns the type of a stream's messages: by their form, else by configuration.
    pub fn message_type(&self, stream: Stream, form: Form) -> Option<MessageType> {
        self.settings.message_type(stream, form)
    }

    /// Returns the configured topic of a stream.
    pub fn topic(&self, stream: Stream) -> Option<&str> {
        let source = self.settings.streams.fields().source(stream)?;
        Some(source.topic.as_str())
    }

    /// Reads one message.
    ///
    /// # Errors
    /// One sentence: the stream, the field, its value and the accepted values.
    pub fn take(&mut self, message: &Message<'_>) -> Result<Taken, MessageRefused> {
        let Message {
            stream, payload, ..
        } = *message;
        let read = message.read(&self.settings)?;
        if !read.is_stamped && !self.unstamped.contains(&stream) {
            self.unstamped.push(stream);
        }
        if stream == Stream::WheelOdometry {
            self.count_parts(&read.reading)?;
        }
        let (stamp, steering_rad, events) = match read.reading {
            Reading::Whole(decoded) => {
                let mut steering_rad = None;
                if let Event::WheelOdometry(sample) = &decoded.event {
                    self.steering.take(sample);
                    steering_rad = Some(sample.steering_rad());
                }
                (decoded.stamp, steering_rad, vec![decoded])
            }
            Reading::Samples(samples) => {
                for sample in &samples {
                    self.steering.take(sample);
                }
                let last = samples.last();
                let stamp = last.map_or(RobotTime(0), DriveSample::stamp);
                let steering_rad = last.map(DriveSample::steering_rad);
                (stamp, steering_rad, decoded(samples))
            }
            Reading::Steering(angle) => {
                self.steering.take_angle(angle.value, self.speed_mps);
                let samples = self.pairing.take_steering(angle);
                (angle.stamp, Some(angle.value), decoded(samples))
            }
            Reading::Speed(speed) => {
                self.speed_mps = speed.value;
                let samples = self.pairing.take_speed(speed);
                (speed.stamp, None, decoded(samples))
            }
            Reading::Turn {
                speed,
                yaw_rate_radps,
                vehicle,
            } => {
                let sample = self.turned(speed, yaw_rate_radps, &vehicle)?;
                let steering_rad = Some(sample.steering_rad());
                (sample.stamp(), steering_rad, decoded(vec![sample]))
            }
        };
        let mut hasher = DefaultHasher::new();
        payload.hash(&mut hasher);
        let content = hasher.finish();
        self.stamps.take(stream, stamp, content);
        Ok(Taken {
            stamp,
            content,
            steering_rad,
            events,
        })
    }

    /// Counts the halves in a row on the topic of wheel odometry.
    fn count_parts(&mut self, reading: &Reading) -> Result<(), MessageRefused> {
        let is_steering = matches!(reading, Reading::Steering(_));
        let is_half = is_steering || matches!(reading, Reading::Speed(_));
        let (count, was_steering) = self.parts;
        let in_a_row = is_half && is_steering == was_steering;
        self.parts = (
            if in_a_row { count.saturating_add(1) } else { 0 },
            is_steering,
        );
        let (messages, _) = self.parts;
        if messages < PARTS_MAX {
            return Ok(());
        }
        Err(MessageRefused::OnePart {
            stream: Stream::WheelOdometry,
            messages,
            lacks: if is_steering { "speed" } else { "steering" },
        })
    }

    /// Makes the drive sample of a robot that sends its yaw rate.
    fn turned(
        &mut self,
        speed: Half,
        yaw_rate_radps: f64,
        vehicle: &Vehicle,
    ) -> Result<DriveSample, MessageRefused> {
        let (speed_mps, angle_rad) = vehicle.reading_of(speed.value, yaw_rate_radps);
        let (speed_mps, angle_rad) = if speed.value.abs() >= STEERING_BY_TURN_MIN_MPS {
            (speed_mps, angle_rad)
        } else {
            (speed.value, self.turned_rad.unwrap_or_default())
        };
        self.turned_rad = Some(angle_rad);
        DriveSample::new(speed.stamp, speed_mps, angle_rad).map_err(|source| {
            let stream = Stream::WheelOdometry;
            MessageRefused::Field { stream, source }
        })
    }

    /// Returns the unchecked content of a message; `None` if it cannot be decoded or is a note.
    pub fn sight(&self, message: &Message<'_>) -> Option<Sighting> {
        message.sight(&self.settings)
    }

    /// Returns the streams whose messages have no stamp and count as measured when they arrive.
    pub fn unstamped(&self) -> &[Stream] {
        &self.unstamped
    }

    /// True if the steering angle is computed from a yaw rate.
    pub fn steers_by_turn(&self) -> bool {
        self.turned_rad.is_some()
    }

    /// Returns the quality of the pairing of steering and speed, for a robot that sends them
    /// separately.
    pub fn pairing(&self) -> Option<PairingReport> {
        let report = self.pairing.report();
        (report != PairingReport::default()).then_some(report)
    }

    /// Returns the streams whose stamps are coarser than their rate.
    pub fn coarsely_stamped(&self) -> Vec<Stream> {
        self.stamps.coarse()
    }

    /// True if its steering angles look commanded, given its estimate.
    pub fn looks_commanded(&self, estimate: Option<&EstimateDocument>) -> bool {
        let time_offset = estimate.and_then(|document| {
            let parameter = document.parameters.get(Parameter::TimeOffset);
            let known = parameter.status == ParameterStatus::Converged;
            known.then_some((parameter.value, parameter.sigma))
        });
        self.steering.looks_commanded(time_offset)
    }
}

/// Wraps the drive samples of a message, or those that a half has completed.
fn decoded(samples: Vec<DriveSample>) -> Vec<Decoded> {
    let event = |sample: DriveSample| Decoded {
        stamp: sample.stamp(),
        event: Event::WheelOdometry(sample),
        note: None,
    };
    samples.into_iter().map(event).collect()
}
