//! The mirrored and the reversed drive: allowed differences of left and right, forward and
//! backward.

use proptest::prelude::*;

use super::*;
use crate::drive_history::DriveHistory;
use crate::filter::prediction::PredictedMotion;
use crate::geometry::Pose2;
use crate::motion_noise::MotionNoise;
use crate::stream::{DriveSample, RobotTime};

/// Signs of the derivatives of a speed by the parameters, mirrored: those of the parameters themselves.
const MIRRORED: [f64; DRIVE_PARAMETERS] = [
    -1.0, 1.0, 1.0, 1.0, 1.0, -1.0, -1.0, 1.0, 1.0, 1.0, 1.0, 1.0,
];

/// The same vehicle in a mirror.
fn mirrored_vehicle(vehicle: Vehicle) -> Vehicle {
    let speed_measured_at = match vehicle.speed_measured_at {
        SpeedMeasuredAt::RearWheel { lateral_m } => SpeedMeasuredAt::RearWheel {
            lateral_m: -lateral_m,
        },
        middle => middle,
    };
    Vehicle {
        speed_measured_at,
        ..vehicle
    }
}

fn mirrored_parameters(p: &DriveParameters) -> DriveParameters {
    DriveParameters {
        steering_offset_rad: -p.steering_offset_rad,
        curve: SteeringCurve {
            asymmetry: -p.curve.asymmetry,
            quadratic_per_rad: -p.curve.quadratic_per_rad,
            cubic_per_rad2: p.curve.cubic_per_rad2,
        },
        ..*p
    }
}

fn mirrored_reading(drive: DriveReading) -> DriveReading {
    DriveReading {
        steering_rad: -drive.steering_rad,
        steering_rate_radps: -drive.steering_rate_radps,
        steering_acceleration_radps2: -drive.steering_acceleration_radps2,
        play_side: -drive.play_side,
        ..drive
    }
}

/// The same steering at the opposite speed.
fn reversed_reading(drive: DriveReading) -> DriveReading {
    DriveReading {
        speed_mps: -drive.speed_mps,
        speed_rate_mps2: -drive.speed_rate_mps2,
        ..drive
    }
}

fn vehicles() -> impl Strategy<Value = Vehicle> {
    let model = prop_oneof![Just(VehicleModel::Bicycle), Just(VehicleModel::Tricycle)];
    let usual = (model, 0.3..3.0f64).prop_map(|(model, wheelbase)| Vehicle::new(model, wheelbase));
    let rear_wheel = (0.3..3.0f64, -0.5..0.5f64).prop_map(|(wheelbase_m, side)| Vehicle {
        model: VehicleModel::Bicycle,
        wheelbase_m,
        speed_measured_at: SpeedMeasuredAt::RearWheel {
            lateral_m: side * wheelbase_m,
        },
    });
    prop_oneof![usual, rear_wheel]
}

prop_compose! {
    fn parameters()(
        wheelbase_m in 0.3..3.0f64,
        (steering_offset_rad, speed_scale, steering_gain) in (-0.15..0.15f64, 0.9..1.1f64, 0.9..1.1f64),
        (side_slip_rad_per_mps2, half_play_rad) in (0.0..0.05f64, 0.0..0.01f64),
        (asymmetry, quadratic_per_rad, cubic_per_rad2) in (-0.05..0.05f64, -0.2..0.2f64, -0.5..0.5f64),
        (lag_s, spread_s2) in (-0.1..0.2f64, 0.0..0.02f64),
    ) -> DriveParameters {
        DriveParameters {
            steering_offset_rad,
            speed_scale,
            wheelbase_m,
            steering_gain,
            side_slip_rad_per_mps2,
            curve: SteeringCurve { asymmetry, quadratic_per_rad, cubic_per_rad2 },
            response: SteeringResponse { lag_s, spread_s2 },
            half_play_rad,
        }
    }
}

prop_compose! {
    fn readings()(
        (speed_mps, speed_rate_mps2) in (-3.0..3.0f64, -1.0..1.0f64),
        (steering_rad, steering_rate_radps, steering_acceleration_radps2) in
            (-0.6..0.6f64, -0.5..0.5f64, -3.0..3.0f64),
        play_side in -1.0..1.0f64,
    ) -> DriveReading {
        DriveReading {
            speed_mps,
            speed_rate_mps2,
            steering_rad,
            steering_rate_radps,
            steering_acceleration_radps2,
            play_side,
            ..DriveReading::default()
        }
    }
}

/// Measurements of a robot: speed and steering, a hundred times a second.
fn drives() -> impl Strategy<Value = Vec<(f64, f64)>> {
    let bends = (-2.0..2.0f64, -0.5..0.5f64, -0.5..0.5f64);
    prop::collection::vec(bends, 2..5).prop_map(|bends| {
        let samples = bends.into_iter().flat_map(|(speed_mps, from_rad, to_rad)| {
            (0..30).map(move |i| {
                let share = f64::from(i) / 30.0;
                (speed_mps, from_rad + share * (to_rad - from_rad))
            })
        });
        samples.collect()
    })
}

/// Motion of a vehicle by its measurements, by the whole way from samples to poses.
fn driven(vehicle: &Vehicle, p: &DriveParameters, samples: &[(f64, f64)]) -> PredictedMotion {
    let at = |i: usize| RobotTime(1_000_000_000 + 10_000_000 * i as i64);
    let mut history = DriveHistory::new(60.0);
    for (i, &(speed_mps, steering_rad)) in samples.iter().enumerate() {
        history.push(DriveSample::new(at(i), speed_mps, steering_rad).unwrap());
    }
    let mut motion = PredictedMotion::none();
    for segment in history.segments(at(0), at(samples.len() - 1), p.response) {
        motion.advance(vehicle, p, &MotionNoise::default(), &segment);
    }
    motion
}

