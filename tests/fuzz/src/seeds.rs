//! Undamaged inputs, small ones: made here, or kept in `corpus`.

use std::sync::{Arc, OnceLock};

use fleetcal_clock::SystemClock;
use fleetcal_model::{Generation, RevisionId, WallTime};
use fleetcal_proto::calibration::{
    Applied, AppliedStatus, CalibrationDocument, CalibrationFrame, CalibrationSchema,
    CalibrationValues, ConfirmationDocument, Confirmed, Envelope,
};
use fleetcal_proto::key_change::{KeyAnnouncement, KeyChanges};
use fleetcal_proto::offer::{OfferDocument, OfferSchema, Offered};
use fleetcal_proto::ros::{
    AckermannDriveStamped, Float64, Header, JointState, Odometry, PointCloud2, PointDatatype,
    PointField, PoseStamped, StringMessage, TfMessage, TransformStamped, TwistStamped,
};
use fleetcal_proto::signing::{SigningKey, seal, sign};
use fleetcal_proto::{RobotId, RosMessage};
use fleetcal_robot::fleet::{record, simulated_robots, urdf};

fn header() -> Header {
    Header {
        frame_id: "laser".to_owned(),
        ..Header::default()
    }
}

fn joints() -> JointState {
    JointState {
        header: header(),
        name: vec!["left".to_owned(), "steer".to_owned()],
        position: vec![0.1, 0.2],
        velocity: vec![1.0, 0.0],
        effort: Vec::new(),
    }
}

fn transforms() -> TfMessage {
    let transform = TransformStamped {
        header: header(),
        child_frame_id: "base_link".to_owned(),
        ..TransformStamped::default()
    };
    TfMessage {
        transforms: vec![transform.clone(), transform],
    }
}

/// Makes a cloud of two points, with fields of these types.
fn cloud(types: &[PointDatatype]) -> PointCloud2 {
    let names = ["x", "y", "z", "intensity", "time"];
    let mut offset = 0;
    let fields = names.iter().zip(types.iter().cycle());
    let fields = fields
        .map(|(name, &datatype)| {
            let field = PointField {
                name: (*name).to_owned(),
                offset,
                datatype,
                count: 1,
            };
            offset += datatype.bytes() as u32;
            field
        })
        .collect();
    PointCloud2 {
        header: header(),
        height: 1,
        width: 2,
        fields,
        is_bigendian: false,
        point_step: offset,
        row_step: 2 * offset,
        data: vec![1; 2 * offset as usize].into(),
        is_dense: true,
    }
}

/// Point clouds in CDR.
pub fn clouds() -> Vec<Vec<u8>> {
    use PointDatatype::{Float32, Float64, Int8, Uint16, Uint32};
    let types: [&[PointDatatype]; 3] = [&[Float32], &[Float64, Uint32], &[Int8, Uint16, Float32]];
    types.iter().map(|types| cloud(types).to_cdr()).collect()
}

/// A message of each type in CDR.
pub fn messages_cdr() -> Vec<Vec<u8>> {
    let text = StringMessage {
        data: "<robot name=\"a\"/>".to_owned(),
    };
    let mut all = clouds();
    all.extend([
        AckermannDriveStamped::default().to_cdr(),
        Float64::default().to_cdr(),
        joints().to_cdr(),
        Odometry::default().to_cdr(),
        PoseStamped::default().to_cdr(),
        text.to_cdr(),
        transforms().to_cdr(),
        TwistStamped::default().to_cdr(),
        scan(),
    ]);
    all
}

/// Makes a scan of three beams in CDR: header, seven numbers, two sequences.
fn scan() -> Vec<u8> {
    let mut bytes = vec![0, 1, 0, 0];
    bytes.extend([0; 8]);
    bytes.extend([6, 0, 0, 0]);
    bytes.extend(*b"laser\0\0\0");
    for number in [-1.0_f32, 1.0, 1.0, 0.0, 0.1, 0.1, 30.0] {
        bytes.extend(number.to_le_bytes());
    }
    for _ in 0..2 {
        bytes.extend([3, 0, 0, 0]);
        bytes.extend([1.0_f32, 2.0, 3.0].map(f32::to_le_bytes).concat());
    }
    bytes
}

