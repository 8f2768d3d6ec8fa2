//! `tf2_msgs/msg/TFMessage`: poses of frames in other frames.

use serde::{Deserialize, Serialize};

use super::{Header, Quaternion, RosMessage, Vector3};
use crate::cdr::{CdrError, CdrReader, CdrWriter};

/// Most transforms of a message.
pub const TRANSFORMS_MAX: usize = 2_048;
/// Fewest bytes of a transform in CDR.
const TRANSFORM_BYTES_MIN: usize = 72;

/// Some transforms.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TfMessage {
    /// The transforms, at most [`TRANSFORMS_MAX`].
    pub transforms: Vec<TransformStamped>,
}

/// Pose of a child frame in the header's frame.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TransformStamped {
    /// Stamp, and the parent frame.
    pub header: Header,
    /// Child frame.
    pub child_frame_id: String,
    /// Pose.
    pub transform: Transform,
}

/// Translation, m, and rotation.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Transform {
    /// Translation, m.
    pub translation: Vector3,
    /// Rotation.
    pub rotation: Quaternion,
}

impl RosMessage for TfMessage {
    const TYPE: &'static str = "tf2_msgs/msg/TFMessage";

    fn read(mut reader: CdrReader<'_>) -> Result<Self, CdrError> {
        let transforms = reader.sequence(
            "transforms",
            TRANSFORM_BYTES_MIN,
            TRANSFORMS_MAX,
            |reader| {
                let header = Header::read(reader)?;
                let child_frame_id = reader.string("transforms.child_frame_id")?;
                let [x, y, z] = reader.f64_array("transforms.transform.translation")?;
                let translation = Vector3 { x, y, z };
                let [x, y, z, w] = reader.f64_array("transforms.transform.rotation")?;
                let rotation = Quaternion { x, y, z, w };
                Ok(TransformStamped {
                    header,
                    child_frame_id,
                    transform: Transform {
                        translation,
                        rotation,
                    },
                })
            },
        )?;
        reader.finish("transforms")?;
        Ok(Self { transforms })
    }

    fn write(&self, writer: &mut CdrWriter) {
        writer.sequence_length(self.transforms.len());
        for of in &self.transforms {
            of.header.write(writer);
            writer.string(&of.child_frame_id);
            let (place, turn) = (of.transform.translation, of.transform.rotation);
            writer.f64_array(&[place.x, place.y, place.z]);
            writer.f64_array(&[turn.x, turn.y, turn.z, turn.w]);
        }
    }

    fn body_bytes(&self) -> usize {
        let bytes = |of: &TransformStamped| of.header.body_bytes() + of.child_frame_id.len() + 80;
        8 + self.transforms.iter().map(bytes).sum::<usize>()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn transforms_are_read_as_they_were_written() {
        let transform = |parent: &str, child: &str| {
            let mut of = TransformStamped::default();
            parent.clone_into(&mut of.header.frame_id);
            child.clone_into(&mut of.child_frame_id);
            of.transform.translation.x = 0.4;
            of.transform.rotation = Quaternion {
                x: 1.0,
                y: 0.0,
                z: 0.0,
                w: 0.0,
            };
            of
        };
        for transforms in [
            Vec::new(),
            vec![transform("", "")],
            vec![transform("base_link", "laser"), transform("laser", "a")],
        ] {
            let message = TfMessage { transforms };
            assert_eq!(TfMessage::from_cdr(&message.to_cdr()).unwrap(), message);
            let json = serde_json::to_vec(&message).unwrap();
            assert_eq!(TfMessage::from_json(&json).unwrap(), message);
        }
        let many = TfMessage {
            transforms: vec![TransformStamped::default(); TRANSFORMS_MAX + 1],
        };
        assert!(TfMessage::from_cdr(&many.to_cdr()).is_err());
    }
}
