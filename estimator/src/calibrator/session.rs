//! Counters of a session.

use std::collections::VecDeque;

use serde::{Deserialize, Serialize};

use crate::drive_history::GAP_MIN_S;
use crate::estimate::{
    Change, ChangeKind, Consistency, Counts, Innovation, ParameterEstimates, Segment,
};
use crate::excitation::Excitation;
use crate::filter::follow::Moved;
use crate::filter::{Values, apart, padded};
use crate::stream::{DriveSample, Dropped, RobotTime};
use crate::vehicle::Vehicle;

/// Speed below which a robot stands, m/s.
pub(super) const AT_REST_MPS: f64 = 0.02;
/// Shortest rest before a start, s: a speed of zero for less is a glitch of the encoder.
const REST_MIN_S: f64 = 0.15;
/// Samples over which the share of impossible steering angles is averaged: 10 s at 50 Hz.
const IMPOSSIBLE_STEERING_WINDOW: f64 = 500.0;
/// Largest share at which values are believed: a single sample, a fault of the encoder, stays
/// below it.
const IMPOSSIBLE_STEERING_SHARE_MAX: f64 = 0.005;
/// Readings over which NIS is averaged.
const NIS_WINDOW: usize = 200;
/// Degrees of freedom of one update: a motion in the plane.
const NIS_DOF: f64 = 3.0;
/// Most changes kept of a session.
const CHANGES_MAX: usize = 64;
/// Most of them in a checkpoint, the latest: each needs some 190 bytes, and 10 kB are there for
/// all.
const CHANGES_STORED_MAX: usize = 5;

/// True if the robot stands according to a sample.
pub(super) fn is_at_rest(sample: &DriveSample) -> bool {
    sample.speed_mps().abs() <= AT_REST_MPS
}

/// A stretch of one robot's life over which its clock went on.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub(super) struct Session {
    pub began: Option<RobotTime>,
    pub now: RobotTime,
    pub distance_m: f64,
    pub counts: Counts,
    pub excitation: Excitation,
    /// NIS of recent updates, in single precision, which is plenty for a mean: they are a tenth of
    /// a checkpoint.
    recent_nis: VecDeque<f32>,
    /// The latest innovation.
    #[serde(default)]
    innovation: Option<Innovation>,
    pub changes: Vec<Change>,
    pub segments: Vec<Segment>,
    /// The parameters before the last change, from which its amount is computed.
    #[serde(default, with = "padded")]
    values_before: Option<Values>,
    /// True if the amount of the last change is not published yet.
    #[serde(default)]
    pub unsized_change: bool,
    /// True if the robot drove when the filter began, and has not started from rest since.
    #[serde(default)]
    pub began_in_motion: bool,
    /// Time since which it stands.
    #[serde(default)]
    at_rest_since: Option<RobotTime>,
    /// Share of recent drive samples with a steering angle that the vehicle cannot have.
    #[serde(default)]
    impossible_steering_share: f64,
}

impl Session {
    pub fn starting(stamp: RobotTime) -> Self {
        Self {
            began: Some(stamp),
            now: stamp,
            ..Self::default()
        }
    }

    /// Part of it that a checkpoint holds.
    pub fn stored(&self) -> Self {
        let mut stored = self.clone();
        let earlier = stored.changes.len().saturating_sub(CHANGES_STORED_MAX);
        stored.changes.drain(..earlier);
        let earlier = stored.segments.len().saturating_sub(CHANGES_STORED_MAX);
        stored.segments.drain(..earlier);
        stored
    }

    /// Seconds from the session's first message to a stamp.
    pub fn seconds_to(&self, stamp: RobotTime) -> f64 {
        self.began.map_or(0.0, |began| stamp.seconds_since(began))
    }

    pub fn duration_s(&self) -> f64 {
        self.seconds_to(self.now)
    }

    /// True if the steering angles that are sent are often impossible for the vehicle.
    pub fn has_impossible_steering(&self) -> bool {
        self.impossible_steering_share > IMPOSSIBLE_STEERING_SHARE_MAX
    }

