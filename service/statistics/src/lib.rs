//! Statistics of a fleet: what the values of many robots say together.
//!
//! [`groups`] sums up the values of groups of robots. [`common_causes`] names groups whose
//! robots differ from others of their kind, as those of one mounting jig do, and [`unlike`] single
//! robots. Both state a rate of false names and assume nothing of a group that is too small to
//! keep it.
//!
//! Pure: no clock, no I/O.

mod common_cause;
mod distribution;
mod group;
mod population;
mod rank_sum;
mod unlike;

pub use common_cause::{CAUSES_MAX, CommonCause, Shift, common_causes};
pub use distribution::Distribution;
pub use group::{GroupStatistics, Member, groups};
pub use population::{FOUR, Grouping, Known, Population, Robot};
pub use unlike::{Unlike, unlike};

/// Probability with which a fleet without any cause has one named, and likewise one robot that is
/// unlike its kind: one in two thousand.
const FALSE_NAMES: f64 = 5e-4;

/// Bound of the probability that a standard normal value lies farther from 0 than `z`: Mills' ratio,
/// `2 phi(z) / z`, at most 1.
fn two_sided(z: f64) -> f64 {
    if z <= 0.0 {
        return 1.0;
    }
    let density = (-z * z / 2.0).exp() / (2.0 * std::f64::consts::PI).sqrt();
    (2.0 * density / z).min(1.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_tail_is_bounded_from_above_and_closely() {
        for (z, tail) in [
            (2.0, 0.045_5),
            (3.0, 2.699_8e-3),
            (4.0, 6.334e-5),
            (6.0, 1.973e-9),
        ] {
            assert!((1.0..1.25).contains(&(two_sided(z) / tail)), "{z}");
        }
        assert!(two_sided(0.1) >= 0.99 && two_sided(-1.0) >= 1.0);
    }
}
