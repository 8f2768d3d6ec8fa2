//! The paper's own filter, as it is printed: seven states, Euler steps, and the LiDAR's motion since
//! the first pose as a measurement with white noise.
//!
//! Its expanded equations parametrise the inverse of the mount, the pose of the rear axle in the
//! LiDAR's frame, although its text means the mount itself. Both readings are here.

use fleetcal_estimator::geometry::{Pose2, wrap_angle_rad};
use fleetcal_estimator::vehicle::DriveReading;
use nalgebra::{SMatrix, SVector, Vector3};

/// Position (3), extrinsics (3) and steering offset, the paper's `s_k`.
type State = SVector<f64, 7>;
type Covariance = SMatrix<f64, 7, 7>;
type Jacobian = SMatrix<f64, 3, 7>;

/// Form of the measurement's equations.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Equations {
    /// The paper's expanded equations, letter by letter.
    AsPrinted,
    /// Its compact equation `X^-1 B_0^-1 B_k X`, expanded correctly.
    Compact,
}

/// Tunable parameters of the paper.
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

/// The paper's filter.
#[derive(Debug, Clone)]
pub struct PaperFilter {
    equations: Equations,
    tuning: Tuning,
    wheelbase_m: f64,
    state: State,
    covariance: Covariance,
    /// The first LiDAR pose, `L_0`.
    first: Option<Pose2>,
}

impl PaperFilter {
    /// Makes a filter before its first LiDAR pose.
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
            state: State::from([0.0, 0.0, 0.0, mount.x_m, mount.y_m, mount.yaw_rad, 0.0]),
            covariance: Covariance::from_diagonal(&sigma.component_mul(&sigma)),
            first: None,
        }
    }

    /// Returns extrinsics (m, m, rad) and steering offset (rad).
    pub fn values(&self) -> [f64; 4] {
        [self.state[3], self.state[4], self.state[5], self.state[6]]
    }

    /// Returns their covariance.
    pub fn covariance(&self) -> SMatrix<f64, 4, 4> {
        self.covariance.fixed_view::<4, 4>(3, 3).into_owned()
    }

    /// Predicts over `step_s` as in the paper: `P = F P F' + G Q G'`. It does nothing before the
    /// first pose.
    pub fn predict(&mut self, drive: DriveReading, step_s: f64) {
        if self.first.is_none() {
            return;
        }
        let (v, yaw) = (drive.speed_mps, self.state[2]);
        let steering_rad = drive.steering_rad - self.state[6];
        let (sin, cos) = yaw.sin_cos();
        let curvature = steering_rad.tan() / self.wheelbase_m;
        let by_steering = v * step_s / (self.wheelbase_m * steering_rad.cos().powi(2));

        let mut transition = Covariance::identity();
        transition[(0, 2)] = -v * sin * step_s;
        transition[(1, 2)] = v * cos * step_s;
        transition[(2, 6)] = -by_steering;
        let mut by_input = SMatrix::<f64, 7, 2>::zeros();
        by_input[(0, 0)] = cos * step_s;
        by_input[(1, 0)] = sin * step_s;
        by_input[(2, 0)] = curvature * step_s;
        by_input[(2, 1)] = by_steering;
        let Tuning {
            speed_mps,
            steering_rad: steering_noise_rad,
            walk_per_sqrt_s,
            ..
        } = self.tuning;
        let input = nalgebra::Vector2::new(speed_mps.powi(2), steering_noise_rad.powi(2));
        let input = nalgebra::Matrix2::from_diagonal(&input);

        self.state[0] += v * cos * step_s;
        self.state[1] += v * sin * step_s;
        self.state[2] += v * curvature * step_s;
        self.covariance = transition * self.covariance * transition.transpose()
            + by_input * input * by_input.transpose();
        for i in 3..7 {
            self.covariance[(i, i)] += walk_per_sqrt_s.powi(2) * step_s;
        }
    }

    /// Updates with a LiDAR pose in its odometry frame as in the paper; the first one is `L_0`.
    pub fn update(&mut self, lidar_in_odom: &Pose2) {
        let Some(first) = self.first else {
            self.first = Some(*lidar_in_odom);
            return;
        };
        let measured = first.between(lidar_in_odom);
        let (predicted, jacobian) = match self.equations {
            Equations::AsPrinted => self.as_printed(),
            Equations::Compact => self.compact(),
        };
        let mut residual = Vector3::new(measured.x_m, measured.y_m, measured.yaw_rad) - predicted;
        residual[2] = wrap_angle_rad(residual[2]);
        let Tuning {
            position_m,
            yaw_rad,
            ..
        } = self.tuning;
        let sigma = Vector3::new(position_m, position_m, yaw_rad);
        let noise = nalgebra::Matrix3::from_diagonal(&sigma.component_mul(&sigma));
        let cross = self.covariance * jacobian.transpose();
        let Some(factor) = (jacobian * cross + noise).cholesky() else {
            return;
        };
        let gain = cross * factor.inverse();
        self.state += gain * residual;
        self.covariance -= gain * cross.transpose();
        self.covariance = (self.covariance + self.covariance.transpose()) * 0.5;
    }

    /// Returns `h` and `H` as printed, with `B_0` the origin.
    fn as_printed(&self) -> (Vector3<f64>, Jacobian) {
        let [dx, dy, turned, x, y, yaw, _] = self.state.data.0[0];
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

    /// Returns `h` and `H` of `X^-1 B_k X`, with `B_0` the origin.
    fn compact(&self) -> (Vector3<f64>, Jacobian) {
        let [dx, dy, turned, x, y, yaw, _] = self.state.data.0[0];
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
        filter.state[0] = body.x_m;
        filter.state[1] = body.y_m;
        filter.state[2] = body.yaw_rad;
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
            let (predicted, jacobian) = match equations {
                Equations::AsPrinted => filter.as_printed(),
                Equations::Compact => filter.compact(),
            };
            let expected = Vector3::new(expected.x_m, expected.y_m, expected.yaw_rad);
            assert!((predicted - expected).norm() < 1e-12, "{equations:?}");
            for i in 0..7 {
                let mut moved = filter.clone();
                moved.state[i] += 1e-6;
                let (after, _) = match equations {
                    Equations::AsPrinted => moved.as_printed(),
                    Equations::Compact => moved.compact(),
                };
                let numeric = (after - predicted) * 1e6;
                assert!(
                    (numeric - jacobian.column(i)).norm() < 1e-5,
                    "{equations:?}, column {i}"
                );
            }
        }
    }

    /// Drives a noiseless figure-eight by the filter's own Euler steps, on which it must find its
    /// own truth.
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
}
