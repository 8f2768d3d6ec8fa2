//! The mirrored and the reversed drive of a simulated vehicle: what left and right, forward and backward may
//! differ in.

use fleetcal_model::VehicleModel;
use proptest::prelude::*;

use super::imperfections::VehicleImperfections;
use super::plane::Pose2;
use super::vehicle::{Command, Motion, Slip, VehicleTruth};

const STEP_S: f64 = 0.001;
const STEPS: usize = 200;

/// Motion of a vehicle in one step.
#[derive(Debug, Clone, Copy)]
struct Step {
    /// Speed of the rear axle's middle over the ground, and to its left.
    speed_mps: f64,
    side_mps: f64,
    yaw_rate_radps: f64,
    steering_rad: f64,
    shown_mps: f64,
}

fn driven(
    vehicle: &VehicleTruth,
    imperfections: &VehicleImperfections,
    commands: &[Command],
) -> Vec<Step> {
    let mut motion = Motion::new(Pose2::default(), 7);
    let mut steps = Vec::new();
    for command in commands {
        for _ in 0..STEPS {
            let before = motion.base;
            motion.advance(vehicle, imperfections, command, STEP_S);
            let twist = before.between(&motion.base).log() / STEP_S;
            steps.push(Step {
                speed_mps: twist.x,
                side_mps: twist.y,
                yaw_rate_radps: twist.z,
                steering_rad: motion.step_steering_rad,
                shown_mps: vehicle.measured_speed_mps(imperfections, &motion),
            });
        }
    }
    steps
}

prop_compose! {
    fn vehicles()(
        is_tricycle in any::<bool>(),
        (steering_offset_rad, steering_gain, speed_scale) in (-0.1..0.1f64, 0.95..1.05f64, 0.95..1.05f64),
        lateral_rad_per_mps2 in 0.0..0.03f64,
    ) -> VehicleTruth {
        VehicleTruth {
            model: if is_tricycle { VehicleModel::Tricycle } else { VehicleModel::Bicycle },
            steering_offset_rad,
            steering_gain,
            speed_scale,
            slip: Slip { longitudinal_sigma: 0.002, lateral_rad_per_mps2 },
            ..VehicleTruth::default()
        }
    }
}

prop_compose! {
    fn imperfections()(
        (steering_gain, steering_asymmetry) in (-0.02..0.02f64, -0.03..0.03f64),
        (steering_quadratic_rad, steering_cubic_rad) in (-0.01..0.01f64, -0.01..0.01f64),
        (backlash_rad, steering_lag_s) in (0.0..0.02f64, 0.0..0.2f64),
        (wheel_sizes, speed_encoder_y_m) in (-0.03..0.03f64, -0.1..0.1f64),
        (side_slip_rad_per_mps2, understeer_rad_per_mps2) in (0.0..0.02f64, 0.0..0.03f64),
    ) -> VehicleImperfections {
        VehicleImperfections {
            steering_gain,
            steering_asymmetry,
            steering_quadratic_rad,
            steering_cubic_rad,
            backlash_rad,
            steering_lag_s,
            wheel_sizes,
            speed_encoder_y_m,
            side_slip_rad_per_mps2,
            understeer_rad_per_mps2,
            ..VehicleImperfections::default()
        }
    }
}

fn commands() -> impl Strategy<Value = Vec<Command>> {
    let one = (-1.5..1.5f64, -0.6..0.6f64).prop_map(|(speed_mps, measured_steering_rad)| Command {
        speed_mps,
        measured_steering_rad,
    });
    prop::collection::vec(one, 1..4)
}

fn near(a: f64, b: f64) -> bool {
    (a - b).abs() <= 1e-9
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(48))]

    #[test]
    fn the_mirrored_drive_moves_like_the_mirror_image(
        vehicle in vehicles(), imperfect in imperfections(), commands in commands(),
    ) {
        let mirrored_vehicle = VehicleTruth {
            steering_offset_rad: -vehicle.steering_offset_rad,
            ..vehicle
        };
        let mirrored_imperfect = VehicleImperfections {
            steering_asymmetry: -imperfect.steering_asymmetry,
            steering_quadratic_rad: -imperfect.steering_quadratic_rad,
            wheel_sizes: -imperfect.wheel_sizes,
            speed_encoder_y_m: -imperfect.speed_encoder_y_m,
            ..imperfect
        };
        let mirrored_commands: Vec<_> = commands.iter().map(|command| Command {
            measured_steering_rad: -command.measured_steering_rad,
            ..*command
        }).collect();
        let here = driven(&vehicle, &imperfect, &commands);
        let there = driven(&mirrored_vehicle, &mirrored_imperfect, &mirrored_commands);
        for (here, there) in here.iter().zip(&there) {
            prop_assert!(near(there.speed_mps, here.speed_mps));
            prop_assert!(near(there.side_mps, -here.side_mps));
            prop_assert!(near(there.yaw_rate_radps, -here.yaw_rate_radps));
            prop_assert!(near(there.shown_mps, here.shown_mps));
        }
    }

    /// Checks that without forces forward and backward are one track; with them the rear axle
    /// drifts to the same side, and understeer forwards becomes oversteer backwards.
    #[test]
    fn the_reversed_drive_turns_as_before_and_slips_outwards(
        vehicle in vehicles(), imperfect in imperfections(), commands in commands(),
    ) {
        let reversed_imperfect = VehicleImperfections {
            understeer_rad_per_mps2: -imperfect.understeer_rad_per_mps2,
            ..imperfect
        };
        let reversed_commands: Vec<_> = commands.iter().map(|command| Command {
            speed_mps: -command.speed_mps,
            ..*command
        }).collect();
        let here = driven(&vehicle, &imperfect, &commands);
        let there = driven(&vehicle, &reversed_imperfect, &reversed_commands);
        for (here, there) in here.iter().zip(&there) {
            prop_assert!(near(there.speed_mps, -here.speed_mps));
            prop_assert!(near(there.side_mps, here.side_mps));
            prop_assert!(near(there.yaw_rate_radps, -here.yaw_rate_radps));
            prop_assert!(near(there.shown_mps, -here.shown_mps));
        }
    }

    /// Checks that each axle slides against the force on it, by its own angle for each m/s² of
    /// lateral acceleration.
    #[test]
    fn both_axles_give_way_to_the_outside(
        vehicle in vehicles(), imperfect in imperfections(), commands in commands(),
    ) {
        let rear = vehicle.slip.lateral_rad_per_mps2 + imperfect.side_slip_rad_per_mps2;
        let front = rear + imperfect.understeer_rad_per_mps2;
        for step in driven(&vehicle, &imperfect, &commands) {
            let (v, yaw_rate) = (step.speed_mps, step.yaw_rate_radps);
            let gives_way = |slip: f64| -v.abs() * slip * v * yaw_rate;
            let off = |mps: f64, slip: f64| (mps - gives_way(slip)).abs();
            prop_assert!(off(step.side_mps, rear) < 2e-3 * gives_way(rear).abs() + 1e-9);
            // The front axle's speed to the left of where its wheel points, along the axle.
            let front_mps = step.side_mps + vehicle.wheelbase_m * yaw_rate - v * step.steering_rad.tan();
            prop_assert!(off(front_mps, front) < 2e-3 * gives_way(front).abs() + 1e-9);
        }
    }
}
