//! Following of LiDAR poses by the filter: its start, its way, and its return to before a change.

use super::comparison::{COMPARED, Comparison, Occasion, SESSIONS, Verdict, knows_enough};
use super::session::AT_REST_MPS;
use super::{Calibrator, CalibratorConfig};
use crate::change::evidence::change_sigma;
use crate::change::{ChangeWatch, Detected};
use crate::estimate::{Cause, Change, ChangeKind, Parameter, ParameterEstimates, Status};
use crate::excitation::Excitation;
use crate::filter::follow::{Followed, Follower};
use crate::filter::prior::Prior;
use crate::filter::{Filter, OdometryReading, ParameterCovariance, Values};
use crate::initial_guess::{agrees_with, initial_guess};
use crate::lidar_odometry::MisledBy;
use crate::stream::{Effect, RobotTime};
use crate::trust::Trust;
use crate::vehicle::SteeringResponse;

/// Most LiDAR poses kept: an hour of them is not needed for a first guess.
const READINGS_MAX: usize = 1200;
/// New readings after which a new guess is tried,
const GUESS_EVERY: usize = 5;
/// but not before this share of all readings is new: of a robot that only circles a few show no
/// more.
const GUESS_SHARE: usize = 16;

/// Largest distance of a LiDAR from the rear axle, in wheelbases,
const MOUNT_REACH_WHEELBASES: f64 = 2.0;
/// plus this, m.
const MOUNT_REACH_M: f64 = 2.0;

/// A LiDAR pose waiting for its drive samples.
#[derive(Debug, Clone)]
pub(super) struct Waiting {
    pub reading: OdometryReading,
    /// True if the odometry does not know its way there.
    pub is_guess: bool,
    /// True if poses before it do not compare with it.
    pub restarted: bool,
    /// True if that is so because tracking restarted in a new map.
    pub in_new_map: bool,
}

impl Calibrator {
    /// Begins the filter again from the next pose. In a new map poses before do not compare with
    /// those to come; found again in the same one, they show whether the robot was carried away.
    pub(super) fn begin_again(&mut self, in_new_map: bool) {
        self.forget_readings();
        if in_new_map {
            self.watch.break_window();
        }
        if let Some(follower) = self.follower.as_mut() {
            follower.lose_anchor();
        }
    }

