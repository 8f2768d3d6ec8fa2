//! Gain that a proposal is expected to bring to its robot's path following.

use fleetcal_proto::calibration::CalibrationValues;

use super::policy::Tolerance;
use super::revision::Revision;
use super::values::{difference, four};
use crate::robot::CrossTrack;

/// Cross-track errors that a robot has to have reported with the values in use: half a minute of
/// one that reports every second, which is some 25 m of driving.
const ERRORS_MIN: u64 = 30;

/// Cross-track error with the values in use, and what is expected of it with the proposed ones.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ExpectedGain {
    /// Root mean square as the robot reported it with the values in use, m.
    pub measured_rms_m: f64,
    /// Root mean square that is expected with the proposed values, m.
    pub expected_rms_m: f64,
}

/// The gain that a revision promises over the values in use (`base`), of whose time `errors` are;
/// `None` while the robot has reported too few errors, or nobody knows what it uses.
///
/// 1. The mean square of the errors `e` has a part that stays and one that averages out:
///    `rms^2 = mean(e)^2 + var(e)`.
/// 2. A robot that follows its path without an integral part stands beside it in proportion to
///    what its calibration is off by, so that the mean is the calibration's part; the variance is
///    that of path, control and localisation, and stays.
/// 3. The proposed values leave the fraction `r` of what it is off by, with the change `d`, the
///    proposal's `sigma` and the tolerance `T`, which only makes radians and metres comparable:
///    `r^2 = sum((sigma_i / T_i)^2) / sum((d_i / T_i)^2)`, at most 1.
/// 4. `expected^2 = var(e) + r^2 mean(e)^2`.
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
    let variance_m2 = (rms_m * rms_m - mean_m * mean_m).max(0.0);
    let expected_m2 = fraction_squared.mul_add(mean_m * mean_m, variance_m2);
    Some(ExpectedGain {
        measured_rms_m: rms_m,
        expected_rms_m: expected_m2.sqrt(),
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
