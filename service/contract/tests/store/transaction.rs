//! Jobs: their order, what becomes of one that fails, and how long one waits beside telemetry.

use std::sync::Arc;
use std::sync::atomic::{AtomicU32, Ordering};
use std::time::Duration;

use async_trait::async_trait;
use fleetcal_contract::{
    AddUser, IsThere, KeepRobot, NOW_S, NS, TestDatabase, clock, config, event, record, robot,
};
use fleetcal_domain::access::{AccountRefused, Actor};
use fleetcal_domain::audit::Action;
use fleetcal_domain::limits;
use fleetcal_model::WallTime;
use fleetcal_store::{AuditEntry, AuditFilter, Job, Records, StoreError};

/// Job that adds a user, counts its runs, and is then refused.
#[derive(Debug)]
struct AddAndRefuse(&'static str, Arc<AtomicU32>);

#[async_trait]
impl Job for AddAndRefuse {
    type Done = ();

    async fn run(&self, records: &mut dyn Records) -> Result<(), StoreError> {
        AddUser(self.0).run(records).await?;
        self.1.fetch_add(1, Ordering::Relaxed);
        Err(AccountRefused::SessionUnknown.into())
    }
}

#[tokio::test]
async fn jobs_are_done_in_the_order_of_their_arrival() {
    let database = TestDatabase::new().await;
    let store = database.open(clock()).await;
    // One thread: all of them wait before the first one runs.
    let (before, added, after) = tokio::join!(
        store.transact(IsThere("ann")),
        store.transact(AddUser("ann")),
        store.transact(IsThere("ann")),
    );
    assert_eq!((before.unwrap(), after.unwrap()), (false, true));
    added.unwrap();
}

#[tokio::test]
async fn a_refused_job_leaves_nothing_behind_and_the_others_alone() {
    let database = TestDatabase::new().await;
    let store = database.open(clock()).await;
    let runs = Arc::default();
    let (first, refused, second, gone) = tokio::join!(
        store.transact(AddUser("ann")),
        store.transact(AddAndRefuse("bob", Arc::clone(&runs))),
        store.transact(AddUser("eve")),
        store.transact(IsThere("bob")),
    );
    first.unwrap();
    second.unwrap();
    assert!(
        matches!(refused, Err(StoreError::Account(_))),
        "{refused:?}"
    );
    assert!(!gone.unwrap());
    assert_eq!(runs.load(Ordering::Relaxed), 1);
    let users = store.users(0, 10).await.unwrap();
    let names: Vec<_> = users.iter().map(|user| user.name.as_str()).collect();
    assert_eq!(names, ["ann", "eve"]);
}

#[tokio::test]
async fn a_job_that_the_database_fails_leaves_the_others_alone() {
    let database = TestDatabase::new().await;
    let store = database.open(clock()).await;
    // The name is taken, which only the table's own rule says.
    let (first, failed, second) = tokio::join!(
        store.transact(AddUser("ann")),
        store.transact(AddUser("ANN")),
        store.transact(AddUser("eve")),
    );
    let (first, second) = (first.unwrap(), second.unwrap());
    assert!(first < second, "{first} {second}");
    assert!(
        matches!(failed, Err(StoreError::Database { .. })),
        "{failed:?}"
    );
}

#[tokio::test]
async fn a_job_may_be_run_again_and_counts_once() {
    let database = TestDatabase::new().await;
    let store = database.open_running_twice(clock()).await;
    let ann = store.transact(AddUser("ann")).await.unwrap();
    let eve = store.transact(AddUser("eve")).await.unwrap();
    assert!(ann < eve, "{ann} {eve}");
    let runs = Arc::default();
    let refused = store.transact(AddAndRefuse("bob", Arc::clone(&runs)));
    refused.await.unwrap_err();
    assert_eq!(runs.load(Ordering::Relaxed), 2);
    assert_eq!(store.users(0, 10).await.unwrap().len(), 2);
}

/// Checks the numbers with every job run twice, and undone the first time.
#[tokio::test]
async fn numbers_of_the_audit_have_no_gaps_and_its_rows_are_linked() {
    #[derive(Debug)]
    struct Append;
    #[async_trait]
    impl Job for Append {
        type Done = ();
        async fn run(&self, records: &mut dyn Records) -> Result<(), StoreError> {
            let entry = AuditEntry {
                at_ns: WallTime(NOW_S * NS),
                actor: Actor::service(),
                action: Action::NoteEvent,
                subject_id: "1".to_owned(),
                robot: None,
                before: None,
                after: None,
                reason: None,
            };
            records.append_audit(&entry).await
        }
    }
    let database = TestDatabase::new().await;
    let store = database.open_running_twice(clock()).await;
    for _ in 0..3 {
        store.transact(Append).await.unwrap();
    }
    let all = AuditFilter {
        limit: 10,
        ..AuditFilter::default()
    };
    let rows = store.audit(&all).await.unwrap();
    let numbers: Vec<i64> = rows.iter().map(|row| row.id.0).collect();
    assert_eq!(numbers, [3, 2, 1]);
    assert!(rows.iter().all(|row| row.link.is_some()));
    for (place, row) in rows.iter().enumerate() {
        row.check_after(rows.get(place + 1)).unwrap();
    }
}

#[tokio::test]
async fn a_robot_that_a_refused_job_made_is_made_again() {
    #[derive(Debug)]
    struct KeepAndRefuse(KeepRobot);
    #[async_trait]
    impl Job for KeepAndRefuse {
        type Done = ();
        async fn run(&self, records: &mut dyn Records) -> Result<(), StoreError> {
            self.0.run(records).await?;
            Err(AccountRefused::SessionUnknown.into())
        }
    }
    let database = TestDatabase::new().await;
    let store = database.open(clock()).await;
    let keep = || KeepRobot(config(1.0), event("x"));
    store.transact(KeepAndRefuse(keep())).await.unwrap_err();
    assert_eq!(store.load_robots().await.unwrap(), []);
    store.transact(keep()).await.unwrap();
    record(&store, "a", NOW_S, 0.1);
    store.flush().await.unwrap();
    assert_eq!(store.events(&robot("a"), None, 10).await.unwrap().len(), 1);
}

/// Runs a job in the middle of a full queue of telemetry: it is committed after a few short
/// transactions, without waiting for all of it.
#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn telemetry_delays_no_job() {
    let database = TestDatabase::new().await;
    let store = database.open(clock()).await;
    let written = || store.counters().history_rows;
    let rows = limits::STORE_QUEUE_MAX as i64;
    for second in 0..rows {
        record(&store, "a", NOW_S + second, 0.5);
    }
    let mut rows_waited_for = Vec::new();
    for _ in 0..15 {
        let before = written();
        let began = tokio::time::Instant::now();
        store.transact(IsThere("ann")).await.unwrap();
        let rows = written() - before;
        println!("{rows} rows and {:?} before a job", began.elapsed());
        rows_waited_for.push(rows);
        tokio::time::sleep(Duration::from_millis(1)).await;
    }
    assert!(written() < rows as u64, "there was too little telemetry");
    // Most of them: where the machine is busy, a task may sleep through several transactions.
    rows_waited_for.sort_unstable();
    let median = rows_waited_for[rows_waited_for.len() / 2];
    let batch = limits::STORE_TELEMETRY_ROWS_MAX as u64;
    assert!(median <= 3 * batch, "{rows_waited_for:?}");
    store.flush().await.unwrap();
    assert_eq!(written(), rows as u64);
}
