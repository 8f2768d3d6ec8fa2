//! Windows of real motions with made-up residuals: the change test with nothing to find.

use std::collections::VecDeque;

use fleetcal_estimator::change::WINDOWS_MAX;
use fleetcal_estimator::change::evidence::{CAUSES, Evidence, Thresholds, WINDOW_CHI2_MAX};
use fleetcal_estimator::change::mean_pose::Way;
use fleetcal_estimator::change::search::{Reference, Search, candidates, strongest};
use fleetcal_estimator::change::window::{Window, WindowCutter};
use fleetcal_estimator::drive_history::DriveHistory;
use fleetcal_estimator::filter::{OdometryReading, PARAMETERS, ParameterCovariance, Values};
use fleetcal_estimator::motion_noise::MotionNoise;
use fleetcal_estimator::{DriveSample, Pose2, RobotTime, Vehicle, VehicleModel};
use fleetcal_robot::simulator::{Point, Route, SimulatedMessage, Simulation, SimulationConfig};
use nalgebra::{Matrix3, SMatrix, SVector, Vector3};
use rand::{Rng, SeedableRng, rngs::StdRng};
use rand_distr::StandardNormal;

use crate::drive::poses;

/// Share of its information that the reference keeps from window to window: it remembers 250 m.
const KEPT: f64 = 0.998;
/// Uncertainty of the parameters before the first window: twice the limits of convergence.
const PRIOR_SIGMA: [f64; PARAMETERS] = [
    1.7e-3, 0.01, 0.01, 3.5e-3, 4e-3, 6e-3, 0.02, 0.02, 3e-3, 0.01, 0.043, 0.12, 0.1, 0.01, 0.0044,
];

/// The search for an alarm.
const SEARCH: Search = Search {
    noise_scale: 1.0,
    window_chi2_max: WINDOW_CHI2_MAX,
    every_onset: false,
};

/// The routes that windows are cut from.
pub fn routes() -> [Route; 3] {
    [
        Route::staging_figure_eight(),
        Route::aisle_loop(),
        Route::left_loop(Point::new(-11.0, 0.0), 10.0, 5.0),
    ]
}

/// Windows of a route with their Jacobians and covariances, cut by the estimator's own code.
pub fn windows_of(route: Route, duration_s: f64) -> Vec<Window> {
    let mut config = SimulationConfig::figure_eight(1);
    config.route = route;
    config.lidar = poses();
    let mut values = Values::zeros();
    for (value, known) in values.iter_mut().zip([
        0.0,
        config.vehicle.lidar_in_base.x_m,
        0.0,
        0.0,
        1.0,
        1.2,
        0.0,
        1.0,
    ]) {
        *value = known;
    }
    let vehicle = Vehicle::new(VehicleModel::Bicycle, 1.2);
    let start_ns = config.start_stamp_ns;
    let mut simulation = Simulation::new(config).unwrap();
    let mut drive = DriveHistory::new(10.0);
    let mut cutter = WindowCutter::default();
    let (mut waiting, mut windows) = (None::<OdometryReading>, Vec::new());
    loop {
        let emitted = simulation.advance();
        if (emitted.sent_ns - start_ns) as f64 * 1e-9 > duration_s {
            return windows;
        }
        match emitted.message {
            SimulatedMessage::WheelOdometry(d) => {
                drive.push(
                    DriveSample::new(RobotTime(d.stamp_ns), d.speed_mps, d.steering_rad).unwrap(),
                );
            }
            SimulatedMessage::LidarPose(p) => {
                let reading = OdometryReading {
                    stamp: RobotTime(p.stamp_ns),
                    lidar_in_odom: Pose2::new(p.pose.x_m, p.pose.y_m, p.pose.yaw_rad),
                    covariance: p
                        .covariance
                        .map_or(Matrix3::zeros(), |c| Matrix3::from_fn(|i, j| c[i][j])),
                };
                // A pose waits for the drive samples of its time.
                if let Some(due) = waiting.replace(reading) {
                    let noise = MotionNoise::default();
                    let way = Way {
                        drive: &drive,
                        vehicle: &vehicle,
                        values: &values,
                        noise: &noise,
                        noise_scale: 1.0,
                    };
                    let cut = cutter.push(&due, way, || ());
                    let complete = cut.complete.into_iter().chain(cut.complete_at_end);
                    windows.extend(complete.map(|(window, ())| window));
                }
            }
            SimulatedMessage::Scan(_) | SimulatedMessage::CrossTrackError(_) => {}
        }
    }
}

