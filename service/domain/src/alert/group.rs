//! Robots that fall silent together, in one alert.

use std::collections::BTreeSet;

use fleetcal_proto::RobotId;

use super::condition::Observation;
use super::kind::AlertKind;
use super::rules::Sighting;
use super::subject::Subject;

/// Fewest silent robots, without a published alert of their own, that share one alert.
const GROUP_MIN: usize = 5;
/// Most robots that the text of a grouped alert names; the alert lists all of them.
const NAMED_MAX: usize = 8;

/// Merges silent robots into one sighting of the fleet when they are `GROUP_MIN` or more, or when
/// such an alert is active (`is_grouped`). Robots with a published alert of their own (`has_own`)
/// keep it.
///
/// `of` is the number of configured robots.
pub fn group_silent(
    sightings: &mut Vec<(Subject, Sighting)>,
    of: usize,
    is_grouped: bool,
    has_own: impl Fn(&RobotId) -> bool,
) {
    let silent: BTreeSet<RobotId> = sightings
        .iter()
        .filter(|(_, sighting)| is_silent(sighting))
        .filter_map(|(subject, _)| subject.robot().cloned())
        .filter(|robot| !has_own(robot))
        .collect();
    let groups = silent.len() >= GROUP_MIN || is_grouped;
    if groups {
        for (subject, sighting) in &mut *sightings {
            if is_silent(sighting) && subject.robot().is_some_and(|one| silent.contains(one)) {
                sighting.observation = Observation::Clear;
                sighting.what.clear();
            }
        }
    }
    let fires = groups && !silent.is_empty();
    sightings.push((
        Subject::Fleet,
        Sighting {
            kind: AlertKind::NoData,
            observation: if fires {
                Observation::Firing
            } else {
                Observation::Clear
            },
            what: if fires {
                words(&silent, of)
            } else {
                String::new()
            },
            robots: if fires {
                silent.into_iter().collect()
            } else {
                Vec::new()
            },
        },
    ));
}

fn is_silent(sighting: &Sighting) -> bool {
    sighting.kind == AlertKind::NoData && sighting.observation == Observation::Firing
}

fn words(silent: &BTreeSet<RobotId>, of: usize) -> String {
    let names: Vec<&str> = silent.iter().take(NAMED_MAX).map(RobotId::as_str).collect();
    let more = silent.len() - names.len();
    let more = if more > 0 {
        format!(" and {more} more")
    } else {
        String::new()
    };
    let send = if silent.len() == 1 { "sends" } else { "send" };
    let count = silent.len();
    format!(
        "{count} of {of} robots {send} nothing: {}{more}",
        names.join(", ")
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    fn robot(number: usize) -> RobotId {
        RobotId::parse(&format!("tugger_{number:02}")).unwrap()
    }

    /// Sightings of the first robots, which are silent, and of the fleet.
    fn seen(silent: usize, is_grouped: bool, own: &[usize]) -> (Vec<usize>, Sighting) {
        let mut sightings: Vec<_> = (1..=silent)
            .map(|number| {
                let sighting = Sighting {
                    kind: AlertKind::NoData,
                    observation: Observation::Firing,
                    what: "nothing has come".to_owned(),
                    robots: Vec::new(),
                };
                (Subject::Robot(robot(number)), sighting)
            })
            .collect();
        let own: Vec<RobotId> = own.iter().map(|number| robot(*number)).collect();
        group_silent(&mut sightings, 24, is_grouped, |one| own.contains(one));
        let (_, fleet) = sightings.pop().unwrap();
        let alone = sightings.iter().enumerate();
        let alone = alone.filter(|(_, (_, one))| is_silent(one));
        (alone.map(|(at, _)| at + 1).collect(), fleet)
    }

    #[test]
    fn eighteen_robots_that_send_nothing_are_one_alert() {
        let (alone, fleet) = seen(18, false, &[]);
        assert!(alone.is_empty());
        assert_eq!(fleet.observation, Observation::Firing);
        assert_eq!(fleet.robots.len(), 18);
        assert_eq!(
            fleet.what,
            "18 of 24 robots send nothing: tugger_01, tugger_02, tugger_03, tugger_04, tugger_05, \
             tugger_06, tugger_07, tugger_08 and 10 more"
        );
    }

    #[test]
    fn a_few_robots_alert_each_for_itself_and_keep_what_was_told() {
        let (alone, fleet) = seen(4, false, &[]);
        assert_eq!(alone, [1, 2, 3, 4]);
        assert_eq!(fleet.observation, Observation::Clear);
        // Two that were told of stay apart; with them they would be five.
        let (alone, fleet) = seen(6, false, &[2, 3]);
        assert_eq!(alone, [1, 2, 3, 4, 5, 6]);
        assert_eq!(fleet.observation, Observation::Clear);
        let (alone, fleet) = seen(7, false, &[2, 3]);
        assert_eq!(alone, [2, 3]);
        assert_eq!(fleet.robots.len(), 5);
    }

    #[test]
    fn a_group_lasts_until_the_last_of_it_is_back() {
        let (alone, fleet) = seen(1, true, &[]);
        assert!(alone.is_empty());
        assert_eq!(fleet.what, "1 of 24 robots sends nothing: tugger_01");
        let (_, fleet) = seen(0, true, &[]);
        assert_eq!(fleet.observation, Observation::Clear);
    }
}
