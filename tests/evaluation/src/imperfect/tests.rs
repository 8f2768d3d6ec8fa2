//! The campaign's own bookkeeping, on short runs and on outcomes that are written down here.

use std::collections::BTreeSet;
use std::fs;

use fleetcal_estimator::estimate::{Cause, ChangeKind, DetectionState, Status};
use fleetcal_estimator::{EstimatorSettings, Parameter};
use fleetcal_robot::simulator::{ImperfectionKind, Strength};

use super::*;
use crate::drive::drive;

fn cell(scenario: Scenario) -> Cell {
    Cell {
        flaw: Flaw::One(ImperfectionKind::SteeringGain, Strength::Strong),
        road: Road::Aisles,
        sensor: Sensor::Poses,
        scenario,
    }
}

fn snapshot(at_s: f64, errors: [f64; 4], converged: bool) -> Snapshot {
    Snapshot {
        at_s,
        errors,
        sigmas: [0.001; 4],
        converged: [converged; 4],
        nees: errors.iter().map(|error| (error / 0.001).powi(2)).sum(),
    }
}

fn claims(snapshots: Vec<Snapshot>) -> Outcome {
    Outcome::Claims(ClaimsOutcome {
        snapshots,
        worst_claim: 0.0,
        converged_s: Some(100.0),
        flagged: Vec::new(),
        length_s: 600.0,
    })
}

fn change(flag: Option<(Cause, f64)>, false_late: u32) -> Outcome {
    let flagged = |cause| Flagged {
        at_s: 130.0,
        kind: ChangeKind::CalibrationChanged,
        cause,
    };
    Outcome::Change(Box::new(ChangeOutcome {
        changed_s: 120.0,
        before: None,
        too_early: Vec::new(),
        flag: flag.map(|(cause, way_m)| (flagged(cause), way_m)),
        faults: Vec::new(),
        turned_m: flag.map(|(_, way_m)| 0.5 * way_m),
        driven_m: 40.0,
        told: [40, false_late],
        told_late: [20, false_late],
        end: None,
    }))
}

#[test]
fn every_cell_has_its_own_name_and_survives_its_results_file() {
    let mut names = BTreeSet::new();
    for flaw in Flaw::all() {
        for road in Road::ALL {
            for scenario in Scenario::all() {
                let cell = Cell {
                    flaw,
                    road,
                    sensor: tables::sensor_of(flaw),
                    scenario,
                };
                assert!(names.insert(cell.to_string()), "{cell} twice");
                let text = serde_json::to_string(&cell).unwrap();
                assert_eq!(serde_json::from_str::<Cell>(&text).unwrap(), cell);
            }
        }
    }
    assert!("aisles".parse::<Road>().is_ok());
    let unknown = "aisle".parse::<Road>().unwrap_err().to_string();
    assert_eq!(
        unknown,
        r#"got "aisle", expected one of eight, aisles, left"#
    );
}

#[test]
fn an_interrupted_campaign_goes_on_where_it_stopped_and_ends_the_same() {
    let cell = cell(Scenario::Unchanged);
    let whole = Campaign::new(Watch::whole(6.0))
        .outcomes(cell, &[1, 2, 3])
        .unwrap();
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("results.jsonl");
    let first = Campaign::resumed(Watch::whole(6.0), &path)
        .unwrap()
        .outcomes(cell, &[1, 2])
        .unwrap();
    assert_eq!(first, whole[..2]);
    // A kill in the middle of a line.
    let text = fs::read_to_string(&path).unwrap();
    let cut = text.trim_end().len() - 20;
    fs::write(&path, &text[..cut]).unwrap();
    let mut again = Campaign::resumed(Watch::whole(6.0), &path).unwrap();
    assert_eq!(again.outcomes(cell, &[1, 2, 3]).unwrap(), whole);
    let kept = fs::read_to_string(&path).unwrap();
    let runs = kept
        .lines()
        .filter(|line| serde_json::from_str::<Finished>(line).is_ok());
    assert_eq!(runs.count(), 3);
    // Runs of another length are others, and so are those of an estimator that begins later.
    let late = Watch {
        heard_from_s: 2.0,
        ..Watch::whole(6.0)
    };
    for other in [Watch::whole(7.0), late] {
        let others = Campaign::resumed(other, &path).unwrap();
        assert_eq!(others.finished_runs(), 0);
    }
    assert_eq!(again.finished_runs(), 3);
}

