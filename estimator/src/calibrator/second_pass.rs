//! Second pass over the first readings of a filter that begins while the robot drives.
//!
//! From rest, lag, play and curve of the steering show one after the other as the robot sets off. On the way
//! all of them are wrong at once: the filter linearises far from where it arrives and stays with what it
//! found there, so that the data of a robot with every imperfection scatter and its changes go unseen. After
//! some metres it therefore begins once more, near where it has arrived and as unsure as it was at first, like
//! a second step of Gauss-Newton over these readings. The prior's mean moves along: where a parameter was
//! learnt to three quarters, its variance comes out up to a tenth too small.
//!
//! The first guess was made of the first few readings. Where the odometry had not found its way by
//! then, as may be with a scanner that sees the floor, the mount came out metres away, and the
//! filter does not come back from there. So the pass also begins at a guess by the later readings,
//! where that is another mount, and the filter begins from nothing where a fault, a disagreement of
//! wheels and LiDAR, was found before it was passed twice. A map that begins again, or a restart,
//! loses the pass.

use super::following::with_nominal;
use super::session::is_at_rest;
use super::{Calibrator, CalibratorConfig};
use crate::change::ChangeWatch;
use crate::change::long_run::LongRunVariance;
use crate::filter::follow::Follower;
use crate::filter::prior::Prior;
use crate::filter::{Filter, OdometryReading, STEERING_PLAY, apart};
use crate::initial_guess::{agrees_with, initial_guess};
use crate::stream::RobotTime;

/// Way after which the pass is due, m: 40 s at 0.3 m/s, less than the drive's history.
const WAY_M: f64 = 12.0;
/// Shortest way of readings that a pass is made over, m: of a robot that waited, the others are
/// gone.
const WAY_MIN_M: f64 = 6.0;
/// Time for which the wheels follow earlier steering, s: a strong lag, and the spread of its
/// response.
const STEERED_BEFORE_S: f64 = 1.0;

/// A pass that is due when the robot has driven some way.
#[derive(Debug, Clone)]
pub(super) struct SecondPass {
    /// Prior of the first pass.
    prior: Prior,
    /// Scatter of the windows before it.
    long_run: LongRunVariance,
    /// Way of the session at which it is due, m.
    due_m: f64,
}

impl Calibrator {
    /// True if the drive shows how the wheels were steered before a time. For a robot that drove
    /// already when its first sample arrived nothing is known from before that.
    pub(super) fn knows_steering_before(&self, stamp: RobotTime) -> bool {
        self.drive.oldest().is_some_and(|oldest| {
            let since_s = stamp.seconds_since(oldest.stamp());
            is_at_rest(&oldest) || since_s >= STEERED_BEFORE_S
        })
    }

    /// Plans the second pass of a filter that begins with this prior, at the first of the readings.
    pub(super) fn plan_second_pass(&mut self, prior: Prior) {
        self.second_pass = Some(Box::new(SecondPass {
            prior,
            long_run: self.watch.long_run().clone(),
            due_m: self.session.distance_m - self.known_way_m() + WAY_M,
        }));
    }

    /// Way over which there are both readings and drive samples, m.
    fn known_way_m(&self) -> f64 {
        let newest = self.drive.newest();
        let ends = self.readings.front().zip(self.drive.oldest()).zip(newest);
        ends.map_or(0.0, |((first, oldest), newest)| {
            self.drive.driven_m(first.stamp.max(oldest.stamp()), newest)
        })
    }

    /// Takes the second pass when it is due, and stays with the first where that fits as well: the change test
    /// begins again with another filter, and judges and claims nothing for some 20 m.
    pub(super) fn take_second_pass(&mut self) {
        let distance_m = self.session.distance_m;
        let due = self
            .second_pass
            .take_if(|pass| distance_m >= pass.due_m)
            .zip(self.follower.as_ref());
        let Some((pass, first)) = due else {
            return;
        };
        if self.known_way_m() < WAY_MIN_M {
            return;
        }
        let readings: Vec<_> = self.readings.iter().copied().collect();
        let near = as_far_as_learnt(&pass.prior, &first.filter);
        let elsewhere = self.guessed_elsewhere(&near, &first.filter, &readings);
        let is_elsewhere = elsewhere.is_some();
        let second = elsewhere.unwrap_or_else(|| self.followed(&near, &readings));
        if !is_elsewhere && misfit(&second) >= misfit(first) {
            return;
        }
        // What was steered before the later readings is no start from rest.
        self.session.began_in_motion |= is_elsewhere;
        self.follower = Some(second);
        // The windows so far were held against values that are given up.
        self.watch = ChangeWatch::with_long_run(pass.long_run);
    }

