//! Three servers of PostgreSQL under Patroni and etcd, on this machine's loopback, set as
//! `examples/deploy/cluster/patroni.yml` sets them.

use std::fs;
use std::net::SocketAddr;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::time::{Duration, Instant};

use fleetcal_contract::own_server::{
    as_server_user, own_by_server_user, program_folder, psql, try_psql, url_of,
};
use fleetcal_ports::free_address;
use fleetcal_store::database_url::PostgresUrl;
use fleetcal_tests::http;
use fleetcal_tests::service::{now, wait_for};
use tempfile::TempDir;

use crate::process::Process;
use crate::processes::{parents, signal};

/// Query for the number of standbys that stream, and have replayed all but the last megabyte of the
/// primary's writes.
const FOLLOWING: &str = "SELECT count(*) FROM pg_stat_replication WHERE state = 'streaming'
    AND pg_wal_lsn_diff(pg_current_wal_lsn(), replay_lsn) < 1000000";

/// Recommended settings.
const EXAMPLE: &str = include_str!("../../examples/deploy/cluster/patroni.yml");
const NAMES: [&str; 3] = ["n1", "n2", "n3"];
/// Text before the settings that all servers share.
const PARAMETERS: &str = "      parameters:\n";
/// Owner of the records.
const OWNER: &str = "fleetcal";

/// Time within which a Patroni with the example's `loop_wait` has begun its next cycle.
const CYCLE: Duration = Duration::from_secs(3);

/// One server and the Patroni that runs it.
#[derive(Debug)]
struct Node {
    name: &'static str,
    folder: PathBuf,
    postgres: SocketAddr,
    rest: SocketAddr,
    patroni: Option<Process>,
}

/// Cluster of PostgreSQL servers under Patroni; see the module.
#[derive(Debug)]
pub struct Patroni {
    folder: TempDir,
    program: PathBuf,
    etcd_client: SocketAddr,
    etcd_peer: SocketAddr,
    etcd: Option<Process>,
    nodes: Vec<Node>,
}

