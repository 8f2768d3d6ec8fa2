//! Access lists: the service's own, which knows shapes of keys, and the generated one, which knows
//! who may use which.

use std::fs;
use std::net::SocketAddr;
use std::os::unix::fs::PermissionsExt as _;
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::time::Duration;

use fleetcal_ports::free_address;
use fleetcal_tests::binary;
use fleetcal_tests::certificates::Authority;
use fleetcal_tests::service::{Service, now, wait_for};
use serde_json::{Value, json};
use tempfile::TempDir;
use zenoh::Session;
use zenoh::pubsub::Publisher;

use super::{robot, session};

/// Samples that one robot sends under another's name.
const TRIES: u64 = 10_000;

/// Time within which sent messages have arrived, if they do.
const UNDER_WAY: Duration = Duration::from_millis(500);

/// Duration for which a robot queries faster than the list allows.
const ASKED_FOR: Duration = Duration::from_secs(2);

/// Configuration of two known robots.
const KNOWN: &str = "\
    [[robot]]\nid = \"robot_a\"\nmodel = \"bicycle\"\nwheelbase_m = 1.2\n\
    [[robot]]\nid = \"robot_b\"\nmodel = \"bicycle\"\nwheelbase_m = 1.2\n";

/// Writes the output of `fleetcal acl generate`, and returns its path.
pub fn generated(folder: &Path, flags: &[&str]) -> String {
    let output = binary::run(["acl", "generate"].iter().chain(flags));
    let said = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "{said}");
    let path = folder.join("router.json5");
    fs::write(&path, output.stdout).unwrap();
    path.display().to_string()
}

/// Writes a password for each name; the password of a name is the name backwards.
pub fn passwords(folder: &Path, names: &[&str]) -> String {
    let line = |name: &&str| format!("{name}:{}\n", password(name));
    let path = folder.join("passwords.txt");
    fs::write(&path, names.iter().map(line).collect::<String>()).unwrap();
    path.display().to_string()
}

pub fn password(name: &str) -> String {
    name.chars().rev().collect()
}

pub fn received(service: &Service, id: &str) -> u64 {
    let robot = service.try_get(&format!("/api/v1/robots/{id}"));
    robot.map_or(0, |robot| {
        robot["counters"]["received"].as_u64().unwrap_or_default()
    })
}

pub fn wait_until_received(service: &Service, id: &str, samples: u64) {
    wait_for(&format!("{samples} samples of {id}"), || {
        (received(service, id) >= samples).then_some(())
    });
}

/// Returns the stream of a robot once its samples arrive, and their number so far: a router drops
/// messages before it knows of the service.
pub async fn arriving(service: &Service, session: &Session, id: &str) -> (Publisher<'static>, u64) {
    let stream = robot::stream(session, id).await;
    let begun = now();
    while received(service, id) == 0 {
        assert!(begun.elapsed() < robot::PATIENCE, "nothing of {id} arrives");
        robot::send(&stream, 1).await;
        tokio::time::sleep(UNDER_WAY).await;
    }
    tokio::time::sleep(UNDER_WAY).await;
    (stream, received(service, id))
}

