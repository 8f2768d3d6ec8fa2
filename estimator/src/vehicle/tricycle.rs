//! The tricycle: the speed is known at the steered front wheel.

use super::{DriveParameters, Motion, Steering, by_parameters};

/// `v = v_front cos(delta_true)`, `theta' = v_front sin(delta_true) / L`.
pub(super) fn motion(
    measured_mps: f64,
    steering: Steering,
    parameters: &DriveParameters,
) -> Motion {
    let (scale, wheelbase_m) = (parameters.speed_scale, parameters.wheelbase_m);
    let (sin, cos) = steering.true_rad.sin_cos();
    let front_mps = scale * measured_mps;
    let yaw_rate_radps = front_mps * sin / wheelbase_m;
    let yaw_rate_by_steering = front_mps * cos / wheelbase_m;
    Motion {
        speed_mps: front_mps * cos,
        yaw_rate_radps,
        speed_by: by_parameters(-front_mps * sin, measured_mps * cos, 0.0, steering),
        yaw_rate_by: by_parameters(
            yaw_rate_by_steering,
            measured_mps * sin / wheelbase_m,
            -yaw_rate_radps / wheelbase_m,
            steering,
        ),
        yaw_rate_by_steering,
        ..Motion::default()
    }
}
