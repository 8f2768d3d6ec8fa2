//! One robot's estimator: a pure `step(event) -> effects`.

mod checkpoint;
mod comparison;
mod config;
mod drift;
mod following;
mod odometry_watch;
mod second_pass;
mod session;
mod top_view;

use std::collections::{BTreeMap, VecDeque};

pub use checkpoint::{Checkpoint, CheckpointRefused};
pub use config::CalibratorConfig;
pub use top_view::{TopView, TopViewLimits, TrajectoryPoint};

use comparison::{Comparison, Occasion};
use drift::Baseline;
use following::Waiting;
use odometry_watch::{OdometryWatch, is_guess, of_open_direction};
use second_pass::SecondPass;
use session::Session;

use crate::advice::ranking::{Floor, Ranked, rank};
use crate::advice::{Advice, Knowledge, advise};
use crate::change::ChangeWatch;
use crate::claim::{self, Claim, reported_covariance};
use crate::drive_history::DriveHistory;
use crate::estimate::{
    Cause, Change, ChangeKind, Detection, DetectionState, Estimate, Parameter, ParameterEstimates,
    Segment, SigmaSource, SigmaTerm, SteeringTable,
};
use crate::excitation::Excitation;
use crate::filter::follow::Follower;
use crate::filter::prior::Prior;
use crate::filter::{Filter, OdometryReading, Values};
use crate::geometry::Pose2;
use crate::lidar_odometry::{BeamTimes, LearntScanner, LidarOdometry, ScannerReport, Tracking};
use crate::merge::{Merged, Merger, MergerPosition};
use crate::settings::Freedom;
use crate::steered_way::SteeringRange;
use crate::stream::{
    DriveSample, Dropped, Effect, Event, LidarPose, Note, NoteKind, RobotTime, Scan,
};
use crate::trust::{Grounds, Trust};

/// Time for which drive samples and LiDAR poses are kept, s.
const HISTORY_S: f64 = 60.0;
/// Most LiDAR poses waiting for the drive samples of their time.
const WAITING_MAX: usize = 64;
/// Silence after which a robot has been out of sight, and may come back another, s.
const NEW_SESSION_GAP_S: f64 = 600.0;
/// Message time between two published estimates, s.
const TELL_EVERY_S: f64 = 1.0;

/// One robot's estimator.
#[derive(Debug, Clone)]
pub struct Calibrator {
    config: CalibratorConfig,
    prior: Prior,
    merger: Merger,
    lidar_odometry: LidarOdometry,
    odometry_watch: OdometryWatch,
    drive: DriveHistory,
    waiting: VecDeque<Waiting>,
    /// Recent readings: for the first guess, and to go back to the onset of a change.
    readings: VecDeque<OdometryReading>,
    since_guess: usize,
    watch: ChangeWatch,
    follower: Option<Follower>,
    second_pass: Option<Box<SecondPass>>,
    /// The pass that a fault came before: the filter begins from nothing when the fault is over.
    failed_pass: Option<Box<SecondPass>>,
    /// Mount (x, y, yaw) of a filter that began again, because its poses had been misled.
    former_mount: Option<nalgebra::Vector3<f64>>,
    /// The stored calibration, until a new session has been compared with it.
    comparison: Option<Comparison>,
    /// True if somebody has reported a reassembly, and nothing was found since.
    reassembly_open: bool,
    /// Calibration that the present one is compared with, to detect slow drift.
    baseline: Option<Baseline>,
    session: Session,
    trust: Trust,
    told: Option<RobotTime>,
}

impl Calibrator {
    /// An estimator that knows nothing yet but its vehicle.
    pub fn new(config: CalibratorConfig) -> Self {
        Self {
            prior: Prior::cold(&config.vehicle, None, &config.settings),
            merger: Merger::default(),
            lidar_odometry: LidarOdometry::default(),
            odometry_watch: OdometryWatch::default(),
            drive: DriveHistory::new(HISTORY_S),
            waiting: VecDeque::new(),
            readings: VecDeque::new(),
            since_guess: 0,
            watch: ChangeWatch::default(),
            follower: None,
            second_pass: None,
            failed_pass: None,
            former_mount: None,
            comparison: None,
            reassembly_open: false,
            baseline: None,
            session: Session::default(),
            trust: Trust::default(),
            told: None,
            config,
        }
    }

    /// The same with another LiDAR odometry: one that localises in a known map.
    #[must_use]
    pub fn with_lidar_odometry(mut self, lidar_odometry: LidarOdometry) -> Self {
        self.lidar_odometry = lidar_odometry;
        self
    }

