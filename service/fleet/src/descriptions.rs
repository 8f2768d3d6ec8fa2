//! Descriptions that robots publish of themselves: the latest payloads, read when somebody asks.

use std::collections::BTreeMap;
use std::sync::{Mutex, MutexGuard, PoisonError};

use fleetcal_description::{Description, StaticTransform};
use fleetcal_domain::limits::{
    ROBOT_DESCRIPTION_BYTES_MAX, TF_STATIC_BYTES_MAX, TF_STATIC_MESSAGES_MAX,
};
use fleetcal_proto::encoding::Encoding;
use fleetcal_proto::ros::{RosMessage, StringMessage, TfMessage, TransformStamped};
use fleetcal_proto::{DecodeError, RobotId};

/// Topic of a description.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum DescriptionTopic {
    /// `robot_description`, a `std_msgs/msg/String` with a URDF.
    RobotDescription,
    /// `tf_static`, a `tf2_msgs/msg/TFMessage`.
    TfStatic,
}

impl DescriptionTopic {
    /// Both of them.
    pub const ALL: [Self; 2] = [Self::RobotDescription, Self::TfStatic];

    /// Returns the topic with this name below a robot.
    pub fn by_name(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|topic| topic.name() == name)
    }

    /// Returns its name below a robot.
    pub const fn name(self) -> &'static str {
        match self {
            Self::RobotDescription => "robot_description",
            Self::TfStatic => "tf_static",
        }
    }

    /// Returns the largest payload that is kept, bytes.
    pub const fn bytes_max(self) -> usize {
        match self {
            Self::RobotDescription => ROBOT_DESCRIPTION_BYTES_MAX,
            Self::TfStatic => TF_STATIC_BYTES_MAX,
        }
    }
}

/// A payload as it came.
#[derive(Debug, Clone, PartialEq)]
struct Payload {
    encoding: Encoding,
    bytes: Vec<u8>,
}

/// Payloads of one robot.
#[derive(Debug, Clone, Default)]
struct Payloads {
    urdf: Option<Payload>,
    /// The latest, oldest first.
    transforms: Vec<Payload>,
    /// Reason for which the latest message of a topic was refused.
    refused: BTreeMap<DescriptionTopic, String>,
}

impl Payloads {
    fn bytes(&self) -> usize {
        let all = self.urdf.iter().chain(&self.transforms);
        all.map(|payload| payload.bytes.len()).sum()
    }

    /// Returns the bytes that the next payload of a topic replaces.
    fn replaced(&self, topic: DescriptionTopic) -> usize {
        let replaced = match topic {
            DescriptionTopic::RobotDescription => self.urdf.as_ref(),
            DescriptionTopic::TfStatic if self.transforms.len() < TF_STATIC_MESSAGES_MAX => None,
            DescriptionTopic::TfStatic => self.transforms.first(),
        };
        replaced.map_or(0, |payload| payload.bytes.len())
    }

    /// Adds a payload; several nodes may publish static transforms.
    fn add(&mut self, topic: DescriptionTopic, payload: Payload) {
        match topic {
            DescriptionTopic::RobotDescription => self.urdf = Some(payload),
            DescriptionTopic::TfStatic => {
                self.transforms.retain(|known| *known != payload);
                if self.transforms.len() >= TF_STATIC_MESSAGES_MAX {
                    self.transforms.remove(0);
                }
                self.transforms.push(payload);
            }
        }
    }
}

/// Description of a robot as it was read.
#[derive(Debug, Default)]
pub struct ReadDescription {
    /// The description.
    pub description: Description,
    /// Topics that it was read from.
    pub origins: Vec<String>,
    /// Reasons for which parts of it were left out.
    pub remarks: Vec<String>,
}

/// Message of a description that has arrived.
#[derive(Debug)]
pub struct ArrivedDescription<B> {
    /// Topic of the message.
    pub topic: DescriptionTopic,
    /// Encoding of the payload, or the reason for which it is none.
    pub encoding: Result<Encoding, String>,
    /// Length of the payload, bytes.
    pub length: usize,
    /// Payload, which is copied for an accepted message alone.
    pub payload: B,
}

/// Payloads of all robots, bounded together.
#[derive(Debug, Default)]
pub(crate) struct Descriptions(Mutex<Kept>);

#[derive(Debug, Default)]
struct Kept {
    of_robots: BTreeMap<RobotId, Payloads>,
    bytes: usize,
}

