//! Extent of an evaluation: the whole, or a small one that shows the same in two minutes.

use crate::imperfect::{Driven, ImperfectExtent};

/// Number of seeds, and lengths of the runs.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Extent {
    /// Name in the report.
    pub name: &'static str,
    /// Seeds of each case: 1 to this.
    pub seeds: u64,
    /// Length of the runs whose convergence is studied, s.
    pub convergence_s: f64,
    /// Length of any other calibration run, s.
    pub calibration_s: f64,
    /// Length of a run whose path following is measured, s.
    pub tracking_s: f64,
    /// Length of a run of odometry, m.
    pub odometry_m: f64,
    /// Length of a stretch in closed loop, s.
    pub loop_stretch_s: f64,
    /// Extent of the study of imperfect robots.
    pub imperfect: ImperfectExtent,
}

impl Extent {
    /// Extent of the committed report.
    pub const FULL: Self = Self {
        name: "full",
        seeds: 20,
        convergence_s: 300.0,
        calibration_s: 240.0,
        tracking_s: 120.0,
        odometry_m: 300.0,
        loop_stretch_s: 120.0,
        imperfect: ImperfectExtent {
            seeds: 4,
            length_s: 600.0,
            driven: Driven::All,
            change_seeds: 2,
        },
    };

    /// Extent of the same studies in less than three minutes.
    pub const QUICK: Self = Self {
        name: "quick",
        seeds: 2,
        convergence_s: 150.0,
        calibration_s: 150.0,
        tracking_s: 60.0,
        odometry_m: 300.0,
        loop_stretch_s: 60.0,
        imperfect: ImperfectExtent {
            seeds: 2,
            length_s: 180.0,
            driven: Driven::Typical,
            change_seeds: 2,
        },
    };

    /// The same less the robots that no claim is about.
    pub const CLAIMED: Self = Self {
        name: "claimed",
        imperfect: ImperfectExtent {
            driven: Driven::Claimed,
            ..Self::QUICK.imperfect
        },
        ..Self::QUICK
    };

    /// Returns the seeds of a case.
    pub fn seeds(&self) -> Vec<u64> {
        (1..=self.seeds).collect()
    }
}
