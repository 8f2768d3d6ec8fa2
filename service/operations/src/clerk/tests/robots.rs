//! Robots that are late, forgetful, or do not drive.

use super::*;

#[tokio::test]
async fn a_robot_that_starts_an_hour_later_gets_the_newest_once() {
    let office = Office::open(Policy::default()).await;
    office.approve(0.02, None).await;
    // A first one is on the wire, and nobody is there to take it.
    assert_eq!(office.post().await.len(), 1);
    assert_eq!(office.state(), Some(DeploymentState::Offered));
    office.roll_back().await.unwrap();
    assert_eq!(office.latest().await.state, DeploymentState::TimedOut);
    office.approve(0.03, None).await;
    let office = office.restart().await;
    office.clock.advance(HOUR);
    // What was decided and not sent before the restart is sent after it, and once.
    let letters = office.post().await;
    assert!(
        matches!(letters.as_slice(), [Letter::Approved(_)]),
        "{letters:?}"
    );
    assert_eq!(office.post().await, []);
    let document = office.asked().await.unwrap();
    assert_eq!((document.generation, document.values), (2, values(0.03)));
    office.answer(2, AppliedStatus::Applied).await.unwrap();
    let office = office.restart().await;
    assert!(is_confirmation_of(&office.post().await, 2));
    assert_eq!(office.state(), Some(DeploymentState::Verifying));
    assert_eq!(office.used(), Some(2));
    let applied = office.latest().await;
    assert_eq!((applied.offer.generation, applied.earlier.len()), (2, 0));
}

#[tokio::test]
async fn the_same_answer_again_changes_nothing_and_is_confirmed_again() {
    let office = Office::open(Policy::default()).await;
    office.approve(0.02, None).await;
    let generation = office.drive_on_trial().await;
    let (rows, before) = (office.rows().await, office.clerk.ledger(&robot()));
    for _ in 0..3 {
        office
            .answer(generation, AppliedStatus::Applied)
            .await
            .unwrap();
        assert!(is_confirmation_of(&office.post().await, generation));
    }
    assert_eq!(office.rows().await, rows);
    assert_eq!(office.clerk.ledger(&robot()), before);
}

#[tokio::test]
async fn an_answer_after_the_time_is_over_is_not_confirmed() {
    let office = Office::open(Policy::default()).await;
    office.approve(0.02, None).await;
    office.post().await;
    office.clock.advance(24 * HOUR);
    office.look().await;
    assert_eq!(office.latest().await.state, DeploymentState::TimedOut);
    assert_eq!(office.asked().await, None);
    office.answer(1, AppliedStatus::Applied).await.unwrap();
    assert_eq!(office.clerk.confirmed(&robot()), None);
    assert_eq!(office.post().await, []);
    let in_use = office.clerk.ledger(&robot()).shadow.in_use.clone().unwrap();
    assert_eq!((in_use.generation, in_use.values), (1, values(0.02)));
    // It was not told to keep it, and goes back to what nobody knows.
    office.answer(1, AppliedStatus::Reverted).await.unwrap();
    assert_eq!(office.used(), None);
}

#[tokio::test]
async fn a_robot_that_reverts_unheard_is_believed_to_use_what_it_used() {
    let office = Office::open(Policy::default()).await;
    office.approve(0.02, None).await;
    office.drive_on_trial().await;
    office.verify(true).await;
    office.approve(0.05, None).await;
    assert_eq!(office.asked().await.unwrap().generation, 2);
    // The link was cut: it applied the second one, heard nothing, and went back to the first.
    office.answer(2, AppliedStatus::Reverted).await.unwrap();
    assert_eq!(office.latest().await.state, DeploymentState::Failed);
    let shadow = office.clerk.ledger(&robot()).shadow.clone();
    assert_eq!(office.used(), Some(1));
    assert_eq!(shadow.in_use.unwrap().values, values(0.02));
    assert_eq!(shadow.desired.unwrap().generation, 1);
}

