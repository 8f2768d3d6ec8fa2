//! Every pair of condition and observation, and the two axes of an alert.

mod rules;

use std::sync::Arc;

use fleetcal_model::{
    AlertId, DeploymentId, Generation, ProposalId, RevisionId, RobotTime, Version, WallTime,
};
use fleetcal_proto::RobotId;
use fleetcal_proto::calibration::CalibrationValues;
use serde_json::json;

use super::*;
use crate::approval::{Deployment, DeploymentState, GenerationRef, InUse, Policy, RobotLedger};
use crate::robot::{
    CheckFinding, CheckState, ChecksReport, Connection, Counters, RobotConfig, RobotState,
    RobotView,
};

const S: i64 = 1_000_000_000;

const fn at(seconds: i64) -> WallTime {
    WallTime(seconds * S)
}
const PERIODS: Periods = Periods {
    pending_ns: 10 * S,
    recovering_ns: 60 * S,
};

fn condition(name: ConditionName, since_ns: WallTime) -> Condition {
    match name {
        ConditionName::Normal => Condition::Normal { since_ns },
        ConditionName::Pending => Condition::Pending { since_ns },
        ConditionName::Alerting => Condition::Alerting { since_ns },
        ConditionName::Recovering => Condition::Recovering { since_ns },
        ConditionName::NoData => Condition::NoData { since_ns },
    }
}

/// Expected conditions before and after the periods are over.
fn expected(was: ConditionName, seen: Observation) -> (ConditionName, ConditionName) {
    use ConditionName as C;
    use Observation as O;
    match (was, seen) {
        (C::Normal, O::Firing) => (C::Pending, C::Pending),
        (C::Pending, O::Firing) => (C::Pending, C::Alerting),
        (C::Normal | C::Pending, O::Clear | O::Unknown) => (C::Normal, C::Normal),
        (C::Alerting | C::Recovering | C::NoData, O::Firing) => (C::Alerting, C::Alerting),
        (C::Alerting | C::NoData, O::Clear) => (C::Recovering, C::Recovering),
        (C::Recovering, O::Clear) => (C::Recovering, C::Normal),
        (C::Alerting | C::Recovering | C::NoData, O::Unknown) => (C::NoData, C::NoData),
    }
}

#[test]
fn every_pair_of_condition_and_observation() {
    for &was in ConditionName::ALL {
        for seen in Observation::ALL {
            let (early, late) = expected(was, seen);
            for (now, follows) in [(105 * S, early), (200 * S, late)] {
                let before = condition(was, at(100));
                let after = before.after(seen, WallTime(now), PERIODS);
                assert_eq!(after.name(), follows, "{was:?} {seen:?} at {now}");
                // What stays keeps its time, what changes has a new one.
                let since = WallTime(if was == follows { 100 * S } else { now });
                assert_eq!(after.since(), since, "{was:?} {seen:?}");
            }
        }
    }
}

#[test]
fn a_period_ends_to_the_nanosecond_and_none_is_none() {
    let pending = condition(ConditionName::Pending, WallTime(0));
    let just_before = pending.after(Observation::Firing, WallTime(10 * S - 1), PERIODS);
    let just_then = pending.after(Observation::Firing, at(10), PERIODS);
    assert_eq!(just_before, pending);
    assert_eq!(just_then.name(), ConditionName::Alerting);
    let normal = condition(ConditionName::Normal, WallTime(0));
    let at_once = normal.after(Observation::Firing, WallTime(1), Periods::NONE);
    assert_eq!(at_once.name(), ConditionName::Alerting);
    let over = at_once.after(Observation::Clear, WallTime(2), Periods::NONE);
    assert_eq!(over.name(), ConditionName::Normal);
    // A clock that was set back by an hour: longer, never shorter.
    let back = pending.after(Observation::Firing, at(-3_600), PERIODS);
    assert_eq!(back, pending);
}

pub(crate) fn robot() -> RobotId {
    RobotId::parse("tugger_01").unwrap()
}

fn seen(observation: Observation) -> Sighting {
    Sighting {
        kind: AlertKind::Drift,
        observation,
        what: "far away".to_owned(),
        robots: Vec::new(),
    }
}

fn kept(step: Step) -> (Alert, Option<Notice>) {
    match step {
        Step::Changed(alert, notice) => (*alert, notice),
        other => panic!("{other:?}"),
    }
}