    /// A filter from a guess by the later half of the readings, and over them, where the guess is another mount
    /// than a filter has found, and fits them better than one that begins near it: that one began with the first
    /// few, and the odometry may not have found its way by then.
    fn guessed_elsewhere(
        &self,
        near: &Prior,
        filter: &Filter,
        readings: &[OdometryReading],
    ) -> Option<Follower> {
        let Self { config, drive, .. } = self;
        let later = readings.get(readings.len() / 2..)?;
        let guess = initial_guess(&config.vehicle, &self.prior, later, drive)?;
        let found = Prior {
            values: *filter.values(),
            covariance: filter.parameter_covariance(),
            ..self.prior.clone()
        };
        if agrees_with(&found, &guess) {
            return None;
        }
        let elsewhere = self.followed(&with_nominal(config, guess), later);
        (misfit(&elsewhere) < misfit(&self.followed(near, later))).then_some(elsewhere)
    }

    /// A filter that has followed these readings from a prior on.
    fn followed(&self, prior: &Prior, readings: &[OdometryReading]) -> Follower {
        let CalibratorConfig {
            vehicle, settings, ..
        } = &self.config;
        let mut follower = Follower::new(Filter::new(*vehicle, settings, prior));
        for reading in readings {
            follower.follow(reading, &self.drive, settings);
        }
        follower
    }

    /// True if others may be compared with the filter: it has been passed twice, or need not be.
    pub(super) fn is_proven(&self) -> bool {
        self.second_pass.is_none() && self.failed_pass.is_none()
    }

    /// Gives up a filter that met a fault before its second pass, with the scatter that its windows
    /// showed.
    pub(super) fn give_up_unproven(&mut self) {
        if let Some(pass) = self.failed_pass.take() {
            self.give_up();
            self.session.unlearn();
            self.watch = ChangeWatch::with_long_run(pass.long_run);
        }
    }

    /// Forgets the readings, and with them the second pass over them.
    pub(super) fn forget_readings(&mut self) {
        self.readings.clear();
        self.second_pass = None;
    }
}

/// Misfit of a filter to the readings that it followed: the factor by which the noise (as a
/// variance) turned out larger.
fn misfit(follower: &Follower) -> f64 {
    follower.filter.noise_scale()
}

