//! A router before the service: the binary that `FLEETCAL_ZENOHD` names, else a Zenoh session in
//! router mode, which is what `zenohd` opens.

use std::env;
use std::fs::File;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};

use fleetcal_ports::free_address;
use fleetcal_tests::service::Service;
use serde_json::json;
use tempfile::TempDir;
use zenoh::{Config, Session, Wait};

use super::lists::{generated, password, passwords, received, service_client, wait_until_received};
use super::robot;

/// A router that runs.
pub enum Router {
    /// `zenohd`, or another process in its place, and its log.
    Process(Child, PathBuf),
    /// A session of this process.
    Session(Session),
}

/// Returns the threads of a router, as in the example.
fn deployed_runtime() -> &'static str {
    let unit = include_str!("../../examples/deploy/cluster/zenohd.service");
    let mut lines = unit.lines();
    let value = lines.find_map(|line| line.strip_prefix("Environment=\"ZENOH_RUNTIME="));
    value.unwrap().trim_end_matches('"')
}

impl Router {
    /// Starts a router with a native configuration.
    pub async fn start(config: &Path) -> Self {
        if env::var_os("FLEETCAL_ZENOHD").is_some() {
            return Self::start_process(config);
        }
        let config = Config::from_file(config).unwrap();
        let opened = tokio::task::spawn_blocking(move || zenoh::open(config).wait()).await;
        Self::Session(opened.unwrap().unwrap())
    }

    /// Starts a router that shares no process with the test: `zenohd`, or its replacement.
    pub fn start_process(config: &Path) -> Self {
        let zenohd = env::var_os("FLEETCAL_ZENOHD");
        let zenohd = zenohd.unwrap_or_else(|| env!("CARGO_BIN_EXE_fleetcal-router").into());
        let log = config.with_extension("log");
        let started = Command::new(zenohd)
            .arg("-c")
            .arg(config)
            .env("ZENOH_RUNTIME", deployed_runtime())
            .stdout(Stdio::null())
            .stderr(File::create(&log).unwrap())
            .spawn();
        Self::Process(started.unwrap(), log)
    }

    /// Returns its process.
    pub fn pid(&self) -> u32 {
        match self {
            Self::Process(child, _) => child.id(),
            Self::Session(_) => std::process::id(),
        }
    }

    /// Asserts that it has not ended by itself, with its log.
    pub fn assert_runs(&mut self) {
        if let Self::Process(child, log) = self {
            let ended = child.try_wait().unwrap();
            let said = std::fs::read_to_string(log).unwrap_or_default();
            assert!(ended.is_none(), "the router has ended: {ended:?}: {said}");
        }
    }

    /// Ends it.
    pub async fn stop(mut self) {
        match &mut self {
            Self::Process(child, _) => {
                child.kill().unwrap();
                child.wait().unwrap();
            }
            Self::Session(session) => session.close().await.unwrap(),
        }
    }
}

impl Drop for Router {
    fn drop(&mut self) {
        if let Self::Process(child, _) = self
            && child.kill().is_ok()
            && child.wait().is_err()
        {
            eprintln!("zenohd {} was not ended", child.id());
        }
    }
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn behind_a_router_with_the_generated_list_the_service_works_the_same() {
    let folder = TempDir::new().unwrap();
    let router_address = free_address();
    let endpoint = format!("tcp/{router_address}");
    let passwords = passwords(folder.path(), &["robot_a", "robot_b", "fleetcal"]);
    let config = generated(
        folder.path(),
        &[
            "--robot",
            "robot_a",
            "--robot",
            "robot_b",
            "--service",
            "fleetcal",
            "--identity",
            "user",
            "--passwords",
            &passwords,
            "--listen",
            &endpoint,
        ],
    );
    let router = Router::start(Path::new(&config)).await;
    let own = folder.path().join("service.json5");
    std::fs::write(&own, service_client(&endpoint, "fleetcal").to_string()).unwrap();
    let robots = ["robot_a", "robot_b"];
    let entry = |id| format!("[[robot]]\nid = \"{id}\"\nmodel = \"bicycle\"\nwheelbase_m = 1.2\n");
    let known: String = robots.into_iter().map(entry).collect();
    let service = Service::start_on(router_address, &known, &["-c", own.to_str().unwrap()]);

    let client = |name| robot::open(robot::with_password(&endpoint, name, &password(name)));
    let a = client("robot_a").await.unwrap();
    let token = a.liveliness().declare_token("fleet/@alive/robot_a").await;
    let token = token.unwrap();
    let estimates = a
        .declare_subscriber("fleet/robot_a/estimate")
        .await
        .unwrap();
    robot::send(&robot::stream(&a, "robot_b").await, 10_000).await;
    robot::send(&robot::stream(&a, "robot_a").await, 500).await;
    wait_until_received(&service, "robot_a", 500);
    assert_eq!(received(&service, "robot_b"), 0, "of 10,000 forged samples");
    assert_eq!(robot::answers(&a, "fleet/robot_a/progress").await, 1);
    assert_eq!(robot::answers(&a, "fleet/robot_b/progress").await, 0);
    assert_eq!(service.robot("robot_a")["alive"], json!(true));
    // The service's estimate comes back through the router.
    let estimate = tokio::time::timeout(std::time::Duration::from_secs(30), estimates.recv_async());
    assert!(estimate.await.is_ok(), "no estimate came back");
    token.undeclare().await.unwrap();
    router.stop().await;
}
