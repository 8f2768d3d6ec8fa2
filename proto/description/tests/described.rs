//! Descriptions of our own, laid out as those of public steered robots are, and of the simulator's
//! vehicle.

#![expect(clippy::unwrap_used, reason = "a test that cannot go on fails")]

use fleetcal_description::{Description, Layout, Proposal, StaticTransform};
use fleetcal_model::{Pose2, SpeedMeasuredAt, VehicleModel};

const BICYCLE: &str = include_str!("urdf/bicycle_steering.urdf");
const TRICYCLE: &str = include_str!("urdf/tricycle.urdf");
const ACKERMANN: &str = include_str!("urdf/ackermann.urdf");
const TUGGER: &str = include_str!("urdf/tugger.urdf");

fn described(urdf: &str) -> Description {
    let mut description = Description::default();
    description.set_urdf(urdf).unwrap();
    description
}

fn proposed(urdf: &str, scan_frame: Option<&str>) -> Proposal {
    described(urdf).propose(scan_frame)
}

#[track_caller]
fn near(one: f64, other: f64) {
    assert!((one - other).abs() < 1e-3, "{one} is not {other}");
}

#[track_caller]
fn same(one: Pose2, x_m: f64, y_m: f64, yaw_rad: f64) {
    near(one.x_m, x_m);
    near(one.y_m, y_m);
    near(one.yaw_rad, yaw_rad);
}

fn transform(parent: &str, child: &str, translation_m: [f64; 3], yaw_rad: f64) -> StaticTransform {
    StaticTransform {
        parent: parent.to_owned(),
        child: child.to_owned(),
        translation_m,
        rotation: [0.0, 0.0, (yaw_rad / 2.0).sin(), (yaw_rad / 2.0).cos()],
    }
}

#[test]
fn virtual_wheels_at_the_centre_are_a_bicycle() {
    let proposal = proposed(BICYCLE, None);
    let layout = proposal.layout.unwrap();
    assert_eq!(layout.value, Layout::Bicycle);
    assert_eq!(layout.value.model(), VehicleModel::Bicycle);
    let wheelbase = proposal.wheelbase_m.unwrap();
    near(wheelbase.value, 0.62);
    assert!(
        wheelbase.source.contains("virtual_front_wheel_joint"),
        "{}",
        wheelbase.source
    );
    near(proposal.track_m.unwrap().value, 0.44);
    near(proposal.wheel_radius_m.unwrap().value, 0.08);
    let joints = proposal.joints.unwrap().value;
    assert_eq!(joints.steering, ["virtual_front_wheel_joint"]);
    assert_eq!(joints.wheels, ["virtual_rear_wheel_joint"]);
    assert_eq!(
        [joints.steering_gear, joints.wheel_gear].map(|of| of as i32),
        [1, 1]
    );
    same(
        proposal.rear_axle_in_base_link.unwrap().value,
        -0.31,
        0.0,
        0.0,
    );
    let lidar = proposal.lidar.unwrap().value;
    assert_eq!(lidar.frame, "laser_frame");
    same(lidar.in_base_link, 0.2, 0.03, std::f64::consts::PI);
    same(lidar.in_base.unwrap(), 0.51, 0.03, std::f64::consts::PI);
    assert!(!lidar.upside_down);
    assert_eq!(proposal.remarks, Vec::<String>::new());
}

#[test]
fn a_steered_and_driven_wheel_is_a_tricycle_and_its_lidar_hangs_upside_down() {
    let proposal = proposed(TRICYCLE, None);
    assert_eq!(proposal.layout.unwrap().value, Layout::Tricycle);
    near(proposal.wheelbase_m.unwrap().value, 1.5);
    near(proposal.track_m.unwrap().value, 1.0);
    near(proposal.wheel_radius_m.unwrap().value, 0.2);
    let joints = proposal.joints.unwrap().value;
    assert_eq!(joints.steering, ["steering_joint"]);
    assert_eq!(joints.wheels, ["traction_joint"]);
    same(
        proposal.rear_axle_in_base_link.unwrap().value,
        0.0,
        0.0,
        0.0,
    );
    let lidar = proposal.lidar.unwrap().value;
    assert!(lidar.upside_down);
    same(lidar.in_base.unwrap(), 1.75, -0.1, 0.1);
    near(lidar.height_m, 0.8);
    assert!(
        proposal.remarks.iter().any(|of| of.contains("upside down")),
        "{:?}",
        proposal.remarks
    );
}

