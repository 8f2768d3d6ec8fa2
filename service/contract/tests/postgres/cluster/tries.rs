//! Tries to sign in count over all instances.

use std::time::Duration;

use fleetcal_contract::own_server::psql;
use fleetcal_domain::limits;
use fleetcal_store::cluster::Try;
use tokio::time::Instant;

use super::instance::{Instance, database};
use crate::proxy::{Cut, Proxy};

/// Time within which everybody can sign in again after an instance was lost.
const AGAIN_WITHIN: Duration = Duration::from_secs(5);

fn of(key: &str, burst: u32) -> Try {
    Try {
        key: key.to_owned(),
        every: Duration::from_secs(30),
        burst,
    }
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn tries_at_several_instances_count_together() {
    let (url, _) = database(1).await;
    let (a, b) = (
        Instance::join(&url, "a").await,
        Instance::join(&url, "b").await,
    );
    let tries = [of("10.0.0.1", 60), of("10.0.0.1\nana", 3)];
    for instance in [&a, &b, &a] {
        let wait = instance.registry.count_tries(&tries).await.unwrap();
        assert_eq!(wait, None);
    }
    for instance in [&a, &b] {
        let wait = instance.registry.count_tries(&tries).await.unwrap();
        let wait = wait.unwrap();
        let expected = Duration::from_secs(20)..=Duration::from_secs(30);
        assert!(expected.contains(&wait), "{wait:?}");
    }
    // Another address is not concerned, and a right password ends the wait everywhere.
    let other = [of("10.0.0.2", 60), of("10.0.0.2\nana", 3)];
    assert_eq!(b.registry.count_tries(&other).await.unwrap(), None);
    let forgotten = ["10.0.0.1\nana".to_owned()];
    b.registry
        .signed_in(&forgotten[0], &forgotten)
        .await
        .unwrap();
    assert_eq!(a.registry.count_tries(&tries).await.unwrap(), None);
}

#[tokio::test(flavor = "multi_thread", worker_threads = 4)]
async fn tries_at_the_same_time_let_no_more_through() {
    let (url, _) = database(1).await;
    let (a, b) = (
        Instance::join(&url, "a").await,
        Instance::join(&url, "b").await,
    );
    let tries = [of("10.0.0.1", 1_000), of("10.0.0.1\nana", 10)];
    let half = async |instance: &Instance| {
        let mut through = 0;
        for _ in 0..50 {
            let wait = instance.registry.count_tries(&tries).await.unwrap();
            through += u32::from(wait.is_none());
        }
        through
    };
    let (at_a, at_b) = tokio::join!(half(&a), half(&b));
    assert_eq!(at_a + at_b, 10);
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn tries_that_are_remembered_are_bounded() {
    let (url, _) = database(1).await;
    let a = Instance::join(&url, "a").await;
    let many =
        "INSERT INTO sign_in_try SELECT 'key ' || number, clock_ns() + number::bigint * 1000000000
        FROM generate_series(1, 10000) AS number";
    psql(&url, many);
    let wait = a.registry.count_tries(&[of("10.0.0.1", 1)]).await.unwrap();
    assert_eq!(wait, None);
    let count = || {
        let count = psql(&url, "SELECT count(*) FROM sign_in_try");
        count.trim().parse::<usize>().unwrap()
    };
    assert!(count() <= limits::SIGN_IN_KEYS_MAX + 1, "{}", count());
    // The last ones to be worked off are kept; what is worked off goes.
    psql(&url, "UPDATE sign_in_try SET worked_off_ns = 1");
    a.registry.count_tries(&[of("10.0.0.2", 1)]).await.unwrap();
    assert_eq!(count(), 1);
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn who_has_signed_in_at_one_instance_is_known_to_the_others() {
    let (url, _) = database(1).await;
    let a = Instance::join(&url, "a").await;
    let b = Instance::join(&url, "b").await;
    let pair = |number: usize| format!("10.0.0.1\nuser {number}");
    assert!(!b.registry.has_signed_in(&pair(1)).await.unwrap());
    a.registry.signed_in(&pair(1), &[]).await.unwrap();
    assert!(b.registry.has_signed_in(&pair(1)).await.unwrap());
    assert!(!b.registry.has_signed_in(&pair(2)).await.unwrap());
    // The latest ones are remembered.
    let many = format!(
        "INSERT INTO sign_in_pair SELECT '10.0.0.2' || number, number
        FROM generate_series(1, {}) AS number",
        limits::SIGN_IN_KNOWN_MAX
    );
    psql(&url, &many);
    b.registry.signed_in(&pair(2), &[]).await.unwrap();
    let count = psql(&url, "SELECT count(*) FROM sign_in_pair");
    assert_eq!(count.trim(), limits::SIGN_IN_KNOWN_MAX.to_string());
    assert!(a.registry.has_signed_in(&pair(1)).await.unwrap());
    assert!(a.registry.has_signed_in(&pair(2)).await.unwrap());
}

/// Loses an instance while it records a sign-in: it holds its locks until the server drops it.
#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn an_instance_that_is_lost_keeps_nobody_from_signing_in_at_the_others() {
    let (url, _) = database(1).await;
    let (proxy, behind_proxy) = Proxy::before_database(&url).await;
    let a = Instance::join(&behind_proxy, "a").await;
    let b = Instance::join(&url, "b").await;
    let pair = |number: usize| format!("10.0.0.1\nuser {number}");
    for number in 1..=4 {
        b.registry.signed_in(&pair(number), &[]).await.unwrap();
    }
    proxy.cut_next(Cut::NeverCommits);
    let lost = Instant::now();
    let last = pair(4);
    let noted_at_a = a.registry.signed_in(&last, &[]);
    let at_b = async {
        while proxy.is_armed() {
            assert!(lost.elapsed() < AGAIN_WITHIN, "nothing was committed");
            tokio::time::sleep(Duration::from_millis(10)).await;
        }
        for number in 1..=3 {
            b.registry.signed_in(&pair(number), &[]).await.unwrap();
        }
        // The same person at the other instance waits until the server has given up the first one.
        while let Err(error) = b.registry.signed_in(&last, &[]).await {
            assert!(lost.elapsed() < AGAIN_WITHIN, "{error}");
        }
    };
    let (noted_at_a, ()) = tokio::join!(noted_at_a, at_b);
    assert!(noted_at_a.is_err(), "nothing was lost");
}
