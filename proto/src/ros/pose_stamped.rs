//! `geometry_msgs/msg/PoseStamped`.

use serde::{Deserialize, Serialize};

use super::{Header, Pose, RosMessage};
use crate::cdr::{CdrError, CdrReader, CdrWriter};

/// A pose in the header's frame.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PoseStamped {
    /// Stamp, and the frame of the pose.
    pub header: Header,
    /// The pose.
    pub pose: Pose,
}

impl RosMessage for PoseStamped {
    const TYPE: &'static str = "geometry_msgs/msg/PoseStamped";

    fn read(mut reader: CdrReader<'_>) -> Result<Self, CdrError> {
        let header = Header::read(&mut reader)?;
        let pose = Pose::read(&mut reader, ["pose.position", "pose.orientation"])?;
        reader.finish("pose.orientation")?;
        Ok(Self { header, pose })
    }

    fn write(&self, writer: &mut CdrWriter) {
        self.header.write(writer);
        self.pose.write(writer);
    }

    fn body_bytes(&self) -> usize {
        self.header.body_bytes() + 8 + 8 * 7
    }
}
