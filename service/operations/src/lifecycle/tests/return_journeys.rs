//! Returns to the calibration in use before, from every state.

use fleetcal_domain::approval::{DeploymentAction, Transition};
use fleetcal_domain::audit::Action;
use fleetcal_model::Generation;

use super::*;

/// Bench whose robot has a deployment in `state`, and could return to its drawing.
async fn office_in(state: DeploymentState) -> Bench {
    let bench = Bench::open(Policy::default()).await;
    bench.approve(0.02, Some(values(0.0))).await;
    if state == DeploymentState::Queued {
        return bench;
    }
    bench.send_outbox().await;
    if state == DeploymentState::Applied || state == DeploymentState::Verifying {
        bench
            .answer(Generation(1), AppliedStatus::Applied)
            .await
            .unwrap();
    }
    if state == DeploymentState::Verifying {
        bench.send_outbox().await;
    }
    if state == DeploymentState::RollingBack {
        bench.roll_back().await.unwrap();
    }
    assert_eq!(bench.state(), Some(state));
    bench
}

#[tokio::test]
async fn from_every_state_under_way_there_is_a_way_back() {
    use DeploymentState as S;
    for state in [S::Offered, S::Applied, S::Verifying, S::RollingBack] {
        let bench = office_in(state).await;
        let last = bench.lifecycle.ledger(&robot()).shadow.generation_last;
        bench.roll_back().await.unwrap();
        assert_eq!(bench.state(), Some(S::RollingBack), "{state:?}");
        let bench = bench.restart().await;
        let document = bench.asked().await.unwrap();
        assert_eq!(
            (document.generation, document.values),
            (last.next(), values(0.0))
        );
        bench.applies(last.next()).await;
        let ended = bench.latest().await;
        assert_eq!(ended.state, S::RolledBack, "{state:?}");
        assert_eq!(bench.used(), Some(last.next()));
        // The same is not proposed again by the service itself.
        let declined = bench.lifecycle.ledger(&robot()).shadow.declined;
        assert_eq!(declined, ended.earlier.first().map(|one| one.revision));
    }
}

#[tokio::test]
async fn what_nobody_has_seen_is_withdrawn() {
    let bench = office_in(DeploymentState::Queued).await;
    bench.roll_back().await.unwrap();
    assert_eq!(bench.latest().await.state, DeploymentState::Withdrawn);
    assert_eq!(bench.asked().await, None);
    assert_eq!(bench.send_outbox().await, []);
    assert_eq!(bench.lifecycle.outbox().await.unwrap(), []);
}

#[tokio::test]
async fn who_withdrew_what_nobody_has_seen_stays_with_it() {
    let bench = office_in(DeploymentState::Queued).await;
    bench.roll_back().await.unwrap();
    let asked = bench.latest().await.roll_back.expect("who rolled it back");
    assert_eq!(
        (asked.by.as_str(), asked.reason.as_str()),
        ("ana", "it weaves")
    );
    assert!(!asked.automatic);
    let events = bench.events().await;
    let event = &events.first().unwrap().event;
    assert_eq!(event.kind, EventKind::RolledBack, "nothing is on its way");
    assert_eq!(event.author.as_deref(), Some("ana"));
    assert_eq!(event.note.as_deref(), Some("it weaves"));
}

#[tokio::test]
async fn a_verification_that_fails_rolls_back() {
    let bench = office_in(DeploymentState::Verifying).await;
    let outcome = bench.verify(false).await;
    let actions: Vec<_> = outcome.transitions.iter().map(Transition::action).collect();
    assert_eq!(
        actions.first(),
        Some(&Action::Deployment(DeploymentAction::FailVerification))
    );
    assert_eq!(
        actions.last(),
        Some(&Action::Deployment(DeploymentAction::RollBack))
    );
    assert_eq!(bench.state(), Some(DeploymentState::RollingBack));
}

#[tokio::test]
async fn a_verification_that_fails_waits_for_a_person_where_the_policy_says_so() {
    let policy = Policy {
        roll_back: false,
        ..Policy::default()
    };
    let bench = Bench::open(policy).await;
    bench.approve(0.02, Some(values(0.0))).await;
    bench.drive_in_verification().await;
    bench.verify(false).await;
    assert_eq!(bench.state(), Some(DeploymentState::Verifying));
    bench.roll_back().await.unwrap();
    assert_eq!(bench.state(), Some(DeploymentState::RollingBack));
}

