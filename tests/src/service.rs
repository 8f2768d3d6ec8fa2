//! A running service: the built binary on free loopback ports and a folder of its own.

use std::collections::BTreeMap;
use std::fs::{self, OpenOptions};
use std::net::SocketAddr;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, ExitStatus, Stdio};
use std::time::{Duration, Instant};

use fleetcal_ports::free_address;
use fleetcal_store::database_url::PostgresUrl;
use serde_json::Value;
use tempfile::TempDir;

use crate::{binary, database, http, memory};

/// Longest wait for an action of a service.
const WAIT_MAX: Duration = Duration::from_secs(90);
/// Lines of a service's log that a test shows.
const LOG_LINES_SHOWN: usize = 200;
/// Pause between two looks.
const LOOK_EVERY: Duration = Duration::from_millis(20);

/// A service, which is killed when it goes out of scope.
#[derive(Debug)]
pub struct Service {
    child: Child,
    folder: TempDir,
    http: SocketAddr,
    zenoh: SocketAddr,
    token: String,
    zenoh_flags: Vec<String>,
    data: PathBuf,
    variables: Vec<(String, String)>,
}

/// Instance of a cluster.
#[derive(Debug, Clone, Copy)]
pub struct Instance<'a> {
    /// Its name.
    pub name: &'a str,
    /// Address of its API.
    pub http: SocketAddr,
    /// Shared database.
    pub database: &'a PostgresUrl,
}

/// Returns the present time, for tests that wait for another process.
#[expect(
    clippy::disallowed_methods,
    reason = "waiting for another process takes real time"
)]
pub fn now() -> Instant {
    Instant::now()
}

/// Waits until `look` returns a value.
///
/// # Panics
/// When it never does.
pub fn wait_for<T>(what: &str, mut look: impl FnMut() -> Option<T>) -> T {
    let began = now();
    loop {
        if let Some(found) = look() {
            return found;
        }
        assert!(
            began.elapsed() < WAIT_MAX,
            "{what} did not come within {WAIT_MAX:?}"
        );
        std::thread::sleep(LOOK_EVERY);
    }
}

impl Service {
    /// Starts a service with configured `robots`, each a bicycle of 1.2 m.
    ///
    /// # Panics
    /// When it does not become ready.
    pub fn start(robots: &[&str]) -> Self {
        let entry = |robot: &&str| {
            format!("[[robot]]\nid = \"{robot}\"\nmodel = \"bicycle\"\nwheelbase_m = 1.2\n\n")
        };
        Self::start_with(&robots.iter().map(entry).collect::<String>())
    }

    /// Starts a service with a configuration file.
    ///
    /// # Panics
    /// When it does not become ready.
    pub fn start_with(config: &str) -> Self {
        let zenoh = free_address();
        Self::start_on(zenoh, config, &["--listen", &format!("tcp/{zenoh}")])
    }

    /// Starts a service with a configuration file and the flags of its endpoints; `zenoh` is the
    /// address for robots.
    ///
    /// # Panics
    /// When it does not become ready.
    pub fn start_on(zenoh: SocketAddr, config: &str, zenoh_flags: &[&str]) -> Self {
        let folder = TempDir::new().expect("a folder");
        let data = folder.path().join("data");
        let place = (folder, data, free_address());
        Self::start_in(place, zenoh, config, zenoh_flags, Vec::new())
    }

    /// Starts an instance of a cluster likewise.
    ///
    /// # Panics
    /// When it does not become ready.
    pub fn start_instance(
        instance: Instance<'_>,
        zenoh: SocketAddr,
        config: &str,
        zenoh_flags: &[&str],
    ) -> Self {
        let folder = TempDir::new().expect("a folder");
        let data = folder.path().join("data");
        database::name(&data, instance.database);
        let flags = [zenoh_flags, &["--instance", instance.name]].concat();
        let place = (folder, data, instance.http);
        Self::start_in(place, zenoh, config, &flags, Vec::new())
    }

    /// Starts a service without robots with its data in a folder elsewhere.
    ///
    /// # Panics
    /// When it does not become ready.
    pub fn start_with_data(data: &Path) -> Self {
        let folder = TempDir::new().expect("a folder");
        Self::start_alone(folder, data.to_owned(), &[])
    }

    /// Starts a service without robots with these environment variables.
    ///
    /// # Panics
    /// When it does not become ready.
    pub fn start_with_variables(variables: &[(&str, &str)]) -> Self {
        let folder = TempDir::new().expect("a folder");
        let data = folder.path().join("data");
        Self::start_alone(folder, data, variables)
    }

