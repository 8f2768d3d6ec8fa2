//! Hostile sessions at one of two routers with the generated list, before two instances of a service:
//! the robots of both go on, and none changes its instance. And one instance killed there: the other one takes
//! its robots over. `make cluster-floods`.

use std::collections::BTreeMap;
use std::net::SocketAddr;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::sleep;
use std::time::{Duration, Instant};

use fleetcal_contract::own_server::psql;
use fleetcal_contract::server;
use fleetcal_ports::free_address;
use fleetcal_store::database_url::PostgresUrl;
use fleetcal_tests::certificates::Authority;
use fleetcal_tests::memory::{self, Memory};
use fleetcal_tests::service::{Instance, Service, now, wait_for};
use fleetcal_tests::{database, recording};
use serde_json::{Value, json};
use tempfile::TempDir;
use tokio::task::JoinSet;
use zenoh::Session;

use super::floods::{
    Crowd, Ended, Figures, ROBOTS, SESSIONS, kinds, longest_stall, names, received_at_last,
    seconds, sections,
};
use super::robot;
use super::router::Router;
use super::routers::configured;
use super::session;

/// Names of instances, and of the routers that they connect to first.
const INSTANCES: [&str; 2] = ["a", "b"];
const ROUTERS: [&str; 2] = ["router_1", "router_2"];
/// Id of the attacked robot, whose alerts may be right.
const ATTACKED: &str = "robot_50";
/// Time that the robots drive before and after a flood, s.
const MARGIN_S: u64 = 2;
/// Pause between two checks of the leases.
const LOOK_EVERY: Duration = Duration::from_millis(250);
/// Samples of the others of which at most one is lost.
const LOST_AT_MOST_ONE_IN: u64 = 2_000;
/// Least remaining lease, s: one of 6 s is renewed every 2 s, so one with less was renewed late.
const LEASE_LEFT_MIN_S: f64 = 2.0;
/// Largest growth of a process by a flood of some seconds, beyond that without one, bytes.
const GROWN_MAX_BYTES: u64 = 256 << 20;
/// Robots whose estimates are received while their instance is killed.
const HEARD: usize = 6;
/// Time within which they are estimated again: before Zenoh notices the killed instance, and before
/// its lease ends.
const SERVED_WITHIN: Duration = Duration::from_secs(3);

/// Instance of each robot: its name, and the epoch of its tenure.
type Owners = BTreeMap<String, (String, u64)>;

/// Two routers that know each other by certificate, and an instance at each.
struct Mesh {
    instances: [Service; 2],
    routers: [Router; 2],
    endpoints: [String; 2],
    database: PostgresUrl,
    folder: TempDir,
}

impl Mesh {
    /// Starts them, and waits until the instances share the robots evenly.
    fn start() -> Self {
        let server = server();
        assert!(
            server.is_some(),
            "FLEETCAL_TEST_POSTGRES names a server: make cluster-floods"
        );
        let folder = TempDir::new().unwrap();
        let authority = Authority::new(folder.path());
        let robots = names();
        let robots: Vec<&str> = robots.iter().map(String::as_str).collect();
        for name in robots.iter().chain(&ROUTERS).chain(&["fleetcal"]) {
            authority.sign(name);
        }
        let addresses = ROUTERS.map(|_| free_address());
        let routers = [[0, 1], [1, 0]].map(|pair| {
            let pair = pair.map(|number| (ROUTERS[number], addresses[number]));
            let config = configured(&authority, folder.path(), &robots, pair);
            Router::start_process(Path::new(&config))
        });
        let endpoints = addresses.map(|address| format!("quic/{address}"));
        let database = database::created_on(&server.unwrap());
        let https = INSTANCES.map(|_| free_address());
        let config = configuration(folder.path(), https) + &sections();
        let instances = [0, 1].map(|number| {
            let zenoh = service_client(&authority, folder.path(), &endpoints, number);
            let instance = Instance {
                name: INSTANCES[number],
                http: https[number],
                database: &database,
            };
            let flags = ["-c", zenoh.to_str().unwrap()];
            Service::start_instance(instance, addresses[number], &config, &flags)
        });
        let mesh = Self {
            instances,
            routers,
            endpoints,
            database,
            folder,
        };
        wait_for("even shares", || {
            let owners = mesh.owners();
            let of = |name: &str| owners.values().filter(|(owner, _)| owner == name).count();
            let even = INSTANCES.iter().all(|name| of(name) == robots.len() / 2);
            even.then_some(())
        });
        mesh
    }

