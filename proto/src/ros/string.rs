//! `std_msgs/msg/String`.

use serde::{Deserialize, Serialize};

use super::RosMessage;
use crate::cdr::{CdrError, CdrReader, CdrWriter};

/// A text.
#[derive(Debug, Clone, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct StringMessage {
    /// The text.
    pub data: String,
}

impl RosMessage for StringMessage {
    const TYPE: &'static str = "std_msgs/msg/String";

    fn read(mut reader: CdrReader<'_>) -> Result<Self, CdrError> {
        let data = reader.string("data")?;
        reader.finish("data")?;
        Ok(Self { data })
    }

    fn write(&self, writer: &mut CdrWriter) {
        writer.string(&self.data);
    }

    fn body_bytes(&self) -> usize {
        8 + self.data.len()
    }
}
