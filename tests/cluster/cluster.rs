//! Routers, instances and robots on this machine's loopback, as processes of their own.

use std::collections::BTreeMap;
use std::env;
use std::fs::{self, File};
use std::net::{SocketAddr, TcpStream};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};

use fleetcal_contract::server;
use fleetcal_robot::fleet::{SimulatedRobot, simulated_robots};
use fleetcal_tests::service::{free_port, wait_for};
use fleetcal_tests::{binary, http};
use serde_json::{Value, json};
use tempfile::TempDir;

/// A process that ends with this value.
#[derive(Debug)]
pub struct Process {
    child: Child,
    log: PathBuf,
}

impl Process {
    fn start(command: &mut Command, log: PathBuf) -> Self {
        let file = File::options()
            .create(true)
            .append(true)
            .open(&log)
            .unwrap();
        let child = command
            .stdin(Stdio::null())
            .stdout(file.try_clone().unwrap())
            .stderr(file)
            .spawn()
            .unwrap();
        Self { child, log }
    }

    /// Sends it a signal by its name, such as `STOP`.
    pub fn signal(&self, name: &str) {
        let sent = Command::new("kill")
            .args(["-s", name, &self.child.id().to_string()])
            .status();
        assert!(sent.unwrap().success(), "SIG{name}");
    }

    /// Ends it without warning.
    pub fn kill(&mut self) {
        self.child.kill().unwrap();
        self.child.wait().unwrap();
    }

    /// Waits until it has ended by itself; gives its exit status.
    pub fn ended(&mut self) -> Option<i32> {
        wait_for("its end", || self.child.try_wait().unwrap()).code()
    }

    /// What it has said.
    pub fn said(&self) -> String {
        fs::read_to_string(&self.log).unwrap_or_default()
    }
}

impl Drop for Process {
    fn drop(&mut self) {
        if matches!(self.child.try_wait(), Ok(None)) && self.child.kill().is_ok() {
            drop(self.child.wait());
        }
        if std::thread::panicking() {
            let said = self.said();
            let lines: Vec<_> = said.lines().collect();
            let last = &lines[lines.len().saturating_sub(40)..];
            eprintln!("--- {}\n{}", self.log.display(), last.join("\n"));
        }
    }
}

/// One instance.
#[derive(Debug)]
pub struct Instance {
    /// Its process.
    pub process: Process,
    /// Its name.
    pub name: &'static str,
    /// Where its API is.
    pub http: SocketAddr,
    token: String,
}

impl Instance {
    /// What it lets an administrator in with.
    pub fn token(&self) -> &str {
        &self.token
    }

    /// The answer of `GET path` with a token of an administrator; `None` when nobody answers, or
    /// not with 200.
    pub fn try_get(&self, path: &str) -> Option<Value> {
        let answer = http::get(self.http, path, Some(&self.token));
        let answer = answer.filter(|answer| answer.status == 200)?;
        serde_json::from_str(&answer.body).ok()
    }

    /// The same of what is there.
    pub fn get(&self, path: &str) -> Value {
        let answer = http::get(self.http, path, Some(&self.token)).unwrap();
        let (status, body) = (answer.status, answer.body);
        assert_eq!(status, 200, "{}: {path}: {body}", self.name);
        serde_json::from_str(&body).unwrap()
    }

    /// How many robots each instance has, as this one sees it.
    pub fn shares(&self) -> Option<BTreeMap<String, u64>> {
        let cluster = self.try_get("/api/v1/cluster")?;
        let instances = cluster["instances"].as_array()?;
        let share = |one: &Value| Some((one["name"].as_str()?.to_owned(), one["robots"].as_u64()?));
        instances.iter().map(share).collect()
    }
}

/// A cluster.
#[derive(Debug)]
pub struct Cluster {
    folder: TempDir,
    database: String,
    /// What is started as an instance.
    pub program: PathBuf,
    /// Where its routers listen.
    pub routers: Vec<String>,
    router_processes: Vec<Process>,
    config: String,
    addresses: BTreeMap<&'static str, SocketAddr>,
    robots: usize,
}

