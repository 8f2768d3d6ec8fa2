//! Restarts of a service that is killed in mid-drive and continues from its checkpoint: it still
//! knows the vehicle and its scanner, and flags no change.

use fleetcal_estimator::calibrator::CalibratorConfig;
use fleetcal_estimator::estimate::{Change, SteeringTableStatus};
use fleetcal_estimator::filter::{ASYMMETRY, PARAMETERS};
use fleetcal_estimator::lidar_odometry::{BeamTimes, ScannerReport};
use fleetcal_estimator::{
    Calibrator, Checkpoint, Effect, Event, Note, NoteKind, Parameter, Status,
};
use fleetcal_robot::simulator::{
    ImperfectionKind, Imperfections, LidarOutput, LidarSettings, Simulation, SimulationConfig,
};

use crate::drive::{FOUR, event_of, poses, vehicle_of};

/// Times of the checkpoints, s.
const CHECKPOINTS_S: [f64; 4] = [35.0, 47.0, 60.0, 75.0];
/// Lengths of the silence after it, s. The robot drives on, and is met again in a turn.
const GAPS_S: [f64; 2] = [0.5, 12.0];
/// Time for which it is watched then, s.
const ON_S: f64 = 45.0;

/// Feeds one event and keeps the changes that it brings.
fn feed(calibrator: &mut Calibrator, event: &Event, changes: &mut Vec<Change>) {
    for effect in calibrator.step(event.clone()) {
        if let Effect::Change(change) = effect {
            changes.push(*change);
        }
    }
}

/// A robot's messages with their times, s.
fn messages(config: SimulationConfig, duration_s: f64) -> Vec<(f64, Event)> {
    let start_ns = config.start_stamp_ns;
    let mut simulation = Simulation::new(config).unwrap();
    let mut messages = Vec::new();
    loop {
        let emitted = simulation.advance();
        let time_s = (emitted.sent_ns - start_ns) as f64 * 1e-9;
        if time_s > duration_s {
            return messages;
        }
        if let Some(event) = event_of(emitted.message) {
            messages.push((time_s, event));
        }
    }
}

/// Asserts that the scanner's errors are the same, to this many sigmas of those before.
fn assert_same_scanner(before: &ScannerReport, after: &ScannerReport, sigmas: f64, name: &str) {
    let pairs = [
        (before.range_bias_m, after.range_bias_m),
        (before.incidence_bias_m, after.incidence_bias_m),
    ];
    for ((was, was_sigma), (is, is_sigma)) in pairs {
        assert!((is - was).abs() <= sigmas * was_sigma, "{name}: {after:?}");
        assert!(is_sigma <= 1.05 * was_sigma, "{name}: {after:?}");
    }
    let kind = |report: &ScannerReport| std::mem::discriminant(&report.beam_times);
    assert_eq!(kind(before), kind(after), "{name}: {after:?}");
}

/// Asserts that the four are the same, by the sigmas of before.
fn assert_same_vehicle(before: &Calibrator, after: &Calibrator, name: &str) {
    let (before, after) = (before.estimate(), after.estimate());
    for parameter in FOUR {
        let (was, is) = (before.parameter(parameter), after.parameter(parameter));
        let moved = (is.value - was.value).abs();
        assert!(moved <= 3.0 * was.sigma, "{name}: {was:?}, then {is:?}");
        let is_kept = was.status != Status::Converged || is.status == Status::Converged;
        assert!(is_kept, "{name}: {was:?}, then {is:?}");
    }
}

