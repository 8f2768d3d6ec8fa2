//! Databases of earlier versions.

use fleetcal_model::{DeploymentId, Generation, ProposalId, RevisionId, Version, WallTime};
use fleetcal_proto::calibration::CalibrationValues;

use super::durability::raw;
use super::*;
use fleetcal_contract::NS;
use fleetcal_domain::approval::{
    Deployment, DeploymentState, Evidence, GenerationRef, Origin, Revision, Shadow,
};
use fleetcal_domain::robot::WheelOdometrySignal;
use fleetcal_domain::streams::Ros2Settings;
use fleetcal_model::RobotTime;
use fleetcal_store::CheckpointRecord;

/// Migration that makes checkpoints bytes.
const CHECKPOINT_BYTES: i64 = 20_261_123_100_000;
/// Migration that renames wheel odometry.
const WHEEL_ODOMETRY: i64 = 20_261_122_230_000;
/// Migration that adds the person who chose the values to older records.
const CHOSEN_BY: i64 = 20_261_122_140_000;

fn offer(generation: Generation) -> GenerationRef {
    GenerationRef {
        generation,
        sha256: "ab".repeat(32),
        revision: RevisionId(1),
        chosen_by: None,
    }
}

/// Makes an ended deployment of a robot that should hold generation 2.
fn deployment(id: u64, name: &str, approved_by: &str, proposal: Option<ProposalId>) -> Deployment {
    Deployment {
        id: DeploymentId(id),
        robot: robot(name),
        version: Version(4),
        state: if proposal.is_some() {
            DeploymentState::RolledBack
        } else {
            DeploymentState::Verified
        },
        proposal,
        approved_by: approved_by.to_owned(),
        offer: offer(Generation(2)),
        earlier: proposal.map(|_| offer(Generation(1))).into_iter().collect(),
        base: None,
        desired_before: None,
        created_ns: WallTime(NOW_S * NS),
        expires_ns: WallTime(NOW_S * NS),
        offered_ns: None,
        applied_ns: None,
        closed_ns: Some(WallTime(NOW_S * NS)),
        verification: None,
        reason: Some("it weaves".to_owned()),
        roll_back: None,
    }
}

