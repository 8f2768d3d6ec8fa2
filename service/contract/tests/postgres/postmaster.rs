//! A postmaster that is killed while a store writes.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

use fleetcal_contract::{NOW_S, clock, query, record};
use fleetcal_postgres::open;
use fleetcal_store::{Store, StoreError};
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
use tokio::task::JoinHandle;
use tokio::time::Instant;

use crate::decision::{Decide, times_decided};
use fleetcal_contract::own_server::{OwnServer, number, setup};

/// Time within which the store writes again after the server's return.
const AGAIN_WITHIN: Duration = Duration::from_secs(5);
/// Time within which a decision is refused while the server is away.
const REFUSED_WITHIN: Duration = Duration::from_secs(3);
/// Seconds of history that are recorded in a round while the server is away.
const TOLD_AWAY: i64 = 200;

/// Decisions and their outcomes.
#[derive(Debug, Default)]
struct Decided {
    acknowledged: Vec<Decide>,
    unknown: Vec<Decide>,
    refused: Vec<Decide>,
}

impl Decided {
    async fn decide(&mut self, store: &Store, name: String) -> Result<(), StoreError> {
        let decision = Decide(name);
        let told = store.transact(decision.clone()).await;
        match &told {
            Ok(_) => self.acknowledged.push(decision),
            Err(StoreError::Commit(_)) => self.unknown.push(decision),
            Err(_) => self.refused.push(decision),
        }
        told.map(drop)
    }

    /// Asserts that the database holds acknowledged decisions once, refused ones never, and unknown
    /// ones at most once.
    async fn assert_kept(&self, store: &Store) {
        let times = times_decided(store, &self.acknowledged).await;
        assert!(times.iter().all(|&times| times == 1), "{times:?}");
        let times = times_decided(store, &self.refused).await;
        assert!(times.iter().all(|&times| times == 0), "{times:?}");
        let times = times_decided(store, &self.unknown).await;
        assert!(times.iter().all(|&times| times <= 1), "{times:?}");
    }
}

/// Idle time in which a server process notices that its postmaster is gone.
const IDLE_FOR: Duration = Duration::from_millis(50);

/// Makes one decision after another until stopped.
fn deciding(store: &Store, round: usize, stop: &Arc<AtomicBool>) -> JoinHandle<Decided> {
    let (store, stop) = (store.clone(), Arc::clone(stop));
    tokio::spawn(async move {
        let mut decided = Decided::default();
        for count in 0_u32.. {
            if stop.load(Ordering::Relaxed) {
                break;
            }
            let name = format!("{round}: {count}");
            if decided.decide(&store, name).await.is_err() {
                tokio::time::sleep(Duration::from_millis(5)).await;
            }
        }
        decided
    })
}

/// Makes decisions until the server's last processes have noticed that their postmaster is gone:
/// whatever one of them acknowledges counts.
async fn until_gone(store: &Store, round: usize) -> Decided {
    let mut decided = Decided::default();
    let killed = Instant::now();
    let mut count = 0;
    while decided
        .decide(store, format!("{round} late: {count}"))
        .await
        .is_ok()
    {
        assert!(killed.elapsed() < AGAIN_WITHIN, "it still decides");
        count += 1;
        // A server process that always has something to read does not look for its postmaster.
        tokio::time::sleep(IDLE_FOR).await;
    }
    decided
}

/// Exercises decisions and telemetry while the server is away.
async fn away(store: &Store, round: usize, from_s: i64) {
    for second in 0..TOLD_AWAY {
        record(store, "a", from_s + second, 0.5);
    }
    for count in 0..3 {
        let began = Instant::now();
        let refused = store
            .transact(Decide(format!("{round} away: {count}")))
            .await;
        let took = began.elapsed();
        assert!(took < REFUSED_WITHIN, "{took:?}");
        let told = refused.unwrap_err();
        let text = told.to_string();
        assert!(
            matches!(
                told,
                StoreError::Server { .. } | StoreError::Database { .. }
            ),
            "{told:?}"
        );
        assert!(text.contains("the database"), "{text}");
    }
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn nothing_acknowledged_is_lost_when_the_postmaster_is_killed() {
    let rounds = number("CONTRACT_KILLS", 6);
    let server = OwnServer::start_new("trust");
    let url = server.url("postgres");
    let store = open(setup(&url), Box::new(()), clock() as _).await.unwrap();
    let mut chance = ChaCha8Rng::seed_from_u64(7);
    let mut slowest = Duration::ZERO;
    let mut count = 0;
    for round in 0..rounds {
        let from_s = NOW_S + round as i64 * 3_600;
        let stop = Arc::default();
        let decider = deciding(&store, round, &stop);
        let busy = Instant::now();
        let busy_for = Duration::from_millis(chance.random_range(100..600));
        let mut second = 0;
        while busy.elapsed() < busy_for {
            record(&store, "busy", from_s + second, 0.5);
            second += 1;
            tokio::time::sleep(Duration::from_millis(2)).await;
        }
        server.kill();
        let late = until_gone(&store, round).await;
        away(&store, round, from_s).await;
        server.start();
        let back = Instant::now();
        let mut decided = Decided::default();
        while let Err(error) = decided.decide(&store, format!("{round} back")).await {
            assert!(back.elapsed() < 2 * AGAIN_WITHIN, "{error:?}");
        }
        while let Err(error) = store.flush().await {
            assert!(back.elapsed() < 2 * AGAIN_WITHIN, "{error:?}");
        }
        let took = back.elapsed();
        assert!(took < AGAIN_WITHIN, "{took:?}");
        slowest = slowest.max(took);
        stop.store(true, Ordering::Relaxed);
        let told = decider.await.unwrap();
        told.assert_kept(&store).await;
        late.assert_kept(&store).await;
        count += told.acknowledged.len();
        let of_absence = query("a", from_s, from_s + TOLD_AWAY, 600);
        let seconds = store.history(&of_absence).await.unwrap().stretches.len();
        assert_eq!(seconds as i64, TOLD_AWAY, "seconds of round {round}");
    }
    let lost = store.counters().lost;
    assert_eq!(lost, 0);
    println!("{rounds} kills, {count} decisions; the slowest return took {slowest:?}");
    store.close().await.unwrap();
}
