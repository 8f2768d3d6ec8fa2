//! The extended Kalman filter over body motion and calibration, with a cloned anchor.
//!
//! The state is the body's motion since an anchor (3), the LiDAR odometry's own error at that
//! anchor (3), and the parameters: those of the calibration, and those of the vehicle beyond.
//! Motion *since the anchor* instead of two poses in a world frame removes the three directions
//! nothing can observe. Every few metres the newest pose becomes the anchor, so that an old
//! odometry error cannot live on and a moved LiDAR shows from then on.
//!
//! Perturbations of poses are right (local) ones: `pose_true = pose * exp(error)`.

pub mod constraint;
pub mod follow;
pub mod padded;
mod parameters;
pub mod prediction;
pub mod prior;
pub mod relevance;
pub mod tyres;

use nalgebra::{Matrix3, Matrix4, SMatrix, SVector, Vector3, Vector4};
use serde::de::IgnoredAny;
use serde::{Deserialize, Deserializer, Serialize};

use crate::drive_history::DriveSegment;
use crate::estimate::Parameter;
use crate::geometry::{Pose2, wrap_angle_rad};
use crate::motion_noise::MotionNoise;
use crate::settings::{EstimatorSettings, Measurement};
use crate::stream::RobotTime;
use crate::vehicle::{DriveParameters, DriveReading, Vehicle};
use constraint::LidarMotion;
pub use parameters::{
    ASYMMETRY, CUBIC, CURVE, DRIVE_PARAMETER, PARAMETERS, ParameterCovariance, QUADRATIC,
    SIDE_SLIP, STEERING_LAG, STEERING_PLAY, STEERING_SPREAD, Values, apart, drive_parameters,
    lidar_in_base, steering_response,
};
use prediction::{ByTimeShift, PredictedMotion, speed_noise_mps, twist};
use prior::Prior;

/// Dimension of the filter's state.
const DIM: usize = 6 + PARAMETERS;
/// First index of the motion since the anchor.
const MOTION: usize = 0;
/// First index of the odometry's error at the anchor.
const ANCHOR: usize = 3;
/// First index of the parameters.
const CALIBRATION: usize = 6;
type Covariance = SMatrix<f64, DIM, DIM>;
type Jacobian = SMatrix<f64, 3, DIM>;
/// A pose of the LiDAR in its odometry frame, as the filter measures it.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct OdometryReading {
    /// Time of the pose, in LiDAR time.
    pub stamp: RobotTime,
    /// The pose.
    pub lidar_in_odom: Pose2,
    /// Covariance of its right perturbation.
    pub covariance: Matrix3<f64>,
}

/// Anchor that the motion is measured from.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
struct Anchor {
    lidar_in_odom: Pose2,
    /// Body twist at the anchor.
    twist: Vector3<f64>,
    /// Time offset with which the anchor was placed in drive time, s.
    time_offset_s: f64,
}

/// Result of one update.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Innovation {
    /// `log(h^-1 z)`: measured less predicted LiDAR motion, in the LiDAR's frame.
    pub residual: Vector3<f64>,
    /// Standard deviations of the residual with the noise as configured: the learnt noise would make
    /// any model look consistent. The whole innovation covariance is divided by the learnt scale, also
    /// what is left in it of a prior or of a parameter that was opened again: while such a parameter is
    /// open on a rough robot, these are too small and the NIS is too large.
    pub sigmas: Vector3<f64>,
    /// Normalised innovation squared with the noise as configured, 3 degrees of freedom.
    pub nis: f64,
}

/// Largest normalised innovation squared at full weight; beyond it the measurement's noise is
/// widened until it fits, so that no outlier steers the filter and none starves it.
const NIS_FULL_WEIGHT_MAX: f64 = 16.3;

/// Share by which one update may change the noise scale, for each unit of NIS over the tolerated one.
const NOISE_LEARNING_RATE: f64 = 0.02;
/// Mean NIS that counts as right: 3 are expected, and a hair more is no reason to widen.
const NIS_TOLERATED: f64 = 3.4;
/// Largest share of the tolerated NIS that one update counts for.
const NIS_EXCESS_MAX: f64 = 10.0;
/// Largest noise scale: thirty times the configured standard deviation.
const NOISE_SCALE_MAX: f64 = 900.0;