#[test]
fn an_alert_is_told_once_when_it_alerts_and_once_when_it_is_over() {
    let robot = Subject::Robot(robot());
    let step = |before: Option<&Alert>, observation, at_s: i64| {
        step(before, &robot, &seen(observation), at(at_s), PERIODS)
    };
    assert_eq!(step(None, Observation::Clear, 0), Step::Same);
    let (pending, notice) = kept(step(None, Observation::Firing, 0));
    assert_eq!((pending.version, notice), (Version(1), None));
    assert_eq!(step(Some(&pending), Observation::Firing, 9), Step::Same);
    assert_eq!(step(Some(&pending), Observation::Clear, 9), Step::Dropped);
    let (alerting, notice) = kept(step(Some(&pending), Observation::Firing, 10));
    assert_eq!(notice, Some(Notice::Alerting));
    assert_eq!(alerting.alerted_ns, Some(at(10)));
    let (recovering, notice) = kept(step(Some(&alerting), Observation::Clear, 20));
    assert_eq!(notice, None);
    // It comes back while nobody believed that it was over: the same alert, told once.
    let (again, notice) = kept(step(Some(&recovering), Observation::Firing, 30));
    assert_eq!((notice, again.alerted_ns), (None, Some(at(10))));
    let (over, notice) = kept(step(Some(&recovering), Observation::Clear, 80));
    assert_eq!(notice, Some(Notice::Resolved));
    assert_eq!((over.ended_ns, over.is_active()), (Some(at(80)), false));
    assert_eq!((over.version, over.what.as_str()), (Version(4), "far away"));
    assert!(again.rank() < pending.rank() && pending.rank() < over.rank());
}

#[test]
fn an_acknowledgement_changes_no_condition_and_a_condition_no_acknowledgement() {
    let robot = Subject::Robot(robot());
    for &name in ConditionName::ALL {
        let alert = Alert {
            id: AlertId(7),
            robot: robot.clone(),
            robots: Vec::new(),
            kind: AlertKind::Drift,
            version: Version(3),
            condition: condition(name, WallTime(0)),
            began_ns: WallTime(0),
            alerted_ns: Some(WallTime(0)),
            ended_ns: None,
            what: String::new(),
            told_ns: WallTime(0),
            acknowledgement: None,
        };
        let ada = Acknowledgement {
            by: "ada".to_owned(),
            at_ns: WallTime(5),
            note: Some("on my way".to_owned()),
        };
        let taken = alert.acknowledge(Version(3), ada.clone()).unwrap();
        assert_eq!(
            (taken.version, taken.condition),
            (Version(4), alert.condition)
        );
        let stale = taken.acknowledge(Version(3), ada.clone()).unwrap_err();
        assert_eq!(stale, AlertRefused::Stale { found: Version(4) });
        let twice = taken.acknowledge(Version(4), ada.clone()).unwrap_err();
        assert_eq!(twice, AlertRefused::AcknowledgedAlready("ada".to_owned()));
        for observation in Observation::ALL {
            if let Step::Changed(after, _) =
                step(Some(&taken), &robot, &seen(observation), at(900), PERIODS)
            {
                assert_eq!(after.acknowledgement, Some(ada.clone()));
            }
        }
    }
}

/// View of a robot that sends, is calibrated, and uses its drawing's values.
pub(crate) fn view() -> RobotView {
    let config: RobotConfig = serde_json::from_value(json!({
        "model": "bicycle", "wheelbase_m": 1.2,
        "nominal_extrinsics": {"x_m": 0.434, "y_m": 0.0, "yaw_rad": 0.0},
    }))
    .unwrap();
    RobotView {
        id: robot(),
        config: Some(config),
        state: RobotState::Calibrated,
        connection: Connection {
            last_seen_ns: Some(at(100)),
            heard_before_ns: None,
            stale: false,
            alive: true,
            streams: Vec::new(),
        },
        estimate: Some(Arc::new(estimate(0.0, 0.0001, "converged"))),
        verification: None,
        counters: Counters::default(),
        estimator_restarts: 0,
        pairing: None,
        reassembly_open: false,
        notes_taken: None,
        warnings: Vec::new(),
        checks: Arc::default(),
        topics: Arc::from([]),
        estimated_by: None,
    }
}

pub(crate) fn estimate(
    offset_rad: f64,
    sigma_rad: f64,
    status: &str,
) -> fleetcal_proto::estimate::EstimateDocument {
    let parameter = |value: f64, sigma: f64, unit: &str, status: &str| json!({"value": value, "sigma": sigma, "unit": unit, "status": status, "needs": null});
    serde_json::from_value(json!({
        "robot": "tugger_01", "stamp_ns": 100 * S, "time_s": 100.0, "distance_m": 90.0,
        "parameters": {
            "steering_offset": parameter(offset_rad, sigma_rad, "rad", status),
            "lidar_x": parameter(0.434, 0.001, "m", "converged"),
            "lidar_y": parameter(0.0, 0.001, "m", "converged"),
            "lidar_yaw": parameter(0.0, 0.001, "rad", "converged"),
            "speed_scale": parameter(1.0, 0.001, "1", "learning"),
            "wheelbase": parameter(1.2, 0.0, "m", "fixed"),
            "time_offset": parameter(0.0, 0.01, "s", "learning"),
            "steering_gain": parameter(1.0, 0.0, "1", "off"),
        },
        "consistency": {"nis_mean": 3.0, "nis_dof": 3.0, "samples": 5},
        "counts": {"drive_samples": 1, "scans": 1, "scans_rejected": 0, "late": 0, "duplicates": 0},
    }))
    .unwrap()
}

