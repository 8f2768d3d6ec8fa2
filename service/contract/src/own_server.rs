//! Servers: the one that is named, and those that a test starts to stop or kill them.

use std::fs;
use std::io::{BufRead as _, BufReader, Write as _};
use std::net::IpAddr;
use std::path::{Path, PathBuf};
use std::process::{Child, ChildStdout, Command, Output, Stdio};
use std::time::Duration;

use fleetcal_ports::free_address;
use fleetcal_postgres::PostgresSetup;
use fleetcal_store::database_url::PostgresUrl;
use tempfile::TempDir;

use crate::database::{SERVER, server};

/// Role that owns everything on a server of a test.
const OWNER: &str = "fleetcal";

/// Returns the server that [`SERVER`] names.
pub fn named() -> PostgresUrl {
    server().unwrap_or_else(|| {
        panic!("{SERVER} is not set, expected the URL of a PostgreSQL that may be filled with databases")
    })
}

/// Reads a number that the environment may set, such as a number of repetitions.
pub fn number(name: &str, default: usize) -> usize {
    std::env::var(name).map_or(default, |text| text.parse().unwrap())
}

/// Makes the setup of a database without a password.
pub fn setup(url: &PostgresUrl) -> PostgresSetup {
    PostgresSetup {
        url: url.clone(),
        password_file: None,
    }
}

/// Runs statements on the first server of a URL by psql; returns the output.
pub fn psql(url: &PostgresUrl, sql: &str) -> String {
    let text = url.to_string();
    // psql reads the same URL; what is after `?` are parameters that it knows.
    done(program("psql").args(["--dbname", &text, "-XAtqc", sql]))
}

/// Runs statements likewise; returns `None` if the server does not answer within 2 s, or refuses.
pub fn try_psql(url: &PostgresUrl, sql: &str) -> Option<String> {
    let mut command = program("psql");
    command.env("PGCONNECT_TIMEOUT", "2");
    command.args(["--dbname", &url.to_string(), "-XAtqc", sql]);
    let output = command.output().ok()?;
    let told = String::from_utf8(output.stdout).ok()?;
    output.status.success().then_some(told)
}

/// A connection of psql beside those of the test. Its uncommitted statements are undone on drop.
#[derive(Debug)]
pub struct Beside {
    psql: Child,
    told: BufReader<ChildStdout>,
}

impl Beside {
    /// Connects, and runs statements.
    pub fn run(url: &PostgresUrl, sql: &str) -> Self {
        let mut psql = program("psql");
        psql.args(["--dbname", &url.to_string(), "-XAtq"]);
        psql.stdin(Stdio::piped()).stdout(Stdio::piped());
        let mut psql = psql.spawn().unwrap();
        let told = BufReader::new(psql.stdout.take().unwrap());
        let mut beside = Self { psql, told };
        beside.go_on(sql);
        beside
    }

    /// Runs more statements.
    pub fn go_on(&mut self, sql: &str) {
        let asked = format!("{sql};\n\\echo it is done\n");
        let statements = self.psql.stdin.as_mut().unwrap();
        statements.write_all(asked.as_bytes()).unwrap();
        let mut line = String::new();
        while line.trim() != "it is done" {
            line.clear();
            let read = self.told.read_line(&mut line).unwrap();
            assert!(read > 0, "psql has ended");
        }
    }
}

impl Drop for Beside {
    fn drop(&mut self) {
        self.psql.kill().unwrap();
        self.psql.wait().unwrap();
    }
}

/// Copies a database into a new one on the same server as described in `docs/postgresql.md`.
pub fn dump_and_restore(from: &PostgresUrl, to: &PostgresUrl) {
    let file = tempfile::NamedTempFile::new().unwrap();
    let mut dump = program("pg_dump");
    dump.args(["--dbname", &from.to_string(), "--format=custom", "--file"]);
    done(dump.arg(file.path()));
    let mut restore = program("pg_restore");
    restore.args(["--dbname", &to.to_string(), "--no-owner", "--exit-on-error"]);
    done(restore.arg(file.path()));
}

