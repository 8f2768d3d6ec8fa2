use super::*;

fn refused<M: RosMessage>(encoding: Encoding, payload: &[u8], wanted: &str) {
    match M::decode(encoding, payload) {
        Ok(_) => panic!("{} accepted what should name {wanted:?}", M::TYPE),
        Err(error) => {
            let sentence = error.to_string();
            assert!(
                sentence.contains(wanted),
                "{sentence:?} does not name {wanted:?}"
            );
            assert!(
                sentence.starts_with(M::TYPE),
                "{sentence:?} does not name its type"
            );
        }
    }
}

#[test]
fn every_truncation_names_a_field() {
    fn check<M: RosMessage>(message: &M, fields: &[&str]) {
        let payload = message.to_cdr();
        let mut named = std::collections::BTreeSet::new();
        for end in 0..payload.len() {
            let sentence = match M::from_cdr(&payload[..end]) {
                Ok(_) => panic!("{} accepted its first {end} bytes", M::TYPE),
                Err(error) => error.to_string(),
            };
            let found = fields.iter().find(|field| {
                [" ", ":"]
                    .iter()
                    .any(|end| sentence.contains(&format!(": {field}{end}")))
            });
            named.insert(*found.unwrap_or_else(|| panic!("no field named in {sentence:?}")));
        }
        assert_eq!(named.len(), fields.len(), "only {named:?} were named");
    }
    let header = [
        "encapsulation header",
        "header.stamp.sec",
        "header.stamp.nanosec",
    ];
    let with = |fields: &[&'static str]| [&header[..], &["header.frame_id"], fields].concat();
    check(
        &scan(),
        &with(&[
            "angle_min",
            "angle_max",
            "angle_increment",
            "time_increment",
            "scan_time",
            "range_min",
            "range_max",
            "ranges",
            "intensities",
        ]),
    );
    check(
        &drive(),
        &with(&[
            "drive.steering_angle",
            "drive.steering_angle_velocity",
            "drive.speed",
            "drive.acceleration",
            "drive.jerk",
        ]),
    );
    check(
        &joints(),
        &with(&["name", "position", "velocity", "effort"]),
    );
    check(
        &odometry(),
        &with(&[
            "child_frame_id",
            "pose.pose.position",
            "pose.pose.orientation",
            "pose.covariance",
            "twist.twist.linear",
            "twist.twist.angular",
            "twist.covariance",
        ]),
    );
    check(&Float64 { data: 1.0 }, &["encapsulation header", "data"]);
}

#[test]
fn another_type_is_refused() {
    let cdr = Encoding::Cdr;
    refused::<AckermannDriveStamped>(cdr, &odometry().to_cdr(), "follow drive.jerk");
    refused::<AckermannDriveStamped>(cdr, &scan().to_cdr(), "follow drive.jerk");
    refused::<LaserScan>(cdr, &drive().to_cdr(), "range_min");
    refused::<Odometry>(cdr, &drive().to_cdr(), "child_frame_id");
    refused::<LaserScan>(cdr, &scan().to_json().unwrap(), "encapsulation header");
    refused::<LaserScan>(Encoding::Json, &scan().to_cdr(), ".: expected value");
}

#[test]
fn cdr_values_that_cannot_be_are_named() {
    let mut payload = drive().to_cdr();
    payload[8..12].copy_from_slice(&1_000_000_000_u32.to_le_bytes());
    let wanted = "header.stamp.nanosec: got 1000000000, expected less than 1000000000";
    refused::<AckermannDriveStamped>(Encoding::Cdr, &payload, wanted);

    let mut names = joints();
    names.name = vec![String::new(); crate::cdr::STRINGS_MAX + 1];
    refused::<JointState>(Encoding::Cdr, &names.to_cdr(), "name claims 1025 elements");
    let json = names.to_json().unwrap();
    refused::<JointState>(
        Encoding::Json,
        &json,
        "name: invalid length 1025, expected an array",
    );
}

#[test]
fn json_refusals_name_the_path() {
    fn check<M: RosMessage>(message: &M, from: &str, to: &str, wanted: &str) {
        let json = String::from_utf8(message.to_json().unwrap()).unwrap();
        assert!(json.contains(from), "{from} is not in {json}");
        refused::<M>(Encoding::Json, json.replace(from, to).as_bytes(), wanted);
    }
    check(
        &drive(),
        "\"speed\":1.5",
        "\"speed\":\"fast\"",
        "drive.speed: invalid type",
    );
    check(
        &drive(),
        "\"speed\":1.5",
        "\"velocity\":1.5",
        "unknown field `velocity`",
    );
    check(
        &drive(),
        "\"speed\":1.5,",
        "",
        "drive: missing field `speed`",
    );
    check(
        &drive(),
        "\"speed\":1.5",
        "\"speed\":null",
        "drive.speed: invalid type: null",
    );
    check(
        &drive(),
        "\"sec\":",
        "\"sec\":4e9,\"x\":",
        "header.stamp.sec",
    );
    check(
        &drive(),
        "\"nanosec\":250000000",
        "\"nanosec\":4000000000",
        "header.stamp.nanosec",
    );
    check(
        &scan(),
        "[1.0,2.0,",
        "[1.0,\"far\",",
        "ranges[1]: invalid type",
    );
    check(
        &scan(),
        "\"angle_min\":-1.5",
        "\"angle_min\":null",
        "angle_min: invalid type: null",
    );
    check(
        &odometry(),
        "\"covariance\":[0.01,",
        "\"covariance\":[",
        "pose.covariance: invalid length",
    );
    check(&joints(), "[\"left\",", "[7,", "name[0]: invalid type");
    check(&drive(), "}}", "}} {}", "trailing characters");
}

#[test]
fn a_scan_whose_length_contradicts_its_angles_is_refused() {
    let of = |beams: usize| LaserScan {
        ranges: vec![1.0; beams].into(),
        ..scan()
    };
    for beams in [6, 7, 8] {
        of(beams).check_beams().unwrap();
    }
    for beams in [0, 4, 5, 9, 1000] {
        let sentence = of(beams).check_beams().unwrap_err().to_string();
        assert!(
            sentence.contains(&format!("has {beams} beams")),
            "{sentence}"
        );
        assert!(sentence.contains("make 7"), "{sentence}");
    }
    let turned = LaserScan {
        angle_min: 1.5,
        angle_max: -1.5,
        angle_increment: -0.5,
        ..of(7)
    };
    turned.check_beams().unwrap();
    let cases = [
        (
            LaserScan {
                angle_max: f32::NAN,
                ..of(7)
            },
            "angle_max: got NaN",
        ),
        (
            LaserScan {
                angle_min: f32::INFINITY,
                ..of(7)
            },
            "angle_min: got inf",
        ),
        (
            LaserScan {
                angle_increment: 0.0,
                ..of(7)
            },
            "angle_increment: got 0",
        ),
    ];
    for (scan, wanted) in cases {
        let sentence = scan.check_beams().unwrap_err().to_string();
        assert!(sentence.contains(wanted), "{sentence}");
    }
}
