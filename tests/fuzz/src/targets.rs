//! Readers of what comes from outside: each takes any bytes, and may refuse them but not panic.

use std::path::Path;

use fleetcal_config::Config;
use fleetcal_description::Description;
use fleetcal_domain::access::TokenValue;
use fleetcal_link::LinkSetup;
use fleetcal_proto::calibration::{Applied, Confirmed, Envelope};
use fleetcal_proto::certificate::CertificateDocument;
use fleetcal_proto::key_change::{KeyAnnouncement, KeyChangeDocument, KeyChanges};
use fleetcal_proto::offer::{Offered, Question};
use fleetcal_proto::ros::{
    AckermannDriveStamped, Float64, JointState, LaserScan, Odometry, PointCloud2, PoseStamped,
    StringMessage, TfMessage, TwistStamped,
};
use fleetcal_proto::signing::{PublicKey, SigningKey, TrustedKeys};
use fleetcal_proto::{Keys, RobotId, RosMessage, endpoint, ros2_key};
use fleetcal_robot::recording::Recording;

use crate::seeds;

/// Most messages that are read of a recording.
const MESSAGES_MAX: usize = 10_000;

/// Reader under test, with the inputs that are damaged.
#[derive(Debug, Clone, Copy)]
pub struct Target {
    /// Its name, also that of its folder of found inputs.
    pub name: &'static str,
    /// Its undamaged inputs.
    pub seeds: fn() -> Vec<Vec<u8>>,
    /// Reads an input; `scratch` is a folder for files.
    pub read: fn(input: &[u8], scratch: &Path),
    /// Inputs in the tests' run, which lasts seconds.
    pub quick: u64,
}

/// All readers.
pub const TARGETS: [Target; 11] = [
    Target {
        name: "cdr",
        seeds: seeds::messages_cdr,
        read: |input, _| messages(input, false),
        quick: 20_000,
    },
    Target {
        name: "json",
        seeds: seeds::messages_json,
        read: |input, _| messages(input, true),
        quick: 10_000,
    },
    Target {
        name: "cloud",
        seeds: seeds::clouds,
        read: |input, _| cloud(input),
        quick: 10_000,
    },
    Target {
        name: "mcap",
        seeds: seeds::recordings,
        read: |input, scratch| recording(input, &scratch.join("input.mcap")),
        quick: 400,
    },
    Target {
        name: "bag",
        seeds: seeds::bags,
        read: |input, scratch| recording(input, &scratch.join("input.db3")),
        quick: 200,
    },
    Target {
        name: "keys",
        seeds: seeds::keys,
        read: |input, _| keys(input),
        quick: 20_000,
    },
    Target {
        name: "signed",
        seeds: seeds::signed,
        read: |input, _| signed(input),
        quick: 2_000,
    },
    Target {
        name: "toml",
        seeds: seeds::configurations,
        read: |input, _| drop(Config::parse(&String::from_utf8_lossy(input))),
        quick: 500,
    },
    Target {
        name: "json5",
        seeds: seeds::zenoh_configurations,
        read: zenoh_configuration,
        quick: 200,
    },
    Target {
        name: "urdf",
        seeds: seeds::urdfs,
        read: |input, _| description(input),
        quick: 1_000,
    },
    Target {
        name: "restore",
        seeds: seeds::backups,
        read: restore,
        quick: 60,
    },
];

/// Reads a message as one of each type.
fn messages(input: &[u8], json: bool) {
    fn read<M: RosMessage>(input: &[u8], json: bool) {
        if json {
            drop(serde_json::from_slice::<M>(input));
        } else if let Ok(message) = M::from_cdr(input) {
            // What was taken can be written, and read again.
            assert!(M::from_cdr(&message.to_cdr()).is_ok(), "{}", M::TYPE);
        }
    }
    read::<AckermannDriveStamped>(input, json);
    read::<Float64>(input, json);
    read::<JointState>(input, json);
    read::<LaserScan>(input, json);
    read::<Odometry>(input, json);
    read::<PointCloud2>(input, json);
    read::<PoseStamped>(input, json);
    read::<StringMessage>(input, json);
    read::<TfMessage>(input, json);
    read::<TwistStamped>(input, json);
    drop(serde_json::from_slice::<Applied>(input));
}

