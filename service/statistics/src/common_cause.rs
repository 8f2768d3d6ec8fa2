//! Causes that several robots of a kind share: one mounting jig, one firmware, one workshop.

use fleetcal_model::Parameter;
use serde::Serialize;

use crate::distribution::centre_and_spread;
use crate::population::{FOUR, Grouping, Population, Robot, values};
use crate::{FALSE_NAMES, rank_sum};

/// Limit of the named causes of a fleet.
pub const CAUSES_MAX: usize = 16;
/// Least number of robots in a group and beside it: of fewer, no difference is improbable enough.
const ROBOTS_MIN: usize = 3;

/// Difference of one value between a group and the others of its kind.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct Shift {
    /// The value.
    pub parameter: Parameter,
    /// Median of the group minus median of the others, in the unit of the value.
    pub shift: f64,
    /// Bound of the probability that robots without a common cause differ as much.
    pub probability: f64,
}

/// Group of robots that differ from the others of their kind.
#[derive(Debug, Clone, PartialEq, Serialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct CommonCause {
    /// Kind of the robots that were compared.
    pub kind: String,
    /// Property that the robots of the group share.
    pub by: Grouping,
    /// Name of the group.
    pub group: String,
    /// Ids of the robots of the group.
    pub robots: Vec<String>,
    /// Number of the other robots of that kind.
    pub others: usize,
    /// Values that differ, the least probable first.
    pub shifts: Vec<Shift>,
}

/// Names the groups of a fleet whose robots differ from others of their kind by more than a
/// tolerance, the least probable first.
///
/// The robots of a named group are left out before the next one is sought: a site is not named for
/// the robots of its jig. `tolerances` are those of the policy, in the order of [`FOUR`].
pub fn common_causes(robots: &[Robot], tolerances: [f64; FOUR.len()]) -> Vec<CommonCause> {
    let mut kinds = Population::by_kind(robots);
    let tests: usize = kinds
        .values()
        .map(|kind| kind.groups(ROBOTS_MIN).len() * FOUR.len())
        .sum();
    let improbable = FALSE_NAMES / tests.max(1) as f64;
    let mut causes = Vec::new();
    for (&kind, population) in &mut kinds {
        while causes.len() < CAUSES_MAX
            && let Some(cause) = least_probable(kind, population, tolerances, improbable)
        {
            let is_other = |robot: &&Robot| !cause.robots.contains(&robot.id);
            population.robots.retain(is_other);
            causes.push(cause);
        }
    }
    let of = |cause: &CommonCause| cause.shifts.first().map_or(1.0, |one| one.probability);
    causes.sort_by(|a, b| of(a).total_cmp(&of(b)));
    causes
}

fn least_probable(
    kind: &str,
    population: &Population<'_>,
    tolerances: [f64; FOUR.len()],
    improbable: f64,
) -> Option<CommonCause> {
    let groups = population.groups(ROBOTS_MIN).into_iter();
    let causes = groups.filter_map(|(by, group)| {
        let (inside, outside) = population.divided((by, group));
        let shifts = shifts(&inside, &outside, tolerances, improbable);
        (!shifts.is_empty()).then(|| CommonCause {
            kind: kind.to_owned(),
            by,
            group: group.to_owned(),
            robots: inside.iter().map(|robot| robot.id.clone()).collect(),
            others: outside.len(),
            shifts,
        })
    });
    causes.min_by(|a, b| a.shifts[0].probability.total_cmp(&b.shifts[0].probability))
}

/// Returns the values that differ significantly and by more than their tolerance.
fn shifts(
    inside: &[&Robot],
    outside: &[&Robot],
    tolerances: [f64; FOUR.len()],
    improbable: f64,
) -> Vec<Shift> {
    let mut shifts: Vec<Shift> = FOUR
        .into_iter()
        .enumerate()
        .filter_map(|(at, parameter)| {
            // Angles of both have one reference.
            let all: Vec<&Robot> = inside.iter().chain(outside).copied().collect();
            let known =
                |robots: &[&Robot]| robots.iter().filter(|one| one.values[at].is_some()).count();
            let mut of_group = values(&all, at);
            let of_others = of_group.split_off(known(inside));
            if of_group.len().min(of_others.len()) < ROBOTS_MIN {
                return None;
            }
            let (centre, _) = centre_and_spread(&of_group)?;
            let (other, _) = centre_and_spread(&of_others)?;
            let found = Shift {
                parameter,
                shift: centre - other,
                probability: rank_sum::probability(&of_group, &of_others),
            };
            let counts = found.probability < improbable && found.shift.abs() > tolerances[at];
            counts.then_some(found)
        })
        .collect();
    shifts.sort_by(|a, b| a.probability.total_cmp(&b.probability));
    shifts
}

#[cfg(test)]
mod tests;
