//! Vehicle models: the fixed axle's motion by measured speed and steering.
//!
//! `base` lies on the fixed axle: at the rear, or in front where a vehicle steers at the rear. The
//! steered axle is at the wheelbase before or behind it ([`VehicleModel::steered_ahead`]).
//!
//! A place of the speed's measurement is one file with one function, `motion`: it returns the axle's
//! speed and yaw rate and their derivatives by the parameters. Everything else (prediction, initial guess, advice) is
//! written on [`Motion`] and knows no model.
//!
//! Each term is named with its behaviour when the drive is *mirrored* (left for right: steering,
//! yaw rate and side speed change sign) and when it is *reversed* (the same steering, the speed
//! with the other sign). Geometry is the same both ways, so that speed and yaw rate change sign
//! with the measured speed; tyres give way against a force, which `v theta'` does not turn with the
//! speed.

mod bicycle;
#[cfg(test)]
mod parity_tests;
mod tricycle;

pub use fleetcal_model::{SpeedMeasuredAt, VehicleModel};
use serde::{Deserialize, Serialize};

/// Largest steering angle of a vehicle whose speed is measured at its rear axle, rad: at 80 degrees
/// it turns about a point within a fifth of its wheelbase, beyond 90 the equations turn it backwards.
const STEERING_BEFORE_REAR_AXLE_MAX_RAD: f64 = 1.396;

/// A vehicle as it is configured.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Vehicle {
    /// Steering geometry.
    pub model: VehicleModel,
    /// Distance from the fixed axle to the steered one, m.
    pub wheelbase_m: f64,
    /// Place where its speed is measured.
    pub speed_measured_at: SpeedMeasuredAt,
}

/// Reading of the drive sensors, before any correction.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
pub struct DriveReading {
    /// Measured speed, m/s.
    pub speed_mps: f64,
    /// Its rate, m/s^2.
    pub speed_rate_mps2: f64,
    /// Steering angle measured `steering_before_s` before the speed, rad.
    pub steering_rad: f64,
    /// Its rate there, rad/s.
    pub steering_rate_radps: f64,
    /// Its second derivative there, rad/s^2.
    pub steering_acceleration_radps2: f64,
    /// Side of its play that the steering is on there: 1 after it turned left, -1 after it turned
    /// right.
    pub play_side: f64,
    /// The response of the wheel to its sensor that is already in the angle.
    pub response: SteeringResponse,
    /// Speed (m/s) and steering angle (rad) without the noise of single readings, where known.
    pub smoothed: Option<[f64; 2]>,
}

impl DriveReading {
    /// The reading without the noise of single ones, where that is known.
    #[must_use]
    pub fn without_noise(self) -> Option<Self> {
        let [speed_mps, steering_rad] = self.smoothed?;
        Some(Self {
            speed_mps,
            steering_rad,
            ..self
        })
    }
}

/// The parameters a vehicle model depends on.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct DriveParameters {
    /// `delta_off`, rad. Mirrored it changes sign, as every angle to the left; reversed it stays: the
    /// sensor does not know which way the wheels roll.
    pub steering_offset_rad: f64,
    /// True speed over measured speed. Stays both ways: a wheel's size is one number.
    pub speed_scale: f64,
    /// Wheelbase, m. Stays both ways.
    pub wheelbase_m: f64,
    /// True steering angle over measured one, after the offset. Stays both ways.
    pub steering_gain: f64,
    /// Slip angle of the rear axle, outwards, for each m/s^2 of lateral acceleration, rad. Stays both
    /// ways, and so does the side speed that it makes of a reversed drive: the force points into the
    /// bend whichever way it is driven.
    pub side_slip_rad_per_mps2: f64,
    /// Steering beyond offset and gain.
    pub curve: SteeringCurve,
    /// Response of the wheel to its sensor in time.
    pub response: SteeringResponse,
    /// Half of the play between sensor and wheel, rad: the wheel stays behind by so much. Stays both
    /// ways: friction holds the wheel where the sensor's side last pushed it. That a wheel with caster
    /// lies on the other side of its play when it is pushed instead of pulled is not modelled.
    pub half_play_rad: f64,
}

