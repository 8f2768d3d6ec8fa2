//! Back to what the robot used before, from wherever it stands.

use fleetcal_domain::approval::{DeploymentAction, Transition};
use fleetcal_domain::audit::Action;

use super::*;

/// An office whose robot has a deployment in `state`, and could go back to its drawing.
async fn office_in(state: DeploymentState) -> Office {
    let office = Office::open(Policy::default()).await;
    office.approve(0.02, Some(values(0.0))).await;
    if state == DeploymentState::Queued {
        return office;
    }
    office.post().await;
    if state == DeploymentState::Applied || state == DeploymentState::Verifying {
        office.answer(1, AppliedStatus::Applied).await.unwrap();
    }
    if state == DeploymentState::Verifying {
        office.post().await;
    }
    if state == DeploymentState::RollingBack {
        office.roll_back().await.unwrap();
    }
    assert_eq!(office.state(), Some(state));
    office
}

#[tokio::test]
async fn from_every_state_under_way_there_is_a_way_back() {
    use DeploymentState as S;
    for state in [S::Offered, S::Applied, S::Verifying, S::RollingBack] {
        let office = office_in(state).await;
        let last = office.clerk.ledger(&robot()).shadow.generation_last;
        office.roll_back().await.unwrap();
        assert_eq!(office.state(), Some(S::RollingBack), "{state:?}");
        let office = office.restart().await;
        let document = office.asked().await.unwrap();
        assert_eq!(
            (document.generation, document.values),
            (last + 1, values(0.0))
        );
        office
            .answer(last + 1, AppliedStatus::Applied)
            .await
            .unwrap();
        assert!(is_confirmation_of(&office.post().await, last + 1));
        let ended = office.latest().await;
        assert_eq!(ended.state, S::RolledBack, "{state:?}");
        assert_eq!(office.used(), Some(last + 1));
        // The same is not proposed again by the service itself.
        let declined = office.clerk.ledger(&robot()).shadow.declined;
        assert_eq!(declined, ended.earlier.first().map(|one| one.revision));
    }
}

#[tokio::test]
async fn what_nobody_has_seen_is_withdrawn() {
    let office = office_in(DeploymentState::Queued).await;
    office.roll_back().await.unwrap();
    assert_eq!(office.latest().await.state, DeploymentState::Withdrawn);
    assert_eq!(office.asked().await, None);
    assert_eq!(office.post().await, []);
    assert_eq!(office.clerk.parcels().await.unwrap(), []);
}

#[tokio::test]
async fn who_withdrew_what_nobody_has_seen_stays_with_it() {
    let office = office_in(DeploymentState::Queued).await;
    office.roll_back().await.unwrap();
    let asked = office.latest().await.roll_back.expect("who rolled it back");
    assert_eq!(
        (asked.by.as_str(), asked.reason.as_str()),
        ("ana", "it weaves")
    );
    assert!(!asked.automatic);
    let events = office.events().await;
    let event = &events.first().unwrap().event;
    assert_eq!(event.kind, EventKind::RolledBack, "nothing is on its way");
    assert_eq!(event.author.as_deref(), Some("ana"));
    assert_eq!(event.note.as_deref(), Some("it weaves"));
}

#[tokio::test]
async fn a_verification_that_fails_rolls_back() {
    let office = office_in(DeploymentState::Verifying).await;
    let outcome = office.verify(false).await;
    let actions: Vec<_> = outcome.transitions.iter().map(Transition::action).collect();
    assert_eq!(
        actions.first(),
        Some(&Action::Deployment(DeploymentAction::FailVerification))
    );
    assert_eq!(
        actions.last(),
        Some(&Action::Deployment(DeploymentAction::RollBack))
    );
    assert_eq!(office.state(), Some(DeploymentState::RollingBack));
}

#[tokio::test]
async fn a_verification_that_fails_waits_for_a_person_where_the_policy_says_so() {
    let policy = Policy {
        roll_back: false,
        ..Policy::default()
    };
    let office = Office::open(policy).await;
    office.approve(0.02, Some(values(0.0))).await;
    office.drive_on_trial().await;
    office.verify(false).await;
    assert_eq!(office.state(), Some(DeploymentState::Verifying));
    office.roll_back().await.unwrap();
    assert_eq!(office.state(), Some(DeploymentState::RollingBack));
}

