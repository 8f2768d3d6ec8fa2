use proptest::collection::vec;
use proptest::prelude::*;

use super::*;

fn any_header() -> impl Strategy<Value = Header> {
    (any::<i32>(), 0..1_000_000_000_u32, "[a-zü/_]{0,12}").prop_map(|(sec, nanosec, frame_id)| {
        Header {
            stamp: Time { sec, nanosec },
            frame_id,
        }
    })
}

fn number() -> impl Strategy<Value = f32> {
    prop_oneof![
        -1e6_f32..1e6,
        Just(0.0),
        Just(f32::MAX),
        Just(f32::MIN_POSITIVE)
    ]
}

fn wide() -> impl Strategy<Value = f64> {
    prop_oneof![
        -1e9_f64..1e9,
        Just(0.0),
        Just(f64::MAX),
        Just(f64::MIN_POSITIVE)
    ]
}

fn any_scan() -> impl Strategy<Value = LaserScan> {
    let range = prop_oneof![9 => number(), 1 => Just(f32::INFINITY)];
    (
        any_header(),
        vec(number(), 7),
        vec(range, 0..50),
        vec(number(), 0..50),
    )
        .prop_map(|(header, shape, ranges, intensities)| LaserScan {
            header,
            angle_min: shape[0],
            angle_max: shape[1],
            angle_increment: shape[2],
            time_increment: shape[3],
            scan_time: shape[4],
            range_min: shape[5],
            range_max: shape[6],
            ranges: ranges.into(),
            intensities: intensities.into(),
        })
}

fn any_drive() -> impl Strategy<Value = AckermannDriveStamped> {
    (any_header(), vec(number(), 5)).prop_map(|(header, values)| AckermannDriveStamped {
        header,
        drive: AckermannDrive {
            steering_angle: values[0],
            steering_angle_velocity: values[1],
            speed: values[2],
            acceleration: values[3],
            jerk: values[4],
        },
    })
}

fn any_joints() -> impl Strategy<Value = JointState> {
    let numbers = || vec(wide(), 0..6);
    (
        any_header(),
        vec("[a-z_]{0,9}", 0..6),
        numbers(),
        numbers(),
        numbers(),
    )
        .prop_map(|(header, name, position, velocity, effort)| JointState {
            header,
            name,
            position,
            velocity,
            effort,
        })
}

fn any_odometry() -> impl Strategy<Value = Odometry> {
    (
        any_header(),
        "[a-z_]{0,9}",
        vec(wide(), 13),
        vec(wide(), 36),
    )
        .prop_map(|(header, child_frame_id, v, covariance)| {
            let covariance: Covariance = covariance.try_into().unwrap();
            let orientation = Quaternion {
                x: v[3],
                y: v[4],
                z: v[5],
                w: v[6],
            };
            let position = Vector3 {
                x: v[0],
                y: v[1],
                z: v[2],
            };
            let linear = Vector3 {
                x: v[7],
                y: v[8],
                z: v[9],
            };
            let angular = Vector3 {
                x: v[10],
                y: v[11],
                z: v[12],
            };
            Odometry {
                header,
                child_frame_id,
                pose: PoseWithCovariance {
                    pose: Pose {
                        position,
                        orientation,
                    },
                    covariance,
                },
                twist: TwistWithCovariance {
                    twist: Twist { linear, angular },
                    covariance,
                },
            }
        })
}

fn same_both_ways<M: RosMessage + PartialEq + std::fmt::Debug>(
    message: &M,
) -> Result<(), TestCaseError> {
    prop_assert_eq!(&M::from_cdr(&message.to_cdr()).unwrap(), message);
    prop_assert_eq!(&M::from_json(&message.to_json().unwrap()).unwrap(), message);
    Ok(())
}

proptest! {
    #[test]
    fn scans(message in any_scan()) {
        same_both_ways(&message)?;
    }

    #[test]
    fn drive_samples(message in any_drive()) {
        same_both_ways(&message)?;
    }

    #[test]
    fn joints_of_any_number(message in any_joints()) {
        same_both_ways(&message)?;
    }

    #[test]
    fn odometry_poses(message in any_odometry()) {
        same_both_ways(&message)?;
        let pose = message.pose.pose;
        same_both_ways(&PoseStamped { header: message.header, pose })?;
    }

    #[test]
    fn numbers(data in wide()) {
        same_both_ways(&Float64 { data })?;
    }
}

#[test]
fn what_json_does_not_have_is_null_and_no_return() {
    let scan = LaserScan {
        ranges: [1.0, f32::NAN, f32::INFINITY].into(),
        ..scan()
    };
    let json = String::from_utf8(scan.to_json().unwrap()).unwrap();
    assert!(json.contains(r#""ranges":[1.0,null,null]"#), "{json}");
    let read = LaserScan::from_json(json.as_bytes()).unwrap();
    assert_eq!(read.ranges[..], [1.0, f32::INFINITY, f32::INFINITY]);
    let cdr = LaserScan::from_cdr(&scan.to_cdr()).unwrap();
    assert!(cdr.ranges[1].is_nan() && cdr.ranges[2] == f32::INFINITY);
}

#[test]
fn json_may_leave_out_what_is_not_needed() {
    let text =
        r#"{"header":{"stamp":{"sec":1,"nanosec":5}},"drive":{"steering_angle":0.1,"speed":-1}}"#;
    let message = AckermannDriveStamped::decode(Encoding::Json, text.as_bytes()).unwrap();
    assert_eq!(message.header.stamp.as_ns(), 1_000_000_005);
    assert_eq!(message.drive.speed.to_bits(), (-1.0_f32).to_bits());
}
