//! Tests of the checker: it passes what is in order, and finds each thing that is not.

use super::*;

fn owned(owner: Option<&str>, epoch: i64, committed_us: i64) -> Owned {
    Owned {
        robot: "r".to_owned(),
        owner: owner.map(str::to_owned),
        epoch,
        committed_us,
    }
}

fn written(by: &str, committed_us: i64) -> Written {
    Written {
        robot: "r".to_owned(),
        table: "checkpoint".to_owned(),
        by: by.to_owned(),
        committed_us,
    }
}

fn estimated(by: &str, epoch: i64) -> Estimated {
    Estimated {
        robot: "r".to_owned(),
        by: by.to_owned(),
        epoch,
    }
}

fn offered(generation: u64, sha256: &str) -> Offered {
    Offered {
        robot: "r".to_owned(),
        generation,
        sha256: sha256.to_owned(),
    }
}

fn audited(id: i64, action: &str, subject: &str, reason: &str) -> Audited {
    Audited {
        id,
        action: action.to_owned(),
        subject: subject.to_owned(),
        reason: reason.to_owned(),
    }
}

fn decision(reason: &str, outcome: Outcome) -> Decision {
    Decision {
        reason: reason.to_owned(),
        outcome,
    }
}

/// Makes a takeover without violations: one decision after another, one late estimate.
fn in_order() -> Evidence {
    Evidence {
        decisions: vec![
            decision("first", Outcome::Acknowledged),
            decision("second", Outcome::Refused),
            decision("third", Outcome::Unknown),
        ],
        audit: vec![
            audited(1, "proposal.create", "proposal 1", "first"),
            audited(2, "proposal.approve", "proposal 1", "third"),
        ],
        owners: vec![
            owned(Some("a"), 1, 10),
            owned(None, 1, 20),
            owned(Some("b"), 2, 30),
        ],
        written: vec![written("a", 11), written("a", 20), written("b", 31)],
        estimates: vec![
            estimated("a", 1),
            estimated("b", 2),
            estimated("a", 1),
            estimated("b", 2),
        ],
        documents: vec![offered(1, "x"), offered(1, "x"), offered(2, "y")],
    }
}

/// Returns the violations after a change of correct evidence.
fn found(change: impl FnOnce(&mut Evidence)) -> Vec<Violation> {
    let mut evidence = in_order();
    change(&mut evidence);
    evidence.violations()
}

#[test]
fn what_is_in_order_passes() {
    assert_eq!(in_order().violations(), []);
    assert_eq!(in_order().stale_estimates().into_values().sum::<usize>(), 1);
}

#[test]
fn a_lost_repeated_or_wrongly_taken_decision_is_found() {
    let reason = "first".to_owned();
    let lost = found(|seen| seen.audit[0].reason = "another".to_owned());
    assert_eq!(lost, [Violation::Lost { reason }]);
    let reason = "first".to_owned();
    let twice = found(|seen| {
        let row = audited(3, "proposal.create", "proposal 2", "first");
        seen.audit.push(row);
    });
    assert_eq!(twice, [Violation::Repeated { reason, times: 2 }]);
    let reason = "second".to_owned();
    let taken = found(|seen| seen.audit[0].reason = "second".to_owned());
    assert!(taken.contains(&Violation::TakenThoughRefused { reason }));
    let gap = found(|seen| seen.audit[1].id = 4);
    assert_eq!(gap, [Violation::AuditGap { before: 4 }]);
}

#[test]
fn two_approvals_of_one_proposal_are_found() {
    let subject = "proposal 1".to_owned();
    let twice = found(|seen| {
        let row = audited(3, "proposal.approve", "proposal 1", "fourth");
        seen.audit.push(row);
    });
    assert_eq!(twice, [Violation::DecidedTwice { subject }]);
}

#[test]
fn a_row_of_an_owner_that_was_replaced_is_found() {
    for (at, owner) in [(21, None), (31, Some("b"))] {
        let late = found(|seen| seen.written.push(written("a", at)));
        let [Violation::StaleRow { by, owner: had, .. }] = late.as_slice() else {
            panic!("{late:?}");
        };
        assert_eq!((by.as_str(), had.as_deref()), ("a", owner));
    }
    // And one before anybody had the robot.
    assert_eq!(found(|seen| seen.written.push(written("a", 9))).len(), 1);
}

#[test]
fn a_second_late_estimate_and_a_shared_epoch_are_found() {
    let late = found(|seen| seen.estimates.push(estimated("a", 1)));
    assert!(matches!(
        late.as_slice(),
        [Violation::StaleEstimates { count: 2, .. }]
    ));
    let shared = found(|seen| seen.estimates.push(estimated("a", 2)));
    let robot = "r".to_owned();
    assert_eq!(shared, [Violation::EpochShared { robot, epoch: 2 }]);
    let same = found(|seen| seen.owners.push(owned(Some("a"), 2, 40)));
    assert!(matches!(
        same.as_slice(),
        [Violation::EpochNotRaised { .. }]
    ));
}

#[test]
fn an_old_document_and_a_shared_generation_are_found() {
    let old = found(|seen| seen.documents.push(offered(1, "x")));
    assert!(matches!(
        old.as_slice(),
        [Violation::StaleDocument { generation: 1, .. }]
    ));
    let shared = found(|seen| seen.documents.push(offered(2, "z")));
    assert!(matches!(
        shared.as_slice(),
        [Violation::GenerationShared { .. }]
    ));
}