impl Patroni {
    /// Starts a cluster with a primary and a standby that commits with it. `program` is a
    /// `patroni`.
    pub fn start(program: &Path) -> Self {
        let folder = tempfile::tempdir().unwrap();
        own_by_server_user(folder.path());
        let node = |name: &'static str| Node {
            name,
            folder: folder.path().join(name),
            postgres: free_address(),
            rest: free_address(),
            patroni: None,
        };
        let mut patroni = Self {
            nodes: NAMES.map(node).into(),
            program: program.to_owned(),
            etcd_client: free_address(),
            etcd_peer: free_address(),
            etcd: None,
            folder,
        };
        patroni.start_etcd();
        for number in 0..patroni.nodes.len() {
            patroni.start_node(number);
        }
        patroni.wait_until_whole();
        psql(
            &patroni.primary().as_superuser(),
            &format!("CREATE ROLE {OWNER} SUPERUSER LOGIN"),
        );
        patroni
    }

    /// Returns the versions of Patroni and etcd.
    pub fn versions(&self) -> String {
        let said = |program: &Path, argument: &str| {
            let output = Command::new(program).arg(argument).output().unwrap();
            let text = String::from_utf8_lossy(&output.stdout).into_owned();
            text.lines().next().unwrap_or_default().trim().to_owned()
        };
        let (own, etcd) = (
            said(&self.program, "--version"),
            said(Path::new("etcd"), "--version"),
        );
        format!("{own}; {etcd}")
    }

    /// Returns the URL of the database on all of them, for a role.
    pub fn url_for(&self, role: &str) -> PostgresUrl {
        let hosts: Vec<_> = self
            .nodes
            .iter()
            .map(|node| node.postgres.to_string())
            .collect();
        let hosts: Vec<_> = hosts.iter().map(String::as_str).collect();
        url_of(&hosts, role, "postgres")
    }

    /// Returns the URL of the database on all of them, for the owner.
    pub fn url(&self) -> PostgresUrl {
        self.url_for(OWNER)
    }

    /// Returns the URL of the database on the present primary.
    pub fn primary_url(&self) -> PostgresUrl {
        url_of(&[&self.primary().postgres.to_string()], OWNER, "postgres")
    }

    /// Returns the name of the present primary.
    pub fn primary_name(&self) -> &'static str {
        self.primary().name
    }

    fn primary(&self) -> &Node {
        let mut found = None;
        wait_for("a primary", || {
            found = self.nodes.iter().position(Node::can_be_written);
            found.map(drop)
        });
        &self.nodes[found.unwrap()]
    }

    /// Waits until a server other than this one is the primary; returns the time of that
    /// observation.
    pub fn next_primary(&self, former: &str) -> Instant {
        wait_for("the next primary", || {
            let mut others = self.nodes.iter().filter(|node| node.name != former);
            others.any(Node::can_be_written).then(now)
        })
    }

    /// Waits until some server is the primary; returns the time of that observation.
    pub fn any_primary(&self) -> Instant {
        wait_for("a primary", || {
            self.nodes.iter().any(Node::can_be_written).then(now)
        })
    }

    /// Waits until there is a primary, the others have replayed nearly all of its writes, and one
    /// of them commits with it. A server that is being rewound is a replica to Patroni already.
    pub fn wait_until_whole(&self) {
        wait_for("a whole cluster", || self.is_whole().then_some(()));
    }

    /// True if the cluster is whole in this sense.
    pub fn is_whole(&self) -> bool {
        let count = |path: &str| self.nodes.iter().filter(|node| node.is(path)).count();
        if count("/primary") != 1 || count("/replica") != 2 || count("/sync") != 1 {
            return false;
        }
        let following = try_psql(&self.primary().as_superuser(), FOLLOWING);
        following.is_some_and(|following| following.trim() == "2")
    }

    /// Moves the primary to another server in order.
    pub fn switch_over(&self) {
        let primary = self.primary();
        let body = serde_json::json!({"leader": primary.name}).to_string();
        let answer = http::send(primary.rest, "POST /switchover", None, Some(("", &body)));
        let answer = answer.unwrap();
        assert!(answer.status < 300, "{}: {}", answer.status, answer.body);
    }

    /// Kills a server and its Patroni, as the loss of their machine does.
    pub fn kill(&mut self, name: &str) {
        let number = self.number(name);
        let node = &mut self.nodes[number];
        signal("KILL", &node.processes());
        node.patroni = None;
        node.wait_until_gone();
    }

    /// Kills the postmaster alone.
    pub fn kill_postmaster(&self, name: &str) {
        let node = &self.nodes[self.number(name)];
        signal("KILL", node.postmaster().as_slice());
    }

    /// Stops a server and its Patroni where they are.
    pub fn freeze(&self, name: &str) {
        signal("STOP", &self.nodes[self.number(name)].processes());
    }

    /// Resumes them.
    pub fn thaw(&self, name: &str) {
        signal("CONT", &self.nodes[self.number(name)].processes());
    }

    /// Stops the primary while its Patroni has read the leader and waits for its server, which it
    /// queries before it renews its lock, and resumes both when another server has been the primary
    /// for a while; returns that time.
    pub fn freeze_before_renewal(&self, lasts_on: Duration) -> Instant {
        let former = self.primary_name();
        let node = &self.nodes[self.number(former)];
        let server: Vec<u32> = node.postmaster().into_iter().collect();
        signal("STOP", &with_descendants(server));
        std::thread::sleep(CYCLE);
        self.freeze(former);
        self.next_primary(former);
        std::thread::sleep(lasts_on);
        self.thaw(former);
        now()
    }

    /// Starts a server that was killed.
    pub fn start_again(&mut self, name: &str) {
        self.start_node(self.number(name));
    }

    /// Kills etcd.
    pub fn kill_etcd(&mut self) {
        self.etcd.take().unwrap().kill();
    }

    /// Starts etcd, with its former data.
    pub fn start_etcd(&mut self) {
        let (client, peer) = (self.etcd_client, self.etcd_peer);
        let mut command = Command::new("etcd");
        command
            .arg("--data-dir")
            .arg(self.folder.path().join("etcd"));
        for (option, value) in [
            ("--listen-client-urls", client.to_string()),
            ("--advertise-client-urls", client.to_string()),
            ("--listen-peer-urls", peer.to_string()),
            ("--initial-advertise-peer-urls", peer.to_string()),
        ] {
            command.arg(option).arg(format!("http://{value}"));
        }
        command
            .arg("--initial-cluster")
            .arg(format!("default=http://{peer}"));
        self.etcd = Some(Process::start(
            &mut command,
            self.folder.path().join("etcd.log"),
        ));
    }

    fn number(&self, name: &str) -> usize {
        self.nodes
            .iter()
            .position(|node| node.name == name)
            .unwrap()
    }

    fn start_node(&mut self, number: usize) {
        let config = self.config(&self.nodes[number]);
        let node = &mut self.nodes[number];
        if !node.folder.exists() {
            fs::create_dir(&node.folder).unwrap();
            own_by_server_user(&node.folder);
        }
        let file = node.folder.join("patroni.yml");
        fs::write(&file, config).unwrap();
        let mut command = as_server_user(&self.program);
        command.arg(&file).current_dir(&node.folder);
        let log = self.folder.path().join(format!("{}.log", node.name));
        node.patroni = Some(Process::start(&mut command, log));
    }

    /// Writes the example's settings of the cluster, and this server's addresses.
    fn config(&self, node: &Node) -> String {
        let (_, from_bootstrap) = EXAMPLE.split_once("\nbootstrap:\n").unwrap();
        let (bootstrap, _) = from_bootstrap.split_once("\npostgresql:\n").unwrap();
        // All servers know when each transaction was committed, which Patroni takes here alone.
        let known = format!("{PARAMETERS}        track_commit_timestamp: 'on'\n");
        let bootstrap = bootstrap.replace(PARAMETERS, &known);
        let Node {
            name,
            folder,
            postgres,
            rest,
            ..
        } = node;
        let (etcd, programs) = (self.etcd_client, program_folder());
        format!(
            "scope: fleetcal\nname: {name}\n\
             restapi: {{ listen: '{rest}', connect_address: '{rest}' }}\n\
             etcd3: {{ hosts: '{etcd}' }}\n\
             bootstrap:\n{bootstrap}\n\
             postgresql:\n  listen: '{postgres}'\n  connect_address: '{postgres}'\n  \
             data_dir: {data}\n  bin_dir: {programs}\n  pgpass: {pgpass}\n  \
             authentication:\n    \
             superuser: {{ username: postgres, password: one }}\n    \
             replication: {{ username: replicator, password: two }}\n    \
             rewind: {{ username: rewinder, password: three }}\n  \
             parameters: {{ unix_socket_directories: {folder}, fsync: 'off' }}\n  \
             pg_hba:\n  - local all all trust\n  - host all all 127.0.0.1/32 trust\n  \
             - host replication all 127.0.0.1/32 trust\n",
            data = node.data().display(),
            programs = programs.display(),
            pgpass = folder.join("pgpass").display(),
            folder = folder.display(),
        )
    }
}