/// Returns the records of a robot with this deployment, and their tables.
fn records_of(deployment: &Deployment) -> [(&'static str, String); 4] {
    let robot = deployment.robot.clone();
    let values = (CalibrationValues::default(), CalibrationValues::default());
    let found = Evidence::default();
    let revision = Revision::new(
        RevisionId(1),
        robot.clone(),
        Origin::Robot,
        values,
        found,
        None,
        WallTime(0),
    );
    let shadow = Shadow {
        generation_last: Generation(2),
        desired: Some(offer(Generation(2))),
        ..Shadow::new(robot)
    };
    [
        (
            "INSERT INTO revision (id, record) VALUES (1, ?1)",
            json(&revision),
        ),
        (
            "INSERT INTO proposal (id, record) VALUES (1, ?1)",
            r#"{"robot": "a", "state": "approved", "revision": 1}"#.to_owned(),
        ),
        (
            "INSERT INTO shadow (robot, record) VALUES ('a', ?1)",
            json(&shadow),
        ),
        (
            "INSERT INTO deployment (id, record) VALUES (1, ?1)",
            json(deployment),
        ),
    ]
}

/// Returns the person who chose a robot's values, after the database was migrated.
async fn chosen_by(
    deployment: &Deployment,
    rolled_back_by: Option<(&str, &str)>,
) -> Option<String> {
    let folder = tempfile::tempdir().unwrap();
    let clock = clock();
    open(folder.path(), &clock).await.close().await.unwrap();
    let mut raw = raw(folder.path()).await;
    for (sql, record) in records_of(deployment) {
        sqlx::query(sql)
            .bind(record)
            .execute(&mut raw)
            .await
            .unwrap();
    }
    if let Some((actor, authentication)) = rolled_back_by {
        sqlx::query(
            "INSERT INTO audit (at_ns, actor, authentication, action, subject, subject_id)
             VALUES (1, ?1, ?2, 'deployment.roll_back', 'deployment', '1')",
        )
        .bind(actor)
        .bind(authentication)
        .execute(&mut raw)
        .await
        .unwrap();
    }
    forget_migrations(&mut raw, CHOSEN_BY).await;
    // What later migrations have made is not there in a database of that time.
    sqlx::query("ALTER TABLE audit DROP COLUMN address")
        .execute(&mut raw)
        .await
        .unwrap();
    drop(raw);
    let store = open(folder.path(), &clock).await;
    let ledgers = store.load_ledgers().await.unwrap();
    let desired = ledgers.into_iter().next().unwrap().shadow.desired;
    store.close().await.unwrap();
    desired.unwrap().chosen_by
}

fn json(record: &impl serde::Serialize) -> String {
    serde_json::to_string(record).unwrap()
}

#[tokio::test]
async fn what_people_rolled_back_to_before_records_said_so_is_theirs() {
    let returned = deployment(1, "a", "ana", None);
    assert_eq!(chosen_by(&returned, None).await.as_deref(), Some("ana"));
    let rolled_back = deployment(1, "a", "ada", Some(ProposalId(1)));
    let by_person = chosen_by(&rolled_back, Some(("ana", "session"))).await;
    assert_eq!(by_person.as_deref(), Some("ana"));
    let by_service = chosen_by(&rolled_back, Some(("fleetcal", "service"))).await;
    assert_eq!(by_service, None);
}

/// Makes a database appear without the migrations from this one on, and removes the additions of
/// the latest of them.
async fn forget_migrations(raw: &mut sqlx::SqliteConnection, from: i64) {
    sqlx::query("DELETE FROM _sqlx_migrations WHERE version >= ?1")
        .bind(from)
        .execute(&mut *raw)
        .await
        .unwrap();
    for added in [
        "DROP TABLE rollout_robot",
        "DROP TABLE rollout",
        "DROP TABLE setup_code",
        "DROP TABLE certificate",
        "ALTER TABLE robot DROP COLUMN drawn_by",
        "ALTER TABLE audit DROP COLUMN link",
    ] {
        sqlx::query(added).execute(&mut *raw).await.unwrap();
    }
}

/// Writes robots in the form of earlier versions, by id and further keys of their configurations,
/// and one unregistered robot.
async fn write_former_robots(folder: &Path, robots: &[(&str, &str)]) {
    let mut raw = raw(folder).await;
    for (id, more) in robots {
        sqlx::query(
            "INSERT INTO robot (id, config, version, created_ns, updated_ns)
             VALUES (?1, ?2, 3, 0, 0)",
        )
        .bind(id)
        .bind(format!(
            r#"{{"model": "bicycle", "wheelbase_m": 1.2, {more}}}"#
        ))
        .execute(&mut raw)
        .await
        .unwrap();
    }
    sqlx::query("INSERT INTO robot (id, created_ns, updated_ns) VALUES ('unregistered', 0, 0)")
        .execute(&mut raw)
        .await
        .unwrap();
    forget_migrations(&mut raw, WHEEL_ODOMETRY).await;
}

#[tokio::test]
async fn stored_robots_keep_the_topics_that_they_had() {
    let folder = tempfile::tempdir().unwrap();
    let clock = clock();
    open(folder.path(), &clock).await.close().await.unwrap();
    let compensated = r#""drive": "compensated", "streams": {"drive": {"topic": "ackermann"}}"#;
    let apart =
        r#""drive": "raw", "streams": {"steering": {"topic": "s"}, "speed": {"topic": "v"}}"#;
    let lidar_named = r#""drive": "raw", "streams": {"scan": {"topic": "front/scan"}}"#;
    let robots = [
        ("usual", r#""drive": "raw""#),
        ("lidar_named", lidar_named),
        ("named", compensated),
        ("apart", apart),
    ];
    write_former_robots(folder.path(), &robots).await;
    let store = open(folder.path(), &clock).await;
    let expect = async |id: &str, signal: WheelOdometrySignal, expected: &[&str]| {
        let record = store.load_robot(&robot(id)).await.unwrap().unwrap();
        let config = record.config.unwrap();
        assert_eq!(config.wheel_odometry, signal, "{id}");
        let roles = config.streams.roles(&Ros2Settings::default());
        let topics = roles.into_iter().map(|role| String::from(role.topic));
        assert_eq!(topics.collect::<Vec<_>>(), expected, "{id}");
    };
    let raw_signal = WheelOdometrySignal::Raw;
    let usual = ["drive", "scan", "lidar_odometry"];
    expect("usual", raw_signal, &usual).await;
    expect("lidar_named", raw_signal, &["front/scan", "drive"]).await;
    let named = ["ackermann", "scan", "lidar_odometry"];
    expect("named", WheelOdometrySignal::Compensated, &named).await;
    let apart = ["s", "v", "scan", "lidar_odometry"];
    expect("apart", raw_signal, &apart).await;
    let unregistered = store.load_robot(&robot("unregistered")).await.unwrap();
    assert_eq!(unregistered.unwrap().config, None);
    store.close().await.unwrap();
}

#[tokio::test]
async fn a_checkpoint_of_json_text_is_kept_to_the_byte() {
    let folder = tempfile::tempdir().unwrap();
    let clock = clock();
    let store = open(folder.path(), &clock).await;
    store.save_checkpoint(&robot("a"), RobotTime(7), vec![0]);
    store.close().await.unwrap();
    drop(store);
    let text = r#"{"calibrator": {"session": 0.1, "note": "Prüfung"}}"#;
    let mut raw = raw(folder.path()).await;
    for sql in [
        "DROP TABLE checkpoint",
        "CREATE TABLE checkpoint (
            robot INTEGER PRIMARY KEY REFERENCES robot (key),
            stamp_ns INTEGER NOT NULL,
            received_ns INTEGER NOT NULL,
            state TEXT NOT NULL CHECK (json_valid(state))
        ) STRICT",
    ] {
        sqlx::query(sql).execute(&mut raw).await.unwrap();
    }
    sqlx::query("INSERT INTO checkpoint SELECT key, 8, 9, ?1 FROM robot WHERE id = 'a'")
        .bind(text)
        .execute(&mut raw)
        .await
        .unwrap();
    forget_migrations(&mut raw, CHECKPOINT_BYTES).await;
    drop(raw);
    let store = open(folder.path(), &clock).await;
    let kept = store.load_checkpoints().await.unwrap();
    let expected = CheckpointRecord {
        robot: robot("a"),
        stamp_ns: RobotTime(8),
        received_ns: WallTime(9),
        state: text.as_bytes().to_vec(),
    };
    assert_eq!(kept, [expected]);
    let state = vec![2, 0, 0xff];
    store.save_checkpoint(&robot("a"), RobotTime(9), state.clone());
    store.close().await.unwrap();
    drop(store);
    let store = open(folder.path(), &clock).await;
    let replaced = store.load_checkpoints().await.unwrap();
    assert_eq!(replaced.first().map(|one| &one.state), Some(&state));
    store.close().await.unwrap();
}
