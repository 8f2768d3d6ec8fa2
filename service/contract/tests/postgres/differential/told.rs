//! Telemetry, drawn at random.

use std::sync::Arc;

use fleetcal_contract::{NOW_S, estimate};
use fleetcal_domain::access::SecretHash;
use fleetcal_domain::robot::{CrossTrack, HistoryEvent, Journal, ServiceEvent, ServiceEventKind};
use fleetcal_model::{Generation, NoteKind, RobotTime};
use fleetcal_proto::event::RobotEvent;
use fleetcal_store::{Credential, Store};
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;

use super::chance::{number, pick, real, robot, time, words};

/// Passes telemetry to a store without waiting.
pub fn tell(store: &Store, seed: u64) {
    let chance = &mut ChaCha8Rng::seed_from_u64(seed);
    let robot = robot(chance);
    match chance.random_range(0..6) {
        0 => {
            for _ in 0..chance.random_range(1..40) {
                let t_s = NOW_S + chance.random_range(0..7_200);
                let (offset_rad, yaw_rad) = (chance.random(), chance.random());
                let estimate = estimate(robot.as_str(), t_s, offset_rad, yaw_rad);
                store.record_history(&estimate, time(chance));
            }
        }
        1 => {
            let state = serde_json::json!({"state": [real(chance), words(chance)]});
            store.save_checkpoint(
                &robot,
                RobotTime(number(chance)),
                state.to_string().into_bytes(),
            );
        }
        2 => Journal::record_event(store, &robot, &Arc::new(event(chance))),
        3 => {
            let mut errors = CrossTrack::default();
            errors.add(chance.random());
            let generation = Generation(chance.random_range(0..12));
            store.save_cross_track(&robot, generation, &errors);
        }
        4 => store.note_use(Credential::Session(secret(chance))),
        _ => store.note_use(Credential::Token(secret(chance))),
    }
}

/// Draws one of few secrets, so that some match sessions and tokens.
pub fn secret(chance: &mut ChaCha8Rng) -> SecretHash {
    SecretHash::of(&chance.random_range(0..8).to_string())
}

/// Draws an event, often one that was recorded before.
fn event(chance: &mut ChaCha8Rng) -> HistoryEvent {
    let stamp_ns = RobotTime(chance.random_range(0..3));
    match chance.random_range(0..3) {
        0 => HistoryEvent::Service(ServiceEvent {
            kind: ServiceEventKind::Configured,
            stamp_ns,
            note: words(chance),
        }),
        1 => HistoryEvent::Note(RobotEvent {
            kind: pick(chance, &[NoteKind::Maintenance, NoteKind::PowerOn]),
            stamp_ns,
            note: pick(chance, &["", "new bracket", "it's \u{1f916}"]).to_owned(),
        }),
        _ => {
            let change = serde_json::json!({
                "kind": "calibration_changed", "cause": "steering", "time_s": 9.0, "onset_s": 8.0,
                "stamp_ns": stamp_ns, "change": {"steering_offset": chance.random::<f64>()},
            });
            HistoryEvent::Change(serde_json::from_value(change).unwrap())
        }
    }
}
