//! `sensor_msgs/msg/PointCloud2`: the points of a 3D scanner, each a record of named numbers.

use std::sync::Arc;

use serde::{Deserialize, Serialize};
use thiserror::Error;

use super::{Header, RosMessage, serde_forms};
use crate::cdr::{CdrError, CdrReader, CdrWriter};

/// Most fields that a point may have.
pub const FIELDS_MAX: usize = 64;
/// Most points of a cloud: four times those of the largest rotating scanners.
pub const POINTS_MAX: u64 = 1 << 20;
/// Least bytes that a field takes on the wire: an empty name's length, offset, datatype and count.
const FIELD_BYTES_MIN: usize = 13;

/// The type of a field's numbers.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(try_from = "u8", into = "u8")]
#[repr(u8)]
pub enum PointDatatype {
    /// `int8`.
    Int8 = 1,
    /// `uint8`.
    Uint8 = 2,
    /// `int16`.
    Int16 = 3,
    /// `uint16`.
    Uint16 = 4,
    /// `int32`.
    Int32 = 5,
    /// `uint32`.
    Uint32 = 6,
    /// `float32`.
    Float32 = 7,
    /// `float64`.
    Float64 = 8,
}

/// Accepted numbers of a datatype, in words.
const DATATYPES: &str = "1 to 8 (int8, uint8, int16, uint16, int32, uint32, float32, float64)";

impl PointDatatype {
    /// All datatypes, in the order of their numbers.
    pub const ALL: [Self; 8] = [
        Self::Int8,
        Self::Uint8,
        Self::Int16,
        Self::Uint16,
        Self::Int32,
        Self::Uint32,
        Self::Float32,
        Self::Float64,
    ];

    /// Returns the size of one number, bytes.
    pub const fn bytes(self) -> usize {
        match self {
            Self::Int8 | Self::Uint8 => 1,
            Self::Int16 | Self::Uint16 => 2,
            Self::Int32 | Self::Uint32 | Self::Float32 => 4,
            Self::Float64 => 8,
        }
    }
}

impl TryFrom<u8> for PointDatatype {
    type Error = String;

    fn try_from(number: u8) -> Result<Self, String> {
        let found = Self::ALL.into_iter().find(|&kind| kind as u8 == number);
        found.ok_or_else(|| format!("datatype: got {number}, expected {DATATYPES}"))
    }
}

impl From<PointDatatype> for u8 {
    fn from(datatype: PointDatatype) -> Self {
        datatype as Self
    }
}

/// `sensor_msgs/msg/PointField`: one field of every point.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PointField {
    /// Its name: `x`, `intensity`.
    pub name: String,
    /// Offset in a point, bytes.
    pub offset: u32,
    /// The type of its numbers.
    pub datatype: PointDatatype,
    /// Number of its values.
    pub count: u32,
}

/// Points of one turn of a scanner. Their bytes are checked by [`PointCloud2::check_layout`], not
/// when they are read.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PointCloud2 {
    /// Stamp, and the LiDAR's frame.
    pub header: Header,
    /// Rows: rings of an organised cloud, 1 for an unorganised one.
    pub height: u32,
    /// Points of a row.
    pub width: u32,
    /// Fields of a point.
    #[serde(deserialize_with = "serde_forms::at_most::<_, FIELDS_MAX, _>")]
    pub fields: Vec<PointField>,
    /// True if numbers have their most significant byte first.
    pub is_bigendian: bool,
    /// Bytes from one point to the next.
    pub point_step: u32,
    /// Bytes from one row to the next.
    pub row_step: u32,
    /// The points.
    #[serde(
        serialize_with = "serde_forms::base64",
        deserialize_with = "serde_forms::bytes"
    )]
    pub data: Arc<[u8]>,
    /// True if every point is valid.
    pub is_dense: bool,
}

/// Reason for which a cloud contradicts itself.
#[derive(Debug, Clone, PartialEq, Eq, Error)]
#[error("{field}: got {value}, expected {accepted}")]
pub struct CloudRefused {
    /// Name of the field.
    pub field: &'static str,
    /// Its value.
    pub value: String,
    /// Accepted values.
    pub accepted: String,
}

impl CloudRefused {
    fn new(field: &'static str, value: impl Into<String>, accepted: impl Into<String>) -> Self {
        Self {
            field,
            value: value.into(),
            accepted: accepted.into(),
        }
    }
}

/// Place and type of a number in a point.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Column {
    offset: usize,
    datatype: PointDatatype,
    is_bigendian: bool,
}

impl Column {
    /// Returns the type of its numbers.
    pub fn datatype(&self) -> PointDatatype {
        self.datatype
    }

    /// Reads the number from a point's bytes; not-a-number if the point is too short.
    #[inline]
    pub fn read(&self, point: &[u8]) -> f64 {
        let number = match self.datatype {
            PointDatatype::Int8 => self.bytes(point).map(|b| f64::from(i8::from_le_bytes(b))),
            PointDatatype::Uint8 => self.bytes(point).map(|b| f64::from(u8::from_le_bytes(b))),
            PointDatatype::Int16 => self.bytes(point).map(|b| f64::from(i16::from_le_bytes(b))),
            PointDatatype::Uint16 => self.bytes(point).map(|b| f64::from(u16::from_le_bytes(b))),
            PointDatatype::Int32 => self.bytes(point).map(|b| f64::from(i32::from_le_bytes(b))),
            PointDatatype::Uint32 => self.bytes(point).map(|b| f64::from(u32::from_le_bytes(b))),
            PointDatatype::Float32 => self.bytes(point).map(|b| f64::from(f32::from_le_bytes(b))),
            PointDatatype::Float64 => self.bytes(point).map(f64::from_le_bytes),
        };
        number.unwrap_or(f64::NAN)
    }

