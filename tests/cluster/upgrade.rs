//! Versions change under robots that drive: one instance after the other, and back again.

use std::collections::BTreeMap;
use std::env;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::time::Duration;

use fleetcal_tests::service::{now, wait_for};
use fleetcal_tests::{binary, http};

use crate::cluster::{Cluster, Instance};
use crate::watch::Watch;

const ROBOTS: usize = 6;
/// Estimates come once a second, and one may be missing.
const GAP_MAX: Duration = Duration::from_millis(2_200);
/// No estimator begins from nothing: its distance would begin at 0, and a sigma would be ten times as
/// large; of a robot that has just converged it goes up and down by a half.
const SIGMA_RISE_MAX: f64 = 2.0;
const ROUNDS: usize = 3;
/// The parameters of a calibration.
const PARAMETERS: [&str; 4] = ["steering_offset", "lidar_x", "lidar_y", "lidar_yaw"];

/// Somebody who reads, as a balancer lets one: from the next instance when one does not answer.
struct Reader {
    stop: Arc<AtomicBool>,
    reads: Arc<AtomicU64>,
    failed: Arc<AtomicU64>,
}

impl Reader {
    fn start(a: &Instance, b: &Instance) -> Self {
        let reader = Self {
            stop: Arc::default(),
            reads: Arc::default(),
            failed: Arc::default(),
        };
        let (token, addresses) = (a.token().to_owned(), [a.http, b.http]);
        let (stop, reads, failed) = (
            Arc::clone(&reader.stop),
            Arc::clone(&reader.reads),
            Arc::clone(&reader.failed),
        );
        std::thread::spawn(move || {
            while !stop.load(Ordering::Relaxed) {
                let read = |address: &_| {
                    let answer = http::get(*address, "/api/v1/robots?limit=100", Some(&token));
                    answer.is_some_and(|answer| answer.status == 200)
                };
                let answered = addresses.iter().any(read);
                reads.fetch_add(1, Ordering::Relaxed);
                failed.fetch_add(u64::from(!answered), Ordering::Relaxed);
                std::thread::sleep(Duration::from_millis(50));
            }
        });
        reader
    }
}

impl Drop for Reader {
    fn drop(&mut self) {
        self.stop.store(true, Ordering::Relaxed);
    }
}

/// Of an estimator.
struct Standing {
    sigmas: Vec<f64>,
    distance_m: f64,
}

/// Each robot's sigmas and distance, once all its parameters are converged.
fn standing(seen_by: &Instance) -> BTreeMap<String, Standing> {
    wait_for("converged estimates of all robots", || {
        let list = seen_by.try_get("/api/v1/robots?limit=100")?;
        let robots = list["items"].as_array()?;
        let one = |robot: &serde_json::Value| {
            let id = robot["id"].as_str()?.to_owned();
            let estimate = seen_by.try_get(&format!("/api/v1/robots/{id}/estimate"))?;
            let sigma = |name: &&str| {
                let parameter = &estimate["parameters"][*name];
                let is_converged = parameter["status"] == "converged";
                is_converged.then(|| parameter["sigma"].as_f64())?
            };
            let sigmas: Option<Vec<_>> = PARAMETERS.iter().map(sigma).collect();
            let standing = Standing {
                sigmas: sigmas?,
                distance_m: estimate["distance_m"].as_f64()?,
            };
            Some((id, standing))
        };
        let standing: Option<BTreeMap<_, _>> = robots.iter().map(one).collect();
        standing.filter(|standing| standing.len() == ROBOTS)
    })
}

fn assert_goes_on(before: &BTreeMap<String, Standing>, after: &BTreeMap<String, Standing>) {
    for (robot, before) in before {
        let after = &after[robot];
        assert!(
            after.distance_m >= before.distance_m,
            "{robot}: {} m before, {} m after",
            before.distance_m,
            after.distance_m
        );
        for (before, after) in before.sigmas.iter().zip(&after.sigmas) {
            assert!(
                *after <= before * SIGMA_RISE_MAX,
                "{robot}: sigma {before} before, {after} after"
            );
        }
    }
}

fn version(instance: &Instance) -> String {
    let cluster = instance.get("/api/v1/cluster");
    let instances = cluster["instances"].as_array().unwrap();
    let own = instances.iter().find(|one| one["name"] == instance.name);
    own.unwrap()["program"].as_str().unwrap().to_owned()
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn instances_are_upgraded_and_taken_back_under_robots_that_drive() {
    let next = env::var_os("FLEETCAL_NEXT").map(PathBuf::from);
    let next = next.expect("FLEETCAL_NEXT names the next version: make cluster-upgrade");
    let this = binary::path();
    let mut cluster = Cluster::new(&["a", "b"], ROBOTS).await;
    let watch = Watch::start(&cluster.routers).await;
    let mut a = cluster.start("a", 0);
    let mut b = cluster.start("b", 1);
    let _robots = cluster.drive();
    standing(&a);
    let reader = Reader::start(&a, &b);
    let of_this = version(&a);
    for round in 0..ROUNDS {
        // The older instances go on while the newer version migrates.
        migrate(&next, cluster.database());
        for (program, is_next) in [(&next, true), (&this, false)] {
            let before = standing(&a);
            let began = now();
            program.clone_into(&mut cluster.program);
            for instance in [&mut a, &mut b] {
                instance.process.end_in_order();
                let router = usize::from(instance.name == "b");
                *instance = cluster.start(instance.name, router);
                let seen_by = &*instance;
                wait_for("even shares", || {
                    let shares = seen_by.shares()?;
                    let even = shares.values().all(|share| *share == (ROBOTS / 2) as u64);
                    (shares.len() == 2 && even).then_some(())
                });
                assert_eq!(version(instance) != of_this, is_next);
            }
            assert_goes_on(&before, &standing(&a));
            let gap = watch.gaps(began).into_values().max().unwrap();
            println!("round {round}, next {is_next}: {gap:?} without an estimate at most");
            assert!(gap <= GAP_MAX, "{gap:?}");
            assert_eq!(watch.stale(began), BTreeMap::new());
        }
    }
    let (reads, failed) = (
        reader.reads.load(Ordering::Relaxed),
        reader.failed.load(Ordering::Relaxed),
    );
    println!("{failed} of {reads} reads failed");
    assert!(reads > 100 && failed == 0, "{failed} of {reads}");
}

/// Brings the database to a version's schema beside the instances that serve.
fn migrate(program: &Path, database: &str) {
    let output = Command::new(program)
        .args(["store", "migrate", "--database", database])
        .output();
    let output = output.unwrap();
    let said = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "{said}");
}
