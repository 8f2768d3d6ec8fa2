//! Simulated robots against a real Zenoh router in this process.

use std::collections::BTreeMap;
use std::num::NonZeroU32;
use std::sync::{Arc, Mutex};
use std::time::Duration;

use fleetcal_model::{Generation, RevisionId, WallTime};
use fleetcal_patience::until;
use fleetcal_ports::free_address;
use fleetcal_proto::calibration::{
    Applied as Acknowledgement, AppliedStatus, CalibrationDocument, CalibrationFrame,
    CalibrationSchema, CalibrationValues, ConfirmationDocument, Confirmed, Envelope,
};
use fleetcal_proto::event::CrossTrackError;
use fleetcal_proto::offer::{OfferDocument, OfferSchema, Offered, Question};
use fleetcal_proto::ros::{DriveSamples, LaserScan};
use fleetcal_proto::signing::{SigningKey, seal, sign};
use fleetcal_proto::{Encoding, Keys, RosMessage};
use zenoh::sample::SampleKind;

use super::*;
use crate::simulator::{LidarOutput, LidarSettings, PoseSettings};

const START_NS: i64 = 1_760_000_000_000_000_000;

/// Opens a router on a free port of the loopback.
async fn router() -> (zenoh::Session, String) {
    let endpoint = format!("tcp/{}", free_address());
    let mut config = zenoh::Config::default();
    for (key, value) in [
        ("mode", "\"router\"".to_owned()),
        ("listen/endpoints", format!("[\"{endpoint}\"]")),
        ("scouting/multicast/enabled", "false".to_owned()),
        ("scouting/gossip/enabled", "false".to_owned()),
    ] {
        config.insert_json5(key, &value).unwrap();
    }
    (zenoh::open(config).await.unwrap(), endpoint)
}

fn options(count: usize, endpoint: &str) -> FleetOptions {
    FleetOptions {
        robots: simulated_robots(count, 1).unwrap(),
        connect: vec![endpoint.to_owned()].into(),
        keys: Keys::default(),
        trusted: Some(key().public_key().into()),
        start_stamp_ns: START_NS,
        rate: NonZeroU32::MIN,
        drive_messages: DriveMessages::default(),
    }
}

type Payloads = Arc<Mutex<BTreeMap<String, Vec<Vec<u8>>>>>;

/// Collects all messages under a key expression, by key.
async fn collect(session: &zenoh::Session, key: &str, encoding: Encoding) -> Payloads {
    let payloads = Payloads::default();
    let into = Arc::clone(&payloads);
    session
        .declare_subscriber(key.to_owned())
        .callback(move |sample| {
            let found = sample.encoding().to_string();
            let found = found.split(';').next();
            assert_eq!(found, Some(encoding.as_str()));
            let key = sample.key_expr().as_str().to_owned();
            let payload = sample.payload().to_bytes().into_owned();
            into.lock().unwrap().entry(key).or_default().push(payload);
        })
        .background()
        .await
        .unwrap();
    payloads
}

fn key() -> SigningKey {
    SigningKey::from_bytes(&[3; 32])
}

/// Makes a signed calibration; generation 9 lies outside the robots' limits.
fn envelope(robot: &str, generation: Generation, confirm_within_s: u32) -> Envelope {
    let values = CalibrationValues {
        steering_offset_rad: if generation == Generation(9) {
            0.5
        } else {
            0.02
        },
        lidar_x_m: 0.44,
        lidar_y_m: 0.01,
        lidar_yaw_rad: 0.02,
        ..CalibrationValues::default()
    };
    envelope_of(values, robot, generation, confirm_within_s)
}

fn envelope_of(
    values: CalibrationValues,
    robot: &str,
    generation: Generation,
    confirm_within_s: u32,
) -> Envelope {
    let document = CalibrationDocument {
        schema: CalibrationSchema::V1,
        robot: RobotId::parse(robot).unwrap(),
        generation,
        base_generation: Some(Generation(generation.0 - 1)),
        revision: RevisionId(1),
        approved_at: "2026-01-01T00:00:00Z".to_owned(),
        approved_by: "ana".to_owned(),
        values,
        sigmas: values,
        covariance: None,
        steering_table: None,
        frame: CalibrationFrame::RearAxle,
        confirm_within_s,
        rear_axle_in_base_link: None,
        lidar_in_base_link: None,
    };
    seal(&document, &key()).unwrap()
}

