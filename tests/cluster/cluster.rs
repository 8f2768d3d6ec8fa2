//! Routers, instances and robots on this machine's loopback, as processes of their own.

use std::collections::BTreeMap;
use std::env;
use std::fs;
use std::net::{SocketAddr, TcpListener, TcpStream};
use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::atomic::{AtomicU16, Ordering};

use fleetcal_contract::own_server::OwnServer;
use fleetcal_contract::server;
use fleetcal_ports::free_address;
use fleetcal_robot::fleet::{SimulatedRobot, simulated_robots};
use fleetcal_store::database_url::PostgresUrl;
use fleetcal_tests::service::wait_for;
use fleetcal_tests::{binary, http};
use serde_json::{Value, json};
use tempfile::TempDir;

use crate::namespaces::{Namespaces, Network};
use crate::network::{Line, Lines, Proxy};
use crate::patroni::Patroni;
use crate::process::Process;
use crate::records;

/// Routers of a cluster.
const ROUTERS: usize = 2;

/// One instance.
#[derive(Debug)]
pub struct Instance {
    /// Its process.
    pub process: Process,
    /// Its name.
    pub name: &'static str,
    /// Address of its API.
    pub http: SocketAddr,
    token: String,
}

impl Instance {
    /// Returns the token by which it admits an administrator.
    pub fn token(&self) -> &str {
        &self.token
    }

    /// Returns the answer of `GET path` with a token of an administrator; `None` without an answer,
    /// or without 200.
    pub fn try_get(&self, path: &str) -> Option<Value> {
        let answer = http::get(self.http, path, Some(&self.token));
        let answer = answer.filter(|answer| answer.status == 200)?;
        serde_json::from_str(&answer.body).ok()
    }

    /// Returns the answer of `GET path`, which has to exist.
    pub fn get(&self, path: &str) -> Value {
        let answer = http::get(self.http, path, Some(&self.token)).unwrap();
        let (status, body) = (answer.status, answer.body);
        assert_eq!(status, 200, "{}: {path}: {body}", self.name);
        serde_json::from_str(&body).unwrap()
    }

    /// Returns the number of robots of each instance, in the view of this one.
    pub fn shares(&self) -> Option<BTreeMap<String, u64>> {
        let cluster = self.try_get("/api/v1/cluster")?;
        let instances = cluster["instances"].as_array()?;
        let share = |one: &Value| Some((one["name"].as_str()?.to_owned(), one["robots"].as_u64()?));
        instances.iter().map(share).collect()
    }
}

/// Parts of a cluster.
#[derive(Debug, Clone)]
pub struct Parts {
    /// Possible instances.
    pub names: Vec<&'static str>,
    /// Driving robots.
    pub robots: usize,
    /// Registered robots that do not drive.
    pub parked: usize,
    /// True if driving robots apply and verify their approved calibration.
    pub robots_apply: bool,
    /// Setting of `[cluster]`.
    pub fast_takeover: bool,
    /// True if each instance has a network namespace of its own, else they share the loopback.
    pub in_namespaces: bool,
}

/// A cluster.
#[derive(Debug)]
pub struct Cluster {
    folder: TempDir,
    /// The cluster's own PostgreSQL; without it the named one.
    pub server: Option<OwnServer>,
    /// Servers under Patroni instead.
    pub patroni: Option<Patroni>,
    database: String,
    /// Program that is started as an instance.
    pub program: PathBuf,
    lines: BTreeMap<&'static str, Lines>,
    /// Endpoints of its routers.
    pub routers: Vec<String>,
    router_processes: Vec<Process>,
    /// Proxies between the routers, if that link can be cut.
    between_routers: Vec<Proxy>,
    /// Namespaces, which outlive the processes in them.
    namespaces: Option<Namespaces>,
    /// Lines of `[cluster]` that name the peers.
    pub peers: String,
    config: String,
    addresses: BTreeMap<&'static str, SocketAddr>,
    robots: usize,
    robots_apply: bool,
}