#[test]
fn a_change_is_flagged_by_the_robots_time_whenever_the_estimator_begins() {
    let cell = Cell {
        flaw: Flaw::Clean,
        road: Road::Eight,
        ..cell(Scenario::Changed(InjectedChange::MountYaw, Speed::Fast))
    };
    for heard_from_s in [0.0, 30.0] {
        let watch = Watch {
            heard_from_s,
            ..Watch::whole(600.0)
        };
        let Outcome::Change(outcome) = run(cell, 1, watch).unwrap() else {
            panic!("no change was driven");
        };
        assert!(outcome.too_early.is_empty(), "{outcome:?}");
        let (flagged, way_m) = outcome.flag.unwrap();
        assert!(flagged.at_s > outcome.changed_s && (0.5..10.0).contains(&way_m));
    }
}

#[test]
fn an_estimator_that_begins_late_knows_nothing_before() {
    let cell = cell(Scenario::Unchanged);
    let told = |heard_from_s: f64| {
        let (mut robot, _) = super::robot::robot(cell, 1, None);
        robot.heard_from_s = heard_from_s;
        let driven = crate::drive::drive(robot, 8.0).unwrap();
        driven.estimates.len()
    };
    assert!(told(5.0) < told(0.0));
    assert_eq!(told(9.0), 0);
}

#[test]
fn claims_are_pooled_by_time() {
    let good = snapshot(180.2, [0.000_5; 4], true);
    let wrong = snapshot(180.4, [0.0, 0.004_5, 0.0, 0.0], true);
    let modest = snapshot(180.9, [0.1; 4], false);
    let early = snapshot(60.1, [0.0; 4], false);
    let outcomes = [
        claims(vec![early, good]),
        claims(vec![early, wrong]),
        claims(vec![early, modest]),
    ];
    let summary = Summary::of(cell(Scenario::Unchanged), &outcomes);
    assert_eq!(summary.false_claims_at(60.0).to_string(), "0/3 (≤63.16%)");
    assert_eq!(summary.false_claims_at(180.0).count, 1);
    assert_eq!(summary.false_claims_at(600.0).of, 0);
    assert!((summary.worst_claim() - 4.5).abs() < 1e-9);
    assert_eq!(summary.converged().count, 2);
    // 0.0005 rad of steering are too much, 4.5 mm in y are not.
    assert_eq!(summary.converged_within_bounds().count, 1);
    assert!((summary.nees_at(180.0) - (1.0 + 20.25 + 40_000.0) / 3.0).abs() < 1e-6);
    assert!((summary.false_changes().upper_bound() - 2.995_73 / 0.5).abs() < 1e-3);
}

#[test]
fn a_wrong_cause_is_no_right_flag() {
    let steering = Scenario::Changed(InjectedChange::Steering, Speed::Fast);
    let outcomes = [
        change(Some((Cause::Steering, 2.0)), 0),
        change(Some((Cause::Steering, 5.0)), 0),
        change(Some((Cause::LidarMount, 1.0)), 0),
        change(None, 7),
    ];
    let summary = Summary::of(cell(steering), &outcomes);
    assert!((summary.flagged_after_m(0.5) - 5.0).abs() < 1e-12);
    assert!(summary.flagged_after_m(0.95).is_infinite());
    assert!((summary.turned_after_m(0.5) - 1.0).abs() < 1e-12);
    assert!(summary.turned_after_m(0.95).is_infinite());
    assert_eq!((summary.missed().count, summary.missed().of), (1, 4));
    assert_eq!(
        (summary.wrong_cause().count, summary.wrong_cause().of),
        (1, 3)
    );
    assert_eq!(summary.false_claims_after_change().count, 1);
}

