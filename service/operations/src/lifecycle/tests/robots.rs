//! Robots that are late, forgetful, or do not drive.

use fleetcal_model::{Generation, RobotTime};

use fleetcal_domain::approval::SyncState;
use fleetcal_proto::offer::Question;

use super::*;

#[tokio::test]
async fn a_robot_that_starts_an_hour_later_gets_the_newest_once() {
    let bench = Bench::open(Policy::default()).await;
    bench.approve(0.02, None).await;
    // A first one is on the wire, and nobody is there to take it.
    assert_eq!(bench.send_outbox().await.len(), 1);
    assert_eq!(bench.state(), Some(DeploymentState::Offered));
    bench.roll_back().await.unwrap();
    assert_eq!(bench.latest().await.state, DeploymentState::Withdrawn);
    bench.approve(0.03, None).await;
    let bench = bench.restart().await;
    bench.clock.advance(HOUR);
    // What was decided and not sent before the restart is sent after it, and once.
    let messages = bench.send_outbox().await;
    assert!(
        matches!(messages.as_slice(), [OutboxMessage::Approved(_)]),
        "{messages:?}"
    );
    assert_eq!(bench.send_outbox().await, []);
    let document = bench.asked().await.unwrap();
    assert_eq!(
        (document.generation, document.values),
        (Generation(2), values(0.03))
    );
    bench
        .answer(Generation(2), AppliedStatus::Applied)
        .await
        .unwrap();
    let bench = bench.restart().await;
    assert!(is_confirmation_of(
        &bench.send_outbox().await,
        Generation(2)
    ));
    assert_eq!(bench.state(), Some(DeploymentState::Verifying));
    assert_eq!(bench.used(), Some(Generation(2)));
    let applied = bench.latest().await;
    assert_eq!(
        (applied.offer.generation, applied.earlier.len()),
        (Generation(2), 0)
    );
}

#[tokio::test]
async fn the_same_answer_again_changes_nothing_and_is_confirmed_again() {
    let bench = Bench::open(Policy::default()).await;
    bench.approve(0.02, None).await;
    let generation = bench.drive_in_verification().await;
    let (rows, before) = (bench.rows().await, bench.lifecycle.ledger(&robot()));
    for _ in 0..3 {
        bench.applies(generation).await;
    }
    assert_eq!(bench.rows().await, rows);
    assert_eq!(bench.lifecycle.ledger(&robot()), before);
}

#[tokio::test]
async fn an_answer_after_the_time_is_over_is_not_confirmed() {
    let bench = Bench::open(Policy::default()).await;
    bench.approve(0.02, None).await;
    bench.send_outbox().await;
    bench.clock.advance(24 * HOUR);
    bench.look().await;
    assert_eq!(bench.latest().await.state, DeploymentState::TimedOut);
    assert_eq!(bench.asked().await, None);
    bench
        .answer(Generation(1), AppliedStatus::Applied)
        .await
        .unwrap();
    assert_eq!(bench.lifecycle.confirmed(&robot()), None);
    assert_eq!(bench.send_outbox().await, []);
    let in_use = bench
        .lifecycle
        .ledger(&robot())
        .shadow
        .in_use
        .clone()
        .unwrap();
    assert_eq!(
        (in_use.generation, in_use.values),
        (Generation(1), values(0.02))
    );
    // It was not told to keep it, and goes back to what nobody knows.
    bench
        .answer(Generation(1), AppliedStatus::Reverted)
        .await
        .unwrap();
    assert_eq!(bench.used(), None);
}

#[tokio::test]
async fn a_robot_that_reverts_unheard_is_believed_to_use_what_it_used() {
    let bench = Bench::open(Policy::default()).await;
    bench.approve(0.02, None).await;
    bench.drive_in_verification().await;
    bench.verify(true).await;
    bench.approve(0.05, None).await;
    assert_eq!(bench.asked().await.unwrap().generation, Generation(2));
    // The link was cut: it applied the second one, heard nothing, and went back to the first.
    bench
        .answer(Generation(2), AppliedStatus::Reverted)
        .await
        .unwrap();
    assert_eq!(bench.latest().await.state, DeploymentState::Failed);
    let shadow = bench.lifecycle.ledger(&robot()).shadow.clone();
    assert_eq!(bench.used(), Some(Generation(1)));
    assert_eq!(shadow.in_use.unwrap().values, values(0.02));
    assert_eq!(shadow.desired.unwrap().generation, Generation(1));
}