    fn start_alone(folder: TempDir, data: PathBuf, variables: &[(&str, &str)]) -> Self {
        let zenoh = free_address();
        let flags = ["--listen", &format!("tcp/{zenoh}")];
        let own = |&(name, value): &(&str, &str)| (name.to_owned(), value.to_owned());
        let variables = variables.iter().map(own).collect();
        let place = (folder, data, free_address());
        Self::start_in(place, zenoh, "", &flags, variables)
    }

    fn start_in(
        (folder, data, http): (TempDir, PathBuf, SocketAddr),
        zenoh: SocketAddr,
        config: &str,
        zenoh_flags: &[&str],
        mut variables: Vec<(String, String)>,
    ) -> Self {
        database::create(&data);
        variables.extend(database::variable(&data));
        fs::write(folder.path().join("fleetcal.toml"), config).expect("a configuration");
        let zenoh_flags: Vec<String> = zenoh_flags.iter().map(|&flag| flag.to_owned()).collect();
        let child = spawn(&folder, &data, http, &zenoh_flags, &variables);
        let mut service = Self {
            child,
            variables,
            folder,
            http,
            zenoh,
            token: String::new(),
            zenoh_flags,
            data,
        };
        service.wait_until_ready();
        // The names of tokens differ, also those of two instances.
        let name = format!("{}-tests", http.port());
        service.token = service.made_token(&["--role", "admin", "--name", &name]);
        service
    }

    /// Restarts the service on the same folder and ports.
    ///
    /// # Panics
    /// When it still runs or does not become ready.
    pub fn restart(&mut self) {
        assert!(
            self.child.try_wait().expect("a status").is_some(),
            "the service still runs"
        );
        self.child = spawn(
            &self.folder,
            &self.data,
            self.http,
            &self.zenoh_flags,
            &self.variables,
        );
        self.wait_until_ready();
    }

    fn wait_until_ready(&mut self) {
        wait_for("readiness", || {
            let end = self.child.try_wait().expect("a status");
            assert!(
                end.is_none(),
                "the service ended: {end:?}\n{}",
                self.logged()
            );
            http::get(self.http, "/readyz", None).filter(|answer| answer.status == 200)
        });
    }

    /// Makes a token by the command line beside the service.
    ///
    /// # Panics
    /// When it is not made.
    pub fn made_token(&self, arguments: &[&str]) -> String {
        let output = Command::new(binary::path())
            .args(["token", "create", "--data"])
            .arg(self.data())
            .args(arguments)
            .envs(self.variables.iter().map(|(name, value)| (name, value)))
            .output()
            .expect("the binary runs");
        let errors = String::from_utf8_lossy(&output.stderr);
        assert!(output.status.success(), "{}: {errors}", output.status);
        let printed = String::from_utf8(output.stdout).expect("text");
        printed.trim_end().to_owned()
    }

    /// Returns the status of `GET path` with a token, or without.
    ///
    /// # Panics
    /// When there is no answer.
    pub fn status(&self, path: &str, token: Option<&str>) -> u16 {
        http::get(self.http, path, token).expect("an answer").status
    }

    /// Returns the body of `GET path`, which is public.
    ///
    /// # Panics
    /// When there is none.
    pub fn page(&self, path: &str) -> String {
        let answer = http::get(self.http, path, None).expect("an answer");
        assert_eq!(answer.status, 200, "{path}: {}", answer.body);
        answer.body
    }

    /// Returns the address of its HTTP listener.
    pub fn http(&self) -> SocketAddr {
        self.http
    }

    /// Returns its URL for people and tools.
    pub fn url(&self) -> String {
        format!("http://{}", self.http)
    }

    /// Returns the endpoint for robots.
    pub fn endpoint(&self) -> String {
        format!("tcp/{}", self.zenoh)
    }

    /// Returns the folder of its data.
    pub fn data(&self) -> PathBuf {
        self.data.clone()
    }

    /// Returns its log.
    ///
    /// # Panics
    /// When the log cannot be read.
    pub fn logged(&self) -> String {
        let bytes = fs::read(log_in(&self.folder)).expect("a log");
        String::from_utf8_lossy(&bytes).into_owned()
    }

    /// Returns the answer to putting a new document at `path`; `None` without one.
    pub fn try_put(&self, path: &str, document: &Value) -> Option<http::Answer> {
        http::put(self.http, path, &self.token, &document.to_string())
    }

    /// Returns a count of `/metrics`; 0 if it is absent.
    ///
    /// # Panics
    /// When there is no answer.
    pub fn metric(&self, name: &str) -> u64 {
        let answer = http::get(self.http, "/metrics", None).expect("an answer");
        let lines = answer.body.lines();
        let value = lines.filter_map(|line| line.strip_prefix(name)?.strip_prefix(' '));
        let count = |value: &str| value.parse::<f64>().expect("a number") as u64;
        value.map(count).sum()
    }

