//! A link that is cut and a router that is restarted while a robot sends.

use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::time::Duration;

use fleetcal_ports::free_address;
use fleetcal_tests::service::{Service, now, wait_for};
use serde_json::json;
use tempfile::TempDir;

use super::link::Link;
use super::lists::received;
use super::robot;
use super::router::Router;

/// Number of cuts of the link and restarts of the router, in turn.
const ROUNDS: u32 = 20;
/// Time within which ingest is back.
const BACK_WITHIN: Duration = Duration::from_secs(5);
/// Duration of a cut of the link.
const CUT: Duration = Duration::from_millis(300);

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn after_cuts_and_restarts_ingest_is_back_and_no_sample_counts_twice() {
    let folder = TempDir::new().unwrap();
    let address = free_address();
    let config = folder.path().join("router.json5");
    let router_config = json!({
        "mode": "router",
        "listen": { "endpoints": [format!("tcp/{address}")] },
        "scouting": { "multicast": { "enabled": false } },
    });
    std::fs::write(&config, router_config.to_string()).unwrap();
    let mut router = Router::start(&config).await;
    let (zenoh, to_router) = (free_address(), format!("tcp/{address}"));
    let known = "[[robot]]\nid = \"tugger_01\"\nmodel = \"bicycle\"\nwheelbase_m = 1.2\n";
    let own = format!("tcp/{zenoh}");
    let service = Service::start_on(zenoh, known, &["-l", &own, "-e", &to_router]);
    let link = Link::to(address).await;
    let session = robot::open(robot::client(&link.endpoint, &json!({}))).await;
    let session = session.unwrap();
    let stream = robot::stream(&session, "tugger_01").await;

    let (sent, goes_on) = (Arc::new(AtomicU64::new(0)), Arc::new(AtomicBool::new(true)));
    let (counter, wanted) = (Arc::clone(&sent), Arc::clone(&goes_on));
    let sender = tokio::spawn(async move {
        while wanted.load(Ordering::Relaxed) {
            let number = counter.fetch_add(1, Ordering::Relaxed);
            stream.put(robot::sample(number)).await.unwrap();
            tokio::time::sleep(Duration::from_millis(10)).await;
        }
    });
    let mut slowest = Duration::ZERO;
    for round in 0..ROUNDS {
        wait_for_more(&service);
        if round % 2 == 0 {
            link.carries(false);
            tokio::time::sleep(CUT).await;
            link.carries(true);
        } else {
            router.stop().await;
            router = Router::start(Path::new(&config)).await;
        }
        let began = now();
        wait_for_more(&service);
        slowest = slowest.max(began.elapsed());
    }
    goes_on.store(false, Ordering::Relaxed);
    sender.await.unwrap();
    let counters = service.accounts_of("tugger_01");
    let sent = sent.load(Ordering::Relaxed);
    println!(
        "{ROUNDS} times cut or restarted: ingest back within {slowest:?}; {sent} samples sent, {} \
         received",
        counters["received"]
    );
    assert!(slowest < BACK_WITHIN, "{slowest:?}");
    assert!(counters["received"].as_u64().unwrap() <= sent, "{counters}");
    let estimate = service.get("/api/v1/robots/tugger_01/estimate");
    assert_eq!(estimate["counts"]["duplicates"], 0, "{estimate}");
    assert_eq!(estimate["counts"]["late"], 0, "{estimate}");
    router.stop().await;
}

/// Waits for samples that were sent from now on: more than can be in flight.
fn wait_for_more(service: &Service) {
    let before = received(service, "tugger_01");
    wait_for("more samples", || {
        (received(service, "tugger_01") > before + 5).then_some(())
    });
}
