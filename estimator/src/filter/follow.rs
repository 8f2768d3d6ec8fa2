//! Following a robot: the readings that the filter uses, their time, and their anchor.

use serde::{Deserialize, Serialize};

use super::{Filter, Innovation, OdometryReading, steering_response};
use crate::drive_history::DriveHistory;
use crate::estimate::Parameter;
use crate::geometry::Pose2;
use crate::settings::EstimatorSettings;
use crate::stream::RobotTime;
use crate::vehicle::SteeringResponse;

/// Way since the last used reading after which one is used, m: readings of a robot at rest repeat
/// one error and would be averaged as if they were many.
const MOVED_MIN_M: f64 = 0.02;
/// Turn after which one is used, rad.
const MOVED_MIN_RAD: f64 = 0.01;
/// Time beyond the time offset for which drive samples are awaited: the reading itself may change
/// it, s.
const DUE_MARGIN_S: f64 = 0.03;
/// Turn after which a new anchor is placed, rad.
const ANCHOR_TURN_RAD: f64 = 2.0;

/// Result of following a reading.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Followed {
    /// Reading that is the anchor now; nothing was measured.
    Anchored,
    /// Reading of a robot that has not moved: kept for later.
    AtRest,
    /// Reading that the filter was updated with.
    Updated(Moved),
    /// Reading that could not be used: its drive time lies behind the filter's, or ahead of all
    /// drive samples.
    Unusable,
}

/// An update and the motion it was about.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Moved {
    /// The filter's innovation.
    pub innovation: Innovation,
    /// Distance since the update before, m, negative in reverse.
    pub distance_m: f64,
    /// Turn since the update before, rad.
    pub turn_rad: f64,
    /// Measured steering angle that the wheel followed at the update, rad.
    pub steering_rad: f64,
}

/// A filter and its progress.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Follower {
    /// The filter.
    pub filter: Filter,
    /// Drive time up to which the filter has predicted.
    reached: Option<RobotTime>,
    /// The last reading that was used.
    last_used: Option<(RobotTime, Pose2)>,
}

impl Follower {
    /// Follows with a filter that has no anchor yet.
    pub fn new(filter: Filter) -> Self {
        Self {
            filter,
            reached: None,
            last_used: None,
        }
    }

    /// The drive time a reading belongs to.
    pub fn drive_time(&self, reading: &OdometryReading, settings: &EstimatorSettings) -> RobotTime {
        let limit_s = settings.time_offset_max_s;
        let offset_s = self
            .filter
            .value(Parameter::TimeOffset)
            .clamp(-limit_s, limit_s);
        reading.stamp.plus_seconds(offset_s)
    }

    /// The drive time until which samples have to be there for a reading: where the sensor of the
    /// steering is behind the wheel, its readings arrive later.
    pub fn due(&self, reading: &OdometryReading, settings: &EstimatorSettings) -> RobotTime {
        let SteeringResponse { lag_s, spread_s2 } = steering_response(self.filter.values());
        let early_s = (spread_s2.sqrt() - lag_s).max(0.0);
        self.drive_time(reading, settings)
            .plus_seconds(early_s + DUE_MARGIN_S)
    }

    /// The body's pose in the LiDAR's odometry frame at the last reading that was used.
    pub fn base_pose(&self) -> Option<(RobotTime, Pose2)> {
        let (stamp, _) = self.last_used?;
        Some((stamp, self.filter.base_in_odom()?))
    }

    /// Gives up the anchor: the next poses do not compare with those before.
    pub fn lose_anchor(&mut self) {
        self.filter.lose_anchor();
        self.reached = None;
    }

    /// Follows a reading whose drive samples are all in the history.
    pub fn follow(
        &mut self,
        reading: &OdometryReading,
        drive: &DriveHistory,
        settings: &EstimatorSettings,
    ) -> Followed {
        let to = self.drive_time(reading, settings);
        let from = match self.reached {
            Some(from) if self.filter.is_anchored() && drive.covers(from, to) => from,
            Some(from) if to <= from => return Followed::Unusable,
            // Readings that are followed again do not wait: the time offset may have grown meanwhile.
            _ if drive.newest().is_none_or(|newest| newest < to) => return Followed::Unusable,
            _ => return self.anchor_at(reading, to, drive),
        };
        let response = steering_response(self.filter.values());
        // 1. Predict up to the reading's time.
        for segment in drive.segments(from, to, response) {
            self.filter.predict(&segment);
        }
        self.reached = Some(to);
        // 2. At rest, wait; and where the steering jumps, until it is over.
        if !self.has_moved(reading) || drive.jumps_at(to, response) {
            return Followed::AtRest;
        }
        // 3. Update, and move the anchor along.
        if let Some((last, _)) = self.last_used {
            self.filter
                .drift(reading.stamp.seconds_since(last).max(0.0));
        }
        let (since_m, since_rad) = self.filter.since_anchor();
        let predicted = self.filter.predicted();
        let new_anchor = since_m + predicted.distance_m >= settings.anchor_distance_m
            || since_rad + predicted.turned_rad >= ANCHOR_TURN_RAD;
        self.last_used = Some((reading.stamp, reading.lidar_in_odom));
        let (distance_m, turn_rad) = (predicted.end_in_begin.x_m, predicted.end_in_begin.yaw_rad);
        match self.filter.update(reading, new_anchor) {
            Some(innovation) => Followed::Updated(Moved {
                innovation,
                distance_m,
                turn_rad,
                steering_rad: drive.at(to, response).steering_rad,
            }),
            None => self.anchor_at(reading, to, drive),
        }
    }

    fn has_moved(&self, reading: &OdometryReading) -> bool {
        let predicted = self.filter.predicted();
        if predicted.distance_m >= MOVED_MIN_M || predicted.turned_rad >= MOVED_MIN_RAD {
            return true;
        }
        let Some((_, last)) = &self.last_used else {
            return false;
        };
        let moved = last.between(&reading.lidar_in_odom).wrapped();
        moved.translation().norm() >= MOVED_MIN_M || moved.yaw_rad.abs() >= MOVED_MIN_RAD
    }

    fn anchor_at(
        &mut self,
        reading: &OdometryReading,
        at: RobotTime,
        drive: &DriveHistory,
    ) -> Followed {
        let response = steering_response(self.filter.values());
        self.filter.start_anchor(reading, drive.at(at, response));
        self.reached = Some(at);
        self.last_used = Some((reading.stamp, reading.lidar_in_odom));
        Followed::Anchored
    }
}