    /// Returns the instance of each robot.
    fn owners(&self) -> Owners {
        let told = psql(
            &self.database,
            "SELECT r.id, coalesce(o.instance, ''), o.epoch FROM robot_owner AS o \
             JOIN robot AS r ON r.key = o.robot",
        );
        let owner = |line: &str| {
            let mut fields = line.split('|');
            let (robot, instance) = (fields.next()?, fields.next()?);
            let epoch = fields.next()?.parse().ok()?;
            Some((robot.to_owned(), (instance.to_owned(), epoch)))
        };
        told.lines().filter_map(owner).collect()
    }

    /// Returns the instance of this name.
    fn instance(&self, name: &str) -> &Service {
        let number = INSTANCES.iter().position(|own| *own == name);
        &self.instances[number.unwrap_or_default()]
    }

    /// Returns all raised alerts.
    fn alerts(&self) -> Vec<String> {
        let raised = "SELECT DISTINCT a.kind || ' of ' || coalesce(a.robot, 'the fleet') FROM alert AS a \
                      JOIN alert_change AS c ON c.alert = a.id WHERE c.state = 'alerting' ORDER BY 1";
        let told = psql(&self.database, raised);
        told.lines().map(str::to_owned).collect()
    }

    /// Opens a robot's own session at its router.
    async fn robot(&self, id: &str) -> Session {
        let identity = session::tls(self.folder.path(), Some(id));
        let config = robot::client(&self.endpoints[router_of(id)], &identity);
        robot::open(config).await.unwrap()
    }

    /// Returns the memory of the instances, then of the routers.
    fn memory(&self) -> [Memory; 4] {
        let [a, b] = &self.instances;
        let [one, two] = &self.routers;
        [a.pid(), b.pid(), one.pid(), two.pid()].map(memory::of)
    }

    /// Starts robots that drive, half of them at each router.
    fn robots(&self, recording: &Path, drive_s: u64) -> Crowd {
        let (drive_s, robots) = (drive_s.to_string(), ROBOTS.to_string());
        Crowd::start(&[
            "robots",
            &self.endpoints.join(","),
            &drive_s,
            &robots,
            recording.to_str().unwrap(),
            self.folder.path().to_str().unwrap(),
        ])
    }

    /// Starts sessions that attack at the first router.
    fn hostile(&self, kind: &str, seconds: u64) -> Crowd {
        let (seconds, sessions) = (seconds.to_string(), SESSIONS.to_string());
        let certificates = self.folder.path().to_str().unwrap();
        let at = &self.endpoints[0];
        Crowd::start(&["hostile", at, &seconds, &sessions, kind, certificates])
    }

    /// Returns the least remaining lease while `goes_on`, s, as reported by the instances.
    fn least_lease_left_s(&self, goes_on: impl Fn() -> bool) -> f64 {
        let mut least_s = f64::INFINITY;
        while goes_on() {
            for instance in &self.instances {
                let Some(cluster) = instance.try_get("/api/v1/cluster") else {
                    continue;
                };
                for member in cluster["instances"].as_array().unwrap() {
                    least_s = least_s.min(member["lease_left_s"].as_f64().unwrap());
                }
            }
            sleep(LOOK_EVERY);
        }
        least_s
    }
}

/// Writes the common configuration of both instances.
fn configuration(folder: &Path, https: [SocketAddr; 2]) -> String {
    let [a, b] = https;
    let key = folder.join("signing.key").display().to_string();
    format!(
        "[cluster]\nplaintext_peers = true\nfast_takeover = true\n\
         peers = {{ a = \"http://{a}\", b = \"http://{b}\" }}\nsigning_key = {key:?}\n\n"
    )
}

/// Writes the Zenoh configuration of an instance: its own router, and the other one if that is
/// gone.
fn service_client(
    authority: &Authority,
    folder: &Path,
    endpoints: &[String; 2],
    number: usize,
) -> PathBuf {
    let (own, other) = (&endpoints[number], &endpoints[1 - number]);
    let mut config = robot::client(own, &session::tls(authority.folder(), Some("fleetcal")));
    config["connect"] = json!({
        "endpoints": [own, other], "timeout_ms": -1, "exit_on_failure": false,
    });
    config["transport"]["link"]["tx"] = json!({ "lease": 3_000 });
    let path = folder.join(format!("instance_{number}.json5"));
    std::fs::write(&path, config.to_string()).unwrap();
    path
}

/// Effects of a flood on instances, routers and robots.
#[derive(Debug)]
struct Hurt {
    done: u64,
    /// Effects on robots at the attacked router, and at the other one.
    of_robots: [Figures; 2],
    /// Longest time without a message of a robot of each instance.
    stalled: [Duration; 2],
    lease_left_s: f64,
    /// Robots that moved to another instance.
    moved: Vec<String>,
    alerts: Vec<String>,
    /// Growth of instances and routers at the end, bytes.
    grown: [u64; 4],
    /// Largest growth of instances and routers, bytes.
    grown_most: [u64; 4],
}

