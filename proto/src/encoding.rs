//! In which form a message travels, as its Zenoh encoding says.

use serde::{Deserialize, Serialize};
use thiserror::Error;

use crate::cdr::CdrError;
use crate::ros::{LaserScan, PointCloud2, RosMessage};

/// How much of what a sender wrote is repeated in a refusal, in characters.
const SHOWN_MAX: usize = 160;

/// The form of a ROS 2 message on the wire.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Encoding {
    /// CDR, `application/cdr`, and what is taken when the sender says nothing.
    #[default]
    Cdr,
    /// JSON with the same field names, `application/json`.
    Json,
}

impl Encoding {
    /// Reads a Zenoh encoding. What follows a `;` is a schema's name and is left aside; Zenoh's own
    /// `zenoh/bytes` and an empty text mean that the sender said nothing.
    ///
    /// # Errors
    /// Any other encoding, by name.
    pub fn parse(text: &str) -> Result<Self, DecodeError> {
        match text.split(';').next().unwrap_or_default() {
            "" | "zenoh/bytes" | "application/cdr" => Ok(Self::Cdr),
            "application/json" | "text/json" => Ok(Self::Json),
            _ => Err(DecodeError::Encoding {
                encoding: clipped(text),
            }),
        }
    }

    /// Its name on the wire.
    pub const fn as_str(self) -> &'static str {
        match self {
            Self::Cdr => "application/cdr",
            Self::Json => "application/json",
        }
    }
}

/// Which of the messages that a scan may be a sender says that it is.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default, Serialize, Deserialize)]
pub enum ScanType {
    /// `sensor_msgs/msg/LaserScan`.
    #[default]
    #[serde(rename = "laser_scan")]
    LaserScan,
    /// `sensor_msgs/msg/PointCloud2`.
    #[serde(rename = "point_cloud2")]
    PointCloud2,
}

impl ScanType {
    /// Reads the name of a ROS 2 type in any of the spellings in use; `None` for any other.
    pub fn of_ros_type(name: &str) -> Option<Self> {
        let last = name.rsplit(['/', ':']).next().unwrap_or_default();
        match last.strip_suffix('_').unwrap_or(last) {
            "LaserScan" => Some(Self::LaserScan),
            "PointCloud2" => Some(Self::PointCloud2),
            _ => None,
        }
    }

    /// Its ROS 2 type.
    pub const fn ros_type(self) -> &'static str {
        match self {
            Self::LaserScan => LaserScan::TYPE,
            Self::PointCloud2 => PointCloud2::TYPE,
        }
    }
}

/// How a payload is to be read: its encoding, and for a scan its type, where the sender names it.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Form {
    /// CDR or JSON.
    pub encoding: Encoding,
    /// What stands behind the `;` of a Zenoh encoding, where it is the type of a scan.
    pub scan_type: Option<ScanType>,
}

impl Form {
    /// Reads a Zenoh encoding.
    ///
    /// # Errors
    /// Any other encoding than CDR and JSON, by name.
    pub fn parse(text: &str) -> Result<Self, DecodeError> {
        let schema = text.split_once(';').map(|(_, schema)| schema.trim());
        Ok(Self {
            encoding: Encoding::parse(text)?,
            scan_type: schema.and_then(ScanType::of_ros_type),
        })
    }

    /// Its name on the wire: `application/cdr;sensor_msgs/msg/PointCloud2`.
    pub fn to_text(self) -> String {
        let encoding = self.encoding.as_str();
        match self.scan_type {
            None => encoding.to_owned(),
            Some(scan_type) => format!("{encoding};{}", scan_type.ros_type()),
        }
    }
}

impl From<Encoding> for Form {
    fn from(encoding: Encoding) -> Self {
        Self {
            encoding,
            scan_type: None,
        }
    }
}

/// Why a payload is not the message it should be.
#[derive(Debug, Error)]
pub enum DecodeError {
    /// The sender named an encoding that is not read here.
    #[error("encoding is {encoding:?}, accepted are application/cdr and application/json")]
    Encoding {
        /// What the sender named.
        encoding: String,
    },
    /// It is no such message in CDR.
    #[error("{message}: {reason}")]
    Cdr {
        /// The ROS 2 type that was expected.
        message: &'static str,
        /// The field and what is wrong with it.
        #[source]
        reason: CdrError,
    },
    /// It is no such message in JSON.
    #[error("{message}: {field}: {reason}")]
    Json {
        /// The ROS 2 type that was expected.
        message: &'static str,
        /// Path of the field, `drive.speed`; `.` for the whole message.
        field: String,
        /// What is wrong with it.
        reason: String,
    },
}

impl DecodeError {
    /// A refusal of JSON. Both texts may hold what the sender wrote, of any length.
    pub(crate) fn json(message: &'static str, field: &str, reason: &serde_json::Error) -> Self {
        let field = if field.is_empty() { "." } else { field };
        Self::Json {
            message,
            field: clipped(field),
            reason: clipped(&reason.to_string()),
        }
    }
}

fn clipped(text: &str) -> String {
    match text.char_indices().nth(SHOWN_MAX) {
        None => text.to_owned(),
        Some((end, _)) => format!("{}…", text.get(..end).unwrap_or_default()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_schema_names_the_type_of_a_scan() {
        let form = |text: &str| Form::parse(text).unwrap();
        for name in [
            "sensor_msgs/msg/PointCloud2",
            "sensor_msgs::msg::dds_::PointCloud2_",
            "PointCloud2",
        ] {
            let text = format!("application/cdr;{name}");
            assert_eq!(form(&text).scan_type, Some(ScanType::PointCloud2));
        }
        let scan = form("application/json;sensor_msgs/msg/LaserScan");
        assert_eq!(scan.encoding, Encoding::Json);
        assert_eq!(scan.scan_type, Some(ScanType::LaserScan));
        for text in [
            "",
            "application/cdr",
            "application/cdr;Image",
            "text/json;x/1",
        ] {
            assert_eq!(form(text).scan_type, None, "{text}");
        }
        assert!(Form::parse("image/png;PointCloud2").is_err());
        for text in [
            "application/cdr;sensor_msgs/msg/PointCloud2",
            "application/json",
        ] {
            assert_eq!(form(text).to_text(), text);
        }
    }

    #[test]
    fn encodings_are_read_by_name() {
        for text in [
            "",
            "zenoh/bytes",
            "application/cdr",
            "application/cdr;LaserScan",
        ] {
            assert_eq!(Encoding::parse(text).unwrap(), Encoding::Cdr);
        }
        for text in ["application/json", "application/json;x/1", "text/json"] {
            assert_eq!(Encoding::parse(text).unwrap(), Encoding::Json);
        }
        let sentence = Encoding::parse("image/png").unwrap_err().to_string();
        assert!(sentence.contains("image/png") && sentence.contains("application/json"));
        let long = Encoding::parse(&"ü".repeat(1_000_000))
            .unwrap_err()
            .to_string();
        assert!(long.len() < 1000, "a refusal repeats {} bytes", long.len());
    }
}