/// Runs a statement that has to be refused; returns the reason.
pub fn psql_refused(url: &PostgresUrl, sql: &str) -> String {
    let text = url.to_string();
    let mut refused = program("psql");
    refused.args(["--dbname", &text, "-XAtqc", sql]);
    let output = refused.output().unwrap();
    assert!(!output.status.success(), "{sql} was done");
    told(&output)
}

/// A server of a test, stopped on drop.
#[derive(Debug)]
pub struct OwnServer {
    folder: TempDir,
    port: u16,
    addresses: Vec<IpAddr>,
}

impl OwnServer {
    /// Starts a new server. `authentication` is the value of `initdb --auth-host`.
    pub fn start_new(authentication: &str) -> Self {
        named();
        let server = Self::prepared();
        let password = server.folder.path().join("password");
        fs::write(&password, "secret of the test\n").unwrap();
        let mut initdb = server.program("initdb");
        initdb.args(["--username", OWNER, "--encoding", "UTF8"]);
        initdb.args(["--auth-local", "trust", "--auth-host", authentication]);
        // What tests order by is not what a person's language orders by.
        initdb.args([
            "--locale-provider",
            "icu",
            "--icu-locale",
            "en-US",
            "--locale",
            "C.UTF-8",
        ]);
        initdb.arg("--pwfile").arg(&password).arg("--no-sync");
        done(initdb.arg("--pgdata").arg(server.data()));
        server.start();
        server
    }

    /// Starts a standby of a server.
    pub fn standby_of(primary: &Self) -> Self {
        let server = Self::prepared();
        let mut copy = server.program("pg_basebackup");
        copy.args(["--host", "127.0.0.1", "--port", &primary.port.to_string()]);
        copy.args([
            "--username",
            OWNER,
            "--write-recovery-conf",
            "--checkpoint=fast",
        ]);
        done(copy.arg("--no-sync").arg("--pgdata").arg(server.data()));
        server.start();
        server
    }

    fn prepared() -> Self {
        let folder = tempfile::tempdir().unwrap();
        own_by_server_user(folder.path());
        let address = free_address();
        Self {
            folder,
            port: address.port(),
            addresses: vec![address.ip()],
        }
    }

    /// Listens on a further address of this machine from the next start on, without authentication
    /// there.
    pub fn listen_at(&mut self, address: IpAddr) {
        self.addresses.push(address);
        let access = self.data().join("pg_hba.conf");
        let mut access = fs::File::options().append(true).open(access).unwrap();
        writeln!(access, "host all all {address}/24 trust").unwrap();
    }

    fn data(&self) -> PathBuf {
        self.folder.path().join("data")
    }

    /// Makes a command of a PostgreSQL program as the user who may run a server.
    fn program(&self, name: &str) -> Command {
        let mut command = as_server_user(&path_of(name));
        command.current_dir(self.folder.path());
        command
    }

    fn pg_ctl(&self, arguments: &[&str]) -> Command {
        let mut command = self.program("pg_ctl");
        command.arg("--pgdata").arg(self.data()).args(arguments);
        command
    }

    /// Starts it and waits until it accepts connections.
    pub fn start(&self) {
        let addresses: Vec<_> = self.addresses.iter().map(IpAddr::to_string).collect();
        let options = format!(
            "-p {} -k {} -c listen_addresses={} -c max_connections=200 -c fsync=off",
            self.port,
            self.folder.path().display(),
            addresses.join(",")
        );
        let log = self.folder.path().join("log");
        let log = log.to_str().unwrap();
        // The processes of a killed postmaster hold its memory for a moment.
        let mut last = None;
        for _ in 0..100 {
            let mut start = self.pg_ctl(&["--wait", "--log", log, "-o", &options, "start"]);
            let output = start.output().unwrap();
            if output.status.success() {
                return;
            }
            last = Some(output);
            std::thread::sleep(Duration::from_millis(100));
        }
        panic!("{}", last.as_ref().map(told).unwrap_or_default());
    }

    /// Stops it.
    pub fn stop(&self) {
        done(&mut self.pg_ctl(&["--wait", "--mode=fast", "stop"]));
    }

