//! Checks of a document before it is applied.

use std::f64::consts::TAU;
use std::time::Duration;

use fleetcal_model::{Generation, Pose2, RobotTime, SteeringTable};
use fleetcal_proto::RobotId;
use fleetcal_proto::calibration::CalibrationDocument;
use fleetcal_proto::offer::{Offered, Question};
use fleetcal_proto::signing::{EnvelopeRefused, TrustedKeys};

use super::keys::with_remedy;
use super::limits::Limits;
use super::state::{Memory, Offer, Phase, Rest};

/// Longest time that a document may leave a robot without confirmation, s.
pub const CONFIRM_WITHIN_MAX_S: u32 = 86_400;

/// Largest distance between a vehicle's frames along an axis, m.
const VEHICLE_MAX_M: f64 = 30.0;

/// Identity of an agent, with its keys and limits.
#[derive(Debug, Clone)]
pub struct Identity {
    /// Id of the robot.
    pub robot: RobotId,
    /// Keys whose signatures are trusted.
    pub trusted: TrustedKeys,
    /// Limits of the robot.
    pub limits: Limits,
}

/// Verdict on an envelope.
#[derive(Debug, Clone, PartialEq)]
pub(super) enum Verdict {
    /// Every check passed.
    Fit(Offer),
    /// Decided before, or in use.
    Known,
    /// Unsolicited: it may have been recorded long ago, or be signed with a new key.
    Unasked,
    /// Signed, but not for now: it is acknowledged and leaves no trace.
    Stale(Refusal),
    /// Signed and new, but never to be applied.
    Unfit(Refusal),
    /// Altered or signed by an untrusted key.
    Forged(Refusal),
    /// Altered, under the name of a decided document, which an acknowledgement would then name.
    Mistaken(String),
}

/// A refusal with its subject.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Refusal {
    pub generation: Generation,
    pub sha256: String,
    pub reason: String,
}

/// Judges a received document: signature first, then robot, generation, offer, base generation,
/// values. `answers` is the question that it answers.
pub(super) fn judge(
    identity: &Identity,
    memory: &Memory,
    offered: &Offered,
    answers: Option<&Question>,
    now: RobotTime,
) -> Verdict {
    let envelope = &offered.envelope;
    let sha256 = envelope.sha256.clone();
    let document = match envelope.open(&identity.trusted) {
        Ok(document) => document,
        Err(error) if is_known(memory, None, &sha256) => {
            return Verdict::Mistaken(with_remedy(&error));
        }
        // It may be of a new key, which is announced with the answer to a query.
        Err(EnvelopeRefused::KeyUnknown { .. }) if answers.is_none() => {
            return Verdict::Unasked;
        }
        Err(error) => {
            return Verdict::Forged(Refusal {
                generation: claimed_generation(&envelope.document),
                sha256,
                reason: with_remedy(&error),
            });
        }
    };
    let generation = document.generation;
    if is_known(memory, Some(generation), &sha256) {
        return Verdict::Known;
    }
    let refusal = |reason| Refusal {
        generation,
        sha256: sha256.clone(),
        reason,
    };
    if document.robot != identity.robot {
        // Its generation counts for another robot.
        return Verdict::Stale(refusal(format!(
            "robot is {}, this one is {}",
            document.robot, identity.robot
        )));
    }
    if generation <= memory.highest {
        return Verdict::Stale(refusal(format!(
            "generation: got {generation}, expected higher ones than {}",
            memory.highest
        )));
    }
    let Some(question) = answers else {
        return Verdict::Unasked;
    };
    let lasts = match wanted_for(identity, offered, &document, question) {
        Ok(lasts) => lasts,
        Err(reason) => return Verdict::Stale(refusal(reason)),
    };
    match objection(identity, memory, &document) {
        Some(reason) => Verdict::Unfit(refusal(reason)),
        None => Verdict::Fit(Offer {
            generation,
            sha256,
            ends_ns: now.plus(lasts),
            confirm_within_s: document.confirm_within_s,
            values: document.values,
            rear_axle_in_base_link: document.rear_axle_in_base_link,
            steering_table: document.steering_table,
            document: envelope.document.clone(),
        }),
    }
}