/// Response of the wheel to its sensor, in time and not along the way, so that it stays mirrored
/// and reversed: the first two cumulants of its impulse response. A pure delay `d` has (d, 0), a
/// first-order lag `t` (t, t^2); the wheel stands at
/// `delta(t - lag) + spread / 2 delta''(t - lag)`, to third order in time.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
pub struct SteeringResponse {
    /// Mean delay of the wheel behind its sensor, s; negative where the sensor is late.
    pub lag_s: f64,
    /// Variance of that delay, s^2; negative where the sensor smooths.
    pub spread_s2: f64,
}

/// Departure of a true steering angle from a straight line over the measured one. With `u` the
/// measured angle less its offset, the true angle is
/// `(gain + asymmetry sign(u)) u + quadratic u^2 + cubic u^3`. Reversed it stays: it is the
/// linkage's geometry, and no force is in it.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
pub struct SteeringCurve {
    /// Share by which the gain is larger to the left and smaller to the right; even in `u`, so that
    /// it changes sign mirrored.
    pub asymmetry: f64,
    /// Quadratic term, 1/rad; even in `u`, so that it changes sign mirrored.
    pub quadratic_per_rad: f64,
    /// Cubic term, 1/rad^2; odd in `u`, so that it stays mirrored.
    pub cubic_per_rad2: f64,
}

/// Number of parameters that [`Motion`]'s derivatives are by.
pub const DRIVE_PARAMETERS: usize = 12;
/// Index of the lag of the steering among them,
pub const BY_STEERING_LAG: usize = 8;
/// and of a lead of the speed: the delay of its measurement.
pub const BY_SPEED_LEAD: usize = 11;

/// The rear axle's motion, with derivatives by (steering offset, speed scale, wheelbase, gain, side
/// slip, asymmetry, quadratic term, cubic term, lag and spread of the steering's response, half its play,
/// lead of the speed).
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Motion {
    /// Speed of the rear axle along x of `base`, m/s.
    pub speed_mps: f64,
    /// Yaw rate, rad/s.
    pub yaw_rate_radps: f64,
    /// Speed of the rear axle to its left, m/s: side slip.
    pub side_speed_mps: f64,
    /// Derivatives of the speed.
    pub speed_by: [f64; DRIVE_PARAMETERS],
    /// Derivatives of the side speed.
    pub side_speed_by: [f64; DRIVE_PARAMETERS],
    /// Derivatives of the yaw rate.
    pub yaw_rate_by: [f64; DRIVE_PARAMETERS],
    /// Derivative of the yaw rate by the true steering angle, 1/s: how far steering noise turns.
    pub yaw_rate_by_steering: f64,
}

impl Vehicle {
    /// A vehicle whose speed is measured where its model usually measures it.
    pub fn new(model: VehicleModel, wheelbase_m: f64) -> Self {
        Self {
            model,
            wheelbase_m,
            speed_measured_at: model.speed_measured_at(),
        }
    }

    /// True if such a vehicle can steer that far. A driven wheel that is steered may turn by 90
    /// degrees and more.
    pub fn can_steer(&self, steering_rad: f64) -> bool {
        match self.speed_measured_at {
            SpeedMeasuredAt::RearAxle | SpeedMeasuredAt::RearWheel { .. } => {
                steering_rad.abs() <= STEERING_BEFORE_REAR_AXLE_MAX_RAD
            }
            SpeedMeasuredAt::SteeredWheel => true,
        }
    }

    /// Place of the steered axle along x of `base`, m: behind the fixed axle it is negative.
    fn steered_at_m(&self, wheelbase_m: f64) -> f64 {
        self.model.steered_ahead() * wheelbase_m
    }

