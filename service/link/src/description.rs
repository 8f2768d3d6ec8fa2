//! Intake of the descriptions that robots publish of themselves. Every instance of a cluster receives
//! those of all robots: they are rare, and each instance answers for them.

use fleetcal_fleet::{ArrivedDescription, DescriptionTopic, FleetHandle};
use fleetcal_proto::RobotId;
use fleetcal_proto::encoding::Encoding;
use fleetcal_proto::key::{Key, Keys, StreamKind};
use zenoh::pubsub::Subscriber;
use zenoh::sample::{Locality, Sample, SampleKind};
use zenoh::{Result, Session};

/// Subscribes to the descriptions on our own keys.
pub async fn subscribe(
    session: &Session,
    keys: &Keys,
    fleet: &FleetHandle,
) -> Result<[Subscriber<()>; 2]> {
    let of = async |kind: StreamKind, topic: DescriptionTopic| {
        let (keys, fleet) = (keys.clone(), fleet.clone());
        session
            .declare_subscriber(keys.stream_of_all(kind))
            .allowed_origin(Locality::Remote)
            .callback(move |sample| {
                if let Ok(Key::Stream { robot, .. }) = keys.parse(sample.key_expr().as_str()) {
                    take(&fleet, &robot, topic, &sample);
                }
            })
            .await
    };
    Ok([
        of(
            StreamKind::RobotDescription,
            DescriptionTopic::RobotDescription,
        )
        .await?,
        of(StreamKind::TfStatic, DescriptionTopic::TfStatic).await?,
    ])
}

/// Passes a message to the fleet. It runs on Zenoh's receiving threads and never blocks.
pub fn take(fleet: &FleetHandle, robot: &RobotId, topic: DescriptionTopic, sample: &Sample) {
    if sample.kind() != SampleKind::Put {
        return;
    }
    let payload = sample.payload();
    let encoding = Encoding::parse(&sample.encoding().to_string());
    let arrived = ArrivedDescription {
        topic,
        encoding: encoding.map_err(|refused| refused.to_string()),
        length: payload.len(),
        payload: || payload.to_bytes().into_owned(),
    };
    fleet.take_description(robot, arrived);
}