    /// Follows a LiDAR pose whose drive samples are there.
    pub(super) fn follow(&mut self, waiting: &Waiting, effects: &mut Vec<Effect>) {
        if waiting.restarted {
            self.begin_again(waiting.in_new_map);
        }
        if self.follower.is_none() && waiting.is_guess {
            // No filter begins on guesses.
            self.forget_readings();
            return;
        }
        if self.follower.is_none() && !self.knows_steering_before(waiting.reading.stamp) {
            return;
        }
        if self.readings.len() >= READINGS_MAX {
            self.readings.pop_front();
        }
        self.readings.push_back(waiting.reading);
        if self.follower.is_none() {
            self.seek_start();
            return;
        }
        if !self.watch.has_fault() {
            self.give_up_unproven();
            self.follow_reading(&waiting.reading);
            self.take_second_pass();
        }
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
            match detected.kind {
                ChangeKind::Fault => self.fail(&detected, effects),
                _ => self.change(&detected, effects),
            }
        }
        if self.filter().is_some_and(|filter| !self.can_be(filter)) {
            self.give_up();
        }
        // Nothing is held against values that are about to be found once more.
        if self.is_proven() {
            self.compare(effects);
            self.check_drift(effects);
        }
    }

    /// True if a filter's mount is one that a robot can have.
    fn can_be(&self, filter: &Filter) -> bool {
        let [x_m, y_m] = [Parameter::LidarX, Parameter::LidarY].map(|p| filter.values()[p.index()]);
        let nominal_m = self
            .config
            .nominal_lidar_in_base
            .map_or(0.0, |nominal| nominal.translation().norm());
        let reach_m = MOUNT_REACH_WHEELBASES * self.config.vehicle.wheelbase_m + MOUNT_REACH_M;
        x_m.hypot(y_m) < reach_m + nominal_m
    }

    /// Gives up a filter whose values are impossible: the next begins from nothing.
    pub(super) fn give_up(&mut self) {
        self.follower = None;
        self.baseline = None;
        self.forget_readings();
        self.watch.restart();
    }

    /// Forgets what misled poses taught: the filter begins from nothing. Where the floor misled
    /// them, a known calibration is found again and compared with its former values: its LiDAR may
    /// have been knocked just now. The vehicle's parameters beyond its calibration were learnt over
    /// all its way and stay: a filter that begins while the robot drives often finds other values,
    /// and stays with them.
    pub(super) fn unlearn(&mut self, by: MisledBy) {
        self.waiting.clear();
        let knows =
            |filter: &&Filter| knows_enough(&self.known_of(filter).1, &self.config.settings);
        let known = self.filter().filter(knows).cloned();
        let is_kept = by == MisledBy::Floor && self.is_proven();
        if let Some(mut filter) = known.filter(|_| is_kept) {
            self.begin_comparison(Occasion::NewSession);
            filter.lose_anchor();
            filter.reopen(&COMPARED, change_sigma);
            self.follower = Some(Follower::new(filter));
            return;
        }
        if by == MisledBy::BeamTimes {
            // What was stored was learnt with the same beam times.
            let is_reassembled = |stored: &Comparison| stored.occasion == Occasion::Reassembled;
            self.comparison = self.comparison.take().filter(is_reassembled);
        }
        self.former_mount = self.filter().map(|filter| {
            let x = Parameter::LidarX.index();
            filter.values().fixed_rows::<3>(x).into_owned()
        });
        self.follower = None;
        self.baseline = None;
        self.forget_readings();
        self.session.unlearn();
        self.watch = ChangeWatch::default();
        self.trust = Trust::default();
    }

    /// Knowledge of a filter: its values, and the covariance that they are compared by.
    pub(super) fn known_of(&self, filter: &Filter) -> (Values, ParameterCovariance) {
        let known = self.watch.long_run().known(filter);
        let scatter = self.watch.long_run().scatter(&known.covariance);
        (known.values, scatter.claim())
    }

    /// A guess with the mount that a filter had before, where the two agree: no evidence, but nearer to
    /// linearise at.
    fn with_former(&self, guess: Prior) -> Prior {
        let Some(mount) = self.former_mount else {
            return guess;
        };
        let mut former = guess.clone();
        let x = Parameter::LidarX.index();
        former.values.fixed_rows_mut::<3>(x).copy_from(&mount);
        if agrees_with(&former, &guess) {
            former
        } else {
            guess
        }
    }

    fn follow_reading(&mut self, reading: &OdometryReading) {
        let Some(follower) = self.follower.as_mut() else {
            return;
        };
        let followed = follower.follow(reading, &self.drive, &self.config.settings);
        if let Followed::Updated(moved) = followed {
            let wheelbase_m = self.config.vehicle.wheelbase_m;
            self.session
                .count_update(reading.stamp, &moved, wheelbase_m);
        }
    }

    /// Looks for the filter's start: guesses, and starts from the first of the readings.
    fn seek_start(&mut self) {
        self.since_guess += 1;
        if self.since_guess < GUESS_EVERY.max(self.readings.len() / GUESS_SHARE) {
            return;
        }
        self.since_guess = 0;
        let config = &self.config;
        let vehicle = &config.vehicle;
        let readings = self.readings.make_contiguous();
        let Some(guess) = initial_guess(vehicle, &self.prior, readings, &self.drive) else {
            return;
        };
        let prior = with_nominal(config, self.with_former(guess));
        let filter = Filter::new(*vehicle, &config.settings, &prior);
        self.former_mount = None;
        self.failed_pass = None;
        self.session.began_in_motion = self.drove_throughout();
        if self.session.began_in_motion {
            self.plan_second_pass(prior);
        }
        self.follow_again(Follower::new(filter), None);
    }

    /// True if the robot has driven ever since the first of the readings.
    fn drove_throughout(&self) -> bool {
        let speed_mps = |reading: &OdometryReading| {
            let response = SteeringResponse::default();
            self.drive.at(reading.stamp, response).speed_mps
        };
        self.readings
            .iter()
            .all(|reading| speed_mps(reading).abs() > AT_REST_MPS)
    }

    /// Starts a follower and takes it through the readings from a time on.
    fn follow_again(&mut self, follower: Follower, from: Option<RobotTime>) {
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

    /// Sets the filter back to before a fault, and waits until that is over.
    fn fail(&mut self, detected: &Detected, effects: &mut Vec<Effect>) {
        let mut filter = detected.filter_before.clone();
        filter.lose_anchor();
        self.follower = Some(Follower::new(filter));
        if let Some(pass) = self.second_pass.take() {
            self.failed_pass = Some(pass);
        }
        self.forget_readings();
        if detected.cause == Cause::Odometry && self.odometry_watch.is_told() {
            return;
        }
        let onset_s = self.session.seconds_to(detected.onset.0);
        self.report(detected.kind, detected.cause, onset_s, &[], effects);
    }

    /// Goes back to before the onset of a change, opens the moved parameters, and follows again, so
    /// that nothing which was absorbed since then stays in the other parameters. While a reassembly
    /// is open nothing is reported: its verdict includes all that has moved since before it.
    fn change(&mut self, detected: &Detected, effects: &mut Vec<Effect>) {
        let (onset, after_onset) = detected.onset;
        self.baseline = None;
        self.second_pass = None;
        let onset_s = self.session.seconds_to(onset);
        if !self.reassembly_open {
            let before = self.judge_filter(&detected.filter_before);
            self.session.close_segment(onset_s, before);
        }

        let mut filter = detected.filter_before.clone();
        filter.lose_anchor();
        filter.reopen(&detected.parameters, change_sigma);
        self.watch.restart();
        self.follow_again(Follower::new(filter), Some(after_onset));
        if !self.reassembly_open {
            let kind = ChangeKind::CalibrationChanged;
            self.report(kind, detected.cause, onset_s, &detected.parameters, effects);
        }
    }

    /// Starts the filter from scratch, to be compared with the present knowledge. The floor's
    /// caller puts the filter back in its place, with the compared parameters opened.
    pub(super) fn begin_comparison(&mut self, occasion: Occasion) {
        if let Some(follower) = self.follower.take() {
            let filter = &follower.filter;
            let (values, covariance) = self.known_of(filter);
            let settings = &self.config.settings;
            // An unfinished session has learnt nothing that a comparison could be held to.
            let is_worth_it = self.is_proven() && knows_enough(&covariance, settings);
            if self.comparison.is_none() && is_worth_it {
                let stored = Comparison {
                    driven: self.session.excitation.steered.range(),
                    ..Comparison::new(occasion, values, &covariance, settings)
                };
                self.comparison = Some(stored.told_with(self.claim_of(filter).covariance()));
            }
        }
        if let Some(comparison) = self.comparison.as_mut()
            && occasion == Occasion::Reassembled
        {
            comparison.occasion = occasion;
        }
        if occasion == Occasion::Reassembled {
            self.reassembly_open = true;
            self.trust.withdraw();
        }
        self.session.excitation = Excitation::default();
        self.baseline = None;
        self.forget_readings();
        self.watch.restart();
    }

    /// Compares the new session with the stored calibration, once it knows enough. For a reported
    /// reassembly of a robot without one, the verdict is then that there is nothing to compare
    /// with.
    fn compare(&mut self, effects: &mut Vec<Effect>) {
        let Some(filter) = self.filter() else {
            return;
        };
        if self.comparison.is_none() && !self.reassembly_open {
            return;
        }
        let settings = &self.config.settings;
        let (values, covariance) = self.known_of(filter);
        if !knows_enough(&covariance, settings) {
            return;
        }
        self.reassembly_open = false;
        let Some(stored) = self.comparison.take() else {
            let kind = ChangeKind::CalibrationLearned;
            self.report(kind, Cause::Unknown, 0.0, &[], effects);
            return;
        };
        let settings = &self.config.settings;
        match stored.verdict(&values, &covariance, settings, &SESSIONS) {
            Verdict::Same => {
                if let Some(follower) = self.follower.as_mut() {
                    let filter = &mut follower.filter;
                    filter.fuse(&COMPARED, &stored.values, &stored.covariance);
                }
                let kind = ChangeKind::CalibrationConfirmed;
                self.report(kind, Cause::Unknown, 0.0, &[], effects);
            }
            Verdict::Changed(cause, parameters) => {
                let before = self.judge_values(&stored.values);
                self.session.close_segment(0.0, before);
                let kind = ChangeKind::CalibrationChanged;
                self.report(kind, cause, 0.0, &parameters, effects);
            }
        }
    }

    /// Publishes the amount of the last change as soon as it is known, where it was not known at
    /// first.
    pub(super) fn size_change(&mut self, now: &ParameterEstimates, effects: &mut Vec<Effect>) {
        let Some(change) = self.session.last_change() else {
            return;
        };
        if self.session.unsized_change && are_known(change, now) {
            effects.push(Effect::ChangeSized(Box::new(change.clone())));
            self.session.unsized_change = false;
        }
    }

    pub(super) fn report(
        &mut self,
        kind: ChangeKind,
        cause: Cause,
        onset_s: f64,
        parameters: &[Parameter],
        effects: &mut Vec<Effect>,
    ) {
        self.session.note_change(Change {
            kind,
            cause,
            stamp: self.session.now,
            time_s: self.session.duration_s(),
            onset_s,
            change: parameters.iter().map(|&p| (p, 0.0)).collect(),
        });
        let values = self
            .filter()
            .map_or(Values::zeros(), |f| self.watch.long_run().known(f).values);
        self.session.update_last_change(&values);
        let parameters = self.judged().1.parameters;
        if let Some(change) = self.session.changes.last() {
            let mut told = change.clone();
            if !are_known(change, &parameters) {
                // How far is not known yet; it is told when it is.
                told.change.clear();
            }
            if kind == ChangeKind::CalibrationChanged {
                self.session.unsized_change = told.change.is_empty();
            }
            effects.push(Effect::Change(Box::new(told)));
        }
        self.tell(effects);
    }
}