fn cloud(input: &[u8]) {
    let Ok(cloud) = PointCloud2::from_cdr(input) else {
        return;
    };
    if cloud.check_layout().is_err() {
        return;
    }
    let columns = ["x", "y", "z", "intensity", "time", "t"].map(|name| cloud.column(name));
    for point in cloud.points().take(MESSAGES_MAX) {
        for column in columns.iter().flatten() {
            column.read(point);
        }
    }
}

fn recording(input: &[u8], path: &Path) {
    if std::fs::write(path, input).is_err() {
        return;
    }
    let Ok(recording) = Recording::open(path) else {
        return;
    };
    let channels = recording.channels().iter();
    let topics: Vec<&str> = channels.map(|channel| &*channel.topic).collect();
    if let Ok(messages) = recording.messages(&topics) {
        // One that fails is the last.
        for message in messages.take(MESSAGES_MAX).flatten() {
            self::messages(&message.payload, false);
        }
    }
}

fn keys(input: &[u8]) {
    let text = String::from_utf8_lossy(input);
    if let Ok(key) = Keys::default().parse(&text) {
        assert!(!format!("{key:?}").is_empty());
    }
    if let Ok(robot) = RobotId::parse(&text) {
        assert_eq!(robot.as_str(), text);
    }
    let _known = ros2_key::TopicKey::parse(&text).message_type();
    drop(ros2_key::Announcement::of_token(&text));
    drop(ros2_key::KeyTemplate::parse(&text));
    drop(endpoint::parse(&text));
    drop(TokenValue::parse(&text));
    drop(Question::parse(&text));
    if let Ok(key) = text.parse::<PublicKey>() {
        assert_eq!(key.to_string().parse(), Ok(key));
    }
}

/// Opens a signed text. Whatever was damaged: nothing but the undamaged ones may open.
fn signed(input: &[u8]) {
    let trusted = TrustedKeys::from(SigningKey::from_bytes(&[7; 32]).public_key());
    let genuine = seeds::genuine();
    let is_genuine = |envelope: &Envelope| genuine.contains(&envelope.document);
    if let Ok(envelope) = Envelope::from_json(input) {
        let opened = envelope.open(&trusted).is_ok()
            || envelope.open_as::<CertificateDocument>(&trusted).is_ok()
            || envelope.open_as::<KeyChangeDocument>(&trusted).is_ok();
        assert!(!opened || is_genuine(&envelope), "a forgery opens");
        drop(KeyChanges::check(vec![envelope]));
    }
    if let Ok(offered) = Offered::from_json(input) {
        let opened = offered.envelope.open(&trusted).is_ok();
        assert!(!opened || is_genuine(&offered.envelope), "a forgery opens");
        drop(offered.open_offer(&trusted));
    }
    if let Ok(confirmed) = serde_json::from_slice::<Confirmed>(input) {
        drop(confirmed.open(&trusted));
    }
    drop(serde_json::from_slice::<KeyAnnouncement>(input));
}

fn zenoh_configuration(input: &[u8], scratch: &Path) {
    let path = scratch.join("zenoh.json5");
    if std::fs::write(&path, input).is_ok() {
        let setup = LinkSetup {
            zenoh_config: Some(path),
            ..LinkSetup::default()
        };
        drop(setup.check());
    }
}

fn description(input: &[u8]) {
    let mut description = Description::default();
    if description
        .set_urdf(&String::from_utf8_lossy(input))
        .is_ok()
    {
        drop(description.propose(None));
    }
}

fn restore(input: &[u8], scratch: &Path) {
    let (backup, data) = (scratch.join("backup.db"), scratch.join("data"));
    std::fs::remove_dir_all(&data).ok();
    if std::fs::write(&backup, input).is_err() {
        return;
    }
    let runtime = tokio::runtime::Builder::new_current_thread()
        .enable_all()
        .build();
    let Ok(runtime) = runtime else {
        return;
    };
    runtime.block_on(async {
        drop(fleetcal_sqlite::restore(&backup, None, &data).await);
    });
}
