//! Fixtures of tests on the real database.

use std::sync::Arc;

use fleetcal_clock::MockClock;
use fleetcal_contract::TestDatabase;
use fleetcal_model::RobotId;
use fleetcal_store::Store;

/// Wall time at which the tests begin: 2026-01-01.
pub(crate) const NOW_NS: i64 = 1_767_225_600_000_000_000;

pub(crate) fn robot(name: &str) -> RobotId {
    RobotId::parse(name).unwrap()
}

pub(crate) fn clock() -> Arc<MockClock> {
    MockClock::at(NOW_NS)
}

/// Store that runs each job twice, of which the first run is undone: so every test here shows that
/// its jobs can be repeated.
pub(crate) async fn open(database: &TestDatabase, clock: &Arc<MockClock>) -> Store {
    database.open_running_twice(Arc::clone(clock)).await
}
