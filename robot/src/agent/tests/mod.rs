//! The agent alone, then over a real router.

mod instances;
mod key_changes;
mod replays;
mod restarts;
mod sequences;
mod service;
mod transitions;
mod wire;

use std::time::Duration;

use fleetcal_model::{Generation, RevisionId, RobotTime, WallTime};
use fleetcal_proto::RobotId;
use fleetcal_proto::calibration::{
    Applied, CalibrationDocument, CalibrationFrame, CalibrationSchema, CalibrationValues,
    ConfirmationDocument, Confirmed, Envelope,
};
use fleetcal_proto::offer::{OfferDocument, OfferSchema, Offered, QUESTION_BYTES, Question};
use fleetcal_proto::signing::{SigningKey, seal, sign};

use super::{Event, Held, Identity, Limits, Memory};

/// Start of the tests' clocks, ns since 1970.
pub(super) const START_NS: i64 = 1_795_000_000_000_000_000;
/// One second, ns.
pub(super) const SECOND_NS: i64 = 1_000_000_000;

pub(super) fn robot() -> RobotId {
    RobotId::parse("tugger_01").unwrap()
}

/// Returns the service's key.
pub(super) fn key() -> SigningKey {
    SigningKey::from_bytes(&[3; 32])
}

/// Returns an untrusted key.
pub(super) fn strange_key() -> SigningKey {
    SigningKey::from_bytes(&[4; 32])
}

/// Makes the values of a generation, different for each.
pub(super) fn values(generation: u64) -> CalibrationValues {
    CalibrationValues {
        steering_offset_rad: 0.001 * generation as f64,
        lidar_x_m: 0.434,
        lidar_y_m: -0.016,
        lidar_yaw_rad: 0.0133,
        speed_scale: Some(1.002),
        ..CalibrationValues::default()
    }
}

/// Makes a document that a robot with the generation before it accepts.
pub(super) fn document(generation: u64) -> CalibrationDocument {
    CalibrationDocument {
        schema: CalibrationSchema::V1,
        robot: robot(),
        generation: Generation(generation),
        base_generation: generation.checked_sub(1).map(Generation),
        revision: RevisionId(10 + generation),
        approved_at: "2026-11-21T12:00:00Z".to_owned(),
        approved_by: "ana".to_owned(),
        values: values(generation),
        sigmas: CalibrationValues::default(),
        covariance: None,
        steering_table: None,
        frame: CalibrationFrame::RearAxle,
        confirm_within_s: 600,
        rear_axle_in_base_link: None,
        lidar_in_base_link: None,
    }
}

pub(super) fn sealed(document: &CalibrationDocument) -> Envelope {
    seal(document, &key()).unwrap()
}

/// Returns the question of these tests' agent.
pub(super) fn question() -> Question {
    Question::from_bytes([7; QUESTION_BYTES])
}

/// Validity of the service's offers.
pub(super) const WANTED_FOR: Duration = Duration::from_hours(1);

/// Makes the service's offer of a document, in answer to a question; documents that the service did
/// not sign get none.
pub(super) fn wanted(envelope: &Envelope, question: Option<Question>) -> Offered {
    let document = envelope.open(&key().public_key().into()).ok();
    let offer = document.map(|document| OfferDocument {
        schema: OfferSchema::V1,
        robot: document.robot,
        generation: document.generation,
        sha256: envelope.sha256.clone(),
        offered_at_ns: WallTime(5),
        valid_until_ns: WallTime(5).plus(WANTED_FOR),
        question,
    });
    Offered {
        envelope: envelope.clone(),
        offer: offer.map(|offer| sign(&offer, &key()).unwrap()),
    }
}

/// Makes the answer to the agent's own question.
pub(super) fn answered(envelope: &Envelope) -> Event {
    Event::Offered {
        offered: wanted(envelope, Some(question())),
        answers: Some(question()),
    }
}

/// Makes the service's confirmation of an acknowledgement.
pub(super) fn confirmation_of(applied: &Applied) -> Confirmed {
    let document = ConfirmationDocument::of(robot(), applied);
    Confirmed {
        generation: applied.generation,
        sha256: applied.sha256.clone(),
        signed: Some(sign(&document, &key()).unwrap()),
    }
}

pub(super) fn identity() -> Identity {
    Identity {
        robot: robot(),
        trusted: key().public_key().into(),
        limits: Limits::default(),
    }
}

/// Makes the memory of an agent's first start.
pub(super) fn first_memory() -> Memory {
    Memory::new(robot(), Held::factory(None, RobotTime(START_NS)))
}
