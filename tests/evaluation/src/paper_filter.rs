//! The paper's own filter, equation by equation and in its letters: seven states, Euler steps, and the
//! LiDAR's motion since the first pose as a measurement with white noise.
//!
//! Each step names its equation and, behind the arrow, the file of the estimator that extends it;
//! `docs/paper.md` has them in one table. The expanded equations 7 parametrise the inverse of the mount, the
//! pose of the rear axle in the LiDAR's frame, although the text means the mount itself. Both readings are here.

#![expect(non_snake_case, reason = "matrices have the paper's letters")]

use fleetcal_estimator::geometry::{Pose2, wrap_angle_rad};
use fleetcal_estimator::vehicle::DriveReading;
use nalgebra::{Matrix2, Matrix3, SMatrix, SVector, Vector2, Vector3};

/// Position (3), extrinsics (3) and steering offset: `s_k`.
type State = SVector<f64, 7>;
type Covariance = SMatrix<f64, 7, 7>;
type Jacobian = SMatrix<f64, 3, 7>;
/// Derivatives by the input `u_k`: speed and measured steering angle.
type ByInput = SMatrix<f64, 7, 2>;

/// Form of the measurement's equations.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Equations {
    /// The paper's expanded equations, letter by letter.
    AsPrinted,
    /// Its compact equation `X^-1 B_0^-1 B_k X`, expanded rightly.
    Compact,
}

/// Parameters that the paper calls tunable.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Tuning {
    /// Standard deviation of a speed, m/s.
    pub speed_mps: f64,
    /// Standard deviation of a steering angle, rad.
    pub steering_rad: f64,
    /// Random walk of the extrinsics (m, rad) and the steering offset (rad), per root second.
    pub walk_per_sqrt_s: f64,
    /// Standard deviation of a LiDAR pose: position, m.
    pub position_m: f64,
    /// Standard deviation of a LiDAR pose: heading, rad.
    pub yaw_rad: f64,
}

/// Belief at the start: the mount, its uncertainty (m and rad) and that of the steering offset.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Start {
    /// The mount.
    pub mount: Pose2,
    /// Standard deviation of its position, m.
    pub position_m: f64,
    /// Standard deviation of its yaw, rad.
    pub yaw_rad: f64,
    /// Standard deviation of the steering offset, which starts at zero, rad.
    pub steering_rad: f64,
}

/// The filter.
#[derive(Debug, Clone)]
pub struct PaperFilter {
    equations: Equations,
    tuning: Tuning,
    wheelbase_m: f64,
    /// Mean and covariance of the belief.
    s: State,
    P: Covariance,
    /// The first LiDAR pose.
    L_0: Option<Pose2>,
}

impl PaperFilter {
    /// A filter before its first LiDAR pose.
    pub fn new(equations: Equations, tuning: Tuning, start: &Start, wheelbase_m: f64) -> Self {
        let Start {
            mount,
            position_m,
            yaw_rad,
            steering_rad,
        } = start;
        let sigma = State::from([
            0.0,
            0.0,
            0.0,
            *position_m,
            *position_m,
            *yaw_rad,
            *steering_rad,
        ]);
        Self {
            equations,
            tuning,
            wheelbase_m,
            s: State::from([0.0, 0.0, 0.0, mount.x_m, mount.y_m, mount.yaw_rad, 0.0]),
            P: Covariance::from_diagonal(&sigma.component_mul(&sigma)),
            L_0: None,
        }
    }

    /// Extrinsics (m, m, rad) and steering offset (rad).
    pub fn values(&self) -> [f64; 4] {
        [self.s[3], self.s[4], self.s[5], self.s[6]]
    }

    /// Their covariance.
    pub fn covariance(&self) -> SMatrix<f64, 4, 4> {
        self.P.fixed_view::<4, 4>(3, 3).into_owned()
    }

    /// Predicts over `dt_s` (equation 10) → `filter/prediction.rs`. Nothing before the first LiDAR pose.
    pub fn predict(&mut self, u: DriveReading, dt_s: f64) {
        if self.L_0.is_none() {
            return;
        }
        let (F, G) = self.F_and_G(u, dt_s);
        self.s = self.f(u, dt_s);
        self.P = F * self.P * F.transpose() + G * self.Q() * G.transpose();
        // Equation 4: extrinsics and steering offset walk → `filter/prior.rs`.
        for i in 3..7 {
            self.P[(i, i)] += self.tuning.walk_per_sqrt_s.powi(2) * dt_s;
        }
    }