#[tokio::test]
async fn a_late_word_about_the_values_on_their_way_out_does_not_hide_what_is_used() {
    let bench = Bench::open(Policy::default()).await;
    bench.approve(0.02, Some(values(0.0))).await;
    bench.drive_in_verification().await;
    bench.roll_back().await.unwrap();
    bench.clock.advance(HOUR);
    bench
        .answer(Generation(1), AppliedStatus::Applied)
        .await
        .unwrap();
    assert_eq!(bench.lifecycle.confirmed(&robot()), None);
    let in_use = bench
        .lifecycle
        .ledger(&robot())
        .shadow
        .in_use
        .clone()
        .unwrap();
    assert_eq!(
        (in_use.generation, in_use.values),
        (Generation(1), values(0.02))
    );
}

#[tokio::test]
async fn an_old_answer_does_not_take_the_place_of_a_new_one() {
    let bench = Bench::open(Policy::default()).await;
    bench.approve(0.02, None).await;
    bench.drive_in_verification().await;
    bench.verify(true).await;
    bench.approve(0.05, None).await;
    assert_eq!(bench.asked().await.unwrap().generation, Generation(2));
    bench.send_outbox().await;
    bench
        .answer(Generation(2), AppliedStatus::Applied)
        .await
        .unwrap();
    // It was on its way for long.
    bench
        .answer(Generation(1), AppliedStatus::Failed)
        .await
        .unwrap();
    assert!(is_confirmation_of(
        &bench.send_outbox().await,
        Generation(2)
    ));
    assert_eq!(bench.state(), Some(DeploymentState::Verifying));
}

#[tokio::test]
async fn a_robot_gets_a_word_of_now_however_long_it_was_away() {
    let policy = Policy {
        offer_valid_s: 3_600,
        ..Policy::default()
    };
    let bench = Bench::open(policy).await;
    bench.approve(0.02, None).await;
    bench.drive_in_verification().await;
    bench.verify(true).await;
    let trusted = TrustedKeys::new(vec![bench.lifecycle.public_key()]).unwrap();
    for weeks in [0, 10] {
        bench.clock.advance(weeks * 7 * 24 * HOUR);
        let question = Question::from_bytes([weeks as u8; 16]);
        let asked = bench
            .lifecycle
            .approved(&robot(), Some(question.clone()))
            .await;
        let offered = asked.unwrap().unwrap();
        let offer = offered.open_offer(&trusted).unwrap();
        assert_eq!((&offer.robot, offer.generation), (&robot(), Generation(1)));
        assert_eq!(offer.sha256, offered.envelope.sha256);
        assert_eq!(offer.question, Some(question));
        assert_eq!(offer.offered_at_ns, bench.clock.now());
        assert_eq!(
            offer.valid_until_ns.ns_since(offer.offered_at_ns),
            3_600_000_000_000
        );
    }
}

/// Case of two computers with an agent of one robot: one refuses, the other one has applied.
#[tokio::test]
async fn a_confirmation_says_which_answer_is_stored() {
    let bench = Bench::open(Policy::default()).await;
    bench.approve(0.02, None).await;
    let generation = bench.asked().await.unwrap().generation;
    bench.send_outbox().await;
    let trusted = TrustedKeys::new(vec![bench.lifecycle.public_key()]).unwrap();
    let stored = |bench: &Bench| {
        let confirmed = bench.lifecycle.confirmed(&robot());
        confirmed.map(|one| one.open(&trusted).unwrap())
    };
    bench
        .answer(generation, AppliedStatus::Refused)
        .await
        .unwrap();
    let document = stored(&bench).unwrap();
    assert_eq!(document.status, AppliedStatus::Refused);
    assert_eq!(document.applied_at_ns, RobotTime(bench.clock.now().0));
    bench.clock.advance(Duration::from_secs(1));
    bench
        .answer(generation, AppliedStatus::Applied)
        .await
        .unwrap();
    // It was refused, so nobody wants it: the other computer goes back by itself.
    assert_eq!(stored(&bench), None);
    let shadow = bench.lifecycle.ledger(&robot()).shadow.clone();
    assert_eq!(shadow.sync(), SyncState::Unwanted);
    assert!(shadow.contradicted.is_some());
    bench
        .answer(generation, AppliedStatus::Reverted)
        .await
        .unwrap();
    let shadow = bench.lifecycle.ledger(&robot()).shadow.clone();
    assert_eq!(shadow.sync(), SyncState::InSync);
}