    /// True if a linkage is between sensor and wheels. The sensor of a wheel that is steered and
    /// driven sits on its axis.
    pub fn has_linkage(&self) -> bool {
        match self.model {
            VehicleModel::Bicycle => true,
            VehicleModel::Tricycle => false,
            VehicleModel::RearSteered => self.speed_measured_at != SpeedMeasuredAt::SteeredWheel,
        }
    }

    /// The speed and steering angle that this vehicle's sensors would measure, without any error,
    /// while its rear axle moves so: the inverse of [`Self::motion`], m/s and rad. At rest the angle
    /// is 0.
    pub fn reading_of(&self, speed_mps: f64, yaw_rate_radps: f64) -> (f64, f64) {
        let tan = self.steered_at_m(self.wheelbase_m) * yaw_rate_radps / speed_mps;
        let steering_rad = if tan.is_finite() { tan.atan() } else { 0.0 };
        let measured_mps = match self.speed_measured_at {
            SpeedMeasuredAt::RearAxle => speed_mps,
            SpeedMeasuredAt::RearWheel { lateral_m } => speed_mps - lateral_m * yaw_rate_radps,
            SpeedMeasuredAt::SteeredWheel => speed_mps / steering_rad.cos(),
        };
        (measured_mps, steering_rad)
    }

    /// The rear axle's motion under a drive reading.
    pub fn motion(&self, drive: DriveReading, parameters: &DriveParameters) -> Motion {
        let steering = Steering::of(drive, parameters);
        let at_m = self.steered_at_m(parameters.wheelbase_m);
        let rolling = match self.speed_measured_at {
            SpeedMeasuredAt::RearAxle => bicycle::motion(drive, 0.0, steering, at_m, parameters),
            SpeedMeasuredAt::RearWheel { lateral_m } => {
                bicycle::motion(drive, lateral_m, steering, at_m, parameters)
            }
            SpeedMeasuredAt::SteeredWheel => tricycle::motion(drive, steering, at_m, parameters),
        };
        with_side_slip(&rolling, parameters.side_slip_rad_per_mps2)
    }
}

/// Tyres drift outwards by an angle that grows with the lateral acceleration `v theta'`, which points
/// into the bend forwards and backwards alike; the ground passes under them at `|v|`:
/// `v_y = -c |v| v theta'`, odd when mirrored, even when reversed.
fn with_side_slip(rolling: &Motion, slip: f64) -> Motion {
    let (v, yaw_rate) = (rolling.speed_mps, rolling.yaw_rate_radps);
    let mut motion = *rolling;
    motion.side_speed_mps = -slip * v.abs() * v * yaw_rate;
    for (by, (speed_by, yaw_by)) in motion
        .side_speed_by
        .iter_mut()
        .zip(rolling.speed_by.iter().zip(&rolling.yaw_rate_by))
    {
        *by = -slip * v.abs() * (2.0 * yaw_rate * speed_by + v * yaw_by);
    }
    let [_, _, _, _, by_slip, ..] = &mut motion.side_speed_by;
    *by_slip = -v.abs() * v * yaw_rate;
    motion
}

/// The true steering angle and its derivatives by steering offset, gain, curve, response and play.
#[derive(Debug, Clone, Copy)]
struct Steering {
    true_rad: f64,
    by_offset: f64,
    by_gain: f64,
    by_asymmetry: f64,
    by_quadratic: f64,
    by_cubic: f64,
    by_lag: f64,
    by_spread: f64,
    by_play: f64,
}

