//! Decisions of people, the policy and the deployment freeze.

use fleetcal_domain::approval::Tolerance;
use fleetcal_model::{Generation, ProposalId, Version};

use super::*;

#[tokio::test]
async fn a_proposal_expires_and_cannot_be_approved_at_its_last_moment() {
    let bench = Bench::open(Policy::default()).await;
    bench.propose(0.02, None).await;
    let approval = bench.approval();
    bench.clock.advance(24 * HOUR);
    let refused = bench.take(approval, person("ana")).await.unwrap_err();
    let state = ProposalState::Expired;
    assert_eq!(refused, Refused::ProposalClosed { state });
    bench.look().await;
    assert_eq!(bench.lifecycle.ledger(&robot()).open, None);
    let (proposal, _) = bench.store.proposal(ProposalId(1)).await.unwrap().unwrap();
    assert_eq!(proposal.state, state);
    assert_eq!(bench.asked().await, None);
}

#[tokio::test]
async fn a_decision_is_seen_through_when_nobody_waits_for_it_any_more() {
    let bench = Bench::open(Policy::default()).await;
    bench.propose(0.02, Some(values(0.0))).await;
    let robot = robot();
    let asked = bench
        .lifecycle
        .decide(&robot, bench.approval(), person("ana"), None);
    // A browser that closes its connection at the worst moment.
    tokio::select! {
        biased;
        _ = asked => panic!("a decision is not taken at once"),
        () = std::future::ready(()) => {}
    }
    bench.store.flush().await.unwrap();
    for _ in 0..2_000 {
        if bench.state().is_some() {
            break;
        }
        tokio::time::sleep(Duration::from_millis(1)).await;
    }
    assert_eq!(bench.state(), Some(DeploymentState::Queued));
    assert_eq!(bench.asked().await.unwrap().generation, Generation(1));
}

#[tokio::test]
async fn the_deployment_freeze_holds_what_no_robot_has_seen() {
    let bench = Bench::open(Policy::default()).await;
    bench.approve(0.02, None).await;
    bench.drive_in_verification().await;
    bench.verify(true).await;
    let reason = || "maintenance in hall 3".to_owned();
    bench
        .lifecycle
        .freeze(true, Version(1), person("ana"), reason())
        .await
        .unwrap();
    bench.approve(0.05, None).await;
    assert_eq!(bench.send_outbox().await, []);
    assert_eq!(bench.asked().await.unwrap().generation, Generation(1));
    assert_eq!(bench.state(), Some(DeploymentState::Queued));
    // Held over a restart too.
    let bench = bench.restart().await;
    assert_eq!(bench.send_outbox().await, []);
    assert_eq!(bench.asked().await.unwrap().generation, Generation(1));
    let stale = bench
        .lifecycle
        .freeze(false, Version(1), person("bruno"), reason())
        .await;
    assert!(matches!(
        stale,
        Err(StoreError::Refused(Refused::Stale { found: Version(2) }))
    ));
    bench
        .lifecycle
        .freeze(false, Version(2), person("bruno"), reason())
        .await
        .unwrap();
    assert_eq!(bench.send_outbox().await.len(), 1);
    assert_eq!(bench.state(), Some(DeploymentState::Offered));
}

#[tokio::test]
async fn the_stop_counts_from_its_commit_on() {
    let bench = Bench::open(Policy::default()).await;
    bench.approve(0.02, None).await;
    // Committed, and not yet known to those who push.
    let stop = SetFreeze {
        frozen: true,
        version: Version(1),
        actor: person("ana"),
        now: bench.clock.now(),
        reason: "maintenance in hall 3".to_owned(),
    };
    bench.store.transact(stop).await.unwrap();
    assert!(!bench.lifecycle.deployment_freeze().frozen);
    assert_eq!(bench.send_outbox().await, []);
    assert_eq!(bench.asked().await, None);
    assert_eq!(bench.state(), Some(DeploymentState::Queued));
}

#[tokio::test]
async fn a_policy_counts_from_its_commit_on() {
    let bench = Bench::open(Policy::default()).await;
    bench.propose(0.02, Some(values(0.0))).await;
    // Committed, and not yet known to the one who takes the approval.
    let careful = Policy {
        two_approvers_beyond: Tolerance {
            steering_offset_deg: 0.1,
            lidar_yaw_deg: 0.1,
            lidar_position_mm: 1.0,
        },
        ..Policy::default()
    };
    let set = SetPolicy {
        policy: Some(careful),
        version: Version(1),
        actor: person("ana"),
        now: bench.clock.now(),
        reason: "narrow aisles".to_owned(),
    };
    bench.store.transact(set).await.unwrap();
    assert_eq!(*bench.lifecycle.policy(), Policy::default());
    let approval = bench.approval();
    bench.take(approval, person("ana")).await.unwrap();
    assert_eq!(bench.state(), None, "one of two has approved");
    let approval = bench.approval();
    bench.take(approval, person("bruno")).await.unwrap();
    assert_eq!(bench.state(), Some(DeploymentState::Queued));
}