/// The filter of one robot.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Filter {
    vehicle: Vehicle,
    /// Written for instances of the version before, which do not read a filter without it.
    #[serde(default)]
    form: Measurement,
    /// Noise as configured. A stored one is not read: a version may know settings that another does
    /// not.
    #[serde(deserialize_with = "as_configured")]
    noise: MotionNoise,
    #[serde(with = "padded")]
    values: Values,
    #[serde(with = "padded")]
    covariance: Covariance,
    /// Parameters whose values the filter may not change (their uncertainty still counts).
    #[serde(with = "padded")]
    held: [bool; PARAMETERS],
    #[serde(with = "padded")]
    random_walk: Values,
    anchor: Option<Anchor>,
    body_in_anchor: Pose2,
    /// Prediction since the last update, not yet in the covariance.
    predicted: PredictedMotion,
    /// Distance and turn since the anchor.
    since_anchor_m: f64,
    since_anchor_rad: f64,
    /// Changes by a shift of the drive's time since the anchor.
    #[serde(default)]
    by_time_shift: ByTimeShift,
    /// Scale of the noise (as a variance, over the configured one), at least 1: learnt from the
    /// innovations, so that a rougher vehicle or a poorer LiDAR only widens the sigmas.
    noise_scale: f64,
}

fn as_configured<'de, D: Deserializer<'de>>(stored: D) -> Result<MotionNoise, D::Error> {
    IgnoredAny::deserialize(stored)?;
    Ok(MotionNoise::default())
}

impl Filter {
    /// A filter that starts from a prior.
    pub fn new(vehicle: Vehicle, settings: &EstimatorSettings, prior: &Prior) -> Self {
        let mut covariance = Covariance::zeros();
        covariance
            .fixed_view_mut::<PARAMETERS, PARAMETERS>(CALIBRATION, CALIBRATION)
            .copy_from(&prior.covariance);
        Self {
            vehicle,
            form: Measurement::Clone,
            noise: settings.motion_noise,
            values: prior.values,
            covariance,
            held: prior.held,
            random_walk: prior.random_walk_per_sqrt_s,
            anchor: None,
            body_in_anchor: Pose2::IDENTITY,
            predicted: PredictedMotion::none(),
            since_anchor_m: 0.0,
            since_anchor_rad: 0.0,
            by_time_shift: ByTimeShift::default(),
            noise_scale: 1.0,
        }
    }

    /// Takes the noise of the motion from the settings: a stored filter has none.
    pub fn set_motion_noise(&mut self, settings: &EstimatorSettings) {
        self.noise = settings.motion_noise;
    }

    /// Scale of the noise (as a variance, over the configured one), at least 1.
    pub fn noise_scale(&self) -> f64 {
        self.noise_scale
    }

    /// Noise of a driven metre, as configured.
    pub fn motion_noise(&self) -> &MotionNoise {
        &self.noise
    }

    /// Values of the parameters.
    pub fn values(&self) -> &Values {
        &self.values
    }

    /// Value of one parameter.
    pub fn value(&self, parameter: Parameter) -> f64 {
        self.values[parameter.index()]
    }

    /// Covariance of the parameters.
    pub fn parameter_covariance(&self) -> ParameterCovariance {
        self.covariance
            .fixed_view::<PARAMETERS, PARAMETERS>(CALIBRATION, CALIBRATION)
            .into_owned()
    }

    /// `lidar_in_base`, the paper's `T^B_L`.
    pub fn lidar_in_base(&self) -> Pose2 {
        lidar_in_base(&self.values)
    }

    /// True if there is an anchor to measure from.
    pub fn is_anchored(&self) -> bool {
        self.anchor.is_some()
    }

    /// The body's pose in the odometry frame of the LiDAR.
    pub fn base_in_odom(&self) -> Option<Pose2> {
        let anchor = self.anchor.as_ref()?;
        let base_from_lidar = self.lidar_in_base().inverse();
        Some(
            anchor
                .lidar_in_odom
                .compose(&base_from_lidar)
                .compose(&self.body_in_anchor),
        )
    }

    /// Motion predicted since the last update.
    pub fn predicted(&self) -> &PredictedMotion {
        &self.predicted
    }

    /// Distance (m) and turn (rad) since the anchor.
    pub fn since_anchor(&self) -> (f64, f64) {
        (self.since_anchor_m, self.since_anchor_rad)
    }

    /// Parameters of the vehicle model.
    pub fn drive_parameters(&self) -> DriveParameters {
        drive_parameters(&self.values)
    }

    /// Predicts over one drive reading.
    pub fn predict(&mut self, segment: &DriveSegment) {
        let parameters = self.drive_parameters();
        let (vehicle, noise) = (&self.vehicle, &self.noise);
        self.predicted.advance(vehicle, &parameters, noise, segment);
    }