#[tokio::test]
async fn where_nobody_knows_the_former_values_there_is_no_way_back() {
    let office = Office::open(Policy::default()).await;
    assert_eq!(
        office.roll_back().await.unwrap_err(),
        Refused::NothingToReturnTo
    );
    office.approve(0.02, None).await;
    office.drive_on_trial().await;
    assert_eq!(
        office.roll_back().await.unwrap_err(),
        Refused::NothingToReturnTo
    );
    // Nor does a failed verification find one; somebody has to decide.
    office.verify(false).await;
    assert_eq!(office.state(), Some(DeploymentState::Verifying));
    office.verify(true).await;
    assert_eq!(
        office.roll_back().await.unwrap_err(),
        Refused::NothingEarlier
    );
}

#[tokio::test]
async fn with_nothing_under_way_it_goes_back_to_what_was_verified() {
    let office = Office::open(Policy::default()).await;
    for offset_rad in [0.02, 0.05] {
        office.approve(offset_rad, None).await;
        office.drive_on_trial().await;
        office.verify(true).await;
    }
    office.roll_back().await.unwrap();
    assert_eq!(office.state(), Some(DeploymentState::Queued));
    let document = office.asked().await.unwrap();
    assert_eq!((document.generation, document.values), (3, values(0.02)));
    assert_eq!(document.approved_by, "ana");
    assert_eq!(office.latest().await.reason.as_deref(), Some("it weaves"));
}

/// An office whose robot was rolled back by a person from a verified calibration to the one
/// before, and drives with that.
async fn office_rolled_back_by_a_person(policy: Policy) -> Office {
    let office = Office::open(policy).await;
    for offset_rad in [0.02, 0.05] {
        office.approve(offset_rad, None).await;
        office.drive_on_trial().await;
        office.verify(true).await;
    }
    office.roll_back().await.unwrap();
    assert_eq!(office.drive_on_trial().await, 3);
    office
}

#[tokio::test]
async fn what_a_person_rolled_back_to_is_never_rolled_back_by_the_service() {
    let office = office_rolled_back_by_a_person(Policy::default()).await;
    let outcome = office.verify(false).await;
    assert_eq!(outcome.envelopes, [], "nothing is sent to the robot");
    assert_eq!(office.state(), None);
    assert_eq!(office.used(), Some(3));
    let office = office.restart().await;
    let kept = office.latest().await;
    assert_eq!(kept.state, DeploymentState::Kept);
    let asked = kept.roll_back.unwrap();
    assert_eq!((asked.by.as_str(), asked.automatic), ("ana", false));
    assert_eq!(
        (asked.reason.as_str(), asked.values),
        ("it weaves", values(0.02))
    );
    // The reason for the present state does not replace the person's.
    assert!(kept.reason.unwrap().contains("values that ana chose"));
    office.clock.advance(48 * HOUR);
    office.look().await;
    assert_eq!(office.asked().await.unwrap().generation, 3);
}

#[tokio::test]
async fn the_history_and_the_audit_name_who_rolled_back_why_and_to_what() {
    let office = office_rolled_back_by_a_person(Policy::default()).await;
    office.verify(false).await;
    let filter = fleetcal_store::AuditFilter {
        action: Some("deployment.create".to_owned()),
        limit: 10,
        ..Default::default()
    };
    let row = office.store.audit(&filter).await.unwrap().remove(0);
    assert_eq!(
        (row.actor.as_str(), row.reason.as_deref()),
        ("ana", Some("it weaves"))
    );
    let record = row.after.unwrap();
    assert_eq!(record["roll_back"]["values"]["steering_offset_rad"], 0.02);
    let events = office.events().await;
    let event = events
        .iter()
        .find(|one| one.event.kind == EventKind::RollingBack);
    let event = &event.expect("a roll-back in the history").event;
    assert_eq!(event.author.as_deref(), Some("ana"));
    assert_eq!(event.note.as_deref(), Some("it weaves"));
    let details = event.details.as_ref().unwrap();
    assert_eq!(details["generation"], 3);
    assert_eq!(details["values"]["steering_offset_rad"], 0.02);
}