impl Descriptions {
    fn kept(&self) -> MutexGuard<'_, Kept> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Keeps a payload, or the reason for which it is refused, while all descriptions together have
    /// at most `room` bytes.
    pub(crate) fn keep<B: FnOnce() -> Vec<u8>>(
        &self,
        robot: &RobotId,
        room: usize,
        arrived: ArrivedDescription<B>,
    ) {
        let topic = arrived.topic;
        let mut kept = self.kept();
        let all = kept.bytes;
        let own = kept.of_robots.entry(robot.clone()).or_default();
        match accepted(own, all, room, arrived) {
            Ok(payload) => {
                let before = own.bytes();
                own.add(topic, payload);
                own.refused.remove(&topic);
                let after = own.bytes();
                kept.bytes = all + after - before;
            }
            Err(reason) => {
                own.refused.insert(topic, reason);
            }
        }
    }

    /// Drops what a robot has published.
    pub(crate) fn forget(&self, robot: &RobotId) {
        let mut kept = self.kept();
        if let Some(own) = kept.of_robots.remove(robot) {
            kept.bytes -= own.bytes();
        }
    }

    /// Reads the description of a robot; `None` if it has published none.
    pub(crate) fn read(&self, robot: &RobotId) -> Option<ReadDescription> {
        let own = self.kept().of_robots.get(robot)?.clone();
        let mut read = ReadDescription {
            remarks: own.refused.into_values().collect(),
            ..ReadDescription::default()
        };
        if let Some(urdf) = &own.urdf {
            let taken = read.take_urdf(urdf);
            read.note(DescriptionTopic::RobotDescription, taken);
        }
        for payload in &own.transforms {
            let taken = read.take_transforms(payload);
            read.note(DescriptionTopic::TfStatic, taken);
        }
        Some(read)
    }
}

/// Returns the payload of an arrived message. `all` are the bytes of all descriptions.
fn accepted<B: FnOnce() -> Vec<u8>>(
    own: &Payloads,
    all: usize,
    room: usize,
    arrived: ArrivedDescription<B>,
) -> Result<Payload, String> {
    let (topic, length) = (arrived.topic, arrived.length);
    let of_topic = |reason: String| format!("{}: {reason}", topic.name());
    let encoding = arrived.encoding.map_err(of_topic)?;
    let limit = topic.bytes_max();
    if length > limit {
        let reason = format!("got {length} bytes, expected {limit} at most");
        return Err(of_topic(reason));
    }
    if all - own.replaced(topic) + length > room {
        let reason = format!(
            "got {length} bytes beside the descriptions of other robots, expected {room} of all \
             at most"
        );
        return Err(of_topic(reason));
    }
    let bytes = (arrived.payload)();
    Ok(Payload { encoding, bytes })
}

impl ReadDescription {
    fn take_urdf(&mut self, payload: &Payload) -> Result<(), String> {
        let said = |refused: DecodeError| refused.to_string();
        let message = StringMessage::decode(payload.encoding, &payload.bytes).map_err(said)?;
        let taken = self.description.set_urdf(&message.data);
        taken.map_err(|refused| refused.to_string())
    }

    fn take_transforms(&mut self, payload: &Payload) -> Result<(), String> {
        let said = |refused: DecodeError| refused.to_string();
        let message = TfMessage::decode(payload.encoding, &payload.bytes).map_err(said)?;
        for transform in message.transforms.into_iter().map(static_transform) {
            let added = self.description.add_transform(transform);
            added.map_err(|refused| refused.to_string())?;
        }
        Ok(())
    }

    fn note(&mut self, topic: DescriptionTopic, taken: Result<(), String>) {
        let name = topic.name();
        let (list, text) = match taken {
            Ok(()) => (&mut self.origins, name.to_owned()),
            Err(refused) if refused.starts_with(name) => (&mut self.remarks, refused),
            Err(refused) => (&mut self.remarks, format!("{name}: {refused}")),
        };
        if !list.contains(&text) {
            list.push(text);
        }
    }
}

