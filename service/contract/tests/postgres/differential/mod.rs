//! The same random operations on SQLite and on PostgreSQL give the same answers.

mod chance;
pub mod export;
mod jobs;
pub mod lifecycle;
mod methods;
mod told;

use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::Duration;

use fleetcal_clock::MockClock;
use fleetcal_contract::{TestDatabase, clock};
use fleetcal_store::Store;
use fleetcal_store::database_url::PostgresUrl;
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
use tokio::task::JoinSet;

use fleetcal_contract::own_server::{named, number, psql};
use jobs::{Kind, Operation};
pub use methods::Calls;
use told::tell;

/// Operations of a sequence.
const OPERATIONS: usize = 50;
/// Sequences that run at once, each on databases of its own.
const AT_ONCE: usize = 4;
/// Databases that are kept until their server ends: dropping one takes half a second, and keeping
/// many takes 8 MB each.
const KEPT: u64 = 50;

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn random_sequences_give_equal_answers_and_equal_exports() {
    let sequences = number("CONTRACT_SEQUENCES", 40) as u64;
    let server = named();
    let calls = Calls::default();
    let next = Arc::new(AtomicU64::new(0));
    let mut tasks = JoinSet::new();
    for _ in 0..AT_ONCE {
        let (server, calls, next) = (server.clone(), calls.clone(), Arc::clone(&next));
        tasks.spawn(async move {
            loop {
                let seed = next.fetch_add(1, Ordering::Relaxed);
                if seed >= sequences {
                    break;
                }
                sequence(&server, seed, &calls).await;
            }
        });
    }
    while let Some(ended) = tasks.join_next().await {
        ended.unwrap();
    }
    calls.assert_complete();
    println!("{sequences} sequences of {OPERATIONS} operations: equal answers, equal exports");
}

async fn sequence(server: &PostgresUrl, seed: u64, calls: &Calls) {
    let clock = clock();
    let sqlite = TestDatabase::in_sqlite();
    let postgres = TestDatabase::on(server).await;
    let stores = [
        sqlite.open(Arc::clone(&clock)).await,
        postgres.open(Arc::clone(&clock)).await,
    ];
    let mut chance = ChaCha8Rng::seed_from_u64(seed);
    for step in 0..OPERATIONS {
        let place = format!("sequence {seed}, operation {step}");
        operate(&stores, &mut chance, &clock, calls, &place).await;
    }
    let exports = [
        export::everything(&stores[0], calls).await,
        export::everything(&stores[1], calls).await,
    ];
    same(&exports, &format!("sequence {seed}, the export"));
    for store in stores {
        store.close().await.unwrap();
    }
    calls.note("reader.close");
    let database = &postgres.postgres().unwrap().url.database;
    if seed >= KEPT {
        let (server, drop) = (
            server.clone(),
            format!("DROP DATABASE {database} WITH (FORCE)"),
        );
        // PostgreSQL waits for every connection that copies, whose rows come from this runtime.
        let dropped = tokio::task::spawn_blocking(move || psql(&server, &drop));
        dropped.await.unwrap();
    }
}

/// Fills a store by random operations.
pub async fn filled(store: &Store, operations: u64, calls: &Calls) {
    for seed in 0..operations {
        tell(store, seed);
        let operation = Operation {
            kind: Kind::ALL[seed as usize % Kind::ALL.len()],
            seed,
            now: store.now(),
            calls: calls.clone(),
        };
        store.transact(operation).await.unwrap();
    }
    store.flush().await.unwrap();
}

/// Performs one operation on both.
async fn operate(
    stores: &[Store; 2],
    chance: &mut ChaCha8Rng,
    clock: &MockClock,
    calls: &Calls,
    place: &str,
) {
    clock.advance(Duration::from_millis(chance.random_range(0..20_000)));
    let seed = chance.random();
    if chance.random_bool(0.25) {
        for store in stores {
            tell(store, seed);
            store.flush().await.unwrap();
        }
        return;
    }
    let operation = Operation {
        kind: chance::pick(chance, Kind::ALL),
        seed,
        now: stores[0].now(),
        calls: calls.clone(),
    };
    let mut answers = Vec::new();
    for store in stores {
        let answer = store.transact(operation.clone()).await;
        answers.push(answer.unwrap_or_else(|error| panic!("{place}, {operation:?}: {error:?}")));
    }
    let answers: [_; 2] = answers.try_into().unwrap();
    same(&answers, &format!("{place}, {operation:?}"));
}

/// Asserts that both are equal, line by line.
fn same(both: &[String; 2], place: &str) {
    let [sqlite, postgres] = both;
    for (left, right) in sqlite.lines().zip(postgres.lines()) {
        assert_eq!(left, right, "{place}");
    }
    assert_eq!(sqlite, postgres, "{place}");
}
