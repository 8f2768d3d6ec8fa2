use fleetcal_proto::ros::RosMessage;

use super::*;

#[test]
fn what_is_written_reads_back() {
    let folder = TempDir::new().unwrap();
    let recording = Recording::open(&recorded(&folder, "a.mcap", 20)).unwrap();
    let shown: Vec<(&str, &str, u64)> = recording
        .channels()
        .iter()
        .map(|channel| (&*channel.topic, &*channel.message_type, channel.count))
        .collect();
    assert_eq!(
        shown,
        [
            (
                "/tugger_01/wheel_odometry",
                "ackermann_msgs/msg/AckermannDriveStamped",
                2000
            ),
            ("/tugger_01/scan", "sensor_msgs/msg/LaserScan", 200),
            ("/tugger_01/truth", "geometry_msgs/msg/PoseStamped", 200),
        ]
    );
    assert_eq!(recording.start_ns(), START_NS.unsigned_abs());
    assert!((recording.duration_s() - 19.9909).abs() < 1e-6);

    let topics = choose_topics(recording.channels(), &AskedTopics::default()).unwrap();
    assert_eq!(
        topics.names(),
        ["/tugger_01/wheel_odometry", "/tugger_01/scan"]
    );
    assert_eq!(topics.robot(), Some("tugger_01"));
    assert_eq!(recording.count(&topics.names()), 2200);
    let (mut drives, mut scans, mut newest_ns) = (0, 0, 0);
    for message in recording.messages(&topics.names()).unwrap() {
        let message = message.unwrap();
        assert!(message.log_time_ns >= newest_ns);
        newest_ns = message.log_time_ns;
        if message.topic.ends_with("wheel_odometry") {
            let read = AckermannDriveStamped::from_cdr(&message.payload).unwrap();
            assert_eq!(read, drive(START_NS + drives * SECOND_NS / 100));
            drives += 1;
        } else {
            let read = LaserScan::from_cdr(&message.payload).unwrap();
            assert_eq!(read, scan(START_NS + scans * SECOND_NS / 10));
            scans += 1;
        }
    }
    assert_eq!((drives, scans), (2000, 200));
}

#[test]
fn the_same_messages_give_the_same_bytes() {
    let folder = TempDir::new().unwrap();
    let [first, second] = ["a.mcap", "b.mcap"].map(|name| recorded(&folder, name, 2));
    assert_eq!(
        std::fs::read(first).unwrap(),
        std::fs::read(second).unwrap()
    );
}

#[test]
fn the_true_values_are_in_the_file() {
    let folder = TempDir::new().unwrap();
    let bytes = std::fs::read(recorded(&folder, "a.mcap", 1)).unwrap();
    let summary = mcap::Summary::read(&bytes).unwrap().unwrap();
    let metadata = mcap::read::metadata(&bytes, &summary.metadata_indexes[0]).unwrap();
    assert_eq!(metadata.name, TRUTH_METADATA);
    assert_eq!(metadata.metadata["lidar_x_m"], "0.434");
}

#[test]
fn a_folder_that_is_not_there_is_an_io_error() {
    let folder = TempDir::new().unwrap();
    let robot = RobotId::parse("a").unwrap();
    let error = RecordingWriter::create(&folder.path().join("no/a.mcap"), &robot).unwrap_err();
    assert_eq!(error.exit_status(), 74);
}
