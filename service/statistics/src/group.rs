//! Statistics of groups of robots.

use std::collections::BTreeMap;

use fleetcal_domain::approval::RobotLedger;
use fleetcal_domain::deviation::Deviation;
use fleetcal_domain::robot::RobotView;
use fleetcal_model::{Parameter, Unit};
use serde::Serialize;

use crate::distribution::Distribution;
use crate::population::{FOUR, Grouping, Robot, values, wrapped};

/// Robot with how far its calibration in use is from what it estimates.
#[derive(Debug, Clone, PartialEq)]
pub struct Member {
    /// The robot.
    pub robot: Robot,
    /// Deviation of its estimate from the calibration in use, tolerances; `None` while unknown.
    pub deviation: Option<f64>,
    /// True if its calibration in use was verified.
    pub is_verified: bool,
}

impl Member {
    /// Member by the view and the records of a robot, with the deviation of its estimate.
    pub fn of(view: &RobotView, ledger: &RobotLedger, deviation: Option<Deviation>) -> Self {
        Self {
            robot: Robot::of(view),
            deviation: deviation.map(|one| one.tolerances),
            is_verified: is_verified(ledger),
        }
    }
}

/// True if the calibration that the robot has in use was verified.
fn is_verified(ledger: &RobotLedger) -> bool {
    let mut verified = ledger.shadow.verified.iter();
    let in_use = ledger.shadow.in_use.as_ref();
    in_use.is_some_and(|in_use| verified.any(|one| one.generation == in_use.generation))
}

/// Statistics of one group.
#[derive(Debug, Clone, PartialEq, Serialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct GroupStatistics {
    /// Name of the group.
    pub group: String,
    /// Number of its robots.
    pub robots: usize,
    /// Robots whose deviation is beyond the tolerance.
    pub beyond_tolerance: usize,
    /// Robots whose calibration in use was verified.
    pub verified: usize,
    /// Distribution of the deviations, tolerances; absent while none is known.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[cfg_attr(feature = "openapi", schema(nullable, required = false))]
    pub deviation_tolerances: Option<Distribution>,
    /// Distributions of the converged values by parameter, rad and m; a parameter that is known of
    /// no robot is absent.
    #[cfg_attr(feature = "openapi", schema(value_type = BTreeMap<String, Distribution>))]
    pub parameters: BTreeMap<&'static str, Distribution>,
}

/// Returns the statistics of each group, by its name. A robot without the property is in none, one
/// with several tags in several.
pub fn groups(members: &[Member], by: Grouping) -> Vec<GroupStatistics> {
    let mut groups: BTreeMap<&str, Vec<&Member>> = BTreeMap::new();
    for member in members {
        for group in member.robot.groups(by) {
            groups.entry(group).or_default().push(member);
        }
    }
    let groups = groups.into_iter();
    groups
        .map(|(group, members)| GroupStatistics::of(group, &members))
        .collect()
}

impl GroupStatistics {
    fn of(group: &str, members: &[&Member]) -> Self {
        let deviations: Vec<f64> = members.iter().filter_map(|one| one.deviation).collect();
        let parameters = FOUR.into_iter().enumerate();
        Self {
            group: group.to_owned(),
            robots: members.len(),
            beyond_tolerance: deviations.iter().filter(|&&one| one > 1.0).count(),
            verified: members.iter().filter(|one| one.is_verified).count(),
            parameters: parameters
                .filter_map(|(at, name)| known(members, at, name))
                .collect(),
            deviation_tolerances: Distribution::of(deviations),
        }
    }
}

/// Returns the distribution of a value by its name; `None` if no robot knows it.
fn known(
    members: &[&Member],
    at: usize,
    parameter: Parameter,
) -> Option<(&'static str, Distribution)> {
    let robots: Vec<&Robot> = members.iter().map(|one| &one.robot).collect();
    let distribution = Distribution::of(values(&robots, at))?;
    // The median of angles lies between -pi and pi, the others beside it.
    let turns = match parameter.unit() {
        Unit::Radian => wrapped(distribution.median) - distribution.median,
        _ => 0.0,
    };
    Some((parameter.name(), distribution.moved(turns)))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Known;

    fn member(number: u32, tags: &[&str], deviation: Option<f64>) -> Member {
        let value = f64::from(number) / 100.0;
        let known = Known {
            value,
            sigma: 0.001,
        };
        Member {
            robot: Robot {
                id: format!("agv_{number}"),
                kind: "tricycle".to_owned(),
                site: (number < 3).then(|| "Hamburg".to_owned()),
                tags: tags.iter().map(|&tag| tag.to_owned()).collect(),
                values: [deviation.map(|_| known), None, None, None],
            },
            deviation,
            is_verified: number == 1,
        }
    }

    #[test]
    fn a_robot_counts_in_each_of_its_groups() {
        let members = [
            member(1, &["leased", "jig 1"], Some(0.5)),
            member(2, &["leased"], Some(1.5)),
            member(3, &[], None),
        ];
        let counts = |by| -> Vec<(String, usize, usize, usize)> {
            let groups = groups(&members, by).into_iter();
            groups
                .map(|one| (one.group, one.robots, one.beyond_tolerance, one.verified))
                .collect()
        };
        assert_eq!(counts(Grouping::Type), [("tricycle".to_owned(), 3, 1, 1)]);
        assert_eq!(counts(Grouping::Site), [("Hamburg".to_owned(), 2, 1, 1)]);
        let tags = counts(Grouping::Tag);
        let expected = [
            ("jig 1".to_owned(), 1, 0, 1),
            ("leased".to_owned(), 2, 1, 1),
        ];
        assert_eq!(tags, expected);
        let all = &groups(&members, Grouping::Type)[0];
        assert_eq!(all.deviation_tolerances.map(|one| one.robots), Some(2));
        let names: Vec<_> = all.parameters.keys().copied().collect();
        assert_eq!(names, ["steering_offset"]);
    }

    #[test]
    fn the_median_of_yaws_beside_pi_is_an_angle_and_the_others_lie_beside_it() {
        let yaws = [3.13, -3.13, -3.12, -3.11];
        let members: Vec<Member> = (1..)
            .zip(yaws)
            .map(|(number, value)| {
                let mut member = member(number, &[], None);
                let known = Known {
                    value,
                    sigma: 0.001,
                };
                member.robot.values[3] = Some(known);
                member
            })
            .collect();
        let yaw = groups(&members, Grouping::Type)[0].parameters["lidar_yaw"];
        assert!((yaw.median + 3.125).abs() < 1e-9, "{yaw:?}");
        assert!(yaw.largest - yaw.smallest < 0.05, "{yaw:?}");
    }
}
