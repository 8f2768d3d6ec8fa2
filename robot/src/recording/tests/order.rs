use std::collections::BTreeMap;
use std::io::Cursor;

use mcap::records::MessageHeader;
use mcap::{Compression, WriteOptions};

use super::*;

/// Log times in the order of the file: two topics, out of order by up to 7, with equal times.
const LOG_TIMES: [u64; 12] = [10, 12, 11, 18, 18, 11, 14, 20, 30, 29, 30, 23];

fn shuffled(options: WriteOptions) -> Vec<u8> {
    let mut writer = options
        .chunk_size(Some(100))
        .create(Cursor::new(Vec::new()))
        .unwrap();
    let schema = writer
        .add_schema("sensor_msgs::msg::dds_::LaserScan_", "ros2msg", b"")
        .unwrap();
    let channels = ["/a", "/b", "/c"].map(|topic| {
        writer
            .add_channel(schema, topic, "cdr", &BTreeMap::new())
            .unwrap()
    });
    for (place, log_time) in LOG_TIMES.into_iter().enumerate() {
        let channel_id = channels[place % 3];
        let header = MessageHeader {
            channel_id,
            sequence: 0,
            log_time,
            publish_time: 0,
        };
        writer
            .write_to_known_channel(&header, &[place as u8])
            .unwrap();
    }
    writer.finish().unwrap();
    writer.into_inner().into_inner()
}

#[test]
fn messages_come_in_the_order_of_their_log_times() {
    let folder = TempDir::new().unwrap();
    let path = folder.path().join("shuffled.mcap");
    let plain = || WriteOptions::new().compression(None);
    let forms = [
        plain(),
        plain().use_chunks(false),
        plain()
            .emit_summary_records(false)
            .emit_summary_offsets(false),
        WriteOptions::new().compression(Some(Compression::Lz4)),
        WriteOptions::new().compression(Some(Compression::Zstd)),
    ];
    for options in forms {
        std::fs::write(&path, shuffled(options)).unwrap();
        let recording = Recording::open(&path).unwrap();
        assert_eq!((recording.start_ns(), recording.end_ns()), (10, 30));
        assert_eq!(recording.channels()[1].message_type, LASER_SCAN);

        let mut wanted: Vec<(u64, usize)> = LOG_TIMES
            .into_iter()
            .enumerate()
            .map(|(place, time)| (time, place))
            .collect();
        wanted.retain(|(_, place)| place % 3 != 2);
        wanted.sort_unstable();
        let got: Vec<(u64, usize)> = recording
            .messages(&["/a", "/b"])
            .unwrap()
            .map(|message| message.unwrap())
            .map(|message| (message.log_time_ns, usize::from(message.payload[0])))
            .collect();
        assert_eq!(got, wanted);
    }
}

const LASER_SCAN: &str = "sensor_msgs/msg/LaserScan";

#[test]
fn every_spelling_of_a_type_is_the_same_type() {
    let spellings = [
        LASER_SCAN,
        "sensor_msgs/LaserScan",
        "sensor_msgs::msg::LaserScan",
        "sensor_msgs::msg::dds_::LaserScan_",
    ];
    for name in spellings {
        assert_eq!(normalised_type(name), LASER_SCAN);
    }
    assert_eq!(normalised_type(""), "");
    assert_eq!(normalised_type("plain"), "plain");
}
