//! Faults that are planted beside the product: the checker has to find each, or its silence in a
//! campaign says nothing.

use std::process::Command;
use std::sync::Arc;
use std::time::Duration;

use fleetcal_cluster::{ClaimId, Seat};
use fleetcal_contract::own_server::{Beside, OwnServer, psql, setup, url_of};
use fleetcal_contract::{
    KeepRobot, NOW_S, clock, config, event, joining, open_instance, record, robot,
};
use fleetcal_model::RobotTime;
use fleetcal_postgres::Fencing;
use fleetcal_store::Store;
use fleetcal_store::cluster::{ClusterRegistry, Renewal, TakeForDead};
use fleetcal_store::database_url::PostgresUrl;
use fleetcal_tests::service::{now, wait_for};

use crate::checker::{Evidence, Violation};
use crate::network::Cut;
use crate::records;
use crate::trial::Trial;

/// Time after which a wait that fails to happen would be noticed.
const MOMENT: Duration = Duration::from_millis(500);

/// Store of an instance, and its life.
struct Writer {
    store: Store,
    registry: Arc<dyn ClusterRegistry>,
    seat: Seat,
}

impl Writer {
    async fn join(server: &OwnServer, name: &str, fencing: Fencing) -> Self {
        let url = url_of(&[&server.host()], name, "postgres");
        let store = open_instance(setup(&url), name, fencing).await.unwrap();
        let registry = store.registry().unwrap();
        let seat = registry.join(&joining(name)).await.unwrap();
        let renewal = Renewal {
            linked: true,
            ..Renewal::default()
        };
        assert!(registry.renew(&seat, renewal).await.unwrap().is_some());
        Self {
            store,
            registry,
            seat,
        }
    }

    async fn claim(&self, claim: i64) {
        let wanted = [(robot("a"), ClaimId(claim))];
        for tenure in self.registry.claim(&self.seat, &wanted).await.unwrap() {
            self.store.claims().set(&tenure);
        }
    }

    /// Passes the output of the robot's estimator in second `t_s` to the store.
    fn tell(&self, t_s: i64) {
        record(&self.store, "a", t_s, 0.1);
        let state = vec![2, t_s as u8];
        self.store
            .save_checkpoint(&robot("a"), RobotTime(t_s), state);
    }
}