#[test]
fn a_jump_on_a_clean_robot_is_flagged_by_its_name_and_the_way_is_counted_from_it() {
    let cell = Cell {
        flaw: Flaw::Clean,
        road: Road::Eight,
        sensor: Sensor::Poses,
        scenario: Scenario::Changed(InjectedChange::Steering, Speed::Fast),
    };
    let Outcome::Change(outcome) = run(cell, 1, Watch::whole(600.0)).unwrap() else {
        panic!("a change was asked for");
    };
    let (flag, way_m) = outcome.flag.unwrap();
    assert_eq!(flag.cause, Cause::Steering);
    assert!(
        (120.0..160.0).contains(&outcome.changed_s),
        "{}",
        outcome.changed_s
    );
    let turned_m = outcome.turned_m.unwrap();
    assert!((0.5..6.0).contains(&turned_m), "{turned_m}");
    // At 1 m/s and less in bends.
    let since_s = flag.at_s - outcome.changed_s;
    assert!(
        way_m > 0.4 * since_s && way_m < 1.05 * since_s + 0.2,
        "{way_m} {since_s}"
    );
    assert!(outcome.driven_m > 40.0 && outcome.told[0] > outcome.told_late[0]);
}

#[test]
fn a_lidar_that_moves_by_20_mm_on_a_loop_to_one_side_is_flagged_by_noisy_poses() {
    let cell = Cell {
        flaw: Flaw::Clean,
        road: Road::Left,
        sensor: Sensor::Poses,
        scenario: Scenario::Changed(InjectedChange::MountMoved, Speed::Slow),
    };
    let mut unflagged = Vec::new();
    for seed in 1..=10 {
        let Outcome::Change(outcome) = run(cell, seed, Watch::whole(600.0)).unwrap() else {
            panic!("a change was asked for");
        };
        assert_eq!(outcome.told_late[1], 0, "seed {seed}");
        let Some((flag, way_m)) = outcome.flag else {
            unflagged.push(seed);
            continue;
        };
        assert_eq!(flag.cause, Cause::LidarMount, "seed {seed}");
        assert!(way_m < 20.0, "seed {seed}: {way_m} m");
    }
    // While single poses, of 3 mm, ended windows, 4, 8 and 9 were not flagged. 8 stands at the threshold.
    assert!(unflagged.iter().all(|seed| *seed == 8), "{unflagged:?}");
}

/// Injects changes within the first 46 m: a detection that needs nine known blocks of windows
/// judges nothing so early, and each of these changes went unseen and was claimed away.
#[test]
fn what_moves_before_a_robot_has_driven_46_m_is_flagged() {
    for (road, change, speed, seed) in [
        (Road::Eight, InjectedChange::MountYaw, Speed::Fast, 8),
        (Road::Aisles, InjectedChange::MountYaw, Speed::Slow, 7),
        (Road::Left, InjectedChange::MountYaw, Speed::Fast, 7),
        (Road::Aisles, InjectedChange::Steering, Speed::Fast, 10),
    ] {
        let cell = Cell {
            flaw: Flaw::Clean,
            road,
            sensor: Sensor::Poses,
            scenario: Scenario::Changed(change, speed),
        };
        let watch = Watch {
            changed_within_m: Some((22.0, 46.0)),
            ..Watch::whole(600.0)
        };
        let Outcome::Change(outcome) = run(cell, seed, watch).unwrap() else {
            panic!("a change was asked for");
        };
        let changed_m = outcome.changed_s * speed.mps();
        assert!((22.0..46.0).contains(&changed_m), "{changed_m} m");
        assert_eq!(outcome.told_late[1], 0, "{cell}: {outcome:?}");
        let (flag, way_m) = outcome.flag.expect("a flag");
        let is_right = (flag.cause == Cause::Steering) == (change == InjectedChange::Steering);
        assert!(is_right && way_m < 7.0, "{cell}: {flag:?} after {way_m} m");
    }
}

