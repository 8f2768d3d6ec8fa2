//! Records of the life cycle after decisions drawn at random.

use fleetcal_domain::approval::{
    Deployment, DeploymentState, Evidence, GenerationRef, NextIds, Origin, OutboxEntry, Outcome,
    Proposal, ProposalState, Revision, RobotLedger,
};
use fleetcal_model::{Generation, Version, WallTime};
use fleetcal_proto::calibration::{CalibrationValues, Envelope};
use fleetcal_store::CertificateRecord;
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;

use super::chance::{number, pick, real, words};

/// Makes an outcome without changes.
fn unchanged(ledger: RobotLedger) -> Outcome {
    Outcome {
        ledger,
        revisions: Vec::new(),
        proposals: Vec::new(),
        deployments: Vec::new(),
        shadow_changed: false,
        envelopes: Vec::new(),
        outbox: Vec::new(),
        sent: None,
        transitions: Vec::new(),
    }
}

/// Proposes a new revision in place of the open one.
pub fn propose(ledger: RobotLedger, ids: NextIds, seed: u64) -> Outcome {
    let chance = &mut ChaCha8Rng::seed_from_u64(seed);
    let robot = ledger.shadow.robot.clone();
    let both = (values(chance), values(chance));
    let evidence = Evidence {
        distance_m: real(chance),
        ..Evidence::default()
    };
    let (origin, now) = (Origin::Estimator, WallTime(number(chance)));
    let revision = Revision::new(
        ids.revision,
        robot.clone(),
        origin,
        both,
        evidence,
        None,
        now,
    );
    let proposal = Proposal {
        id: ids.proposal,
        robot,
        version: Version(1),
        state: ProposalState::Proposed,
        revision: revision.id,
        revision_sha256: revision.sha256.clone(),
        proposed_by: words(chance),
        reason: Some(words(chance)),
        created_ns: now,
        expires_ns: WallTime(number(chance)),
        base: Some(values(chance)),
        base_generation: None,
        drawn_by: None,
        approvals_needed: 1,
        second_approver: None,
        approvals: Vec::new(),
        closing: None,
        refreshed: None,
    };
    let superseded = ledger.open.as_ref().map(|open| Proposal {
        state: ProposalState::Superseded,
        version: open.version.next(),
        ..open.clone()
    });
    let mut outcome = unchanged(ledger);
    outcome.revisions.push(revision);
    outcome.proposals.extend(superseded);
    outcome.proposals.push(proposal);
    outcome
}

/// Closes the open proposal: in one of the ways without approval, or with a deployment.
pub fn close(ledger: RobotLedger, ids: NextIds, seed: u64) -> Outcome {
    let chance = &mut ChaCha8Rng::seed_from_u64(seed);
    let mut outcome = unchanged(ledger);
    let Some(open) = outcome.ledger.open.clone() else {
        return outcome;
    };
    let approved = outcome.ledger.live.is_none() && chance.random_bool(0.7);
    let state = if approved {
        ProposalState::Approved
    } else {
        let others = ProposalState::ALL.iter().copied();
        let others = others
            .filter(|state| !matches!(state, ProposalState::Proposed | ProposalState::Approved));
        pick(chance, &others.collect::<Vec<_>>())
    };
    let version = open.version.next();
    if approved {
        deploy(&mut outcome, &open, ids, chance);
    }
    outcome.proposals.push(Proposal {
        state,
        version,
        ..open
    });
    outcome
}

fn deploy(outcome: &mut Outcome, open: &Proposal, ids: NextIds, chance: &mut ChaCha8Rng) {
    let shadow = &mut outcome.ledger.shadow;
    let generation = Generation(shadow.generation_last.0 + 1);
    let document = serde_json::json!({
        "generation": generation, "revision": open.revision, "note": words(chance),
    });
    let envelope = Envelope {
        document: document.to_string(),
        sha256: words(chance),
        key_id: "key".to_owned(),
        signature: words(chance),
    };
    let offer = GenerationRef {
        generation,
        sha256: envelope.sha256.clone(),
        revision: open.revision,
        chosen_by: None,
    };
    let now = WallTime(number(chance));
    outcome.deployments.push(Deployment {
        id: ids.deployment,
        robot: open.robot.clone(),
        version: Version(1),
        state: DeploymentState::Queued,
        proposal: Some(open.id),
        approved_by: words(chance),
        offer: offer.clone(),
        earlier: Vec::new(),
        base: None,
        desired_before: shadow.desired.replace(offer),
        created_ns: now,
        expires_ns: now,
        offered_ns: None,
        applied_ns: None,
        closed_ns: None,
        verification: None,
        reason: None,
        roll_back: None,
    });
    shadow.generation_last = generation;
    shadow.version = shadow.version.next();
    outcome.shadow_changed = true;
    outcome.envelopes.push((generation, envelope));
    outcome.outbox.push(OutboxEntry::Approved(generation));
}

/// Moves the deployment in progress to any other state, and sends or keeps a message.
pub fn advance(ledger: RobotLedger, seed: u64) -> Outcome {
    let chance = &mut ChaCha8Rng::seed_from_u64(seed);
    let mut outcome = unchanged(ledger);
    let Some(live) = outcome.ledger.live.clone() else {
        return outcome;
    };
    let generation = live.offer.generation;
    if chance.random_bool(0.5) {
        outcome.sent = Some(OutboxEntry::Approved(generation));
        outcome.outbox.push(OutboxEntry::Confirmed(generation));
    } else {
        outcome.sent = Some(OutboxEntry::Confirmed(generation));
    }
    outcome.deployments.push(Deployment {
        state: pick(chance, &DeploymentState::ALL),
        version: live.version.next(),
        reason: Some(words(chance)),
        ..live
    });
    outcome
}

/// Makes the certificate of a deployment that an outcome begins: the database asks for no verdict,
/// and few sequences reach one.
pub fn certificate(outcome: &Outcome, now: WallTime) -> Option<CertificateRecord> {
    let begun = outcome.deployments.last()?;
    (begun.version == Version(1)).then(|| CertificateRecord {
        number: begun.id,
        robot: begun.robot.clone(),
        verified_ns: now,
        approved_by: begun.approved_by.clone(),
        envelope: Envelope {
            document: format!("{{\"number\":{}}}", begun.id),
            sha256: begun.offer.sha256.clone(),
            key_id: "key".to_owned(),
            signature: begun.approved_by.clone(),
        },
    })
}

fn values(chance: &mut ChaCha8Rng) -> CalibrationValues {
    CalibrationValues {
        steering_offset_rad: real(chance),
        lidar_x_m: real(chance),
        lidar_y_m: real(chance),
        lidar_yaw_rad: real(chance),
        ..CalibrationValues::default()
    }
}