    /// The same with a scanner that another estimator has learnt: its errors belong to the sensor,
    /// not to the calibration.
    #[must_use]
    pub fn with_scanner(mut self, learnt: LearntScanner) -> Self {
        self.lidar_odometry = self.lidar_odometry.with_scanner(learnt);
        self
    }

    /// Knowledge of the scanner, for another estimator of this robot.
    pub fn learnt_scanner(&self) -> LearntScanner {
        self.lidar_odometry.learnt_scanner()
    }

    /// The configuration it was made with.
    pub fn config(&self) -> &CalibratorConfig {
        &self.config
    }

    /// Processes one event, in any order inside the merger's window, and returns what has to be
    /// done. A note is processed where it arrives, whatever its stamp: people's notes are never
    /// dropped for that.
    pub fn step(&mut self, event: Event) -> Vec<Effect> {
        let ends = event == Event::EndOfSession;
        // Work that takes nothing apart is only remembered by people.
        if matches!(&event, Event::Note(note) if note.kind == NoteKind::Maintenance) {
            return Vec::new();
        }
        // 1. Order by stamp.
        let mut merged = Vec::new();
        self.merger.push(event, &mut merged);
        // 2. Work through what is in order now.
        let mut effects = Vec::new();
        for merged in merged {
            match merged {
                Merged::Event(stamp, event) => self.take(stamp, event, &mut effects),
                Merged::Note(note) => self.take_note(&note, &mut effects),
                Merged::Dropped(dropped) => self.drop_message(dropped, &mut effects),
                Merged::SessionStarted(stamp) => self.start_session(stamp, &mut effects),
            }
        }
        // 3. At the end, work through what still waits.
        if ends {
            self.work_off(true, &mut effects);
            self.tell(&mut effects);
        }
        effects
    }

    /// Position up to which it has processed the robot's messages.
    pub fn position(&self) -> MergerPosition {
        self.merger.position()
    }

    /// The estimate now.
    pub fn estimate(&self) -> Estimate {
        self.judged().1
    }

    /// The body's pose in the LiDAR's odometry frame at the last scan or pose that was used.
    pub fn base_pose(&self) -> Option<(RobotTime, Pose2)> {
        self.follower.as_ref()?.base_pose()
    }

    /// The filter, once it has started.
    pub fn filter(&self) -> Option<&Filter> {
        self.follower.as_ref().map(|follower| &follower.filter)
    }

    /// Knowledge of the scanner: the times of its beams, the errors of its ranges, and its line of
    /// the floor.
    pub fn scanner(&self) -> ScannerReport {
        self.lidar_odometry.scanner()
    }

    /// Changes and faults of this session, oldest first.
    pub fn changes(&self) -> &[Change] {
        &self.session.changes
    }

    /// The stretches of this session over which the vehicle stayed the same.
    pub fn segments(&self) -> Vec<Segment> {
        self.session.segments_with(self.estimate().parameters)
    }

    /// Every manoeuvre of the library with the knowledge that it would add for this robot now.
    pub fn advice(&self) -> Vec<Advice> {
        self.with_knowledge(advise)
    }

    /// Manoeuvres that the robot should drive next: those that fit on the floor, the best first.
    pub fn next_manoeuvres(&self, floor: Option<Floor>) -> Vec<Ranked> {
        self.with_knowledge(|knowledge| rank(knowledge, floor))
    }

    fn with_knowledge<T>(&self, of: impl FnOnce(&Knowledge) -> T) -> T {
        let (values, covariance) = match self.filter() {
            Some(filter) => (*filter.values(), filter.parameter_covariance()),
            None => (self.prior.values, self.prior.covariance),
        };
        of(&Knowledge {
            vehicle: &self.config.vehicle,
            values: &values,
            covariance: &covariance,
            settings: &self.config.settings,
        })
    }

    /// Distance driven so far in each kind of motion.
    pub fn excitation(&self) -> &Excitation {
        &self.session.excitation
    }

    /// Seconds of message time since the session's first message.
    pub fn duration_s(&self) -> f64 {
        self.session.duration_s()
    }

    fn start_session(&mut self, stamp: RobotTime, effects: &mut Vec<Effect>) {
        self.drive.clear();
        self.told = None;
        self.come_back(Occasion::NewSession);
        self.session = Session::starting(stamp);
        effects.push(Effect::SessionStarted(stamp));
    }

    /// Begins after a long absence: the robot may be another one now, in another place, and poses
    /// and map from before mean nothing after it.
    fn come_back(&mut self, occasion: Occasion) {
        self.waiting.clear();
        self.lidar_odometry.begin_anew();
        self.begin_comparison(occasion);
    }