pub(crate) fn deployment(state: DeploymentState) -> Deployment {
    let offer = GenerationRef {
        generation: Generation(2),
        sha256: "00".to_owned(),
        revision: RevisionId(1),
        chosen_by: None,
    };
    Deployment {
        id: DeploymentId(5),
        robot: robot(),
        version: Version(3),
        state,
        proposal: Some(ProposalId(1)),
        approved_by: "ada".to_owned(),
        offer,
        earlier: Vec::new(),
        base: None,
        desired_before: None,
        created_ns: WallTime(0),
        expires_ns: WallTime(0),
        offered_ns: None,
        applied_ns: None,
        closed_ns: None,
        verification: None,
        reason: Some("hook said no".to_owned()),
        roll_back: None,
    }
}

pub(crate) fn in_use(generation: Generation, steering_offset_rad: f64) -> InUse {
    InUse {
        generation,
        revision: None,
        values: CalibrationValues {
            steering_offset_rad,
            lidar_x_m: 0.434,
            ..CalibrationValues::default()
        },
        since_ns: RobotTime(0),
    }
}

#[test]
fn the_words_of_an_alert_follow_what_is_seen() {
    let robot = Subject::Robot(robot());
    let seen = |what: &str| Sighting {
        kind: AlertKind::Drift,
        observation: Observation::Firing,
        what: what.to_owned(),
        robots: Vec::new(),
    };
    let first = seen("LiDAR yaw +1.73°");
    let (alert, _) = kept(step(None, &robot, &first, WallTime(0), Periods::NONE));
    let now = seen("steering offset +1.33°, LiDAR y +38.0 mm");
    let step = |at_s: i64| step(Some(&alert), &robot, &now, at(at_s), Periods::NONE);
    assert_eq!(step(9), Step::Same, "not with every look");
    let Step::Retold(retold) = step(10) else {
        panic!("{:?}", step(10));
    };
    assert_eq!(retold.what, now.what);
    assert_eq!(
        (retold.version, retold.condition),
        (alert.version, alert.condition)
    );
    let told = AlertDocument::of(&retold).what;
    assert_eq!(told, "steering offset +1.33°, LiDAR y +38.0 mm");
    let over = Alert {
        condition: Condition::Normal { since_ns: at(20) },
        ..*retold
    };
    let told = AlertDocument::of(&over).what;
    assert_eq!(
        told,
        "over; it was: steering offset +1.33°, LiDAR y +38.0 mm"
    );
}

#[test]
fn a_policy_is_refused_by_key_and_value() {
    let policy = AlertPolicy {
        pending_s: -1.0,
        ..AlertPolicy::default()
    };
    let refused = policy.check().unwrap_err();
    assert_eq!(refused, "alerts.pending_s: got -1, expected 0 to 86400");
    assert!(AlertPolicy::default().check().is_ok());
}

#[test]
fn names_are_those_of_documents() {
    for kind in AlertKind::ALL {
        assert_eq!(json!(kind), kind.as_str());
        assert_eq!(AlertKind::parse(kind.as_str()), Some(kind));
        assert_eq!(json!(kind.severity()), kind.severity().as_str());
        assert!(kind.advice().ends_with('.'));
    }
    for &name in ConditionName::ALL {
        assert_eq!(json!(name), name.as_str());
        assert_eq!(ConditionName::parse(name.as_str()), Some(name));
        assert_eq!(json!(condition(name, WallTime(0)))["state"], name.as_str());
    }
}

#[test]
fn a_cause_that_a_check_names_is_the_fault() {
    let finding = CheckFinding {
        check: "speed".to_owned(),
        state: CheckState::Wrong,
        cause: Some("speed_zero".to_owned()),
        seen: "wheels 0.0 m, LiDAR 2.1 m".to_owned(),
        advice: Some("Fill in the speed.".to_owned()),
        after_m: Some(20.0),
        after_s: Some(20.0),
        spoils_values: true,
    };
    let report = ChecksReport {
        findings: vec![finding],
        ..ChecksReport::default()
    };
    let wrong = RobotView {
        checks: Arc::new(report),
        ..view()
    };
    let ledger = RobotLedger::new(robot());
    let fault = |view: &RobotView, fault| {
        let situation = Situation {
            now: at(101),
            watched_since_ns: at(0),
            view,
            in_sight: true,
            ledger: &ledger,
            latest: None,
            fault,
            approval: &Policy::default(),
            policy: &AlertPolicy::default(),
        };
        let mut all = sightings(&situation).into_iter();
        let seen = all.find(|one| one.kind == AlertKind::Fault).unwrap();
        (seen.observation, seen.what)
    };
    let told = "speed: wheels 0.0 m, LiDAR 2.1 m. Fill in the speed.";
    for told_before in [None, Some((at(100), "odometry"))] {
        let expected = (Observation::Firing, told.to_owned());
        assert_eq!(fault(&wrong, told_before), expected);
    }
    assert_eq!(fault(&view(), None).0, Observation::Clear);
}
