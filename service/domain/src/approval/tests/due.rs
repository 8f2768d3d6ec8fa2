//! Commands that time or a new estimate makes due.

use fleetcal_model::{
    Generation, Pose2, RobotTime, SteeringPoint, SteeringTable, SteeringTableStatus, WallTime,
};
use fleetcal_proto::calibration::{Applied, AppliedStatus, CalibrationValues};

use super::bench::{Bench, NOW_NS, estimate, factory};
use crate::access::Actor;
use crate::approval::{
    Command, DeploymentState, Evidence, Objections, Origin, Outdated, Present, Refused, Situation,
    SyncState, Tolerance, automatic, due, values_and_sigmas,
};

#[test]
fn what_differs_from_what_is_used_is_proposed_once() {
    let mut bench = Bench::new();
    assert_eq!(
        bench.do_due(&estimate(0.002, 0), false),
        None,
        "0.11 degrees"
    );
    assert_eq!(bench.do_due(&estimate(0.05, 0), false), Some("propose"));
    assert_eq!(bench.do_due(&estimate(0.05, 1), false), None);
    bench.policy.propose = false;
    assert_eq!(Bench::new().due(None, false), None);
}

#[test]
fn an_estimate_three_sigma_from_a_proposal_refreshes_it_and_voids_its_approvals() {
    let mut bench = Bench::new();
    bench.policy.two_approvers_beyond.steering_offset_deg = 1.0;
    bench.do_due(&estimate(0.05, 0), false);
    bench.approve();
    let before = bench.ledger.open.clone().unwrap();
    assert_eq!((before.approvals.len(), before.approvals_needed), (1, 2));
    bench.wait();
    // The sigma of the proposal and of now is 0.0002 rad.
    assert_eq!(bench.do_due(&estimate(0.050_59, 1), false), None);
    let moved = estimate(0.050_61, 2);
    assert_eq!(bench.do_due(&moved, false), Some("refresh"));
    let open = bench.ledger.open.clone().unwrap();
    assert_eq!((open.id, open.version), (before.id, before.version.next()));
    assert_ne!(open.revision_sha256, before.revision_sha256);
    assert!(open.approvals.is_empty());
    let refreshed = open.refreshed.unwrap();
    assert_eq!(refreshed.voided, ["ana"]);
    let expected = "the present estimate differs from the proposal: steering offset by +0.03°, 3.0 \
                    sigma";
    assert_eq!(refreshed.reason, expected);
    let proposed = bench.ledger.revisions[&open.revision].values;
    assert!((proposed.steering_offset_rad - 0.050_61).abs() < 1e-12);

    // Not twice within a minute, however far it moves.
    assert_eq!(bench.do_due(&estimate(0.06, 3), false), None);
    bench.wait();
    assert_eq!(bench.do_due(&estimate(0.06, 3), false), Some("refresh"));
    let times = bench.ledger.open.as_ref().unwrap().refreshed.clone();
    assert_eq!(times.unwrap().times, 2);
    assert_eq!(bench.do_due(&estimate(0.06, 4), false), None, "once");
}

#[test]
fn a_proposal_that_brings_nothing_any_more_is_closed() {
    let mut bench = Bench::new();
    bench.do_due(&estimate(0.05, 0), false);
    bench.wait();
    assert_eq!(bench.do_due(&estimate(0.0, 1), false), Some("supersede"));
    assert!(bench.ledger.open.is_none());

    let mut bench = Bench::new();
    bench.do_due(&estimate(0.05, 0), false);
    let changed = Situation {
        now: bench.now,
        estimate: None,
        objections: Objections {
            vehicle_changed: true,
            ..Objections::default()
        },
        stable: false,
        verification: None,
        nominal: None,
    };
    let command = due(&bench.ledger, &changed, &bench.policy);
    assert!(
        matches!(&command, Some(Command::Supersede { reason, .. })
            if reason == "the vehicle is no longer the one that was calibrated"),
        "{command:?}"
    );
}

#[test]
fn nobody_approves_what_the_present_estimate_speaks_against() {
    let mut bench = Bench::new();
    bench.do_due(&estimate(0.05, 0), false);
    let present = |steering_offset_rad| {
        let (values, sigmas) = values_and_sigmas(&estimate(steering_offset_rad, 1)).unwrap();
        Present::Known { values, sigmas }
    };
    for outdated in [present(0.049_3), Present::VehicleChanged] {
        bench.present = outdated;
        let refused = bench.approve_as("ana");
        assert!(matches!(refused, Err(Refused::Outdated(_))), "{refused:?}");
    }
    bench.present = present(0.050_5);
    bench.approve_as("ana").unwrap();
    assert_eq!(bench.state(), Some(DeploymentState::Queued));
}

