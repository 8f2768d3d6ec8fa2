//! `builtin_interfaces/msg/Time` and `std_msgs/msg/Header`.

use serde::de::Error as _;
use serde::{Deserialize, Deserializer, Serialize};

use crate::cdr::{CdrError, CdrReader, CdrWriter};

/// Nanoseconds of a second.
pub(super) const NANOSEC_END: u32 = 1_000_000_000;

/// Time since 1970: whole seconds, and nanoseconds that are always added.
#[derive(
    Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Default, Serialize, Deserialize,
)]
#[serde(deny_unknown_fields)]
pub struct Time {
    /// Seconds.
    pub sec: i32,
    /// Nanoseconds, less than 1,000,000,000.
    #[serde(deserialize_with = "below_a_second")]
    pub nanosec: u32,
}

impl Time {
    /// Reads a time; its two fields have these names.
    pub(super) fn read(
        reader: &mut CdrReader<'_>,
        sec: &'static str,
        field: &'static str,
    ) -> Result<Self, CdrError> {
        let sec = reader.i32(sec)?;
        let nanosec = reader.u32(field)?;
        if nanosec >= NANOSEC_END {
            let value = nanosec.to_string();
            return Err(CdrError::Value {
                field,
                value,
                accepted: "less than 1000000000",
            });
        }
        Ok(Self { sec, nanosec })
    }

    pub(super) fn write(self, writer: &mut CdrWriter) {
        writer.i32(self.sec);
        writer.u32(self.nanosec);
    }

    /// Returns the time in nanoseconds.
    pub fn as_ns(self) -> i64 {
        i64::from(self.sec) * i64::from(NANOSEC_END) + i64::from(self.nanosec)
    }

    /// Returns the time `stamp_ns` nanoseconds after 1970; `None` outside the 68 years either way
    /// that a ROS stamp can represent.
    pub fn from_ns(stamp_ns: i64) -> Option<Self> {
        let second_ns = i64::from(NANOSEC_END);
        let sec = i32::try_from(stamp_ns.div_euclid(second_ns)).ok()?;
        let nanosec = u32::try_from(stamp_ns.rem_euclid(second_ns)).ok()?;
        Some(Self { sec, nanosec })
    }
}

/// Stamp and frame of a message.
#[derive(Debug, Clone, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Header {
    /// Stamp by the robot's clock.
    pub stamp: Time,
    /// Name of the frame.
    #[serde(default)]
    pub frame_id: String,
}

impl Header {
    pub(super) fn read(reader: &mut CdrReader<'_>) -> Result<Self, CdrError> {
        let stamp = Time::read(reader, "header.stamp.sec", "header.stamp.nanosec")?;
        let frame_id = reader.string("header.frame_id")?;
        Ok(Self { stamp, frame_id })
    }

    pub(super) fn write(&self, writer: &mut CdrWriter) {
        self.stamp.write(writer);
        writer.string(&self.frame_id);
    }

    pub(super) fn body_bytes(&self) -> usize {
        // Two words, the length, the NUL, and what aligns the next field.
        20 + self.frame_id.len()
    }
}

/// Reads the nanoseconds of a stamp, which are less than a second.
fn below_a_second<'de, D: Deserializer<'de>>(deserializer: D) -> Result<u32, D::Error> {
    let nanosec = u32::deserialize(deserializer)?;
    if nanosec < NANOSEC_END {
        return Ok(nanosec);
    }
    Err(D::Error::custom(format!(
        "{nanosec} ns, expected less than 1000000000"
    )))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn times_go_to_nanoseconds_and_back() {
        for ns in [0, 1, -1, 1_700_000_000_250_000_000, -2_000_000_000] {
            assert_eq!(Time::from_ns(ns).unwrap().as_ns(), ns);
        }
        assert_eq!(
            Time::from_ns(-1),
            Some(Time {
                sec: -1,
                nanosec: 999_999_999
            })
        );
        assert_eq!(Time::from_ns(i64::MAX), None);
    }
}
