//! Names of the instances of a cluster.

use fleetcal_contract::{NOW_S, clock, instance, joining, open_instance, record};
use fleetcal_postgres::Fencing;
use fleetcal_store::StoreError;
use fleetcal_store::cluster::{Joining, TakeForDead};
use fleetcal_store::database_url::PostgresUrl;

use super::instance::{Instance, database, end_lease};
use crate::startup::new_role;
use fleetcal_contract::own_server::{psql, setup};

fn told<T: std::fmt::Debug>(refused: Result<T, StoreError>) -> String {
    refused.unwrap_err().to_string()
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_name_is_one_processs_until_it_ends() {
    let (url, robots) = database(3).await;
    let first = Instance::join(&url, "a").await;
    assert_eq!(first.claim(&robots, 1).await.len(), 3);
    let second = open_instance(setup(&url), "a", Fencing::Locked)
        .await
        .unwrap();
    let told = told(second.registry().unwrap().join(&joining("a")).await);
    assert!(
        told.contains("has an instance a already, from 127.0.0.1"),
        "{told}"
    );
    assert!(first.renew().await, "the first one lives on");
    assert_eq!(first.robots().await.len(), 3);

    // As after kill -9: its connections are gone, its row and its robots are still there.
    let former = first.seat.clone();
    first.store.close().await.unwrap();
    drop(first);
    let registry = second.registry().unwrap();
    let seat = registry.join(&joining("a")).await.unwrap();
    assert!(seat.incarnation > former.incarnation);
    let look = registry.look(None).await.unwrap();
    assert_eq!(look.snapshot.members.len(), 1);
    assert_eq!(look.snapshot.members[0].seat, seat);
    let rows = look.snapshot.robots.values();
    assert!(rows.clone().count() == 3 && rows.clone().all(|row| row.owner.is_none()));
    assert!(rows.clone().all(|row| row.free_since.is_some()));
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn an_instance_that_lost_its_connection_keeps_its_name_and_its_seat() {
    let (url, _) = database(1).await;
    let a = Instance::join(&url, "a").await;
    for _ in 0..3 {
        let ended = "SELECT count(pg_terminate_backend(pid)) FROM pg_stat_activity
            WHERE datname = current_database() AND pid <> pg_backend_pid()";
        psql(&url, ended);
        assert!(a.renew().await);
        assert_eq!(a.look().await.snapshot.members.len(), 1);
    }
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_service_that_is_alone_and_an_instance_exclude_each_other() {
    let (url, _) = database(1).await;
    let alone = || fleetcal_postgres::open(setup(&url), Box::new(()), clock() as _);
    let a = Instance::join(&url, "a").await;
    let b = Instance::join(&url, "b").await;
    let refused = told(alone().await);
    assert!(
        refused.contains("is served by another fleetcal"),
        "{refused}"
    );
    for one in [a, b] {
        one.registry.leave(&one.seat).await.unwrap();
        one.store.close().await.unwrap();
    }
    let store = alone().await.unwrap();
    assert!(store.registry().is_none());
    let refused = told(open_instance(setup(&url), "a", Fencing::Locked).await);
    assert!(refused.contains("is no instance of a cluster"), "{refused}");
    store.close().await.unwrap();
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_role_with_fewer_rights_is_an_instance() {
    let (url, robots) = database(2).await;
    let role = new_role("instance");
    let migrated = fleetcal_postgres::migrate(setup(&url), Some(&role)).await;
    migrated.unwrap();
    let serving = PostgresUrl {
        user: role,
        ..url.clone()
    };
    let a = Instance::join(&serving, "a").await;
    let b = Instance::join(&serving, "b").await;
    let tenures = a.claim(&robots, 1).await;
    assert_eq!(tenures.len(), 2);
    record(&a.store, robots[0].as_str(), NOW_S, 0.1);
    a.store.flush().await.unwrap();
    assert_eq!(a.store.counters().history_rows, 1);
    a.registry.free(&a.seat, &robots[..1]).await.unwrap();
    end_lease(&url, "a");
    let taken = b.registry.take_for_dead(&b.seat, TakeForDead::LeaseEnded);
    assert_eq!(taken.await.unwrap(), std::slice::from_ref(&a.seat));
    let members = b.look().await.snapshot.members;
    let ended: Vec<_> = members.iter().map(|member| member.is_ended).collect();
    assert_eq!(ended, [true, false], "{members:?}");
    b.registry.leave(&b.seat).await.unwrap();
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn who_signs_with_another_key_is_refused() {
    let (url, _) = database(1).await;
    let a = Instance::join(&url, "a").await;
    let store = open_instance(setup(&url), "b", Fencing::Locked)
        .await
        .unwrap();
    let registry = store.registry().unwrap();
    let other = Joining {
        signing_key: "another key".to_owned(),
        ..joining("b")
    };
    let refused = told(registry.join(&other).await);
    let expected = "got another key, expected key of the site";
    assert!(refused.contains(expected), "{refused}");
    assert_eq!(a.look().await.snapshot.members.len(), 1, "it is not there");
    registry.join(&joining("b")).await.unwrap();
    assert_eq!(a.look().await.snapshot.members.len(), 2);
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_key_that_follows_is_taken_over_and_the_former_one_is_refused_after_it() {
    let (url, _) = database(1).await;
    let a = Instance::join(&url, "a").await;
    let join = async |name: &str, key: &str, formers: &[&str]| {
        let store = open_instance(setup(&url), name, Fencing::Locked).await;
        let joining = Joining {
            signing_key: key.to_owned(),
            former_signing_keys: formers.iter().map(|&former| former.to_owned()).collect(),
            ..joining(name)
        };
        let registry = store.unwrap().registry().unwrap();
        registry.join(&joining).await.map(drop)
    };
    let stranger = join("b", "new key", &["key of others"]).await;
    assert!(stranger.is_err());
    join("b", "new key", &["oldest key", "key of the site"])
        .await
        .unwrap();
    // Those that began before go on until they start again.
    assert!(a.renew().await);
    let former = told(join("c", "key of the site", &["oldest key"]).await);
    assert!(
        former.contains("got key of the site, expected new key"),
        "{former}"
    );
    join("c", "new key", &["key of the site"]).await.unwrap();
}

/// Checks that a wrong liveliness token of Zenoh does not end a connected instance.
#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn who_is_gone_is_taken_for_dead_at_once_and_who_is_connected_is_not() {
    let (url, robots) = database(2).await;
    let a = Instance::join(&url, "a").await;
    let b = Instance::join(&url, "b").await;
    assert_eq!(b.claim(&robots, 1).await.len(), 2);
    let gone = [instance("a"), instance("b"), instance("c")];
    let take = || a.registry.take_for_dead(&a.seat, TakeForDead::Gone(&gone));
    assert_eq!(take().await.unwrap(), []);
    assert!(b.renew().await);
    let former = b.seat.clone();
    b.store.close().await.unwrap();
    drop(b);
    // The server has to notice that the connection is closed.
    let mut taken = Vec::new();
    for _ in 0..100 {
        taken = take().await.unwrap();
        if !taken.is_empty() {
            break;
        }
        tokio::time::sleep(std::time::Duration::from_millis(20)).await;
    }
    assert_eq!(taken, std::slice::from_ref(&former));
    let snapshot = a.look().await.snapshot;
    assert!(snapshot.robots.values().all(|row| row.owner.is_none()));
    assert!(snapshot.member(&former).is_none());
    let dead = snapshot
        .members
        .iter()
        .find(|one| one.seat.instance == instance("b"));
    assert!(dead.is_some_and(|dead| !dead.is_live()), "{snapshot:?}");
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn only_the_database_s_clock_ends_a_lease_and_only_a_live_one_takes() {
    let (url, robots) = database(2).await;
    let a = Instance::join(&url, "a").await;
    let b = Instance::join(&url, "b").await;
    a.claim(&robots, 1).await;
    let take = |by: &Instance| {
        let (registry, seat) = (by.registry.clone(), by.seat.clone());
        async move {
            registry
                .take_for_dead(&seat, TakeForDead::LeaseEnded)
                .await
                .unwrap()
        }
    };
    assert_eq!(take(&b).await, []);
    end_lease(&url, "a");
    end_lease(&url, "b");
    assert_eq!(take(&b).await, [], "its own lease has ended");
    assert!(a.renew().await, "late, and nobody has taken it");
    assert!(b.renew().await);
    end_lease(&url, "a");
    assert_eq!(take(&b).await, std::slice::from_ref(&a.seat));
    assert_eq!(take(&b).await, [], "once");
    assert!(!a.renew().await);
    assert_eq!(a.claim(&robots, 10).await, []);
    assert_eq!(b.claim(&robots, 20).await.len(), 2);
    // What it does in its former life changes nothing.
    let all = a.registry.free(&a.seat, &robots).await;
    all.unwrap();
    a.registry.leave(&a.seat).await.unwrap();
    assert_eq!(b.robots().await.len(), 2);
}
