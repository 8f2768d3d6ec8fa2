//! The whole loop with everything real but the robots' bodies: they weave because their steering
//! zero is off, the service finds that out, two people approve, the robots apply and prove it.

#![expect(
    clippy::unwrap_used,
    clippy::panic,
    clippy::print_stdout,
    reason = "a test that cannot go on fails, and prints its figures"
)]

use std::net::SocketAddr;
use std::num::NonZeroU32;
use std::sync::Arc;

use fleetcal::service::Service;
use fleetcal_clock::{Clock, SystemClock};
use fleetcal_config::{Config, RobotEntry};
use fleetcal_domain::access::{Actor, Authentication, Role};
use fleetcal_domain::approval::{
    Command, DeploymentState, ExpectedGain, Policy, ProposalState, expected_gain,
};
use fleetcal_domain::robot::{Mount, RobotConfig, Wheelbase};
use fleetcal_estimator::{Pose2, VehicleModel};
use fleetcal_model::Generation;
use fleetcal_patience::until;
use fleetcal_ports::free_address;
use fleetcal_proto::calibration::Envelope;
use fleetcal_proto::signing::{KEY_BYTES, SigningKey, TrustedKeys, sha256_hex};
use fleetcal_proto::{Keys, RobotId};
use fleetcal_robot::fleet::{
    DriveMessages, FleetOptions, SimulatedRobot, run_fleet, simulated_robots,
};
use fleetcal_store::{CertificateFilter, CertificateRecord, ProposalFilter};
use tokio_util::sync::CancellationToken;

/// The offsets of the paper's two runs, degrees.
const OFFSETS_DEG: [f64; 2] = [2.92, -1.25];
/// Factor by which the robots' time runs faster than the clock.
const RATE: NonZeroU32 = NonZeroU32::new(4).unwrap();
/// Largest offset that is left after the push, degrees.
const RESIDUAL_MAX_DEG: f64 = 0.1;
/// Largest part of the gain by which a proposal's promise may be missed.
const PROMISE_MISSED_MAX: f64 = 0.25;

fn robots() -> Vec<SimulatedRobot> {
    let mut robots = simulated_robots(OFFSETS_DEG.len(), 3).unwrap();
    for (robot, offset_deg) in robots.iter_mut().zip(OFFSETS_DEG) {
        robot.config.vehicle.steering_offset_rad = offset_deg.to_radians();
    }
    robots
}

fn entry(robot: &SimulatedRobot) -> RobotEntry {
    let nominal = robot.nominal();
    let wheelbase = Wheelbase::try_from(robot.wheelbase_m()).unwrap();
    let mut config = RobotConfig::of_vehicle(VehicleModel::Bicycle, wheelbase);
    let nominal = Pose2::new(nominal.x_m, nominal.y_m, nominal.yaw_rad);
    config.nominal_extrinsics = Some(Mount::try_from(nominal).unwrap());
    RobotEntry {
        id: robot.id.clone(),
        config,
    }
}

fn approver() -> Actor {
    Actor {
        name: "ana".to_owned(),
        authentication: Authentication::Session,
        role: Some(Role::Approver),
        request: None,
    }
}

/// Approves what waits for a robot, once it waits; gives the cross-track error that it promises.
async fn approve(service: &Service, robot: &RobotId) -> ExpectedGain {
    let lifecycle = service.lifecycle();
    until("a proposal is made", || {
        lifecycle.ledger(robot).open.is_some()
    })
    .await;
    until("a gain is promised", || promised(service, robot).is_some()).await;
    let promise = promised(service, robot).unwrap();
    let open = lifecycle.ledger(robot).open.clone().unwrap();
    let command = Command::Approve {
        proposal: open.id,
        version: Some(open.version),
        sha256: open.revision_sha256,
        reason: Some("looks right".to_owned()),
    };
    lifecycle
        .decide(robot, command, approver(), None)
        .await
        .unwrap();
    promise
}

/// Gain that the open proposal of a robot promises, once it has driven enough.
fn promised(service: &Service, robot: &RobotId) -> Option<ExpectedGain> {
    let ledger = service.lifecycle().ledger(robot);
    let open = ledger.open.as_ref()?;
    let revision = ledger.revisions.get(&open.revision)?;
    let errors = service.fleet().cross_tracks(robot);
    let tolerance = Policy::default().verify_within;
    expected_gain(
        &open.base?,
        revision,
        errors.get(&Generation::FACTORY)?,
        &tolerance,
    )
}