    /// Updates with a LiDAR pose in its odometry frame (equations 11 and 12) → `filter/mod.rs`. The first
    /// one is `L_0`.
    pub fn update(&mut self, L_k: &Pose2) {
        let Some(L_0) = self.L_0 else {
            self.L_0 = Some(*L_k);
            return;
        };
        let z = L_0.between(L_k);
        let (h, H) = self.h_and_H();
        let mut r = Vector3::new(z.x_m, z.y_m, z.yaw_rad) - h;
        r[2] = wrap_angle_rad(r[2]);
        let PHt = self.P * H.transpose();
        let Some(S) = (H * PHt + self.R()).cholesky() else {
            return;
        };
        let K = PHt * S.inverse();
        self.s += K * r;
        self.P -= K * PHt.transpose();
        self.P = (self.P + self.P.transpose()) * 0.5;
    }

    /// Motion model `f(s_k, u_k)`: equation 3 with the true steering angle of equation 1 →
    /// `vehicle/bicycle.rs`, by exact arcs.
    fn f(&self, u: DriveReading, dt_s: f64) -> State {
        let (v, theta) = (u.speed_mps, self.s[2]);
        let delta_true = u.steering_rad - self.s[6];
        let (sin, cos) = theta.sin_cos();
        let curvature = delta_true.tan() / self.wheelbase_m;
        let mut s = self.s;
        s[0] += v * cos * dt_s;
        s[1] += v * sin * dt_s;
        s[2] += v * curvature * dt_s;
        s
    }

    /// Jacobians `F_k` and `G_k` of the motion model (equation 5) → `vehicle/mod.rs`.
    fn F_and_G(&self, u: DriveReading, dt_s: f64) -> (Covariance, ByInput) {
        let (v, theta) = (u.speed_mps, self.s[2]);
        let delta_true = u.steering_rad - self.s[6];
        let (sin, cos) = theta.sin_cos();
        let curvature = delta_true.tan() / self.wheelbase_m;
        let by_steering = v * dt_s / (self.wheelbase_m * delta_true.cos().powi(2));
        let mut F = Covariance::identity();
        F[(0, 2)] = -v * sin * dt_s;
        F[(1, 2)] = v * cos * dt_s;
        F[(2, 6)] = -by_steering;
        let mut G = ByInput::zeros();
        G[(0, 0)] = cos * dt_s;
        G[(1, 0)] = sin * dt_s;
        G[(2, 0)] = curvature * dt_s;
        G[(2, 1)] = by_steering;
        (F, G)
    }

    /// Covariance of the input → `motion_noise.rs`, for each root metre instead.
    fn Q(&self) -> Matrix2<f64> {
        let sigma = [self.tuning.speed_mps, self.tuning.steering_rad];
        Matrix2::from_diagonal(&Vector2::from(sigma.map(|sigma| sigma.powi(2))))
    }

    /// Covariance of a LiDAR pose → `fleetcal_odometry`, which states one for each pose.
    fn R(&self) -> Matrix3<f64> {
        let (m, rad) = (self.tuning.position_m, self.tuning.yaw_rad);
        let sigma = Vector3::new(m, m, rad);
        Matrix3::from_diagonal(&sigma.component_mul(&sigma))
    }

    /// Measurement model `h(s_k)` and its Jacobian `H_k` (equations 7 and 8), made of the motion-based
    /// calibration constraint (equation 6) → `filter/constraint.rs`.
    fn h_and_H(&self) -> (Vector3<f64>, Jacobian) {
        match self.equations {
            Equations::AsPrinted => self.as_printed(),
            Equations::Compact => self.compact(),
        }
    }

    /// Both as printed, with `B_0` the origin.
    fn as_printed(&self) -> (Vector3<f64>, Jacobian) {
        let [dx, dy, turned, x, y, yaw, _] = self.s.data.0[0];
        let (sin_turned, cos_turned) = turned.sin_cos();
        let (sin, cos) = yaw.sin_cos();
        let predicted = Vector3::new(
            (1.0 - cos_turned) * x + sin_turned * y + cos * dx - sin * dy,
            -sin_turned * x + (1.0 - cos_turned) * y + sin * dx + cos * dy,
            turned,
        );
        let jacobian = Jacobian::from_row_slice(&[
            cos,
            -sin,
            sin_turned * x + cos_turned * y,
            1.0 - cos_turned,
            sin_turned,
            -sin * dx - cos * dy,
            0.0,
            sin,
            cos,
            -cos_turned * x + sin_turned * y,
            -sin_turned,
            1.0 - cos_turned,
            cos * dx - sin * dy,
            0.0,
            0.0,
            0.0,
            1.0,
            0.0,
            0.0,
            0.0,
            0.0,
        ]);
        (predicted, jacobian)
    }

