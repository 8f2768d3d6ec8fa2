//! Orders, and positions that continue them.

use fleetcal_domain::robot::RobotState;

use super::*;

fn robot<'a>(id: &'a str, site: Option<&'a Label>, deviation: Option<f64>) -> Properties<'a> {
    Properties {
        id,
        site,
        vehicle_type: None,
        tags: &[],
        model: None,
        state: RobotState::Learning,
        standing: Standing::Learning,
        is_stale: false,
        in_maintenance: false,
        deviation,
        age_s: None,
    }
}

#[test]
fn robots_without_the_property_are_last_either_way() {
    let sites = ["Ulm", "ulm", "Ulm 2", "Berlin"].map(|site| Label::parse(site).unwrap());
    let [ulm, same, second, berlin] = &sites;
    let robots = [
        robot("a", None, Some(0.5)),
        robot("b", Some(second), Some(12.0)),
        robot("c", Some(same), None),
        robot("d", Some(berlin), Some(2.0)),
        robot("e", Some(ulm), Some(2.0)),
    ];
    for (text, expected) in [
        ("id", "a b c d e"),
        ("-id", "e d c b a"),
        ("site", "d c e b a"),
        ("-site", "b c e d a"),
        ("deviation", "a d e b c"),
        ("-deviation", "b d e a c"),
        ("severity", "a b c d e"),
        ("type", "a b c d e"),
    ] {
        let sort: Sort = text.parse().unwrap();
        assert_eq!(sort.to_string(), text);
        let mut positions: Vec<_> = robots.iter().map(|robot| sort.position(robot)).collect();
        positions.sort();
        let ids: Vec<&str> = positions.iter().map(|one| one.id.as_str()).collect();
        assert_eq!(ids.join(" "), expected, "{text}");
        for position in positions {
            assert_eq!(position.to_string().parse(), Ok(position));
        }
    }
    for text in ["", "-", "worst", "--id", "ID"] {
        assert_eq!(text.parse::<Sort>(), Err(SortRefused));
    }
    assert_eq!("zz.a".parse::<Position>(), Err(PositionRefused));
}

#[test]
fn a_silent_robot_comes_before_those_that_need_nobody_and_after_those_that_need_somebody() {
    let with = |id, standing, is_stale, in_maintenance| Properties {
        standing,
        is_stale,
        in_maintenance,
        ..robot(id, None, None)
    };
    let sort: Sort = "severity".parse().unwrap();
    let mut robots = [
        with("online", Standing::Calibrated, false, false),
        with("parked", Standing::Calibrated, true, true),
        with("silent", Standing::Calibrated, true, false),
        with("waiting", Standing::AwaitingApproval, true, false),
        with("off", Standing::Uncalibrated, false, false),
    ];
    robots.sort_by_cached_key(|robot| sort.position(robot));
    let ids = robots.map(|robot| robot.id);
    assert_eq!(ids, ["waiting", "off", "silent", "online", "parked"]);
}