/// Asserts for robot A's connection: messages under its own name arrive, those under B's do not,
/// and it receives the service's messages for itself alone. `listener` is a second connection of B.
async fn assert_a_is_a_alone(service: &Service, a: &Session, b: &Session, listener: &Session) {
    let (as_a, of_a) = arriving(service, a, "robot_a").await;
    let as_b = robot::stream(a, "robot_b").await;
    let estimates_of_b = "fleet/robot_b/estimate";
    let heard_by_b = listener.declare_subscriber(estimates_of_b).await.unwrap();
    let heard = a.declare_subscriber(estimates_of_b).await.unwrap();
    // The key of the forged ones is declared by then, too.
    tokio::time::sleep(UNDER_WAY).await;
    robot::send(&as_b, TRIES).await;
    // Behind the forged ones on the same connection: when these are in, those have been decided on.
    robot::send(&as_a, 100).await;
    wait_until_received(service, "robot_a", of_a + 100);
    assert_eq!(received(service, "robot_b"), 0, "of {TRIES} forged samples");
    let (by_b, of_b) = arriving(service, b, "robot_b").await;
    robot::send(&by_b, 300).await;
    wait_until_received(service, "robot_b", of_b + 300);
    assert_eq!(received(service, "robot_b"), of_b + 300);
    assert_eq!(received(service, "robot_a"), of_a + 100);
    eprintln!("{TRIES} samples of robot A under robot B's key, 0 accepted");

    // B's estimate did leave.
    let estimate = tokio::time::timeout(robot::PATIENCE, heard_by_b.recv_async()).await;
    let key = estimate.map(|heard| heard.unwrap().key_expr().to_string());
    assert_eq!(key, Ok(estimates_of_b.to_owned()));
    assert_eq!(robot::answers(a, "fleet/robot_a/progress").await, 1);
    assert_eq!(robot::answers(a, "fleet/robot_b/progress").await, 0);
    assert!(
        heard.try_recv().unwrap().is_none(),
        "B's estimate reached A"
    );
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn under_the_default_list_a_robot_joins_at_run_time_and_names_are_not_bound() {
    let service = Service::start_with(KNOWN);
    let config = robot::client(&service.endpoint(), &json!({}));
    let session = robot::open(config).await.unwrap();
    robot::send(&robot::stream(&session, "newcomer").await, 100).await;
    wait_until_received(&service, "newcomer", 100);
    service.put(
        "/api/v1/robots/newcomer",
        &json!({ "model": "bicycle", "wheelbase_m": 1.2 }),
    );
    robot::send(&robot::stream(&session, "newcomer").await, 100).await;
    wait_until_received(&service, "newcomer", 200);
    wait_for("samples that are worked through", || {
        let counters = &service.robot("newcomer")["counters"];
        (counters["processed"].as_u64()? >= 1).then_some(())
    });
    // What the list per robot is for: here the same session may be any robot.
    robot::send(&robot::stream(&session, "robot_b").await, TRIES).await;
    wait_until_received(&service, "robot_b", TRIES);
}

fn start_with_passwords(folder: &Path, zenoh: SocketAddr) -> Service {
    let passwords = passwords(folder, &["robot_a", "robot_b"]);
    let listen = format!("tcp/{zenoh}");
    let flags = [
        "--robot",
        "robot_a",
        "--robot",
        "robot_b",
        "--identity",
        "user",
    ];
    let file = ["--passwords", &passwords, "--listen", &listen];
    let config = generated(folder, &[flags.as_slice(), &file].concat());
    Service::start_on(zenoh, KNOWN, &["-c", &config])
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn with_passwords_a_robot_is_refused_under_anothers_key_and_one_more_joins_by_a_restart() {
    let folder = TempDir::new().unwrap();
    let zenoh = free_address();
    let mut service = start_with_passwords(folder.path(), zenoh);
    let client = |name: &str, password: &str| {
        robot::open(robot::with_password(
            &format!("tcp/{zenoh}"),
            name,
            password,
        ))
    };
    let a = client("robot_a", &password("robot_a")).await.unwrap();
    let b = client("robot_b", &password("robot_b")).await.unwrap();
    let listener = client("robot_b", &password("robot_b")).await.unwrap();
    assert_a_is_a_alone(&service, &a, &b, &listener).await;
    assert!(client("robot_a", "guessed").await.is_err());
    assert!(client("robot_c", &password("robot_c")).await.is_err());

    let listen = format!("tcp/{zenoh}");
    let names = ["robot_a", "robot_b", "robot_c"];
    let passwords = passwords(folder.path(), &names);
    let robots = names.iter().flat_map(|name| ["--robot", name]);
    let rest = [
        "--identity",
        "user",
        "--passwords",
        &passwords,
        "-l",
        &listen,
    ];
    let flags: Vec<&str> = robots.chain(rest).collect();
    generated(folder.path(), &flags);
    service.terminate();
    service.restart();
    let c = client("robot_c", &password("robot_c")).await.unwrap();
    robot::send(&robot::stream(&c, "robot_c").await, 100).await;
    wait_until_received(&service, "robot_c", 100);
    robot::send(&robot::stream(&a, "robot_a").await, 100).await;
    wait_until_received(&service, "robot_a", 100);
}

pub fn start_with_certificates(
    authority: &Authority,
    folder: &Path,
    zenoh: SocketAddr,
    protocol: &str,
) -> Service {
    for name in ["router", "robot_a", "robot_b", "stranger"] {
        authority.sign(name);
    }
    let [certificate, key, ca] =
        ["router.pem", "router.key.pem", "ca.pem"].map(|f| authority.path(f));
    let listen = format!("{protocol}/{zenoh}");
    let flags = [
        "--robot", "robot_a", "--robot", "robot_b", "--listen", &listen,
    ];
    let files = [
        "--tls-certificate",
        &certificate,
        "--tls-key",
        &key,
        "--tls-ca",
        &ca,
    ];
    let config = generated(folder, &[flags, files].concat());
    // Sessions of robots that share a name, beyond the default share.
    let known = format!("sessions_per_name = 64\n{KNOWN}");
    Service::start_on(zenoh, &known, &["-c", &config])
}

async fn assert_certificates_are_asked_for(protocol: &str) {
    let folder = TempDir::new().unwrap();
    let authority = Authority::new(folder.path());
    let zenoh = free_address();
    let service = start_with_certificates(&authority, folder.path(), zenoh, protocol);
    let client = |name: Option<&str>| {
        let transport = session::tls(authority.folder(), name);
        robot::open(robot::client(&format!("{protocol}/{zenoh}"), &transport))
    };
    let a = client(Some("robot_a")).await.unwrap();
    let b = client(Some("robot_b")).await.unwrap();
    let listener = client(Some("robot_b")).await.unwrap();
    assert_a_is_a_alone(&service, &a, &b, &listener).await;
    assert!(client(None).await.is_err(), "without a certificate");
    // Signed by the fleet's authority, but in no list.
    let stranger = client(Some("stranger")).await.unwrap();
    assert_eq!(robot::answers(&stranger, "fleet/robot_a/progress").await, 0);
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn with_certificates_a_robot_is_refused_under_anothers_key() {
    assert_certificates_are_asked_for("tls").await;
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn over_quic_a_robot_is_refused_under_anothers_key() {
    assert_certificates_are_asked_for("quic").await;
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_generated_list_lets_ten_queries_a_second_through() {
    let folder = TempDir::new().unwrap();
    let zenoh = free_address();
    let _service = start_with_passwords(folder.path(), zenoh);
    let config = robot::with_password(&format!("tcp/{zenoh}"), "robot_a", &password("robot_a"));
    let session = robot::open(config).await.unwrap();
    let answered = Arc::new(AtomicUsize::new(0));
    let begun = now();
    let mut asked = 0;
    while begun.elapsed() < ASKED_FOR {
        let answered = Arc::clone(&answered);
        let query = session
            .get("fleet/robot_a/progress")
            .callback(move |reply| {
                let is_answer = reply.result().is_ok();
                answered.fetch_add(usize::from(is_answer), Ordering::Relaxed);
            });
        query.await.unwrap();
        asked += 1;
        tokio::time::sleep(Duration::from_millis(10)).await;
    }
    tokio::time::sleep(Duration::from_secs(1)).await;
    let answered = answered.load(Ordering::Relaxed);
    assert!(asked >= 100, "{asked} queries were no flood");
    assert!((15..=25).contains(&answered), "{answered} of {asked}");
}

/// Runs the two lines of the README under "Connect a robot", without a password file.
#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_list_with_passwords_needs_no_file_before() {
    let folder = TempDir::new().unwrap();
    let path = folder.path().join("passwords.txt");
    let (zenoh, file) = (free_address(), path.display().to_string());
    let listen = format!("tcp/{zenoh}");
    let identity = ["--identity", "user", "--passwords", &file];
    let flags = [&["--robot", "robot_a"], &identity[..], &["-l", &listen]].concat();
    let router = generated(folder.path(), &flags);
    let text = fs::read_to_string(&path).unwrap();
    let secret = text.trim().strip_prefix("robot_a:").unwrap();
    let mode = fs::metadata(&path).unwrap().permissions().mode();
    assert_eq!(mode & 0o777, 0o600);

    let service = Service::start_on(zenoh, KNOWN, &["-c", &router]);
    let shown = |secret: &str| robot::with_password(&service.endpoint(), "robot_a", secret);
    assert!(robot::open(shown("another")).await.is_err());
    let session = robot::open(shown(secret)).await.unwrap();
    arriving(&service, &session, "robot_a").await;
    drop((session, service));

    fs::remove_file(&path).unwrap();
    let data = folder.path().join("data").display().to_string();
    let http = free_address().to_string();
    let refused = binary::run(["serve", "-c", &router, "--data", &data, "--http", &http]);
    let said = String::from_utf8_lossy(&refused.stderr);
    assert_eq!(refused.status.code(), Some(2), "{said}");
    for wanted in [&file, "No such file", "acl generate"] {
        assert!(said.contains(wanted), "{said}");
    }
    assert!(!said.contains(".rs:"), "{said}");
}

#[test]
fn a_file_of_passwords_that_everybody_can_read_is_warned_of() {
    let folder = TempDir::new().unwrap();
    let passwords = passwords(folder.path(), &["a"]);
    let flags = ["--robot", "a", "--identity", "user", "--passwords"];
    for (mode, is_warned_of) in [(0o600, false), (0o640, false), (0o644, true)] {
        fs::set_permissions(&passwords, fs::Permissions::from_mode(mode)).unwrap();
        let flags = ["acl", "generate"].iter().chain(&flags);
        let output = binary::run(flags.chain([&passwords.as_str()]));
        let said = String::from_utf8_lossy(&output.stderr);
        assert!(output.status.success(), "{said}");
        assert!(said.is_empty() != is_warned_of, "{mode:o}: {said}");
        assert!(!is_warned_of || said.contains("chmod o-r"), "{said}");
    }
}

#[test]
fn what_makes_no_list_is_refused_in_one_sentence() {
    let cases: [(&[&str], &str); 4] = [
        (&["--identity", "user", "--passwords", "p.txt"], "no robot"),
        (&["--robot", "a"], "--tls-certificate"),
        (&["--robot", "a", "--identity", "user"], "--passwords"),
        (
            &[
                "--robot",
                "a",
                "--identity",
                "user",
                "--passwords",
                "p.txt",
                "--stream",
                "a/**",
            ],
            "{robot}",
        ),
    ];
    for (flags, wanted) in cases {
        let output = binary::run(["acl", "generate"].iter().chain(flags));
        let said = String::from_utf8_lossy(&output.stderr);
        assert_eq!(output.status.code(), Some(2), "{said}");
        assert!(said.contains(wanted), "{flags:?}: {said}");
    }
}

/// Makes the configuration of a service that is a client of a router.
pub fn service_client(router: &str, name: &str) -> Value {
    robot::with_password(router, name, &password(name))
}
