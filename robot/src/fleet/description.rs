//! Description that a simulated robot publishes of itself: its drawing, not its true values.

use super::robots::SimulatedRobot;
use crate::simulator::VehicleModel;

/// Radius of the wheels, m.
const WHEEL_RADIUS_M: f64 = 0.15;
/// Distance of the rear wheels from the middle, m.
const HALF_TRACK_M: f64 = 0.45;
/// Height of the LiDAR above the axles, m.
const LIDAR_HEIGHT_M: f64 = 0.2;

/// Joints that are driven: those of the fixed axle, called rear, or the steered wheel of a tricycle.
const fn driven(model: VehicleModel) -> &'static [&'static str] {
    match model {
        VehicleModel::Bicycle | VehicleModel::RearSteered => {
            &["rear_left_wheel_joint", "rear_right_wheel_joint"]
        }
        VehicleModel::Tricycle => &["front_wheel_joint"],
    }
}

/// Makes a robot's URDF: `base_link` at the rear axle's centre, x forward, lengths in m.
pub fn urdf(robot: &SimulatedRobot) -> String {
    let mount = robot.nominal();
    let wheelbase_m = robot.wheelbase_m();
    let mut text = format!("<?xml version=\"1.0\"?>\n<robot name=\"{}\">\n", robot.id);
    text.push_str("  <link name=\"base_link\"/>\n  <link name=\"steering\"/>\n");
    text.push_str("  <link name=\"lidar\"/>\n");
    for wheel in ["rear_left_wheel", "rear_right_wheel", "front_wheel"] {
        text.push_str(&wheel_link(wheel));
    }
    let turns = "<axis xyz=\"0 1 0\"/>";
    let steers = "<axis xyz=\"0 0 1\"/><limit lower=\"-1.2\" upper=\"1.2\" effort=\"100\" \
                  velocity=\"2\"/>";
    let left = [0.0, HALF_TRACK_M, 0.0];
    let right = [0.0, -HALF_TRACK_M, 0.0];
    let lidar = [mount.x_m, mount.y_m, LIDAR_HEIGHT_M];
    let front = [robot.model().steered_ahead() * wheelbase_m, 0.0, 0.0];
    let rolling = |child, parent, at| joint([child, "continuous", parent, turns], at, 0.0);
    text.push_str(&rolling("rear_left_wheel", "base_link", left));
    text.push_str(&rolling("rear_right_wheel", "base_link", right));
    let steering = ["steering", "revolute", "base_link", steers];
    text.push_str(&joint(steering, front, 0.0));
    text.push_str(&rolling("front_wheel", "steering", [0.0; 3]));
    let mounted = ["lidar", "fixed", "base_link", ""];
    text.push_str(&joint(mounted, lidar, mount.yaw_rad));
    text.push_str("  <ros2_control name=\"drive\" type=\"system\">\n");
    text.push_str(&controlled("steering_joint", "position"));
    for joint in driven(robot.model()) {
        text.push_str(&controlled(joint, "velocity"));
    }
    text.push_str("  </ros2_control>\n</robot>\n");
    text
}

/// Makes a joint of a child link, its type, its parent and its further elements.
fn joint([child, kind, parent, rest]: [&str; 4], [x, y, z]: [f64; 3], yaw_rad: f64) -> String {
    format!(
        "  <joint name=\"{child}_joint\" type=\"{kind}\"><parent link=\"{parent}\"/><child \
         link=\"{child}\"/><origin xyz=\"{x:?} {y:?} {z:?}\" rpy=\"0 0 {yaw_rad:?}\"/>{rest}</joint>\n"
    )
}

fn wheel_link(name: &str) -> String {
    format!(
        "  <link name=\"{name}\"><collision><origin xyz=\"0 0 0\" rpy=\"1.5707963267949 0 \
         0\"/><geometry><cylinder length=\"0.05\" radius=\"{WHEEL_RADIUS_M}\"/></geometry>\
         </collision></link>\n"
    )
}

fn controlled(joint: &str, by: &str) -> String {
    format!(
        "    <joint name=\"{joint}\"><command_interface name=\"{by}\"/><state_interface \
         name=\"{by}\"/></joint>\n"
    )
}
