//! The tricycle: the speed is known at the steered wheel.

use super::{DriveParameters, DriveReading, Motion, Steering, by_parameters};

/// `v = v_front cos(delta_true)`, `theta' = v_front sin(delta_true) / L`: odd in the speed, and mirrored
/// the one is even, the other odd. `L` is the place of the wheel, negative behind the fixed axle.
pub(super) fn motion(
    drive: DriveReading,
    steering: Steering,
    steered_at_m: f64,
    parameters: &DriveParameters,
) -> Motion {
    let (scale, wheelbase_m) = (parameters.speed_scale, parameters.wheelbase_m);
    let (sin, cos) = steering.true_rad.sin_cos();
    let front_mps = scale * drive.speed_mps;
    let front_rate_mps2 = scale * drive.speed_rate_mps2;
    let yaw_rate_radps = front_mps * sin / steered_at_m;
    let yaw_rate_by_steering = front_mps * cos / steered_at_m;
    Motion {
        speed_mps: front_mps * cos,
        yaw_rate_radps,
        speed_by: by_parameters(
            -front_mps * sin,
            drive.speed_mps * cos,
            0.0,
            front_rate_mps2 * cos,
            steering,
        ),
        yaw_rate_by: by_parameters(
            yaw_rate_by_steering,
            drive.speed_mps * sin / steered_at_m,
            -yaw_rate_radps / wheelbase_m,
            front_rate_mps2 * sin / steered_at_m,
            steering,
        ),
        yaw_rate_by_steering,
        ..Motion::default()
    }
}
