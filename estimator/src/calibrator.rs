//! One robot's estimator: a pure `step(event) -> effects`.

use std::collections::VecDeque;

use serde::{Deserialize, Serialize};
use thiserror::Error;

use crate::change::evidence::change_sigma;
use crate::change::long_run::LongRunVariance;
use crate::change::{ChangeWatch, Detected};
use crate::drive_history::DriveHistory;
use crate::estimate::{
    Change, ChangeKind, Consistency, Counts, Estimate, Parameter, ParameterEstimate, Segment,
};
use crate::excitation::Excitation;
use crate::filter::follow::{Followed, Follower};
use crate::filter::prior::Prior;
use crate::filter::{Filter, Innovation, OdometryReading, PARAMETERS, ParameterCovariance, Values};
use crate::geometry::Pose2;
use crate::initial_guess::{agrees_with, initial_guess};
use crate::lidar_odometry::{LidarOdometry, Tracking};
use crate::merge::{Merged, Merger};
use crate::settings::EstimatorSettings;
use crate::stream::{DriveSample, Dropped, Effect, Event, LidarPose, Stamp, Sweep};
use crate::trust::Trust;
use crate::vehicle::Vehicle;

/// How far back drive samples and LiDAR poses are kept, s.
const HISTORY_S: f64 = 60.0;
/// Most LiDAR poses kept: an hour of them is not needed for a first guess.
const READINGS_MAX: usize = 1200;
/// Most LiDAR poses waiting for the drive samples of their time.
const WAITING_MAX: usize = 64;
/// A new guess is tried after this many new readings.
const GUESS_EVERY: usize = 5;
/// Readings over which the mean NIS is taken.
const NIS_WINDOW: usize = 200;
/// Most changes kept of a session.
const CHANGES_MAX: usize = 64;
/// Version of the checkpoint's layout.
const CHECKPOINT_VERSION: u32 = 1;

/// What is known of a robot before it has driven.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct CalibratorConfig {
    /// The vehicle.
    pub vehicle: Vehicle,
    /// The LiDAR's pose in `base` from CAD or tape, when there is one.
    pub nominal_lidar_in_base: Option<Pose2>,
    /// Settings of the filter.
    pub settings: EstimatorSettings,
}

impl CalibratorConfig {
    /// A configuration with default settings and no nominal mount.
    pub fn of(vehicle: Vehicle) -> Self {
        Self {
            vehicle,
            nominal_lidar_in_base: None,
            settings: EstimatorSettings::default(),
        }
    }
}

/// A calibrator's state, to be stored and restored. The local map is not in it: it is rebuilt.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Checkpoint {
    version: u32,
    stamp: Stamp,
    filter: Option<Filter>,
    session: Session,
    trust: Trust,
    long_run: LongRunVariance,
}

/// Why a checkpoint could not be used.
#[derive(Debug, Clone, PartialEq, Eq, Error)]
pub enum CheckpointRefused {
    /// It was written by another version of the estimator.
    #[error("the checkpoint is of version {found}, this estimator reads version {wanted}")]
    Version {
        /// Version in the checkpoint.
        found: u32,
        /// Version that can be read.
        wanted: u32,
    },
}

/// What is counted over a session.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
struct Session {
    began: Option<Stamp>,
    now: Stamp,
    distance_m: f64,
    counts: Counts,
    excitation: Excitation,
    recent_nis: VecDeque<f64>,
    changes: Vec<Change>,
    segments: Vec<Segment>,
}

/// A LiDAR pose waiting for its drive samples.
#[derive(Debug, Clone)]
struct Waiting {
    reading: OdometryReading,
    /// Whether poses before it do not compare with it.
    anew: bool,
}

/// One robot's estimator.
#[derive(Debug, Clone)]
pub struct Calibrator {
    config: CalibratorConfig,
    prior: Prior,
    merger: Merger,
    lidar_odometry: LidarOdometry,
    drive: DriveHistory,
    waiting: VecDeque<Waiting>,
    /// Recent readings: for the first guess, and to go back to the onset of a change.
    readings: VecDeque<OdometryReading>,
    since_guess: usize,
    watch: ChangeWatch,
    follower: Option<Follower>,
    session: Session,
    trust: Trust,
    told: Option<Stamp>,
}