impl Cluster {
    /// Makes a database and two routers, without running instances. `names` are the possible
    /// instances.
    pub async fn new(names: &[&'static str], robots: usize) -> Self {
        Self::of(&Parts {
            names: names.to_vec(),
            robots,
            parked: 0,
            robots_apply: false,
            fast_takeover: true,
            in_namespaces: false,
        })
        .await
    }

    /// Makes a cluster of these parts.
    pub async fn of(parts: &Parts) -> Self {
        let server = server().expect("FLEETCAL_TEST_POSTGRES names a server: make cluster-smoke");
        let database = fleetcal_postgres::create_for_test(&server).await.unwrap();
        Self::on(&database, parts, None)
    }

    /// Makes a cluster on a server of its own that records the writes, with a line between each
    /// instance and the others that can be cut.
    pub async fn watched(parts: &Parts) -> Self {
        let namespaces = parts.in_namespaces.then(|| Namespaces::new(&parts.names));
        let address = namespaces.as_ref();
        let server = records::server(address.map(|all| all.own_address(Network::Database)));
        let url = server.url("postgres");
        let mut cluster = Self::on(&url, parts, namespaces);
        let migrated = binary::run(["store", "migrate", "--database", &cluster.database]);
        assert!(migrated.status.success(), "{migrated:?}");
        records::watch(&url, &parts.names);
        for (number, &name) in parts.names.iter().enumerate() {
            let router = &cluster.routers[number % cluster.routers.len()];
            let router: SocketAddr = router.trim_start_matches("tcp/").parse().unwrap();
            let lines = match &cluster.namespaces {
                Some(all) => Lines {
                    database: Line::Wire(all.wire(Network::Database, name, server.port())),
                    router: Line::Wire(all.wire(Network::Router, name, router.port())),
                },
                None => Lines {
                    database: Line::Proxy(Proxy::before(server.host()).await),
                    router: Line::Proxy(Proxy::before(router.to_string()).await),
                },
            };
            cluster.lines.insert(name, lines);
        }
        cluster.server = Some(server);
        cluster
    }

    /// Makes a cluster on servers under Patroni, without proxies.
    pub fn under_patroni(patroni: Patroni, parts: &Parts) -> Self {
        let mut cluster = Self::on(&patroni.url(), parts, None);
        let migrated = binary::run(["store", "migrate", "--database", &cluster.database]);
        assert!(migrated.status.success(), "{migrated:?}");
        records::watch(&patroni.primary_url(), &parts.names);
        cluster.patroni = Some(patroni);
        cluster
    }

    fn on(database: &PostgresUrl, parts: &Parts, namespaces: Option<Namespaces>) -> Self {
        let folder = TempDir::new().unwrap();
        let spaces = namespaces.as_ref();
        let http = |&name| {
            let http = spaces.map_or_else(kept_port, |all| all.http(name));
            (name, http)
        };
        let addresses: BTreeMap<_, _> = parts.names.iter().map(http).collect();
        let routers = (0..ROUTERS).map(|_| {
            // A router that is killed finds its port free when it starts again.
            let mut router = kept_port();
            if let Some(all) = spaces {
                router.set_ip(all.own_address(Network::Router));
            }
            format!("tcp/{router}")
        });
        let routers: Vec<_> = routers.collect();
        let mut cluster = Self {
            server: None,
            patroni: None,
            lines: BTreeMap::new(),
            database: database.to_string(),
            program: binary::path(),
            router_processes: Vec::new(),
            between_routers: Vec::new(),
            peers: plaintext_peers(&addresses),
            config: config(parts, folder.path()),
            routers,
            namespaces,
            addresses,
            robots: parts.robots,
            robots_apply: parts.robots_apply,
            folder,
        };
        for number in 0..cluster.routers.len() {
            let router = cluster.router(number);
            cluster.router_processes.push(router);
        }
        for router in &cluster.routers {
            let address = router.trim_start_matches("tcp/");
            wait_for("a router", || TcpStream::connect(address).ok());
        }
        cluster
    }

    fn router(&self, number: usize) -> Process {
        let own = &self.routers[number];
        let others: Vec<_> = match self.between_routers.get(number) {
            Some(line) => vec![format!("tcp/{}", line.address())],
            None => self
                .routers
                .iter()
                .filter(|other| *other != own)
                .cloned()
                .collect(),
        };
        let test = env::current_exe().unwrap();
        let beside = test.ancestors().nth(2).unwrap().join("fleetcal-router");
        let log = self.folder.path().join(format!("router_{number}.log"));
        Process::start(Command::new(beside).arg(own).args(others), log)
    }

    /// Writes a Zenoh configuration of a client of the first of these routers that answers.
    fn client(&self, name: &str, routers: &[String]) -> PathBuf {
        let path = self.folder.path().join(format!("{name}.json5"));
        let config = json!({
            "mode": "client",
            "connect": { "endpoints": routers, "timeout_ms": -1, "exit_on_failure": false },
            "scouting": { "multicast": { "enabled": false }, "gossip": { "enabled": false } },
        });
        fs::write(&path, config.to_string()).unwrap();
        path
    }

    /// Returns the routers of an instance: both, its own first, unless it has a line that can be
    /// cut.
    fn routers_of(&self, name: &str, router: usize) -> Vec<String> {
        if let Some(lines) = self.lines.get(name) {
            return vec![format!("tcp/{}", lines.router.address())];
        }
        let mut both = self.routers.clone();
        both.rotate_left(router);
        both
    }

    /// Ends a router without warning.
    pub fn kill_router(&mut self, router: usize) {
        self.router_processes[router].kill();
    }

    /// Starts a router that was killed.
    pub fn start_router(&mut self, router: usize) {
        self.router_processes[router] = self.router(router);
        let address = self.routers[router].trim_start_matches("tcp/");
        wait_for("a router", || TcpStream::connect(address).ok());
    }

    /// Starts the routers again with lines between them that can be cut.
    pub async fn part_routers(&mut self) -> Vec<Line> {
        let servers = self.routers.iter().rev();
        let servers: Vec<_> = servers
            .map(|other| other.trim_start_matches("tcp/").to_owned())
            .collect();
        for server in servers {
            self.between_routers.push(Proxy::before(server).await);
        }
        for router in 0..self.routers.len() {
            self.kill_router(router);
            self.start_router(router);
        }
        self.between_routers
            .iter()
            .cloned()
            .map(Line::Proxy)
            .collect()
    }

    /// Returns the URL of the database for an instance: by its own line and in its own role.
    fn database_of(&self, name: &str) -> String {
        match (&self.patroni, self.lines.get(name)) {
            (Some(patroni), _) => patroni.url_for(name).to_string(),
            (None, Some(lines)) => {
                let address = lines.database.address();
                // Beyond the loopback an instance expects TLS unless this says otherwise.
                format!("postgres://{name}@{address}/postgres?sslmode=disable")
            }
            (None, None) => self.database.clone(),
        }
    }

    /// Returns the server that has the records now.
    pub fn records(&self) -> PostgresUrl {
        let patroni = self.patroni.as_ref();
        patroni.map_or_else(|| self.database.parse().unwrap(), Patroni::primary_url)
    }

    /// Returns the lines between an instance and the others.
    pub fn lines(&self, name: &str) -> &Lines {
        &self.lines[name]
    }

    /// Returns the address of an instance's API.
    pub fn http(&self, name: &str) -> SocketAddr {
        self.addresses[name]
    }

    /// Starts an instance at a router, with further arguments.
    pub fn spawn(&self, name: &str, router: usize, arguments: &[&str]) -> Process {
        let zenoh = self.client(name, &self.routers_of(name, router));
        let mut command = self.serve(name, &zenoh);
        command.args(["--database", &self.database_of(name)]);
        command.args(arguments);
        Process::start(&mut command, self.folder.path().join(format!("{name}.log")))
    }

    /// Makes the command `fleetcal serve` with a Zenoh configuration and data of its own.
    fn serve(&self, name: &str, zenoh: &Path) -> Command {
        let folder = self.folder.path().join(name);
        fs::create_dir_all(&folder).unwrap();
        let config = folder.join("fleetcal.toml");
        fs::write(&config, format!("[cluster]\n{}{}", self.peers, self.config)).unwrap();
        let mut command = match &self.namespaces {
            Some(all) => {
                let mut command = all.command(name);
                command.arg(&self.program);
                command
            }
            None => Command::new(&self.program),
        };
        command
            .arg("serve")
            .arg("--config")
            .arg(&config)
            .arg("--data")
            .arg(folder.join("data"))
            .arg("-c")
            .arg(zenoh);
        command
    }

    /// Starts a service at the first router with a database of its own and further settings of
    /// Zenoh, and waits until it is ready; returns it with the address of its API and its folder.
    pub fn start_beside(
        &self,
        name: &str,
        settings: &[(&str, Value)],
    ) -> (Process, SocketAddr, PathBuf) {
        let http = free_address();
        let zenoh = self.client(name, &self.routers[..1]);
        let mut config: Value = serde_json::from_slice(&fs::read(&zenoh).unwrap()).unwrap();
        for (key, value) in settings {
            config[*key] = value.clone();
        }
        fs::write(&zenoh, config.to_string()).unwrap();
        let mut command = self.serve(name, &zenoh);
        command.args(["--http", &http.to_string()]);
        let log = self.folder.path().join(format!("{name}.log"));
        let process = Process::start(&mut command, log);
        wait_until_ready(http);
        (process, http, self.folder.path().join(name).join("data"))
    }

    /// Starts a service that has all robots and waits until it is ready.
    pub fn start_alone(&self) -> Process {
        let http = free_address();
        let process = self.spawn("alone", 0, &["--http", &http.to_string()]);
        wait_until_ready(http);
        process
    }

    /// Starts an instance and waits until it is ready.
    pub fn start(&self, name: &'static str, router: usize) -> Instance {
        let http = self.addresses[name];
        let address = http.to_string();
        let process = self.spawn(name, router, &["--instance", name, "--http", &address]);
        wait_until_ready(http);
        let token = self.token(name);
        Instance {
            process,
            name,
            http,
            token,
        }
    }

    fn token(&self, name: &str) -> String {
        self.token_of(&format!("{name}-{}", free_address().port()))
    }

    /// Makes a token of an administrator of this name.
    pub fn token_of(&self, name: &str) -> String {
        token_in(&["--database", &self.database], name)
    }

    /// Drives the robots, which know both routers.
    pub fn drive(&self) -> Process {
        let mut command = Command::new(binary::path());
        command.args(["simulate", "--robots", &self.robots.to_string()]);
        for router in &self.routers {
            command.args(["-e", router]);
        }
        if self.robots_apply {
            command.args(["--service-key", &self.service_key()]);
        }
        Process::start(&mut command, self.folder.path().join("robots.log"))
    }

    /// Returns the public key of the service, from any running instance.
    fn service_key(&self) -> String {
        let mut all = self.addresses.values();
        let answer = all.find_map(|http| http::get(*http, "/api/v1/signing-key", None));
        let key: Value = serde_json::from_str(&answer.unwrap().body).unwrap();
        key["public_key"].as_str().unwrap().to_owned()
    }

    /// Returns a folder for the files of a test.
    pub fn folder(&self) -> &Path {
        self.folder.path()
    }

    /// Returns the URL of the database.
    pub fn database(&self) -> &str {
        &self.database
    }
}

/// Writes the configuration of peers at their own APIs, without TLS.
fn plaintext_peers(addresses: &BTreeMap<&str, SocketAddr>) -> String {
    let peers = addresses
        .iter()
        .map(|(name, http)| format!("{name} = \"http://{http}\""));
    let peers: Vec<_> = peers.collect();
    let peers = peers.join(", ");
    format!("plaintext_peers = true\npeers = {{ {peers} }}\n")
}

/// Writes the configuration of every instance of a cluster with these parts, from the rest of
/// `[cluster]` on.
fn config(parts: &Parts, folder: &Path) -> String {
    let key = folder.join("signing.key");
    let entry = |one: &SimulatedRobot| {
        let model = serde_json::to_value(one.model()).unwrap();
        let (id, wheelbase_m) = (&one.id, one.wheelbase_m());
        format!("[[robot]]\nid = \"{id}\"\nmodel = {model}\nwheelbase_m = {wheelbase_m}\n\n")
    };
    let simulated = simulated_robots(parts.robots, 1).unwrap();
    let parked = (1..=parts.parked).map(|number| {
        format!("[[robot]]\nid = \"parked_{number}\"\nmodel = \"bicycle\"\nwheelbase_m = 1.2\n\n")
    });
    format!(
        "fast_takeover = {}\nsigning_key = {:?}\n\n{}{}",
        parts.fast_takeover,
        key.display().to_string(),
        simulated.iter().map(entry).collect::<String>(),
        parked.collect::<String>(),
    )
}

/// Makes a token of an administrator of this name in a database.
pub fn token_in(place: &[&str], name: &str) -> String {
    let made = Command::new(binary::path())
        .args(["token", "create"])
        .args(place)
        .args(["--role", "admin", "--name", name])
        .output()
        .unwrap();
    let errors = String::from_utf8_lossy(&made.stderr);
    assert!(made.status.success(), "{errors}");
    String::from_utf8(made.stdout)
        .unwrap()
        .trim_end()
        .to_owned()
}

/// Returns an unused loopback address that stays free while its instance is away: the system never
/// assigns ports this low by itself.
pub fn kept_port() -> SocketAddr {
    static NEXT: AtomicU16 = AtomicU16::new(0);
    let first = 16_000 + (std::process::id() % 800) as u16 * 16;
    let ports = std::iter::from_fn(|| Some(first + NEXT.fetch_add(1, Ordering::Relaxed)));
    let free = ports.map(|port| SocketAddr::from(([127, 0, 0, 1], port)));
    let mut free = free.filter(|address| TcpListener::bind(address).is_ok());
    free.next().unwrap()
}

fn wait_until_ready(http: SocketAddr) {
    wait_for("readiness", || {
        http::get(http, "/readyz", None).filter(|answer| answer.status == 200)
    });
}
