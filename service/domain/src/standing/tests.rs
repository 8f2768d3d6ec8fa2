//! Every state, deployment and alert by itself, and the most urgent of several.

use std::sync::Arc;

use fleetcal_model::{AlertId, Generation, ProposalId, RevisionId, Version, WallTime};

use super::*;
use crate::alert::tests::{deployment, estimate, in_use, robot, view};
use crate::alert::{Condition, Subject};
use crate::approval::{Policy, Proposal, ProposalState, Verification};

/// Robot and the facts about it.
struct Case {
    view: RobotView,
    ledger: RobotLedger,
    alerts: RobotAlerts,
}

fn case(state: RobotState) -> Case {
    Case {
        view: RobotView { state, ..view() },
        ledger: RobotLedger::new(robot()),
        alerts: RobotAlerts::default(),
    }
}

fn proposal() -> Proposal {
    Proposal {
        id: ProposalId(3),
        robot: robot(),
        version: Version(1),
        state: ProposalState::Proposed,
        revision: RevisionId(1),
        revision_sha256: "00".to_owned(),
        proposed_by: "fleetcal".to_owned(),
        reason: None,
        created_ns: WallTime(0),
        expires_ns: WallTime(0),
        base: None,
        base_generation: None,
        drawn_by: None,
        approvals_needed: 1,
        second_approver: None,
        approvals: Vec::new(),
        closing: None,
        refreshed: None,
    }
}

impl Case {
    fn alerting(mut self, kind: AlertKind) -> Self {
        self.alerts.set(kind, ConditionName::Alerting);
        self
    }

    fn stale(mut self, kind: AlertKind) -> Self {
        self.alerts.set(kind, ConditionName::NoData);
        self
    }

    fn proposed(mut self) -> Self {
        self.ledger.open = Some(proposal());
        self
    }

    fn deployed(mut self, state: DeploymentState) -> Self {
        self.ledger.live = Some(deployment(state));
        self
    }

    /// Sets the generation in use and its steering offset; the estimate is 0.
    fn using(mut self, generation: Generation, steering_offset_rad: f64) -> Self {
        self.ledger.shadow.in_use = Some(in_use(generation, steering_offset_rad));
        self
    }

    fn stands(&self) -> Standing {
        let tolerance = Policy::default().propose_beyond;
        StandingBasis::of(&self.view, &self.ledger, &tolerance).with(&self.alerts)
    }
}

#[test]
fn it_is_the_worst_of_what_is_so() {
    use RobotState as R;
    use Standing as S;
    let of = |case: Case| case.stands();
    assert_eq!(of(case(R::Calibrated)), S::Calibrated);
    assert_eq!(of(case(R::Unregistered)), S::Unregistered);
    assert_eq!(of(case(R::Failed)), S::EstimatorFailed);
    assert_eq!(of(case(R::Changed)), S::Drift);
    assert_eq!(of(case(R::Calibrated).proposed()), S::AwaitingApproval);
    let drifted = case(R::Calibrated).proposed().using(Generation(1), 0.0);
    assert_eq!(of(drifted.alerting(AlertKind::Drift)), S::Drift);
    assert_eq!(of(case(R::NoData)), S::NoData);
    assert_eq!(of(case(R::NoData).proposed()), S::AwaitingApproval);
    let verifying = case(R::Learning).deployed(DeploymentState::Verifying);
    assert_eq!(of(verifying), S::Deploying);
    let verified = case(R::Learning).deployed(DeploymentState::Verified);
    assert_eq!(of(verified), S::Learning);
    let failed = case(R::Calibrated).deployed(DeploymentState::RollbackFailed);
    assert_eq!(of(failed.alerting(AlertKind::Drift)), S::RollbackFailed);
}

#[test]
fn a_verdict_against_the_values_in_use_is_a_failed_verification() {
    let mut case = case(RobotState::Calibrated).deployed(DeploymentState::Verifying);
    for (within, stands) in [
        (true, Standing::Deploying),
        (false, Standing::VerificationFailed),
    ] {
        let verdict = Verification {
            at_ns: WallTime(1),
            distance_m: 61.0,
            residual: [0.02, 0.0, 0.0, 0.0],
            sigma: [0.001; 4],
            within,
            limits: None,
            evidence: None,
        };
        case.ledger.live.as_mut().unwrap().verification = Some(verdict);
        assert_eq!(case.stands(), stands);
    }
}

#[test]
fn nothing_has_drifted_as_long_as_nothing_was_applied() {
    use RobotState as R;
    let uncalibrated = |case: Case| case.alerting(AlertKind::Uncalibrated).stands();
    let factory = case(R::Calibrated).using(Generation(0), 0.0);
    assert_eq!(uncalibrated(factory), Standing::Uncalibrated);
    let proposed = case(R::Calibrated).proposed();
    assert_eq!(uncalibrated(proposed), Standing::AwaitingApproval);
    // The estimator has seen it move: that it did.
    assert_eq!(uncalibrated(case(R::Changed)), Standing::Drift);
}

