//! Certificates: listed, searched, saved, printed, and many of them as one file.

use fleetcal_contract::KeepCertificate;
use fleetcal_domain::limits;
use fleetcal_model::{DeploymentId, WallTime};
use fleetcal_proto::calibration::Envelope;
use fleetcal_proto::certificate::CertificateDocument;
use fleetcal_proto::signing::{SigningKey, TrustedKeys, sign};
use fleetcal_store::CertificateRecord;
use serde_json::json;

use super::*;

/// Certificates, of which several reads fetch one part each.
const MANY: u64 = 300;

fn key() -> SigningKey {
    SigningKey::from_bytes(&[7; 32])
}

fn document(number: u64, name: &str) -> CertificateDocument {
    let values = json!({
        "steering_offset_rad": 0.05, "lidar_x_m": 0.434, "lidar_y_m": -0.016,
        "lidar_yaw_rad": 0.0133,
    });
    let act = |by: &str| json!({ "by": by, "at": "2026-11-21T12:05:00Z", "reason": "<b>fits</b>" });
    let document = json!({
        "schema": "fleetcal.certificate/1",
        "number": number,
        "robot": name,
        "calibration": {
            "generation": 1, "document_sha256": "ab", "revision": 1, "values": values,
            "sigmas": values, "frame": "rear_axle",
        },
        "evidence_sha256": "cd",
        "verification": {
            "at": "2026-11-21T12:10:00Z", "distance_m": 61.5, "residual": values,
            "sigmas": values,
        },
        "approved": [act("ana")],
        "applied": act(name),
        "versions": { "service": "0.2.0", "estimator": "0.2.0" },
    });
    serde_json::from_value(document).unwrap()
}

impl Bench {
    /// Stores the certificate of a robot that was verified this number of hours after the clock's
    /// present.
    async fn certify(&self, number: u64, name: &str, hours: i64) {
        let certificate = CertificateRecord {
            number: DeploymentId(number),
            robot: robot(name),
            verified_ns: WallTime(NOW_NS + hours * 3_600_000_000_000),
            approved_by: "ana".to_owned(),
            envelope: sign(&document(number, name), &key()).unwrap(),
        };
        self.store
            .transact(KeepCertificate(certificate))
            .await
            .unwrap();
    }

    /// Numbers of the certificates that a list returns.
    async fn numbers(&self, query: &str) -> Vec<u64> {
        let page = self.get(&format!("/api/v1/certificates{query}")).await;
        let page = page.json();
        let items = page["items"].as_array().unwrap().iter();
        items.map(|one| one["number"].as_u64().unwrap()).collect()
    }
}

#[tokio::test]
async fn certificates_are_listed_and_searched() {
    let bench = bench(&["a", "b"]).await;
    assert_eq!(bench.numbers("").await, [0_u64; 0]);
    for (number, name, hours) in [(1, "a", 0), (2, "b", 1), (3, "a", 2)] {
        bench.certify(number, name, hours).await;
    }
    let page = bench.get("/api/v1/certificates?limit=1").await.json();
    let envelope = sign(&document(3, "a"), &key()).unwrap();
    let expected = json!({
        "number": 3, "robot": "a", "approved_by": "ana", "sha256": envelope.sha256,
        "key_id": envelope.key_id, "verified": page["items"][0]["verified"],
    });
    assert_eq!(page["items"], json!([expected]));
    assert_eq!(page["next"], "3");
    let verified = page["items"][0]["verified"].as_str().unwrap().to_owned();
    assert_eq!(bench.numbers("?limit=1&cursor=3").await, [2]);
    assert_eq!(bench.numbers("?robot=a").await, [3, 1]);
    assert_eq!(bench.numbers("?robot=nobody").await, [0_u64; 0]);
    assert_eq!(bench.numbers("?approved_by=ana").await, [3, 2, 1]);
    assert_eq!(bench.numbers("?approved_by=bo").await, [0_u64; 0]);
    assert_eq!(bench.numbers(&format!("?from={verified}")).await, [3]);
    assert_eq!(bench.numbers(&format!("?to={verified}")).await, [2, 1]);
    for (query, told) in [
        ("?format=csv", "400 value_refused [format]"),
        ("?robot=a/b", "400 value_refused [robot]"),
        ("?from=now", "400 value_refused [from]"),
        ("?limit=0", "400 value_refused [limit]"),
    ] {
        let refused = bench.get(&format!("/api/v1/certificates{query}")).await;
        assert!(refused.told().starts_with(told), "{}", refused.told());
    }
}

#[tokio::test]
async fn a_certificate_is_saved_signed_and_printed() {
    let bench = bench(&["a"]).await;
    bench.certify(1, "a", 0).await;
    let file = bench.get("/api/v1/certificates/1").await;
    assert_eq!(file.header("content-type"), "application/json");
    assert_eq!(
        file.header("content-disposition"),
        "attachment; filename=\"certificate-1.json\""
    );
    assert!(!file.body.contains('\n'), "one line");
    let envelope = Envelope::from_json(file.body.as_bytes()).unwrap();
    let trusted = TrustedKeys::from(bench.lifecycle.public_key());
    let opened: CertificateDocument = envelope.open_as(&trusted).unwrap();
    assert_eq!(opened, document(1, "a"));

    let page = bench.get("/api/v1/certificates/1?format=html").await;
    assert_eq!(page.header("content-type"), "text/html; charset=utf-8");
    let policy = page.header("content-security-policy");
    assert!(policy.contains("default-src 'none'") && !policy.contains("script"));
    assert!(page.body.contains(&envelope.sha256));
    assert!(page.body.contains("&lt;b&gt;fits&lt;/b&gt;"));
    assert!(!page.body.contains("<b>"), "{}", page.body);

    for (path, told) in [
        ("2", "404 certificate_unknown"),
        ("18446744073709551615", "404 certificate_unknown"),
        ("one", "400 value_refused [id]"),
        ("1?format=pdf", "400 value_refused [format]"),
    ] {
        let refused = bench.get(&format!("/api/v1/certificates/{path}")).await;
        assert!(refused.told().starts_with(told), "{}", refused.told());
    }
}

#[tokio::test]
async fn a_file_of_certificates_is_given_while_it_is_read() {
    let bench = bench(&["a"]).await;
    for number in 1..=MANY {
        bench.certify(number, "a", 0).await;
    }
    let uri = "/api/v1/certificates?format=ndjson";
    let mut body = bench.begin(uri, &[]).await;
    let first = body.next().await.unwrap().unwrap();
    let lines = String::from_utf8_lossy(&first).lines().count();
    assert_eq!(lines, limits::LIST_ROWS_AT_ONCE as usize);
    drop(body);
    let file = bench.get(uri).await;
    assert_eq!(file.header("content-type"), "application/x-ndjson");
    assert_eq!(
        file.header("content-disposition"),
        "attachment; filename=\"certificates.ndjson\""
    );
    let trusted = TrustedKeys::from(key().public_key());
    let opened = |line: &str| -> u64 {
        let envelope = Envelope::from_json(line.as_bytes()).unwrap();
        let document: CertificateDocument = envelope.open_as(&trusted).unwrap();
        document.number.0
    };
    let numbers: Vec<_> = file.body.lines().map(opened).collect();
    assert!(numbers.into_iter().eq((1..=MANY).rev()));
    let some = bench.get(&format!("{uri}&limit=7&robot=a")).await;
    assert_eq!(some.body.lines().count(), 7);
}