/// Drives robots while the first router is attacked by `kind`; without a kind, it is not attacked.
fn flooded(kind: Option<&str>, seconds: u64) -> Hurt {
    let mut mesh = Mesh::start();
    let path = mesh.folder.path().join("robot.mcap");
    let drive_s = seconds + 2 * MARGIN_S;
    recording::simulated(&path, drive_s as f64);
    let (owners, memory) = (mesh.owners(), mesh.memory());
    let mut fleet = mesh.robots(&path, drive_s);
    sleep(Duration::from_secs(MARGIN_S));
    let (done, stalled, lease_left_s) = watched(&mesh, &owners, || {
        kind.map_or_else(
            || {
                sleep(Duration::from_secs(seconds));
                0
            },
            |kind| mesh.hostile(kind, seconds).hear()["done"].as_u64().unwrap(),
        )
    });
    let sent = fleet.hear();
    let alerts = mesh.alerts();
    let owners_then = mesh.owners();
    let of_robots = at_routers(&mesh, &owners_then, &sent);
    let moved = owners.iter().filter(|(id, of)| owners_then[*id] != **of);
    let moved = moved.map(|(id, of)| format!("{id}: {of:?}, {:?}", owners_then[id]));
    mesh.routers.iter_mut().for_each(Router::assert_runs);
    let memory_then = mesh.memory();
    let grown = |what: fn(&Memory) -> u64| {
        [0, 1, 2, 3].map(|one| what(&memory_then[one]).saturating_sub(memory[one].held_bytes))
    };
    Hurt {
        done,
        of_robots,
        stalled,
        lease_left_s,
        moved: moved.collect(),
        alerts,
        grown: grown(|memory| memory.held_bytes),
        grown_most: grown(|memory| memory.most_bytes),
    }
}

/// Returns the router of a robot, in turn by their numbers.
fn router_of(id: &str) -> usize {
    let (_, number) = id.rsplit_once('_').unwrap();
    number.parse::<usize>().unwrap() % ROUTERS.len()
}

/// Counts the samples of the robots at each router.
fn at_routers(mesh: &Mesh, owners: &Owners, sent: &Value) -> [Figures; 2] {
    let sent = sent["sent"].as_object().unwrap();
    let ended = sent.iter().map(|(id, of_robot)| Ended {
        service: mesh.instance(&owners[id].0),
        id,
        of_robot,
    });
    let ended: Vec<Ended<'_>> = ended.collect();
    let mut figures = [Figures::default(), Figures::default()];
    for (one, robot) in ended.iter().zip(received_at_last(&ended)) {
        figures[router_of(one.id)].add(&robot);
    }
    figures
}

/// Runs `flood`, and returns its result, with the longest stall of a robot of each instance and the
/// least remaining lease meanwhile.
fn watched(mesh: &Mesh, owners: &Owners, flood: impl FnOnce() -> u64) -> (u64, [Duration; 2], f64) {
    let is_over = AtomicBool::new(false);
    let goes_on = || !is_over.load(Ordering::Relaxed);
    std::thread::scope(|scope| {
        let stalls = INSTANCES.map(|name| {
            let own = owners
                .iter()
                .find(|(id, (of, _))| *id != ATTACKED && of == name);
            let (id, _) = own.unwrap();
            scope.spawn(move || longest_stall(mesh.instance(name), id, goes_on))
        });
        let lease = scope.spawn(|| mesh.least_lease_left_s(goes_on));
        let done = flood();
        is_over.store(true, Ordering::Relaxed);
        let stalled = stalls.map(|stall| stall.join().unwrap());
        (done, stalled, lease.join().unwrap())
    })
}

fn report(kind: &str, hurt: &Hurt) {
    println!(
        "{kind} by {SESSIONS} sessions ({}), {} s:",
        hurt.done,
        seconds()
    );
    for (router, figures) in ROUTERS.iter().zip(&hurt.of_robots) {
        println!(
            "  robots at {router}: {} sent, {} lost, {} late, {} drive samples and {} scans dropped",
            figures.sent,
            figures.lost,
            figures.late,
            figures.dropped_wheel_odometry,
            figures.dropped_scans,
        );
    }
    let mib = |bytes: [u64; 4]| bytes.map(|bytes| bytes >> 20);
    println!(
        "  stalled {:.2?}, at least {:.1} s left of a lease, {} robots moved, alerts {:?}; MiB of two \
         instances and two routers +{:?}, at most +{:?}",
        hurt.stalled,
        hurt.lease_left_s,
        hurt.moved.len(),
        hurt.alerts,
        mib(hurt.grown),
        mib(hurt.grown_most),
    );
}