impl Calibrator {
    /// An estimator that knows nothing yet but its vehicle.
    pub fn new(config: CalibratorConfig) -> Self {
        let unknown = Prior::cold(&config.vehicle, None, &config.settings);
        Self {
            prior: unknown,
            merger: Merger::default(),
            lidar_odometry: LidarOdometry::default(),
            drive: DriveHistory::new(HISTORY_S),
            waiting: VecDeque::new(),
            readings: VecDeque::new(),
            since_guess: 0,
            watch: ChangeWatch::default(),
            follower: None,
            session: Session::default(),
            trust: Trust::default(),
            told: None,
            config,
        }
    }

    /// An estimator that goes on from a checkpoint, under a new anchor and local map.
    ///
    /// # Errors
    /// When the checkpoint is of another version.
    pub fn restore(
        config: CalibratorConfig,
        checkpoint: &Checkpoint,
    ) -> Result<Self, CheckpointRefused> {
        if checkpoint.version != CHECKPOINT_VERSION {
            return Err(CheckpointRefused::Version {
                found: checkpoint.version,
                wanted: CHECKPOINT_VERSION,
            });
        }
        let mut restored = Self::new(config);
        restored.follower = checkpoint.filter.clone().map(|mut filter| {
            filter.lose_anchor();
            Follower::new(filter)
        });
        restored.session = checkpoint.session.clone();
        restored.trust = checkpoint.trust.clone();
        restored.watch = ChangeWatch::with_long_run(checkpoint.long_run.clone());
        Ok(restored)
    }

    /// What has to be stored to go on later.
    pub fn checkpoint(&self) -> Checkpoint {
        Checkpoint {
            version: CHECKPOINT_VERSION,
            stamp: self.session.now,
            filter: self.follower.as_ref().map(|follower| {
                let mut filter = follower.filter.clone();
                filter.lose_anchor();
                filter
            }),
            session: self.session.clone(),
            trust: self.trust.clone(),
            long_run: self.watch.long_run().clone(),
        }
    }

    /// The configuration it was made with.
    pub fn config(&self) -> &CalibratorConfig {
        &self.config
    }

    /// Takes one event, in any order inside the merger's window, and says what has to be done.
    pub fn step(&mut self, event: Event) -> Vec<Effect> {
        let ends = event == Event::EndOfSession;
        let mut merged = Vec::new();
        self.merger.push(event, &mut merged);
        let mut effects = Vec::new();
        for merged in merged {
            match merged {
                Merged::Event(stamp, event) => self.take(stamp, event, &mut effects),
                Merged::Dropped(dropped) => self.drop_message(dropped, &mut effects),
                Merged::SessionStarted(stamp) => self.start_session(stamp, &mut effects),
            }
        }
        if ends {
            self.work_off(true, &mut effects);
            self.tell(&mut effects);
        }
        effects
    }

    /// The estimate now.
    pub fn estimate(&self) -> Estimate {
        self.clone_judgement().1
    }

    /// The body's pose in the LiDAR's odometry frame at the last sweep or pose that was used.
    pub fn base_pose(&self) -> Option<(Stamp, Pose2)> {
        self.follower.as_ref()?.base_pose()
    }

    /// The filter, once it has started.
    pub fn filter(&self) -> Option<&Filter> {
        self.follower.as_ref().map(|follower| &follower.filter)
    }

    /// Changes and faults of this session, oldest first.
    pub fn changes(&self) -> &[Change] {
        &self.session.changes
    }

    /// The stretches of this session over which the vehicle stayed the same.
    pub fn segments(&self) -> Vec<Segment> {
        let from_s = self
            .session
            .segments
            .last()
            .map_or(0.0, |segment| segment.to_s);
        let estimate = self.estimate();
        let mut segments = self.session.segments.clone();
        segments.push(Segment {
            from_s,
            to_s: estimate.time_s,
            parameters: estimate.parameters,
        });
        segments
    }

