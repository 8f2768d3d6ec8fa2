//! Every rule: its sighting of a robot, its records and its newest deployment.

use super::*;
use crate::approval::{
    Evidence, GenerationRef, Maintenance, Origin, Policy, Revision, RobotLedger, Verification,
};
use crate::robot::Warning;

/// Case of a rule: its situation, and the expected sighting.
struct Case {
    view: RobotView,
    ledger: RobotLedger,
    latest: Option<Deployment>,
    fault: Option<(WallTime, &'static str)>,
    policy: AlertPolicy,
    watched_since_s: i64,
    in_sight: bool,
}

fn case() -> Case {
    Case {
        view: view(),
        ledger: RobotLedger::new(robot()),
        latest: None,
        fault: None,
        policy: AlertPolicy::default(),
        watched_since_s: 0,
        in_sight: true,
    }
}

impl Case {
    fn sight(&self, kind: AlertKind) -> (Observation, String) {
        let all = sightings(&Situation {
            now: at(110),
            watched_since_ns: at(self.watched_since_s),
            view: &self.view,
            in_sight: self.in_sight,
            ledger: &self.ledger,
            latest: self.latest.as_ref(),
            fault: self.fault,
            approval: &Policy::default(),
            policy: &self.policy,
        });
        let found = all.into_iter().find(|one| one.kind == kind).unwrap();
        (found.observation, found.what)
    }

