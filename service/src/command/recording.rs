//! Reads a recording message by message and counts what is refused.

use std::path::{Path, PathBuf};

use fleetcal_estimator::point_cloud::PlanarBand;
use fleetcal_proto::encoding::{Form, ScanType};
use fleetcal_robot::recording::{Channel, RecordedMessage};

use crate::command::CommandError;
use crate::fleet::decode::{self, Decoded};
use crate::fleet::{ScanSettings, Stream};

/// One stream of a recording.
#[derive(Debug)]
pub struct RecordedStream {
    topic: String,
    stream: Stream,
    form: Form,
    scans: ScanSettings,
    messages: u64,
    refused: u64,
    first_refusal: Option<String>,
}

impl RecordedStream {
    /// The stream that a channel carries; of clouds `band` is taken.
    pub fn of(channel: &Channel, stream: Stream, band: PlanarBand) -> Self {
        Self {
            topic: channel.topic.clone(),
            stream,
            form: channel.scan_form(),
            scans: ScanSettings {
                scan_type: ScanType::LaserScan,
                band,
            },
            messages: 0,
            refused: 0,
            first_refusal: None,
        }
    }

    /// Whether a message is of this stream.
    pub fn carries(&self, message: &RecordedMessage) -> bool {
        *self.topic == *message.topic
    }

    /// Decodes and checks a message; `None` when it is refused, which is counted.
    pub fn decode(&mut self, message: &RecordedMessage) -> Option<Decoded> {
        self.messages += 1;
        match decode::decode(self.stream, self.form, &self.scans, &message.payload) {
            Ok(decoded) => Some(decoded),
            Err(refused) => {
                self.refused += 1;
                if self.first_refusal.is_none() {
                    self.first_refusal = Some(refused.to_string());
                }
                None
            }
        }
    }

    /// How many were refused and why, in one sentence; `None` when none was.
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

    /// Fails when there were messages and none could be used.
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