    /// Seconds of message time since the session's first message.
    pub fn duration_s(&self) -> f64 {
        self.session
            .began
            .map_or(0.0, |began| self.session.now.seconds_since(began))
    }

    fn start_session(&mut self, stamp: Stamp, effects: &mut Vec<Effect>) {
        self.session = Session {
            began: Some(stamp),
            now: stamp,
            ..Session::default()
        };
        self.drive.clear();
        self.waiting.clear();
        self.told = None;
        self.begin_anew();
        effects.push(Effect::SessionStarted(stamp));
    }

    fn drop_message(&mut self, dropped: Dropped, effects: &mut Vec<Effect>) {
        match dropped {
            Dropped::Late => self.session.counts.late += 1,
            Dropped::Duplicate => self.session.counts.duplicates += 1,
            Dropped::UnusableSweep => self.session.counts.scans_rejected += 1,
        }
        effects.push(Effect::Dropped(dropped));
    }

    fn take(&mut self, stamp: Stamp, event: Event, effects: &mut Vec<Effect>) {
        self.session.now = self.session.now.max(stamp);
        match event {
            Event::Drive(sample) => self.take_drive(sample),
            Event::Sweep(sweep) => self.take_sweep(&sweep, effects),
            Event::LidarPose(pose) => self.take_pose(&pose),
            Event::Note(_) | Event::EndOfSession => {}
        }
        self.work_off(false, effects);
        let due = self
            .told
            .is_none_or(|told| self.session.now.seconds_since(told) >= 1.0);
        if due {
            self.tell(effects);
        }
    }

    fn take_drive(&mut self, sample: DriveSample) {
        if let Some(last) = self.drive.newest() {
            let interval_s = sample.stamp().seconds_since(last);
            if interval_s < crate::drive_history::GAP_MIN_S {
                self.session.distance_m += sample.speed_mps().abs() * interval_s;
            }
        }
        self.session.counts.drive_samples += 1;
        self.drive.push(sample);
    }

    fn take_sweep(&mut self, sweep: &Sweep, effects: &mut Vec<Effect>) {
        let Some(pose) = self.lidar_odometry.process(sweep) else {
            self.drop_message(Dropped::UnusableSweep, effects);
            return;
        };
        if pose.tracking == Tracking::Lost {
            self.drop_message(Dropped::UnusableSweep, effects);
            return;
        }
        self.session.counts.scans += 1;
        let reading = OdometryReading {
            stamp: pose.stamp,
            lidar_in_odom: pose.lidar_in_odom,
            covariance: pose.covariance,
        };
        let anew = pose.map_restarted || pose.tracking == Tracking::Recovered;
        self.wait(Waiting { reading, anew });
    }

    fn take_pose(&mut self, pose: &LidarPose) {
        self.session.counts.scans += 1;
        let settings = &self.config.settings;
        let own = nalgebra::Vector3::new(
            settings.pose_sigma_m,
            settings.pose_sigma_m,
            settings.pose_sigma_rad,
        );
        // A given covariance is of the odometry frame's axes; the filter takes the pose's own.
        let covariance = pose.covariance().map_or_else(
            || nalgebra::Matrix3::from_diagonal(&own.component_mul(&own)),
            |given| {
                let turn = Pose2::new(0.0, 0.0, -pose.pose().yaw_rad).adjoint();
                turn * given * turn.transpose()
            },
        );
        let reading = OdometryReading {
            stamp: pose.stamp(),
            lidar_in_odom: pose.pose(),
            covariance,
        };
        self.wait(Waiting {
            reading,
            anew: false,
        });
    }

    fn wait(&mut self, waiting: Waiting) {
        if self.waiting.len() >= WAITING_MAX {
            self.waiting.pop_front();
        }
        self.waiting.push_back(waiting);
    }