impl Steering {
    fn of(drive: DriveReading, parameters: &DriveParameters) -> Self {
        let curve = &parameters.curve;
        // To first order in what of the response is not in the reading.
        let lag_s = parameters.response.lag_s - drive.response.lag_s;
        let spread_s2 = parameters.response.spread_s2 - drive.response.spread_s2;
        let (rate_radps, bend_radps2) = (
            drive.steering_rate_radps,
            0.5 * drive.steering_acceleration_radps2,
        );
        let followed_rad = drive.steering_rad - lag_s * rate_radps + spread_s2 * bend_radps2;
        let behind_rad = parameters.half_play_rad * drive.play_side;
        let raw = followed_rad - behind_rad - parameters.steering_offset_rad;
        let slope = parameters.steering_gain
            + curve.asymmetry * raw.signum()
            + 2.0 * curve.quadratic_per_rad * raw
            + 3.0 * curve.cubic_per_rad2 * raw * raw;
        Self {
            true_rad: parameters.steering_gain * raw
                + curve.asymmetry * raw.abs()
                + curve.quadratic_per_rad * raw.powi(2)
                + curve.cubic_per_rad2 * raw.powi(3),
            by_offset: -slope,
            by_lag: -slope * rate_radps,
            by_spread: slope * bend_radps2,
            by_play: -slope * drive.play_side,
            by_gain: raw,
            by_asymmetry: raw.abs(),
            by_quadratic: raw.powi(2),
            by_cubic: raw.powi(3),
        }
    }
}

/// The true steering angle of a wheel that has followed a measured one and taken up no play, rad, with its
/// derivatives in the order of [`Motion`]'s.
pub fn true_steering(
    measured_rad: f64,
    parameters: &DriveParameters,
) -> (f64, [f64; DRIVE_PARAMETERS]) {
    let drive = DriveReading {
        steering_rad: measured_rad,
        ..DriveReading::default()
    };
    let steering = Steering::of(drive, parameters);
    (
        steering.true_rad,
        by_parameters(1.0, 0.0, 0.0, 0.0, steering),
    )
}

