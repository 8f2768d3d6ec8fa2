use zenoh::key_expr::KeyExpr;

use super::*;

fn table(robots: &[(&str, &str)]) -> RouteTable {
    let robots = robots.iter().map(|(id, streams)| {
        let streams: RobotStreams = toml::from_str(streams).unwrap();
        (RobotId::parse(id).unwrap(), streams)
    });
    RouteTable::new(
        &Ros2Settings::default(),
        &KeyRoot::default(),
        robots.collect(),
    )
}

const SCAN: &str = "sensor_msgs::msg::dds_::LaserScan_";

/// Returns the only route of a key.
fn route<'k>(table: &RouteTable, key: &'k str) -> Option<Route<'k>> {
    let mut routes = table.routes(key);
    assert!(routes.len() <= 1, "{routes:?}");
    routes.pop()
}

fn routed(table: &RouteTable, key: &str) -> Option<(String, Stream)> {
    let route = route(table, key)?;
    Some((route.robot.as_str().to_owned(), route.stream))
}

#[test]
fn a_robot_that_nobody_knows_has_the_usual_topics() {
    let table = table(&[]);
    for key in [
        format!("0/tugger_01/scan/{SCAN}/RIHS01_64c1"),
        format!("7/tugger_01/scan/{SCAN}/TypeHashNotSupported"),
        "tugger_01/scan".to_owned(),
    ] {
        let wanted = Some(("tugger_01".to_owned(), Stream::Scan));
        assert_eq!(routed(&table, &key), wanted, "{key}");
    }
    for key in [
        "fleet/tugger_01/scan",
        "tugger_01/camera",
        "0/tugger_01/x/scan",
    ] {
        assert_eq!(routed(&table, key), None, "{key}");
    }
}

#[test]
fn a_configured_robot_has_its_own_topics_and_prefix() {
    let table = table(&[
        ("tugger_01", "scan = { topic = 'front/scan' }"),
        ("tugger_02", "prefix = '7'\nscan = { topic = 'lidar/scan' }"),
    ]);
    let key = format!("0/tugger_01/front/scan/{SCAN}/RIHS01_64c1");
    let route = route(&table, &key).unwrap();
    assert_eq!(route.prefix, "0/tugger_01");
    assert_eq!(route.message_type, Some(MessageType::LaserScan));
    assert_eq!(routed(&table, "tugger_01/scan"), None, "not its topic");
    for key in [
        format!("7/lidar/scan/{SCAN}/RIHS01_64c1"),
        "7/lidar/scan".to_owned(),
    ] {
        let wanted = Some(("tugger_02".to_owned(), Stream::Scan));
        assert_eq!(routed(&table, &key), wanted, "{key}");
    }
    let expressions = table.robot_expressions();
    assert!(expressions.contains(&format!("*/tugger_01/front/scan/{SCAN}/*")));
    assert!(expressions.contains("tugger_01/front/scan"));
    assert!(expressions.contains("7/wheel_odometry"));
    assert!(
        !expressions
            .iter()
            .any(|text| text.ends_with("tugger_01/wheel_odometry"))
    );
}

#[test]
fn a_short_prefix_hides_nobody_behind_it() {
    let table = table(&[
        ("lone", "prefix = '0'"),
        ("site_cart", "prefix = '0/site/b'"),
        ("tugger_01", ""),
    ]);
    for (key, robot) in [
        (format!("0/scan/{SCAN}/RIHS01_64c1"), "lone"),
        (format!("0/tugger_01/scan/{SCAN}/RIHS01_64c1"), "tugger_01"),
        (format!("0/stranger/scan/{SCAN}/RIHS01_64c1"), "stranger"),
        (format!("0/site/b/scan/{SCAN}/RIHS01_64c1"), "site_cart"),
    ] {
        let wanted = Some((robot.to_owned(), Stream::Scan));
        assert_eq!(routed(&table, &key), wanted, "{key}");
    }
    let own = format!("0/lone/scan/{SCAN}/RIHS01_64c1");
    assert_eq!(routed(&table, &own), None, "it has a prefix");
}