    /// Gives up the anchor, and with it the motion since: the next poses do not compare with those
    /// before (a gap, a new map).
    pub fn lose_anchor(&mut self) {
        self.anchor = None;
        self.body_in_anchor = Pose2::IDENTITY;
        self.predicted = PredictedMotion::none();
        self.since_anchor_m = 0.0;
        self.since_anchor_rad = 0.0;
        self.by_time_shift = ByTimeShift::default();
        self.covariance = self.covariance_of_parameters_alone();
    }

    /// The covariance of a state whose motion and anchor are exact.
    fn covariance_of_parameters_alone(&self) -> Covariance {
        let mut covariance = Covariance::zeros();
        covariance
            .fixed_view_mut::<PARAMETERS, PARAMETERS>(CALIBRATION, CALIBRATION)
            .copy_from(&self.parameter_covariance());
        covariance
    }

    /// Makes a reading the first anchor, or the one after a loss. `drive` is the reading then.
    pub fn start_anchor(&mut self, reading: &OdometryReading, drive: DriveReading) {
        let drive = drive.without_noise().unwrap_or(drive);
        self.predicted.twist = twist(&self.vehicle.motion(drive, &self.drive_parameters()));
        self.place_anchor(reading.lidar_in_odom);
        let mut covariance = self.covariance_of_parameters_alone();
        covariance
            .fixed_view_mut::<3, 3>(ANCHOR, ANCHOR)
            .copy_from(&(reading.covariance * self.noise_scale));
        self.covariance = covariance;
    }

    /// Lets slow drift in: `elapsed_s` seconds of random walk on the parameters.
    pub fn drift(&mut self, elapsed_s: f64) {
        for (i, walk) in self.random_walk.iter().enumerate() {
            self.covariance[(CALIBRATION + i, CALIBRATION + i)] += walk * walk * elapsed_s;
        }
    }

    /// Updates with a reading. Does nothing without an anchor.
    ///
    /// Steps: 1 bring the prediction into the covariance, 2 innovation, 3 gain, 4 correction (the
    /// paper's equations for `r_k`, `S_k`, `K_k`, in Joseph form), 5 a new anchor where asked.
    pub fn update(&mut self, reading: &OdometryReading, new_anchor: bool) -> Option<Innovation> {
        // 1. Prediction.
        self.absorb_prediction();
        // 2. Innovation: r = log(h^-1 z) and S = H P H^T + R.
        let (residual, jacobian) = self.innovation(reading)?;
        let cross = self.covariance * jacobian.transpose();
        let predicted = jacobian * cross;
        let mut noise = reading.covariance * self.noise_scale;
        let nis = normalised_square(&(predicted + noise), &residual)?;
        let innovation = Innovation {
            residual,
            sigmas: ((predicted + noise).diagonal() / self.noise_scale).map(f64::sqrt),
            nis: nis * self.noise_scale,
        };
        self.learn_noise(nis);
        if nis > NIS_FULL_WEIGHT_MAX {
            noise = widened(&noise, &predicted, nis);
        }
        let innovation_covariance = predicted + noise;
        // 3. Gain. Held parameters keep their value but not their part in the covariance (Schmidt).
        let inverse = innovation_covariance.cholesky()?.inverse();
        let mut gain = cross * inverse;
        for (i, _) in self.held.iter().enumerate().filter(|(_, held)| **held) {
            gain.row_mut(CALIBRATION + i).fill(0.0);
        }
        // 5a. The reading's own error, which the new anchor takes over.
        let fresh = new_anchor.then(|| FreshAnchor::of(&noise, &inverse, &cross, &residual));
        // 4. Correction.
        self.correct(&(gain * residual));
        let gain_cross = gain * cross.transpose();
        self.covariance +=
            gain * innovation_covariance * gain.transpose() - gain_cross - gain_cross.transpose();
        self.covariance = symmetric(&self.covariance);
        // 5. New anchor.
        if let Some(fresh) = fresh {
            self.take_anchor(reading, &fresh);
        }
        Some(innovation)
    }

    /// Opens parameters again after a change: adds uncertainty to them, and forgets their
    /// correlations with all others, which were learnt on another vehicle.
    pub fn reopen(&mut self, parameters: &[Parameter], sigma: impl Fn(Parameter) -> f64) {
        for &parameter in parameters {
            let i = CALIBRATION + parameter.index();
            let variance = self.covariance[(i, i)] + sigma(parameter).powi(2);
            self.covariance.row_mut(i).fill(0.0);
            self.covariance.column_mut(i).fill(0.0);
            self.covariance[(i, i)] = variance;
        }
    }