    fn drop_message(&mut self, dropped: Dropped, effects: &mut Vec<Effect>) {
        self.session.count_dropped(dropped);
        effects.push(Effect::Dropped(dropped));
    }

    fn take(&mut self, stamp: RobotTime, event: Event, effects: &mut Vec<Effect>) {
        self.session.now = self.session.now.max(stamp);
        match event {
            Event::WheelOdometry(sample) => self.take_drive(sample),
            Event::Scan(scan) => self.take_scan(&scan, effects),
            Event::LidarPose(pose) => self.take_pose(&pose),
            Event::Note(_) | Event::EndOfSession => {}
        }
        self.work_off(false, effects);
        let now = self.session.now;
        if self
            .told
            .is_none_or(|told| now.seconds_since(told) >= TELL_EVERY_S)
        {
            self.tell(effects);
        }
    }

    fn take_drive(&mut self, sample: DriveSample) {
        let last = self.drive.newest();
        let vehicle = &self.config.vehicle;
        self.session.count_drive(&sample, vehicle, last);
        if last.is_some_and(|last| sample.stamp().seconds_since(last) > NEW_SESSION_GAP_S) {
            self.come_back(Occasion::NewSession);
        }
        self.drive.push(sample);
    }

    fn take_note(&mut self, note: &Note, effects: &mut Vec<Effect>) {
        let occasion = match note.kind {
            NoteKind::Reassembled => Occasion::Reassembled,
            NoteKind::PowerOn => Occasion::NewSession,
            NoteKind::Maintenance => return,
        };
        self.come_back(occasion);
        if self.session.began.is_some() {
            // Nobody should use for another second what holds no more.
            self.tell(effects);
        }
    }