    /// Both of `X^-1 B_k X`, with `B_0` the origin and `X` for `T^B_L`.
    fn compact(&self) -> (Vector3<f64>, Jacobian) {
        let [dx, dy, turned, x, y, yaw, _] = self.s.data.0[0];
        let (sin_turned, cos_turned) = turned.sin_cos();
        let (sin, cos) = yaw.sin_cos();
        // The LiDAR's way in the frame of B_0, then seen from the LiDAR.
        let across_x = (cos_turned - 1.0) * x - sin_turned * y + dx;
        let across_y = sin_turned * x + (cos_turned - 1.0) * y + dy;
        let by_turn = (
            -sin_turned * x - cos_turned * y,
            cos_turned * x - sin_turned * y,
        );
        let seen =
            |along: f64, across: f64| (cos * along + sin * across, cos * across - sin * along);
        let predicted = seen(across_x, across_y);
        let columns = [
            seen(1.0, 0.0),
            seen(0.0, 1.0),
            seen(by_turn.0, by_turn.1),
            seen(cos_turned - 1.0, sin_turned),
            seen(-sin_turned, cos_turned - 1.0),
            (predicted.1, -predicted.0),
            (0.0, 0.0),
        ];
        let mut jacobian = Jacobian::zeros();
        for (i, (along, across)) in columns.into_iter().enumerate() {
            jacobian[(0, i)] = along;
            jacobian[(1, i)] = across;
        }
        jacobian[(2, 2)] = 1.0;
        (Vector3::new(predicted.0, predicted.1, turned), jacobian)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use fleetcal_estimator::drive_history::DriveSegment;
    use fleetcal_estimator::filter::prediction::PredictedMotion;
    use fleetcal_estimator::motion_noise::MotionNoise;
    use fleetcal_estimator::vehicle::{
        DriveParameters, SteeringCurve, SteeringResponse, Vehicle, VehicleModel,
    };

    const TUNING: Tuning = Tuning {
        speed_mps: 0.01,
        steering_rad: 0.001,
        walk_per_sqrt_s: 0.0,
        position_m: 0.002,
        yaw_rad: 0.000_5,
    };

    fn filter(equations: Equations, mount: Pose2, body: Pose2) -> PaperFilter {
        let start = Start {
            mount,
            position_m: 1.0,
            yaw_rad: 0.3,
            steering_rad: 0.1,
        };
        let mut filter = PaperFilter::new(equations, TUNING, &start, 1.2);
        filter.s[0] = body.x_m;
        filter.s[1] = body.y_m;
        filter.s[2] = body.yaw_rad;
        filter
    }

    #[test]
    fn the_compact_form_is_the_constraint_and_the_printed_one_that_of_the_inverse() {
        let (mount, body) = (Pose2::new(0.434, -0.1, 0.3), Pose2::new(2.0, 1.5, 0.9));
        let constraint = |x: &Pose2| x.inverse().compose(&body).compose(x);
        for (equations, expected) in [
            (Equations::Compact, constraint(&mount)),
            (Equations::AsPrinted, constraint(&mount.inverse())),
        ] {
            let filter = filter(equations, mount, body);
            let (predicted, jacobian) = filter.h_and_H();
            let expected = Vector3::new(expected.x_m, expected.y_m, expected.yaw_rad);
            assert!((predicted - expected).norm() < 1e-12, "{equations:?}");
            for i in 0..7 {
                let mut moved = filter.clone();
                moved.s[i] += 1e-6;
                let (after, _) = moved.h_and_H();
                let numeric = (after - predicted) * 1e6;
                assert!(
                    (numeric - jacobian.column(i)).norm() < 1e-5,
                    "{equations:?}, column {i}"
                );
            }
        }
    }

    /// A noiseless figure-eight by the filter's own Euler steps: it must find its own truth.
    #[test]
    fn it_finds_a_mount_on_data_of_its_own_model() {
        let (mount, offset_rad) = (Pose2::new(0.434, 0.02, 0.05), 0.02);
        let start = Start {
            mount: Pose2::IDENTITY,
            position_m: 1.0,
            yaw_rad: 0.3,
            steering_rad: 0.1,
        };
        let mut found = PaperFilter::new(Equations::Compact, TUNING, &start, 1.2);
        let mut body = Pose2::IDENTITY;
        for step in 0..6000 {
            let lidar = mount.inverse().compose(&body).compose(&mount);
            if step % 10 == 0 {
                found.update(&lidar);
            }
            let steering_rad = 0.3 * (f64::from(step) * 0.003).sin();
            let drive = DriveReading {
                speed_mps: 1.0,
                steering_rad: steering_rad + offset_rad,
                ..DriveReading::default()
            };
            found.predict(drive, 0.01);
            let yaw_rad = body.yaw_rad + 0.01 * steering_rad.tan() / 1.2;
            body = Pose2::new(
                body.x_m + 0.01 * body.yaw_rad.cos(),
                body.y_m + 0.01 * body.yaw_rad.sin(),
                yaw_rad,
            );
        }
        let truth = [mount.x_m, mount.y_m, mount.yaw_rad, offset_rad];
        for (value, truth) in found.values().into_iter().zip(truth) {
            assert!((value - truth).abs() < 1e-3, "{value} for {truth}");
        }
    }

    /// Equation 3 is what the estimator left first: seen from its end, a mount that is moved by `v dt / 2`
    /// explains the difference to an arc, so that `x_off` is off by as much.
    #[test]
    fn an_euler_step_is_half_a_step_behind_the_arc() {
        let (dt_s, wheelbase_m) = (0.01, 1.2);
        let drive = DriveReading {
            speed_mps: 1.0,
            steering_rad: 0.4,
            ..DriveReading::default()
        };
        let mut euler = filter(Equations::Compact, Pose2::IDENTITY, Pose2::IDENTITY);
        let mut arc = PredictedMotion::none();
        let vehicle = Vehicle::new(VehicleModel::Bicycle, wheelbase_m);
        let parameters = DriveParameters {
            steering_offset_rad: 0.0,
            speed_scale: 1.0,
            wheelbase_m,
            steering_gain: 1.0,
            side_slip_rad_per_mps2: 0.0,
            curve: SteeringCurve::default(),
            response: SteeringResponse::default(),
            half_play_rad: 0.0,
        };
        let segment = DriveSegment {
            duration_s: dt_s,
            drive,
            held_m: 0.0,
            steering_step_rad: 0.0,
        };
        for _ in 0..100 {
            euler.s = euler.f(drive, dt_s);
            arc.advance(&vehicle, &parameters, &MotionNoise::default(), &segment);
        }
        let euler = Pose2::new(euler.s[0], euler.s[1], euler.s[2]);
        let half = Pose2::new(-0.5 * dt_s, 0.0, 0.0);
        let shifted = half.inverse().compose(&arc.end_in_begin).compose(&half);
        let apart = shifted.between(&euler).log();
        assert!(apart.norm() < 1e-5, "{apart}");
    }

    /// Equation 5 against differences of equation 3.
    #[test]
    fn the_jacobians_of_the_motion_match_differences() {
        let at = filter(
            Equations::Compact,
            Pose2::IDENTITY,
            Pose2::new(2.0, 1.5, 0.9),
        );
        let u = DriveReading {
            speed_mps: 1.3,
            steering_rad: 0.2,
            ..DriveReading::default()
        };
        let (F, G) = at.F_and_G(u, 0.01);
        let h = 1e-6;
        for i in 0..7 {
            let mut moved = at.clone();
            moved.s[i] += h;
            let numeric = (moved.f(u, 0.01) - at.f(u, 0.01)) / h;
            assert!((numeric - F.column(i)).norm() < 1e-6, "state {i}");
        }
        let (mut faster, mut turned) = (u, u);
        faster.speed_mps += h;
        turned.steering_rad += h;
        for (i, other) in [faster, turned].into_iter().enumerate() {
            let numeric = (at.f(other, 0.01) - at.f(u, 0.01)) / h;
            assert!((numeric - G.column(i)).norm() < 1e-6, "input {i}");
        }
    }
}