    /// Opens the steering's curve, which a filter of an earlier estimator lacks.
    pub fn open_curve(&mut self, prior: &Prior) {
        for parameter in CURVE {
            let i = CALIBRATION + parameter;
            if self.covariance[(i, i)] <= 0.0 {
                self.covariance[(i, i)] = prior.covariance[(parameter, parameter)];
                self.held[parameter] = prior.held[parameter];
            }
        }
    }

    /// Fuses knowledge of some parameters from elsewhere, as one measurement of them.
    pub fn fuse(
        &mut self,
        parameters: &[Parameter; 4],
        values: &Values,
        covariance: &ParameterCovariance,
    ) {
        let indices = parameters.map(Parameter::index);
        let mut residual = Vector4::from_fn(|i, _| values[indices[i]] - self.values[indices[i]]);
        for (i, parameter) in parameters.iter().enumerate() {
            if *parameter == Parameter::LidarYaw {
                residual[i] = wrap_angle_rad(residual[i]);
            }
        }
        let cross = SMatrix::<f64, DIM, 4>::from_fn(|row, column| {
            self.covariance[(row, CALIBRATION + indices[column])]
        });
        let innovation_covariance = Matrix4::from_fn(|i, j| {
            cross[(CALIBRATION + indices[i], j)] + covariance[(indices[i], indices[j])]
        });
        let Some(factor) = innovation_covariance.cholesky() else {
            return;
        };
        let gain = cross * factor.inverse();
        self.correct(&(gain * residual));
        self.covariance -= gain * cross.transpose();
        self.covariance = symmetric(&self.covariance);
    }

    /// Multiplicative step towards the tolerated mean NIS; a single outlier counts as ten at most.
    fn learn_noise(&mut self, nis: f64) {
        let excess = (nis / NIS_TOLERATED).min(NIS_EXCESS_MAX) - 1.0;
        let scale = self.noise_scale * (NOISE_LEARNING_RATE * excess).exp();
        self.noise_scale = scale.clamp(1.0, NOISE_SCALE_MAX);
    }

    fn absorb_prediction(&mut self) {
        let predicted = std::mem::replace(&mut self.predicted, PredictedMotion::none());
        self.predicted.twist = predicted.twist;
        self.body_in_anchor = self.body_in_anchor.compose(&predicted.end_in_begin);
        self.since_anchor_m += predicted.distance_m;
        self.since_anchor_rad += predicted.turned_rad;
        self.by_time_shift = self.by_time_shift.after(&predicted);

        // eta <- Phi eta + Gamma p + w, all else stays: only three rows and columns change.
        let mut transition = SMatrix::<f64, 3, DIM>::zeros();
        transition
            .fixed_view_mut::<3, 3>(0, MOTION)
            .copy_from(&predicted.by_begin);
        for (column, parameter) in DRIVE_PARAMETER.iter().enumerate() {
            transition.set_column(
                CALIBRATION + parameter,
                &predicted.by_parameters.column(column),
            );
        }
        let rows = transition * self.covariance;
        let block =
            symmetric(&(rows * transition.transpose() + predicted.noise * self.noise_scale));
        self.covariance
            .fixed_view_mut::<3, DIM>(MOTION, 0)
            .copy_from(&rows);
        self.covariance
            .fixed_view_mut::<DIM, 3>(0, MOTION)
            .copy_from(&rows.transpose());
        self.covariance
            .fixed_view_mut::<3, 3>(MOTION, MOTION)
            .copy_from(&block);
    }

    /// Residual and Jacobian of `z = exp(-e_a) X^-1 B X exp(e_k)`.
    fn innovation(&self, reading: &OdometryReading) -> Option<(Vector3<f64>, Jacobian)> {
        let anchor = self.anchor.as_ref()?;
        let x = self.lidar_in_base();
        let time_offset_s = self.value(Parameter::TimeOffset);
        // The anchor was placed with the time offset of then: shift it to that of now.
        let shift = Pose2::exp(&(-anchor.twist * (time_offset_s - anchor.time_offset_s)));
        let body = shift.compose(&self.body_in_anchor);
        let predicted = LidarMotion::new(&x, &body);
        let measured = anchor.lidar_in_odom.between(&reading.lidar_in_odom);
        let residual = predicted.end_in_begin.between(&measured).log();

        let mut jacobian = Jacobian::zeros();
        jacobian
            .fixed_view_mut::<3, 3>(0, MOTION)
            .copy_from(&predicted.by_body);
        jacobian
            .fixed_view_mut::<3, 3>(0, ANCHOR)
            .copy_from(&-predicted.carry);
        jacobian
            .fixed_view_mut::<3, 3>(0, CALIBRATION + Parameter::LidarX.index())
            .copy_from(&predicted.by_mount);
        jacobian.set_column(
            CALIBRATION + Parameter::TimeOffset.index(),
            &(predicted.by_body
                * self.by_time_shift.between(
                    (anchor.twist.x, self.predicted.twist.x),
                    speed_noise_mps(&self.noise, &self.predicted.twist),
                )),
        );
        Some((residual, jacobian))
    }