/// Converts a transform.
pub fn static_transform(of: TransformStamped) -> StaticTransform {
    let (place, turn) = (of.transform.translation, of.transform.rotation);
    StaticTransform {
        parent: of.header.frame_id,
        child: of.child_frame_id,
        translation_m: [place.x, place.y, place.z],
        rotation: [turn.x, turn.y, turn.z, turn.w],
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const TUGGER: &str = include_str!("../../../proto/description/tests/urdf/tugger.urdf");
    const ROOM: usize = 3 << 20;

    fn robot() -> RobotId {
        RobotId::parse("tugger_01").unwrap()
    }

    fn keep(of: &Descriptions, robot: &RobotId, topic: DescriptionTopic, bytes: Vec<u8>) {
        let arrived = ArrivedDescription {
            topic,
            encoding: Ok(Encoding::Cdr),
            length: bytes.len(),
            payload: || bytes,
        };
        of.keep(robot, ROOM, arrived);
    }

    fn urdf(data: &str) -> Vec<u8> {
        let data = data.to_owned();
        StringMessage { data }.to_cdr()
    }

    #[test]
    fn the_latest_payloads_are_kept_and_read() {
        let descriptions = Descriptions::default();
        assert!(descriptions.read(&robot()).is_none());
        let keep = |topic, bytes| keep(&descriptions, &robot(), topic, bytes);
        keep(DescriptionTopic::RobotDescription, urdf("no URDF"));
        keep(DescriptionTopic::RobotDescription, urdf(TUGGER));
        let mut mounted = TransformStamped::default();
        for number in 0..TF_STATIC_MESSAGES_MAX + 3 {
            mounted.header.frame_id = "base_link".to_owned();
            mounted.child_frame_id = format!("laser_{number}");
            let transforms = vec![mounted.clone()];
            let message = TfMessage { transforms }.to_cdr();
            keep(DescriptionTopic::TfStatic, message.clone());
            keep(DescriptionTopic::TfStatic, message);
        }
        let read = descriptions.read(&robot()).unwrap();
        assert_eq!(read.origins, ["robot_description", "tf_static"]);
        assert_eq!(read.remarks, Vec::<String>::new());
        let mount = |frame| read.description.propose(Some(frame)).lidar;
        assert!(mount("laser_18").is_ok() && mount("laser_3").is_ok());
        assert!(mount("laser_2").is_err());
        assert!((read.description.propose(None).wheelbase_m.unwrap().value - 1.2).abs() < 1e-9);
    }

    #[test]
    fn what_cannot_be_read_is_named() {
        let bomb = "<!DOCTYPE a [<!ENTITY b \"bbbb\">]><robot name=\"&b;\"/>";
        let unreadable = [0, 1, 0, 0, 3, 0, 0, 0, 0xc3, 0x28, 0];
        for (payload, wanted) in [
            (urdf("wheelbase: 1.2"), "robot_description: got no XML"),
            (urdf(bomb), "robot_description: got no XML"),
            (unreadable.to_vec(), "robot_description: "),
            (Vec::new(), "robot_description: "),
        ] {
            let descriptions = Descriptions::default();
            keep(
                &descriptions,
                &robot(),
                DescriptionTopic::RobotDescription,
                payload,
            );
            let read = descriptions.read(&robot()).unwrap();
            assert_eq!(read.remarks.len(), 1);
            assert!(read.remarks[0].starts_with(wanted), "{:?}", read.remarks);
            assert!(read.description.is_empty() && read.origins.is_empty());
        }
    }

    #[test]
    fn what_is_too_large_or_finds_no_room_is_refused_and_leaves_the_rest() {
        let descriptions = Descriptions::default();
        let topic = DescriptionTopic::RobotDescription;
        keep(&descriptions, &robot(), topic, urdf(TUGGER));
        keep(&descriptions, &robot(), topic, vec![0; 10_000_000]);
        let read = descriptions.read(&robot()).unwrap();
        assert!(read.description.has_urdf());
        let wanted = "robot_description: got 10000000 bytes, expected 1048576 at most";
        assert_eq!(read.remarks, [wanted]);

        let other = |number| RobotId::parse(&format!("other_{number}")).unwrap();
        for number in 0..3 {
            let large = vec![0; ROBOT_DESCRIPTION_BYTES_MAX];
            keep(&descriptions, &other(number), topic, large);
        }
        let remark = |robot: &RobotId| descriptions.read(robot).unwrap().remarks.remove(0);
        assert!(remark(&other(2)).contains("beside the descriptions of other robots"));
        // A description takes the place of its robot's former one, and of one that is dropped.
        keep(&descriptions, &robot(), topic, urdf(TUGGER));
        assert!(descriptions.read(&robot()).unwrap().remarks.is_empty());
        descriptions.forget(&other(0));
        let large = vec![1; ROBOT_DESCRIPTION_BYTES_MAX];
        keep(&descriptions, &other(2), topic, large);
        assert!(!remark(&other(2)).contains("beside"));
        assert!(descriptions.read(&other(0)).is_none());
    }
}