    /// Waits until a standby has received everything from its primary.
    pub fn wait_until_equal(&self, primary: &Self) {
        let sql = "SELECT pg_current_wal_flush_lsn()";
        let written = psql(&primary.url("postgres"), sql);
        let sql = format!("SELECT pg_last_wal_replay_lsn() >= '{}'", written.trim());
        for _ in 0..300 {
            if psql(&self.url("postgres"), &sql).trim() == "t" {
                return;
            }
            std::thread::sleep(Duration::from_millis(100));
        }
        panic!("the standby stays behind");
    }

    /// Promotes a standby to the writable server.
    pub fn promote(&self) {
        done(&mut self.pg_ctl(&["--wait", "promote"]));
    }

    /// Kills the postmaster as `kill -9` does.
    pub fn kill(&self) {
        let pid = fs::read_to_string(self.data().join("postmaster.pid")).unwrap();
        let pid = pid.lines().next().unwrap();
        done(Command::new("kill").args(["-9", pid]));
    }

    /// Returns its port, at each of its addresses.
    pub fn port(&self) -> u16 {
        self.port
    }

    /// Returns its host and port in a URL.
    pub fn host(&self) -> String {
        format!("127.0.0.1:{}", self.port)
    }

    /// Returns the URL of a database on it.
    pub fn url(&self, database: &str) -> PostgresUrl {
        url_of(&[&self.host()], OWNER, database)
    }
}

impl Drop for OwnServer {
    fn drop(&mut self) {
        // A test that failed may have stopped it before.
        let stopped = self.pg_ctl(&["--mode=immediate", "stop"]).output();
        assert!(stopped.is_ok(), "{stopped:?}");
    }
}

/// Makes the URL of a database on one of several hosts.
pub fn url_of(hosts: &[&str], user: &str, database: &str) -> PostgresUrl {
    let hosts = hosts.join(",");
    let url = format!("postgres://{user}@{hosts}/{database}?sslmode=disable");
    url.parse().unwrap()
}

/// Makes a command of a program as the user who may run a server: PostgreSQL refuses root.
pub fn as_server_user(program: &Path) -> Command {
    if !is_root() {
        return Command::new(program);
    }
    let mut command = Command::new("runuser");
    command.args(["-u", "postgres", "--"]).arg(program);
    command
}

/// Makes a folder writable for that user.
pub fn own_by_server_user(folder: &Path) {
    if is_root() {
        done(Command::new("chown").arg("postgres").arg(folder));
    }
}

/// Returns the folder of the newest PostgreSQL's programs.
pub fn program_folder() -> PathBuf {
    let initdb = path_of("initdb");
    initdb.parent().unwrap_or(Path::new("/")).to_owned()
}

fn is_root() -> bool {
    done(Command::new("id").arg("-u")).trim() == "0"
}

fn program(name: &str) -> Command {
    Command::new(path_of(name))
}

/// Returns the path of a program of the newest PostgreSQL: Debian keeps servers off the path.
fn path_of(name: &str) -> PathBuf {
    let versions = fs::read_dir("/usr/lib/postgresql");
    let folders = versions.into_iter().flatten().filter_map(Result::ok);
    let newest = folders.max_by_key(|folder| {
        let version = folder.file_name().to_string_lossy().parse();
        version.unwrap_or(0_u32)
    });
    let path = newest.map(|folder| folder.path().join("bin").join(name));
    path.filter(|path| path.exists())
        .unwrap_or_else(|| Path::new(name).to_owned())
}

/// Runs a command that has to succeed; returns its output.
fn done(command: &mut Command) -> String {
    let output = command.output();
    let output = output.unwrap_or_else(|error| panic!("{command:?} cannot be run: {error}"));
    assert!(output.status.success(), "{command:?}: {}", told(&output));
    String::from_utf8(output.stdout).unwrap()
}

fn told(output: &Output) -> String {
    let both = [output.stdout.as_slice(), output.stderr.as_slice()].concat();
    String::from_utf8_lossy(&both).into_owned()
}
