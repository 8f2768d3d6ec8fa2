//! `sensor_msgs/msg/LaserScan`: one scan of a planar LiDAR.

use std::sync::Arc;

use serde::{Deserialize, Serialize};
use thiserror::Error;

use super::{Header, RosMessage, serde_forms};
use crate::cdr::{CdrError, CdrReader, CdrWriter};

/// Largest difference between the number of beams and the number by the angles: drivers count both
/// ends, or one, and round.
pub const BEAMS_TOLERANCE: f64 = 1.5;

/// One scan. Stamped at its first beam; a `time_increment` other than 0 means that the beams were
/// measured one after the other.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct LaserScan {
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
    /// Ranges, m; infinite ones, not-a-number and values outside the limits are missing returns.
    #[serde(
        serialize_with = "serde_forms::beams",
        deserialize_with = "serde_forms::ranges"
    )]
    pub ranges: Arc<[f32]>,
    /// Intensities, one for each beam, or empty.
    #[serde(
        default = "serde_forms::no_beams",
        serialize_with = "serde_forms::beams",
        deserialize_with = "serde_forms::intensities"
    )]
    pub intensities: Arc<[f32]>,
}

/// Reason for which a scan contradicts itself.
#[derive(Debug, Clone, PartialEq, Error)]
pub enum ScanRefused {
    /// An angle is not finite, or the step is impossible.
    #[error("{field}: got {value}, expected a finite number (and a step other than zero)")]
    Angle {
        /// Name of the field.
        field: &'static str,
        /// Its value.
        value: f32,
    },
    /// The number of beams contradicts the angles.
    #[error(
        "ranges has {beams} beams, but angle_min, angle_max and angle_increment make {wanted:.0}; \
         expected that number, one more or one fewer"
    )]
    Length {
        /// Number of beams.
        beams: usize,
        /// Number by the angles.
        wanted: f64,
    },
}

impl LaserScan {
    /// Checks that the number of beams agrees with the angles, within `BEAMS_TOLERANCE`.
    ///
    /// # Errors
    /// Names the angle that is not finite, or both numbers.
    pub fn check_beams(&self) -> Result<(), ScanRefused> {
        let angles = [
            ("angle_min", self.angle_min),
            ("angle_max", self.angle_max),
            ("angle_increment", self.angle_increment),
        ];
        for (field, value) in angles {
            if !value.is_finite() {
                return Err(ScanRefused::Angle { field, value });
            }
        }
        let step_rad = f64::from(self.angle_increment);
        if step_rad == 0.0 {
            return Err(ScanRefused::Angle {
                field: "angle_increment",
                value: 0.0,
            });
        }
        let wanted = (f64::from(self.angle_max) - f64::from(self.angle_min)) / step_rad + 1.0;
        let beams = self.ranges.len();
        if (beams as f64 - wanted).abs() <= BEAMS_TOLERANCE {
            return Ok(());
        }
        Err(ScanRefused::Length { beams, wanted })
    }
}

impl RosMessage for LaserScan {
    const TYPE: &'static str = "sensor_msgs/msg/LaserScan";

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
            ranges: reader.f32_sequence("ranges")?,
            intensities: reader.f32_sequence("intensities")?,
        };
        reader.finish("intensities")?;
        Ok(message)
    }

    fn write(&self, writer: &mut CdrWriter) {
        self.header.write(writer);
        writer.f32(self.angle_min);
        writer.f32(self.angle_max);
        writer.f32(self.angle_increment);
        writer.f32(self.time_increment);
        writer.f32(self.scan_time);
        writer.f32(self.range_min);
        writer.f32(self.range_max);
        writer.f32_sequence(&self.ranges);
        writer.f32_sequence(&self.intensities);
    }

    fn body_bytes(&self) -> usize {
        self.header.body_bytes() + 36 + 4 * (self.ranges.len() + self.intensities.len())
    }
}