/// Waits until a robot has proven what it was given; any other end of it is told at once.
async fn verified(service: &Service, robot: &RobotId) {
    let lifecycle = service.lifecycle();
    let state = || lifecycle.ledger(robot).live.clone().map(|live| live.state);
    let mut seen = state();
    until("the calibration is verified", || {
        let now = state();
        if now != seen {
            println!("{robot}: {seen:?} -> {now:?}");
            seen = now;
        }
        let ended = matches!(seen, None | Some(DeploymentState::RollingBack));
        let proven = !lifecycle.ledger(robot).shadow.verified.is_empty();
        assert!(proven || !ended, "{robot}: not proven");
        proven
    })
    .await;
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn an_offset_is_found_approved_pulled_and_proven() {
    let data = tempfile::tempdir().unwrap();
    let endpoint = format!("tcp/{}", free_address());
    let robots = robots();
    let config = Config {
        data: data.path().join("data"),
        http: SocketAddr::from(([127, 0, 0, 1], 0)),
        listen: vec![endpoint.clone()],
        robots: robots.iter().map(entry).collect(),
        approval: Policy {
            stable_for_s: 3.0,
            ..Policy::default()
        },
        ..Config::default()
    };
    let clock = Arc::new(SystemClock::start());
    let service = Service::start(config, clock.clone()).await.unwrap();
    let stop = CancellationToken::new();
    let fleet = tokio::spawn(run_fleet(
        FleetOptions {
            robots: robots.clone(),
            connect: vec![endpoint].into(),
            keys: Keys::default(),
            trusted: Some(TrustedKeys::from(service.lifecycle().public_key())),
            start_stamp_ns: clock.now().0,
            rate: RATE,
            drive_messages: DriveMessages::default(),
        },
        stop.clone(),
    ));

    let mut promises = Vec::new();
    for robot in &robots {
        promises.push(approve(&service, &robot.id).await);
    }
    for robot in &robots {
        verified(&service, &robot.id).await;
    }
    for ((robot, offset_deg), promise) in robots.iter().zip(OFFSETS_DEG).zip(promises) {
        is_proven(&service, &robot.id, offset_deg, promise).await;
    }
    nothing_else_was_proposed(&service).await;
    let certificates = certificates(&service).await;
    let key = service.lifecycle().public_key().to_string();
    stop.cancel();
    fleet.await.unwrap().unwrap();
    service.stop().await.unwrap();
    are_checked_without_the_service(&certificates, &key);
}

/// Files of the certificates of all robots, each as the API gives it.
async fn certificates(service: &Service) -> Vec<String> {
    let filter = CertificateFilter {
        limit: 10,
        ..CertificateFilter::default()
    };
    let found = service.store().certificates(&filter).await.unwrap();
    assert_eq!(found.len(), OFFSETS_DEG.len(), "each is certified once");
    let file = |one: &CertificateRecord| serde_json::to_string(&one.envelope).unwrap();
    found.iter().map(file).collect()
}

/// Runs `fleetcal verify` on a file; returns its exit status, output and errors.
fn verify(file: &str, key: &str) -> (Option<i32>, String, String) {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("certificate.json");
    std::fs::write(&path, file).unwrap();
    let done = std::process::Command::new(env!("CARGO_BIN_EXE_fleetcal"))
        .arg("verify")
        .arg(&path)
        .args(["--key", key])
        .output()
        .unwrap();
    let text = |bytes| String::from_utf8(bytes).unwrap();
    (done.status.code(), text(done.stdout), text(done.stderr))
}

fn are_checked_without_the_service(certificates: &[String], key: &str) {
    let (status, printed, said) = verify(&certificates[0], key);
    assert_eq!(status, Some(0), "{said}");
    let acts = ["proposed", "approved", "applied", "verified"];
    for fact in ["Calibration certificate", "manoeuvres", "RMS"]
        .into_iter()
        .chain(acts)
    {
        assert!(printed.contains(fact), "{fact}: {printed}");
    }
    let (status, printed, said) = verify(&certificates.join("\n"), key);
    assert_eq!(status, Some(0), "{said}");
    assert_eq!(printed.matches("Genuine").count(), OFFSETS_DEG.len());

    let other = SigningKey::from_bytes(&[9; KEY_BYTES]).public_key();
    let (status, _, said) = verify(&certificates[0], &other.to_string());
    assert_eq!(status, Some(1));
    assert!(said.contains("refused: key_id: got"), "{said}");
    let (status, _, said) = verify("", key);
    assert_eq!(status, Some(1), "{said}");

    for (field, check) in CHANGED {
        let (status, printed, said) = verify(&changed(&certificates[0], field), key);
        assert_eq!(status, Some(1), "{field}: {printed}");
        let refused = format!("refused: {check}");
        assert!(said.contains(&refused), "{field}: {said}");
        assert!(!printed.contains("Genuine"), "{field}: {printed}");
    }
    // A forger computes the hash again, and has no key.
    let mut forged: Envelope = serde_json::from_str(&certificates[0]).unwrap();
    forged.document = forged.document.replace("\"ana\"", "\"bob\"");
    forged.sha256 = sha256_hex(forged.document.as_bytes());
    let (status, _, said) = verify(&serde_json::to_string(&forged).unwrap(), key);
    assert_eq!(status, Some(1));
    assert!(said.contains("refused: signature: "), "{said}");
}

/// Fields of a certificate, one of each kind, and the check that names a change of its first byte.
const CHANGED: [(&str, &str); 21] = [
    (r#"\"schema\":"#, "sha256 is"),
    (r#"\"number\":"#, "sha256 is"),
    (r#"\"robot\":"#, "sha256 is"),
    (r#"\"wheelbase_m\":"#, "sha256 is"),
    (r#"\"generation\":"#, "sha256 is"),
    (r#"\"steering_offset_rad\":"#, "sha256 is"),
    (r#"\"sigmas\":{\"steering_offset_rad\":"#, "sha256 is"),
    (r#"\"covariance\":"#, "sha256 is"),
    (r#"\"distance_m\":"#, "sha256 is"),
    (r#"\"left_m\":"#, "sha256 is"),
    (r#"\"nis_mean\":"#, "sha256 is"),
    (r#"\"limits\":{\"steering_offset_rad\":"#, "sha256 is"),
    (r#"\"evidence_sha256\":"#, "sha256 is"),
    (r#"\"rms_m\":"#, "sha256 is"),
    (r#"\"by\":"#, "sha256 is"),
    (r#"\"at\":"#, "sha256 is"),
    (r#"\"service\":"#, "sha256 is"),
    (r#","sha256":"#, "sha256 is"),
    (r#","key_id":"#, "key_id: got"),
    (r#","signature":"#, "signature: "),
    (r#"{""#, "envelope: "),
];

/// Changes one bit of the first letter or digit behind a text of the file.
fn changed(file: &str, behind: &str) -> String {
    let from = file
        .find(behind)
        .unwrap_or_else(|| panic!("{behind} is in {file}"))
        + behind.len();
    let mut bytes = file.as_bytes().to_vec();
    let place = (from..bytes.len()).find(|&at| bytes[at].is_ascii_alphanumeric());
    bytes[place.unwrap()] ^= 0x01;
    String::from_utf8(bytes).unwrap()
}

/// Holds a robot against its truth, and against how it drove before.
async fn is_proven(service: &Service, robot: &RobotId, offset_deg: f64, promise: ExpectedGain) {
    let deployments = service.store().deployments(robot, None, 1).await.unwrap();
    let deployment = deployments.first().unwrap();
    assert_eq!(deployment.state, DeploymentState::Verified);
    let ledger = service.lifecycle().ledger(robot);
    assert!(ledger.shadow.in_sync());
    let used = ledger.shadow.in_use.as_ref().unwrap().values;
    let residual_deg = (offset_deg - used.steering_offset_rad.to_degrees()).abs();
    let errors = service.fleet().cross_tracks(robot);
    let rms_mm = |generation| {
        errors
            .get(&generation)
            .map_or(f64::NAN, |e| 1e3 * e.rms_m())
    };
    let (before_mm, after_mm) = (rms_mm(Generation(0)), rms_mm(deployment.offer.generation));
    println!(
        "{robot}: offset {offset_deg:+.2} deg, used {:+.3} deg, residual {residual_deg:.3} deg; \
             cross-track error {before_mm:.0} mm RMS before, {after_mm:.0} mm after",
        used.steering_offset_rad.to_degrees(),
    );
    assert!(residual_deg < RESIDUAL_MAX_DEG, "{residual_deg}");
    assert!(after_mm < before_mm, "{before_mm} {after_mm}");
    let expected_mm = 1e3 * promise.expected_rms_m;
    println!("{robot}: {expected_mm:.0} mm RMS were expected");
    let of_gain = (after_mm - expected_mm).abs() / (before_mm - after_mm);
    assert!(of_gain < PROMISE_MISSED_MAX, "{expected_mm} {after_mm}");
}

async fn nothing_else_was_proposed(service: &Service) {
    let filter = ProposalFilter {
        limit: 10,
        ..ProposalFilter::default()
    };
    let proposals = service.store().proposals(&filter).await.unwrap();
    assert_eq!(
        proposals.len(),
        OFFSETS_DEG.len(),
        "nothing else was proposed"
    );
    assert!(
        proposals
            .iter()
            .all(|(one, _)| one.state == ProposalState::Approved)
    );
}