#[test]
fn two_steered_wheels_are_ackermann_and_of_two_lidars_the_scans_name_one() {
    let proposal = proposed(ACKERMANN, Some("rear_laser"));
    let layout = proposal.layout.unwrap();
    assert_eq!(
        (layout.value, layout.value.model()),
        (Layout::Ackermann, VehicleModel::Bicycle)
    );
    near(proposal.wheelbase_m.unwrap().value, 1.7);
    near(proposal.wheel_radius_m.unwrap().value, 0.3);
    let joints = proposal.joints.unwrap().value;
    assert_eq!(
        joints.steering,
        ["left_wheel_steering_joint", "right_wheel_steering_joint"]
    );
    assert_eq!(
        joints.wheels,
        ["rear_left_wheel_joint", "rear_right_wheel_joint"]
    );
    let lidar = proposal.lidar.unwrap().value;
    same(lidar.in_base.unwrap(), -0.2, -0.4, -2.356);

    let unnamed = proposed(ACKERMANN, None).lidar.unwrap_err().to_string();
    assert_eq!(
        unnamed,
        "nominal_extrinsics: got 2 frames: front_laser, rear_laser, expected one LiDAR: a link or \
         frame with laser, lidar or scan in its name, or with a simulated LiDAR"
    );
}

#[test]
fn the_simulators_vehicle_is_found_among_its_other_parts() {
    let proposal = proposed(TUGGER, Some("tugger_01/lidar"));
    assert_eq!(proposal.layout.unwrap().value, Layout::Bicycle);
    near(proposal.wheelbase_m.unwrap().value, 1.2);
    near(proposal.track_m.unwrap().value, 0.96);
    let radius = proposal.wheel_radius_m.unwrap();
    near(radius.value, 0.15);
    assert!(
        radius.source.contains("above base_footprint"),
        "{}",
        radius.source
    );
    let joints = proposal.joints.unwrap().value;
    assert_eq!(joints.steering, ["steer_joint"]);
    assert_eq!(
        joints.wheels,
        ["rear_left_wheel_joint", "rear_right_wheel_joint"]
    );
    same(
        proposal.rear_axle_in_base_link.unwrap().value,
        -0.4,
        0.0,
        0.0,
    );
    same(
        proposal.lidar.unwrap().value.in_base.unwrap(),
        0.434,
        0.0,
        0.0,
    );
    assert_eq!(
        proposal.remarks,
        ["caster_swivel_joint is taken for a caster: its wheel trails behind the joint"]
    );
}

#[test]
fn a_steered_axle_at_the_rear_is_rear_steered_by_the_angle_of_its_wheel() {
    let urdf = BICYCLE.replace("\"0.31 ", "\"-0.93 ");
    let proposal = proposed(&urdf, None);
    let layout = proposal.layout.unwrap().value;
    assert_eq!(layout.model(), VehicleModel::RearSteered);
    assert_eq!(layout.speed_measured_at(), None);
    near(proposal.wheelbase_m.unwrap().value, 0.62);
    let joints = proposal.joints.unwrap().value;
    near(joints.steering_gear, 1.0);
    assert_eq!(joints.wheels, ["virtual_rear_wheel_joint"]);
    assert!(
        proposal.remarks[0].contains("behind the fixed one"),
        "{:?}",
        proposal.remarks
    );
}

#[test]
fn a_wheel_at_the_rear_that_steers_and_drives_measures_the_speed() {
    let steering = "xyz=\"0.7 0 -0.3\"";
    assert!(TRICYCLE.contains(steering));
    let urdf = TRICYCLE.replace(steering, "xyz=\"-2.3 0 -0.3\"");
    let proposal = proposed(&urdf, None);
    let layout = proposal.layout.unwrap().value;
    assert_eq!(layout.model(), VehicleModel::RearSteered);
    assert_eq!(
        layout.speed_measured_at(),
        Some(SpeedMeasuredAt::SteeredWheel)
    );
    near(proposal.wheelbase_m.unwrap().value, 1.5);
    assert_eq!(proposal.joints.unwrap().value.wheels, ["traction_joint"]);
}

#[test]
fn axes_that_point_down_or_to_the_right_have_negative_gears() {
    let urdf = BICYCLE.replace("xyz=\"0 0 1\"", "xyz=\"0 0 -1\"");
    let urdf = urdf.replace("xyz=\"1 0 0\"", "xyz=\"-1 0 0\"");
    let joints = proposed(&urdf, None).joints.unwrap().value;
    assert_eq!(
        [joints.steering_gear, joints.wheel_gear].map(|of| of as i32),
        [-1, -1]
    );
}

