//! Intake of robots' streams and of their liveliness tokens.

use std::hash::{DefaultHasher, Hash, Hasher};

use fleetcal_domain::limits;
use fleetcal_fleet::{Arrived, FleetHandle, Origin};
use fleetcal_model::Stream;
use fleetcal_proto::RobotId;
use fleetcal_proto::encoding::Encoding;
use fleetcal_proto::key::{Key, Keys, StreamKind};
use fleetcal_proto::message_type::{Form, MessageType};
use fleetcal_proto::ros2_key::Attachment;
use zenoh::pubsub::Subscriber;
use zenoh::sample::{Locality, Sample, SampleKind};
use zenoh::{Result, Session};

/// Subscribes to robots' streams, of every kind, with one callback: a queue for each stream would
/// lose the robot's order of sending. The callback runs on Zenoh's receiving threads and never
/// blocks.
pub async fn subscribe(
    session: &Session,
    keys: &Keys,
    streams: String,
    fleet: FleetHandle,
) -> Result<Subscriber<()>> {
    let own_keys = keys.clone();
    session
        .declare_subscriber(streams)
        .allowed_origin(Locality::Remote)
        .callback(move |sample| take(&fleet, &own_keys, &sample))
        .await
}

/// Subscribes to streams, from which only the messages of unregistered robots are accepted: the
/// others have subscribers of their own.
pub async fn subscribe_strangers(
    session: &Session,
    keys: &Keys,
    streams: String,
    fleet: FleetHandle,
) -> Result<Subscriber<()>> {
    let own_keys = keys.clone();
    session
        .declare_subscriber(streams)
        .allowed_origin(Locality::Remote)
        .callback(move |sample| {
            let key = own_keys.parse(sample.key_expr().as_str());
            if let Ok(Key::Stream { robot, .. }) = key
                && !fleet.is_registered(&robot)
            {
                take(&fleet, &own_keys, &sample);
            }
        })
        .await
}

fn take(fleet: &FleetHandle, keys: &Keys, sample: &Sample) {
    let (robot, kind) = match keys.parse(sample.key_expr().as_str()) {
        Ok(Key::Stream { robot, kind }) => (robot, kind),
        Ok(Key::FormerWheelOdometry(robot)) => {
            let key = keys.stream(&robot, StreamKind::WheelOdometry);
            fleet.refuse_former_key(&robot, Stream::WheelOdometry, &key);
            return;
        }
        _ => {
            fleet.count_foreign_key();
            return;
        }
    };
    let stream = match kind {
        StreamKind::WheelOdometry => Stream::WheelOdometry,
        StreamKind::Scan => Stream::Scan,
        StreamKind::LidarOdometry => Stream::LidarOdometry,
        StreamKind::Event => Stream::Event,
        StreamKind::CrossTrackError => {
            take_cross_track_error(fleet, &robot, sample);
            return;
        }
        // Every instance has a subscriber of its own for them.
        StreamKind::RobotDescription | StreamKind::TfStatic => return,
        _ => {
            fleet.count_foreign_key();
            return;
        }
    };
    offer(fleet, &robot, stream, None, sample);
}

/// Offers a message to its robot's mailbox; `message_type` is the type in its key.
pub fn offer(
    fleet: &FleetHandle,
    robot: &RobotId,
    stream: Stream,
    message_type: Option<MessageType>,
    sample: &Sample,
) {
    if sample.kind() != SampleKind::Put {
        fleet.refuse(robot, stream, "the message is a deletion, expected a put");
        return;
    }
    let payload = sample.payload();
    match Form::parse(&sample.encoding().to_string()) {
        Ok(form) => {
            let form = Form {
                message_type: message_type.or(form.message_type),
                ..form
            };
            let origin = origin(sample);
            let arrived = Arrived { form, origin };
            let bytes = || payload.to_bytes().into_owned();
            fleet.receive(robot, stream, arrived, payload.len(), bytes);
        }
        Err(refused) => fleet.refuse(robot, stream, &format!("{}: {refused}", stream.name())),
    }
}

/// Identifies the origin of a message within its callback: the connection, which Zenoh does not
/// name, but receives in a task of its own that calls the callback; and the publisher, where
/// `rmw_zenoh` attaches it, since one router may bring the messages of several.
fn origin(sample: &Sample) -> Option<Origin> {
    let task = tokio::task::try_id();
    let attached = sample.attachment().map(|bytes| bytes.to_bytes());
    let attachment = attached.and_then(|bytes| Attachment::from_bytes(&bytes));
    let gid = attachment.map(|attachment| attachment.gid);
    if task.is_none() && gid.is_none() {
        return None;
    }
    let mut hasher = DefaultHasher::new();
    (task, gid).hash(&mut hasher);
    Some(Origin(hasher.finish()))
}

fn take_cross_track_error(fleet: &FleetHandle, robot: &RobotId, sample: &Sample) {
    let payload = sample.payload();
    let fits = payload.len() <= limits::CROSS_TRACK_BYTES_MAX;
    if sample.kind() != SampleKind::Put || !fits {
        return;
    }
    if let Ok(encoding) = Encoding::parse(&sample.encoding().to_string()) {
        fleet.take_cross_track_error(robot, encoding, &payload.to_bytes());
    }
}

/// Follows the presence of robots, including those that were there before.
pub async fn watch_presence(
    session: &Session,
    keys: &Keys,
    fleet: FleetHandle,
) -> Result<Subscriber<()>> {
    let own_keys = keys.clone();
    let take = move |sample: Sample| {
        if let Ok(Key::Alive(robot)) = own_keys.parse(sample.key_expr().as_str()) {
            fleet.set_alive(&robot, sample.kind() == SampleKind::Put);
        } else {
            fleet.count_foreign_key();
        }
    };
    session
        .liveliness()
        .declare_subscriber(keys.alive_of_all())
        .history(true)
        .callback(take)
        .await
}
