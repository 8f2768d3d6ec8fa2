//! The bicycle: the speed is known at the fixed axle, or at one wheel on it.

use super::{DriveParameters, DriveReading, Motion, Steering, by_parameters};

/// The paper's equations (2), in continuous time: `theta' = v tan(delta_true) / L`.
///
/// `L` is the place of the steered axle, negative behind the fixed one. A wheel `lateral_m` left of the centre rolls at `v (1 - lateral * kappa)` with the
/// curvature `kappa = tan(delta_true) / L`; at the centre itself the factor is 1. Reversed, that wheel rolls
/// the same circle: `lateral` stays, and changes sign mirrored.
pub(super) fn motion(
    drive: DriveReading,
    lateral_m: f64,
    steering: Steering,
    steered_at_m: f64,
    parameters: &DriveParameters,
) -> Motion {
    let (scale, wheelbase_m) = (parameters.speed_scale, parameters.wheelbase_m);
    let tan = steering.true_rad.tan();
    let kappa = tan / steered_at_m;
    let kappa_by_steering = (1.0 + tan * tan) / steered_at_m;
    let kappa_by_wheelbase = -kappa / wheelbase_m;

    let factor = 1.0 / (1.0 - lateral_m * kappa);
    let unscaled_mps = drive.speed_mps * factor;
    let speed_mps = scale * unscaled_mps;
    let speed_rate_mps2 = scale * drive.speed_rate_mps2 * factor;
    let speed_by_kappa = speed_mps * factor * lateral_m;
    let yaw_rate_by_kappa = speed_mps + kappa * speed_by_kappa;
    Motion {
        speed_mps,
        yaw_rate_radps: speed_mps * kappa,
        speed_by: by_parameters(
            speed_by_kappa * kappa_by_steering,
            unscaled_mps,
            speed_by_kappa * kappa_by_wheelbase,
            speed_rate_mps2,
            steering,
        ),
        yaw_rate_by: by_parameters(
            yaw_rate_by_kappa * kappa_by_steering,
            unscaled_mps * kappa,
            yaw_rate_by_kappa * kappa_by_wheelbase,
            speed_rate_mps2 * kappa,
            steering,
        ),
        yaw_rate_by_steering: yaw_rate_by_kappa * kappa_by_steering,
        ..Motion::default()
    }
}
