//! Long random histories of one robot: the records agree whatever happens, in any order.

use fleetcal_model::{DeploymentId, Generation, ProposalId, RobotTime, Version, WallTime};
use fleetcal_proto::RobotId;
use fleetcal_proto::calibration::{Applied, AppliedStatus, CalibrationValues};
use fleetcal_proto::signing::{SigningKey, TrustedKeys};
use proptest::collection::vec;
use proptest::option;
use proptest::prelude::*;

use super::model::Model;
use crate::access::{Actor, Authentication, Role};
use crate::approval::{
    Command, DeploymentState, Drawing, Evidence, Origin, Policy, Present, ProposalState, Refused,
    Standing, Tolerance, Verification, step,
};

/// Wall time at which the histories begin.
const BEGIN_NS: i64 = 1_763_700_000_000_000_000;

/// Attempt of a person, the robot or the service; numbers are relative to the present records.
#[derive(Debug, Clone)]
enum Attempt {
    /// Change of the drawing, by a person or in the configuration file; or its removal.
    Draw(Option<CalibrationValues>, bool),
    Propose(Origin, CalibrationValues),
    Approve {
        right: bool,
    },
    Reject {
        right: bool,
        reason: &'static str,
    },
    Withdraw {
        right: bool,
    },
    Expire,
    Supersede,
    Refresh(CalibrationValues),
    Offer(u64),
    Offered(u64),
    Answer(AppliedStatus, u64, bool, Option<CalibrationValues>),
    Confirmed(u64),
    Judge {
        right: bool,
        within: bool,
    },
    GiveUp {
        right: bool,
    },
    Void {
        right: bool,
    },
    RollBack {
        right: bool,
        reason: &'static str,
    },
    Maintain {
        hours: Option<i64>,
        reason: &'static str,
    },
}

fn values() -> impl Strategy<Value = CalibrationValues> {
    let steering = prop_oneof![8 => -0.2..0.2, 1 => Just(f64::NAN), 1 => Just(1.0)];
    let scale = option::of(prop_oneof![9 => 0.9..1.1, 1 => Just(0.0)]);
    (steering, -2.0..2.0, -0.5..0.5, -3.1..3.1, scale).prop_map(|(steering, x, y, yaw, scale)| {
        CalibrationValues {
            steering_offset_rad: steering,
            lidar_x_m: x,
            lidar_y_m: y,
            lidar_yaw_rad: yaw,
            speed_scale: scale,
            ..CalibrationValues::default()
        }
    })
}

/// Values that a robot may report, which JSON limits to finite numbers.
fn reported() -> impl Strategy<Value = CalibrationValues> {
    values().prop_map(|values| CalibrationValues {
        steering_offset_rad: values.steering_offset_rad.min(1.0),
        ..values
    })
}

fn right() -> impl Strategy<Value = bool> {
    prop::bool::weighted(0.9)
}

fn reason() -> impl Strategy<Value = &'static str> {
    prop_oneof![9 => Just("it weaves"), 1 => Just("  ")]
}

/// Distance below the highest generation; -1 would be one that was never assigned.
fn back() -> impl Strategy<Value = u64> {
    prop_oneof![12 => Just(1_u64), 3 => Just(2_u64), 2 => 0_u64..6]
}