#[tokio::test]
async fn a_late_word_about_the_values_on_their_way_out_does_not_hide_what_is_used() {
    let office = Office::open(Policy::default()).await;
    office.approve(0.02, Some(values(0.0))).await;
    office.drive_on_trial().await;
    office.roll_back().await.unwrap();
    office.clock.advance(HOUR);
    office.answer(1, AppliedStatus::Applied).await.unwrap();
    assert_eq!(office.clerk.confirmed(&robot()), None);
    let in_use = office.clerk.ledger(&robot()).shadow.in_use.clone().unwrap();
    assert_eq!((in_use.generation, in_use.values), (1, values(0.02)));
}

#[tokio::test]
async fn an_old_answer_does_not_take_the_place_of_a_new_one() {
    let office = Office::open(Policy::default()).await;
    office.approve(0.02, None).await;
    office.drive_on_trial().await;
    office.verify(true).await;
    office.approve(0.05, None).await;
    assert_eq!(office.asked().await.unwrap().generation, 2);
    office.post().await;
    office.answer(2, AppliedStatus::Applied).await.unwrap();
    // It was on its way for long.
    office.answer(1, AppliedStatus::Failed).await.unwrap();
    assert!(is_confirmation_of(&office.post().await, 2));
    assert_eq!(office.state(), Some(DeploymentState::Verifying));
}

#[tokio::test]
async fn a_robot_that_does_not_drive_is_inconclusive_after_a_day() {
    let office = Office::open(Policy::default()).await;
    office.approve(0.02, None).await;
    office.drive_on_trial().await;
    office.clock.advance(Duration::from_secs(24 * 3600 - 1));
    office.look().await;
    assert_eq!(office.state(), Some(DeploymentState::Verifying));
    office.clock.advance(Duration::from_secs(1));
    office.look().await;
    let ended = office.latest().await;
    assert_eq!(ended.state, DeploymentState::Inconclusive);
    assert!(ended.reason.unwrap().contains("not moved enough"));
    // It keeps what it has.
    let ledger = office.clerk.ledger(&robot());
    assert!(ledger.shadow.in_sync());
    assert_eq!(ledger.shadow.verified, []);
}

#[tokio::test]
async fn an_answer_about_what_was_never_given_out_is_refused() {
    let office = Office::open(Policy::default()).await;
    office.approve(0.02, None).await;
    let refused = office.answer(1_002, AppliedStatus::Applied).await;
    assert_eq!(
        refused.unwrap_err(),
        Refused::NeverOffered {
            generation: 1_002,
            most: 1_001
        }
    );
    office.post().await;
    let applied = Applied {
        generation: 1,
        sha256: "ab".repeat(32),
        status: AppliedStatus::Applied,
        reason: None,
        applied_at_ns: 0,
        values: None,
    };
    let actor = Actor::robot(&robot());
    let other = office.clerk.acknowledge(&robot(), applied, actor).await;
    assert!(matches!(
        other,
        Err(StoreError::Refused(Refused::OtherDocument { .. }))
    ));
    assert_eq!(office.clerk.answer_counters()[1], ("answer_refused", 2));
}

#[tokio::test]
async fn what_is_approved_after_an_older_database_came_back_is_newer_than_what_the_robot_has() {
    let office = Office::open(Policy::default()).await;
    office.answer(7, AppliedStatus::Applied).await.unwrap();
    assert!(
        office.post().await.is_empty(),
        "nobody here has approved it"
    );
    office.approve(0.02, None).await;
    assert_eq!(office.asked().await.unwrap().generation, 8);
}

#[tokio::test]
async fn what_no_robot_can_drive_with_is_not_believed() {
    let office = Office::open(Policy::default()).await;
    office.approve(0.02, None).await;
    let sha256 = match office.post().await.as_slice() {
        [Letter::Approved(envelope)] => envelope.sha256.clone(),
        other => panic!("{other:?}"),
    };
    let applied = Applied {
        generation: 1,
        sha256,
        status: AppliedStatus::Applied,
        reason: None,
        applied_at_ns: 0,
        values: Some(values(1e300)),
    };
    let actor = Actor::robot(&robot());
    let refused = office.clerk.acknowledge(&robot(), applied, actor).await;
    let refused = refused.unwrap_err().to_string();
    assert!(refused.contains("steering_offset_rad"), "{refused}");
    assert_eq!(office.used(), None);
}
