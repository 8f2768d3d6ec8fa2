//! Readers of what comes from outside: each takes any bytes, and may refuse them but not panic.

use std::path::Path;

use fleetcal_config::Config;
use fleetcal_description::Description;
use fleetcal_domain::access::TokenValue;
use fleetcal_link::LinkSetup;
use fleetcal_proto::calibration::{Applied, ConfirmationDocument, Confirmed, Envelope};
use fleetcal_proto::certificate::CertificateDocument;
use fleetcal_proto::key_change::{KeyAnnouncement, KeyChangeDocument, KeyChanges};
use fleetcal_proto::offer::{OfferDocument, Offered, Question};
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
    /// Reads an input, and returns whether it was taken; `scratch` is a folder for files.
    pub read: fn(input: &[u8], scratch: &Path) -> bool,
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
        read: |input, _| Config::parse(&String::from_utf8_lossy(input)).is_ok(),
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
fn messages(input: &[u8], json: bool) -> bool {
    fn read<M: RosMessage>(input: &[u8], json: bool) -> bool {
        if json {
            return serde_json::from_slice::<M>(input).is_ok();
        }
        let message = M::from_cdr(input);
        if let Ok(message) = &message {
            // What was taken can be written, and read again.
            assert!(M::from_cdr(&message.to_cdr()).is_ok(), "{}", M::TYPE);
        }
        message.is_ok()
    }
    let applied = json && serde_json::from_slice::<Applied>(input).is_ok();
    let read = [
        read::<AckermannDriveStamped>,
        read::<Float64>,
        read::<JointState>,
        read::<LaserScan>,
        read::<Odometry>,
        read::<PointCloud2>,
        read::<PoseStamped>,
        read::<StringMessage>,
        read::<TfMessage>,
        read::<TwistStamped>,
    ];
    read.map(|read| read(input, json)).contains(&true) || applied
}

fn cloud(input: &[u8]) -> bool {
    let Ok(cloud) = PointCloud2::from_cdr(input) else {
        return false;
    };
    if cloud.check_layout().is_err() {
        return false;
    }
    let columns = ["x", "y", "z", "intensity", "time", "t"].map(|name| cloud.column(name));
    for point in cloud.points().take(MESSAGES_MAX) {
        for column in columns.iter().flatten() {
            column.read(point);
        }
    }
    true
}

fn recording(input: &[u8], path: &Path) -> bool {
    if std::fs::write(path, input).is_err() {
        return false;
    }
    let Ok(recording) = Recording::open(path) else {
        return false;
    };
    let channels = recording.channels().iter();
    let topics: Vec<&str> = channels.map(|channel| &*channel.topic).collect();
    let Ok(messages) = recording.messages(&topics) else {
        return false;
    };
    // One that fails is the last.
    let messages = messages.take(MESSAGES_MAX).flatten();
    let taken = messages.filter(|message| self::messages(&message.payload, false));
    taken.count() > 0
}

fn keys(input: &[u8]) -> bool {
    let text = String::from_utf8_lossy(input);
    let key = Keys::default().parse(&text);
    if let Ok(key) = &key {
        assert!(!format!("{key:?}").is_empty());
    }
    if let Ok(robot) = RobotId::parse(&text) {
        assert_eq!(robot.as_str(), text);
    }
    let public = text.parse::<PublicKey>();
    if let Ok(public) = &public {
        assert_eq!(public.to_string().parse().as_ref(), Ok(public));
    }
    [
        key.is_ok(),
        public.is_ok(),
        ros2_key::TopicKey::parse(&text).message_type().is_some(),
        ros2_key::Announcement::of_token(&text).is_some(),
        ros2_key::KeyTemplate::parse(&text).is_ok(),
        endpoint::parse(&text).is_ok(),
        TokenValue::parse(&text).is_some(),
        Question::parse(&text).is_ok(),
    ]
    .contains(&true)
}

/// Opens a signed text. Whatever was damaged: nothing but the undamaged ones may open.
fn signed(input: &[u8]) -> bool {
    let trusted = TrustedKeys::from(SigningKey::from_bytes(&[7; 32]).public_key());
    let genuine = seeds::genuine();
    let opens = |envelope: &Envelope| {
        let opened = envelope.open(&trusted).is_ok()
            || envelope.open_as::<OfferDocument>(&trusted).is_ok()
            || envelope.open_as::<ConfirmationDocument>(&trusted).is_ok()
            || envelope.open_as::<CertificateDocument>(&trusted).is_ok()
            || envelope.open_as::<KeyChangeDocument>(&trusted).is_ok();
        assert!(
            !opened || genuine.contains(&envelope.document),
            "a forgery opens"
        );
        opened
    };
    let envelope = Envelope::from_json(input).is_ok_and(|envelope| {
        drop(KeyChanges::check(vec![envelope.clone()]));
        opens(&envelope)
    });
    let offered = Offered::from_json(input).is_ok_and(|offered| {
        let offer = offered.offer.as_ref().is_some_and(opens);
        opens(&offered.envelope) || offer
    });
    let confirmed = serde_json::from_slice::<Confirmed>(input);
    let confirmed = confirmed.is_ok_and(|one| one.signed.as_ref().is_some_and(opens));
    let announced = serde_json::from_slice::<KeyAnnouncement>(input);
    let announced = announced.is_ok_and(|one| one.key_changes.iter().any(&opens));
    envelope || offered || confirmed || announced
}

fn zenoh_configuration(input: &[u8], scratch: &Path) -> bool {
    let path = scratch.join("zenoh.json5");
    if std::fs::write(&path, input).is_err() {
        return false;
    }
    let setup = LinkSetup {
        zenoh_config: Some(path),
        ..LinkSetup::default()
    };
    setup.check().is_ok()
}

fn description(input: &[u8]) -> bool {
    let mut description = Description::default();
    let taken = description
        .set_urdf(&String::from_utf8_lossy(input))
        .is_ok();
    if taken {
        drop(description.propose(None));
    }
    taken
}

fn restore(input: &[u8], scratch: &Path) -> bool {
    let (backup, data) = (scratch.join("backup.db"), scratch.join("data"));
    std::fs::remove_dir_all(&data).ok();
    if std::fs::write(&backup, input).is_err() {
        return false;
    }
    let runtime = tokio::runtime::Builder::new_current_thread()
        .enable_all()
        .build();
    let restored = |runtime: tokio::runtime::Runtime| {
        runtime.block_on(fleetcal_sqlite::restore(&backup, None, &data))
    };
    runtime.is_ok_and(|runtime| restored(runtime).is_ok())
}