fn near(a: f64, b: f64) -> bool {
    (a - b).abs() <= 1e-9 * (1.0 + a.abs().max(b.abs()))
}

fn all_near(a: &[f64], b: impl IntoIterator<Item = f64>) -> bool {
    a.iter().zip(b).all(|(&a, b)| near(a, b))
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]

    #[test]
    fn the_mirrored_drive_moves_like_the_mirror_image(
        vehicle in vehicles(), p in parameters(), samples in drives(),
    ) {
        let here = driven(&vehicle, &p, &samples);
        let samples: Vec<_> = samples.iter().map(|&(speed, steering)| (speed, -steering)).collect();
        let there = driven(&mirrored_vehicle(vehicle), &mirrored_parameters(&p), &samples);
        let Pose2 { x_m, y_m, yaw_rad } = here.end_in_begin;
        let mirrored = Pose2::new(x_m, -y_m, -yaw_rad);
        prop_assert!(mirrored.between(&there.end_in_begin).log().norm() < 1e-9);
        for (row, row_sign) in [(0, 1.0), (1, -1.0), (2, -1.0)] {
            let column = |motion: &PredictedMotion, i: usize| motion.by_parameters[(row, i)];
            let expected = (0..DRIVE_PARAMETERS).map(|i| row_sign * MIRRORED[i] * column(&here, i));
            let there: Vec<f64> = (0..DRIVE_PARAMETERS).map(|i| column(&there, i)).collect();
            prop_assert!(all_near(&there, expected), "row {row}");
        }
    }

    /// Forward and backward a body follows one track, but for its tyres: they give way outwards both times.
    #[test]
    fn the_reversed_drive_keeps_to_the_track_and_to_the_outside_of_the_bend(
        vehicle in vehicles(), p in parameters(), drive in readings(),
    ) {
        let (forward, back) = (
            vehicle.motion(drive, &p),
            vehicle.motion(reversed_reading(drive), &p),
        );
        prop_assert!(near(back.speed_mps, -forward.speed_mps));
        prop_assert!(near(back.yaw_rate_radps, -forward.yaw_rate_radps));
        prop_assert!(near(back.yaw_rate_by_steering, -forward.yaw_rate_by_steering));
        prop_assert!(near(back.side_speed_mps, forward.side_speed_mps));
        prop_assert!(all_near(&back.speed_by, forward.speed_by.map(|by| -by)));
        prop_assert!(all_near(&back.yaw_rate_by, forward.yaw_rate_by.map(|by| -by)));
        prop_assert!(all_near(&back.side_speed_by, forward.side_speed_by));
    }

    /// The road pushes a tyre into the bend, with the force that turns the body, and absorbs energy
    /// of the sliding: the tyre slides outwards, whichever way it rolls.
    #[test]
    fn a_tyre_takes_energy_from_the_drive(vehicle in vehicles(), p in parameters(), drive in readings()) {
        let motion = vehicle.motion(drive, &p);
        let acceleration_mps2 = motion.speed_mps * motion.yaw_rate_radps;
        prop_assert!(acceleration_mps2 * motion.side_speed_mps <= 0.0);
        let slip_rad = motion.side_speed_mps.abs() / motion.speed_mps.abs().max(f64::MIN_POSITIVE);
        let expected_rad = p.side_slip_rad_per_mps2 * acceleration_mps2.abs();
        prop_assert!(near(slip_rad, expected_rad), "{slip_rad} {expected_rad}");
    }

    /// A drive run backwards in time, each reading with the speed's other sign, leads back to its start where
    /// nothing depends on time or force.
    #[test]
    fn the_way_back_ends_at_the_start(
        vehicle in vehicles(), p in parameters(), legs in prop::collection::vec(readings(), 1..12),
    ) {
        let p = DriveParameters {
            side_slip_rad_per_mps2: 0.0,
            response: SteeringResponse::default(),
            half_play_rad: 0.0,
            ..p
        };
        let there = legs.iter().copied();
        let back = legs.iter().rev().map(|&drive| reversed_reading(drive));
        let mut motion = PredictedMotion::none();
        for drive in there.chain(back) {
            let drive = DriveReading { steering_rate_radps: 0.0, steering_acceleration_radps2: 0.0, ..drive };
            let segment = crate::drive_history::DriveSegment {
                duration_s: 0.02,
                drive,
                held_m: 0.0,
                steering_step_rad: 0.0,
            };
            motion.advance(&vehicle, &p, &MotionNoise::default(), &segment);
        }
        prop_assert!(motion.end_in_begin.log().norm() < 1e-9);
    }

    #[test]
    fn a_mirrored_reading_gives_the_mirrored_motion(
        vehicle in vehicles(), p in parameters(), drive in readings(),
    ) {
        let here = vehicle.motion(drive, &p);
        let there = mirrored_vehicle(vehicle).motion(mirrored_reading(drive), &mirrored_parameters(&p));
        prop_assert!(near(there.speed_mps, here.speed_mps));
        prop_assert!(near(there.yaw_rate_radps, -here.yaw_rate_radps));
        prop_assert!(near(there.side_speed_mps, -here.side_speed_mps));
    }
}