/// Declares an instance dead that is between its fence and its rows, like one that is frozen there;
/// returns the evidence.
async fn frozen_in_the_midst_of_a_write(fencing: Fencing) -> Evidence {
    let server = records::server(None);
    let url = server.url("postgres");
    let opened = fleetcal_postgres::open(setup(&url), Box::new(()), clock() as _);
    let store = opened.await.unwrap();
    let keep = KeepRobot(config(1.2), event("kept"));
    store.transact(keep).await.unwrap();
    store.close().await.unwrap();
    records::watch(&url, &["one", "two"]);
    let one = Writer::join(&server, "one", fencing).await;
    let two = Writer::join(&server, "two", Fencing::Locked).await;
    one.claim(1).await;
    one.tell(NOW_S);
    one.store.flush().await.unwrap();

    let frozen = Beside::run(&url, "BEGIN; LOCK TABLE checkpoint IN EXCLUSIVE MODE");
    one.tell(NOW_S + 1);
    let store = one.store.clone();
    let writing = tokio::spawn(async move { store.flush().await });
    wait_for("a write that waits", || {
        let waiting = "SELECT count(*) FROM pg_locks
            WHERE relation = 'checkpoint'::regclass AND NOT granted";
        (psql(&url, waiting).trim() == "1").then_some(())
    });
    psql(
        &url,
        "UPDATE instance SET lease_ends_ns = clock_ns() - 1 WHERE id = 'one'",
    );
    let taking = async {
        let taken = two
            .registry
            .take_for_dead(&two.seat, TakeForDead::LeaseEnded);
        assert_eq!(taken.await.unwrap().len(), 1);
        two.claim(2).await;
    };
    let mut taking = std::pin::pin!(taking);
    let waits = tokio::time::timeout(MOMENT, &mut taking).await.is_err();
    drop(frozen);
    // The rest of what is written may wait for the row that is taken.
    let taken = async {
        if waits {
            taking.await;
        }
    };
    let (written, ()) = tokio::join!(writing, taken);
    written.unwrap().unwrap();
    two.tell(NOW_S + 2);
    two.store.flush().await.unwrap();
    let mut evidence = Evidence::default();
    records::read(&url, &mut evidence);
    assert!(evidence.written.iter().any(|row| row.by == "two"));
    one.store.close().await.unwrap();
    two.store.close().await.unwrap();
    evidence
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_fence_without_its_row_lock_is_found() {
    let in_order = frozen_in_the_midst_of_a_write(Fencing::Locked).await;
    assert_eq!(in_order.violations(), []);
    let found = frozen_in_the_midst_of_a_write(Fencing::Unlocked)
        .await
        .violations();
    println!("without the row lock: {found:?}");
    let is_late = |one: &Violation| matches!(one, Violation::StaleRow { by, .. } if by == "one");
    assert!(!found.is_empty() && found.iter().all(is_late), "{found:?}");
}

/// Ends the lease in the database while the instance, which cannot reach it, trusts it for seconds,
/// like an instance without a gate whose lease has ended.
#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn an_instance_whose_gate_does_not_close_is_found() {
    let trial = Trial::start(true, 7, Duration::from_millis(200)).await;
    assert_eq!(trial.evidence().violations(), []);
    let robots = trial.of_instance("a");
    wait_for("a renewal", || {
        let left = "SELECT lease_ends_ns - clock_ns() > 5700000000 FROM instance WHERE id = 'a'";
        (psql(&trial.url(), left).trim() == "t").then_some(())
    });
    let began = now();
    trial.cluster.lines("a").database.cut(Cut::Both);
    let ended = "UPDATE instance SET lease_ends_ns = clock_ns() - 1 WHERE id = 'a'";
    psql(&trial.url(), ended);
    trial.taken_over(began, "a", &robots);
    std::thread::sleep(Duration::from_secs(5).saturating_sub(began.elapsed()));
    trial.cluster.lines("a").database.heal();
    trial.balanced();
    let found = trial.evidence().violations();
    println!("without a gate: {found:?}");
    let is_late =
        |one: &Violation| matches!(one, Violation::StaleEstimates { by, .. } if by == "a");
    assert!(!found.is_empty() && found.iter().all(is_late), "{found:?}");
}

/// Number of kills of a server whose commits do not wait for the disk.
const KILLS_MAX: usize = 5;

/// Kills all processes of a server whose commits do not wait for the disk, which so forgets
/// acknowledged ones with its memory.
#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn an_asynchronous_commit_is_found() {
    let trial = Trial::start(true, 7, Duration::from_millis(20)).await;
    psql(&trial.url(), "ALTER SYSTEM SET synchronous_commit = off");
    psql(&trial.url(), "SELECT pg_reload_conf()");
    let server = trial.cluster.server.as_ref().unwrap();
    let (mut found, mut lost) = (Vec::new(), 0);
    // On a busy machine other commits, which wait for the disk, take most of the decisions with them.
    for _ in 0..KILLS_MAX {
        stop_walwriter(&trial.url());
        let before = trial.decider.acknowledged();
        wait_for("decisions", || {
            (trial.decider.acknowledged() >= before + 20).then_some(())
        });
        records::kill_processes(&trial.url());
        std::thread::sleep(Duration::from_secs(1));
        server.start();
        let back = now();
        wait_for("a decision", || trial.decider.acknowledged_since(back));
        found = trial.evidence().violations();
        let is_lost = |one: &&Violation| matches!(one, Violation::Lost { .. });
        lost = found.iter().filter(is_lost).count();
        if lost > 5 {
            break;
        }
    }
    println!("with asynchronous commits: {lost} acknowledged decisions lost");
    assert!(lost > 5, "{found:?}");
}

/// Stops the process that would write full pages soon: the commits that an asynchronous server
/// leaves to it stay in memory.
fn stop_walwriter(url: &PostgresUrl) {
    let writer = "SELECT pid FROM pg_stat_activity WHERE backend_type = 'walwriter'";
    let stopped = Command::new("kill")
        .args(["-s", "STOP", psql(url, writer).trim()])
        .status();
    assert!(stopped.unwrap().success());
    std::thread::sleep(Duration::from_secs(1));
}