impl Cluster {
    /// A database and two routers; nobody serves yet. `names` are the instances that there may be.
    pub async fn new(names: &[&'static str], robots: usize) -> Self {
        let server = server().expect("FLEETCAL_TEST_POSTGRES names a server: make cluster-smoke");
        let database = fleetcal_postgres::create_for_test(&server).await.unwrap();
        let folder = TempDir::new().unwrap();
        let addresses: BTreeMap<_, _> = names.iter().map(|&name| (name, free_port())).collect();
        let entry = |one: &SimulatedRobot| {
            let model = serde_json::to_value(one.model()).unwrap();
            let (id, wheelbase_m) = (&one.id, one.wheelbase_m());
            format!("[[robot]]\nid = \"{id}\"\nmodel = {model}\nwheelbase_m = {wheelbase_m}\n\n")
        };
        let simulated = simulated_robots(robots, 1).unwrap();
        let peers = addresses
            .iter()
            .map(|(name, http)| format!("{name} = \"http://{http}\""));
        let peers: Vec<_> = peers.collect();
        let key = folder.path().join("signing.key");
        let config = format!(
            "[cluster]\nplaintext_peers = true\npeers = {{ {} }}\nsigning_key = {:?}\n\n{}",
            peers.join(", "),
            key.display().to_string(),
            simulated.iter().map(entry).collect::<String>(),
        );
        let mut cluster = Self {
            database: database.to_string(),
            program: binary::path().into(),
            routers: (0..2).map(|_| format!("tcp/{}", free_port())).collect(),
            router_processes: Vec::new(),
            config,
            addresses,
            robots,
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
        let others = self.routers.iter().filter(|other| *other != own);
        let test = env::current_exe().unwrap();
        let beside = test.ancestors().nth(2).unwrap().join("fleetcal-router");
        let log = self.folder.path().join(format!("router_{number}.log"));
        Process::start(Command::new(beside).arg(own).args(others), log)
    }

    /// A Zenoh configuration of a client of one router.
    fn client(&self, name: &str, router: &str) -> PathBuf {
        let path = self.folder.path().join(format!("{name}.json5"));
        let config = json!({
            "mode": "client",
            "connect": { "endpoints": [router], "timeout_ms": -1, "exit_on_failure": false },
            "scouting": { "multicast": { "enabled": false }, "gossip": { "enabled": false } },
        });
        fs::write(&path, config.to_string()).unwrap();
        path
    }

    /// Starts an instance at a router, with further arguments.
    pub fn spawn(&self, name: &str, router: usize, arguments: &[&str]) -> Process {
        let folder = self.folder.path().join(name);
        fs::create_dir_all(&folder).unwrap();
        let config = folder.join("fleetcal.toml");
        fs::write(&config, &self.config).unwrap();
        let mut command = Command::new(&self.program);
        command
            .arg("serve")
            .arg("--config")
            .arg(&config)
            .arg("--data")
            .arg(folder.join("data"))
            .arg("-c")
            .arg(self.client(name, &self.routers[router]))
            .args(["--database", &self.database])
            .args(arguments);
        Process::start(&mut command, self.folder.path().join(format!("{name}.log")))
    }

    /// Starts an instance and waits until it is ready.
    pub fn start(&self, name: &'static str, router: usize) -> Instance {
        let http = self.addresses[name];
        let address = http.to_string();
        let process = self.spawn(name, router, &["--instance", name, "--http", &address]);
        wait_for("readiness", || {
            http::get(http, "/readyz", None).filter(|answer| answer.status == 200)
        });
        let token = self.token(name);
        Instance {
            process,
            name,
            http,
            token,
        }
    }

    fn token(&self, name: &str) -> String {
        let made = Command::new(binary::path())
            .args(["token", "create", "--database", &self.database])
            .args(["--role", "admin", "--name"])
            .arg(format!("{name}-{}", free_port().port()))
            .output()
            .unwrap();
        let errors = String::from_utf8_lossy(&made.stderr);
        assert!(made.status.success(), "{errors}");
        String::from_utf8(made.stdout)
            .unwrap()
            .trim_end()
            .to_owned()
    }

    /// Drives the robots, which know both routers.
    pub fn drive(&self) -> Process {
        let mut command = Command::new(binary::path());
        command.args(["simulate", "--robots", &self.robots.to_string()]);
        for router in &self.routers {
            command.args(["-e", router]);
        }
        Process::start(&mut command, self.folder.path().join("robots.log"))
    }

    /// A folder for what a test writes.
    pub fn folder(&self) -> &Path {
        self.folder.path()
    }

    /// Where the records are.
    pub fn database(&self) -> &str {
        &self.database
    }
}
