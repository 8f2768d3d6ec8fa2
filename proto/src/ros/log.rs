//! `rcl_interfaces/msg/Log`.

use serde::{Deserialize, Serialize};

use super::{RosMessage, Time};
use crate::cdr::{CdrError, CdrReader, CdrWriter};

/// Line of a node's log, as on `/rosout`.
#[derive(Debug, Clone, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Log {
    /// Time of the line.
    pub stamp: Time,
    /// Severity: 10, 20, 30, 40 and 50 from debug to fatal.
    pub level: u8,
    /// Name of the node.
    pub name: String,
    /// The line.
    pub msg: String,
    /// File of the source.
    pub file: String,
    /// Function of the source.
    pub function: String,
    /// Line of the source.
    pub line: u32,
}

impl Log {
    /// Severity of a warning.
    pub const WARN: u8 = 30;
}

impl RosMessage for Log {
    const TYPE: &'static str = "rcl_interfaces/msg/Log";

    fn read(mut reader: CdrReader<'_>) -> Result<Self, CdrError> {
        let stamp = Time::read(&mut reader, "stamp.sec", "stamp.nanosec")?;
        let log = Self {
            stamp,
            level: reader.u8("level")?,
            name: reader.string("name")?,
            msg: reader.string("msg")?,
            file: reader.string("file")?,
            function: reader.string("function")?,
            line: reader.u32("line")?,
        };
        reader.finish("line")?;
        Ok(log)
    }

    fn write(&self, writer: &mut CdrWriter) {
        self.stamp.write(writer);
        writer.u8(self.level);
        for text in [&self.name, &self.msg, &self.file, &self.function] {
            writer.string(text);
        }
        writer.u32(self.line);
    }

    fn body_bytes(&self) -> usize {
        let texts = [&self.name, &self.msg, &self.file, &self.function];
        16 + texts.map(|text| text.len() + 8).iter().sum::<usize>()
    }
}