    /// Works off the LiDAR poses whose drive samples are there; at the end, those that never will
    /// have them are left.
    fn work_off(&mut self, ends: bool, effects: &mut Vec<Effect>) {
        while let Some(front) = self.waiting.front() {
            let due = match &self.follower {
                Some(follower) => follower.drive_time(&front.reading, &self.config.settings),
                None => front.reading.stamp,
            };
            if self.drive.newest().is_none_or(|newest| newest < due) {
                if ends {
                    self.waiting.clear();
                }
                return;
            }
            if let Some(waiting) = self.waiting.pop_front() {
                self.follow(&waiting, effects);
            }
        }
    }

    /// Poses before do not compare with those to come.
    fn begin_anew(&mut self) {
        self.readings.clear();
        self.watch.break_window();
        if let Some(follower) = self.follower.as_mut() {
            follower.lose_anchor();
        }
    }

    fn follow(&mut self, waiting: &Waiting, effects: &mut Vec<Effect>) {
        if waiting.anew {
            self.begin_anew();
        }
        if self.readings.len() >= READINGS_MAX {
            self.readings.pop_front();
        }
        self.readings.push_back(waiting.reading);
        if self.follower.is_none() {
            self.seek_start();
            return;
        }
        self.follow_reading(&waiting.reading);
        let watched = self.follower.as_ref().and_then(|follower| {
            self.watch.watch(
                &waiting.reading,
                &self.drive,
                &self.config.vehicle,
                follower,
                &self.config.settings,
            )
        });
        if let Some(detected) = watched {
            self.change(&detected, effects);
        }
    }

    fn follow_reading(&mut self, reading: &OdometryReading) {
        let Some(follower) = self.follower.as_mut() else {
            return;
        };
        let followed = follower.follow(reading, &self.drive, &self.config.settings);
        if let Followed::Updated(moved) = followed {
            self.session
                .excitation
                .add(moved.distance_m, moved.turn_rad);
            self.note_innovation(&moved.innovation);
        }
    }

    /// Before the filter has started: guess, and start from the first of the readings.
    fn seek_start(&mut self) {
        self.since_guess += 1;
        if self.since_guess < GUESS_EVERY {
            return;
        }
        self.since_guess = 0;
        let config = &self.config;
        let vehicle = &config.vehicle;
        let readings = self.readings.make_contiguous();
        let Some(guess) = initial_guess(vehicle, &self.prior, readings, &self.drive) else {
            return;
        };
        let prior = with_nominal(config, guess);
        let filter = Filter::new(*vehicle, &config.settings, &prior);
        self.follow_again(Follower::new(filter), None);
    }

    /// Starts a follower and takes it through the readings from a time on.
    fn follow_again(&mut self, follower: Follower, from: Option<Stamp>) {
        self.follower = Some(follower);
        let readings: Vec<_> = self
            .readings
            .iter()
            .filter(|reading| from.is_none_or(|from| reading.stamp >= from))
            .copied()
            .collect();
        for reading in readings {
            self.follow_reading(&reading);
        }
    }

    /// The vehicle has changed: go back to before the onset, open what moved, and follow again, so
    /// that nothing which was absorbed since then stays in the other parameters.
    fn change(&mut self, detected: &Detected, effects: &mut Vec<Effect>) {
        let began = self.session.began.unwrap_or(self.session.now);
        let (onset, after_onset) = detected.onset;
        let before = self.clone_judgement_of(&detected.filter_before);
        let from_s = self
            .session
            .segments
            .last()
            .map_or(0.0, |segment| segment.to_s);
        let onset_s = onset.seconds_since(began);
        self.session.segments.push(Segment {
            from_s,
            to_s: onset_s,
            parameters: before,
        });

        let mut filter = detected.filter_before.clone();
        filter.lose_anchor();
        filter.reopen(&detected.parameters, change_sigma);
        self.session.excitation = Excitation::default();
        self.session.recent_nis.clear();
        self.watch.restart();
        self.follow_again(Follower::new(filter), Some(after_onset));

        let change = Change {
            kind: ChangeKind::CalibrationChanged,
            cause: detected.cause,
            stamp: self.session.now,
            time_s: self.duration_s(),
            onset_s,
            change: self.moved(&detected.parameters, &detected.filter_before),
        };
        self.session.changes.push(change.clone());
        if self.session.changes.len() > CHANGES_MAX {
            self.session.changes.remove(0);
            self.session.segments.remove(0);
        }
        effects.push(Effect::Change(Box::new(change)));
        self.tell(effects);
    }