#[test]
fn robots_at_one_place_get_what_each_is_configured_to_take() {
    let rear = "scan = { topic = 'scan_rear' }";
    let table = table(&[
        // Two LiDARs of one vehicle, whose namespace is the first id.
        ("two", ""),
        ("two_rear", &format!("prefix = '0/two'\n{rear}")),
        // And of one that both have by its domain.
        ("seven", "prefix = '7'"),
        ("seven_rear", &format!("prefix = '7'\n{rear}")),
        // No robot is named as the place of this one.
        ("other", "prefix = '0/elsewhere'"),
    ]);
    let drive = "ackermann_msgs::msg::dds_::AckermannDriveStamped_";
    for (path, of, robots) in [
        ("0/two/wheel_odometry", drive, &["two_rear", "two"][..]),
        ("0/two/scan", SCAN, &["two"]),
        ("0/two/scan_rear", SCAN, &["two_rear"]),
        ("7/wheel_odometry", drive, &["seven", "seven_rear"]),
        ("7/scan", SCAN, &["seven"]),
        ("7/scan_rear", SCAN, &["seven_rear"]),
        ("0/elsewhere/scan", SCAN, &["other"]),
    ] {
        let key = format!("{path}/{of}/RIHS01_64c1");
        let routes = table.routes(&key);
        let taken: Vec<_> = routes.iter().map(|route| route.robot.as_str()).collect();
        assert_eq!(taken, robots, "{key}");
        let places = table.places(path, KeyLayout::RmwZenoh);
        let shown: Vec<_> = places.iter().map(|placed| placed.robot.as_str()).collect();
        assert_eq!(shown, robots, "{key}");
        let wanted = table.wanted_expressions();
        let all_wanted = routes
            .iter()
            .all(|route| wanted.contains(&route.expression));
        assert!(all_wanted, "{routes:?}");
    }
    // What the place itself has is one robot's.
    let nearest = |path| {
        let nearest = table.nearest(path, KeyLayout::RmwZenoh).unwrap();
        nearest.robot.as_str().to_owned()
    };
    assert_eq!(nearest("0/two/calibration/approved"), "two");
    assert_eq!(nearest("7/calibration/approved"), "seven");
    assert_eq!(nearest("0/elsewhere/calibration/approved"), "other");
}

#[test]
fn a_bridges_topic_that_is_configured_after_the_access_list_is_blocked() {
    let mut table = table(&[("before", "scan = { topic = 'scan_front' }")]);
    table.close_access_list();
    let later = [
        ("before", "scan = { topic = 'scan_front' }"),
        ("usual", ""),
        ("later", "scan = { topic = 'scan_front' }"),
        ("below", "prefix = 'site/agv'"),
    ];
    let later = later.map(|(id, streams)| {
        let streams: RobotStreams = toml::from_str(streams).unwrap();
        (RobotId::parse(id).unwrap(), streams)
    });
    table.set_robots(later.into());
    let is_blocked = |path: &str, layout| {
        let places = table.places(path, layout);
        places
            .iter()
            .any(|placed| table.is_blocked(placed, path, layout))
    };
    for (path, blocked) in [
        ("before/scan_front", false),
        ("usual/scan", false),
        ("later/wheel_odometry", false),
        ("later/scan_front", true),
        ("site/agv/wheel_odometry", true),
        // Nobody takes it.
        ("later/camera", false),
    ] {
        assert_eq!(
            is_blocked(path, KeyLayout::BridgeRos2dds),
            blocked,
            "{path}"
        );
    }
    // A key of rmw_zenoh says its type, which is on the list.
    assert!(!is_blocked("0/later/scan_front", KeyLayout::RmwZenoh));
}