impl Drop for Patroni {
    fn drop(&mut self) {
        for node in &mut self.nodes {
            signal("CONT", &node.processes());
            signal("KILL", &node.processes());
            node.patroni = None;
        }
    }
}

impl Node {
    fn data(&self) -> PathBuf {
        self.folder.join("data")
    }

    /// True if it reports itself as the primary.
    fn can_be_written(&self) -> bool {
        let told = try_psql(&self.as_superuser(), "SELECT NOT pg_is_in_recovery()");
        told.is_some_and(|told| told.trim() == "t")
    }

    /// Returns the URL of its database, for the role that made it.
    fn as_superuser(&self) -> PostgresUrl {
        url_of(&[&self.postgres.to_string()], "postgres", "postgres")
    }

    /// True if Patroni reports the server in this state.
    fn is(&self, path: &str) -> bool {
        http::get(self.rest, path, None).is_some_and(|answer| answer.status == 200)
    }

    fn postmaster(&self) -> Option<u32> {
        let text = fs::read_to_string(self.data().join("postmaster.pid")).ok()?;
        text.lines().next()?.trim().parse().ok()
    }

    /// Returns Patroni, the postmaster, and their descendants.
    fn processes(&self) -> Vec<u32> {
        let own = self.patroni.as_ref().map(Process::id);
        with_descendants(own.into_iter().chain(self.postmaster()).collect())
    }

    fn wait_until_gone(&self) {
        let left = self
            .postmaster()
            .map(|pid| Path::new("/proc").join(pid.to_string()));
        wait_for("the end of a server", || {
            let is_there = left.as_ref().is_some_and(|path| path.exists());
            (!is_there).then_some(())
        });
    }
}

/// Adds the descendants of processes.
fn with_descendants(mut all: Vec<u32>) -> Vec<u32> {
    let parents = parents();
    let mut at = 0;
    while at < all.len() {
        let children = parents.iter().filter(|(_, parent)| *parent == all[at]);
        let children = children.map(|(child, _)| *child);
        let new: Vec<_> = children.filter(|child| !all.contains(child)).collect();
        all.extend(new);
        at += 1;
    }
    all
}