    fn take_scan(&mut self, scan: &Scan, effects: &mut Vec<Effect>) {
        let pose = self.lidar_odometry.process(scan);
        effects.extend(pose.clone().map(Box::new).map(Effect::LidarMoved));
        let pose = pose.filter(|pose| pose.tracking != Tracking::Lost);
        let is_guess = pose.as_ref().is_none_or(is_guess);
        let (distance_m, time_s) = (self.session.distance_m, self.session.duration_s());
        let lost_since_s = self.odometry_watch.note(is_guess, distance_m, time_s);
        if let Some(onset_s) = lost_since_s
            && !self.watch.has_fault()
        {
            self.report(ChangeKind::Fault, Cause::Odometry, onset_s, &[], effects);
        }
        let Some(pose) = pose else {
            self.drop_message(Dropped::UnusableScan, effects);
            return;
        };
        if let Some(by) = pose.misled_by {
            self.unlearn(by);
        }
        let reading = OdometryReading {
            stamp: pose.stamp,
            lidar_in_odom: pose.lidar_in_odom,
            covariance: pose.covariance + of_open_direction(pose.unconstrained_rad),
        };
        let restarted = pose.map_restarted || pose.tracking == Tracking::Recovered;
        self.wait(Waiting {
            reading,
            is_guess,
            restarted,
            in_new_map: pose.map_restarted,
        });
    }
    fn take_pose(&mut self, pose: &LidarPose) {
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
            is_guess: false,
            restarted: false,
            in_new_map: false,
        });
    }

    fn wait(&mut self, waiting: Waiting) {
        self.session.counts.scans += 1;
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
                Some(follower) => follower.due(&front.reading, &self.config.settings),
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

    fn tell(&mut self, effects: &mut Vec<Effect>) {
        let (trust, estimate) = self.judged();
        self.trust = trust;
        self.told = Some(self.session.now);
        // Until a new session has been held against the stored calibration, the latter is told.
        if self.comparison.is_none()
            && let Some(follower) = &self.follower
        {
            let known = self.watch.long_run().known(&follower.filter);
            self.session.update_last_change(&known.values);
            self.size_change(&estimate.parameters, effects);
        }
        effects.push(Effect::Estimate(Box::new(estimate)));
    }

    /// The stored calibration that holds until it is contradicted.
    fn held(&self) -> Option<&Comparison> {
        let stored = self.comparison.as_ref();
        stored.filter(|comparison| comparison.occasion == Occasion::NewSession)
    }

    /// The claim about the vehicle now: a stored calibration holds until it is contradicted, unless
    /// somebody reported that the vehicle was taken apart.
    fn claim(&self) -> Claim {
        let settings = &self.config.settings;
        match (self.held(), self.filter()) {
            (Some(held), _) => held.claim(settings),
            // Errors that last for metres: the filter takes them as independent.
            (None, Some(filter)) => self.claim_of(filter),
            (None, None) => {
                let Prior {
                    values, covariance, ..
                } = &self.prior;
                Claim::new(SigmaSource::Prior, *values, covariance, settings)
            }
        }
    }

    /// The terms of each published sigma; none of a parameter that is off.
    pub fn sigma_terms(&self) -> BTreeMap<Parameter, Vec<SigmaTerm>> {
        let claim = self.claim();
        let settings = &self.config.settings;
        let published = |parameter: &Parameter| settings.freedom(*parameter) != Freedom::Off;
        Parameter::ALL
            .into_iter()
            .filter(published)
            .map(|parameter| (parameter, claim.sigma_terms(parameter)))
            .collect()
    }

    /// The estimate that is published now, and the trust that it leaves.
    fn judged(&self) -> (Trust, Estimate) {
        let mut trust = self.trust.clone();
        let claim = self.claim();
        let parameters = self.judge(&mut trust, &claim);
        let now = self.drive.now();
        let base_in_odom = self.filter().and_then(Filter::base_in_odom);
        let estimate = Estimate {
            stamp: self.session.now,
            time_s: self.session.duration_s(),
            distance_m: self.session.distance_m,
            covariance: reported_covariance(&parameters, claim.covariance()),
            steering_table: self.steering_table(&claim, &parameters),
            parameters,
            reassembly_open: self.reassembly_open,
            detection: self.detection(),
            consistency: self.session.consistency(),
            counts: self.session.counts,
            base_in_odom: base_in_odom.unwrap_or(Pose2::IDENTITY).wrapped(),
            drive_now: [now.speed_mps, now.steering_rad],
        };
        (trust, estimate)
    }

    fn steering_table(&self, claim: &Claim, parameters: &ParameterEstimates) -> SteeringTable {
        let offset = &parameters[Parameter::SteeringOffset.index()];
        let stored = self.held().and_then(|held| held.driven);
        let driven = [stored, self.session.excitation.steered.range()];
        let driven = driven.into_iter().flatten().reduce(SteeringRange::joined);
        let limits = &self.config.settings.converged_sigma;
        claim.steering_table(offset, driven, *limits.get(Parameter::SteeringOffset))
    }

    fn judge(&self, trust: &mut Trust, claim: &Claim) -> ParameterEstimates {
        let prior_sigma = Values::from_fn(|i, _| self.prior.covariance[(i, i)].sqrt());
        trust.judge(&Grounds {
            now: self.session.now,
            prior_sigma: &prior_sigma,
            blind: self.blind(),
            lacks_beam_times: self.lacks_beam_times(),
            has_impossible_steering: self.session.has_impossible_steering(),
            claim,
            one_sidedness: self.session.excitation.one_sidedness(),
            knowledge: Knowledge {
                vehicle: &self.config.vehicle,
                values: claim.values(),
                covariance: claim.covariance(),
                settings: &self.config.settings,
            },
        })
    }

    /// State of detection for each cause.
    fn detection(&self) -> Detection {
        if self.held().is_some() || self.follower.is_none() {
            return Detection::of_all(DetectionState::FirstEstimate);
        }
        let [steering, lidar_mount, vehicle] = self.watch.detection();
        Detection {
            steering,
            lidar_mount,
            vehicle,
        }
    }

    /// True if the stamps of scans may be off by a part of a turn that nobody knows.
    fn lacks_beam_times(&self) -> bool {
        self.scanner().beam_times == BeamTimes::Missing
    }

    /// Parameters of which a change would go unseen. A stored calibration is held against the session.
    fn blind(&self) -> [bool; Parameter::ALL.len()] {
        Parameter::ALL.map(|p| self.held().is_none() && self.watch.is_blind(p))
    }

    /// The parameters as judged for a filter of this session.
    fn judge_filter(&self, filter: &Filter) -> ParameterEstimates {
        self.judge(&mut self.trust.clone(), &self.claim_of(filter))
    }

    /// The claim of a filter of this session.
    fn claim_of(&self, filter: &Filter) -> Claim {
        let grounds = claim::Grounds {
            vehicle: &self.config.vehicle,
            settings: &self.config.settings,
            long_run: self.watch.long_run(),
            drive: &self.drive,
            excitation: &self.session.excitation,
            saw_start: !self.session.began_in_motion,
            suspicion: self.watch.suspicion(),
        };
        Claim::of_filter(filter, &grounds)
    }

    /// Stored values, with the uncertainty of now.
    fn judge_values(&self, values: &Values) -> ParameterEstimates {
        let (source, covariance) = self
            .filter()
            .map_or((SigmaSource::Prior, self.prior.covariance), |filter| {
                (SigmaSource::Filter, filter.parameter_covariance())
            });
        let claim = Claim::new(source, *values, &covariance, &self.config.settings);
        self.judge(&mut self.trust.clone(), &claim)
    }
}
