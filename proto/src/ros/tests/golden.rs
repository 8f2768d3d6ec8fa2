use super::*;

/// Bytes that an independent implementation (the Python package `rosbags`) wrote.
const SCAN: &str = "0001000000f1536580b2e60e060000006c617365720000000000c0bf0000c03f0000003f6f12833a\
    cdcccc3dcdcc4c3d0000f041040000000000803f00000040000040400000804002000000000020410000a041";
const DRIVE: &str = "0001000000f1536580b2e60e0a000000626173655f6c696e6b000000cdcccc3d000000000000c03f\
    0000000000000000";
const JOINTS: &str = "0001000000f1536580b2e60e010000000000000002000000050000006c6566740000000006000000\
    7269676874000000020000009a9999999999b93f9a9999999999c93f0200000000000000000000000000f03f00000000\
    0000004000000000";

const POSE: &str = "0001000000f1536580b2e60e050000006f646f6d0000000000000000000000000000f03f00000000000000c000000000\
    000000000000000000000000000000000000000022eddfe9c920c33f37e95e3e03a4ef3f";
const TWIST: &str = "0001000000f1536580b2e60e0a000000626173655f6c696e6b000000000000000000e03f000000000000d0bf00000000\
    0000000000000000000000000000000000000000000000000000c03f";
const TEXT: &str = "000100000600000068656c6c6f00";
/// The odometry up to its first covariance; it continues with zeros except for the numbers that
/// [`golden_odometry`] inserts.
const ODOMETRY: &str = "0001000000f1536580b2e60e050000006f646f6d00000000060000006c61736572000000000000000000f03f00000000\
    000000c000000000000000000000000000000000000000000000000022eddfe9c920c33f37e95e3e03a4ef3f";

/// All 724 bytes of the odometry.
fn golden_odometry() -> Vec<u8> {
    let mut golden = bytes(ODOMETRY);
    let covariance_at = golden.len();
    golden.resize(covariance_at + 8 * (36 + 6 + 36), 0);
    for (number, place) in [
        ("7b14ae47e17a843f", 0),
        ("7b14ae47e17a943f", 35),
        ("000000000000e03f", 36),
    ] {
        let at = covariance_at + 8 * place;
        golden[at..at + 8].copy_from_slice(&bytes(number));
    }
    golden
}

pub(super) fn bytes(hex: &str) -> Vec<u8> {
    let digits: Vec<u8> = hex.bytes().filter(u8::is_ascii_hexdigit).collect();
    let byte = |pair: &[u8]| u8::from_str_radix(std::str::from_utf8(pair).unwrap(), 16).unwrap();
    digits.chunks(2).map(byte).collect()
}

#[test]
fn a_scan_reads_and_writes_the_bytes_of_others() {
    assert_eq!(LaserScan::from_cdr(&bytes(SCAN)).unwrap(), scan());
    assert_eq!(scan().to_cdr(), bytes(SCAN));
}

#[test]
fn a_drive_sample_reads_and_writes_the_bytes_of_others() {
    assert_eq!(
        AckermannDriveStamped::from_cdr(&bytes(DRIVE)).unwrap(),
        drive()
    );
    assert_eq!(drive().to_cdr(), bytes(DRIVE));
}

#[test]
fn joints_read_and_write_the_bytes_of_others() {
    assert_eq!(JointState::from_cdr(&bytes(JOINTS)).unwrap(), joints());
    assert_eq!(joints().to_cdr(), bytes(JOINTS));
}

#[test]
fn an_odometry_reads_and_writes_the_bytes_of_others() {
    let golden = golden_odometry();
    let read = Odometry::from_cdr(&golden).unwrap();
    // Sine and cosine may differ in their last bit from one library to another.
    assert!((read.pose.pose.orientation.yaw_rad() - 0.3).abs() < 1e-15);
    let mut expected = odometry();
    expected.pose.pose.orientation = read.pose.pose.orientation;
    assert_eq!(read, expected);
    assert_eq!(read.to_cdr(), golden);
}

#[test]
fn poses_velocities_and_texts_read_and_write_the_bytes_of_others() {
    let pose = PoseStamped::from_cdr(&bytes(POSE)).unwrap();
    assert_eq!(pose.header, header("odom"));
    assert_eq!(pose.pose.position, odometry().pose.pose.position);
    assert_eq!(pose.to_cdr(), bytes(POSE));

    let twist = TwistStamped::from_cdr(&bytes(TWIST)).unwrap();
    assert_eq!(twist, velocities());
    assert_eq!(twist.to_cdr(), bytes(TWIST));

    let text = StringMessage::from_cdr(&bytes(TEXT)).unwrap();
    assert_eq!(text.data, "hello");
    assert_eq!(text.to_cdr(), bytes(TEXT));
}

#[test]
fn sizes_are_those_of_other_implementations() {
    let scan_of = |beams: usize| LaserScan {
        ranges: vec![1.0; beams].into(),
        intensities: [].into(),
        ..scan()
    };
    for (beams, size) in [(360, 1500), (720, 2940), (1081, 4384), (1440, 5820)] {
        assert_eq!(scan_of(beams).to_cdr().len(), size);
    }
    let odometry = Odometry {
        child_frame_id: "base_link".into(),
        ..odometry()
    };
    assert_eq!(odometry.to_cdr().len(), 724);
    assert_eq!(drive().to_cdr().len(), 48);
}

#[test]
fn the_expected_size_is_enough_for_one_allocation() {
    fn check<M: RosMessage>(message: &M) {
        assert!(
            message.body_bytes() + 4 >= message.to_cdr().len(),
            "{}",
            M::TYPE
        );
    }
    check(&scan());
    check(&drive());
    check(&joints());
    check(&odometry());
    check(&super::point_cloud2::cloud());
    check(&Float64 { data: 1.0 });
    check(&velocities());
    check(&StringMessage {
        data: "hello".into(),
    });
}

#[test]
fn big_endian_is_read_too() {
    let mut payload = vec![0, 0, 0, 0];
    payload.extend(1_700_000_000_i32.to_be_bytes());
    payload.extend(250_000_000_u32.to_be_bytes());
    payload.extend(10_u32.to_be_bytes());
    payload.extend(b"base_link\0\0\0");
    for value in [0.1_f32, 0.0, 1.5, 0.0, 0.0] {
        payload.extend(value.to_be_bytes());
    }
    assert_eq!(AckermannDriveStamped::from_cdr(&payload).unwrap(), drive());

    let mut payload = vec![0, 0, 0, 0];
    payload.extend(1_700_000_000_i32.to_be_bytes());
    payload.extend(250_000_000_u32.to_be_bytes());
    payload.extend(6_u32.to_be_bytes());
    payload.extend(b"laser\0\0\0");
    for value in [-1.5_f32, 1.5, 0.5, 0.001, 0.1, 0.05, 30.0] {
        payload.extend(value.to_be_bytes());
    }
    payload.extend(4_u32.to_be_bytes());
    for value in [1.0_f32, 2.0, 3.0, 4.0] {
        payload.extend(value.to_be_bytes());
    }
    payload.extend(2_u32.to_be_bytes());
    for value in [10.0_f32, 20.0] {
        payload.extend(value.to_be_bytes());
    }
    assert_eq!(LaserScan::from_cdr(&payload).unwrap(), scan());

    let mut payload = vec![0, 0, 0, 0];
    payload.extend(0.25_f64.to_be_bytes());
    assert_eq!(Float64::from_cdr(&payload).unwrap(), Float64 { data: 0.25 });
}
