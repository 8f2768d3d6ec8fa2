//! Measures what dropping a day of history costs writers and readers: an old day of many
//! robots is there when a store opens on PostgreSQL, which `FLEETCAL_TEST_POSTGRES` names.
//!
//! `cargo run --release --example drop_day -- [ROBOTS]`: each has 86,400 seconds of some 170 bytes.
#![expect(
    clippy::print_stdout,
    clippy::disallowed_methods,
    clippy::unwrap_used,
    reason = "it measures, and prints what it measured"
)]

use std::time::{Duration, Instant};

use fleetcal_contract::{NOW_S, TestDatabase, clock, query, record, server};

/// A day of 2025.
const DAY: i64 = 20_100;
/// Time for which writing and reading continue after the day is dropped.
const AFTER: Duration = Duration::from_secs(2);

#[tokio::main]
async fn main() {
    let robots = std::env::args().nth(1);
    let robots = robots.map_or(100, |text| text.parse().unwrap());
    let database = TestDatabase::on(&server().unwrap()).await;
    // Makes the tables.
    database.open(clock()).await.close().await.unwrap();
    let setup = database.postgres().unwrap();
    let filled = fleetcal_postgres::fill_day_for_test(setup, DAY, robots).await;
    filled.unwrap();
    let store = database.open(clock()).await;
    let began = Instant::now();
    let (mut dropped, mut write, mut read) = (None, Duration::ZERO, Duration::ZERO);
    let mut second = 0;
    while dropped.is_none_or(|after: Duration| began.elapsed() < after + AFTER) {
        let asked = Instant::now();
        record(&store, "a", NOW_S + second, 0.5);
        store.flush().await.unwrap();
        write = write.max(asked.elapsed());
        let asked = Instant::now();
        let latest = query("a", NOW_S, NOW_S + second + 1, 60);
        store.history(&latest).await.unwrap();
        read = read.max(asked.elapsed());
        second += 1;
        if store.counters().pruned_rows >= 86_400 * robots.unsigned_abs() {
            dropped.get_or_insert(began.elapsed());
        }
    }
    store.close().await.unwrap();
    println!(
        "{} seconds of {robots} robots were gone after {:.1?}; of {second} turns the longest write \
         took {write:.1?}, the longest read {read:.1?}",
        86_400 * robots,
        dropped.unwrap()
    );
}