const APPROVED: &str = "fleet/tugger_01/calibration/approved";

/// Service's half of the approved calibration's key of `tugger_01`.
struct Approved {
    session: zenoh::Session,
    wanted: Arc<Mutex<Option<Envelope>>>,
}

impl Approved {
    async fn answering(session: &zenoh::Session) -> Self {
        let wanted: Arc<Mutex<Option<Envelope>>> = Arc::default();
        let stored = Arc::clone(&wanted);
        let answer = move |query: zenoh::query::Query| {
            let envelope = stored.lock().unwrap().clone();
            let Some(envelope) = envelope else { return };
            let question = query.payload().unwrap().try_to_string().unwrap();
            let document = envelope.open(&key().public_key().into()).unwrap();
            let offer = OfferDocument {
                schema: OfferSchema::V1,
                robot: document.robot,
                generation: document.generation,
                sha256: envelope.sha256.clone(),
                offered_at_ns: WallTime(0),
                valid_until_ns: WallTime(60_000_000_000),
                question: Question::parse(&question).ok(),
            };
            let offer = Some(sign(&offer, &key()).unwrap());
            let payload = serde_json::to_vec(&Offered { envelope, offer }).unwrap();
            zenoh::Wait::wait(query.reply(APPROVED, payload)).unwrap();
        };
        let answering = session.declare_queryable(APPROVED).callback(answer);
        answering.background().await.unwrap();
        Self {
            session: session.clone(),
            wanted,
        }
    }

    fn store(&self, envelope: &Envelope) {
        *self.wanted.lock().unwrap() = Some(envelope.clone());
    }

    async fn approve(&self, envelope: &Envelope) {
        self.store(envelope);
        let payload = serde_json::to_vec(envelope).unwrap();
        self.session.put(APPROVED, payload).await.unwrap();
    }
}