    fn correct(&mut self, correction: &SVector<f64, DIM>) {
        let motion = correction.fixed_rows::<3>(MOTION).into_owned();
        self.body_in_anchor = self.body_in_anchor.compose(&Pose2::exp(&motion));
        let at_anchor = correction.fixed_rows::<3>(ANCHOR).into_owned();
        if let Some(anchor) = self.anchor.as_mut() {
            // Z_a = T_a exp(e_a): taking the estimated error out leaves a zero-mean one.
            anchor.lidar_in_odom = anchor.lidar_in_odom.compose(&Pose2::exp(&-at_anchor));
        }
        self.values += correction.fixed_rows::<PARAMETERS>(CALIBRATION);
        let yaw = &mut self.values[Parameter::LidarYaw.index()];
        *yaw = wrap_angle_rad(*yaw);
    }

    fn place_anchor(&mut self, lidar_in_odom: Pose2) {
        self.anchor = Some(Anchor {
            lidar_in_odom,
            twist: self.predicted.twist,
            time_offset_s: self.value(Parameter::TimeOffset),
        });
        let twist = self.predicted.twist;
        self.predicted = PredictedMotion::none();
        self.predicted.twist = twist;
        self.body_in_anchor = Pose2::IDENTITY;
        self.since_anchor_m = 0.0;
        self.since_anchor_rad = 0.0;
        self.by_time_shift = ByTimeShift::default();
    }

    fn take_anchor(&mut self, reading: &OdometryReading, fresh: &FreshAnchor) {
        self.place_anchor(reading.lidar_in_odom.compose(&Pose2::exp(&-fresh.error)));
        for block in [MOTION, ANCHOR] {
            self.covariance.fixed_view_mut::<3, DIM>(block, 0).fill(0.0);
            self.covariance.fixed_view_mut::<DIM, 3>(0, block).fill(0.0);
        }
        self.covariance
            .fixed_view_mut::<3, 3>(ANCHOR, ANCHOR)
            .copy_from(&fresh.covariance);
        self.covariance
            .fixed_view_mut::<3, PARAMETERS>(ANCHOR, CALIBRATION)
            .copy_from(&fresh.with_parameters);
        self.covariance
            .fixed_view_mut::<PARAMETERS, 3>(CALIBRATION, ANCHOR)
            .copy_from(&fresh.with_parameters.transpose());
    }
}

/// The error of the reading that becomes the anchor, after the update with that same reading.
struct FreshAnchor {
    error: Vector3<f64>,
    covariance: Matrix3<f64>,
    with_parameters: SMatrix<f64, 3, PARAMETERS>,
}

impl FreshAnchor {
    /// Error by `e_k ~ N(0, R)` in `r = H x + e_k`: mean `R S^-1 r`, covariance `R - R S^-1 R`, and
    /// covariance with the state `-R S^-1 H P`, whatever gain the state was updated with.
    fn of(
        noise: &Matrix3<f64>,
        inverse: &Matrix3<f64>,
        cross: &SMatrix<f64, DIM, 3>,
        residual: &Vector3<f64>,
    ) -> Self {
        let error_gain = noise * inverse;
        // Cov(e - K_e r, x - K r) = -R K^T - K_e H P + K_e S K^T, and K_e S = R.
        let with_state = -error_gain * cross.transpose();
        Self {
            error: error_gain * residual,
            covariance: symmetric(&(noise - error_gain * noise)),
            with_parameters: with_state
                .fixed_view::<3, PARAMETERS>(0, CALIBRATION)
                .into_owned(),
        }
    }
}

/// Noise widened so that the innovation comes back to the edge of full weight.
fn widened(noise: &Matrix3<f64>, predicted: &Matrix3<f64>, nis: f64) -> Matrix3<f64> {
    noise + (predicted + noise) * (nis / NIS_FULL_WEIGHT_MAX - 1.0)
}

fn normalised_square(covariance: &Matrix3<f64>, residual: &Vector3<f64>) -> Option<f64> {
    let solved = covariance.cholesky()?.solve(residual);
    Some(residual.dot(&solved))
}

/// A covariance made symmetric again after rounding.
pub(crate) fn symmetric<const N: usize>(covariance: &SMatrix<f64, N, N>) -> SMatrix<f64, N, N> {
    (covariance + covariance.transpose()) * 0.5
}