/// A prior whose values lie between its own and those that a filter has found from it, each by the
/// share of its variance that is gone: a parameter that no reading shows yet only wanders, and
/// would wander on. No play is negative.
fn as_far_as_learnt(prior: &Prior, filter: &Filter) -> Prior {
    let before = prior.covariance.diagonal();
    let left = filter.parameter_covariance().diagonal();
    let learnt = before.zip_map(&left, |before, left| {
        if before > 0.0 {
            (1.0 - left / before).clamp(0.0, 1.0)
        } else {
            0.0
        }
    });
    let mut values = prior.values + learnt.component_mul(&apart(filter.values(), &prior.values));
    values[STEERING_PLAY] = values[STEERING_PLAY].max(0.0);
    Prior {
        values,
        ..prior.clone()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::calibrator::CalibratorConfig;
    use crate::estimate::Parameter;
    use crate::geometry::Pose2;
    use crate::settings::EstimatorSettings;
    use crate::stream::DriveSample;
    use crate::vehicle::{Vehicle, VehicleModel};

    fn second_s(seconds: f64) -> RobotTime {
        RobotTime(1_700_000_000_000_000_000).plus_seconds(seconds)
    }

    /// A robot that drives straight ahead, with a sample every 0.1 s.
    fn driven(speed_mps: f64, length_s: f64) -> Calibrator {
        let vehicle = Vehicle::new(VehicleModel::Bicycle, 1.2);
        let mut calibrator = Calibrator::new(CalibratorConfig::of(vehicle));
        for tick in 0..(length_s * 10.0) as i64 {
            let stamp = second_s(tick as f64 * 0.1);
            let sample = DriveSample::new(stamp, speed_mps, 0.0).unwrap();
            calibrator.drive.push(sample);
            calibrator.readings.push_back(OdometryReading {
                stamp,
                lidar_in_odom: Pose2::new(speed_mps * tick as f64 * 0.1, 0.0, 0.0),
                covariance: nalgebra::Matrix3::identity() * 1e-6,
            });
        }
        calibrator
    }

    #[test]
    fn what_was_steered_before_the_first_sample_is_known_of_a_robot_at_rest_alone() {
        assert!(driven(0.0, 5.0).knows_steering_before(second_s(0.1)));
        assert!(!driven(1.0, 5.0).knows_steering_before(second_s(0.9)));
        assert!(driven(1.0, 5.0).knows_steering_before(second_s(1.0)));
    }

    #[test]
    fn a_second_pass_is_due_after_its_way_and_not_taken_over_a_rest_of_the_readings() {
        let settings = EstimatorSettings::default();
        let mut calibrator = driven(1.0, 5.0);
        let prior = Prior::cold(&calibrator.config.vehicle, None, &settings);
        // Its LiDAR went twice as far as its wheels: the first pass fits badly.
        let mut first = Follower::new(Filter::new(calibrator.config.vehicle, &settings, &prior));
        for reading in &calibrator.readings {
            let mut far = *reading;
            far.lidar_in_odom.x_m *= 2.0;
            first.follow(&far, &calibrator.drive, &settings);
        }
        let badly = first.filter.noise_scale();
        let is_first = |calibrator: &Calibrator| {
            let scale = calibrator.filter().unwrap().noise_scale();
            assert!(badly > 1.5 && scale <= badly);
            scale > 1.5
        };
        calibrator.follower = Some(first);
        calibrator.plan_second_pass(prior);

        // 4.9 m are driven: 7.1 are missing.
        calibrator.session.distance_m = 7.0;
        calibrator.take_second_pass();
        assert!(calibrator.second_pass.is_some());
        calibrator.session.distance_m = 7.2;
        let mut waited = calibrator.clone();
        waited.take_second_pass();
        assert!(waited.second_pass.is_none() && is_first(&waited));

        let mut drove_on = driven(1.0, 12.2);
        drove_on.follower = calibrator.follower;
        drove_on.second_pass = calibrator.second_pass;
        drove_on.session.distance_m = 7.2;
        drove_on.take_second_pass();
        assert!(drove_on.second_pass.is_none() && !is_first(&drove_on));
    }

    #[test]
    fn the_second_pass_begins_as_far_away_as_was_learnt() {
        let vehicle = Vehicle::new(VehicleModel::Bicycle, 1.2);
        let settings = EstimatorSettings::default();
        let prior = Prior::cold(&vehicle, None, &settings);
        let mut found = prior.clone();
        let [offset, scale] =
            [Parameter::SteeringOffset, Parameter::SpeedScale].map(Parameter::index);
        found.values[offset] = 0.02;
        found.covariance[(offset, offset)] *= 0.25;
        // Nothing was learnt of the speed scale, and a negative play cannot be.
        found.values[scale] += 0.01;
        found.values[STEERING_PLAY] = -0.002;
        found.covariance[(STEERING_PLAY, STEERING_PLAY)] *= 0.01;

        let begin = as_far_as_learnt(&prior, &Filter::new(vehicle, &settings, &found));
        let is_at = |i: usize, value: f64| (begin.values[i] - value).abs() < 1e-12;
        assert!(is_at(offset, 0.015) && is_at(scale, prior.values[scale]));
        assert!(is_at(STEERING_PLAY, 0.0));
        assert_eq!(begin.covariance, prior.covariance);
    }
}