/// Beams of a scanner that no machine simulates at [`FAST`].
const MANY_BEAMS: u32 = 16_384;
/// Seconds of robots that are simulated too slowly, in one of real time.
const FAST: NonZeroU32 = NonZeroU32::new(100).unwrap();
/// Drive after which they still send what they measure now, ns.
const DRIVEN_NS: i64 = 200_000_000_000;

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_robot_that_is_too_slow_for_real_time_leaves_messages_out_and_goes_on() {
    let (session, endpoint) = router().await;
    let mut options = options(1, &endpoint);
    options.rate = FAST;
    for robot in &mut options.robots {
        robot.config.lidar = LidarOutput::Scans(LidarSettings {
            beams: MANY_BEAMS,
            ..LidarSettings::default()
        });
    }
    let received = collect(&session, "fleet/*/wheel_odometry", Encoding::Cdr).await;
    let stop = CancellationToken::new();
    let running = tokio::spawn(run_fleet(options, stop.clone()));
    let stamps = || -> Vec<i64> {
        let received = received.lock().unwrap();
        let payloads = received.values().flatten();
        let stamp = |payload: &Vec<u8>| {
            let message = DriveSamples::from_cdr(payload).unwrap();
            message.samples().last().unwrap().stamp.as_ns()
        };
        payloads.map(stamp).collect()
    };
    until("it drives on", || {
        let last = stamps().last().copied();
        last.is_some_and(|stamp_ns| stamp_ns - START_NS > DRIVEN_NS)
    })
    .await;
    stop.cancel();
    let summaries = running.await.unwrap().unwrap();
    assert!(summaries[0].late > 0, "nothing was left out: {summaries:?}");
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn robots_stream_drive_scan_and_cross_track_error() {
    let (session, endpoint) = router().await;
    let drives = collect(&session, "fleet/*/wheel_odometry", Encoding::Cdr).await;
    let scans = collect(&session, "fleet/*/scan", Encoding::Cdr).await;
    let errors = collect(&session, "fleet/*/cross_track_error", Encoding::Json).await;
    let stop = CancellationToken::new();
    let fleet = tokio::spawn(run_fleet(options(2, &endpoint), stop.clone()));
    let count = |payloads: &Payloads, robot: &str| {
        let key = format!("fleet/{robot}");
        let payloads = payloads.lock().unwrap();
        payloads
            .iter()
            .find(|(k, _)| k.starts_with(&key))
            .map_or(0, |(_, all)| all.len())
    };
    for robot in ["tugger_01", "tugger_02"] {
        until("each robot drove for two seconds", || {
            count(&drives, robot) > 20 && count(&errors, robot) > 1
        })
        .await;
    }
    stop.cancel();
    let summaries = fleet.await.unwrap().unwrap();
    until("the last messages are in", || {
        summaries
            .iter()
            .all(|s| count(&scans, s.id.as_str()) as u64 == s.scans)
    })
    .await;
    for summary in summaries {
        assert_eq!(summary.late, 0);
        let id = summary.id.as_str();
        let drives = drives.lock().unwrap()[&format!("fleet/{id}/wheel_odometry")].clone();
        let samples = drives
            .iter()
            .map(|payload| DriveSamples::from_cdr(payload).unwrap());
        let stamps: Vec<_> = samples
            .flat_map(|message| message.samples().to_vec())
            .map(|sample| sample.stamp.as_ns())
            .collect();
        assert_eq!(stamps.len() as u64, summary.drive_samples, "none lost");
        assert!(drives.len() < stamps.len() / 4, "{}", drives.len());
        assert!(
            stamps
                .windows(2)
                .all(|pair| pair[1] - pair[0] == 10_000_000)
        );
        assert!(stamps[0] > START_NS - 50_000_000 && stamps[0] < START_NS + 5_000_000_000);
        for payload in &scans.lock().unwrap()[&format!("fleet/{id}/scan")] {
            let scan = LaserScan::from_cdr(payload).unwrap();
            scan.check_beams().unwrap();
            assert_eq!(scan.ranges.len(), 1024);
            assert!((scan.time_increment - 0.1 / 1024.0).abs() < 1e-9);
            assert!(scan.ranges.iter().filter(|range| range.is_finite()).count() > 900);
        }
        let errors = errors.lock().unwrap()[&format!("fleet/{id}/cross_track_error")].clone();
        let error: CrossTrackError = serde_json::from_slice(&errors[0]).unwrap();
        assert!(error.value_m.abs() < 0.5);
    }
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_robot_pulls_applies_and_acknowledges_what_is_approved() {
    let (session, endpoint) = router().await;
    let answers = collect(&session, "fleet/*/calibration/applied", Encoding::Json).await;
    let approved = Approved::answering(&session).await;
    approved.store(&envelope("tugger_01", Generation(3), 600));
    let stop = CancellationToken::new();
    let fleet = tokio::spawn(run_fleet(options(1, &endpoint), stop.clone()));
    let answered = || -> Vec<Acknowledgement> {
        let answers = answers.lock().unwrap();
        let all = answers.values().flatten();
        all.map(|payload| serde_json::from_slice(payload).unwrap())
            .collect()
    };
    let applied = |generation| {
        answered().iter().any(|answer| {
            answer.generation == generation && answer.status == AppliedStatus::Applied
        })
    };
    until("the pulled calibration is applied", || {
        applied(Generation(3))
    })
    .await;
    let first = &answered()[0];
    assert_eq!(
        (first.generation, first.sha256.as_str()),
        (Generation(0), ""),
        "its factory calibration"
    );

    // Without a confirmation the robot goes back to where it was, which nobody confirmed either.
    let pushed = envelope("tugger_01", Generation(4), 1);
    approved.approve(&pushed).await;
    until("the pushed calibration is applied", || {
        applied(Generation(4))
    })
    .await;
    let ended = |generation, status| {
        let of = move |answer: &&Acknowledgement| {
            answer.generation == generation && answer.status == status
        };
        answered().iter().find(of).cloned()
    };
    let reverted = || ended(Generation(4), AppliedStatus::Reverted);
    until("it went back by itself", || reverted().is_some()).await;
    let values = reverted().unwrap().values.unwrap();
    assert!(
        values.steering_offset_rad.abs() < 1e-12,
        "its factory calibration"
    );

    let next = envelope("tugger_01", Generation(5), 2);
    approved.approve(&next).await;
    until("the next one is applied", || applied(Generation(5))).await;
    let said = ended(Generation(5), AppliedStatus::Applied).unwrap();
    let document = ConfirmationDocument::of(RobotId::parse("tugger_01").unwrap(), &said);
    let confirmation = Confirmed {
        generation: Generation(5),
        sha256: next.sha256,
        signed: Some(sign(&document, &key()).unwrap()),
    };
    let payload = serde_json::to_vec(&confirmation).unwrap();
    let confirmed_key = "fleet/tugger_01/calibration/confirmed";
    session.put(confirmed_key, payload).await.unwrap();

    for (envelope, generation, reason) in [
        (
            envelope("tugger_02", Generation(7), 600),
            7,
            "robot is tugger_02",
        ),
        (pushed, 4, "expected higher ones than 5"),
        (
            envelope("tugger_01", Generation(9), 600),
            9,
            "steering_offset_rad: got 0.5",
        ),
    ] {
        approved.approve(&envelope).await;
        let refused = || {
            let refused = AppliedStatus::Refused;
            let about = |answer: &&Acknowledgement| {
                answer.generation == Generation(generation) && answer.status == refused
            };
            let answers = answered();
            let reason_of = answers.iter().find(about)?.reason.clone();
            Some(reason_of.unwrap_or_default())
        };
        until("it is refused", || refused().is_some()).await;
        assert!(refused().unwrap().contains(reason), "{:?}", refused());
    }
    // Longer than it would have waited for the confirmation.
    tokio::time::sleep(Duration::from_millis(2500)).await;
    assert!(ended(Generation(5), AppliedStatus::Reverted).is_none());
    stop.cancel();
    assert_eq!(fleet.await.unwrap().unwrap()[0].generation, Generation(5));
}

/// Drives with one reading a second of its own time: some with the wrong steering zero, and as many
/// with the right one.
#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_robot_stops_weaving_once_its_true_calibration_is_approved() {
    const READINGS: usize = 12;
    /// Readings until the robot is on its way.
    const SETTLING: usize = 3;
    let (session, endpoint) = router().await;
    let payloads = collect(&session, "fleet/*/cross_track_error", Encoding::Json).await;
    let mut options = options(1, &endpoint);
    options.rate = NonZeroU32::new(8).unwrap();
    let config = &mut options.robots[0].config;
    config.vehicle.steering_offset_rad = 2.92_f64.to_radians();
    config.lidar = LidarOutput::Poses(PoseSettings::default());
    let truth = config.vehicle;
    let stop = CancellationToken::new();
    let fleet = tokio::spawn(run_fleet(options, stop.clone()));
    let errors_m = || -> Vec<f64> {
        let payloads = payloads.lock().unwrap();
        let read = |payload: &Vec<u8>| serde_json::from_slice::<CrossTrackError>(payload);
        let all = payloads.values().flatten();
        all.map(|payload| read(payload).unwrap().value_m).collect()
    };
    let rms_m = |errors: &[f64]| {
        let squares: f64 = errors.iter().map(|error| error * error).sum();
        (squares / errors.len() as f64).sqrt()
    };
    until("it drove with its factory calibration", || {
        errors_m().len() >= SETTLING + READINGS
    })
    .await;
    let wrong = errors_m().split_off(SETTLING);
    let mount = truth.lidar_in_base;
    let values = CalibrationValues {
        steering_offset_rad: truth.steering_offset_rad,
        lidar_x_m: mount.x_m,
        lidar_y_m: mount.y_m,
        lidar_yaw_rad: mount.yaw_rad,
        ..CalibrationValues::default()
    };
    let approved = Approved::answering(&session).await;
    let envelope = envelope_of(values, "tugger_01", Generation(1), 600);
    let answers = collect(&session, "fleet/*/calibration/applied", Encoding::Json).await;
    approved.approve(&envelope).await;
    let is_applied = |payload: &Vec<u8>| {
        let answer: Acknowledgement = serde_json::from_slice(payload).unwrap();
        answer.generation == Generation(1) && answer.status == AppliedStatus::Applied
    };
    until("it applied what was approved", || {
        answers.lock().unwrap().values().flatten().any(is_applied)
    })
    .await;
    let from = errors_m().len() + SETTLING;
    until("it drove with what was approved", || {
        errors_m().len() >= from + READINGS
    })
    .await;
    let right = errors_m().split_off(from);
    stop.cancel();
    assert_eq!(fleet.await.unwrap().unwrap()[0].generation, Generation(1));
    let (before_m, after_m) = (rms_m(&wrong), rms_m(&right));
    println!("cross-track error {before_m:.4} m before, {after_m:.4} m after");
    assert!(
        after_m < 0.5 * before_m,
        "{before_m} m before, {after_m} m after"
    );
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_robot_waits_for_its_router_shows_its_token_and_speaks_up_when_a_service_comes() {
    let endpoint = format!("tcp/{}", free_address());
    let stop = CancellationToken::new();
    let fleet = tokio::spawn(run_fleet(options(1, &endpoint), stop.clone()));
    tokio::time::sleep(Duration::from_millis(300)).await;
    let mut config = zenoh::Config::default();
    config.insert_json5("mode", "\"router\"").unwrap();
    config
        .insert_json5("listen/endpoints", &format!("[\"{endpoint}\"]"))
        .unwrap();
    config
        .insert_json5("scouting/multicast/enabled", "false")
        .unwrap();
    let session = zenoh::open(config).await.unwrap();
    let (seen, gone) = (Arc::new(Mutex::new(false)), Arc::new(Mutex::new(false)));
    let (into_seen, into_gone) = (Arc::clone(&seen), Arc::clone(&gone));
    session
        .liveliness()
        .declare_subscriber("fleet/@alive/tugger_01")
        .history(true)
        .callback(move |sample| match sample.kind() {
            SampleKind::Put => *into_seen.lock().unwrap() = true,
            SampleKind::Delete => *into_gone.lock().unwrap() = true,
        })
        .background()
        .await
        .unwrap();
    until("the robot's token is there", || *seen.lock().unwrap()).await;
    let answers = collect(&session, "fleet/*/calibration/applied", Encoding::Json).await;
    let _service = session
        .liveliness()
        .declare_token("fleet/@service/a1")
        .await
        .unwrap();
    until("the robot says what it uses", || {
        !answers.lock().unwrap().is_empty()
    })
    .await;
    stop.cancel();
    fleet.await.unwrap().unwrap();
    until("the token is gone", || *gone.lock().unwrap()).await;
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn an_endpoint_that_cannot_be_is_refused_with_its_name() {
    let options = options(1, "nonsense");
    let error = run_fleet(options, CancellationToken::new())
        .await
        .unwrap_err()
        .to_string();
    assert!(
        error.contains("connect/endpoints") && error.contains("nonsense"),
        "{error}"
    );
}

#[test]
fn robots_differ_and_a_smaller_fleet_is_the_start_of_a_larger_one() {
    let small = simulated_robots(6, 9).unwrap();
    let large = simulated_robots(50, 9).unwrap();
    for (a, b) in small.iter().zip(&large) {
        assert_eq!((&a.id, a.config.vehicle), (&b.id, b.config.vehicle));
    }
    for robot in &large {
        robot.config.check().unwrap();
        assert!(robot.config.vehicle.steering_offset_rad.abs() < 0.053);
        let (mount, nominal) = (robot.config.vehicle.lidar_in_base, robot.nominal());
        assert!(mount.point().distance_m(nominal.point()) < 0.06);
    }
    let offsets = large
        .iter()
        .map(|robot| robot.config.vehicle.steering_offset_rad.to_bits());
    assert_eq!(offsets.collect::<std::collections::BTreeSet<_>>().len(), 50);
    assert!(
        simulated_robots(501, 9)
            .unwrap_err()
            .to_string()
            .contains("501")
    );
}