#[tokio::test]
async fn where_nobody_knows_the_former_values_there_is_no_way_back() {
    let bench = Bench::open(Policy::default()).await;
    assert_eq!(
        bench.roll_back().await.unwrap_err(),
        Refused::NothingToReturnTo
    );
    bench.approve(0.02, None).await;
    bench.drive_in_verification().await;
    assert_eq!(
        bench.roll_back().await.unwrap_err(),
        Refused::NothingToReturnTo
    );
    // Nor does a failed verification find one; somebody has to decide.
    bench.verify(false).await;
    assert_eq!(bench.state(), Some(DeploymentState::Verifying));
    bench.verify(true).await;
    assert_eq!(
        bench.roll_back().await.unwrap_err(),
        Refused::NothingEarlier
    );
}

#[tokio::test]
async fn with_nothing_under_way_it_goes_back_to_what_was_verified() {
    let bench = Bench::open(Policy::default()).await;
    for offset_rad in [0.02, 0.05] {
        bench.approve(offset_rad, None).await;
        bench.drive_in_verification().await;
        bench.verify(true).await;
    }
    bench.roll_back().await.unwrap();
    assert_eq!(bench.state(), Some(DeploymentState::Queued));
    let document = bench.asked().await.unwrap();
    assert_eq!(
        (document.generation, document.values),
        (Generation(3), values(0.02))
    );
    assert_eq!(document.approved_by, "ana");
    assert_eq!(bench.latest().await.reason.as_deref(), Some("it weaves"));
}

/// Bench whose robot a person rolled back from a verified calibration to the one before, and which
/// drives with that.
async fn office_rolled_back_by_a_person(policy: Policy) -> Bench {
    let bench = Bench::open(policy).await;
    for offset_rad in [0.02, 0.05] {
        bench.approve(offset_rad, None).await;
        bench.drive_in_verification().await;
        bench.verify(true).await;
    }
    bench.roll_back().await.unwrap();
    assert_eq!(bench.drive_in_verification().await, Generation(3));
    bench
}

#[tokio::test]
async fn what_a_person_rolled_back_to_is_never_rolled_back_by_the_service() {
    let bench = office_rolled_back_by_a_person(Policy::default()).await;
    let outcome = bench.verify(false).await;
    assert_eq!(outcome.envelopes, [], "nothing is sent to the robot");
    assert_eq!(bench.state(), None);
    assert_eq!(bench.used(), Some(Generation(3)));
    let bench = bench.restart().await;
    let kept = bench.latest().await;
    assert_eq!(kept.state, DeploymentState::Kept);
    let asked = kept.roll_back.unwrap();
    assert_eq!((asked.by.as_str(), asked.automatic), ("ana", false));
    assert_eq!(
        (asked.reason.as_str(), asked.values),
        ("it weaves", values(0.02))
    );
    // The reason for the present state does not replace the person's.
    assert!(kept.reason.unwrap().contains("values that ana chose"));
    bench.clock.advance(48 * HOUR);
    bench.look().await;
    assert_eq!(bench.asked().await.unwrap().generation, Generation(3));
}

#[tokio::test]
async fn the_history_and_the_audit_name_who_rolled_back_why_and_to_what() {
    let bench = office_rolled_back_by_a_person(Policy::default()).await;
    bench.verify(false).await;
    let filter = fleetcal_store::AuditFilter {
        action: Some("deployment.create".to_owned()),
        limit: 10,
        ..Default::default()
    };
    let row = bench.store.audit(&filter).await.unwrap().remove(0);
    assert_eq!(
        (row.actor.as_str(), row.reason.as_deref()),
        ("ana", Some("it weaves"))
    );
    let record = row.after.unwrap();
    assert_eq!(record["roll_back"]["values"]["steering_offset_rad"], 0.02);
    let events = bench.events().await;
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
    let bench = office_rolled_back_by_a_person(policy).await;
    bench.verify(false).await;
    bench.propose(0.035, None).await;
    let refused = bench.take(bench.approval(), Actor::service()).await;
    assert!(matches!(
        refused,
        Err(Refused::ChosenByPerson {
            generation: Generation(3),
            ..
        })
    ));
    bench.look().await;
    assert_eq!(bench.state(), None, "no automatic approval");
    bench.take(bench.approval(), person("bruno")).await.unwrap();
    assert_eq!(bench.state(), Some(DeploymentState::Queued));
}

