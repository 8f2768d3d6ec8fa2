//! Gain that a proposal is expected to bring to its robot's path following.

use fleetcal_proto::calibration::CalibrationValues;

use super::policy::Tolerance;
use super::revision::Revision;
use super::values::{difference, four};
use crate::robot::CrossTrack;

/// Fewest cross-track errors reported with the values in use: half a minute of a robot that reports
/// every second, which is some 25 m of driving.
const ERRORS_MIN: u64 = 30;

/// Cross-track error with the values in use, and its expectation with the proposed ones.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ExpectedGain {
    /// Root mean square that the robot reported with the values in use, m.
    pub measured_rms_m: f64,
    /// Expected root mean square with the proposed values if all lasting errors come from the
    /// calibration, m.
    pub expected_rms_m: f64,
    /// Expected root mean square if of these only the mean comes from it and errors of other minutes
    /// are larger by chance, m.
    pub expected_rms_max_m: f64,
}

/// The gain that a revision promises over the values in use (`base`), of whose time `errors` are;
/// `None` while the robot has reported too few errors, or nobody knows what it uses.
///
/// 1. A robot that follows its path without an integral part stands beside it by what its
///    calibration is off by, and turns into that over metres: by `d_steering / L` and `d_yaw` all
///    along, by `d_x` and `d_y` in bends, to the other side in bends to the other side. So the
///    calibration's part of an error `e` lasts for seconds, and need not be in the mean: left and
///    right bends cancel there, and so can a steering offset and a heading.
/// 2. What differs from one second to the next is the localisation's noise and stays. Its variance
///    `n^2` is that of the errors' bends ([`CrossTrack::brief_m2`]).
/// 3. The proposed values leave the fraction `r` of what it is off by, with the change `d`, the
///    proposal's `sigma` and the tolerance `T`, which only makes radians and metres comparable:
///    `r^2 = sum((sigma_i / T_i)^2) / sum((d_i / T_i)^2)`, at most 1.
/// 4. `expected^2 = n^2 + r^2 (rms^2 - n^2)`.
/// 5. A vehicle has lasting errors of its own: it understeers, its steering lags. What they are is
///    not seen before they stand alone. The most that may stay of what averages out is
///    `expected_max^2 = var(e) + r^2 mean(e)^2`.
/// 6. Errors of other minutes differ: the root mean square of `n` of them has a standard error of
///    `1 / sqrt(2 n)` of it at least, and two of these are added to the most.
///
/// The errors are as the robot reports them. One that measures them by its own LiDAR does not see
/// what its own mount is off by, and then this does not either.
pub fn expected_gain(
    base: &CalibrationValues,
    revision: &Revision,
    errors: &CrossTrack,
    tolerance: &Tolerance,
) -> Option<ExpectedGain> {
    if errors.count < ERRORS_MIN {
        return None;
    }
    let limits = tolerance.limits();
    let in_tolerances = |parts: [f64; 4]| -> f64 {
        let parts = parts.into_iter().zip(limits);
        parts.map(|(part, limit)| (part / limit).powi(2)).sum()
    };
    let off = in_tolerances(difference(base, &revision.values));
    let left = in_tolerances(four(&revision.sigmas));
    let fraction_squared = if off > left { left / off } else { 1.0 };
    let (rms_m, mean_m) = (errors.rms_m(), errors.mean_m());
    let square_m2 = rms_m * rms_m;
    let variance_m2 = (square_m2 - mean_m * mean_m).max(0.0);
    let brief_m2 = errors.brief_m2().unwrap_or(variance_m2).min(variance_m2);
    let expected_m = |stays_m2: f64| {
        fraction_squared
            .mul_add(square_m2 - stays_m2, stays_m2)
            .sqrt()
    };
    Some(ExpectedGain {
        measured_rms_m: rms_m,
        expected_rms_m: expected_m(brief_m2),
        expected_rms_max_m: (1.0 + (2.0 / errors.count as f64).sqrt()) * expected_m(variance_m2),
    })
}

#[cfg(test)]
mod tests {
    use fleetcal_model::{RevisionId, WallTime};
    use fleetcal_proto::RobotId;

    use super::*;
    use crate::approval::{Evidence, Origin, Policy};

    fn revision(steering_offset_rad: f64, sigma_rad: f64) -> Revision {
        let values = |steering_offset_rad| CalibrationValues {
            steering_offset_rad,
            ..CalibrationValues::default()
        };
        let robot = RobotId::parse("tugger_01").unwrap();
        let found = (values(steering_offset_rad), values(sigma_rad));
        Revision::new(
            RevisionId(1),
            robot,
            Origin::Estimator,
            found,
            Evidence::default(),
            None,
            WallTime(0),
        )
    }

    fn gain(revision: &Revision, errors: &CrossTrack) -> Option<ExpectedGain> {
        let tolerance = Policy::default().verify_within;
        expected_gain(&CalibrationValues::default(), revision, errors, &tolerance)
    }

    #[test]
    fn what_averages_out_stays_and_the_mean_goes() {
        let mut errors = CrossTrack::default();
        for _ in 0..100 {
            errors.add(0.024);
            errors.add(0.016);
        }
        // 20 mm beside the path, and 4 mm to either side of that.
        let found = gain(&revision(0.05, 0.0), &errors).unwrap();
        // Two hundred errors are a sample: a tenth more may come of as many.
        assert!((1.1 * found.expected_rms_m - found.expected_rms_max_m).abs() < 1e-12);
        assert!((found.measured_rms_m - 0.020_396).abs() < 1e-6, "{found:?}");
        assert!((found.expected_rms_m - 0.004).abs() < 1e-9, "{found:?}");
        // A quarter of what it is off by stays uncertain: 5 mm of the 20.
        let uncertain = gain(&revision(0.04, 0.01), &errors).unwrap();
        let expected_m = 0.004_f64.hypot(0.005);
        assert!(
            (uncertain.expected_rms_m - expected_m).abs() < 1e-9,
            "{uncertain:?}"
        );
    }

    #[test]
    fn what_lasts_may_go_though_it_averages_out_and_what_is_brief_stays() {
        // 25 mm to the one side in left bends and to the other in right ones, each of ten seconds,
        // with 3 mm of noise that changes every second.
        let error_m = |second: i32| {
            let side = if second / 10 % 2 == 0 { 0.025 } else { -0.025 };
            side + if second % 2 == 0 { 0.003 } else { -0.003 }
        };
        let mut errors = CrossTrack::default();
        for second in 0..200 {
            errors.add(error_m(second));
            errors.add_bend([second, second + 1, second + 2].map(error_m));
        }
        let found = gain(&revision(0.02, 0.0), &errors).unwrap();
        assert!(found.expected_rms_max_m > 0.99 * found.measured_rms_m);
        assert!(
            found.expected_rms_m < 0.5 * found.measured_rms_m,
            "{found:?}"
        );
        assert!(found.expected_rms_m > 0.003, "{found:?}");
    }

    #[test]
    fn nothing_is_promised_of_too_few_errors_or_of_no_change() {
        let mut errors = CrossTrack::default();
        for _ in 1..ERRORS_MIN {
            errors.add(0.02);
        }
        assert_eq!(gain(&revision(0.05, 0.001), &errors), None);
        errors.add(0.02);
        let none = gain(&revision(0.0, 0.001), &errors).unwrap();
        assert!((none.expected_rms_m - none.measured_rms_m).abs() < 1e-12);
    }
}
