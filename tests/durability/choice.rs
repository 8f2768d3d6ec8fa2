//! Choices of the deciding process.

use fleetcal_domain::approval::{
    Command, Deployment, DeploymentState, Evidence, Origin, Proposal, RobotLedger, Verification,
};
use fleetcal_model::{RobotTime, Version, WallTime};
use fleetcal_proto::calibration::{Applied, AppliedStatus, CalibrationValues};
use rand::Rng;
use rand::rngs::StdRng;

/// Chooses a command that mostly fits the records, so that every state is reached.
pub fn choose(random: &mut StdRng, ledger: &RobotLedger, now: WallTime) -> Command {
    if let Some(live) = &ledger.live {
        return for_deployment(random, live, now);
    }
    if let Some(open) = &ledger.open {
        return for_proposal(random, open);
    }
    match random.random_range(0..10) {
        0 | 1 => roll_back(ledger.shadow.version.0),
        2 => match &ledger.shadow.desired {
            Some(desired) => Command::Acknowledge(Applied {
                generation: desired.generation,
                sha256: desired.sha256.clone(),
                status: AppliedStatus::Applied,
                reason: None,
                applied_at_ns: RobotTime(now.0),
                values: None,
            }),
            None => propose(random),
        },
        _ => propose(random),
    }
}

fn propose(random: &mut StdRng) -> Command {
    let values = CalibrationValues {
        steering_offset_rad: random.random_range(-0.05..0.05),
        lidar_x_m: random.random_range(0.40..0.45),
        lidar_y_m: random.random_range(-0.02..0.02),
        lidar_yaw_rad: random.random_range(-0.05..0.05),
        ..CalibrationValues::default()
    };
    Command::Propose {
        origin: Origin::Estimator,
        values,
        sigmas: CalibrationValues::default(),
        evidence: Evidence::default(),
        reason: None,
    }
}

fn roll_back(version: u64) -> Command {
    Command::RollBack {
        version: Some(Version(version)),
        reason: "it weaves".to_owned(),
    }
}

fn for_proposal(random: &mut StdRng, open: &Proposal) -> Command {
    let (proposal, version) = (open.id, Some(open.version));
    let reason = "as it was tried".to_owned();
    match random.random_range(0..12) {
        0 => Command::Reject {
            proposal,
            version,
            reason,
        },
        1 => Command::Withdraw {
            proposal,
            version,
            reason: None,
        },
        2 => Command::Supersede { proposal, reason },
        3 => propose(random),
        _ => Command::Approve {
            proposal,
            version,
            sha256: open.revision_sha256.clone(),
            reason: None,
        },
    }
}

fn for_deployment(random: &mut StdRng, live: &Deployment, now: WallTime) -> Command {
    use DeploymentState as S;
    let generation = live.offer.generation;
    let deployment = live.id;
    let reason = "as it was tried".to_owned();
    let answer = |status| {
        Command::Acknowledge(Applied {
            generation,
            sha256: live.offer.sha256.clone(),
            status,
            reason: None,
            applied_at_ns: RobotTime(now.0),
            values: None,
        })
    };
    let judge = |within| Command::Judge {
        deployment,
        verification: Verification {
            at_ns: now,
            distance_m: 80.0,
            residual: [0.0; 4],
            sigma: [0.0; 4],
            within,
            limits: None,
            evidence: None,
        },
    };
    let roll = random.random_range(0..10);
    if roll == 0 {
        return Command::RollBack {
            version: None,
            reason: "it weaves".to_owned(),
        };
    }
    let give_up = Command::GiveUp { deployment, reason };
    match live.state {
        S::Queued => match roll {
            1..=7 => Command::Offer { generation },
            _ => give_up,
        },
        S::Offered => match roll {
            1..=4 => Command::Offered { generation },
            5..=7 => answer(AppliedStatus::Applied),
            8 => answer(AppliedStatus::Refused),
            _ => Command::Void {
                deployment,
                reason: "a newer estimate disagrees".to_owned(),
            },
        },
        S::RollingBack => match roll {
            1..=4 => Command::Offered { generation },
            5..=7 => answer(AppliedStatus::Applied),
            8 => answer(AppliedStatus::Failed),
            _ => give_up,
        },
        S::Applied => match roll {
            1 | 2 => answer(AppliedStatus::Applied),
            _ => Command::Confirmed { generation },
        },
        _ => match roll {
            1..=4 => judge(true),
            5 | 6 => judge(false),
            7 => answer(AppliedStatus::Reverted),
            8 => answer(AppliedStatus::Applied),
            _ => give_up,
        },
    }
}
