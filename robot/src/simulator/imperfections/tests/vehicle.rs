//! Steering, wheels and tyres.

use super::{drives, quiet, run, with};
use crate::simulator::steering_curve::SteeringCurve;
use crate::simulator::{
    Change, DriveSample, Emitted, ImperfectionKind, Imperfections, Point, Route, ScheduledChange,
    SimulationConfig, VehicleImperfections, VehicleModel, VehicleTruth,
};

fn vehicle(imperfections: VehicleImperfections) -> Imperfections {
    Imperfections {
        vehicle: imperfections,
        ..Imperfections::default()
    }
}

/// Returns each drive sample with the true steering in the middle of its interval, rad.
fn shown_and_true(messages: &[Emitted]) -> Vec<(DriveSample, f64)> {
    let drives = drives(messages);
    drives
        .windows(2)
        .map(|pair| {
            let (before, after) = (&pair[0].1.truth, &pair[1].1.truth);
            (pair[1].0, 0.5 * (before.steering_rad + after.steering_rad))
        })
        .collect()
}

fn circle(speed_mps: f64) -> SimulationConfig {
    let mut config = quiet();
    config.route = Route::circle(Point::new(-11.0, 0.0), 4.0);
    config.speed.min_mps = speed_mps;
    config.speed.max_mps = speed_mps;
    config
}

#[test]
fn the_steering_follows_the_curve_of_its_four_terms() {
    let imperfections = VehicleImperfections {
        steering_gain: 0.02,
        steering_asymmetry: -0.03,
        steering_quadratic_rad: 0.01,
        steering_cubic_rad: 0.02,
        ..VehicleImperfections::default()
    };
    let mut config = with(quiet(), vehicle(imperfections));
    config.vehicle.steering_offset_rad = 0.05;
    let messages = run(config, 40.0);
    let reference_rad = 20_f64.to_radians();
    let mut farthest_rad = 0.0_f64;
    for (drive, true_rad) in shown_and_true(&messages) {
        let u = drive.steering_rad - 0.05;
        let part = u / reference_rad;
        let expected_rad = 1.02 * u - 0.03 * u.abs() + 0.01 * part * part + 0.02 * part.powi(3);
        assert!(
            (expected_rad - true_rad).abs() < 2e-4,
            "{u}: {true_rad} {expected_rad}"
        );
        farthest_rad = farthest_rad.max((true_rad - u).abs());
    }
    assert!(farthest_rad > 0.02, "the curve is driven: {farthest_rad}");
}

#[test]
fn the_steering_curve_turns_back_everywhere_and_a_flat_one_is_refused() {
    let truth = VehicleTruth::default();
    for kind in [
        ImperfectionKind::SteeringGain,
        ImperfectionKind::SteeringAsymmetry,
        ImperfectionKind::SteeringQuadratic,
        ImperfectionKind::SteeringCubic,
    ] {
        for times in [-3.0, -1.0, 1.0, 3.0] {
            let curve = SteeringCurve::new(
                truth.steering_gain,
                &Imperfections::single(kind, times).vehicle,
            );
            assert!(curve.least_slope() > 0.3, "{} {times}", kind.name());
            for step in -90..=90 {
                let wheel_rad = f64::from(step) * 0.01;
                let back_rad = curve.wheel_rad(curve.shown_rad(wheel_rad));
                assert!((back_rad - wheel_rad).abs() < 1e-14, "{wheel_rad}");
            }
        }
    }
    let config = with(
        quiet(),
        vehicle(VehicleImperfections {
            steering_cubic_rad: -0.1,
            ..VehicleImperfections::default()
        }),
    );
    let refused = crate::simulator::Simulation::new(config).unwrap_err();
    assert_eq!(refused.field, "slope of the steering curve");
}