#[test]
fn nothing_estimated_holds_while_two_senders_use_the_id() {
    let mut bench = Bench::new();
    let found = estimate(0.05, 0);
    bench.do_due(&found, false);
    bench.present = Present::TwoSenders;
    let refused = bench.approve_as("ana");
    assert_eq!(refused, Err(Refused::Outdated(Outdated::TwoSenders)));
    assert_eq!(bench.do_due(&found, false), Some("supersede"));
    assert_eq!(bench.due(Some(&found), false), None);
    let (values, sigmas) = values_and_sigmas(&found).unwrap();
    let command = |origin| Command::Propose {
        origin,
        values,
        sigmas,
        evidence: Evidence::of(&found),
        reason: None,
    };
    let refused = bench.try_to(command(Origin::Estimator), &Actor::service());
    assert_eq!(refused, Err(Refused::TwoSenders));
    bench.take(command(Origin::Person), &Actor::service());
    bench.approve_as("ana").unwrap();

    // An approved calibration that is not applied yet is withdrawn.
    let mut bench = Bench::new();
    bench.do_due(&found, false);
    bench.approve();
    bench.present = Present::TwoSenders;
    assert_eq!(bench.do_due(&found, false), Some("void"));
}

#[test]
fn values_of_a_person_are_held_against_no_estimate() {
    let mut bench = Bench::new();
    let command = Command::Propose {
        origin: Origin::Person,
        values: CalibrationValues::default(),
        sigmas: CalibrationValues::default(),
        evidence: Evidence::default(),
        reason: None,
    };
    bench.take(command, &Actor::service());
    bench.present = Present::VehicleChanged;
    bench.wait();
    assert_eq!(bench.do_due(&estimate(0.06, 3), false), None);
    bench.approve_as("ana").unwrap();
}

#[test]
fn a_newer_estimate_that_disagrees_voids_what_no_robot_uses_yet() {
    let mut bench = Bench::new();
    bench.do_due(&estimate(0.05, 0), false);
    bench.approve();
    assert_eq!(bench.do_due(&estimate(0.05, 1), false), None);
    assert_eq!(bench.do_due(&estimate(0.06, 2), false), Some("void"));
    assert_eq!(bench.state(), None);
    assert_eq!(bench.ledger.shadow.desired, None);
    // Once it is in use, the verification estimate judges it and nothing else.
    assert_eq!(bench.do_due(&estimate(0.07, 3), false), Some("propose"));
    bench.approve();
    bench.try_out();
    assert_eq!(bench.do_due(&estimate(0.05, 4), false), None);
    assert_eq!(bench.state(), Some(DeploymentState::Verifying));
}

#[test]
fn what_is_used_is_judged_by_a_fresh_estimate() {
    for (found_rad, expected, state) in [
        (0.0505, Some("verify"), None),
        (0.06, Some("fail"), Some(DeploymentState::RollingBack)),
        // Outside by less than its own uncertainty.
        (0.05 + 0.002_8, None, Some(DeploymentState::Verifying)),
    ] {
        let mut bench = Bench::new();
        bench.do_due(&estimate(0.05, 0), false);
        bench.approve();
        bench.try_out();
        let mut early = estimate(found_rad, 10);
        early.distance_m = 59.0;
        assert_eq!(bench.do_due(&early, true), None, "too little driven");
        assert_eq!(bench.do_due(&estimate(found_rad, 20), true), expected);
        assert_eq!(bench.state(), state, "{found_rad}");
        assert_eq!(bench.do_due(&estimate(found_rad, 30), true), None, "once");
    }
}

#[test]
fn verified_means_that_difference_and_uncertainty_lie_within_the_tolerance() {
    // LiDAR x against its 10 mm: the value that was found beside the 434 mm in use, and its sigma.
    for (lidar_x_m, sigma_m, expected) in [
        (0.442, 0.004_2, None),
        (0.442, 0.001_1, None),
        (0.442, 0.000_9, Some("verify")),
        (0.434, 0.004_9, Some("verify")),
        (0.434, 0.005_1, None),
        (0.448, 0.002_1, None),
        (0.448, 0.001_9, Some("fail")),
    ] {
        let mut bench = Bench::new();
        bench.do_due(&estimate(0.05, 0), false);
        bench.approve();
        bench.try_out();
        let mut verification = estimate(0.05, 20);
        verification.parameters.lidar_x.value = lidar_x_m;
        verification.parameters.lidar_x.sigma = sigma_m;
        let done = bench.do_due(&verification, true);
        assert_eq!(done, expected, "{lidar_x_m} m, sigma {sigma_m} m");
    }
}