#[test]
fn nothing_stands_well_beside_a_value_that_is_off() {
    let of = |state, offset_rad| case(state).using(Generation(1), offset_rad);
    let off_rad = 0.045;
    // No alert yet: it has to last.
    let off = of(RobotState::Calibrated, off_rad);
    assert_eq!(off.stands(), Standing::Uncalibrated);
    assert_eq!(
        off.alerting(AlertKind::Drift).stands(),
        Standing::Drift,
        "proven"
    );
    let within = of(RobotState::Calibrated, 0.002);
    assert_eq!(within.stands(), Standing::Calibrated);
    let deploying = of(RobotState::Calibrated, off_rad).deployed(DeploymentState::Applied);
    assert_eq!(deploying.stands(), Standing::Deploying);
    // What is not known is not off.
    let mut unknown = of(RobotState::Calibrated, off_rad);
    unknown.view.estimate = Some(Arc::new(estimate(0.0, 0.1, "unobservable")));
    assert_eq!(unknown.stands(), Standing::Calibrated);
    assert_eq!(
        of(RobotState::Learning, off_rad).stands(),
        Standing::Learning
    );
}

#[test]
fn a_silent_robot_with_values_inside_the_tolerance_has_not_drifted() {
    let of = |offset_rad| case(RobotState::Calibrated).using(Generation(1), offset_rad);
    let drift = AlertKind::Drift;
    assert_eq!(of(0.001).stale(drift).stands(), Standing::Calibrated);
    assert_eq!(of(0.02).stale(drift).stands(), Standing::Drift);
    assert_eq!(of(0.001).alerting(drift).stands(), Standing::Drift);
    // Without an estimate nothing speaks against it.
    let mut unknown = of(0.001).stale(drift);
    unknown.view.estimate = None;
    assert_eq!(unknown.stands(), Standing::Drift);
    unknown.view.estimate = Some(Arc::new(estimate(0.001, 0.0001, "converged")));
    assert_eq!(unknown.stands(), Standing::Calibrated);
}

#[test]
fn silence_hides_nothing() {
    use RobotState as R;
    let silent = |case: Case| case.alerting(AlertKind::NoData).stands();
    for (state, standing) in [
        (R::Calibrated, Standing::Calibrated),
        (R::Learning, Standing::Learning),
        (R::NoData, Standing::NoData),
    ] {
        assert_eq!(silent(case(state)), standing);
        assert_eq!(silent(case(state).proposed()), Standing::AwaitingApproval);
    }
    let deployed = case(R::Calibrated).deployed(DeploymentState::Queued);
    assert_eq!(silent(deployed), Standing::Deploying);
}

#[test]
fn every_alert_is_a_way_to_stand() {
    use Standing as S;
    let of = |kind| {
        case(RobotState::Calibrated)
            .using(Generation(1), 0.0)
            .alerting(kind)
    };
    let found = AlertKind::ALL.map(|kind| of(kind).stands());
    let expected = [
        S::RollbackFailed,
        S::Drift,
        S::VerificationFailed,
        S::TwoSenders,
        S::FormerKey,
        S::FalseReport,
        S::EstimatorFailed,
        S::NoInstance,
        S::NotApplied,
        S::OutOfSync,
        // A robot that fell silent stands as before.
        S::Calibrated,
        S::Fault,
        S::Uncalibrated,
        // What is wrong with instances is no state of a robot.
        S::Calibrated,
        S::Calibrated,
        S::Calibrated,
        S::Calibrated,
    ];
    assert_eq!(found, expected);
    for condition in [
        ConditionName::Pending,
        ConditionName::Recovering,
        ConditionName::Normal,
    ] {
        let mut case = of(AlertKind::Fault);
        case.alerts.set(AlertKind::Fault, condition);
        assert_eq!(case.stands(), S::Calibrated, "{condition:?}");
    }
}

#[test]
fn an_alert_about_several_robots_is_one_of_each() {
    let alert = Alert {
        id: AlertId(7),
        robot: Subject::Fleet,
        robots: vec![robot()],
        kind: AlertKind::Fault,
        version: Version(3),
        condition: Condition::Alerting {
            since_ns: WallTime(0),
        },
        began_ns: WallTime(0),
        alerted_ns: Some(WallTime(0)),
        ended_ns: None,
        what: String::new(),
        told_ns: WallTime(0),
        acknowledgement: None,
    };
    // Its own of that kind is over, and takes nothing away.
    let own = Alert {
        robot: Subject::Robot(robot()),
        robots: Vec::new(),
        condition: Condition::Recovering {
            since_ns: WallTime(0),
        },
        ..alert.clone()
    };
    let found = RobotAlerts::by_robot([&alert, &own]);
    let faulty = Case {
        alerts: found[&robot()].clone(),
        ..case(RobotState::Calibrated)
    };
    assert_eq!(faulty.stands(), Standing::Fault);
}

#[test]
fn urgency_is_the_order_and_names_are_those_of_documents() {
    use Standing as S;
    let order = [
        S::RollbackFailed,
        S::Drift,
        S::VerificationFailed,
        S::AwaitingApproval,
        S::Uncalibrated,
        S::NoData,
        S::Learning,
        S::Calibrated,
    ];
    assert!(order.is_sorted());
    assert_eq!(S::ALL.len(), 18);
    for &standing in S::ALL {
        assert_eq!(serde_json::json!(standing), standing.as_str());
        assert_eq!(S::parse(standing.as_str()), Some(standing));
    }
}