/// Asserts for every restart of a drive that the calibrator that continues agrees with the one
/// before.
fn assert_goes_on(seed: u64, imperfections: Imperfections) -> ScannerReport {
    let mut config = SimulationConfig::figure_eight(seed);
    config.lidar = LidarOutput::Scans(LidarSettings {
        beams: 720,
        ..LidarSettings::default()
    });
    config.imperfections = imperfections;
    let settings = CalibratorConfig::of(vehicle_of(&config.vehicle, config.vehicle.wheelbase_m));
    let last_s = CHECKPOINTS_S[3] + GAPS_S[1] + ON_S;
    let messages = messages(config, last_s);
    let mut calibrator = Calibrator::new(settings.clone());
    let mut changes = Vec::new();
    let mut fed = 0;
    for checkpoint_s in CHECKPOINTS_S {
        while messages[fed].0 < checkpoint_s {
            feed(&mut calibrator, &messages[fed].1, &mut changes);
            fed += 1;
        }
        let stored = serde_json::to_string(&calibrator.checkpoint()).unwrap();
        for gap_s in GAPS_S {
            let name = format!("seed {seed}, stored at {checkpoint_s} s, {gap_s} s of gap");
            let read: Checkpoint = serde_json::from_str(&stored).unwrap();
            let mut restored = Calibrator::restore(settings.clone(), &read).unwrap();
            assert_same_scanner(&calibrator.scanner(), &restored.scanner(), 1e-9, &name);
            let from_s = checkpoint_s + gap_s;
            let on = from_s..from_s + ON_S;
            for (_, event) in messages.iter().filter(|(time_s, _)| on.contains(time_s)) {
                feed(&mut restored, event, &mut changes);
            }
            assert!(changes.is_empty(), "{name}: {changes:?}");
            assert_same_scanner(&calibrator.scanner(), &restored.scanner(), 4.0, &name);
            assert_same_vehicle(&calibrator, &restored, &name);
        }
    }
    calibrator.scanner()
}

#[test]
fn a_restart_in_mid_drive_changes_nothing() {
    for seed in 1..=8 {
        assert_goes_on(seed, Imperfections::default());
    }
}

#[test]
fn a_restart_in_mid_drive_keeps_what_was_learnt_of_the_scanner() {
    let bias = Imperfections::single(ImperfectionKind::RangeBias, 1.0);
    let (learnt_m, sigma_m) = assert_goes_on(7, bias).range_bias_m;
    assert!((learnt_m - 0.03).abs() < 4.0 * sigma_m, "{learnt_m} m");
    let mut untimed = Imperfections::default();
    untimed.scanner.untimed_beams = true;
    let report = assert_goes_on(9, untimed);
    assert!(
        matches!(report.beam_times, BeamTimes::Turning { .. }),
        "{report:?}"
    );
}

/// Removes the last rows and columns, which an earlier estimator lacked.
fn shrink(value: &mut serde_json::Value) {
    const CURVE: usize = 6;
    match value {
        serde_json::Value::Object(fields) => fields.values_mut().for_each(shrink),
        serde_json::Value::Array(numbers) => match numbers.len() {
            PARAMETERS => numbers.truncate(PARAMETERS - CURVE),
            // Drive parameters and all parameters, of a pose.
            33 | 45 => numbers.truncate(numbers.len() - 3 * CURVE),
            // Covariances, by halves.
            120 | 231 => {
                let size = ((8 * numbers.len() + 1).isqrt() - 1) / 2;
                let kept = size - CURVE;
                let mut column_and_row = (0, 0);
                numbers.retain(|_| {
                    let (column, row) = column_and_row;
                    column_and_row = if row + 1 < size {
                        (column, row + 1)
                    } else {
                        (column + 1, column + 1)
                    };
                    row.max(column) < kept
                });
            }
            225 | 441 => {
                let size = numbers.len().isqrt();
                let mut index = 0;
                numbers.retain(|_| {
                    let (row, column) = (index % size, index / size);
                    index += 1;
                    row.max(column) < size - CURVE
                });
            }
            _ => {}
        },
        _ => {}
    }
}

#[test]
fn a_checkpoint_that_knows_no_steering_curve_is_read_and_the_curve_learnt() {
    let config = SimulationConfig::figure_eight(3);
    let settings = CalibratorConfig::of(vehicle_of(&config.vehicle, config.vehicle.wheelbase_m));
    let mut calibrator = Calibrator::new(settings.clone());
    let mut changes = Vec::new();
    let messages = messages(config, 60.0);
    let (before, after) = messages.split_at(messages.len() * 2 / 3);
    for (_, event) in before {
        feed(&mut calibrator, event, &mut changes);
    }
    let mut stored = serde_json::to_value(calibrator.checkpoint()).unwrap();
    stored["version"] = 7.into();
    for part in ["filter", "long_run", "comparison", "baseline"] {
        shrink(&mut stored[part]);
    }
    assert_eq!(
        stored["filter"]["covariance"].as_array().unwrap().len(),
        15 * 16 / 2
    );
    let read: Checkpoint = serde_json::from_value(stored).unwrap();
    let mut restored = Calibrator::restore(settings, &read).unwrap();
    let asymmetry_variance = |calibrator: &Calibrator| {
        let covariance = calibrator.filter().unwrap().parameter_covariance();
        covariance[(ASYMMETRY, ASYMMETRY)]
    };
    let prior_variance = asymmetry_variance(&restored);
    assert!((prior_variance - 1e-4).abs() < 1e-9, "{prior_variance}");
    for parameter in FOUR {
        let [then, now] = [&calibrator, &restored].map(|c| c.estimate().parameter(parameter).value);
        // What was known of the curve is not known any more.
        assert!((then - now).abs() < 2e-3, "{parameter:?}: {then} {now}");
    }
    for (_, event) in after {
        feed(&mut restored, event, &mut changes);
    }
    assert!(changes.is_empty(), "{changes:?}");
    assert!(asymmetry_variance(&restored) < 0.5 * prior_variance);
    for parameter in FOUR {
        let status = restored.estimate().parameter(parameter).status;
        assert_eq!(status, Status::Converged, "{parameter:?}");
    }
}