#[test]
fn what_was_rejected_is_not_proposed_again() {
    let mut bench = Bench::new();
    bench.do_due(&estimate(0.05, 0), false);
    let open = bench.ledger.open.clone().unwrap();
    let reject = Command::Reject {
        proposal: open.id,
        version: Some(open.version),
        reason: "it was pushed by hand".to_owned(),
    };
    bench.take(reject, &Actor::service());
    assert_eq!(bench.do_due(&estimate(0.05, 1), false), None);
    assert_eq!(bench.do_due(&estimate(0.06, 2), false), Some("propose"));
}

#[test]
fn the_curve_of_an_approved_estimate_is_signed_beside_the_same_values() {
    let signed_with = |steering_table: Option<SteeringTable>| {
        let mut bench = Bench::new();
        let mut estimate = estimate(0.05, 0);
        estimate.steering_table = steering_table;
        bench.do_due(&estimate, false);
        bench.approve();
        bench.signed.unwrap()
    };
    let table = SteeringTable {
        status: SteeringTableStatus::Informative,
        needs: None,
        points: vec![SteeringPoint {
            measured_rad: 0.05,
            true_rad: 0.0,
            sigma_rad: 0.000_2,
        }],
    };
    let without = signed_with(None);
    let with = signed_with(Some(table.clone()));
    assert_eq!(with.steering_table, Some(table));
    assert_eq!((with.values, with.sigmas), (without.values, without.sigmas));
    let unknown = SteeringTable::not_known(Some("turns to both sides".to_owned()));
    assert_eq!(signed_with(Some(unknown)).steering_table, None);
}

#[test]
fn the_frame_that_was_looked_at_is_signed_and_another_takes_two() {
    let axle = |x_m| Pose2 {
        x_m,
        y_m: 0.0,
        yaw_rad: 0.0,
    };
    let mut bench = Bench::new();
    bench.policy.approve_within = Some(Tolerance {
        steering_offset_deg: 5.0,
        lidar_yaw_deg: 5.0,
        lidar_position_mm: 50.0,
    });
    bench.rear_axle = Some(axle(-0.4));
    bench.do_due(&estimate(0.05, 0), false);
    assert_eq!(automatic(&bench.ledger, &bench.policy), None, "a new frame");
    // Configured while the proposal waits: nobody has agreed to it.
    bench.rear_axle = Some(axle(5.0));
    bench.approve();
    let signed = bench.signed.clone().unwrap();
    assert_eq!(signed.rear_axle_in_base_link, Some(axle(-0.4)));
    assert!((signed.lidar_in_base_link.unwrap().x_m - 0.034).abs() < 1e-12);
    bench.try_out();
    assert_eq!(bench.do_due(&estimate(0.05, 20), true), Some("verify"));

    assert_eq!(bench.do_due(&estimate(0.06, 30), false), Some("propose"));
    let needed = |bench: &Bench| bench.ledger.open.as_ref().unwrap().approvals_needed;
    assert_eq!(needed(&bench), 2, "base_link has moved");
    assert_eq!(automatic(&bench.ledger, &bench.policy), None);
    bench.rear_axle = Some(axle(-0.4));
    bench.wait();
    bench.do_due(&estimate(0.07, 31), false);
    assert_eq!(needed(&bench), 1);
    assert!(automatic(&bench.ledger, &bench.policy).is_some());
}

#[test]
fn automatic_steps_add_up_until_a_person_decides() {
    let mut bench = Bench::new();
    bench.policy.approve_within = Some(Tolerance {
        steering_offset_deg: 5.0,
        lidar_yaw_deg: 5.0,
        lidar_position_mm: 50.0,
    });
    let next = |bench: &mut Bench, offset_rad: f64, second: i64| {
        assert_eq!(
            bench.do_due(&estimate(offset_rad, second), false),
            Some("propose")
        );
        automatic(&bench.ledger, &bench.policy)
    };
    let settle = |bench: &mut Bench, offset_rad: f64, second: i64| {
        bench.try_out();
        assert_eq!(
            bench.do_due(&estimate(offset_rad, second), true),
            Some("verify")
        );
    };
    // Each step is 2.9 degrees, which is inside of the limit; two of them are not.
    let first = next(&mut bench, 0.05, 0).unwrap();
    bench.take(first, &Actor::service());
    settle(&mut bench, 0.05, 20);
    assert_eq!(next(&mut bench, 0.1, 30), None);
    bench.approve();
    settle(&mut bench, 0.1, 50);
    // There and back is no way around it.
    let back = next(&mut bench, 0.05, 60).unwrap();
    bench.take(back, &Actor::service());
    settle(&mut bench, 0.05, 80);
    assert_eq!(next(&mut bench, 0.1, 90), None);
}

