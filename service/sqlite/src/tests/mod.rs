//! The store on SQLite: its file, its folder, and what survives.

mod administration;
mod connection;
mod durability;
mod transaction;
mod upgrade;

use std::path::Path;
use std::sync::Arc;

use fleetcal_clock::MockClock;
use fleetcal_contract::{NOW_S, clock, query, record, robot};
use fleetcal_store::Store;

async fn open(folder: &Path, clock: &Arc<MockClock>) -> Store {
    crate::open(folder, Arc::clone(clock) as _).await.unwrap()
}
