//! Latest innovations of a robot's filter.

use std::collections::VecDeque;

use fleetcal_domain::limits::INNOVATIONS_KEPT;
use fleetcal_model::{Innovation, RobotTime};
use fleetcal_proto::estimate::EstimateDocument;

/// Innovation as it is kept: single precision is plenty for a chart, and 32 bytes instead of 56.
#[derive(Debug, Clone, Copy)]
struct Kept {
    stamp_ns: RobotTime,
    residual: [f32; 3],
    sigma: [f32; 3],
}

impl Kept {
    fn of(innovation: &Innovation) -> Self {
        Self {
            stamp_ns: innovation.stamp_ns,
            residual: innovation.residual.map(|one| one as f32),
            sigma: innovation.sigma.map(|one| one as f32),
        }
    }

    fn innovation(&self) -> Innovation {
        Innovation {
            stamp_ns: self.stamp_ns,
            residual: self.residual.map(f64::from),
            sigma: self.sigma.map(f64::from),
        }
    }
}

/// Innovations of a robot, one of each estimate with a new one, oldest first.
#[derive(Debug, Default)]
pub(super) struct Innovations(VecDeque<Kept>);

impl Innovations {
    /// Takes the innovation of an estimate; an estimate before the first update has none.
    pub(super) fn take_of(&mut self, estimate: &EstimateDocument) {
        if let Some(innovation) = estimate.consistency.innovation {
            self.take(innovation);
        }
    }

    /// Returns the latest innovations, oldest first.
    pub(super) fn latest(&self) -> Vec<Innovation> {
        self.0.iter().map(Kept::innovation).collect()
    }

    fn take(&mut self, innovation: Innovation) {
        match self.0.back() {
            // A robot at rest has no updates, and repeats the last one.
            Some(last) if last.stamp_ns == innovation.stamp_ns => return,
            // Its clock went back.
            Some(last) if last.stamp_ns > innovation.stamp_ns => self.0.clear(),
            _ => {}
        }
        if self.0.len() == INNOVATIONS_KEPT {
            self.0.pop_front();
        }
        self.0.push_back(Kept::of(&innovation));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn at(stamp_ns: i64) -> Innovation {
        Innovation {
            stamp_ns: RobotTime(stamp_ns),
            residual: [0.0; 3],
            sigma: [1.0; 3],
        }
    }

    fn stamps(of: &Innovations) -> Vec<i64> {
        of.0.iter().map(|one| one.stamp_ns.0).collect()
    }

    #[test]
    fn as_many_are_kept_as_the_limit_says_each_once() {
        let mut innovations = Innovations::default();
        for stamp_ns in 0..INNOVATIONS_KEPT as i64 + 5 {
            innovations.take(at(stamp_ns));
            innovations.take(at(stamp_ns));
        }
        let expected: Vec<i64> = (5..INNOVATIONS_KEPT as i64 + 5).collect();
        assert_eq!(stamps(&innovations), expected);
    }

    #[test]
    fn an_innovation_takes_32_bytes() {
        assert_eq!(size_of::<Kept>(), 32);
    }

    #[test]
    fn a_clock_that_went_back_begins_anew() {
        let mut innovations = Innovations::default();
        for stamp_ns in [10, 20, 5, 6] {
            innovations.take(at(stamp_ns));
        }
        assert_eq!(stamps(&innovations), [5, 6]);
    }
}
