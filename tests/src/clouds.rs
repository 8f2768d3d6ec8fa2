//! Recordings of robots with a 3D scanner, made of those of robots with a planar one.

use std::borrow::Cow;
use std::collections::BTreeMap;
use std::fs::File;
use std::io::BufWriter;
use std::path::Path;

use fleetcal_proto::ros::{LaserScan, PointCloud2, PointDatatype, PointField, RosMessage};
use fleetcal_robot::recording::Recording;
use mcap::records::MessageHeader;
use mcap::{WriteOptions, Writer};

/// Elevations of the scanner's rings, degrees.
const RINGS_DEG: [f64; 8] = [-15.0, -10.0, -6.0, -3.0, -1.0, 1.0, 4.0, 12.0];
/// Heights of the floor and of the ceiling from the LiDAR, m.
const FLOOR_M: f64 = -0.5;
const CEILING_M: f64 = 4.0;
/// Of the planar scanner's beams each so many make a column.
const BEAMS_A_COLUMN: usize = 2;

/// Writes a recording's messages as `path`, its sweeps as the clouds that a scanner of eight rings
/// would have taken: walls from the floor to the ceiling, where the sweep saw them.
///
/// # Panics
/// When it cannot be written.
pub fn of_sweeps(recording: &Path, path: &Path) {
    let recording = Recording::open(recording).expect("a recording");
    let file = BufWriter::new(File::create(path).expect("a file"));
    let options = WriteOptions::new().profile("ros2");
    let mut writer = options.create(file).expect("a recording");
    let mut channels = BTreeMap::new();
    for channel in recording.channels() {
        let is_scan = channel.message_type == LaserScan::TYPE;
        let message_type = if is_scan {
            PointCloud2::TYPE
        } else {
            &channel.message_type
        };
        let id = add_channel(&mut writer, &channel.topic, message_type);
        channels.insert(channel.topic.as_str(), (id, is_scan));
    }
    let topics: Vec<&str> = channels.keys().copied().collect();
    for message in recording.messages(&topics).expect("readable") {
        let message = message.expect("readable");
        let &(channel_id, is_scan) = channels.get(&*message.topic).expect("a topic of it");
        let payload = if is_scan {
            let scan = LaserScan::from_cdr(&message.payload).expect("a scan");
            Cow::Owned(cloud(&scan).to_cdr())
        } else {
            Cow::Borrowed(&message.payload)
        };
        let header = MessageHeader {
            channel_id,
            sequence: 0,
            log_time: message.log_time_ns,
            publish_time: message.log_time_ns,
        };
        let written = writer.write_to_known_channel(&header, &payload);
        written.expect("written");
    }
    writer.finish().expect("written");
}

fn add_channel(writer: &mut Writer<BufWriter<File>>, topic: &str, message_type: &str) -> u16 {
    let schema = writer.add_schema(message_type, "ros2msg", b"");
    let schema = schema.expect("a schema");
    let channel = writer.add_channel(schema, topic, "cdr", &BTreeMap::new());
    channel.expect("a channel")
}

/// The cloud of a turn: ring after ring, each point with its time.
fn cloud(scan: &LaserScan) -> PointCloud2 {
    let beams = || scan.ranges.iter().enumerate().step_by(BEAMS_A_COLUMN);
    let mut data = Vec::new();
    for ring_deg in RINGS_DEG {
        let slope = ring_deg.to_radians().tan();
        let flat_m = if slope < 0.0 { FLOOR_M } else { CEILING_M } / slope;
        for (beam, &range) in beams() {
            let azimuth = f64::from(scan.angle_min) + beam as f64 * f64::from(scan.angle_increment);
            let is_return = (scan.range_min..=scan.range_max).contains(&range);
            let wall_m = if is_return {
                f64::from(range)
            } else {
                f64::INFINITY
            };
            let level_m = wall_m.min(flat_m);
            let position = [
                level_m * azimuth.cos(),
                level_m * azimuth.sin(),
                level_m * slope,
            ];
            let time_s = beam as f32 * scan.time_increment;
            let numbers = position.map(|metres| metres as f32);
            data.extend(numbers.into_iter().flat_map(f32::to_le_bytes));
            data.extend(time_s.to_le_bytes());
        }
    }
    let fields = ["x", "y", "z", "time"].into_iter().zip((0..).step_by(4));
    let width = beams().count() as u32;
    PointCloud2 {
        header: scan.header.clone(),
        height: RINGS_DEG.len() as u32,
        width,
        fields: fields
            .map(|(name, offset)| PointField {
                name: name.to_owned(),
                offset,
                datatype: PointDatatype::Float32,
                count: 1,
            })
            .collect(),
        is_bigendian: false,
        point_step: 16,
        row_step: 16 * width,
        data: data.into(),
        is_dense: false,
    }
}