    /// Returns the sum of a name's samples of `/metrics`, whatever their labels; 0 if it is absent.
    ///
    /// # Panics
    /// When there is no answer.
    pub fn metric_sum(&self, name: &str) -> f64 {
        let answer = http::get(self.http, "/metrics", None).expect("an answer");
        let values = answer.body.lines().filter_map(|line| {
            let rest = line.strip_prefix(name)?;
            let is_it = rest.starts_with(['{', ' ']);
            rest.rsplit_once(' ')
                .filter(|_| is_it)?
                .1
                .parse::<f64>()
                .ok()
        });
        values.sum()
    }

    /// Returns the upper bound of the histogram's bucket up to which it has a share of its values;
    /// `None` where there is no such histogram.
    ///
    /// # Panics
    /// When there is no answer.
    pub fn metric_quantile(&self, name: &str, share: f64) -> Option<f64> {
        let answer = http::get(self.http, "/metrics", None).expect("an answer");
        let begin = format!("{name}_bucket{{le=\"");
        let buckets = answer.body.lines().filter_map(|line| {
            let (bound, count) = line.strip_prefix(&begin)?.split_once("\"} ")?;
            let bound = bound.replace("+Inf", "inf").parse().ok()?;
            Some((bound, count.parse().ok()?))
        });
        let buckets: Vec<(f64, f64)> = buckets.collect();
        let (_, all) = *buckets.last()?;
        let is_enough = |bucket: &&(f64, f64)| bucket.1 >= share * all;
        buckets.iter().find(is_enough).map(|bucket| bucket.0)
    }

    /// Returns its process.
    pub fn pid(&self) -> u32 {
        self.child.id()
    }

    /// Returns the answer of `GET path`.
    ///
    /// # Panics
    /// When there is none.
    pub fn get(&self, path: &str) -> Value {
        let answer = http::get(self.http, path, Some(&self.token)).expect("an answer");
        assert_eq!(answer.status, 200, "{path}: {}", answer.body);
        serde_json::from_str(&answer.body).expect("JSON")
    }

    /// Puts a new document at `path`.
    ///
    /// # Panics
    /// When it is not taken.
    pub fn put(&self, path: &str, document: &Value) {
        let answer = http::put(self.http, path, &self.token, &document.to_string());
        let answer = answer.expect("an answer");
        assert!(
            (200..300).contains(&answer.status),
            "{path}: {}",
            answer.body
        );
    }

    /// Returns the answer of `GET path`, if it has status 200.
    pub fn try_get(&self, path: &str) -> Option<Value> {
        let answer = http::get(self.http, path, Some(&self.token));
        let answer = answer.filter(|answer| answer.status == 200)?;
        serde_json::from_str(&answer.body).ok()
    }

    /// Registers a robot with a configuration in JSON.
    ///
    /// # Panics
    /// When it is refused.
    pub fn register(&self, id: &str, config: &str) {
        let request = format!("PUT /api/v1/robots/{id}");
        self.send(&request, &self.token, "If-None-Match: *\r\n", config);
    }

    /// Returns the answer to a request, `POST /path`, with further headers, each with its line's
    /// end, and a body in JSON.
    ///
    /// # Panics
    /// When it is refused.
    pub fn send(&self, request: &str, token: &str, headers: &str, json: &str) -> Value {
        let answer = http::send(self.http, request, Some(token), Some((headers, json)));
        let answer = answer.expect("an answer");
        assert!(
            (200..300).contains(&answer.status),
            "{request}: {}",
            answer.body
        );
        serde_json::from_str(&answer.body).expect("JSON")
    }

    /// Returns one robot.
    pub fn robot(&self, id: &str) -> Value {
        self.get(&format!("/api/v1/robots/{id}"))
    }

    /// Returns a robot's estimate once its session has ended and everything was processed: it has
    /// used as many drive samples as were sent.
    pub fn estimate_of(&self, id: &str, drive_samples: u64) -> Value {
        wait_for("the end of the session", || {
            let estimate = self.try_get(&format!("/api/v1/robots/{id}/estimate"))?;
            (estimate["counts"]["drive_samples"] == drive_samples).then_some(estimate)
        })
    }