#[test]
fn the_wheel_stays_within_the_play_and_reaches_both_its_ends() {
    let play_rad = 0.5_f64.to_radians();
    let config = with(quiet(), Imperfections::typical(ImperfectionKind::Backlash));
    let messages = run(config, 40.0);
    let lost = shown_and_true(&messages);
    let lost = lost
        .iter()
        .map(|(drive, wheel_rad)| drive.steering_rad - wheel_rad);
    let (least, most) = lost.fold((0.0_f64, 0.0_f64), |(least, most), rad| {
        (least.min(rad), most.max(rad))
    });
    let half = 0.5 * play_rad;
    assert!(
        (least + half).abs() < 1e-4 && (most - half).abs() < 1e-4,
        "{least} to {most}"
    );
}

#[test]
fn the_wheel_follows_the_shown_angle_with_the_lag_and_the_speed_does_not() {
    let messages = run(
        with(
            quiet(),
            Imperfections::typical(ImperfectionKind::SteeringLag),
        ),
        40.0,
    );
    let samples = drives(&messages);
    for three in samples.windows(3) {
        let [before, now, after] = [0, 1, 2].map(|n| three[n].1.truth.steering_rad);
        let rate = (after - before) / 0.02;
        let shown_rad = 0.5 * (three[1].0.steering_rad + three[2].0.steering_rad);
        assert!(
            (0.1 * rate - (shown_rad - now)).abs() < 3e-3,
            "{rate} {shown_rad} {now}"
        );
        let truth = &three[1].1.truth;
        assert!((three[1].0.speed_mps - truth.speed_mps).abs() < 0.02);
    }
}

#[test]
fn a_late_angle_shows_what_the_wheel_was_at_before() {
    let messages = run(
        with(
            quiet(),
            Imperfections::typical(ImperfectionKind::SteeringDelay),
        ),
        40.0,
    );
    let samples = shown_and_true(&messages);
    for pair in samples.windows(11).skip(10) {
        let (then, now) = (pair[0], pair[10]);
        assert!((now.0.steering_rad - then.1).abs() < 1e-4);
    }
    let moved = samples
        .windows(11)
        .map(|pair| (pair[10].1 - pair[0].1).abs());
    assert!(
        moved.fold(0.0, f64::max) > 0.02,
        "the steering moves meanwhile"
    );
}

#[test]
fn an_encoder_without_dither_shows_one_step_on_a_straight() {
    let mut config = quiet();
    config.route = Route::straight(Point::new(-30.0, 0.0), Point::new(300.0, 0.0));
    config.vehicle.steering_offset_rad = 0.1_f64.to_radians();
    config.drive.steering_sigma_rad = 0.01;
    config.imperfections = Imperfections::typical(ImperfectionKind::EncoderSteps);
    let messages = run(config, 20.0);
    let step_rad = 0.25_f64.to_radians();
    let mut steps: Vec<_> = drives(&messages)[500..]
        .iter()
        .map(|(drive, _)| drive.steering_rad / step_rad)
        .collect();
    assert!(steps.iter().all(|step| (step - step.round()).abs() < 1e-9));
    steps.dedup();
    assert_eq!(steps.len(), 1, "{steps:?}");
}

#[test]
fn a_wrong_wheelbase_is_what_the_robot_is_told_and_not_what_it_has() {
    let config = with(quiet(), Imperfections::typical(ImperfectionKind::Wheelbase));
    assert!((config.configured_wheelbase_m() - 1.2 * 1.02).abs() < 1e-12);
    let messages = run(config, 30.0);
    for pair in drives(&messages).windows(2).skip(300) {
        let (before, after) = (&pair[0].1.truth, &pair[1].1.truth);
        let yaw_rate = (after.base.yaw_rad - before.base.yaw_rad) / 0.01;
        let middle = |a: f64, b: f64| 0.5 * (a + b);
        let speed_mps = middle(before.speed_mps, after.speed_mps);
        let steering_rad = middle(before.steering_rad, after.steering_rad);
        assert!((yaw_rate - speed_mps * steering_rad.tan() / 1.2).abs() < 1e-3);
    }
}