    /// Returns its bytes, the least significant first.
    #[inline]
    fn bytes<const N: usize>(&self, point: &[u8]) -> Option<[u8; N]> {
        let mut bytes: [u8; N] = *point.get(self.offset..)?.first_chunk()?;
        if self.is_bigendian {
            bytes.reverse();
        }
        Some(bytes)
    }
}

impl PointCloud2 {
    /// Checks that sizes, steps and fields agree with the bytes.
    ///
    /// # Errors
    /// Names the field, its value and the accepted values.
    pub fn check_layout(&self) -> Result<(), CloudRefused> {
        let points = u64::from(self.width) * u64::from(self.height);
        if points > POINTS_MAX {
            let value = format!("{} by {} points", self.width, self.height);
            let accepted = format!("at most {POINTS_MAX} points");
            return Err(CloudRefused::new("width", value, accepted));
        }
        let point_step = u64::from(self.point_step);
        for field in &self.fields {
            let bytes = u64::from(field.count) * field.datatype.bytes() as u64;
            let end = u64::from(field.offset) + bytes;
            if end > point_step {
                let value = format!("{:?} up to byte {end}", clipped(&field.name));
                let accepted = format!("fields inside of point_step, {point_step} bytes");
                return Err(CloudRefused::new("fields", value, accepted));
            }
        }
        if point_step == 0 {
            return Err(CloudRefused::new("point_step", "0", "1 or more bytes"));
        }
        let row = u64::from(self.width) * point_step;
        if u64::from(self.row_step) < row {
            let accepted = format!("width times point_step, {row} bytes, or more");
            return Err(CloudRefused::new(
                "row_step",
                self.row_step.to_string(),
                accepted,
            ));
        }
        let wanted = u64::from(self.row_step) * u64::from(self.height);
        if self.data.len() as u64 != wanted {
            let value = format!("{} bytes", self.data.len());
            let accepted = format!("row_step times height, {wanted} bytes");
            return Err(CloudRefused::new("data", value, accepted));
        }
        Ok(())
    }

    /// Returns the first number of the field called `name`; `None` without the field.
    pub fn column(&self, name: &str) -> Option<Column> {
        let mut fields = self.fields.iter();
        let field = fields.find(|field| field.name == name && field.count > 0)?;
        Some(Column {
            offset: field.offset as usize,
            datatype: field.datatype,
            is_bigendian: self.is_bigendian,
        })
    }

    /// Returns the first number of a required field.
    ///
    /// # Errors
    /// Lists the present fields.
    pub fn needed_column(&self, name: &'static str) -> Result<Column, CloudRefused> {
        self.column(name).ok_or_else(|| {
            let names: Vec<_> = self.fields.iter().map(|f| clipped(&f.name)).collect();
            let value = format!("[{}]", names.join(", "));
            CloudRefused::new("fields", value, format!("a list with {name:?}"))
        })
    }

    /// Iterates over the bytes of each point, row after row, of a cloud whose layout was checked.
    pub fn points(&self) -> impl Iterator<Item = &[u8]> {
        let step = (self.point_step as usize).max(1);
        let row_bytes = self.width as usize * step;
        let rows = self.data.chunks_exact((self.row_step as usize).max(1));
        rows.flat_map(move |row| row.get(..row_bytes).unwrap_or_default().chunks_exact(step))
    }
}

/// Longest name that an error shows, in characters.
const SHOWN_MAX: usize = 40;

fn clipped(name: &str) -> String {
    name.chars().take(SHOWN_MAX).collect()
}

impl PointField {
    fn read(reader: &mut CdrReader<'_>) -> Result<Self, CdrError> {
        Ok(Self {
            name: reader.string("fields.name")?,
            offset: reader.u32("fields.offset")?,
            datatype: {
                let field = "fields.datatype";
                let number = reader.u8(field)?;
                PointDatatype::try_from(number).map_err(|_| CdrError::Value {
                    field,
                    value: number.to_string(),
                    accepted: DATATYPES,
                })?
            },
            count: reader.u32("fields.count")?,
        })
    }

    fn write(&self, writer: &mut CdrWriter) {
        writer.string(&self.name);
        writer.u32(self.offset);
        writer.u8(self.datatype.into());
        writer.u32(self.count);
    }
}

impl RosMessage for PointCloud2 {
    const TYPE: &'static str = "sensor_msgs/msg/PointCloud2";

    fn read(mut reader: CdrReader<'_>) -> Result<Self, CdrError> {
        let message = Self {
            header: Header::read(&mut reader)?,
            height: reader.u32("height")?,
            width: reader.u32("width")?,
            fields: reader.sequence("fields", FIELD_BYTES_MIN, FIELDS_MAX, PointField::read)?,
            is_bigendian: reader.bool("is_bigendian")?,
            point_step: reader.u32("point_step")?,
            row_step: reader.u32("row_step")?,
            data: reader.byte_sequence("data")?,
            is_dense: reader.bool("is_dense")?,
        };
        reader.finish("is_dense")?;
        Ok(message)
    }

    fn write(&self, writer: &mut CdrWriter) {
        self.header.write(writer);
        writer.u32(self.height);
        writer.u32(self.width);
        writer.sequence_length(self.fields.len());
        for field in &self.fields {
            field.write(writer);
        }
        writer.bool(self.is_bigendian);
        writer.u32(self.point_step);
        writer.u32(self.row_step);
        writer.byte_sequence(&self.data);
        writer.bool(self.is_dense);
    }

    fn body_bytes(&self) -> usize {
        let fields = self.fields.iter().map(|field| 24 + field.name.len());
        self.header.body_bytes() + 32 + fields.sum::<usize>() + self.data.len()
    }
}
