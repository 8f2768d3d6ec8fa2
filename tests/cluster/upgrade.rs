//! Versions change under robots that drive and somebody who decides: one instance after the other,
//! and back again.

use std::collections::BTreeMap;
use std::env;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::time::Duration;

use fleetcal_tests::service::{now, wait_for};
use fleetcal_tests::{binary, http};

use crate::cluster::Instance;
use crate::figures::spread;
use crate::progress::Progress;
use crate::trial::{BALANCED_WITHIN, DRIVING, HANDED_OVER_WITHIN, Trial, is_parked};

/// Pause between two decisions of the decider beside it.
const PAUSE: Duration = Duration::from_millis(200);
/// Largest rise of a sigma: an estimator that began from nothing would have a distance of 0 and a
/// sigma ten times as large; that of a robot that has just converged varies by a half.
const SIGMA_RISE_MAX: f64 = 2.0;
/// Parameters of a calibration.
const PARAMETERS: [&str; 4] = ["steering_offset", "lidar_x", "lidar_y", "lidar_yaw"];

/// Reader that moves to the next instance when one does not answer, like a balancer's client.
struct Reader {
    stop: Arc<AtomicBool>,
    reads: Arc<AtomicU64>,
    failed: Arc<AtomicU64>,
}

impl Reader {
    fn start(trial: &Trial) -> Self {
        let reader = Self {
            stop: Arc::default(),
            reads: Arc::default(),
            failed: Arc::default(),
        };
        let all = trial.instances.values();
        let addresses: Vec<_> = all.clone().map(|instance| instance.http).collect();
        let token = all.map(Instance::token).next().unwrap().to_owned();
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

    fn assert_none_failed(&self) {
        let [reads, failed] =
            [&self.reads, &self.failed].map(|count| count.load(Ordering::Relaxed));
        println!("{failed} of {reads} reads failed");
        assert!(reads > 100 && failed == 0, "{failed} of {reads}");
    }
}

impl Drop for Reader {
    fn drop(&mut self) {
        self.stop.store(true, Ordering::Relaxed);
    }
}

/// Sigmas and distance of an estimator.
struct Standing {
    sigmas: Vec<f64>,
    distance_m: f64,
}

/// Returns each robot's sigmas and distance, once all its parameters are converged.
fn standing(seen_by: &Instance) -> BTreeMap<String, Standing> {
    wait_for("converged estimates of all robots", || {
        let list = seen_by.try_get("/api/v1/robots?limit=100")?;
        let driving = |robot: &&serde_json::Value| {
            let id = robot["id"].as_str();
            id.is_some_and(|id| !is_parked(id))
        };
        let robots = list["items"].as_array()?.iter().filter(driving);
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
        let standing: Option<BTreeMap<_, _>> = robots.map(one).collect();
        standing.filter(|standing| standing.len() == DRIVING)
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

/// Changes all instances to a program, one after the other; returns the longest time without an
/// estimate of a robot, s.
fn change(trial: &mut Trial, program: &Path, has_changed: impl Fn(&Instance) -> bool) -> f64 {
    let any = |trial: &Trial| standing(trial.instances.values().next().unwrap());
    let (before, began) = (any(trial), now());
    program.clone_into(&mut trial.cluster.program);
    let names: Vec<_> = trial.instances.keys().copied().collect();
    for name in names {
        let mut instance = trial.instances.remove(name).unwrap();
        instance.process.end_in_order();
        trial.start_again(name);
        let balanced = trial.balanced();
        assert!(balanced < BALANCED_WITHIN, "balanced after {balanced:?}");
        assert!(has_changed(&trial.instances[name]), "{name}");
    }
    assert_goes_on(&before, &any(trial));
    trial.owners();
    let gaps = trial.watch.gaps(began);
    assert_eq!(gaps.len(), DRIVING);
    let gap = gaps.into_values().max().unwrap();
    assert!(gap <= HANDED_OVER_WITHIN, "{gap:?} without an estimate");
    assert_eq!(trial.watch.stale(began), BTreeMap::new());
    gap.as_secs_f64()
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn instances_are_upgraded_and_taken_back_under_robots_that_drive() {
    let next = env::var_os("FLEETCAL_NEXT").map(PathBuf::from);
    let next = next.expect("FLEETCAL_NEXT names the next version: make cluster-upgrade");
    let this = binary::path();
    let mut progress = Progress::of("upgrade", 3);
    let open = progress.open();
    if let Some(&first) = open.first() {
        let mut trial = Trial::start(true, first, PAUSE).await;
        standing(trial.instances.values().next().unwrap());
        let of_this = version(trial.instances.values().next().unwrap());
        let reader = Reader::start(&trial);
        for seed in open {
            progress.begin(seed);
            let decided = trial.decider.acknowledged();
            // The older instances go on while the newer version migrates.
            migrate(&next, &trial.url().to_string());
            let there = change(&mut trial, &next, |one| version(one) != of_this);
            trial.check(seed);
            let back = change(&mut trial, &this, |one| version(one) == of_this);
            trial.check(seed);
            let decided = trial.decider.acknowledged() - decided;
            println!(
                "round {seed}: at most {there:.2} s between two estimates on the way there, {back:.2} s \
                 back; {decided} decisions acknowledged"
            );
            assert!(decided > 0, "nothing was decided");
            reader.assert_none_failed();
            progress.passed(seed, vec![there, back]);
        }
        println!(
            "upgrade: {}; {}",
            trial.seen(),
            progress.told(&trial.server())
        );
    }
    let gaps = [progress.figures(0), progress.figures(1)].concat();
    println!(
        "longest time between two estimates while a version changes: {}",
        spread(&gaps)
    );
    println!("  failed or broken off: {}", progress.told_failed());
}

/// Migrates the database to a version's schema beside the running instances.
fn migrate(program: &Path, database: &str) {
    let output = Command::new(program)
        .args(["store", "migrate", "--database", database])
        .output();
    let output = output.unwrap();
    let said = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "{said}");
}