#[tokio::test]
async fn the_way_back_is_not_held() {
    let bench = Bench::open(Policy::default()).await;
    bench.approve(0.02, Some(values(0.0))).await;
    bench.drive_in_verification().await;
    let reason = "maintenance in hall 3".to_owned();
    bench
        .lifecycle
        .freeze(true, Version(1), person("ana"), reason)
        .await
        .unwrap();
    bench.roll_back().await.unwrap();
    assert_eq!(bench.send_outbox().await.len(), 1);
    assert_eq!(bench.asked().await.unwrap().values, values(0.0));
}

#[tokio::test]
async fn a_drawing_that_is_moved_for_a_proposal_does_not_save_an_approver() {
    let bench = Bench::open(Policy::default()).await;
    let far = CalibrationValues {
        lidar_x_m: 2.5,
        ..values(0.0)
    };
    let propose = Command::Propose {
        origin: Origin::Person,
        values: far,
        sigmas: CalibrationValues::default(),
        evidence: Evidence::default(),
        reason: None,
    };
    let mallory = person("mallory");
    bench.draw(Some(values(0.0)), Actor::service()).await;
    bench.draw(Some(far), mallory.clone()).await;
    bench.take(propose, mallory.clone()).await.unwrap();
    bench.draw(Some(values(0.0)), mallory).await;
    bench.take(bench.approval(), person("ana")).await.unwrap();
    assert_eq!(bench.state(), None, "one of two has approved");
    bench.take(bench.approval(), person("bruno")).await.unwrap();
    assert_eq!(bench.state(), Some(DeploymentState::Queued));
}

#[tokio::test]
async fn only_a_small_change_of_the_estimators_is_approved_without_a_person() {
    let within = Tolerance {
        steering_offset_deg: 2.0,
        lidar_yaw_deg: 2.0,
        lidar_position_mm: 20.0,
    };
    let policy = Policy {
        approve_within: Some(within),
        ..Policy::default()
    };
    let bench = Bench::open(policy).await;
    bench.propose(0.05, Some(values(0.0))).await;
    bench.look().await;
    assert!(
        bench.lifecycle.ledger(&robot()).open.is_some(),
        "2.9 degrees are not small"
    );
    bench.propose(0.03, None).await;
    bench.look().await;
    assert!(
        bench.lifecycle.ledger(&robot()).open.is_some(),
        "nobody knows how large it is"
    );
    bench.propose(0.03, Some(values(0.0))).await;
    bench.look().await;
    assert_eq!(bench.state(), Some(DeploymentState::Queued));
    let (proposal, _) = bench.store.proposal(ProposalId(3)).await.unwrap().unwrap();
    assert_eq!(proposal.state, ProposalState::Approved);
    assert_eq!(proposal.approvals.first().unwrap().by, "fleetcal");
    // By default nothing is.
    let bench = Bench::open(Policy::default()).await;
    bench.propose(0.03, Some(values(0.0))).await;
    bench.look().await;
    assert_eq!(bench.state(), None);
}

#[tokio::test]
async fn a_change_that_became_large_needs_a_second_person() {
    let policy = Policy::default();
    let bench = Bench::open(policy).await;
    for offset_rad in [0.04, 0.08] {
        bench.approve(offset_rad, Some(values(0.0))).await;
        bench.drive_in_verification().await;
        bench.verify(true).await;
    }
    // From 0.08 it is a small step; from 0.04, to which the robot goes back, it is a large one.
    bench.propose(0.14, None).await;
    let needed = |bench: &Bench| {
        let ledger = bench.lifecycle.ledger(&robot());
        ledger.open.as_ref().map(|open| open.approvals_needed)
    };
    assert_eq!(needed(&bench), Some(1));
    bench.roll_back().await.unwrap();
    bench.drive_in_verification().await;
    bench.verify(true).await;
    bench.take(bench.approval(), person("ana")).await.unwrap();
    assert_eq!(needed(&bench), Some(2));
    let again = bench.take(bench.approval(), person("ana")).await;
    assert_eq!(
        again.unwrap_err(),
        Refused::ApprovedAlready("ana".to_owned())
    );
    bench.take(bench.approval(), person("bruno")).await.unwrap();
    assert_eq!(bench.state(), Some(DeploymentState::Queued));
}