/// The change test fed with windows that hold noise alone.
pub struct NoiseWindows {
    pool: Vec<Window>,
    next: usize,
    random: StdRng,
    remembered: VecDeque<Window>,
    information: SMatrix<f64, PARAMETERS, PARAMETERS>,
    score: SVector<f64, PARAMETERS>,
}

impl NoiseWindows {
    /// Goes round a pool of windows again and again.
    pub fn new(pool: Vec<Window>, seed: u64) -> Self {
        let prior = SVector::from_fn(|i, _| PRIOR_SIGMA[i].powi(-2));
        Self {
            pool,
            next: 0,
            random: StdRng::seed_from_u64(seed),
            remembered: VecDeque::new(),
            information: SMatrix::from_diagonal(&prior),
            score: SVector::zeros(),
        }
    }

    /// One window on: its residual is drawn from its own covariance.
    pub fn advance(&mut self) {
        let mut window = self.pool[self.next].clone();
        self.next = (self.next + 1) % self.pool.len();
        let factor = window.innovation.covariance.cholesky().unwrap();
        let noise = Vector3::from_fn(|_, _| self.random.sample::<f64, _>(StandardNormal));
        window.innovation.residual = factor.l() * noise;
        window.evidence = Evidence::of_window(&window.innovation).unwrap();
        self.remembered.push_back(window);
        if self.remembered.len() > WINDOWS_MAX {
            self.forget_oldest();
        }
    }

    /// Forgets the oldest window: the reference knows it from then on.
    fn forget_oldest(&mut self) {
        let oldest = self.remembered.pop_front().unwrap().innovation;
        let inverse = oldest.covariance.cholesky().unwrap().inverse();
        let weighted = oldest.jacobian.transpose() * inverse;
        let prior = SVector::from_fn(|i, _| PRIOR_SIGMA[i].powi(-2));
        let refresh = SMatrix::from_diagonal(&(prior * (1.0 - KEPT)));
        self.information = self.information * KEPT + refresh + weighted * oldest.jacobian;
        self.score = self.score * KEPT + weighted * oldest.residual;
    }

    fn reference(&self) -> Reference {
        let covariance: ParameterCovariance = self.information.cholesky().unwrap().inverse();
        let values = self.pool[0].values + covariance * self.score;
        Reference::new(values, &covariance).unwrap()
    }

    /// The largest ratio of each cause over all onsets.
    pub fn largest_ratios(&self) -> [f64; CAUSES] {
        let mut largest = [0.0_f64; CAUSES];
        for candidate in candidates(self.remembered.iter(), &self.reference(), &SEARCH) {
            for (most, ratio) in largest.iter_mut().zip(candidate.ratios) {
                *most = most.max(ratio);
            }
        }
        largest
    }

    /// True if the change test raises an alarm now.
    pub fn alarms(&self, thresholds: &Thresholds) -> bool {
        let reference = self.reference();
        strongest(
            &candidates(self.remembered.iter(), &reference, &SEARCH),
            thresholds,
        )
        .is_some_and(|accusation| accusation.margin >= 0.0)
    }
}

/// Counts alarms; after one it waits until the memory holds new windows only, as a restart would.
#[derive(Debug, Clone, Copy, Default)]
pub struct Alarms {
    pub count: u64,
    pub windows: u64,
    rest: usize,
}

impl Alarms {
    /// Counts whether there is an alarm in the next window.
    pub fn push(&mut self, alarm: bool) {
        if self.rest > 0 {
            self.rest -= 1;
            return;
        }
        self.windows += 1;
        if alarm {
            self.count += 1;
            self.rest = WINDOWS_MAX;
        }
    }

    /// Mean run between two alarms, in windows.
    pub fn run_length(&self) -> f64 {
        self.windows as f64 / self.count.max(1) as f64
    }
}
