//! `sensor_msgs/msg/MultiEchoLaserScan`: one scan of a planar LiDAR with several echoes a beam.

use std::sync::Arc;

use serde::{Deserialize, Serialize};

use super::{Header, LaserScan, RosMessage, serde_forms};
use crate::cdr::{CdrError, CdrReader, CdrWriter};

/// Most beams of a scan.
const BEAMS_MAX: usize = 65_536;

/// Echoes of one beam, the nearest first; empty for a missing return.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct LaserEcho {
    /// Ranges, m, or intensities.
    #[serde(
        serialize_with = "serde_forms::beams",
        deserialize_with = "serde_forms::ranges"
    )]
    pub echoes: Arc<[f32]>,
}

/// One scan, with the fields of a [`LaserScan`].
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct MultiEchoLaserScan {
    /// Time of the first beam, and the LiDAR's frame.
    pub header: Header,
    /// Direction of the first beam, rad.
    pub angle_min: f32,
    /// Direction of the last beam, rad.
    pub angle_max: f32,
    /// Angle from one beam to the next, rad.
    pub angle_increment: f32,
    /// Time from one beam to the next, s.
    pub time_increment: f32,
    /// Time from one scan to the next, s.
    #[serde(default)]
    pub scan_time: f32,
    /// Shortest valid range, m.
    pub range_min: f32,
    /// Longest valid range, m.
    pub range_max: f32,
    /// Ranges of each beam.
    #[serde(deserialize_with = "serde_forms::at_most::<_, BEAMS_MAX, _>")]
    pub ranges: Vec<LaserEcho>,
    /// Intensities of each beam, or empty.
    #[serde(default, deserialize_with = "serde_forms::at_most::<_, BEAMS_MAX, _>")]
    pub intensities: Vec<LaserEcho>,
}

impl MultiEchoLaserScan {
    /// Returns the scan of the first echoes, without intensities.
    pub fn first_echoes(self) -> LaserScan {
        let first = |beam: &LaserEcho| beam.echoes.first().copied().unwrap_or(f32::INFINITY);
        LaserScan {
            header: self.header,
            angle_min: self.angle_min,
            angle_max: self.angle_max,
            angle_increment: self.angle_increment,
            time_increment: self.time_increment,
            scan_time: self.scan_time,
            range_min: self.range_min,
            range_max: self.range_max,
            ranges: self.ranges.iter().map(first).collect(),
            intensities: serde_forms::no_beams(),
        }
    }
}

fn echoes(reader: &mut CdrReader<'_>, field: &'static str) -> Result<Vec<LaserEcho>, CdrError> {
    reader.sequence(field, 4, BEAMS_MAX, |reader| {
        let echoes = reader.f32_sequence(field)?;
        Ok(LaserEcho { echoes })
    })
}

impl RosMessage for MultiEchoLaserScan {
    const TYPE: &'static str = "sensor_msgs/msg/MultiEchoLaserScan";

    fn read(mut reader: CdrReader<'_>) -> Result<Self, CdrError> {
        let message = Self {
            header: Header::read(&mut reader)?,
            angle_min: reader.f32("angle_min")?,
            angle_max: reader.f32("angle_max")?,
            angle_increment: reader.f32("angle_increment")?,
            time_increment: reader.f32("time_increment")?,
            scan_time: reader.f32("scan_time")?,
            range_min: reader.f32("range_min")?,
            range_max: reader.f32("range_max")?,
            ranges: echoes(&mut reader, "ranges")?,
            intensities: echoes(&mut reader, "intensities")?,
        };
        reader.finish("intensities")?;
        Ok(message)
    }

    fn write(&self, writer: &mut CdrWriter) {
        self.header.write(writer);
        for value in [
            self.angle_min,
            self.angle_max,
            self.angle_increment,
            self.time_increment,
            self.scan_time,
            self.range_min,
            self.range_max,
        ] {
            writer.f32(value);
        }
        for beams in [&self.ranges, &self.intensities] {
            writer.sequence_length(beams.len());
            for beam in beams {
                writer.f32_sequence(&beam.echoes);
            }
        }
    }

    fn body_bytes(&self) -> usize {
        let of = |beam: &LaserEcho| 4 + 4 * beam.echoes.len();
        let beams: usize = self.ranges.iter().chain(&self.intensities).map(of).sum();
        self.header.body_bytes() + 36 + beams
    }
}