fn attempt() -> impl Strategy<Value = Attempt> {
    let origin = prop_oneof![3 => Just(Origin::Estimator), 2 => Just(Origin::Person)];
    let status = prop_oneof![
        6 => Just(AppliedStatus::Applied),
        1 => Just(AppliedStatus::Refused),
        1 => Just(AppliedStatus::Failed),
        2 => Just(AppliedStatus::Reverted),
    ];
    let answer = (status, back(), right(), option::weighted(0.2, reported()));
    prop_oneof![
        3 => (option::weighted(0.8, reported()), any::<bool>())
            .prop_map(|(values, by_file)| Attempt::Draw(values, by_file)),
        4 => (origin, values()).prop_map(|(origin, values)| Attempt::Propose(origin, values)),
        6 => right().prop_map(|right| Attempt::Approve { right }),
        1 => (right(), reason()).prop_map(|(right, reason)| Attempt::Reject { right, reason }),
        1 => right().prop_map(|right| Attempt::Withdraw { right }),
        1 => Just(Attempt::Expire),
        1 => Just(Attempt::Supersede),
        2 => values().prop_map(Attempt::Refresh),
        5 => back().prop_map(Attempt::Offer),
        3 => back().prop_map(Attempt::Offered),
        8 => answer.prop_map(|(status, back, right, values)| {
            Attempt::Answer(status, back, right, values)
        }),
        5 => back().prop_map(Attempt::Confirmed),
        4 => (right(), any::<bool>())
            .prop_map(|(right, within)| Attempt::Judge { right, within }),
        1 => right().prop_map(|right| Attempt::GiveUp { right }),
        1 => right().prop_map(|right| Attempt::Void { right }),
        3 => (right(), reason()).prop_map(|(right, reason)| Attempt::RollBack { right, reason }),
        2 => (option::of(-1_i64..2_200), reason())
            .prop_map(|(hours, reason)| Attempt::Maintain { hours, reason }),
    ]
}

fn actor() -> impl Strategy<Value = Actor> {
    let person = |name: &str| Actor {
        name: name.to_owned(),
        authentication: Authentication::Session,
        role: Some(Role::Approver),
        request: None,
    };
    prop_oneof![
        3 => Just(person("ana")),
        3 => Just(person("bruno")),
        1 => Just(person("carla")),
        2 => Just(Actor::service()),
    ]
}

fn policy() -> impl Strategy<Value = Policy> {
    let two = prop_oneof![Just(0.001), Just(40.0)];
    (two, any::<bool>()).prop_map(|(degrees, roll_back)| Policy {
        two_approvers_beyond: Tolerance {
            steering_offset_deg: degrees,
            lidar_yaw_deg: 180.0,
            lidar_position_mm: 30_000.0,
        },
        roll_back,
        ..Policy::default()
    })
}

/// Command of an attempt on these records; `None` if it makes none.
#[expect(clippy::too_many_lines, reason = "one arm for each command")]
#[expect(clippy::needless_pass_by_value, reason = "an attempt is used up")]
fn command(attempt: Attempt, model: &Model, now: WallTime) -> Option<Command> {
    let open = model.ledger.open.as_ref();
    let live = model.ledger.live.as_ref();
    let proposal = open.map_or(1, |open| open.id.0);
    let version = |right: bool, found: Option<Version>| {
        let found = found.unwrap_or(Version(1));
        Some(if right { found } else { found.next() })
    };
    let of_open = |right| version(right, open.map(|open| open.version));
    let deployment = |right: bool| live.map_or(1, |live| live.id.0) + u64::from(!right);
    let last = model.ledger.shadow.generation_last;
    let below = |back: u64| Generation(last.next().0.saturating_sub(back));
    let words = || "as it was tried".to_owned();
    Some(match attempt {
        Attempt::Draw(..) => return None,
        Attempt::Propose(origin, values) => Command::Propose {
            origin,
            values,
            sigmas: CalibrationValues::default(),
            evidence: Evidence::default(),
            reason: None,
        },
        Attempt::Approve { right } => Command::Approve {
            proposal: ProposalId(proposal),
            version: of_open(right),
            sha256: open
                .map(|open| open.revision_sha256.clone())
                .unwrap_or_default(),
            reason: None,
        },
        Attempt::Reject { right, reason } => Command::Reject {
            proposal: ProposalId(proposal),
            version: of_open(right),
            reason: reason.to_owned(),
        },
        Attempt::Withdraw { right } => Command::Withdraw {
            proposal: ProposalId(proposal),
            version: of_open(right),
            reason: None,
        },
        Attempt::Expire => Command::Expire {
            proposal: ProposalId(proposal),
        },
        Attempt::Supersede => Command::Supersede {
            proposal: ProposalId(proposal),
            reason: words(),
        },
        Attempt::Refresh(values) => Command::Refresh {
            proposal: ProposalId(proposal),
            values,
            sigmas: CalibrationValues::default(),
            evidence: Evidence::default(),
            reason: words(),
        },
        Attempt::Offer(back) => Command::Offer {
            generation: below(back),
        },
        Attempt::Offered(back) => Command::Offered {
            generation: below(back),
        },
        Attempt::Answer(status, back, right, values) => {
            let generation = below(back);
            Command::Acknowledge(answer(model, status, generation, right, values, now))
        }
        Attempt::Confirmed(back) => Command::Confirmed {
            generation: below(back),
        },
        Attempt::Judge { right, within } => Command::Judge {
            deployment: DeploymentId(deployment(right)),
            verification: Verification {
                at_ns: now,
                distance_m: 80.0,
                residual: [0.0; 4],
                sigma: [0.0; 4],
                within,
                limits: None,
                evidence: None,
            },
        },
        Attempt::GiveUp { right } => Command::GiveUp {
            deployment: DeploymentId(deployment(right)),
            reason: words(),
        },
        Attempt::Void { right } => Command::Void {
            deployment: DeploymentId(deployment(right)),
            reason: words(),
        },
        Attempt::Maintain { hours, reason } => Command::Maintain {
            until_ns: hours.map(|hours| WallTime(now.0 + hours * 3_600_000_000_000)),
            reason: reason.to_owned(),
        },
        Attempt::RollBack { right, reason } => Command::RollBack {
            version: version(right, Some(model.ledger.shadow.version)),
            reason: reason.to_owned(),
        },
    })
}