#[test]
fn strong_understeer_is_not_taken_for_a_steering_zero_that_moved_on_the_first_lap() {
    let cell = Cell {
        flaw: Flaw::One(ImperfectionKind::Understeer, Strength::Strong),
        road: Road::Eight,
        sensor: Sensor::Poses,
        scenario: Scenario::Unchanged,
    };
    // Before a change took twice the evidence of few blocks, each of these was flagged and claimed a zero
    // that was off by more than four sigmas.
    for seed in [16, 24, 29, 35, 36, 42, 56, 58] {
        let Outcome::Claims(outcome) = run(cell, seed, Watch::whole(64.0)).unwrap() else {
            panic!("an unchanged robot was asked for");
        };
        assert_eq!(outcome.flagged, [], "seed {seed}");
        assert!(
            (0.1..4.0).contains(&outcome.worst_claim),
            "seed {seed}: {}",
            outcome.worst_claim
        );
    }
}

/// Drives tilted scanners whose filters mostly begin again while they drive: the evidence for the
/// delays of the wheels and the steering is lost with the start.
#[test]
fn who_has_every_imperfection_and_sees_the_floor_claims_no_false_steering_zero() {
    let cell = Cell {
        flaw: Flaw::AllTypical,
        road: Road::Left,
        sensor: Sensor::Scans,
        scenario: Scenario::Unchanged,
    };
    // Before the floor was left out 34 and 53 were false, and 27 and 45 reported more than 100 faults; before
    // a start on the way counted, 24, 49 and 53.
    for seed in [24, 27, 34, 45, 49, 53] {
        let Outcome::Claims(outcome) = run(cell, seed, Watch::whole(300.0)).unwrap() else {
            panic!("an unchanged robot was asked for");
        };
        assert_eq!(outcome.flagged, [], "seed {seed}");
        assert!(
            outcome.worst_claim < 4.0,
            "seed {seed}: {}",
            outcome.worst_claim
        );
    }
}

/// Checks that the known properties of a vehicle survive the detection of a tilted scanner: lag,
/// play and curve of the steering stay, and are not learnt from nothing on the way.
#[test]
fn the_floor_that_is_found_after_minutes_is_no_change() {
    // Without that each of these was reported as changed after 104 to 183 s.
    for (road, seed, length_s) in [
        (Road::Aisles, 53, 130.0),
        (Road::Aisles, 79, 190.0),
        (Road::Aisles, 96, 115.0),
        (Road::Aisles, 111, 115.0),
        (Road::Left, 67, 115.0),
    ] {
        let cell = Cell {
            flaw: Flaw::AllTypical,
            road,
            sensor: Sensor::Scans,
            scenario: Scenario::Unchanged,
        };
        let Outcome::Claims(outcome) = run(cell, seed, Watch::whole(length_s)).unwrap() else {
            panic!("an unchanged robot was asked for");
        };
        let kinds: Vec<_> = outcome.flagged.iter().map(|flag| flag.kind).collect();
        let confirmed = [ChangeKind::CalibrationConfirmed];
        assert_eq!(kinds, confirmed, "{road:?}, seed {seed}");
        assert!(
            (0.1..4.0).contains(&outcome.worst_claim),
            "{road:?}, seed {seed}: {}",
            outcome.worst_claim
        );
    }
}

/// Begins a filter on the way with lag, play and curve of the steering wrong all at once. Used
/// once, the first readings leave the filter with other values, and the robot scatters.
#[test]
fn a_change_is_seen_on_a_robot_with_every_imperfection_whose_filter_began_on_the_way() {
    let cell = Cell {
        flaw: Flaw::AllTypical,
        road: Road::Eight,
        sensor: Sensor::Poses,
        scenario: Scenario::Changed(InjectedChange::MountMoved, Speed::Fast),
    };
    // None of these was flagged within 40 m.
    for (seed, heard_from_s) in [
        (1, 6.0),
        (23, 6.0),
        (37, 6.0),
        (9, 9.5),
        (23, 9.5),
        (35, 9.5),
    ] {
        let watch = Watch {
            heard_from_s,
            ..Watch::whole(600.0)
        };
        let Outcome::Change(outcome) = run(cell, seed, watch).unwrap() else {
            panic!("a change was asked for");
        };
        let (flag, way_m) = outcome.flag.expect("the change is flagged");
        assert_eq!(flag.cause, Cause::LidarMount, "seed {seed}");
        assert!(way_m < 20.0, "seed {seed}: {way_m} m");
        assert!(outcome.too_early.is_empty(), "seed {seed}");
        assert_eq!(outcome.told_late[1], 0, "seed {seed}");
    }
}