/// A table of a stored calibration has the angles that were driven before, and is no sharper than what
/// the checkpoint knows of the curve.
#[test]
fn a_stored_calibration_keeps_its_steering_table_as_far_as_its_curve_is_stored() {
    let mut config = SimulationConfig::figure_eight(3);
    config.lidar = poses();
    config.people.count = 0;
    let settings = CalibratorConfig::of(vehicle_of(&config.vehicle, config.vehicle.wheelbase_m));
    let mut calibrator = Calibrator::new(settings.clone());
    let mut changes = Vec::new();
    let messages = messages(config, 180.0);
    for (_, event) in &messages {
        feed(&mut calibrator, event, &mut changes);
    }
    let range = |calibrator: &Calibrator| {
        let points = calibrator.estimate().steering_table.points;
        [points.first(), points.last()].map(|point| point.map(|point| point.measured_rad))
    };
    let driven = range(&calibrator);
    assert!(
        driven[0] < Some(-0.1) && driven[1] > Some(0.1),
        "{driven:?}"
    );
    let note = Note {
        stamp: calibrator.estimate().stamp,
        kind: NoteKind::PowerOn,
    };
    feed(&mut calibrator, &Event::Note(note), &mut changes);
    assert_eq!(range(&calibrator), driven);
    let mut stored = serde_json::to_value(calibrator.checkpoint()).unwrap();
    let read: Checkpoint = serde_json::from_value(stored.clone()).unwrap();
    let same = Calibrator::restore(settings.clone(), &read).unwrap();
    assert_eq!(range(&same), driven);

    stored["version"] = 7.into();
    for part in ["filter", "long_run", "comparison", "baseline"] {
        shrink(&mut stored[part]);
    }
    let read: Checkpoint = serde_json::from_value(stored).unwrap();
    let table = Calibrator::restore(settings, &read)
        .unwrap()
        .estimate()
        .steering_table;
    assert_eq!(table.status, SteeringTableStatus::Informative, "{table:?}");
    for point in &table.points {
        // Of the asymmetry alone: 1 % of the angle.
        let least_rad = 0.009 * (point.measured_rad.abs() - 0.05);
        assert!(point.sigma_rad > least_rad, "{point:?}");
    }
}

/// A checkpoint of the release before has no scanner in it.
#[test]
fn a_checkpoint_without_a_scanner_is_read_and_its_scanner_learnt_again() {
    let config = SimulationConfig::figure_eight(3);
    let settings = CalibratorConfig::of(vehicle_of(&config.vehicle, config.vehicle.wheelbase_m));
    let mut calibrator = Calibrator::new(settings.clone());
    let mut changes = Vec::new();
    for (_, event) in messages(config, 40.0) {
        feed(&mut calibrator, &event, &mut changes);
    }
    let mut stored = serde_json::to_value(calibrator.checkpoint()).unwrap();
    assert_eq!(stored["version"], 9);
    stored["version"] = 6.into();
    stored.as_object_mut().unwrap().remove("scanner").unwrap();
    let read: Checkpoint = serde_json::from_value(stored).unwrap();
    let restored = Calibrator::restore(settings, &read).unwrap();
    let (before, after) = (calibrator.estimate(), restored.estimate());
    for parameter in Parameter::ALL {
        assert_eq!(before.parameter(parameter), after.parameter(parameter));
    }
    let unknown = Calibrator::new(restored.config().clone()).scanner();
    assert_eq!(restored.scanner(), unknown);
}