    /// Checks that every message of a robot is accounted for and that none waits; returns the
    /// counters.
    ///
    /// # Panics
    /// When one is missing.
    pub fn accounts_of(&self, id: &str) -> Value {
        let counters = wait_for("an empty mailbox", || {
            Some(self.robot(id)["counters"].clone()).filter(|counters| counters["waiting"] == 0)
        });
        let count = |name: &str| counters[name].as_u64().expect("a count");
        let kept = count("processed") + count("refused") + count("ignored");
        let dropped =
            count("dropped_wheel_odometry") + count("dropped_scans") + count("dropped_notes");
        assert_eq!(count("received"), kept + dropped, "{counters}");
        counters
    }

    /// Returns the CPU time that it has used, s.
    ///
    /// # Panics
    /// When the system does not provide it.
    pub fn cpu_s(&self) -> f64 {
        // Fields 14 and 15 of proc(5) stat, in ticks of 10 ms; the second field may hold spaces.
        let stat = fs::read_to_string(format!("/proc/{}/stat", self.pid())).expect("proc");
        let (_, fields) = stat.rsplit_once(')').expect("a stat line");
        let ticks = |at: usize| -> f64 {
            let field = fields.split_whitespace().nth(at).expect("a field");
            field.parse().expect("a number")
        };
        (ticks(11) + ticks(12)) / 100.0
    }

    /// Returns the CPU time that its threads have used, s, by their names without numbers.
    ///
    /// # Panics
    /// When the system does not provide it.
    pub fn cpu_s_by_thread(&self) -> BTreeMap<String, f64> {
        let mut by_name = BTreeMap::new();
        let threads = fs::read_dir(format!("/proc/{}/task", self.pid())).expect("proc");
        for thread in threads {
            let folder = thread.expect("proc").path();
            // A thread may end meanwhile.
            let read = |file: &str| fs::read_to_string(folder.join(file)).ok();
            if let (Some(name), Some(stat)) = (read("comm"), read("schedstat")) {
                let name = name
                    .trim_end()
                    .trim_end_matches(|c: char| c.is_ascii_digit() || c == '-');
                let used_ns = stat.split_whitespace().next().expect("a time");
                let used_ns: f64 = used_ns.parse().expect("a number");
                *by_name.entry(name.to_owned()).or_insert(0.0) += 1e-9 * used_ns;
            }
        }
        by_name
    }

    /// Returns its memory, bytes.
    ///
    /// # Panics
    /// When the system does not provide it.
    pub fn memory_bytes(&self) -> u64 {
        memory::of(self.pid()).held_bytes
    }

    /// Ends it without warning.
    ///
    /// # Panics
    /// When that fails.
    pub fn kill(&mut self) {
        self.child.kill().expect("SIGKILL");
        self.child.wait().expect("its end");
    }

    /// Stops it by a signal; returns its exit status and the time it took.
    ///
    /// # Panics
    /// When it does not end.
    pub fn terminate(&mut self) -> (ExitStatus, Duration) {
        let began = now();
        let asked = Command::new("kill")
            .arg(self.pid().to_string())
            .status()
            .expect("kill");
        assert!(asked.success());
        let status = wait_for("its end", || self.child.try_wait().expect("a status"));
        (status, began.elapsed())
    }
}

impl Drop for Service {
    fn drop(&mut self) {
        if self.child.kill().is_err() || self.child.wait().is_err() {
            eprintln!("the service {} was not ended", self.child.id());
        }
        // Of a failing test, what the service said last.
        if let Ok(said) = fs::read(log_in(&self.folder)) {
            let said = String::from_utf8_lossy(&said);
            let lines: Vec<_> = said.lines().collect();
            let last = &lines[lines.len().saturating_sub(LOG_LINES_SHOWN)..];
            eprintln!("{}", last.join("\n"));
        }
    }
}

/// Returns the path of a service's log: a pipe without a reader would stop it once full.
fn log_in(folder: &TempDir) -> PathBuf {
    folder.path().join("service.log")
}

fn spawn(
    folder: &TempDir,
    data: &Path,
    http: SocketAddr,
    zenoh_flags: &[String],
    variables: &[(String, String)],
) -> Child {
    let log = OpenOptions::new()
        .create(true)
        .append(true)
        .open(log_in(folder));
    Command::new(binary::path())
        .arg("serve")
        .arg("--config")
        .arg(folder.path().join("fleetcal.toml"))
        .arg("--data")
        .arg(data)
        .args(["--http", &http.to_string()])
        .args(zenoh_flags)
        .env_remove("ZENOH_CONFIG")
        .envs(variables.iter().map(|(name, value)| (name, value)))
        .stdin(Stdio::null())
        .stdout(Stdio::null())
        .stderr(log.expect("a log"))
        .spawn()
        .expect("the service starts")
}