/// Messages in JSON.
pub fn messages_json() -> Vec<Vec<u8>> {
    let json = [
        serde_json::to_vec(&AckermannDriveStamped::default()),
        serde_json::to_vec(&joints()),
        serde_json::to_vec(&Odometry::default()),
        serde_json::to_vec(&cloud(&[PointDatatype::Float32])),
        serde_json::to_vec(&transforms()),
        serde_json::to_vec(&TwistStamped::default()),
        serde_json::to_vec(&applied()),
    ];
    json.into_iter().flatten().collect()
}

/// Recordings as MCAP files.
pub fn recordings() -> Vec<Vec<u8>> {
    static MADE: OnceLock<Vec<Vec<u8>>> = OnceLock::new();
    let make = || {
        let folder = tempfile::tempdir().ok()?;
        let path = folder.path().join("robot.mcap");
        let robot = simulated_robots(1, 7).ok()?.into_iter().next()?;
        record(&robot, 0.3, &path).ok()?;
        std::fs::read(&path).ok()
    };
    MADE.get_or_init(|| make().into_iter().collect()).clone()
}

/// Recordings as rosbag2's SQLite files.
pub fn bags() -> Vec<Vec<u8>> {
    vec![include_bytes!("../corpus/bag/two_messages.db3").to_vec()]
}

/// Key expressions, ids, endpoints, tokens, public keys.
pub fn keys() -> Vec<Vec<u8>> {
    let public = SigningKey::from_bytes(&[7; 32]).public_key().to_string();
    let token = format!("cal_{}", "0123456789abcdef".repeat(4));
    let texts = [
        "fleet/tugger_01/scan",
        "fleet/tugger_01/calibration/approved",
        "fleet/@alive/tugger_01",
        "fleet/@service/a1",
        "0/jazzy_01/scan/sensor_msgs::msg::dds_::LaserScan_/RIHS01_64c191398013af96509d518dac71d5164f9382553fce5c1f8cca5be7924bd828",
        "@ros2_lv/0/aa/1/2/MP/%/%jazzy_01/node/%jazzy_01%scan/sensor_msgs::msg::dds_::LaserScan_/RIHS01_64c1/::,10:,:,:,,",
        "@/aa/@ros2_lv/MP/jazzy_01§scan/sensor_msgs§msg§LaserScan/:::",
        "{robot}/{topic}",
        "tcp/127.0.0.1:7447#iface=lo",
        "quic/[::1]:7447",
        "00112233445566778899aabbccddeeff",
        &public,
        &token,
    ];
    texts.iter().map(|text| text.as_bytes().to_vec()).collect()
}

fn robot() -> Option<RobotId> {
    RobotId::parse("tugger_01").ok()
}

fn applied() -> Applied {
    Applied {
        generation: Generation(4),
        sha256: "00".repeat(32),
        status: AppliedStatus::Applied,
        reason: Some("because".to_owned()),
        applied_at_ns: fleetcal_model::RobotTime(1),
        values: Some(CalibrationValues::default()),
    }
}