fn answer(
    model: &Model,
    status: AppliedStatus,
    generation: Generation,
    right: bool,
    values: Option<CalibrationValues>,
    now: WallTime,
) -> Applied {
    let known = model.envelopes.get(&generation);
    let sha256 = known.map(|envelope| envelope.sha256.clone());
    Applied {
        generation,
        sha256: if right {
            sha256.unwrap_or_default()
        } else {
            "ab".repeat(32)
        },
        status,
        reason: None,
        applied_at_ns: RobotTime(now.0),
        values,
    }
}

fn checked(refused: &Refused, command: &Command, model: &Model) {
    if let (Refused::ProposalClosed { state }, Some(_)) = (refused, &model.ledger.open) {
        assert_eq!(*state, ProposalState::Expired, "{command:?}");
    }
    if let Refused::Deployment { state, event } = refused {
        let live = model.ledger.live.as_ref().map(|live| live.state);
        assert!(live.is_some(), "{command:?}");
        // What is in use is rolled back, and not voided.
        let is_void = matches!(command, Command::Void { .. });
        assert!(is_void || state.after(*event).is_err());
        assert!(live == Some(*state) || *state == DeploymentState::RollingBack);
    }
}

proptest! {
    #![proptest_config(ProptestConfig {
        cases: 10_000,
        failure_persistence: None,
        ..ProptestConfig::default()
    })]

    #[test]
    fn the_records_agree_whatever_happens(
        attempts in vec((attempt(), actor(), 0_i64..60, prop::bool::weighted(0.1)), 1..50),
        policy in policy(),
    ) {
        let key = SigningKey::from_bytes(&[7; 32]);
        let trusted = TrustedKeys::new(vec![key.public_key()]).unwrap();
        let mut model = Model::new(RobotId::parse("tugger_01").unwrap(), trusted, policy);
        let mut now = BEGIN_NS;
        for (attempt, actor, minutes, frozen) in attempts {
            now += minutes * minutes * 60_000_000_000;
            if let Attempt::Draw(values, by_file) = &attempt {
                let by = (!by_file).then(|| actor.name.clone());
                model.drawing = values.map(|values| Drawing { values, by });
            }
            let Some(command) = command(attempt, &model, WallTime(now)) else {
                continue;
            };
            let standing = Standing {
                policy: &policy,
                key: &key,
                actor: &actor,
                now: WallTime(now),
                frozen,
                rear_axle_in_base_link: None,
                drawing: model.drawing.clone(),
                present: Present::Unknown,
                is_sending: false,
            };
            let ledger = model.read_for(&command);
            match step(&ledger, command.clone(), model.next_ids(), &standing) {
                Ok(outcome) => model.take(&command, &actor, &outcome, WallTime(now)),
                Err(refused) => checked(&refused, &command, &model),
            }
        }
    }
}