/// Returns the time for which the service offers this document, by its signed offer in answer to
/// `question`; or the reason for rejecting the offer.
///
/// The question makes the robot's clock irrelevant: the offer was made after the robot's query. So
/// its end counts from now, on a clock that may be wrong by any time and only has to advance.
fn wanted_for(
    identity: &Identity,
    offered: &Offered,
    document: &CalibrationDocument,
    question: &Question,
) -> Result<Duration, String> {
    let offer = offered
        .open_offer(&identity.trusted)
        .map_err(|error| format!("offer: {}", with_remedy(&error)))?;
    let is_of_it = (&offer.robot, offer.generation) == (&document.robot, document.generation)
        && offer.sha256 == offered.envelope.sha256;
    if !is_of_it {
        return Err(format!(
            "offer: got that of generation {} of {}, expected that of this document",
            offer.generation, offer.robot
        ));
    }
    if offer.question.as_ref() != Some(question) {
        return Err(
            "offer.question: got another one, expected the one that was asked: it may be a \
             recording of a document that was taken back since"
                .to_owned(),
        );
    }
    let lasts_ns = offer.valid_until_ns.ns_since(offer.offered_at_ns);
    match u64::try_from(lasts_ns) {
        Ok(lasts_ns) if lasts_ns > 0 => Ok(Duration::from_nanos(lasts_ns)),
        _ => Err(format!(
            "offer.valid_until_ns: got {}, expected a time after {}, when it was made",
            offer.valid_until_ns.0, offer.offered_at_ns.0
        )),
    }
}

fn objection(
    identity: &Identity,
    memory: &Memory,
    document: &CalibrationDocument,
) -> Option<String> {
    let confirmed = confirmed_generation(memory);
    let base = document.base_generation;
    if base.unwrap_or_default() < confirmed {
        let base = base.map_or_else(|| "none".to_owned(), |base| base.to_string());
        return Some(format!(
            "base_generation: got {base}, expected {confirmed} and higher ones: it was compared \
             with something older than what the robot holds"
        ));
    }
    let confirm_within_s = document.confirm_within_s;
    if !(1..=CONFIRM_WITHIN_MAX_S).contains(&confirm_within_s) {
        return Some(format!(
            "confirm_within_s: got {confirm_within_s}, expected 1 to {CONFIRM_WITHIN_MAX_S}"
        ));
    }
    if let Some(pose) = document.rear_axle_in_base_link
        && !is_on_a_vehicle(&pose)
    {
        let Pose2 { x_m, y_m, yaw_rad } = pose;
        return Some(format!(
            "rear_axle_in_base_link: got {x_m}, {y_m}, {yaw_rad}, expected -30 to 30 m and \
             radians within one turn"
        ));
    }
    if !document
        .steering_table
        .as_ref()
        .is_none_or(SteeringTable::is_sound)
    {
        return Some(
            "steering_table: expected radians within one turn, by growing measured_rad".to_owned(),
        );
    }
    let outside = identity.limits.check(&document.values).err()?;
    Some(outside.to_string())
}

fn is_on_a_vehicle(pose: &Pose2) -> bool {
    let metres = -VEHICLE_MAX_M..=VEHICLE_MAX_M;
    metres.contains(&pose.x_m) && metres.contains(&pose.y_m) && (-TAU..=TAU).contains(&pose.yaw_rad)
}

/// Returns the generation that both sides know to be in use: the service may not know of an
/// unconfirmed one.
fn confirmed_generation(memory: &Memory) -> Generation {
    match &memory.phase {
        Phase::Resting(Rest::Unconfirmed(trial)) => trial.fallback.held.generation,
        _ => memory.held.generation,
    }
}

fn is_known(memory: &Memory, generation: Option<Generation>, sha256: &str) -> bool {
    let same = |its_generation, its_sha256: &str| {
        generation.is_none_or(|generation| generation == its_generation) && its_sha256 == sha256
    };
    let held = &memory.held;
    (!held.generation.is_factory() && same(held.generation, &held.sha256))
        || memory
            .latest
            .as_ref()
            .is_some_and(|latest| same(latest.generation, &latest.sha256))
}

/// Returns the generation in an unopened document, to name it in the refusal; 0 without one.
fn claimed_generation(document: &str) -> Generation {
    Generation(
        serde_json::from_str::<serde_json::Value>(document)
            .ok()
            .and_then(|document| document.get("generation")?.as_u64())
            .unwrap_or(0),
    )
}
