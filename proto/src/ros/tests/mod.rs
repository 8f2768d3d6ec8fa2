//! The codecs of all messages: golden bytes, round trips, refusals, and mutated payloads.

mod golden;
mod mutated;
mod point_cloud2;
mod refusals;
mod round_trips;

use super::*;

/// Makes a header of 1700000000.25 s, the stamp of the golden bytes.
fn header(frame_id: &str) -> Header {
    Header {
        stamp: Time {
            sec: 1_700_000_000,
            nanosec: 250_000_000,
        },
        frame_id: frame_id.into(),
    }
}

fn scan() -> LaserScan {
    LaserScan {
        header: header("laser"),
        angle_min: -1.5,
        angle_max: 1.5,
        angle_increment: 0.5,
        time_increment: 0.001,
        scan_time: 0.1,
        range_min: 0.05,
        range_max: 30.0,
        ranges: [1.0, 2.0, 3.0, 4.0].into(),
        intensities: [10.0, 20.0].into(),
    }
}

fn drive() -> AckermannDriveStamped {
    let drive = AckermannDrive {
        steering_angle: 0.1,
        speed: 1.5,
        ..AckermannDrive::default()
    };
    AckermannDriveStamped {
        header: header("base_link"),
        drive,
    }
}

fn joints() -> JointState {
    JointState {
        header: header(""),
        name: vec!["left".into(), "right".into()],
        position: vec![0.1, 0.2],
        velocity: vec![1.0, 2.0],
        effort: vec![],
    }
}

fn odometry() -> Odometry {
    let mut message = Odometry {
        header: header("odom"),
        ..Odometry::default()
    };
    message.child_frame_id = "laser".into();
    message.pose.pose.position = Vector3 {
        x: 1.0,
        y: -2.0,
        z: 0.0,
    };
    message.pose.pose.orientation = Quaternion::from_yaw(0.3);
    message.pose.covariance[0] = 0.01;
    message.pose.covariance[35] = 0.02;
    message.twist.twist.linear.x = 0.5;
    message
}

fn velocities() -> TwistStamped {
    let mut message = TwistStamped {
        header: header("base_link"),
        ..TwistStamped::default()
    };
    message.twist.linear = Vector3 {
        x: 0.5,
        y: -0.25,
        z: 0.0,
    };
    message.twist.angular.z = 0.125;
    message
}