#[tokio::test]
async fn a_robot_that_does_not_drive_is_inconclusive_after_a_day() {
    let bench = Bench::open(Policy::default()).await;
    bench.approve(0.02, None).await;
    bench.drive_in_verification().await;
    bench.clock.advance(Duration::from_secs(24 * 3600 - 1));
    bench.look().await;
    assert_eq!(bench.state(), Some(DeploymentState::Verifying));
    bench.clock.advance(Duration::from_secs(1));
    bench.look().await;
    let ended = bench.latest().await;
    assert_eq!(ended.state, DeploymentState::Inconclusive);
    assert!(ended.reason.unwrap().contains("not moved enough"));
    // It keeps what it has.
    let ledger = bench.lifecycle.ledger(&robot());
    assert!(ledger.shadow.in_sync());
    assert_eq!(ledger.shadow.verified, []);
}

#[tokio::test]
async fn an_answer_about_what_was_never_given_out_is_refused() {
    let bench = Bench::open(Policy::default()).await;
    bench.approve(0.02, None).await;
    let refused = bench
        .answer(Generation(1_002), AppliedStatus::Applied)
        .await;
    assert_eq!(
        refused.unwrap_err(),
        Refused::NeverOffered {
            generation: Generation(1_002),
            most: Generation(1_001)
        }
    );
    bench.send_outbox().await;
    let applied = Applied {
        generation: Generation(1),
        sha256: "ab".repeat(32),
        status: AppliedStatus::Applied,
        reason: None,
        applied_at_ns: RobotTime(0),
        values: None,
    };
    let actor = Actor::robot(&robot());
    let other = bench.lifecycle.acknowledge(&robot(), applied, actor).await;
    assert!(matches!(
        other,
        Err(StoreError::Refused(Refused::OtherDocument { .. }))
    ));
    assert_eq!(bench.lifecycle.answer_counters()[1], ("answer_refused", 2));
}

#[tokio::test]
async fn what_is_approved_after_an_older_database_came_back_is_newer_than_what_the_robot_has() {
    let bench = Bench::open(Policy::default()).await;
    bench
        .answer(Generation(7), AppliedStatus::Applied)
        .await
        .unwrap();
    assert!(
        bench.send_outbox().await.is_empty(),
        "nobody here has approved it"
    );
    bench.approve(0.02, None).await;
    assert_eq!(bench.asked().await.unwrap().generation, Generation(8));
}

#[tokio::test]
async fn what_no_robot_can_drive_with_is_not_believed() {
    let bench = Bench::open(Policy::default()).await;
    bench.approve(0.02, None).await;
    let sha256 = match bench.send_outbox().await.as_slice() {
        [OutboxMessage::Approved(offered)] => offered.envelope.sha256.clone(),
        other => panic!("{other:?}"),
    };
    let applied = Applied {
        generation: Generation(1),
        sha256,
        status: AppliedStatus::Applied,
        reason: None,
        applied_at_ns: RobotTime(0),
        values: Some(values(1e300)),
    };
    let actor = Actor::robot(&robot());
    let refused = bench.lifecycle.acknowledge(&robot(), applied, actor).await;
    let refused = refused.unwrap_err().to_string();
    assert!(refused.contains("steering_offset_rad"), "{refused}");
    assert_eq!(bench.used(), None);
}
