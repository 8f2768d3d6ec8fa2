//! Distinction in `/healthz` of a stuck writer from a database that takes no writes. Minutes:
//! `make hardening-store`.

use std::fs;
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::time::Duration;

use fleetcal_tests::http;
use fleetcal_tests::service::{self, Service, wait_for};
use sqlx::Connection;

use crate::durability::hanging::locked;
use crate::durability::injected::{Robots, can_inject, settle};

/// Time within which a stuck writer is reported: it counts as stuck after a minute, and is checked
/// every few seconds.
const STUCK_WITHIN: Duration = Duration::from_secs(85);
/// Time before which it may not be reported.
const NOT_BEFORE: Duration = Duration::from_secs(55);
/// Time for which the database is locked: longer than a writer may be stuck.
const LOCKED_FOR: Duration = Duration::from_secs(90);
/// Name of the threads in which SQLite works, as the system truncates it.
const THREAD: &str = "sqlx-sqlite-wor";

/// Threads that are frozen until this goes out of scope: each waits before it next sleeps or is
/// woken. None of them holds a lock of the database.
struct Frozen(Vec<Child>);

impl Frozen {
    fn threads(service: &Service) -> Self {
        let tasks = fs::read_dir(format!("/proc/{}/task", service.pid())).unwrap();
        let of_sqlite = tasks.map(|task| task.unwrap().path()).filter(|task| {
            let name = fs::read_to_string(task.join("comm")).unwrap_or_default();
            name.trim() == THREAD
        });
        Self(of_sqlite.map(|task| freeze(&task)).collect())
    }
}

fn freeze(task: &Path) -> Child {
    let thread = task.file_name().unwrap().to_owned();
    let mut strace = Command::new("strace");
    strace.arg("-p").arg(thread);
    strace.args(["-e", "trace=futex", "-e", "inject=futex:delay_enter=600s"]);
    strace.stdout(Stdio::null()).stderr(Stdio::null());
    strace.spawn().unwrap()
}

impl Drop for Frozen {
    fn drop(&mut self) {
        for strace in &mut self.0 {
            drop(Command::new("kill").arg(strace.id().to_string()).status());
            drop(strace.wait());
        }
    }
}

fn health(service: &Service) -> u16 {
    service.status("/healthz", None)
}

#[test]
#[ignore = "takes minutes; make hardening-store"]
fn a_writer_that_stands_still_beside_a_database_that_works_is_told() {
    if !can_inject() {
        return;
    }
    let service = Service::start(&[]);
    let mut robots = Robots::default();
    assert!(robots.register(&service));
    settle(&service);
    let frozen = Frozen::threads(&service);
    assert!(!frozen.0.is_empty(), "no thread is called {THREAD}");
    std::thread::sleep(Duration::from_secs(1));
    let began = service::now();
    // It waits for the writer, and gets no answer.
    drop(http::get(service.http(), "/readyz", None));
    let told = wait_for("the probe's failure", || {
        (health(&service) == 503).then(|| began.elapsed())
    });
    println!(
        "{} threads frozen; /healthz fails after {told:?}",
        frozen.0.len()
    );
    assert!((NOT_BEFORE..STUCK_WITHIN).contains(&told), "{told:?}");
    drop(frozen);
    wait_for("the probe's recovery", || {
        (health(&service) == 200).then_some(())
    });
    println!("writing works after {:?}", robots.recover(&service));
    settle(&service);
    robots.check(&service);
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
#[ignore = "takes minutes; make hardening-store"]
async fn a_locked_database_is_not_the_writers_fault() {
    let service = Service::start(&[]);
    let mut robots = Robots::default();
    assert!(robots.register(&service));
    let lock = locked(&service).await;
    tokio::task::block_in_place(|| {
        let end = service::now() + LOCKED_FOR;
        while service::now() < end {
            assert!(!robots.register(&service));
            assert_eq!(health(&service), 200);
            assert_eq!(service.status("/readyz", None), 503);
        }
    });
    lock.close().await.unwrap();
    tokio::task::block_in_place(|| {
        println!("writing works after {:?}", robots.recover(&service));
        settle(&service);
        robots.check(&service);
    });
}