#[tokio::test]
async fn what_a_person_rolled_back_to_is_replaced_by_people_alone() {
    let within = Tolerance {
        steering_offset_deg: 5.0,
        lidar_yaw_deg: 5.0,
        lidar_position_mm: 100.0,
    };
    let policy = Policy {
        approve_within: Some(within),
        ..Policy::default()
    };
    let office = office_rolled_back_by_a_person(policy).await;
    office.verify(false).await;
    office.propose(0.035, None).await;
    let refused = office.take(office.approval(), Actor::service()).await;
    assert!(matches!(
        refused,
        Err(Refused::ChosenByPerson { generation: 3, .. })
    ));
    office.look().await;
    assert_eq!(office.state(), None, "no automatic approval");
    office
        .take(office.approval(), person("bruno"))
        .await
        .unwrap();
    assert_eq!(office.state(), Some(DeploymentState::Queued));
}

#[tokio::test]
async fn a_robot_that_was_away_still_goes_back_to_what_a_person_chose() {
    let office = Office::open(Policy::default()).await;
    for offset_rad in [0.02, 0.05] {
        office.approve(offset_rad, None).await;
        office.drive_on_trial().await;
        office.verify(true).await;
    }
    office.roll_back().await.unwrap();
    office.post().await;
    office.clock.advance(24 * HOUR);
    office.look().await;
    assert_eq!(office.latest().await.state, DeploymentState::TimedOut);
    let office = office.restart().await;
    assert_eq!(office.asked().await.unwrap().generation, 3);
    office.answer(3, AppliedStatus::Applied).await.unwrap();
    assert!(is_confirmation_of(&office.post().await, 3));
    assert_eq!(office.used(), Some(3));
}

#[tokio::test]
async fn a_failed_deployment_returns_to_what_a_person_chose_as_that_persons_choice() {
    let office = office_rolled_back_by_a_person(Policy::default()).await;
    office.verify(false).await;
    office.propose(0.035, None).await;
    let approval = office.approval();
    office.take(approval, person("bruno")).await.unwrap();
    office.drive_on_trial().await;
    office.verify(false).await;
    assert_eq!(office.state(), Some(DeploymentState::RollingBack));
    let desired = office
        .clerk
        .ledger(&robot())
        .shadow
        .desired
        .clone()
        .unwrap();
    assert_eq!(
        (desired.generation, desired.chosen_by.as_deref()),
        (5, Some("ana"))
    );
}

#[tokio::test]
async fn going_back_twice_does_not_return_to_what_was_left() {
    let office = Office::open(Policy::default()).await;
    for offset_rad in [0.02, 0.05, 0.08] {
        office.approve(offset_rad, None).await;
        office.drive_on_trial().await;
        office.verify(true).await;
    }
    for offset_rad in [0.05, 0.02] {
        office.roll_back().await.unwrap();
        assert_eq!(office.asked().await.unwrap().values, values(offset_rad));
        office.drive_on_trial().await;
        office.verify(true).await;
    }
    assert_eq!(
        office.roll_back().await.unwrap_err(),
        Refused::NothingEarlier
    );
}

#[tokio::test]
async fn what_failed_and_nobody_decided_upon_says_so() {
    let office = Office::open(Policy::default()).await;
    office.approve(0.02, None).await;
    office.drive_on_trial().await;
    office.verify(false).await;
    office.clock.advance(24 * HOUR);
    office.look().await;
    let ended = office.latest().await;
    assert_eq!(ended.state, DeploymentState::Inconclusive);
    assert!(ended.reason.unwrap().contains("nobody decided"));
}

#[tokio::test]
async fn a_robot_that_does_not_take_its_former_values_is_reported() {
    let office = office_in(DeploymentState::Verifying).await;
    office.roll_back().await.unwrap();
    office.post().await;
    office.clock.advance(24 * HOUR);
    office.look().await;
    assert_eq!(office.latest().await.state, DeploymentState::RollbackFailed);
    // It still gets them when it comes back, and is told to keep them.
    assert_eq!(office.asked().await.unwrap().generation, 2);
    office.answer(2, AppliedStatus::Applied).await.unwrap();
    assert!(is_confirmation_of(&office.post().await, 2));
    assert_eq!(office.used(), Some(2));
}