    fn moved(&self, parameters: &[Parameter], before: &Filter) -> Vec<(Parameter, f64)> {
        let Some(follower) = &self.follower else {
            return Vec::new();
        };
        parameters
            .iter()
            .map(|&p| (p, follower.filter.value(p) - before.value(p)))
            .collect()
    }

    fn note_innovation(&mut self, innovation: &Innovation) {
        let recent = &mut self.session.recent_nis;
        recent.push_back(innovation.nis);
        if recent.len() > NIS_WINDOW {
            recent.pop_front();
        }
    }

    fn tell(&mut self, effects: &mut Vec<Effect>) {
        let (trust, estimate) = self.clone_judgement();
        self.trust = trust;
        self.told = Some(self.session.now);
        effects.push(Effect::Estimate(Box::new(estimate)));
    }

    /// The parameters as a filter sees them, judged by the trust they have earned.
    fn clone_judgement_of(&self, filter: &Filter) -> [ParameterEstimate; PARAMETERS] {
        self.judge(
            &mut self.trust.clone(),
            filter.values(),
            &filter.parameter_covariance(),
        )
    }

    fn judge(
        &self,
        trust: &mut Trust,
        values: &Values,
        covariance: &ParameterCovariance,
    ) -> [ParameterEstimate; PARAMETERS] {
        let prior_sigma = Values::from_fn(|i, _| self.prior.covariance[(i, i)].sqrt());
        // Errors that last for metres: the filter takes them as independent, its sigmas may not.
        let covariance = covariance * self.watch.long_run().ratio();
        trust.judge(
            values,
            &covariance,
            &prior_sigma,
            &self.session.excitation,
            &self.config.settings,
        )
    }

    fn clone_judgement(&self) -> (Trust, Estimate) {
        let mut trust = self.trust.clone();
        let parameters = match self.filter() {
            Some(filter) => self.judge(&mut trust, filter.values(), &filter.parameter_covariance()),
            None => self.judge(&mut trust, &self.prior.values, &self.prior.covariance),
        };
        let recent = &self.session.recent_nis;
        let samples = recent.len() as u64;
        let now = self.drive.now();
        let estimate = Estimate {
            stamp: self.session.now,
            time_s: self.duration_s(),
            distance_m: self.session.distance_m,
            parameters,
            consistency: Consistency {
                nis_mean: if samples == 0 {
                    0.0
                } else {
                    recent.iter().sum::<f64>() / samples as f64
                },
                nis_dof: 3.0,
                samples,
            },
            counts: self.session.counts,
            base_in_odom: self
                .follower
                .as_ref()
                .and_then(|f| f.filter.base_in_odom())
                .unwrap_or(Pose2::IDENTITY)
                .wrapped(),
            drive_now: [now.speed_mps, now.steering_rad],
        };
        (trust, estimate)
    }
}

/// A guess joined with the nominal mount, where the two agree: the nominal mount is evidence too.
fn with_nominal(config: &CalibratorConfig, guess: Prior) -> Prior {
    if config.nominal_lidar_in_base.is_none() {
        return guess;
    }
    let nominal = Prior::cold(
        &config.vehicle,
        config.nominal_lidar_in_base,
        &config.settings,
    );
    if !agrees_with(&nominal, &guess) {
        return guess;
    }
    // The guess is where to linearise; what is believed is the nominal mount's doubt around it.
    let x = Parameter::LidarX.index();
    let mut joined = guess;
    joined
        .covariance
        .fixed_view_mut::<3, 3>(x, x)
        .copy_from(&nominal.covariance.fixed_view::<3, 3>(x, x));
    joined
}
