//! A disk that fails: errors that strace puts in the place of what the system would answer.

use std::fs;
use std::path::PathBuf;
use std::process::{Child, Command, Stdio};
use std::time::Duration;

use fleetcal_tests::service::{self, Service, wait_for};
use serde_json::json;
use tempfile::TempDir;

use crate::durability::trace;

/// Time after the last fault within which writing has to work again.
const RECOVERS_WITHIN: Duration = Duration::from_secs(5);
/// System calls by which SQLite syncs; which of the two depends on its build.
pub const SYNC: &str = "fsync,fdatasync";
/// Time for which a disk fails that fails a few times.
const FAILS_FOR: Duration = Duration::from_millis(1_500);

/// Faults of a running process, until this goes out of scope.
pub struct Faults {
    strace: Child,
    logs: TempDir,
}

impl Faults {
    /// Attaches strace, which from now on does to a call as `fault` specifies: `error=EIO:when=2`
    /// makes the second one of each thread fail.
    pub fn begin(service: &Service, call: &str, fault: &str) -> Self {
        let logs = tempfile::tempdir().unwrap();
        let log = logs.path().join("strace.log");
        fs::write(&log, "").unwrap();
        let strace = Command::new("strace")
            .args(["-f", "-p", &service.pid().to_string()])
            .args(["-e", &format!("trace={call}")])
            .args(["-e", &format!("inject={call}:{fault}")])
            .arg("-o")
            .arg(&log)
            .stdout(Stdio::null())
            .stderr(fs::File::create(logs.path().join("said")).unwrap())
            .spawn()
            .unwrap();
        let faults = Self { strace, logs };
        wait_for("strace", || {
            faults.read("said").contains("attached").then_some(())
        });
        faults
    }

    fn read(&self, name: &str) -> String {
        let path: PathBuf = self.logs.path().join(name);
        String::from_utf8_lossy(&fs::read(path).unwrap()).into_owned()
    }

    /// Returns the number of failed calls so far.
    pub fn count(&self) -> usize {
        self.read("strace.log").matches("(INJECTED)").count()
    }

    /// Ends them; returns their number.
    pub fn end(mut self) -> usize {
        self.detach();
        self.count()
    }

    fn detach(&mut self) {
        let asked = Command::new("kill")
            .args(["-INT", &self.strace.id().to_string()])
            .status();
        assert!(asked.unwrap().success());
        self.strace.wait().unwrap();
    }
}

impl Drop for Faults {
    fn drop(&mut self) {
        if let Ok(None) = self.strace.try_wait() {
            self.detach();
        }
    }
}

/// Registrations of robots, with those that were acknowledged.
#[derive(Default)]
pub struct Robots {
    tried: usize,
    acknowledged: Vec<String>,
    /// Robots refused with the report that nothing was changed.
    unchanged: Vec<String>,
    unknown: usize,
}

impl Robots {
    /// Registers one more; returns whether that was acknowledged.
    pub fn register(&mut self, service: &Service) -> bool {
        let id = format!("tugger_{}", self.tried);
        self.tried += 1;
        let vehicle = json!({"model": "bicycle", "wheelbase_m": 1.2});
        let answer = service.try_put(&format!("/api/v1/robots/{id}"), &vehicle);
        let answer = answer.unwrap_or_else(|| panic!("{id}: no answer"));
        match (answer.status, answer.body.contains("\"outcome_unknown\"")) {
            (201, _) => {
                self.acknowledged.push(id);
                true
            }
            (503, true) => {
                self.unknown += 1;
                false
            }
            (503, false) => {
                self.unchanged.push(id);
                false
            }
            (status, _) => panic!("{id}: {status}: {}", answer.body),
        }
    }

    /// Writes until it works again.
    pub fn recover(&mut self, service: &Service) -> Duration {
        let began = service::now();
        while !self.register(service) {
            let waited = began.elapsed();
            assert!(waited < RECOVERS_WITHIN, "still not after {waited:?}");
        }
        began.elapsed()
    }

    /// Returns the number of acknowledged ones.
    pub fn acknowledged(&self) -> usize {
        self.acknowledged.len()
    }

    /// Returns the number of others.
    pub fn refused(&self) -> usize {
        self.unchanged.len() + self.unknown
    }

    /// Checks that every acknowledged one exists, and none that was reported as unchanged.
    pub fn check(&self, service: &Service) {
        for id in &self.acknowledged {
            assert_eq!(service.robot(id)["id"], id.as_str());
        }
        for id in &self.unchanged {
            assert_eq!(service.try_get(&format!("/api/v1/robots/{id}")), None);
        }
    }
}

/// Waits until nothing is left in memory.
pub fn settle(service: &Service) {
    wait_for("an empty memory", || {
        (service.metric("fleetcal_store_waiting") == 0).then_some(())
    });
}

/// True if faults can be injected here. Without strace the test reports it, and fails where it must
/// not be left out.
pub fn can_inject() -> bool {
    let Some(missing) = trace::missing() else {
        return true;
    };
    assert!(std::env::var_os("CI").is_none(), "{missing}");
    println!("skipped: {missing}");
    false
}

/// Writes while calls fail: until one has failed, or for a while.
fn fail(
    service: &Service,
    robots: &mut Robots,
    (call, error, when): (&str, &str, &str),
    once: bool,
) {
    let faults = Faults::begin(service, call, &format!("error={error}:when={when}"));
    let began = service::now();
    let goes_on = || {
        if once {
            faults.count() == 0
        } else {
            began.elapsed() < FAILS_FOR
        }
    };
    while goes_on() {
        robots.register(service);
        assert!(
            began.elapsed() < Duration::from_secs(20),
            "{call} did not fail"
        );
    }
    let failed = faults.end();
    let recovered = robots.recover(service);
    println!("{call} {error} when={when}: {failed} failed, writing works after {recovered:?}");
    assert!(failed > 0, "{call} did not fail");
}

#[test]
fn a_service_writes_again_after_the_disk_failed() {
    if !can_inject() {
        return;
    }
    let mut service = Service::start(&[]);
    let mut robots = Robots::default();
    for (call, error) in [
        ("pwrite64", "EIO"),
        ("pwrite64", "ENOSPC"),
        (SYNC, "EIO"),
        (SYNC, "ENOSPC"),
    ] {
        for (when, once) in [
            ("1", true),
            ("2", true),
            ("5", true),
            ("1+", false),
            ("3+2", false),
        ] {
            fail(&service, &mut robots, (call, error, when), once);
        }
    }
    println!(
        "{} writes acknowledged, {} refused, {} of unknown outcome",
        robots.acknowledged.len(),
        robots.unchanged.len(),
        robots.unknown
    );
    assert!(robots.refused() > 10, "{} were refused", robots.refused());
    assert_eq!(service.status("/readyz", None), 200);
    assert_eq!(service.metric("fleetcal_store_lost_total"), 0);
    settle(&service);
    service.kill();
    service.restart();
    robots.check(&service);
}
