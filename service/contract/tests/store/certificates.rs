//! Certificates: found by robot, approver and time, never changed, and kept for five years.

use std::sync::Arc;
use std::time::Duration;

use fleetcal_contract::{KeepCertificate, NOW_S, NS, TestDatabase, clock, record, robot};
use fleetcal_domain::limits;
use fleetcal_model::{DeploymentId, WallTime};
use fleetcal_proto::calibration::Envelope;
use fleetcal_store::{CertificateFilter, CertificateRecord, Store};

const DAY: Duration = Duration::from_hours(24);

fn certificate(number: u64, name: &str, approved_by: &str, second: i64) -> CertificateRecord {
    CertificateRecord {
        number: DeploymentId(number),
        robot: robot(name),
        verified_ns: WallTime((NOW_S + second) * NS),
        approved_by: approved_by.to_owned(),
        envelope: Envelope {
            document: format!("{{\"number\":{number}, \"by\":\"{approved_by}\"}}"),
            sha256: format!("{number:064x}"),
            key_id: "key".to_owned(),
            signature: "c2lnbmF0dXJl".to_owned(),
        },
    }
}

fn all() -> CertificateFilter {
    CertificateFilter {
        limit: 100,
        ..CertificateFilter::default()
    }
}

async fn numbers(store: &Store, filter: &CertificateFilter) -> Vec<u64> {
    let found = store.certificates(filter).await.unwrap();
    found.iter().map(|one| one.number.0).collect()
}

#[tokio::test]
async fn certificates_are_found_newest_first_byte_for_byte() {
    let database = TestDatabase::new().await;
    let store = database.open(clock()).await;
    let kept = [
        certificate(1, "a", "ana", 0),
        certificate(2, "b", "ana, \u{17d}o\u{eb} \"x\"", 10),
        certificate(3, "a", "bo", 20),
    ];
    for one in &kept {
        store.transact(KeepCertificate(one.clone())).await.unwrap();
    }
    let found = store.certificates(&all()).await.unwrap();
    assert_eq!(found, kept.iter().rev().cloned().collect::<Vec<_>>());
    for one in &kept {
        let found = store.certificate(one.number).await.unwrap();
        assert_eq!(found.as_ref(), Some(one));
    }
    assert_eq!(store.certificate(DeploymentId(9)).await.unwrap(), None);
    let beyond = store.certificate(DeploymentId(u64::MAX)).await;
    assert_eq!(beyond.unwrap(), None);
    let of_a = CertificateFilter {
        robot: Some(robot("a")),
        ..all()
    };
    assert_eq!(numbers(&store, &of_a).await, [3, 1]);
    let by_ana = CertificateFilter {
        approved_by: Some("ana".to_owned()),
        ..all()
    };
    assert_eq!(numbers(&store, &by_ana).await, [1]);
    let at = |second: i64| Some(WallTime((NOW_S + second) * NS));
    let between = CertificateFilter {
        from_ns: at(10),
        to_ns: at(20),
        ..all()
    };
    assert_eq!(numbers(&store, &between).await, [2]);
    let next = CertificateFilter {
        before: Some(3),
        limit: 1,
        ..CertificateFilter::default()
    };
    assert_eq!(numbers(&store, &next).await, [2]);
}

#[tokio::test]
async fn a_deployment_has_one_certificate() {
    let database = TestDatabase::new().await;
    let store = database.open(clock()).await;
    let first = certificate(1, "a", "ana", 0);
    store
        .transact(KeepCertificate(first.clone()))
        .await
        .unwrap();
    let second = certificate(1, "a", "mallory", 1);
    store.transact(KeepCertificate(second)).await.unwrap_err();
    let found = store.certificate(DeploymentId(1)).await.unwrap();
    assert_eq!(found, Some(first));
}

#[tokio::test]
async fn certificates_are_kept_for_five_years_whatever_else_is_deleted() {
    let database = TestDatabase::new().await;
    let clock = clock();
    let store = database.open(Arc::clone(&clock)).await;
    for (number, second) in [(1, 0), (2, 86_400)] {
        let one = certificate(number, "a", "ana", second);
        store.transact(KeepCertificate(one)).await.unwrap();
    }
    record(&store, "a", NOW_S, 0.1);
    store.flush().await.unwrap();
    clock.advance(5 * 365 * DAY + Duration::from_hours(1));
    // Its second, minute and hour of history are gone.
    pruned(&store, 3).await;
    assert_eq!(numbers(&store, &all()).await, [2, 1]);
    clock.advance(limits::CERTIFICATES_KEPT.saturating_sub(5 * 365 * DAY));
    pruned(&store, 4).await;
    assert_eq!(numbers(&store, &all()).await, [2]);
}

/// Waits until the writer has deleted `rows` rows.
async fn pruned(store: &Store, rows: u64) {
    let done = async {
        while store.counters().pruned_rows < rows {
            tokio::time::sleep(Duration::from_millis(20)).await;
        }
    };
    tokio::time::timeout(Duration::from_secs(30), done)
        .await
        .unwrap();
}