#[test]
fn a_speed_measured_beside_the_axle_or_by_unequal_wheels_is_off_in_bends() {
    for model in [
        VehicleModel::Bicycle,
        VehicleModel::Tricycle,
        VehicleModel::RearSteered,
    ] {
        for (imperfections, ratio_less_1) in [
            (
                VehicleImperfections {
                    speed_encoder_y_m: 0.05,
                    ..VehicleImperfections::default()
                },
                -0.05 / 4.0,
            ),
            (
                VehicleImperfections {
                    wheel_sizes: 0.01,
                    ..VehicleImperfections::default()
                },
                match model {
                    VehicleModel::Bicycle | VehicleModel::RearSteered => 0.01 * 0.4 * 1.2 / 4.0,
                    VehicleModel::Tricycle => 0.0,
                },
            ),
        ] {
            let mut config = with(circle(0.8), vehicle(imperfections));
            config.vehicle.model = model;
            let messages = run(config, 30.0);
            for (drive, emitted) in &drives(&messages)[1000..] {
                let truth = &emitted.truth;
                let middle_mps = match model {
                    VehicleModel::Bicycle | VehicleModel::RearSteered => truth.speed_mps,
                    VehicleModel::Tricycle => truth.speed_mps / truth.steering_rad.cos(),
                };
                let off = (drive.speed_mps - middle_mps) / truth.speed_mps;
                assert!(
                    (off - ratio_less_1).abs() < 2e-3,
                    "{model:?}: {off} {ratio_less_1}"
                );
            }
        }
    }
}

#[test]
fn slipping_tyres_go_outwards_and_understeer_widens_the_bend() {
    let imperfections = VehicleImperfections {
        side_slip_rad_per_mps2: 0.02,
        understeer_rad_per_mps2: 0.03,
        ..VehicleImperfections::default()
    };
    let messages = run(with(circle(1.2), vehicle(imperfections)), 30.0);
    for pair in drives(&messages)[1000..].windows(2) {
        let (before, after) = (&pair[0].1.truth, &pair[1].1.truth);
        let moved = before.base.between(&after.base);
        let (speed_mps, yaw_rate) = (after.speed_mps, moved.yaw_rad / 0.01);
        let slip_rad = moved.y_m.atan2(moved.x_m) - 0.5 * moved.yaw_rad;
        assert!((slip_rad + 0.02 * speed_mps * yaw_rate).abs() < 3e-4);
        let expected = speed_mps * after.steering_rad.tan() / (1.2 + 0.03 * speed_mps * speed_mps);
        assert!((yaw_rate - expected).abs() < 3e-3, "{yaw_rate} {expected}");
    }
}

#[test]
fn a_steering_zero_that_jumps_shifts_an_imperfect_curve() {
    let mut config = with(
        quiet(),
        Imperfections::strong(ImperfectionKind::SteeringCubic),
    );
    config.imperfections.vehicle.backlash_rad = 0.5_f64.to_radians();
    config.changes = vec![ScheduledChange {
        at_s: 20.0,
        change: Change::SteeringOffset(0.02),
    }];
    let start_ns = config.start_stamp_ns;
    let curve = SteeringCurve::new(config.vehicle.steering_gain, &config.imperfections.vehicle);
    let half_play_rad = 0.25_f64.to_radians();
    let messages = run(config, 40.0);
    for (drive, true_rad) in shown_and_true(&messages) {
        let time_s = (drive.stamp_ns - start_ns) as f64 * 1e-9;
        let offset_rad = if time_s > 20.005 { 0.02 } else { 0.0 };
        let side_rad = curve.wheel_rad(drive.steering_rad - offset_rad);
        let lost_rad = (side_rad - true_rad).abs();
        assert!(lost_rad < half_play_rad + 3e-4, "{time_s}: {lost_rad}");
    }
}
