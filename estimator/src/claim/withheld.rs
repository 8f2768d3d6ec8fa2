//! Reasons for which a value is not `converged` although its sigma is within its limit.

use crate::estimate::Parameter;

/// Request to a driver where a value cannot be one of a vehicle.
const CHECK_VEHICLE: &str = "a look at the vehicle and its configuration: this cannot be";
/// Request for the time offset of clouds whose points have no times.
const POINT_TIMES: &str = "clouds whose points have a time, or ignore_times in point_cloud where they were all \
    taken at once: without, nobody knows when in a turn the scanner looked where";

/// Reason for which a value is withheld.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Withheld {
    /// Value beyond the limits of a vehicle. All values explain the same motion: where one of them
    /// is impossible, none is claimed.
    Impossible,
    /// Clouds whose points have no times, so that the time offset may be off by a part of a turn.
    PointTimes,
    /// Change of the parameter that would go unseen.
    Blind,
}

/// Findings that withhold values.
#[derive(Debug, Clone, Copy)]
pub struct Findings {
    /// True if a value or a steering angle is impossible.
    pub is_impossible: bool,
    /// True if scans are made of points without times.
    pub lacks_beam_times: bool,
    /// True if a change of the parameter would go unseen.
    pub is_blind: bool,
}

impl Withheld {
    /// The first reason for which a parameter is withheld.
    pub fn of(parameter: Parameter, findings: Findings) -> Option<Self> {
        if findings.is_impossible {
            Some(Self::Impossible)
        } else if findings.lacks_beam_times && parameter == Parameter::TimeOffset {
            Some(Self::PointTimes)
        } else {
            findings.is_blind.then_some(Self::Blind)
        }
    }

    /// Need of the value, in words; `None` where driving is enough.
    pub fn needs(self) -> Option<&'static str> {
        match self {
            Self::Impossible => Some(CHECK_VEHICLE),
            Self::PointTimes => Some(POINT_TIMES),
            Self::Blind => None,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn points_without_times_withhold_the_time_offset_alone() {
        let findings = Findings {
            is_impossible: false,
            lacks_beam_times: true,
            is_blind: false,
        };
        let withheld = Parameter::ALL.map(|parameter| Withheld::of(parameter, findings));
        for (parameter, reason) in Parameter::ALL.into_iter().zip(withheld) {
            let is_time = parameter == Parameter::TimeOffset;
            assert_eq!(reason, is_time.then_some(Withheld::PointTimes));
        }
    }

    #[test]
    fn an_impossible_value_is_named_before_all_else() {
        let findings = Findings {
            is_impossible: true,
            lacks_beam_times: true,
            is_blind: true,
        };
        let reasons = Parameter::ALL.map(|parameter| Withheld::of(parameter, findings));
        assert!(
            reasons
                .iter()
                .all(|&reason| reason == Some(Withheld::Impossible))
        );
        assert!(Withheld::Impossible.needs().is_some());
    }
}
