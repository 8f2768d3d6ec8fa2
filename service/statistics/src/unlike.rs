//! Robots that are unlike others of their kind.

use fleetcal_model::Parameter;
use serde::Serialize;

use crate::distribution::centre_and_spread;
use crate::population::{FOUR, Population, Robot, values};
use crate::{FALSE_NAMES, two_sided};

/// Least number of robots of a kind: the spread of fewer is not known.
const ROBOTS_MIN: usize = 8;
/// Standard deviation of the robust spread of `n` normal values is this part of it over `sqrt(n)`
/// (asymptotic efficiency of the median absolute deviation, 0.37).
const SPREAD_DEVIATION: f64 = 1.17;
/// Standard deviations by which the spread is taken for larger than it was found.
const SPREAD_CAUTION: f64 = 3.0;

/// Value of a robot that is unlike those of its kind.
#[derive(Debug, Clone, PartialEq, Serialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct Unlike {
    /// Id of the robot.
    pub robot: String,
    /// Kind of the robots that it was compared with.
    pub kind: String,
    /// Number of these robots.
    pub others: usize,
    /// The value.
    pub parameter: Parameter,
    /// Value of the robot minus the median of its kind, in the unit of the value.
    pub difference: f64,
    /// Spread of the kind: robust standard deviation, in the unit of the value.
    pub spread: f64,
}

/// Names the robots whose values lie farther from the median of their kind than chance and a
/// tolerance explain, the farthest first.
///
/// Robots in `explained` are neither named nor counted: a common cause has named them.
/// `tolerances` are those of the policy, in the order of [`FOUR`].
pub fn unlike(robots: &[Robot], explained: &[&str], tolerances: [f64; FOUR.len()]) -> Vec<Unlike> {
    let mut named = Vec::new();
    for (kind, mut population) in Population::by_kind(robots) {
        population
            .robots
            .retain(|robot| !explained.contains(&robot.id.as_str()));
        for (at, parameter) in FOUR.into_iter().enumerate() {
            let known = values(&population.robots, at);
            let Some((median, spread)) = centre_and_spread(&known) else {
                continue;
            };
            if known.len() < ROBOTS_MIN {
                continue;
            }
            let caution = 1.0 + SPREAD_CAUTION * SPREAD_DEVIATION / (known.len() as f64).sqrt();
            let improbable = FALSE_NAMES / (FOUR.len() * robots.len()) as f64;
            let has_value = population
                .robots
                .iter()
                .filter_map(|robot| Some((robot, robot.values[at]?)));
            for ((robot, value), unwrapped) in has_value.zip(&known) {
                let difference = unwrapped - median;
                let sigma = (caution * spread).hypot(value.sigma);
                let z = difference.abs() / sigma;
                if two_sided(z) < improbable && difference.abs() > tolerances[at] {
                    named.push(Unlike {
                        robot: robot.id.clone(),
                        kind: kind.to_owned(),
                        others: known.len() - 1,
                        parameter,
                        difference,
                        spread,
                    });
                }
            }
        }
    }
    let far = |one: &Unlike| one.difference.abs() / one.spread;
    named.sort_by(|a, b| far(b).total_cmp(&far(a)));
    named
}