/// Chain rule: from derivatives by (steering, speed scale, wheelbase) to those by the parameters, the last of
/// which is `by_lead`.
fn by_parameters(
    by_steering: f64,
    by_scale: f64,
    by_wheelbase: f64,
    by_lead: f64,
    s: Steering,
) -> [f64; DRIVE_PARAMETERS] {
    [
        by_steering * s.by_offset,
        by_scale,
        by_wheelbase,
        by_steering * s.by_gain,
        0.0,
        by_steering * s.by_asymmetry,
        by_steering * s.by_quadratic,
        by_steering * s.by_cubic,
        by_steering * s.by_lag,
        by_steering * s.by_spread,
        by_steering * s.by_play,
        by_lead,
    ]
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn shifted(p: &DriveParameters, index: usize, by: f64) -> DriveParameters {
        let mut q = *p;
        match index {
            0 => q.steering_offset_rad += by,
            1 => q.speed_scale += by,
            2 => q.wheelbase_m += by,
            3 => q.steering_gain += by,
            4 => q.side_slip_rad_per_mps2 += by,
            5 => q.curve.asymmetry += by,
            6 => q.curve.quadratic_per_rad += by,
            7 => q.curve.cubic_per_rad2 += by,
            8 => q.response.lag_s += by,
            9 => q.response.spread_s2 += by,
            10 => q.half_play_rad += by,
            _ => {}
        }
        q
    }

    impl DriveParameters {
        /// Parameters of sensors without any error.
        fn exact(wheelbase_m: f64) -> Self {
            Self {
                steering_offset_rad: 0.0,
                speed_scale: 1.0,
                wheelbase_m,
                steering_gain: 1.0,
                side_slip_rad_per_mps2: 0.0,
                curve: SteeringCurve::default(),
                response: SteeringResponse::default(),
                half_play_rad: 0.0,
            }
        }
    }

    fn vehicle() -> impl Strategy<Value = Vehicle> {
        prop_oneof![
            Just(Vehicle::new(VehicleModel::Bicycle, 1.2)),
            Just(Vehicle::new(VehicleModel::Tricycle, 1.5)),
            Just(Vehicle::new(VehicleModel::RearSteered, 1.5)),
            Just(Vehicle {
                model: VehicleModel::RearSteered,
                wheelbase_m: 1.5,
                speed_measured_at: SpeedMeasuredAt::SteeredWheel,
            }),
            Just(Vehicle {
                model: VehicleModel::Bicycle,
                wheelbase_m: 1.2,
                speed_measured_at: SpeedMeasuredAt::RearWheel { lateral_m: 0.4 },
            }),
        ]
    }

    #[test]
    fn only_a_driven_wheel_can_be_steered_across_the_vehicle() {
        let bicycle = Vehicle::new(VehicleModel::Bicycle, 1.2);
        let tricycle = Vehicle::new(VehicleModel::Tricycle, 1.2);
        assert!(bicycle.can_steer(-1.3) && !bicycle.can_steer(-1.4));
        assert!(tricycle.can_steer(1.6));
    }

    proptest! {
        #[test]
        fn a_reading_is_of_the_motion_that_it_makes(
            vehicle in vehicle(),
            speed_mps in prop_oneof![-2.0..-0.1f64, 0.1..2.0f64],
            curvature in -0.5..0.5f64,
        ) {
            let (speed, steering_rad) = vehicle.reading_of(speed_mps, speed_mps * curvature);
            let drive = DriveReading { speed_mps: speed, steering_rad, ..DriveReading::default() };
            let motion = vehicle.motion(drive, &DriveParameters::exact(vehicle.wheelbase_m));
            prop_assert!((motion.speed_mps - speed_mps).abs() < 1e-9);
            prop_assert!((motion.yaw_rate_radps - speed_mps * curvature).abs() < 1e-9);
        }

        #[test]
        fn derivatives_match_differences(
            vehicle in vehicle(),
            speed_mps in -2.0..2.0f64,
            steering_rad in -0.8..0.8f64,
            offset in -0.15..0.15f64,
        ) {
            let drive = DriveReading {
                speed_mps,
                steering_rad,
                speed_rate_mps2: -0.6,
                steering_rate_radps: 0.4,
                steering_acceleration_radps2: 2.0,
                play_side: -0.7,
                smoothed: None,
                response: SteeringResponse { lag_s: 0.05, spread_s2: 0.0 },
            };
            let p = DriveParameters {
                steering_offset_rad: offset,
                speed_scale: 1.01,
                wheelbase_m: vehicle.wheelbase_m,
                steering_gain: 0.98,
                side_slip_rad_per_mps2: 0.01,
                curve: SteeringCurve { asymmetry: 0.01, quadratic_per_rad: 0.04, cubic_per_rad2: 0.1 },
                response: SteeringResponse { lag_s: 0.1, spread_s2: 0.01 },
                half_play_rad: 0.004,
            };
            let motion = vehicle.motion(drive, &p);
            for i in 0..DRIVE_PARAMETERS {
                let h = 1e-6;
                let moved = |by: f64| {
                    let lead_s = if i == BY_SPEED_LEAD { by } else { 0.0 };
                    let speed_mps = speed_mps + lead_s * drive.speed_rate_mps2;
                    vehicle.motion(DriveReading { speed_mps, ..drive }, &shifted(&p, i, by))
                };
                let (up, down) = (moved(h), moved(-h));
                let speed_by = (up.speed_mps - down.speed_mps) / (2.0 * h);
                let yaw_by = (up.yaw_rate_radps - down.yaw_rate_radps) / (2.0 * h);
                let side_by = (up.side_speed_mps - down.side_speed_mps) / (2.0 * h);
                prop_assert!((side_by - motion.side_speed_by[i]).abs() < 1e-6);
                prop_assert!((speed_by - motion.speed_by[i]).abs() < 1e-6);
                prop_assert!((yaw_by - motion.yaw_rate_by[i]).abs() < 1e-6);
            }
        }
    }

    #[test]
    fn steering_left_of_the_offset_turns_left() {
        let vehicle = Vehicle::new(VehicleModel::Bicycle, 1.2);
        let p = DriveParameters {
            steering_offset_rad: 0.05,
            ..DriveParameters::exact(1.2)
        };
        let motion = vehicle.motion(
            DriveReading {
                speed_mps: 1.0,
                steering_rad: 0.06,
                ..DriveReading::default()
            },
            &p,
        );
        assert!((motion.yaw_rate_radps - 0.01f64.tan() / 1.2).abs() < 1e-12);
    }
}