#[test]
fn static_transforms_add_frames_and_contradictions_are_named() {
    let mut description = described(TUGGER);
    let without = description
        .propose(Some("scanner_front"))
        .lidar
        .unwrap_err();
    assert_eq!(
        without.to_string(),
        "nominal_extrinsics: got scans in the frame \"scanner_front\", expected a link of the URDF \
         or a frame of tf_static"
    );
    let mounted = transform("/base_link", "scanner_front", [0.9, 0.1, 0.3], 0.5);
    description.add_transform(mounted).unwrap();
    let off = transform("chassis", "lidar", [-0.3, 0.0, 0.2], 0.0);
    description.add_transform(off).unwrap();
    let proposal = description.propose(Some("scanner_front"));
    let lidar = proposal.lidar.unwrap();
    same(lidar.value.in_base.unwrap(), 1.3, 0.1, 0.5);
    assert_eq!(lidar.source, "tf_static: scanner_front in base_link");
    assert!(
        proposal
            .remarks
            .iter()
            .any(|of| of.starts_with("lidar is in chassis elsewhere")),
        "{:?}",
        proposal.remarks
    );
}

#[test]
fn transforms_alone_give_the_mount_and_a_named_rear_axle() {
    let mut description = Description::default();
    description
        .add_transform(transform("base_link", "laser", [0.4, 0.0, 0.2], 0.1))
        .unwrap();
    let proposal = description.propose(Some("laser"));
    let lidar = proposal.lidar.unwrap().value;
    same(lidar.in_base_link, 0.4, 0.0, 0.1);
    assert_eq!(lidar.in_base, None);
    assert_eq!(
        proposal.wheelbase_m.unwrap_err().to_string(),
        "wheelbase_m: got no URDF, expected a URDF (robot_description)"
    );
    description
        .add_transform(transform("base_link", "rear_axle", [-0.3, 0.0, 0.0], 0.0))
        .unwrap();
    let proposal = description.propose(Some("laser"));
    same(
        proposal.lidar.unwrap().value.in_base.unwrap(),
        0.7,
        0.0,
        0.1,
    );
}

/// A change of a description, and the sentence it is refused with.
#[track_caller]
fn refused(urdf: &str, from: &str, to: &str, wanted: &str) {
    assert!(urdf.contains(from), "{from}");
    let changed = urdf.replace(from, to);
    let mut description = Description::default();
    let sentence = description.set_urdf(&changed).unwrap_err().to_string();
    assert!(sentence.contains(wanted), "{sentence}");
}

#[test]
fn a_text_that_is_no_urdf_is_refused_by_name() {
    refused(TUGGER, "</robot>", "", "expected a URDF");
    refused(TUGGER, "robot", "sdf", "got <sdf>");
    let xacro = "name=\"tugger\" xmlns:xacro=\"http://www.ros.org/wiki/xacro\"><xacro:wheel/";
    refused(TUGGER, "name=\"tugger\"", xacro, "template <xacro:wheel>");
    refused(
        TUGGER,
        "xyz=\"0.8 0 0.2\"",
        "xyz=\"0.8 0\"",
        "joint \"steer_joint\": origin xyz: got \"0.8 0\", expected three numbers",
    );
    refused(
        TUGGER,
        "radius=\"0.15\"",
        "radius=\"-1\"",
        "link \"front_wheel\": radius: got \"-1\", expected a number of metres above 0",
    );
    refused(
        TUGGER,
        "<parent link=\"steering_fork\"/>",
        "<parent link=\"fork\"/>",
        "joint \"front_wheel_joint\": parent link: got \"fork\", expected a link of the URDF",
    );
    refused(
        TUGGER,
        "<child link=\"front_wheel\"/>",
        "<child link=\"lidar\"/>",
        "expected one joint above each link",
    );
    refused(
        TUGGER,
        "<link name=\"lidar\"/>",
        "<link name=\"brush\"/>",
        "expected each name once",
    );
    refused(
        TUGGER,
        "xyz=\"0 0 1\"",
        "xyz=\"0 0 0\"",
        "axis xyz: got \"0 0 0\"",
    );
    refused(
        TUGGER,
        "</robot>",
        "<link name=\"stray\"/></robot>",
        "expected one, the root",
    );
    let long = format!(
        "<!--{}--></robot>",
        " ".repeat(fleetcal_description::URDF_BYTES_MAX)
    );
    refused(TUGGER, "</robot>", &long, "expected at most 4194304");
    let bomb = "<!DOCTYPE r [<!ENTITY a \"aaaaaaaaaa\">]><robot name=\"r\">&a;</robot>";
    assert!(Description::default().set_urdf(bomb).is_err());
}

/// A description, changes of its text, and the reason that they lead to.
type Contradiction = (
    &'static str,
    &'static [(&'static str, &'static str)],
    &'static str,
);

