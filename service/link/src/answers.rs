//! Answers of robots.

use fleetcal_domain::limits;
use fleetcal_operations::lifecycle::Lifecycle;
use fleetcal_proto::RobotId;
use fleetcal_proto::calibration::Applied;
use fleetcal_proto::key::{Key, Keys};
use zenoh::pubsub::Subscriber;
use zenoh::sample::{Locality, Sample, SampleKind};
use zenoh::{Result, Session};

use crate::gate::Gate;

/// Subscribes to the robots' acknowledgements. The callback runs on Zenoh's receiving threads and
/// never blocks. Of several instances, the one that estimates the robot stores the acknowledgement;
/// robots repeat those that come while no instance does.
pub async fn hear(
    session: &Session,
    keys: &Keys,
    answers: String,
    lifecycle: Lifecycle,
    gate: Gate,
) -> Result<Subscriber<()>> {
    let own_keys = keys.clone();
    session
        .declare_subscriber(answers)
        .allowed_origin(Locality::Remote)
        .callback(move |sample| {
            if let Ok(Key::Stream { robot, .. }) = own_keys.parse(sample.key_expr().as_str())
                && gate.has(&robot)
            {
                take_answer(&lifecycle, &robot, &sample);
            }
        })
        .await
}

fn take_answer(lifecycle: &Lifecycle, robot: &RobotId, sample: &Sample) {
    let payload = sample.payload();
    if sample.kind() != SampleKind::Put || payload.len() > limits::ANSWER_BYTES_MAX {
        let bytes = payload.len();
        lifecycle.refuse_answer(
            robot,
            &format!("no message of an accepted size: {bytes} bytes"),
        );
        return;
    }
    match serde_json::from_slice::<Applied>(&payload.to_bytes()) {
        Ok(applied) => lifecycle.take_answer(robot, applied),
        Err(error) => lifecycle.refuse_answer(robot, &error.to_string()),
    }
}