/// The signed texts that are damaged: a calibration, its offer, a confirmation, a change of key.
fn envelopes() -> Option<[Envelope; 4]> {
    let key = SigningKey::from_bytes(&[7; 32]);
    let document = CalibrationDocument {
        schema: CalibrationSchema::V1,
        robot: robot()?,
        generation: Generation(4),
        base_generation: Some(Generation(3)),
        revision: RevisionId(17),
        approved_at: "2026-11-21T12:00:00Z".to_owned(),
        approved_by: "ana".to_owned(),
        values: CalibrationValues::default(),
        sigmas: CalibrationValues::default(),
        covariance: None,
        steering_table: None,
        frame: CalibrationFrame::RearAxle,
        confirm_within_s: 600,
        rear_axle_in_base_link: None,
        lidar_in_base_link: None,
    };
    let calibration = seal(&document, &key).ok()?;
    let offer = OfferDocument {
        schema: OfferSchema::V1,
        robot: robot()?,
        generation: document.generation,
        sha256: calibration.sha256.clone(),
        offered_at_ns: WallTime(5),
        valid_until_ns: WallTime(3_600_000_000_005),
        question: None,
    };
    let confirmation = ConfirmationDocument::of(robot()?, &applied());
    let mut changes = KeyChanges::default();
    let new = SigningKey::from_bytes(&[8; 32]).public_key();
    changes.add(&key, &new, WallTime(1), 60).ok()?;
    let change = changes.envelopes().into_iter().next()?;
    let [offer, confirmation] = [sign(&offer, &key).ok()?, sign(&confirmation, &key).ok()?];
    Some([calibration, offer, confirmation, change])
}

/// The texts that the key of these tests has signed.
pub fn genuine() -> &'static [String] {
    static MADE: OnceLock<Vec<String>> = OnceLock::new();
    MADE.get_or_init(|| {
        let all = envelopes().into_iter().flatten();
        all.map(|envelope| envelope.document).collect()
    })
}

/// Signed messages as they travel.
pub fn signed() -> Vec<Vec<u8>> {
    let Some([calibration, offer, confirmation, change]) = envelopes() else {
        return Vec::new();
    };
    let offered = Offered {
        envelope: calibration.clone(),
        offer: Some(offer.clone()),
    };
    let confirmed = Confirmed {
        generation: Generation(4),
        sha256: calibration.sha256.clone(),
        signed: Some(confirmation.clone()),
    };
    let announcement = KeyAnnouncement {
        key_changes: vec![change.clone()],
    };
    let mut all: Vec<Vec<u8>> = [calibration, offer, confirmation, change]
        .iter()
        .flat_map(serde_json::to_vec)
        .collect();
    all.extend(serde_json::to_vec(&offered).ok());
    all.extend(serde_json::to_vec(&confirmed).ok());
    all.extend(serde_json::to_vec(&announcement).ok());
    all
}

/// Configurations of the service.
pub fn configurations() -> Vec<Vec<u8>> {
    let texts = [
        include_str!("../../../fleetcal.example.toml"),
        include_str!("../../../packaging/fleetcal.toml"),
        include_str!("../../../examples/deploy/cluster/fleetcal.toml"),
    ];
    texts.iter().map(|text| text.as_bytes().to_vec()).collect()
}

/// Configurations of Zenoh.
pub fn zenoh_configurations() -> Vec<Vec<u8>> {
    vec![include_bytes!("../../../examples/deploy/cluster/service.json5").to_vec()]
}

/// Descriptions of robots.
pub fn urdfs() -> Vec<Vec<u8>> {
    let robots = simulated_robots(3, 1).unwrap_or_default();
    robots
        .iter()
        .map(|robot| urdf(robot).into_bytes())
        .collect()
}

/// Backups of a database.
pub fn backups() -> Vec<Vec<u8>> {
    static MADE: OnceLock<Vec<Vec<u8>>> = OnceLock::new();
    let make = || {
        let folder = tempfile::tempdir().ok()?;
        let [data, to] = ["data", "backup.db"].map(|name| folder.path().join(name));
        let runtime = tokio::runtime::Builder::new_current_thread()
            .enable_all()
            .build()
            .ok()?;
        runtime.block_on(async {
            let clock = Arc::new(SystemClock::start());
            let store = fleetcal_sqlite::open(&data, clock).await.ok()?;
            store.close().await.ok()?;
            fleetcal_sqlite::backup(&data, &to).await.ok()
        })?;
        std::fs::read(&to).ok()
    };
    MADE.get_or_init(|| make().into_iter().collect()).clone()
}
