//! Retirement of a robot, and its return.

use super::bench::*;
use crate::approval::{Command, ProposalState, Refused};

fn retire() -> Command {
    Command::Retire {
        reason: "sold".to_owned(),
    }
}

fn bring_back() -> Command {
    Command::BringBack {
        reason: "bought back".to_owned(),
    }
}

#[test]
fn a_retired_robot_only_comes_back() {
    let mut bench = Bench::new();
    let bo = person("bo");
    assert_eq!(bench.try_to(bring_back(), &bo), Err(Refused::NotRetired));
    bench.take(retire(), &bo);
    let retired = bench.ledger.shadow.retired.clone().unwrap();
    assert_eq!((&*retired.by, &*retired.reason), ("bo", "sold"));
    let refused = Err(Refused::Retired {
        by: "bo".to_owned(),
    });
    assert_eq!(bench.try_to(retire(), &bo), refused);
    let maintain = Command::Maintain {
        until_ns: Some(bench.now.plus(std::time::Duration::from_mins(1))),
        reason: "x".to_owned(),
    };
    assert_eq!(bench.try_to(maintain.clone(), &bo), refused);
    bench.take(bring_back(), &bo);
    assert_eq!(bench.ledger.shadow.retired, None);
    bench.take(maintain, &bo);
}

#[test]
fn a_robot_that_sends_is_at_work() {
    let mut bench = Bench::new();
    bench.is_sending = true;
    let bo = person("bo");
    assert_eq!(bench.try_to(retire(), &bo), Err(Refused::StillSends));
}

#[test]
fn its_open_proposal_is_withdrawn_and_a_deployment_has_to_end_first() {
    let mut bench = Bench::new();
    let bo = person("bo");
    assert_eq!(bench.do_due(&estimate(0.01, 0), false), Some("propose"));
    let open = bench.ledger.open.clone().unwrap();
    assert_eq!(open.state, ProposalState::Proposed);
    bench.take(retire(), &bo);
    assert_eq!(bench.ledger.open, None);
    bench.take(bring_back(), &bo);
    assert_eq!(bench.do_due(&estimate(0.02, 60), false), Some("propose"));
    bench.approve();
    let refused = bench.try_to(retire(), &bo);
    assert!(
        matches!(refused, Err(Refused::UnderwayAtRetirement { .. })),
        "{refused:?}"
    );
}