    pub fn count_drive(
        &mut self,
        sample: &DriveSample,
        vehicle: &Vehicle,
        last: Option<RobotTime>,
    ) {
        self.counts.drive_samples += 1;
        let impossible = f64::from(!vehicle.can_steer(sample.steering_rad()));
        self.impossible_steering_share +=
            (impossible - self.impossible_steering_share) / IMPOSSIBLE_STEERING_WINDOW;
        if is_at_rest(sample) {
            self.at_rest_since.get_or_insert(sample.stamp());
        } else if let Some(since) = self.at_rest_since.take() {
            self.began_in_motion &= sample.stamp().seconds_since(since) < REST_MIN_S;
        }
        let Some(last) = last else { return };
        let interval_s = sample.stamp().seconds_since(last);
        if interval_s < GAP_MIN_S {
            self.distance_m += sample.speed_mps().abs() * interval_s;
        }
    }

    /// Forgets what was counted and published of a filter that does not count.
    pub fn unlearn(&mut self) {
        self.excitation = Excitation::default();
        self.recent_nis.clear();
        self.innovation = None;
        self.values_before = None;
        self.unsized_change = false;
    }

    pub fn count_dropped(&mut self, dropped: Dropped) {
        match dropped {
            Dropped::Late => self.counts.late += 1,
            Dropped::Duplicate => self.counts.duplicates += 1,
            Dropped::UnusableScan => self.counts.scans_rejected += 1,
        }
    }

    pub fn count_update(&mut self, stamp_ns: RobotTime, moved: &Moved, wheelbase_m: f64) {
        self.excitation.add(moved.distance_m, moved.turn_rad);
        // The steered wheel moves where the vehicle turns on the spot, too.
        let wheel_m = moved.distance_m.hypot(wheelbase_m * moved.turn_rad);
        self.excitation.steered.add(wheel_m, moved.steering_rad);
        self.innovation = Some(Innovation {
            stamp_ns,
            residual: moved.innovation.residual.into(),
            sigma: moved.innovation.sigmas.into(),
        });
        self.recent_nis.push_back(moved.innovation.nis as f32);
        if self.recent_nis.len() > NIS_WINDOW {
            self.recent_nis.pop_front();
        }
    }

    pub fn consistency(&self) -> Consistency {
        let samples = self.recent_nis.len() as u64;
        let sum: f64 = self.recent_nis.iter().copied().map(f64::from).sum();
        let nis_mean = if samples == 0 {
            0.0
        } else {
            sum / samples as f64
        };
        Consistency::of(nis_mean, NIS_DOF, samples, self.innovation)
    }

    /// Start of the current stretch of an unchanged vehicle, s.
    fn segment_from_s(&self) -> f64 {
        self.segments.last().map_or(0.0, |segment| segment.to_s)
    }

    /// Closes the stretch up to the onset of a change.
    pub fn close_segment(&mut self, to_s: f64, before: ParameterEstimates) {
        let from_s = self.segment_from_s();
        self.values_before = Some(Values::from_fn(|i, _| {
            before.get(i).map_or(0.0, |parameter| parameter.value)
        }));
        self.segments.push(Segment {
            from_s,
            to_s,
            parameters: before,
        });
        self.excitation = Excitation::default();
        self.recent_nis.clear();
    }

    /// All stretches, the current one included.
    pub fn segments_with(&self, now: ParameterEstimates) -> Vec<Segment> {
        let mut segments = self.segments.clone();
        segments.push(Segment {
            from_s: self.segment_from_s(),
            to_s: self.duration_s(),
            parameters: now,
        });
        segments
    }

    pub fn note_change(&mut self, change: Change) {
        self.changes.push(change);
        if self.changes.len() > CHANGES_MAX {
            self.changes.remove(0);
            if !self.segments.is_empty() {
                self.segments.remove(0);
            }
        }
    }

    /// Updates the amounts of the last change: they are known ever better.
    pub fn update_last_change(&mut self, values: &Values) {
        let is_change = |change: &&mut Change| change.kind == ChangeKind::CalibrationChanged;
        let last = self.changes.iter_mut().rev().find(is_change);
        let (Some(before), Some(last)) = (&self.values_before, last) else {
            return;
        };
        let apart = apart(values, before);
        for (parameter, moved) in &mut last.change {
            *moved = apart[parameter.index()];
        }
    }

    /// The last change of the vehicle, not a fault or a confirmation.
    pub fn last_change(&self) -> Option<&Change> {
        let is_change = |change: &&Change| change.kind == ChangeKind::CalibrationChanged;
        self.changes.iter().rev().find(is_change)
    }
}
