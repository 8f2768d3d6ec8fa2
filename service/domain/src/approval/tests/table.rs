//! Every state against every event.

use std::collections::BTreeSet;

use fleetcal_model::{DeploymentId, Generation, ProposalId, RevisionId};
use fleetcal_proto::RobotId;

use crate::alert::tests::{deployment, in_use};
use crate::approval::{
    Deployment, DeploymentEvent, DeploymentState, InUse, ProposalEvent, ProposalState, Refused,
};

/// States of a proposal after each event; `-` where it is refused.
const PROPOSAL: &str = "
             ApproveInPart  Approve   Reject    Expire   Withdraw   Supersede   Refresh
proposed     proposed       approved  rejected  expired  withdrawn  superseded  proposed
approved     -              -         -         -        -          -           -
rejected     -              -         -         -        -          -           -
expired      -              -         -         -        -          -           -
withdrawn    -              -         -         -        -          -           -
superseded   -              -         -         -        -          -           -
";

/// States of a deployment after each event; `-` where it is refused.
const DEPLOYMENT: &str = "
                 Offer    Applied      Refused          Failed           Reverted
queued           offered  -            -                -                -
offered          -        applied      refused          failed           failed
applied          -        -            -                failed           failed
verifying        -        -            -                failed           failed
verified         -        -            -                -                -
inconclusive     -        -            -                -                -
refused          -        -            -                -                -
failed           -        -            -                -                -
timed_out        -        -            -                -                -
withdrawn        -        -            -                -                -
rolling_back     -        rolled_back  rollback_failed  rollback_failed  rollback_failed
rolled_back      -        -            -                -                -
rollback_failed  -        -            -                -                -
kept             -        -            -                -                -

                 Confirmed  Verified  VerificationFailed  Contradicted  TooLittleMotion
queued           -          -         -                   -             -
offered          -          -         -                   -             -
applied          verifying  -         -                   -             -
verifying        -          verified  verifying           kept          inconclusive
verified         -          -         -                   -             -
inconclusive     -          -         -                   -             -
refused          -          -         -                   -             -
failed           -          -         -                   -             -
timed_out        -          -         -                   -             -
withdrawn        -          -         -                   -             -
rolling_back     -          -         -                   -             -
rolled_back      -          -         -                   -             -
rollback_failed  -          -         -                   -             -
kept             -          -         -                   -             -

                 TimeOut          RollBack      Withdraw
queued           timed_out        -             withdrawn
offered          timed_out        rolling_back  withdrawn
applied          -                rolling_back  -
verifying        -                rolling_back  -
verified         -                -             -
inconclusive     -                -             -
refused          -                -             -
failed           -                -             -
timed_out        -                -             -
withdrawn        -                -             -
rolling_back     rollback_failed  rolling_back  -
rolled_back      -                -             -
rollback_failed  -                -             -
kept             -                -             -
";

/// Cells of a table: state, event, and the state after it.
fn cells(text: &'static str) -> Vec<(&'static str, &'static str, &'static str)> {
    let mut cells = Vec::new();
    for block in text.split("\n\n") {
        let mut lines = block.lines().filter(|line| !line.trim().is_empty());
        let events: Vec<_> = lines.next().unwrap().split_whitespace().collect();
        for line in lines {
            let words: Vec<_> = line.split_whitespace().collect();
            assert_eq!(words.len(), events.len() + 1, "{line}");
            let states = words[1..].iter().zip(&events);
            cells.extend(states.map(|(after, event)| (words[0], *event, *after)));
        }
    }
    let pairs: BTreeSet<_> = cells
        .iter()
        .map(|(state, event, _)| (state, event))
        .collect();
    assert_eq!(pairs.len(), cells.len(), "a pair stands twice in the table");
    cells
}

#[test]
fn every_event_does_to_a_proposal_what_the_table_says() {
    const EVENTS: [ProposalEvent; 7] = [
        ProposalEvent::ApproveInPart,
        ProposalEvent::Approve,
        ProposalEvent::Reject,
        ProposalEvent::Expire,
        ProposalEvent::Withdraw,
        ProposalEvent::Supersede,
        ProposalEvent::Refresh,
    ];
    let cells = cells(PROPOSAL);
    assert_eq!(cells.len(), ProposalState::ALL.len() * EVENTS.len());
    for (name, event_name, expected) in cells {
        let state = ProposalState::parse(name).unwrap();
        let event = EVENTS
            .into_iter()
            .find(|event| format!("{event:?}") == event_name)
            .unwrap();
        match state.after(event) {
            Ok(after) => assert_eq!(after.as_str(), expected, "{name} {event_name}"),
            Err(refused) => {
                assert_eq!(expected, "-", "{name} {event_name}");
                assert_eq!(refused, Refused::ProposalClosed { state });
            }
        }
    }
}

#[test]
fn every_event_does_to_a_deployment_what_the_table_says() {
    let cells = cells(DEPLOYMENT);
    let all = DeploymentState::ALL.len() * DeploymentEvent::ALL.len();
    assert_eq!(cells.len(), all);
    for (name, event_name, expected) in cells {
        let state = DeploymentState::parse(name).unwrap();
        let event = DeploymentEvent::ALL
            .into_iter()
            .find(|event| format!("{event:?}") == event_name)
            .unwrap();
        match state.after(event) {
            Ok(after) => assert_eq!(after.as_str(), expected, "{name} {event_name}"),
            Err(refused) => {
                assert_eq!(expected, "-", "{name} {event_name}");
                assert_eq!(refused, Refused::Deployment { state, event });
            }
        }
    }
}

#[test]
fn exactly_the_states_that_can_change_are_live() {
    for state in DeploymentState::ALL {
        let can_change = DeploymentEvent::ALL
            .into_iter()
            .any(|event| state.after(event).is_ok());
        assert_eq!(state.is_live(), can_change, "{state:?}");
    }
}

#[test]
fn what_a_person_goes_back_from_is_rolled_back_whatever_it_had_proven() {
    use DeploymentState as S;
    let approved = deployment(S::Verified);
    let from = |id, revision, state| Deployment {
        id: DeploymentId(id),
        proposal: None,
        base: Some(InUse {
            revision: Some(RevisionId(revision)),
            ..in_use(Generation(2), 0.0)
        }),
        ..deployment(state)
    };
    assert_eq!(approved.state_after(&[]), S::Verified);
    for state in S::ALL {
        let expected = match state {
            S::Queued | S::Offered | S::TimedOut => S::RollingBack,
            S::Applied | S::Verifying | S::Verified | S::Inconclusive | S::Kept => S::RolledBack,
            _ => S::Verified,
        };
        assert_eq!(
            approved.state_after(&[from(6, 1, state)]),
            expected,
            "{state:?}"
        );
    }
    // From other values, before it, to another robot, or by an approval: nothing of it is undone.
    let mut elsewhere = from(6, 1, S::Verified);
    elsewhere.robot = RobotId::parse("tugger_02").unwrap();
    let mut newer = from(6, 1, S::Verified);
    newer.proposal = Some(ProposalId(9));
    let others = [
        from(6, 2, S::Verified),
        from(4, 1, S::Verified),
        elsewhere,
        newer,
    ];
    assert_eq!(approved.state_after(&others), S::Verified);
    // The last one counts, and what never was in use is not taken back.
    let both = [from(7, 1, S::Verified), from(6, 1, S::Refused)];
    assert_eq!(approved.state_after(&both), S::RolledBack);
    let refused = deployment(S::Refused);
    assert_eq!(refused.state_after(&both), S::Refused);
}