#[test]
fn what_a_robot_says_of_itself_makes_no_step_smaller() {
    let mut bench = Bench::new();
    bench.policy.approve_within = Some(Tolerance {
        steering_offset_deg: 5.0,
        lidar_yaw_deg: 5.0,
        lidar_position_mm: 50.0,
    });
    bench.do_due(&estimate(0.05, 0), false);
    bench.approve();
    bench.try_out();
    assert_eq!(bench.do_due(&estimate(0.05, 20), true), Some("verify"));
    // Somebody says that it uses what is about to be proposed.
    bench.take(
        Command::Acknowledge(factory(0.199, WallTime(1))),
        &Actor::service(),
    );
    assert_eq!(
        bench.do_due(&estimate(0.2, 30), false),
        None,
        "it differs from nothing"
    );
    assert_eq!(bench.do_due(&estimate(0.21, 40), false), Some("propose"));
    assert_eq!(
        automatic(&bench.ledger, &bench.policy),
        None,
        "9 degrees from what was approved"
    );
}

#[test]
fn an_answer_that_the_next_one_contradicts_is_kept_until_a_person_decides() {
    let offered = || {
        let mut bench = Bench::new();
        bench.do_due(&estimate(0.05, 0), false);
        bench.approve();
        bench.try_out();
        bench
    };
    let own = |bench: &Bench, status: AppliedStatus, at_ns: WallTime| {
        let reported = bench.ledger.shadow.reported.clone().unwrap();
        Command::Acknowledge(Applied {
            generation: reported.generation,
            sha256: reported.sha256,
            status,
            reason: None,
            applied_at_ns: RobotTime(at_ns.0),
            values: None,
        })
    };
    let is_told = |bench: &Bench| bench.ledger.shadow.contradicted.is_some();
    // The same answer again is the robot's own, and going back is what a robot may do.
    let mut honest = offered();
    for status in [AppliedStatus::Applied, AppliedStatus::Reverted] {
        honest.take(own(&honest, status, WallTime(NOW_NS)), &Actor::service());
        assert!(!is_told(&honest), "{status:?}");
    }
    // It cannot have refused what it has applied, nor applied it at another time.
    let later = (AppliedStatus::Applied, NOW_NS + 5);
    for (status, at_ns) in [(AppliedStatus::Refused, NOW_NS + 5), later] {
        let mut forged = offered();
        assert_eq!(forged.do_due(&estimate(0.05, 20), true), Some("verify"));
        forged.take(own(&forged, status, WallTime(at_ns)), &Actor::service());
        assert!(is_told(&forged), "{status:?}");
    }
    // Nor go on using since then what it was said to have replaced.
    let mut forged = offered();
    assert_eq!(forged.do_due(&estimate(0.05, 20), true), Some("verify"));
    let own_answer = own(&forged, AppliedStatus::Applied, WallTime(NOW_NS));
    forged.take(
        Command::Acknowledge(factory(0.1, WallTime(7))),
        &Actor::service(),
    );
    assert!(!is_told(&forged));
    forged.take(own_answer, &Actor::service());
    assert!(is_told(&forged));
    let contradicted = forged.ledger.shadow.contradicted.clone().unwrap();
    assert_eq!(
        (contradicted.generation, contradicted.by_generation),
        (Generation(0), Generation(1))
    );
    // A person looks at it and decides.
    forged.do_due(&estimate(0.12, 30), false);
    forged.approve();
    assert!(!is_told(&forged));
}

/// Two agents of one robot: one refuses, the other one has applied.
#[test]
fn what_was_refused_and_is_in_use_contradicts_itself_and_is_not_wanted() {
    for status in [AppliedStatus::Refused, AppliedStatus::Failed] {
        let mut forged = Bench::new();
        forged.do_due(&estimate(0.05, 0), false);
        forged.approve();
        let offer = forged.ledger.live.clone().unwrap().offer;
        let generation = offer.generation;
        forged.take(Command::Offer { generation }, &Actor::service());
        let answer = |status| {
            Command::Acknowledge(Applied {
                generation: offer.generation,
                sha256: offer.sha256.clone(),
                status,
                reason: None,
                applied_at_ns: RobotTime(NOW_NS),
                values: Some(CalibrationValues::default()),
            })
        };
        forged.take(answer(status), &Actor::service());
        assert_eq!(forged.ledger.shadow.contradicted, None);
        assert_eq!(forged.ledger.shadow.sync(), SyncState::InSync);
        forged.take(answer(AppliedStatus::Applied), &Actor::service());
        let contradicted = forged.ledger.shadow.contradicted.clone().unwrap();
        assert_eq!(
            (contradicted.status, contradicted.by_status),
            (status, AppliedStatus::Applied)
        );
        assert_eq!(forged.ledger.shadow.sync(), SyncState::Unwanted);
    }
}