#[test]
fn each_key_is_taken_by_one_expression_of_the_table_for_a_robot() {
    let settings: Ros2Settings = toml::from_str(
        "rmw_zenoh = ['{domain}/{robot}/{topic}', '{robot}/{topic}', '{robot}/{domain}/{topic}']",
    )
    .unwrap();
    let robots = [
        ("left", "scan = { topic = 'front/scan' }"),
        // By its domain: the key is also one that the robot before it may have.
        ("7", "scan = { topic = 'left/front/scan' }"),
        // Its prefix lies below that domain.
        ("cart", "prefix = '7/left'\nscan = { topic = 'rear/scan' }"),
        (
            "9",
            "scan = { topic = 'scan' }
wheel_odometry = { topic = '3/wheel_odometry' }",
        ),
    ];
    let robots = robots.map(|(id, streams)| {
        let streams: RobotStreams = toml::from_str(streams).unwrap();
        (RobotId::parse(id).unwrap(), streams)
    });
    let table = RouteTable::new(&settings, &KeyRoot::default(), robots.into());
    let mut all = table.usual_expressions();
    all.extend(table.robot_expressions());
    let drive = "ackermann_msgs::msg::dds_::AckermannDriveStamped_";
    let mut matched_by_many = 0;
    for (path, of, robots) in [
        ("7/left/front/scan", SCAN, &["left"][..]),
        ("8/left/front/scan", SCAN, &["left"]),
        ("7/left/rear/scan", SCAN, &["cart"]),
        // At the place of both.
        ("7/left/wheel_odometry", drive, &["cart", "left"]),
        ("7/9/scan", SCAN, &["9"]),
        ("9/7/scan", SCAN, &["9"]),
        ("9/3/wheel_odometry", drive, &["3"]),
        ("9/scan", SCAN, &["9"]),
        ("stranger/4/scan", SCAN, &["stranger"]),
    ] {
        let key = format!("{path}/{of}/RIHS01_64c1");
        let routes = table.routes(&key);
        let taken: Vec<_> = routes.iter().map(|route| route.robot.as_str()).collect();
        assert_eq!(taken, robots, "{key}");
        let key = KeyExpr::try_from(key.as_str()).unwrap();
        let includes = |text: &&String| KeyExpr::try_from(text.as_str()).unwrap().includes(&key);
        for route in &routes {
            assert!(all.contains(&route.expression), "{}", route.expression);
            assert!(includes(&&route.expression), "{}", route.expression);
        }
        matched_by_many += usize::from(all.iter().filter(includes).count() > 1);
    }
    assert!(matched_by_many >= 2, "{matched_by_many}");
    // Of a type that its robot does not take there.
    assert!(route(&table, &format!("7/left/front/scan/{drive}/RIHS01_64c1")).is_none());
}

#[test]
fn of_several_instances_each_hears_the_topics_of_its_robots() {
    let mut table = table(&[
        ("tugger_01", ""),
        ("tugger_02", "prefix = '7'"),
        ("tugger_03", ""),
    ]);
    let heard = ["tugger_01", "tugger_02"].map(|id| RobotId::parse(id).unwrap());
    table.set_heard(Some(heard.clone().into()));
    let of_tugger_01 = |text: &String| text.contains("tugger_01");
    assert!(!table.wanted_expressions().iter().any(of_tugger_01));
    assert!(table.note_announcing(&heard[0]));
    assert!(!table.note_announcing(&heard[0]), "for the second time");
    let wanted = table.wanted_expressions();
    let is_heard = |key: &str| {
        let key = KeyExpr::try_from(key).unwrap();
        let mut wanted = wanted.iter();
        wanted.any(|text| KeyExpr::try_from(text.as_str()).unwrap().includes(&key))
    };
    for (key, wanted) in [
        (format!("0/tugger_01/scan/{SCAN}/RIHS01_64c1"), true),
        ("tugger_01/scan".to_owned(), true),
        (format!("7/scan/{SCAN}/RIHS01_64c1"), true),
        (format!("0/tugger_03/scan/{SCAN}/RIHS01_64c1"), false),
        ("tugger_03/scan".to_owned(), false),
    ] {
        assert_eq!(is_heard(&key), wanted, "{key}");
        let expression = route(&table, &key).unwrap().expression;
        assert_eq!(
            table.wanted_expressions().contains(&expression),
            wanted,
            "{key}"
        );
    }
    table.set_heard(Some(BTreeSet::new()));
    assert!(table.wanted_expressions().is_empty());
}

#[test]
fn a_token_says_what_a_key_of_the_bridge_does_not() {
    let mut table = table(&[]);
    let of = |table: &RouteTable| route(table, "tugger_01/scan").unwrap().message_type;
    assert_eq!(of(&table), None);
    table.announce("tugger_01/scan", Some(MessageType::PointCloud2));
    assert_eq!(of(&table), Some(MessageType::PointCloud2));
    table.announce("tugger_01/scan", None);
    assert_eq!(of(&table), None);
}

#[test]
fn every_expression_of_the_usual_topics_holds_a_type_or_is_the_bridges() {
    let table = table(&[]);
    let usual = table.usual_expressions();
    assert!(usual.contains(&format!("*/*/scan/{SCAN}/*")), "{usual:?}");
    assert!(usual.contains("*/wheel_odometry"));
    let bridge: Vec<String> = table.bridge_expressions().into_iter().collect();
    assert_eq!(bridge, ["*/lidar_odometry", "*/scan", "*/wheel_odometry"]);
}
