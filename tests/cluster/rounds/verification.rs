//! An instance is killed while its robots prove their approved calibration.

use std::collections::BTreeMap;
use std::ops::RangeInclusive;
use std::time::Duration;

use fleetcal_tests::service::{now, wait_for};
use serde_json::Value;

use crate::cluster::{Cluster, Instance};
use crate::decider::Desk;
use crate::figures::quantile;
use crate::progress::Progress;
use crate::trial::{DRIVING, Trial, is_parked};

const PAUSE: Duration = Duration::from_millis(200);
/// Distance that a robot has driven with the calibration in verification when its instance is
/// killed: far enough to recognise a run that begins from scratch, and not so far that it ends
/// meanwhile (60 m), m.
const PROVEN_OVER_M: RangeInclusive<f64> = 20.0..=45.0;
/// Most that a run is shorter at its first reading after the takeover, m: a checkpoint is at most
/// 10 s old, and robots drive at 1 m/s at most.
const SHORTER_MAX_M: f64 = 12.0;

/// Returns every robot, by its id.
fn robots(seen_by: &Instance) -> Option<BTreeMap<String, Value>> {
    let list = seen_by.try_get("/api/v1/robots?limit=100")?;
    let one = |robot: &Value| Some((robot["id"].as_str()?.to_owned(), robot.clone()));
    list["items"].as_array()?.iter().map(one).collect()
}

/// Approves all proposals that wait for driving robots.
fn approve_waiting(trial: &Trial, approver: &str) {
    let asked = trial.instances.values().next().unwrap();
    let list = asked.try_get("/api/v1/proposals?state=proposed&limit=100");
    let waiting = list.map(|list| list["items"].as_array().unwrap().clone());
    for proposal in waiting.unwrap_or_default() {
        // Those of parked robots are decided by somebody else.
        if !is_parked(proposal["robot"].as_str().unwrap()) {
            let waiting = Desk::waiting(&proposal).unwrap();
            // One that has been refreshed meanwhile is refused, and approved the next time.
            Desk::approve(asked.http, approver, &waiting, "approved to be proven");
        }
    }
}

/// Approves proposals and repeats a look until it finds something.
fn meanwhile<T>(
    trial: &Trial,
    approver: &str,
    what: &str,
    look: impl Fn(&Instance) -> Option<T>,
) -> T {
    let began = now();
    loop {
        approve_waiting(trial, approver);
        if let Some(found) = look(trial.instances.values().next().unwrap()) {
            return found;
        }
        assert!(
            began.elapsed() < Duration::from_mins(4),
            "{what} did not come"
        );
        std::thread::sleep(Duration::from_millis(500));
    }
}

/// Returns the distances that robots of an instance have driven with the calibration in
/// verification, once one has gone some way.
fn proving(seen_by: &Instance, name: &str) -> Option<BTreeMap<String, f64>> {
    let all = robots(seen_by)?.into_iter();
    let own = all.filter(|(_, robot)| robot["instance"] == name);
    let driven =
        own.filter_map(|(id, robot)| Some((id, robot["verification_distance_m"].as_f64()?)));
    let prove: BTreeMap<_, _> = driven.filter(|(_, m)| PROVEN_OVER_M.contains(m)).collect();
    (!prove.is_empty()).then_some(prove)
}

/// Kills an instance with robots in verification; returns the loss of each run at its first reading
/// afterwards, m.
fn kill(trial: &mut Trial, approver: &str) -> Vec<f64> {
    let name = *trial.instances.keys().next().unwrap();
    let before = meanwhile(trial, approver, "a robot that proves", |seen_by| {
        proving(seen_by, name)
    });
    let own: Vec<_> = before.keys().cloned().collect();
    let killed = trial.kill(name);
    trial.taken_over(killed, name, &own);
    let next = trial.instances.values().next().unwrap();
    let after = wait_for("runs that go on", || {
        let all = robots(next)?;
        let run = |id: &String| {
            let driven_m = all.get(id)?["verification_distance_m"].as_f64()?;
            Some((id.clone(), driven_m))
        };
        own.iter().map(run).collect::<Option<BTreeMap<_, _>>>()
    });
    println!("{name} killed: before {before:.1?} m, after {after:.1?} m");
    before.iter().map(|(id, m)| m - after[id]).collect()
}

/// True if every driving robot has verified its calibration.
fn are_verified(seen_by: &Instance) -> Option<()> {
    let all = robots(seen_by)?.into_keys();
    let driving: Vec<_> = all.filter(|id| !is_parked(id)).collect();
    let is_verified = |id: &String| {
        let path = format!("/api/v1/robots/{id}/deployments?limit=1");
        let list = seen_by.try_get(&path);
        list.is_some_and(|list| list["items"][0]["state"] == "verified")
    };
    (driving.len() == DRIVING && driving.iter().all(is_verified)).then_some(())
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_verification_run_goes_on_after_its_instance_was_killed() {
    let mut progress = Progress::of("verification", 1);
    for seed in progress.open() {
        progress.begin(seed);
        let mut parts = Trial::parts(true);
        parts.robots_apply = true;
        let cluster = Cluster::watched(&parts).await;
        let approver = cluster.token_of("vera");
        let mut trial = Trial::on(cluster, &parts, seed, PAUSE).await;
        let shorter_m = kill(&mut trial, &approver);
        let killed = now();
        meanwhile(&trial, &approver, "verified robots", are_verified);
        let took = killed.elapsed();
        trial.check(seed);
        println!(
            "round {seed}: {} runs went on, all {DRIVING} robots verified {took:.1?} later; {}; {}",
            shorter_m.len(),
            trial.seen(),
            progress.told(&trial.server())
        );
        progress.passed(seed, vec![shorter_m.into_iter().fold(0.0, f64::max)]);
    }
    let shorter_m = progress.figures(0);
    println!(
        "verification runs after kill -9: at most {:.1} m shorter at the first reading (N = {})",
        quantile(&shorter_m, 1.0),
        shorter_m.len()
    );
    println!("  failed or broken off: {}", progress.told_failed());
    assert!(quantile(&shorter_m, 1.0) <= SHORTER_MAX_M, "{shorter_m:?}");
}