#[tokio::test]
async fn nothing_is_approved_by_itself_while_a_robots_answers_contradict_each_other() {
    let within = Tolerance {
        steering_offset_deg: 5.0,
        lidar_yaw_deg: 5.0,
        lidar_position_mm: 100.0,
    };
    let policy = Policy {
        approve_within: Some(within),
        ..Policy::default()
    };
    let bench = Bench::open(policy).await;
    bench.approve(0.02, Some(values(0.0))).await;
    let forged = bench.drive_in_verification().await;
    bench.verify(true).await;
    // What the robot was said to have applied it says that it refused.
    bench.answer(forged, AppliedStatus::Refused).await.unwrap();
    let told = |bench: &Bench| bench.lifecycle.ledger(&robot()).shadow.contradicted.clone();
    assert!(told(&bench).is_some());
    let bench = bench.restart().await;
    bench.propose(0.03, None).await;
    let refused = bench.take(bench.approval(), Actor::service()).await;
    assert!(
        matches!(refused, Err(Refused::AnswersContradict { said, .. }) if said == forged),
        "{refused:?}"
    );
    bench.look().await;
    assert_eq!(bench.state(), None, "no automatic approval");
    // Once a person has decided, small steps go on by themselves.
    bench.take(bench.approval(), person("bruno")).await.unwrap();
    assert_eq!(told(&bench), None);
    bench.drive_in_verification().await;
    bench.verify(true).await;
    bench.propose(0.04, None).await;
    bench.look().await;
    assert_eq!(bench.state(), Some(DeploymentState::Queued));
}

#[tokio::test]
async fn a_robot_that_was_away_still_goes_back_to_what_a_person_chose() {
    let bench = Bench::open(Policy::default()).await;
    for offset_rad in [0.02, 0.05] {
        bench.approve(offset_rad, None).await;
        bench.drive_in_verification().await;
        bench.verify(true).await;
    }
    bench.roll_back().await.unwrap();
    bench.send_outbox().await;
    bench.clock.advance(24 * HOUR);
    bench.look().await;
    assert_eq!(bench.latest().await.state, DeploymentState::TimedOut);
    let bench = bench.restart().await;
    assert_eq!(bench.asked().await.unwrap().generation, Generation(3));
    bench.applies(Generation(3)).await;
    assert_eq!(bench.used(), Some(Generation(3)));
}

#[tokio::test]
async fn a_failed_deployment_returns_to_what_a_person_chose_as_that_persons_choice() {
    let bench = office_rolled_back_by_a_person(Policy::default()).await;
    bench.verify(false).await;
    bench.propose(0.035, None).await;
    let approval = bench.approval();
    bench.take(approval, person("bruno")).await.unwrap();
    bench.drive_in_verification().await;
    bench.verify(false).await;
    assert_eq!(bench.state(), Some(DeploymentState::RollingBack));
    let desired = bench
        .lifecycle
        .ledger(&robot())
        .shadow
        .desired
        .clone()
        .unwrap();
    assert_eq!(
        (desired.generation, desired.chosen_by.as_deref()),
        (Generation(5), Some("ana"))
    );
}

#[tokio::test]
async fn going_back_twice_does_not_return_to_what_was_left() {
    use DeploymentState::{RolledBack, RollingBack, Verified};
    let bench = Bench::open(Policy::default()).await;
    for offset_rad in [0.02, 0.05, 0.08] {
        bench.approve(offset_rad, None).await;
        bench.drive_in_verification().await;
        bench.verify(true).await;
    }
    for (offset_rad, under_way, after) in [
        (
            0.05,
            [Verified, Verified, RollingBack],
            [Verified, Verified, RolledBack],
        ),
        (
            0.02,
            [Verified, RollingBack, RolledBack],
            [Verified, RolledBack, RolledBack],
        ),
    ] {
        bench.roll_back().await.unwrap();
        assert_eq!(bench.asked().await.unwrap().values, values(offset_rad));
        assert_eq!(bench.followed().await, under_way);
        bench.drive_in_verification().await;
        bench.verify(true).await;
        assert_eq!(bench.followed().await, after);
    }
    assert_eq!(
        bench.roll_back().await.unwrap_err(),
        Refused::NothingEarlier
    );
}

#[tokio::test]
async fn what_failed_and_nobody_decided_upon_says_so() {
    let bench = Bench::open(Policy::default()).await;
    bench.approve(0.02, None).await;
    bench.drive_in_verification().await;
    bench.verify(false).await;
    bench.clock.advance(24 * HOUR);
    bench.look().await;
    let ended = bench.latest().await;
    assert_eq!(ended.state, DeploymentState::Inconclusive);
    assert!(ended.reason.unwrap().contains("nobody decided"));
}

#[tokio::test]
async fn a_robot_that_does_not_take_its_former_values_is_reported() {
    let bench = office_in(DeploymentState::Verifying).await;
    bench.roll_back().await.unwrap();
    bench.send_outbox().await;
    bench.clock.advance(24 * HOUR);
    bench.look().await;
    assert_eq!(bench.latest().await.state, DeploymentState::RollbackFailed);
    // It still gets them when it comes back, and is told to keep them.
    assert_eq!(bench.asked().await.unwrap().generation, Generation(2));
    bench.applies(Generation(2)).await;
    assert_eq!(bench.used(), Some(Generation(2)));
}
