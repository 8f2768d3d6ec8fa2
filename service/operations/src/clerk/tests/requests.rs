//! What people, the policy and the deployment freeze decide.

use fleetcal_domain::approval::Tolerance;

use super::*;

#[tokio::test]
async fn a_proposal_expires_and_cannot_be_approved_at_its_last_moment() {
    let office = Office::open(Policy::default()).await;
    office.propose(0.02, None).await;
    let approval = office.approval();
    office.clock.advance(24 * HOUR);
    let refused = office.take(approval, person("ana")).await.unwrap_err();
    let state = ProposalState::Expired;
    assert_eq!(refused, Refused::ProposalClosed { state });
    office.look().await;
    assert_eq!(office.clerk.ledger(&robot()).open, None);
    let (proposal, _) = office.store.proposal(1).await.unwrap().unwrap();
    assert_eq!(proposal.state, state);
    assert_eq!(office.asked().await, None);
}

#[tokio::test]
async fn a_decision_is_seen_through_when_nobody_waits_for_it_any_more() {
    let office = Office::open(Policy::default()).await;
    office.propose(0.02, None).await;
    let robot = robot();
    let asked = office
        .clerk
        .decide(&robot, office.approval(), person("ana"), None);
    // A browser that closes its connection at the worst moment.
    tokio::select! {
        biased;
        _ = asked => panic!("a decision is not taken at once"),
        () = std::future::ready(()) => {}
    }
    office.store.flush().await.unwrap();
    for _ in 0..2_000 {
        if office.state().is_some() {
            break;
        }
        tokio::time::sleep(Duration::from_millis(1)).await;
    }
    assert_eq!(office.state(), Some(DeploymentState::Queued));
    assert_eq!(office.asked().await.unwrap().generation, 1);
}

#[tokio::test]
async fn the_deployment_freeze_holds_what_no_robot_has_seen() {
    let office = Office::open(Policy::default()).await;
    office.approve(0.02, None).await;
    office.drive_on_trial().await;
    office.verify(true).await;
    let reason = || "maintenance in hall 3".to_owned();
    office
        .clerk
        .freeze(true, 1, person("ana"), reason())
        .await
        .unwrap();
    office.approve(0.05, None).await;
    assert_eq!(office.post().await, []);
    assert_eq!(office.asked().await.unwrap().generation, 1);
    assert_eq!(office.state(), Some(DeploymentState::Queued));
    // Held over a restart too.
    let office = office.restart().await;
    assert_eq!(office.post().await, []);
    assert_eq!(office.asked().await.unwrap().generation, 1);
    let stale = office
        .clerk
        .freeze(false, 1, person("bruno"), reason())
        .await;
    assert!(matches!(
        stale,
        Err(StoreError::Refused(Refused::Stale { found: 2 }))
    ));
    office
        .clerk
        .freeze(false, 2, person("bruno"), reason())
        .await
        .unwrap();
    assert_eq!(office.post().await.len(), 1);
    assert_eq!(office.state(), Some(DeploymentState::Offered));
}

#[tokio::test]
async fn the_stop_counts_from_its_commit_on() {
    let office = Office::open(Policy::default()).await;
    office.approve(0.02, None).await;
    // Committed, and not yet known to those who push.
    let stop = SetFreeze {
        frozen: true,
        version: 1,
        actor: person("ana"),
        now_ns: office.clock.now_ns(),
        reason: "maintenance in hall 3".to_owned(),
    };
    office.store.transact(stop).await.unwrap();
    assert!(!office.clerk.deployment_freeze().frozen);
    assert_eq!(office.post().await, []);
    assert_eq!(office.asked().await, None);
    assert_eq!(office.state(), Some(DeploymentState::Queued));
}

#[tokio::test]
async fn a_policy_counts_from_its_commit_on() {
    let office = Office::open(Policy::default()).await;
    office.propose(0.02, Some(values(0.0))).await;
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
        version: 1,
        actor: person("ana"),
        now_ns: office.clock.now_ns(),
        reason: "narrow aisles".to_owned(),
    };
    office.store.transact(set).await.unwrap();
    assert_eq!(*office.clerk.policy(), Policy::default());
    let approval = office.approval();
    office.take(approval, person("ana")).await.unwrap();
    assert_eq!(office.state(), None, "one of two has approved");
    let approval = office.approval();
    office.take(approval, person("bruno")).await.unwrap();
    assert_eq!(office.state(), Some(DeploymentState::Queued));
}

#[tokio::test]
async fn the_way_back_is_not_held() {
    let office = Office::open(Policy::default()).await;
    office.approve(0.02, Some(values(0.0))).await;
    office.drive_on_trial().await;
    let reason = "maintenance in hall 3".to_owned();
    office
        .clerk
        .freeze(true, 1, person("ana"), reason)
        .await
        .unwrap();
    office.roll_back().await.unwrap();
    assert_eq!(office.post().await.len(), 1);
    assert_eq!(office.asked().await.unwrap().values, values(0.0));
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
    let office = Office::open(policy).await;
    office.propose(0.05, Some(values(0.0))).await;
    office.look().await;
    assert!(
        office.clerk.ledger(&robot()).open.is_some(),
        "2.9 degrees are not small"
    );
    office.propose(0.03, None).await;
    office.look().await;
    assert!(
        office.clerk.ledger(&robot()).open.is_some(),
        "nobody knows how large it is"
    );
    office.propose(0.03, Some(values(0.0))).await;
    office.look().await;
    assert_eq!(office.state(), Some(DeploymentState::Queued));
    let (proposal, _) = office.store.proposal(3).await.unwrap().unwrap();
    assert_eq!(proposal.state, ProposalState::Approved);
    assert_eq!(proposal.approvals.first().unwrap().by, "fleetcal");
    // By default nothing is.
    let office = Office::open(Policy::default()).await;
    office.propose(0.03, Some(values(0.0))).await;
    office.look().await;
    assert_eq!(office.state(), None);
}

#[tokio::test]
async fn a_change_that_became_large_needs_a_second_person() {
    let policy = Policy::default();
    let office = Office::open(policy).await;
    for offset_rad in [0.04, 0.08] {
        office.approve(offset_rad, Some(values(0.0))).await;
        office.drive_on_trial().await;
        office.verify(true).await;
    }
    // From 0.08 it is a small step; from 0.04, to which the robot goes back, it is a large one.
    office.propose(0.14, None).await;
    let needed = |office: &Office| {
        let ledger = office.clerk.ledger(&robot());
        ledger.open.as_ref().map(|open| open.approvals_needed)
    };
    assert_eq!(needed(&office), Some(1));
    office.roll_back().await.unwrap();
    office.drive_on_trial().await;
    office.verify(true).await;
    office.take(office.approval(), person("ana")).await.unwrap();
    assert_eq!(needed(&office), Some(2));
    let again = office.take(office.approval(), person("ana")).await;
    assert_eq!(
        again.unwrap_err(),
        Refused::ApprovedAlready("ana".to_owned())
    );
    office
        .take(office.approval(), person("bruno"))
        .await
        .unwrap();
    assert_eq!(office.state(), Some(DeploymentState::Queued));
}