/// Returns the forbidden effects of a flood, whatever else the machine does; empty without any.
fn wrongs(kind: &str, hurt: &Hurt, control: &Hurt) -> Vec<String> {
    let lost: u64 = hurt.of_robots.iter().map(|figures| figures.lost).sum();
    let sent: u64 = hurt.of_robots.iter().map(|figures| figures.sent).sum();
    let of_others = |alert: &&String| !alert.ends_with(ATTACKED) && !control.alerts.contains(alert);
    let alerts: Vec<_> = hurt.alerts.iter().filter(of_others).collect();
    let grown = std::iter::zip(hurt.grown_most, control.grown_most);
    let beyond = grown.map(|(grown, without)| grown.saturating_sub(without));
    let beyond = beyond.max().unwrap_or_default();
    let rules = [
        (hurt.done > 100, "that was no flood"),
        (hurt.moved.is_empty(), "robots moved"),
        (alerts.is_empty(), "alerts of others"),
        (
            hurt.lease_left_s >= LEASE_LEFT_MIN_S,
            "a lease was renewed late",
        ),
        (lost * LOST_AT_MOST_ONE_IN <= sent, "others lost samples"),
        (beyond <= GROWN_MAX_BYTES, "a process grew"),
    ];
    let broken = rules.into_iter().filter(|(is_kept, _)| !is_kept);
    broken
        .map(|(_, what)| format!("{kind}: {what}: {hurt:?}"))
        .collect()
}

#[test]
#[ignore = "needs PostgreSQL, five minutes; make cluster-floods"]
fn no_flood_at_a_router_moves_a_robot_or_takes_samples_from_others() {
    let kinds = kinds();
    let control = flooded(None, seconds());
    report("nothing", &control);
    let mut wrong = Vec::new();
    for kind in kinds.split_whitespace() {
        let hurt = flooded(Some(kind), seconds());
        report(kind, &hurt);
        wrong.extend(wrongs(kind, &hurt, &control));
    }
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}

/// Receives a robot's estimates until one of this instance comes; returns its epoch, and the time
/// since `began`.
async fn estimated(own: &Session, id: &str, by: &str, began: Instant) -> (u64, Duration) {
    let estimates = own.declare_subscriber(format!("fleet/{id}/estimate"));
    let estimates = estimates.await.unwrap();
    let heard = async {
        loop {
            let sample = estimates.recv_async().await.unwrap();
            let estimate: Value = serde_json::from_slice(&sample.payload().to_bytes()).unwrap();
            let estimated_by = &estimate["estimated_by"];
            if estimated_by["instance"] == by {
                return (estimated_by["epoch"].as_u64().unwrap(), began.elapsed());
            }
        }
    };
    let heard = tokio::time::timeout(session::PATIENCE, heard).await;
    assert!(heard.is_ok(), "{by} sends no estimate of {id}");
    heard.unwrap()
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
#[ignore = "needs PostgreSQL, a minute; make cluster-floods"]
async fn an_instance_takes_robots_over_by_certificate_and_list() {
    let mut mesh = Mesh::start();
    let path = mesh.folder.path().join("robot.mcap");
    let drive_s = 2 * session::PATIENCE.as_secs();
    recording::simulated(&path, drive_s as f64);
    let _fleet = mesh.robots(&path, drive_s);
    let owners = mesh.owners();
    let [killed, other] = INSTANCES;
    let of_killed = owners
        .iter()
        .filter(|(id, (owner, _))| *id != ATTACKED && owner == killed);
    let mut robots = Vec::new();
    for (id, _) in of_killed.take(HEARD) {
        let own = mesh.robot(id).await;
        let (epoch, _) = estimated(&own, id, killed, now()).await;
        robots.push((id.clone(), own, epoch));
    }
    assert_eq!(robots.len(), HEARD);
    mesh.instances[0].kill();
    let began = now();
    let taken_over = robots.into_iter().map(|(id, own, epoch)| async move {
        let (later, took) = estimated(&own, &id, other, began).await;
        assert!(later > epoch, "{id}: epoch {later} after {epoch}");
        took
    });
    let took = taken_over.collect::<JoinSet<_>>().join_all().await;
    println!("{HEARD} robots of {killed} are estimated by {other} after {took:.2?}");
    assert!(took.iter().all(|took| *took <= SERVED_WITHIN), "{took:?}");
    mesh.routers.iter_mut().for_each(Router::assert_runs);
}
