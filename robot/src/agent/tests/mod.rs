//! The agent alone, then over a real router.

mod instances;
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

/// When the tests' clocks begin, ns since 1970.
pub(super) const START_NS: i64 = 1_795_000_000_000_000_000;
/// One second, ns.
pub(super) const SECOND_NS: i64 = 1_000_000_000;

pub(super) fn robot() -> RobotId {
    RobotId::parse("tugger_01").unwrap()
}

/// The service's key.
pub(super) fn key() -> SigningKey {
    SigningKey::from_bytes(&[3; 32])
}

/// A key that nobody trusts.
pub(super) fn strange_key() -> SigningKey {
    SigningKey::from_bytes(&[4; 32])
}

/// The values of a generation: no two have the same.
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

/// A document that a robot which holds the generation before it takes.
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
        frame: CalibrationFrame::RearAxle,
        confirm_within_s: 600,
        rear_axle_in_base_link: None,
        lidar_in_base_link: None,
    }
}

pub(super) fn sealed(document: &CalibrationDocument) -> Envelope {
    seal(document, &key()).unwrap()
}

/// What the agent of these tests has asked with.
pub(super) fn question() -> Question {
    Question::from_bytes([7; QUESTION_BYTES])
}

/// How long the service's word lasts.
pub(super) const WANTED_FOR: Duration = Duration::from_hours(1);

/// The service's word that a document is wanted, in answer to a question. Of what the service did not
/// sign there is none.
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

/// The answer to the agent's own question.
pub(super) fn answered(envelope: &Envelope) -> Event {
    Event::Offered {
        offered: wanted(envelope, Some(question())),
        answers: Some(question()),
    }
}

/// The service's confirmation of an acknowledgement.
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

/// What an agent remembers that starts for the first time.
pub(super) fn first_memory() -> Memory {
    Memory::new(robot(), Held::factory(None, RobotTime(START_NS)))
}