    fn firing(&self) -> Vec<AlertKind> {
        let fires = |kind: &AlertKind| self.sight(*kind).0 == Observation::Firing;
        AlertKind::OF_ROBOT.into_iter().filter(fires).collect()
    }
}

#[test]
fn nothing_is_wrong_with_a_robot_that_is_as_it_should_be() {
    assert!(case().firing().is_empty());
}

#[test]
fn places_of_sessions_that_are_taken_are_an_alert_of_the_fleet_unless_it_is_off() {
    let mut policy = AlertPolicy::default();
    let seen = |crowded: Option<&str>, policy: &AlertPolicy| {
        let (subject, seen) = sessions_full(crowded.map(str::to_owned), policy);
        assert_eq!(
            (&subject, seen.kind),
            (&Subject::Fleet, AlertKind::SessionsFull)
        );
        (seen.observation, seen.what)
    };
    let what = "10.0.0.1 has all of its share";
    let (crowded, firing) = (Some(what), (Observation::Firing, what.to_owned()));
    let clear = (Observation::Clear, String::new());
    assert_eq!(seen(crowded, &policy), firing);
    assert_eq!(seen(None, &policy), clear);
    policy.off.push(AlertKind::SessionsFull);
    assert_eq!(seen(crowded, &policy), clear);
}

#[test]
fn a_robot_on_a_former_key_is_told_of_until_it_stops() {
    let mut case = case();
    let warning = Warning::former_key("fleet/tugger_01/wheel_odometry");
    case.view.warnings.push(warning);
    assert_eq!(case.firing(), [AlertKind::FormerKey]);
    assert!(AlertKind::FormerKey.advice().contains("wheel_odometry"));
    case.view.warnings.clear();
    assert!(case.firing().is_empty());
}

#[test]
fn drift_is_sure_and_far_or_a_vehicle_that_changed() {
    // It uses what was approved for it.
    let case = || {
        let mut case = case();
        case.ledger.shadow.in_use = Some(in_use(Generation(1), 0.0));
        case
    };
    let drift = |change: fn(&mut Case)| {
        let mut case = case();
        change(&mut case);
        case.sight(AlertKind::Drift)
    };
    let estimated = |case: &mut Case, offset_rad, sigma_rad, status: &str| {
        case.view.estimate = Some(Arc::new(estimate(offset_rad, sigma_rad, status)));
    };
    let (far, what) = drift(|case| {
        case.view.estimate = Some(Arc::new(estimate(0.01, 0.0005, "converged")));
    });
    assert_eq!(far, Observation::Firing);
    assert_eq!(
        what,
        "steering offset +0.57° (sigma 0.03°) away from what the robot uses"
    );
    let mut unsure = case();
    estimated(&mut unsure, 0.01, 0.01, "converged");
    assert_eq!(unsure.sight(AlertKind::Drift).0, Observation::Clear);
    let mut near = case();
    estimated(&mut near, 0.002, 0.0001, "converged");
    assert_eq!(near.sight(AlertKind::Drift).0, Observation::Clear);
    // One that is not known yet does not count, whatever its value.
    let mut learning = case();
    estimated(&mut learning, 0.1, 0.0001, "learning");
    assert_eq!(learning.sight(AlertKind::Drift).0, Observation::Unknown);
    // What the robot says it uses counts more than its drawing.
    let mut applied = case();
    estimated(&mut applied, 0.01, 0.0001, "converged");
    applied.ledger.shadow.in_use = Some(in_use(Generation(2), 0.01));
    assert_eq!(applied.sight(AlertKind::Drift).0, Observation::Clear);
    assert_eq!(
        drift(|case| case.view.state = RobotState::Changed).0,
        Observation::Firing
    );
    let unknown: [fn(&mut Case); 3] = [
        |case| {
            case.view.connection.stale = true;
            case.view.connection.last_seen_ns = Some(at(100));
        },
        |case| case.view.state = RobotState::NoData,
        |case| case.view.estimate = None,
    ];
    for change in unknown {
        assert_eq!(drift(change).0, Observation::Unknown);
    }
    let gap = drift(|case| {
        case.view.connection.stale = true;
        case.view.connection.last_seen_ns = Some(at(105));
    });
    assert_eq!(gap.0, Observation::Clear);
    // Nobody knows what it uses: there is nothing to have drifted from.
    let unknown_base = drift(|case| {
        case.ledger.shadow.in_use = None;
        case.view.estimate = Some(Arc::new(estimate(0.1, 0.0001, "converged")));
        case.view.config = case.view.config.take().map(|config| RobotConfig {
            nominal_extrinsics: None,
            ..config
        });
    });
    assert_eq!(unknown_base.0, Observation::Clear);
}

#[test]
fn what_no_estimate_was_approved_for_needs_a_calibration_and_has_not_drifted() {
    let using = |in_use: Option<InUse>| {
        let mut case = case();
        case.view.estimate = Some(Arc::new(estimate(0.01, 0.0005, "converged")));
        let approved = in_use
            .as_ref()
            .filter(|in_use| in_use.generation > Generation(0));
        case.ledger.shadow.desired = approved.map(|in_use| GenerationRef {
            generation: in_use.generation,
            ..deployment(DeploymentState::Verified).offer
        });
        case.ledger.shadow.in_use = in_use;
        case
    };
    // Its drawing, its factory calibration, and what was approved.
    assert_eq!(using(None).firing(), [AlertKind::Uncalibrated]);
    let factory = using(Some(in_use(Generation(0), 0.0)));
    assert_eq!(factory.firing(), [AlertKind::Uncalibrated]);
    assert_eq!(
        factory.sight(AlertKind::Uncalibrated).1,
        "steering offset +0.57° (sigma 0.03°) away from what the robot uses"
    );
    let second = |revision| {
        Some(InUse {
            revision: Some(RevisionId(revision)),
            ..in_use(Generation(2), 0.0)
        })
    };
    let mut approved = using(second(1));
    assert_eq!(approved.firing(), [AlertKind::Drift]);
    // A person rolled it back to that, also while the next one is on its way.
    let mut chosen = deployment(DeploymentState::Verified).offer;
    chosen.chosen_by = Some("ada".to_owned());
    approved.ledger.shadow.desired = Some(chosen.clone());
    assert_eq!(approved.firing(), [AlertKind::Uncalibrated]);
    let mut next = deployment(DeploymentState::Queued);
    next.offer.generation = Generation(3);
    approved.ledger.shadow.desired = Some(next.offer.clone());
    next.desired_before = Some(chosen);
    approved.ledger.live = Some(next);
    assert_eq!(approved.firing(), [AlertKind::Uncalibrated]);
    // The factory calibration that came back by itself.
    let mut returned = using(second(7));
    let revision = revision(7, Origin::Robot);
    returned.ledger.revisions.insert(RevisionId(7), revision);
    assert_eq!(returned.firing(), [AlertKind::Uncalibrated]);
    // Whatever it uses, a vehicle that changed has changed.
    let mut changed = factory;
    changed.view.state = RobotState::Changed;
    assert_eq!(changed.firing(), [AlertKind::Drift]);
    // Of a robot that sends nothing nobody knows.
    let mut silent = using(None);
    silent.view.state = RobotState::NoData;
    assert_eq!(
        silent.sight(AlertKind::Uncalibrated).0,
        Observation::Unknown
    );
}

fn revision(id: u64, origin: Origin) -> Revision {
    Revision {
        id: RevisionId(id),
        robot: robot(),
        origin,
        values: in_use(Generation(0), 0.0).values,
        sigmas: CalibrationValues::default(),
        estimator: String::new(),
        evidence: Evidence::default(),
        created_ns: WallTime(0),
        rear_axle_in_base_link: None,
        sha256: String::new(),
    }
}

#[test]
fn only_a_robot_that_was_sending_has_stopped_sending() {
    let mut silent = case();
    silent.view.connection.stale = true;
    let (observation, what) = silent.sight(AlertKind::NoData);
    assert_eq!(observation, Observation::Firing);
    assert_eq!(
        what,
        "nothing has come from the robot since 1970-01-01T00:01:40Z"
    );
    silent.view.connection.last_seen_ns = None;
    assert_eq!(silent.sight(AlertKind::NoData).0, Observation::Unknown);
    // It was heard before the service was started, and stays away.
    silent.view.connection.heard_before_ns = Some(at(50));
    let (observation, what) = silent.sight(AlertKind::NoData);
    assert_eq!(observation, Observation::Firing);
    assert_eq!(
        what,
        "nothing has come from the robot since 1970-01-01T00:00:50Z"
    );
    silent.watched_since_s = 108;
    assert_eq!(silent.sight(AlertKind::NoData).0, Observation::Clear);
    let never = Condition::Normal {
        since_ns: WallTime(0),
    };
    let never = never.after(Observation::Unknown, at(900), PERIODS);
    assert_eq!(never.name(), ConditionName::Normal);
}

#[test]
fn a_robot_in_maintenance_raises_no_alert_until_that_ends() {
    let mut parked = case();
    parked.view.connection.stale = true;
    let until = |until_ns| Maintenance {
        until_ns,
        by: "ada".to_owned(),
        at_ns: at(90),
        reason: "parked for the night".to_owned(),
    };
    parked.ledger.shadow.maintenance = Some(until(at(111)));
    assert_eq!(parked.sight(AlertKind::NoData).0, Observation::Clear);
    parked.ledger.shadow.maintenance = Some(until(at(110)));
    assert_eq!(parked.sight(AlertKind::NoData).0, Observation::Firing);
}

#[test]
fn each_state_of_the_newest_deployment_fires_its_own_alert() {
    use AlertKind as K;
    use DeploymentState as D;
    for state in D::ALL {
        let expected: &[K] = match state {
            D::Refused | D::Failed | D::TimedOut => &[K::NotApplied],
            D::RollbackFailed => &[K::RollbackFailed],
            _ => &[],
        };
        let mut case = case();
        case.latest = Some(deployment(state));
        if state == D::RollbackFailed {
            case.ledger.shadow.desired = case.latest.as_ref().map(|one| one.offer.clone());
            case.ledger.shadow.in_use = Some(in_use(Generation(1), 0.0));
        }
        assert_eq!(case.firing(), expected, "{state:?}");
        if !expected.is_empty() {
            let (_, what) = case.sight(expected[0]);
            assert!(what.contains("deployment 5") && what.contains("hook said no"));
        }
        case.latest = case.latest.map(|latest| Deployment {
            verification: Some(Verification {
                at_ns: WallTime(0),
                distance_m: 60.0,
                residual: [0.02, 0.0, 0.0, 0.0],
                sigma: [0.001; 4],
                within: false,
                limits: None,
                evidence: None,
            }),
            ..latest
        });
        case.view.estimate = Some(Arc::new(estimate(0.02, 0.0001, "converged")));
        let failed = matches!(
            state,
            D::Verifying | D::RollingBack | D::RolledBack | D::Kept
        );
        let (observation, what) = case.sight(K::VerificationFailed);
        assert_eq!(observation == Observation::Firing, failed, "{state:?}");
        assert_eq!(what.contains("steering offset +1.15°"), failed, "{what}");
    }
}

#[test]
fn a_failed_verification_clears_once_the_estimate_agrees_with_what_the_robot_uses() {
    use DeploymentState as D;
    for state in [D::RolledBack, D::Kept] {
        let sight = |estimated_rad| {
            let mut case = case();
            let mut latest = deployment(state);
            latest.verification = Some(Verification {
                at_ns: WallTime(0),
                distance_m: 60.0,
                residual: [0.02, 0.0, 0.0, 0.0],
                sigma: [0.001; 4],
                within: false,
                limits: None,
                evidence: None,
            });
            case.ledger.shadow.desired = Some(latest.offer.clone());
            case.latest = Some(latest);
            case.ledger.shadow.in_use = Some(in_use(Generation(2), 0.01));
            case.view.estimate = Some(Arc::new(estimate(estimated_rad, 0.0001, "converged")));
            case.sight(AlertKind::VerificationFailed).0
        };
        assert_eq!(sight(0.03), Observation::Firing, "{state:?}");
        assert_eq!(sight(0.0101), Observation::Clear, "{state:?}");
    }
}

#[test]
fn a_robot_that_uses_another_generation_is_out_of_sync_unless_one_is_on_its_way() {
    let mut apart = case();
    apart.ledger.shadow.desired = Some(deployment(DeploymentState::Verified).offer);
    apart.ledger.shadow.in_use = Some(in_use(Generation(1), 0.0));
    assert_eq!(apart.firing(), [AlertKind::OutOfSync]);
    let (_, what) = apart.sight(AlertKind::OutOfSync);
    assert_eq!(what, "the robot should use generation 2 and uses 1");
    apart.ledger.live = Some(deployment(DeploymentState::Offered));
    assert!(apart.firing().is_empty());
}

#[test]
fn of_a_robot_out_of_sight_the_records_alone_are_judged() {
    let mut cut = case();
    cut.fault = Some((at(109), "steering"));
    cut.ledger.shadow.desired = Some(deployment(DeploymentState::Verified).offer);
    cut.ledger.shadow.in_use = Some(in_use(Generation(1), 0.0));
    assert_eq!(cut.firing(), [AlertKind::OutOfSync, AlertKind::Fault]);
    cut.in_sight = false;
    assert_eq!(cut.firing(), [AlertKind::OutOfSync]);
    for kind in [AlertKind::Fault, AlertKind::NoData] {
        assert_eq!(cut.sight(kind).0, Observation::Unknown);
    }
}

#[test]
fn a_robot_that_uses_what_nobody_wants_is_out_of_sync_and_did_apply_it() {
    let mut replayed = case();
    replayed.latest = Some(deployment(DeploymentState::TimedOut));
    assert_eq!(replayed.firing(), [AlertKind::NotApplied]);
    replayed.ledger.shadow.in_use = Some(in_use(Generation(2), 0.0));
    assert_eq!(replayed.firing(), [AlertKind::OutOfSync]);
    let (_, what) = replayed.sight(AlertKind::OutOfSync);
    assert!(
        what.starts_with("the robot uses generation 2 and should use none"),
        "{what}"
    );
    assert!(AlertKind::OutOfSync.advice().contains("taken back"));
    // Its factory calibration is what it should use then.
    replayed.ledger.shadow.in_use = Some(in_use(Generation(0), 0.0));
    assert_eq!(replayed.firing(), [AlertKind::NotApplied]);
}

#[test]
fn faults_pass_and_failures_stay() {
    let mut faulty = case();
    faulty.fault = Some((at(108), "LiDAR odometry"));
    assert_eq!(faulty.firing(), [AlertKind::Fault]);
    faulty.fault = Some((at(90), "LiDAR odometry"));
    assert!(faulty.firing().is_empty());
    faulty.view.state = RobotState::Failed;
    assert_eq!(faulty.firing(), [AlertKind::EstimatorFailed]);
}

#[test]
fn what_is_switched_off_or_not_registered_is_silent() {
    let mut silent = case();
    silent.view.connection.stale = true;
    silent.policy.off = vec![AlertKind::NoData];
    assert_eq!(silent.sight(AlertKind::NoData).0, Observation::Clear);
    silent.policy.off.clear();
    silent.view.config = None;
    assert!(silent.firing().is_empty());
}
