//! Measures `fleetcal store copy`: fills a data folder with the history of robots, and copies it
//! into a PostgreSQL, which `FLEETCAL_TEST_POSTGRES` names.
//!
//! `cargo run --release --example copy_load -- [ROBOTS] [SECONDS]`
#![expect(
    clippy::print_stdout,
    clippy::disallowed_methods,
    clippy::unwrap_used,
    reason = "it measures, and prints what it measured"
)]

use std::path::Path;
use std::time::Instant;

use fleetcal_contract::{NOW_S, TestDatabase, clock, record, server};
use fleetcal_sqlite::Source;

#[tokio::main]
async fn main() {
    let mut arguments = std::env::args().skip(1);
    let mut number = |usual: i64| arguments.next().map_or(usual, |text| text.parse().unwrap());
    let (robots, seconds) = (number(200), number(2_500));
    let sqlite = TestDatabase::in_sqlite();
    let store = sqlite.open(clock()).await;
    for second in 0..seconds {
        for robot in 0..robots {
            let offset_rad = 1e-4 * ((robot * 31 + second * 17) % 997) as f64;
            record(
                &store,
                &format!("robot_{robot:04}"),
                NOW_S + second,
                offset_rad,
            );
        }
        store.flush().await.unwrap();
    }
    store.close().await.unwrap();
    drop(store);
    let postgres = TestDatabase::on(&server().unwrap()).await;
    let setup = postgres.postgres().unwrap().clone();
    let mut from = Source::open(Path::new(&sqlite.address())).await.unwrap();
    let began = Instant::now();
    let copied = fleetcal_postgres::copy(&mut from, setup, &|_| {}).await;
    let rows: u64 = copied
        .unwrap()
        .iter()
        .map(|(_, content)| content.rows)
        .sum();
    let took_s = began.elapsed().as_secs_f64();
    let rate = rows as f64 / took_s;
    println!("{rows} rows copied, read again and found equal in {took_s:.1} s: {rate:.0} rows/s");
}