/// True if all parameters that a change moved are known again.
fn are_known(change: &Change, now: &ParameterEstimates) -> bool {
    let is_open = |(parameter, _): &(Parameter, f64)| {
        let status = now[parameter.index()].status;
        matches!(status, Status::Learning | Status::Unobservable)
    };
    !change.change.iter().any(is_open)
}

/// A guess joined with the nominal mount, where the two agree: the nominal mount is evidence too.
pub(super) fn with_nominal(config: &CalibratorConfig, guess: Prior) -> Prior {
    let Some(nominal) = config.nominal_lidar_in_base else {
        return guess;
    };
    let nominal = Prior::cold(&config.vehicle, Some(nominal), &config.settings);
    if !agrees_with(&nominal, &guess) {
        return guess;
    }
    // The guess is where to linearise; what is believed is the nominal mount's uncertainty around it.
    let x = Parameter::LidarX.index();
    let mut joined = guess;
    joined
        .covariance
        .fixed_view_mut::<3, 3>(x, x)
        .copy_from(&nominal.covariance.fixed_view::<3, 3>(x, x));
    joined
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::vehicle::{Vehicle, VehicleModel};

    #[test]
    fn what_was_stored_is_dropped_where_beam_times_misled_and_kept_where_the_floor_did() {
        let vehicle = Vehicle::new(VehicleModel::Bicycle, 1.2);
        let is_kept = |occasion: Occasion, by: MisledBy| {
            let mut calibrator = Calibrator::new(CalibratorConfig::of(vehicle));
            let settings = calibrator.config.settings.clone();
            let covariance = ParameterCovariance::identity() * 1e-8;
            let stored = Comparison::new(occasion, Values::zeros(), &covariance, &settings);
            calibrator.comparison = Some(stored);
            calibrator.unlearn(by);
            calibrator.comparison.is_some()
        };
        assert!(!is_kept(Occasion::NewSession, MisledBy::BeamTimes));
        // A person said that parts were off: the scanner may be another one.
        assert!(is_kept(Occasion::Reassembled, MisledBy::BeamTimes));
        assert!(is_kept(Occasion::NewSession, MisledBy::Floor));
    }
}
