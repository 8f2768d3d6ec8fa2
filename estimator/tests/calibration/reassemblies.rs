//! Verdicts after a reassembly: their reference, and that they come whatever the stamps do.

use fleetcal_estimator::calibrator::CalibratorConfig;
use fleetcal_estimator::estimate::{Cause, Change, ChangeKind};
use fleetcal_estimator::{Calibrator, Effect, Event, Note, NoteKind, Parameter};
use fleetcal_robot::simulator::{
    self, LidarOutput, Pose2, ScheduledChange, Simulation, SimulationConfig,
};

use crate::drive::{event_of, poses, vehicle_of};

/// Turn of the LiDAR's yaw in the workshop, rad.
const MOVED_RAD: f64 = 0.021;
/// Start of a drive's stamps after the first one's, ns: after the workshop,
const LATER_NS: i64 = 300_000_000_000;
/// by a clock that begins again with each drive, and by one that is set back an hour.
const CLOCKS_BACK_NS: [i64; 2] = [0, -3_600_000_000_000];

/// A tugger with scans that is off in every respect, drawn from a seed.
fn drawn(seed: u64) -> SimulationConfig {
    let (one, other) = ((seed as f64 * 1.7).sin(), (seed as f64 * 2.3).cos());
    let mut config = SimulationConfig::figure_eight(seed);
    let vehicle = &mut config.vehicle;
    vehicle.steering_offset_rad = 0.05 * one;
    vehicle.lidar_in_base.x_m += 0.04 * other;
    vehicle.lidar_in_base.y_m += 0.04 * one;
    vehicle.lidar_in_base.yaw_rad += 0.03 * other;
    vehicle.speed_scale = 1.0 + 0.008 * one;
    vehicle.time_offset_s = 0.03 * other;
    vehicle.slip.longitudinal_sigma = 0.002;
    config.speed.period_s = 23.0 + 6.0 * one;
    if let LidarOutput::Scans(scans) = &mut config.lidar {
        scans.phase_s = 0.05 + 0.05 * other;
    }
    config
}

fn calibrator_of(config: &SimulationConfig) -> Calibrator {
    let vehicle = vehicle_of(&config.vehicle, config.vehicle.wheelbase_m);
    Calibrator::new(CalibratorConfig::of(vehicle))
}

fn report(calibrator: &mut Calibrator) {
    let stamp = calibrator.estimate().stamp;
    let kind = NoteKind::Reassembled;
    calibrator.step(Event::Note(Note { stamp, kind }));
}

/// Drives a robot past a calibrator; returns the changes of its calibration, with the time of the
/// drive (s).
fn driven(
    calibrator: &mut Calibrator,
    config: &SimulationConfig,
    duration_s: f64,
) -> Vec<(f64, Change)> {
    let mut simulation = Simulation::new(config.clone()).unwrap();
    let mut changes = Vec::new();
    loop {
        let emitted = simulation.advance();
        let time_s = (emitted.sent_ns - config.start_stamp_ns) as f64 * 1e-9;
        if time_s > duration_s {
            return changes;
        }
        let event = event_of(emitted.message);
        for effect in event.into_iter().flat_map(|event| calibrator.step(event)) {
            if let Effect::Change(change) = effect {
                changes.push((time_s, *change));
            }
        }
    }
}

/// Kinds and causes of the changes.
fn told(changes: &[(f64, Change)]) -> Vec<(ChangeKind, Cause)> {
    changes.iter().map(|(_, c)| (c.kind, c.cause)).collect()
}

const MOVED: [(ChangeKind, Cause); 1] = [(ChangeKind::CalibrationChanged, Cause::LidarMount)];
const UNMOVED: [(ChangeKind, Cause); 1] = [(ChangeKind::CalibrationConfirmed, Cause::Unknown)];

#[test]
fn each_report_is_answered_by_what_has_moved_since_just_before_it() {
    for seed in [13, 16] {
        let mut config = drawn(seed);
        let mut calibrator = calibrator_of(&config);
        assert_eq!(told(&driven(&mut calibrator, &config, 90.0)), []);
        // Each drive begins elsewhere than the last has ended.
        config.vehicle.lidar_in_base.yaw_rad += MOVED_RAD;
        for answer in [MOVED, UNMOVED, UNMOVED] {
            config.start_stamp_ns += LATER_NS;
            report(&mut calibrator);
            let changes = driven(&mut calibrator, &config, 90.0);
            assert_eq!(told(&changes), answer, "seed {seed}: {changes:?}");
        }
    }
}

#[test]
fn a_clock_that_goes_back_delays_no_verdict() {
    let mut config = SimulationConfig::figure_eight(9);
    let mut calibrator = calibrator_of(&config);
    assert_eq!(told(&driven(&mut calibrator, &config, 60.0)), []);
    for back_ns in CLOCKS_BACK_NS {
        config.start_stamp_ns += back_ns;
        for is_reported in [true, false] {
            let mut calibrator = calibrator.clone();
            if is_reported {
                report(&mut calibrator);
            }
            let changes = driven(&mut calibrator, &config, 30.0);
            assert_eq!(told(&changes), UNMOVED, "{back_ns} ns: {changes:?}");
        }
    }
}

/// Motions on the way to a verdict belong to it: nobody knew the state before.
#[test]
fn the_first_change_after_a_report_is_its_verdict() {
    let mut config = SimulationConfig::figure_eight(9);
    config.lidar = poses();
    let mut before = calibrator_of(&config);
    assert_eq!(told(&driven(&mut before, &config, 60.0)), []);
    config.start_stamp_ns += LATER_NS;
    for at_s in 2..12 {
        let mut config = config.clone();
        config.changes.push(ScheduledChange {
            at_s: f64::from(at_s),
            change: simulator::Change::Mount(Pose2::new(0.0, 0.0, MOVED_RAD)),
        });
        let mut calibrator = before.clone();
        report(&mut calibrator);
        let changes = driven(&mut calibrator, &config, 90.0);
        // A verdict has no onset, and the LiDAR is seen to have moved.
        assert!(changes[0].1.onset_s.abs() < 1e-9, "{at_s} s: {changes:?}");
        let is_move = |(_, change): &(f64, Change)| change.kind == ChangeKind::CalibrationChanged;
        assert!(changes.iter().any(is_move), "{at_s} s: {changes:?}");
        let yaw_rad = calibrator.estimate().parameter(Parameter::LidarYaw).value;
        let truth_rad = config.vehicle.lidar_in_base.yaw_rad + MOVED_RAD;
        assert!((yaw_rad - truth_rad).abs() < 2e-3, "{at_s} s: {yaw_rad}");
    }
}
