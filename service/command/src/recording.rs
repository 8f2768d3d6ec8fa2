//! Reads a recording message by message and counts what is refused.

use std::path::{Path, PathBuf};

use fleetcal_estimator::RobotTime;
use fleetcal_fleet::decode::MessageRefused;
use fleetcal_fleet::{Intake, ReadMessage, Taken};
use fleetcal_model::Stream;
use fleetcal_proto::RecordingTopic;
use fleetcal_proto::message_type::{Form, MessageType};
use fleetcal_robot::recording::{
    Channel, ChosenPose, ChosenWheelOdometry, RecordedMessage, Topics,
};

use crate::CommandError;

/// One stream of a recording.
#[derive(Debug)]
pub struct RecordedStream {
    topic: String,
    stream: Stream,
    form: Form,
    messages: u64,
    refused: u64,
    first_refusal: Option<String>,
}

/// Returns the streams of a recording's topics, those of the wheel odometry first.
pub fn streams(topics: &Topics) -> Vec<RecordedStream> {
    let mut streams = match &topics.wheel_odometry {
        ChosenWheelOdometry::Whole(channel) => {
            vec![RecordedStream::of(channel, Stream::WheelOdometry)]
        }
        ChosenWheelOdometry::Halves { steering, speed } => vec![
            RecordedStream::of(steering, Stream::Steering),
            RecordedStream::of(speed, Stream::Speed),
        ],
    };
    let pose = match &topics.pose {
        ChosenPose::Scan(_) => Stream::Scan,
        ChosenPose::LidarOdometry(_) => Stream::LidarOdometry,
    };
    streams.push(RecordedStream::of(topics.pose.channel(), pose));
    streams
}

impl RecordedStream {
    /// Makes the stream that a channel carries.
    pub fn of(channel: &Channel, stream: Stream) -> Self {
        Self {
            topic: channel.topic.clone(),
            stream,
            form: channel.form(),
            messages: 0,
            refused: 0,
            first_refusal: None,
        }
    }

    /// True if a message belongs to this stream.
    pub fn carries(&self, message: &RecordedMessage) -> bool {
        *self.topic == *message.topic
    }

    /// True if it is a stream of wheel odometry.
    pub fn is_wheel_odometry(&self) -> bool {
        self.stream.is_wheel_odometry()
    }

    /// Returns its topic in a session.
    pub fn recording_topic(&self) -> Option<RecordingTopic> {
        let message_type: MessageType = self.form.message_type?;
        Some(RecordingTopic {
            topic: self.topic.clone(),
            message_type,
            encoding: self.form.encoding,
        })
    }

    /// Decodes and checks a message; returns `None` for a refused one, which is counted.
    pub fn take(&mut self, intake: &mut Intake, message: &RecordedMessage) -> Option<Taken> {
        self.read(intake, message).ok()
    }

    /// The same, with the reason of a refusal.
    ///
    /// # Errors
    /// One sentence: the stream, the field, its value and what is accepted.
    pub fn read(
        &mut self,
        intake: &mut Intake,
        message: &RecordedMessage,
    ) -> Result<Taken, MessageRefused> {
        self.messages += 1;
        let taken = intake.take(&self.read_message(message));
        if let Err(refused) = &taken {
            self.refused += 1;
            self.first_refusal
                .get_or_insert_with(|| refused.to_string());
        }
        taken
    }

    /// Returns what a reading needs of a message.
    pub fn read_message<'m>(&self, message: &'m RecordedMessage) -> ReadMessage<'m> {
        ReadMessage {
            stream: self.stream,
            form: self.form,
            payload: &message.payload,
            arrived: RobotTime(i64::try_from(message.log_time_ns).unwrap_or(i64::MAX)),
        }
    }

    /// Its topic.
    pub fn topic(&self) -> &str {
        &self.topic
    }

    /// The stream, and the form of its messages.
    pub fn kind(&self) -> (Stream, Form) {
        (self.stream, self.form)
    }

    /// Returns the number of refusals and the first reason, in one sentence; `None` without
    /// refusals.
    pub fn refusals(&self) -> Option<String> {
        let first = self.first_refusal.as_ref()?;
        let Self {
            topic,
            refused,
            messages,
            ..
        } = self;
        Some(format!(
            "{refused} of {messages} messages of {topic} were refused, the first: {first}"
        ))
    }

    /// Fails if there were messages and none could be used.
    ///
    /// # Errors
    /// One sentence with the reason of the first refusal.
    pub fn check_usable(&self, path: &Path) -> Result<(), CommandError> {
        if self.refused < self.messages {
            return Ok(());
        }
        let first = self
            .first_refusal
            .as_ref()
            .map_or_else(String::new, |why| format!(": {why}"));
        Err(CommandError::Unusable {
            path: PathBuf::from(path),
            what: self.stream.name(),
            messages: self.messages,
            first,
        })
    }
}
