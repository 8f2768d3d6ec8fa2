//! Writes a recording of a robot as MCAP for Foxglove: its streams as they were, and beside them what
//! was found of it.

use std::collections::BTreeMap;
use std::fs::File;
use std::io::{BufWriter, Write};
use std::path::Path;

use fleetcal_model::Pose2;
use fleetcal_proto::RecordingTopic;
use mcap::write::NoSeek;
use serde_json::{Value, json};

use super::RecordingError;
use super::mcap_file::{self, McapFile};

/// Name of the metadata record with the number of missing messages.
pub const RECORDING_METADATA: &str = "fleetcal.session";

/// Writer of a recording: the streams unchanged, `/tf` as `foxglove.FrameTransform`,
/// `/{robot}/estimate` as JSON and `/{robot}/events` as `foxglove.Log`.
///
/// Everything is logged at its own stamp, by the robot's clock: messages at that of their header, a
/// scan at its first beam; the rest at its message time. A recorder's clock is ignored, since it
/// may be any other. The same messages give the same bytes.
#[derive(Debug)]
pub struct RobotWriter<W: Write> {
    file: McapFile<NoSeek<W>>,
    streams: BTreeMap<RecordingTopic, u16>,
    transforms: u16,
    estimates: u16,
    events: u16,
}

impl RobotWriter<BufWriter<File>> {
    /// Creates the file, or empties it.
    ///
    /// # Errors
    /// When it can't be made.
    pub fn create(path: &Path, robot: &str) -> Result<Self, RecordingError> {
        let file = File::create(path).map_err(|source| RecordingError::Io {
            path: path.to_owned(),
            source,
        })?;
        Self::begin(path, BufWriter::new(file), robot)
    }

    /// Writes the end and waits until the disk has it all. A file without its end is refused as
    /// truncated.
    ///
    /// # Errors
    /// When it can't be written.
    pub fn finish_on_disk(self) -> Result<(), RecordingError> {
        let path = self.file.path().to_owned();
        mcap_file::sync(&path, self.finish()?)
    }
}

impl<W: Write> RobotWriter<W> {
    /// Begins writing to `to`, from beginning to end; errors call it `path`.
    ///
    /// # Errors
    /// When it can't be written.
    pub fn begin(path: &Path, to: W, robot: &str) -> Result<Self, RecordingError> {
        let options = mcap_file::options().disable_seeking(true);
        let mut file = McapFile::begin(path, NoSeek::new(to), options)?;
        let anything = json!({ "type": "object" });
        let (estimate, events) = (format!("/{robot}/estimate"), format!("/{robot}/events"));
        Ok(Self {
            transforms: file.json_channel("/tf", "foxglove.FrameTransform", &transform_schema())?,
            estimates: file.json_channel(&estimate, "fleetcal.Estimate", &anything)?,
            events: file.json_channel(&events, "foxglove.Log", &log_schema())?,
            streams: BTreeMap::new(),
            file,
        })
    }

    /// Writes a message of the robot unchanged, logged at `stamp_ns`.
    ///
    /// # Errors
    /// When it can't be written.
    pub fn message(
        &mut self,
        stamp_ns: i64,
        topic: &RecordingTopic,
        payload: &[u8],
    ) -> Result<(), RecordingError> {
        let channel = if let Some(&known) = self.streams.get(topic) {
            known
        } else {
            let RecordingTopic {
                topic: name,
                message_type,
                encoding,
            } = topic;
            let added = self.file.ros_channel(name, *message_type, *encoding)?;
            self.streams.insert(topic.clone(), added);
            added
        };
        self.file.write(channel, [stamp_ns; 2], payload)
    }

    /// Writes the pose of a frame in another, from `stamp_ns` on.
    ///
    /// # Errors
    /// When it can't be written.
    pub fn transform(
        &mut self,
        stamp_ns: i64,
        parent: &str,
        child: &str,
        child_in_parent: Pose2,
    ) -> Result<(), RecordingError> {
        let Pose2 { x_m, y_m, yaw_rad } = child_in_parent;
        let (z, w) = (0.5 * yaw_rad).sin_cos();
        let transform = json!({
            "timestamp": time(stamp_ns),
            "parent_frame_id": parent,
            "child_frame_id": child,
            "translation": { "x": x_m, "y": y_m, "z": 0.0 },
            "rotation": { "x": 0.0, "y": 0.0, "z": z, "w": w },
        });
        self.write_json(self.transforms, stamp_ns, &transform)
    }

    /// Writes the estimate at a time.
    ///
    /// # Errors
    /// When it can't be written.
    pub fn estimate(&mut self, stamp_ns: i64, estimate: &Value) -> Result<(), RecordingError> {
        self.write_json(self.estimates, stamp_ns, estimate)
    }

    /// Writes an event, as a warning.
    ///
    /// # Errors
    /// When it can't be written.
    pub fn event(&mut self, stamp_ns: i64, words: &str) -> Result<(), RecordingError> {
        let log = json!({
            "timestamp": time(stamp_ns),
            "level": LEVEL_WARNING,
            "message": words,
            "name": "fleetcal",
            "file": "",
            "line": 0,
        });
        self.write_json(self.events, stamp_ns, &log)
    }

    /// Writes the number of messages that are missing because they came faster than they were
    /// written.
    ///
    /// # Errors
    /// When it can't be written.
    pub fn left_out(&mut self, messages: u64) -> Result<(), RecordingError> {
        let values = [("left_out".to_owned(), messages.to_string())];
        self.file.metadata(RECORDING_METADATA, values.into())
    }

    /// Writes the end and returns the output.
    ///
    /// # Errors
    /// When it can't be written.
    pub fn finish(self) -> Result<W, RecordingError> {
        Ok(self.file.finish()?.into_inner())
    }

    fn write_json(
        &mut self,
        channel: u16,
        stamp_ns: i64,
        value: &Value,
    ) -> Result<(), RecordingError> {
        let json = value.to_string();
        self.file.write(channel, [stamp_ns; 2], json.as_bytes())
    }
}

/// Foxglove's level of a warning.
const LEVEL_WARNING: u8 = 3;

fn time(stamp_ns: i64) -> Value {
    let second = 1_000_000_000;
    json!({ "sec": stamp_ns.div_euclid(second), "nsec": stamp_ns.rem_euclid(second) })
}

fn time_schema() -> Value {
    let whole = json!({ "type": "integer" });
    json!({ "type": "object", "title": "time", "properties": { "sec": whole, "nsec": whole } })
}

fn numbers(names: &[&str]) -> Value {
    let number = |name: &&str| ((*name).to_owned(), json!({ "type": "number" }));
    let properties: serde_json::Map<String, Value> = names.iter().map(number).collect();
    json!({ "type": "object", "properties": properties })
}

fn transform_schema() -> Value {
    json!({ "title": "foxglove.FrameTransform", "type": "object", "properties": {
        "timestamp": time_schema(),
        "parent_frame_id": { "type": "string" },
        "child_frame_id": { "type": "string" },
        "translation": numbers(&["x", "y", "z"]),
        "rotation": numbers(&["x", "y", "z", "w"]),
    }})
}

fn log_schema() -> Value {
    json!({ "title": "foxglove.Log", "type": "object", "properties": {
        "timestamp": time_schema(),
        "level": { "type": "integer" },
        "message": { "type": "string" },
        "name": { "type": "string" },
        "file": { "type": "string" },
        "line": { "type": "integer" },
    }})
}