/// Drives scanners that see the floor, whose odometry may move aside in its first metres, until the
/// floor is found and its new map holds. A filter that begins there converges to a mount over a
/// metre away.
#[test]
fn a_filter_that_began_with_misled_poses_begins_again_elsewhere() {
    let tilt = Flaw::One(ImperfectionKind::Tilt, Strength::Typical);
    // The first two reported 16 and 15 faults within 120 s, the third was 1.3 m off.
    for (flaw, seed, faults_max) in [(tilt, 138, 1), (tilt, 156, 1), (Flaw::AllTypical, 163, 0)] {
        let cell = Cell {
            flaw,
            road: Road::Left,
            sensor: Sensor::Scans,
            scenario: Scenario::Unchanged,
        };
        let Outcome::Claims(outcome) = run(cell, seed, Watch::whole(125.0)).unwrap() else {
            panic!("an unchanged robot was asked for");
        };
        assert!(
            outcome.flagged.len() <= faults_max,
            "seed {seed}: {outcome:?}"
        );
        let last = outcome.snapshots.last().unwrap();
        assert!(last.at_s > 119.0);
        for (error, sigma) in last.errors.iter().zip(last.sigmas) {
            assert!(error.abs() < 4.0 * sigma && error.abs() < 0.05, "{last:?}");
        }
    }
}

/// Drives robots without imperfections on the straights of aisles, where detection waits for the
/// turns in which a moved LiDAR shows, and its pose is not claimed before, however well it is
/// known.
#[test]
fn where_turns_are_missing_detection_waits_for_motion_and_not_for_scatter() {
    let cell = Cell {
        flaw: Flaw::Clean,
        ..cell(Scenario::Unchanged)
    };
    for seed in 501..=503 {
        let (robot, _) = robot::robot(cell, seed, None);
        let driven = drive(robot, 90.0).unwrap();
        let estimates = || driven.estimates.iter().map(|(estimate, _)| estimate);
        let states = || estimates().map(|estimate| estimate.detection);
        let last = states().map(|state| state.lidar_mount).next_back();
        assert_eq!(last, Some(DetectionState::Watching), "seed {seed}");
        let scatters = states().any(|state| state.lidar_mount == DetectionState::Scatter);
        assert!(!scatters, "seed {seed}");
        let x_sigma_max_m = EstimatorSettings::default().converged_sigma.lidar_x;
        let withheld = estimates().any(|estimate| {
            let x = estimate.parameter(Parameter::LidarX);
            estimate.detection.lidar_mount == DetectionState::Motion
                && x.status == Status::Learning
                && x.sigma < 0.9 * x_sigma_max_m
                && estimate.distance_m > 46.0
        });
        assert!(withheld, "seed {seed}");
    }
}

/// Moves a LiDAR, which jumps in one window. On a straight the next evidence comes with the next
/// turn; a jump that counted as scatter until then would hide the change.
#[test]
fn a_lidar_that_moves_on_a_straight_is_flagged_in_the_next_turn() {
    let cell = Cell {
        flaw: Flaw::Clean,
        ..cell(Scenario::Changed(InjectedChange::MountMoved, Speed::Fast))
    };
    // Before c696e23 none of these was flagged within 40 m.
    for seed in [415, 424, 456, 465, 496] {
        let Outcome::Change(outcome) = run(cell, seed, Watch::whole(600.0)).unwrap() else {
            panic!("a change was asked for");
        };
        let (flag, way_m) = outcome.flag.expect("the change is flagged");
        assert_eq!(flag.cause, Cause::LidarMount, "seed {seed}");
        assert!(way_m < 25.0, "seed {seed}: {way_m} m");
        assert!(outcome.too_early.is_empty(), "seed {seed}");
    }
}
