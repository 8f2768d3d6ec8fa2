//! Track of the robot during the last moments: a scan looks back at each beam's own time.

use std::collections::VecDeque;

use super::plane::Pose2;

/// The robot's motion at one moment, in the world.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(super) struct Moment {
    pub base: Pose2,
    pub lidar: Pose2,
    pub speed_mps: f64,
    pub steering_rad: f64,
}

/// Moments at a fixed spacing, the oldest first.
#[derive(Debug)]
pub(super) struct Track {
    moments: VecDeque<Moment>,
    first_ns: i64,
    spacing_ns: i64,
    capacity: usize,
}

impl Track {
    /// Makes a track that starts with `moment` and remembers `length_ns`.
    pub fn new(start_ns: i64, spacing_ns: i64, length_ns: i64, moment: Moment) -> Self {
        let capacity = (length_ns / spacing_ns + 2) as usize;
        let moments = VecDeque::from([moment]);
        Self {
            moments,
            first_ns: start_ns,
            spacing_ns,
            capacity,
        }
    }

    /// Adds the next moment, one spacing later.
    pub fn push(&mut self, moment: Moment) {
        self.moments.push_back(moment);
        if self.moments.len() > self.capacity {
            self.moments.pop_front();
            self.first_ns += self.spacing_ns;
        }
    }

    /// Returns the moment at a time, linear between neighbours; held at the ends.
    pub fn at(&self, time_ns: i64) -> Moment {
        let since_ns = (time_ns - self.first_ns).max(0);
        let number = (since_ns / self.spacing_ns) as usize;
        let last = self.moments.back().copied().unwrap_or_default();
        let Some((before, after)) = self.moments.get(number).zip(self.moments.get(number + 1))
        else {
            return last;
        };
        let fraction = (since_ns % self.spacing_ns) as f64 / self.spacing_ns as f64;
        let mix = |a: f64, b: f64| a + fraction * (b - a);
        Moment {
            base: before.base.toward(&after.base, fraction),
            lidar: before.lidar.toward(&after.lidar, fraction),
            speed_mps: mix(before.speed_mps, after.speed_mps),
            steering_rad: mix(before.steering_rad, after.steering_rad),
        }
    }
}
