//! Writes a robot's session as MCAP for Foxglove: its streams as they were, and beside them what
//! was found of it.

use std::collections::BTreeMap;
use std::fs::File;
use std::io::BufWriter;
use std::path::{Path, PathBuf};

use fleetcal_proto::encoding::Encoding;
use fleetcal_proto::ros::{AckermannDriveStamped, LaserScan, Odometry, PointCloud2, RosMessage};
use mcap::records::MessageHeader;
use mcap::{Compression, McapError, WriteOptions, Writer};
use serde_json::{Value, json};

use super::{Channel, RecordedMessage, RecordingError, definitions};

/// A pose in the plane.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PlanarPose {
    /// Forward, m.
    pub x_m: f64,
    /// To the left, m.
    pub y_m: f64,
    /// Counter-clockwise, rad.
    pub yaw_rad: f64,
}

/// Writes a session: the streams in CDR, `/tf` as `foxglove.FrameTransform`, `/{robot}/estimate` as
/// JSON and `/{robot}/events` as `foxglove.Log`. The same messages give the same bytes.
pub struct SessionWriter {
    path: PathBuf,
    writer: Writer<BufWriter<File>>,
    streams: BTreeMap<String, u16>,
    transforms: u16,
    estimates: u16,
    events: u16,
    sequence: u32,
}

impl std::fmt::Debug for SessionWriter {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("SessionWriter")
            .field("path", &self.path)
            .finish_non_exhaustive()
    }
}

impl SessionWriter {
    /// Makes the file, or empties it, for some channels of a recording. A channel whose type has no
    /// definition here is left out.
    ///
    /// # Errors
    /// When it can't be made.
    pub fn create(path: &Path, robot: &str, channels: &[&Channel]) -> Result<Self, RecordingError> {
        let file = File::create(path).map_err(|source| RecordingError::Io {
            path: path.to_owned(),
            source,
        })?;
        let refused = |error| refused(path, error);
        let options = WriteOptions::new()
            .compression(Some(Compression::Zstd))
            // One thread: the bytes do not depend on the machine.
            .compression_threads(0);
        let mut writer = options.create(BufWriter::new(file)).map_err(refused)?;
        let mut streams = BTreeMap::new();
        for channel in channels {
            if let Some(id) = add_stream(&mut writer, channel).map_err(refused)? {
                streams.insert(channel.topic.clone(), id);
            }
        }
        let mut json_channel = |topic: &str, name: &str, schema: &Value| {
            let schema = writer.add_schema(name, "jsonschema", schema.to_string().as_bytes())?;
            writer.add_channel(schema, topic, "json", &BTreeMap::new())
        };
        let transforms = json_channel("/tf", "foxglove.FrameTransform", &transform_schema());
        let estimates = json_channel(
            &format!("/{robot}/estimate"),
            "fleetcal.Estimate",
            &json!({ "type": "object" }),
        );
        let events = json_channel(&format!("/{robot}/events"), "foxglove.Log", &log_schema());
        Ok(Self {
            path: path.to_owned(),
            transforms: transforms.map_err(refused)?,
            estimates: estimates.map_err(refused)?,
            events: events.map_err(refused)?,
            writer,
            streams,
            sequence: 0,
        })
    }

    /// Writes a message of the robot as it was recorded. One of a channel that is left out is not.
    ///
    /// # Errors
    /// When it can't be written.
    pub fn message(&mut self, message: &RecordedMessage) -> Result<(), RecordingError> {
        let Some(&channel) = self.streams.get(&*message.topic) else {
            return Ok(());
        };
        self.write(channel, message.log_time_ns, &message.payload)
    }

    /// Writes where a frame is in another, from `stamp_ns` on.
    ///
    /// # Errors
    /// When it can't be written.
    pub fn transform(
        &mut self,
        stamp_ns: i64,
        parent: &str,
        child: &str,
        child_in_parent: PlanarPose,
    ) -> Result<(), RecordingError> {
        let PlanarPose { x_m, y_m, yaw_rad } = child_in_parent;
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

    /// Writes what was known at a time.
    ///
    /// # Errors
    /// When it can't be written.
    pub fn estimate(&mut self, stamp_ns: i64, estimate: &Value) -> Result<(), RecordingError> {
        self.write_json(self.estimates, stamp_ns, estimate)
    }

    /// Writes what happened, as a warning.
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

    /// Writes the end of the file. One without it is refused as truncated.
    ///
    /// # Errors
    /// When it can't be written.
    pub fn finish(mut self) -> Result<(), RecordingError> {
        let finished = self.writer.finish();
        finished.map_err(|error| refused(&self.path, error))?;
        let file = self.writer.into_inner().into_inner();
        let io = |source| RecordingError::Io {
            path: self.path.clone(),
            source,
        };
        let file = file.map_err(|error| io(error.into_error()))?;
        file.sync_all().map_err(io)
    }

    fn write_json(
        &mut self,
        channel: u16,
        stamp_ns: i64,
        value: &Value,
    ) -> Result<(), RecordingError> {
        let time_ns = stamp_ns.max(0).unsigned_abs();
        self.write(channel, time_ns, value.to_string().as_bytes())
    }

    fn write(
        &mut self,
        channel_id: u16,
        time_ns: u64,
        payload: &[u8],
    ) -> Result<(), RecordingError> {
        self.sequence = self.sequence.wrapping_add(1);
        let header = MessageHeader {
            channel_id,
            sequence: self.sequence,
            log_time: time_ns,
            publish_time: time_ns,
        };
        self.writer
            .write_to_known_channel(&header, payload)
            .map_err(|error| refused(&self.path, error))
    }
}

/// Foxglove's level of a warning.
const LEVEL_WARNING: u8 = 3;

fn add_stream(
    writer: &mut Writer<BufWriter<File>>,
    channel: &Channel,
) -> Result<Option<u16>, McapError> {
    let definition = match channel.message_type.as_str() {
        AckermannDriveStamped::TYPE => definitions::ACKERMANN,
        LaserScan::TYPE => definitions::LASER_SCAN,
        PointCloud2::TYPE => definitions::POINT_CLOUD,
        Odometry::TYPE => definitions::ODOMETRY,
        _ => return Ok(None),
    };
    let (encoding, text, message) = match channel.encoding.unwrap_or_default() {
        Encoding::Cdr => ("ros2msg", definition.to_owned(), "cdr"),
        Encoding::Json => (
            "jsonschema",
            json!({ "type": "object" }).to_string(),
            "json",
        ),
    };
    let schema = writer.add_schema(&channel.message_type, encoding, text.as_bytes())?;
    let id = writer.add_channel(schema, &channel.topic, message, &BTreeMap::new())?;
    Ok(Some(id))
}

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

fn refused(path: &Path, error: McapError) -> RecordingError {
    let path = path.to_owned();
    match error {
        McapError::Io(source) => RecordingError::Io { path, source },
        error => RecordingError::Write {
            path,
            source: Box::new(error),
        },
    }
}