#[test]
fn a_contradictory_build_says_what_is_missing() {
    let cases: [Contradiction; 7] = [
        (
            TRICYCLE,
            &[("name=\"velocity\"", "name=\"temperature\"")],
            "model: got no driven joint among left_wheel_joint, right_wheel_joint and \
             traction_joint",
        ),
        (
            TUGGER,
            &[(
                "name=\"steer_joint\" type=\"revolute\"",
                "name=\"steer_joint\" type=\"fixed\"",
            )],
            "several axles: rear_left_wheel_joint at x -0.400 m, y 0.480 m, front_wheel_joint at x \
             0.800 m, y 0.000 m",
        ),
        (
            BICYCLE,
            &[("type=\"revolute\"", "type=\"fixed\"")],
            "steering joint: got none: the vehicle is not steered by a wheel",
        ),
        (
            ACKERMANN,
            &[(
                "<origin xyz=\"0.9 -0.5 -0.2\"",
                "<origin xyz=\"0.5 -0.5 -0.2\"",
            )],
            "steering joint: got joints of several axles: left_wheel_steering_joint at x 1.700 m",
        ),
        (
            ACKERMANN,
            &[(
                "<origin xyz=\"0.9 -0.5 -0.2\"",
                "<origin xyz=\"0.9 -0.2 -0.2\"",
            )],
            "steering joint: got left_wheel_steering_joint at x 1.700 m, y 0.500 m, \
             right_wheel_steering_joint",
        ),
        (
            TUGGER,
            &[("xyz=\"-0.4 -0.48 0\"", "xyz=\"0.1 -0.48 0\"")],
            "fixed axle: got wheels of several axles",
        ),
        (
            TRICYCLE,
            &[("type=\"continuous\"", "type=\"fixed\"")],
            "fixed axle: got no wheel that rolls without being steered",
        ),
    ];
    for (urdf, changes, wanted) in cases {
        let mut changed = urdf.to_owned();
        for (from, to) in changes {
            assert!(changed.contains(from), "{from}");
            changed = changed.replace(from, to);
        }
        let proposal = proposed(&changed, None);
        let reasons = [
            proposal.layout.err().map(|of| of.to_string()),
            proposal.wheelbase_m.err().map(|of| of.to_string()),
        ];
        let text = format!("{reasons:?}");
        let own = wanted.split_once(": got ").map_or(wanted, |(_, rest)| rest);
        assert!(text.contains(own), "{wanted}\n{text}");
    }
}

#[test]
fn wheels_that_contradict_each_other_give_no_radius_or_gear() {
    let urdf = ACKERMANN.replacen("radius=\"0.3\"", "radius=\"0.25\"", 1);
    let refused = proposed(&urdf, None)
        .wheel_radius_m
        .unwrap_err()
        .to_string();
    assert_eq!(
        refused,
        "wheel_radius_m: got 0.2500 m of rear_left_wheel and 0.3000 m of rear_right_wheel, expected \
         one radius of both"
    );
    let urdf = ACKERMANN.replacen("rpy=\"-1.57 0 0\"", "rpy=\"1.57 0 0\"", 1);
    let refused = proposed(&urdf, None).joints.unwrap_err().to_string();
    assert!(
        refused.contains("which roll forwards with opposite signs"),
        "{refused}"
    );
    let tilted = TUGGER.replace(
        "xyz=\"-0.366 0 0.2\" rpy=\"0 0 0\"",
        "xyz=\"0 0 0\" rpy=\"0 0.5 0\"",
    );
    let refused = proposed(&tilted, Some("lidar"))
        .lidar
        .unwrap_err()
        .to_string();
    assert!(refused.contains("lidar tilted by 29 degrees"), "{refused}");
}

#[test]
fn impossible_transforms_are_refused() {
    let mut description = Description::default();
    let mut unturned = transform("a", "b", [0.0; 3], 0.0);
    unturned.rotation = [0.0; 4];
    let sentence = description.add_transform(unturned).unwrap_err().to_string();
    assert!(
        sentence.contains("expected finite metres and a unit quaternion"),
        "{sentence}"
    );
    for number in 0..fleetcal_description::STATIC_TRANSFORMS_MAX {
        let frame = transform("a", &format!("f{number}"), [0.0; 3], 0.0);
        description.add_transform(frame).unwrap();
    }
    let again = transform("a", "f7", [1.0, 0.0, 0.0], 0.0);
    assert!(description.add_transform(again).is_ok());
    let more = transform("a", "more", [0.0; 3], 0.0);
    assert!(description.add_transform(more).is_err());
    // A circle of frames joins nothing.
    let mut circle = Description::default();
    circle
        .add_transform(transform("a", "b", [0.0; 3], 0.0))
        .unwrap();
    circle
        .add_transform(transform("b", "a", [0.0; 3], 0.0))
        .unwrap();
    assert!(circle.propose(Some("a")).lidar.is_err());
}
