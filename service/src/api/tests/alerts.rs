//! `/alerts` and `/webhooks`.

use std::time::Duration;

use fleetcal_proto::calibration::CalibrationValues;
use insta::assert_snapshot;

use super::*;
use crate::access::Actor;
use crate::alert::{AlertKind, Observation, Sighting};
use crate::approval::{Command, Evidence, Origin};
use crate::fleet::Stream;
use crate::store::AlertWrite;

/// Longer than anything here takes.
const PATIENCE: Duration = Duration::from_mins(1);

impl Bench {
    /// Something is wrong with a robot, as the rules would have seen it.
    async fn observe(&self, name: &str, kind: AlertKind, observation: Observation) {
        let sighting = Sighting {
            kind,
            observation,
            what: "deployment 3 was refused by the robot: <b>on a mission</b>".to_owned(),
        };
        let write = AlertWrite::Observe {
            sightings: vec![(robot(name), sighting)],
            policy: Arc::new(AlertPolicy::default()),
            now_ns: NOW_NS,
        };
        self.store.write_alerts(write).await.unwrap();
    }

    /// An answer, once it is as it should be.
    async fn once(&self, uri: &str, is_ready: impl Fn(&Value) -> bool) -> Value {
        let wait = async {
            loop {
                let found = self.get(uri).await.json();
                if is_ready(&found) {
                    return found;
                }
                tokio::time::sleep(Duration::from_millis(20)).await;
            }
        };
        tokio::time::timeout(PATIENCE, wait).await.unwrap()
    }
}

#[tokio::test]
async fn a_robot_that_fell_silent_is_alerted_acknowledged_and_comes_back() {
    let bench = bench(&["a", "never_seen"]).await;
    let mut live = bench.begin("/api/v1/stream?robot=a", &[]).await;
    assert_eq!(next_event(&mut live).await.0, "ready");
    bench.fleet.refuse(&robot("a"), Stream::Drive, "no CDR");
    bench.clock.advance(Duration::from_secs(4));
    let one =
        |state: &'static str| move |page: &Value| page["items"][0]["state"].as_str() == Some(state);
    let all = "/api/v1/alerts";
    bench.once(all, one("pending")).await;
    bench.clock.advance(Duration::from_secs(10));
    let page = bench.once(all, one("alerting")).await;
    // The robot that has never sent anything is nobody's alert.
    assert_eq!(page["items"].as_array().unwrap().len(), 1);
    let alert = &page["items"][0];
    assert_eq!(
        (&alert["robot"], &alert["kind"]),
        (&"a".into(), &"no_data".into())
    );
    assert_eq!(alert["acknowledgement"], Value::Null);
    let metric = "fleetcal_alerts{kind=\"no_data\",severity=\"warning\",state=\"alerting\"} 1";
    let metrics = bench.get("/metrics").await.body;
    assert!(metrics.contains(metric), "{metrics}");
    let uri = format!("{all}/{}", alert["id"]);
    let etag = bench.get(&uri).await.header("etag").to_owned();
    let ack = format!("{uri}/ack");
    let taken = bench
        .send_body(
            "POST",
            &ack,
            &[("if-match", &etag)],
            r#"{"note": "battery"}"#,
        )
        .await;
    assert_eq!(taken.told(), "200");
    assert_eq!(taken.json()["acknowledgement"]["note"], "battery");
    assert_eq!(taken.json()["state"], "alerting");
    bench.fleet.refuse(&robot("a"), Stream::Drive, "no CDR");
    bench.once(all, one("recovering")).await;
    // Two steps, because a robot that sends nothing for a minute would be silent again.
    for _ in 0..30 {
        bench.clock.advance(Duration::from_secs(2));
        bench.fleet.refuse(&robot("a"), Stream::Drive, "no CDR");
    }
    let over = bench.once(all, one("normal")).await;
    assert_ne!(over["items"][0]["ended"], Value::Null);
    assert_eq!(over["items"][0]["acknowledgement"]["note"], "battery");
    let whole = bench.get(&uri).await.json();
    let states: Vec<_> = whole["history"]
        .as_array()
        .unwrap()
        .iter()
        .map(|change| change["state"].as_str().unwrap())
        .collect();
    let went = ["pending", "alerting", "alerting", "recovering", "normal"];
    assert_eq!(states, went);
    let mut told = Vec::new();
    while told.len() < went.len() {
        let (event, data) = next_event(&mut live).await;
        if event == "alert" {
            let data: Value = serde_json::from_str(&data).unwrap();
            told.push(data["state"].as_str().unwrap().to_owned());
        }
    }
    assert_eq!(told, went);
}

#[tokio::test]
async fn a_list_is_filtered_paged_and_refuses_by_name() {
    let bench = bench(&[]).await;
    for name in ["a", "b", "c"] {
        bench
            .observe(name, AlertKind::NotApplied, Observation::Firing)
            .await;
    }
    bench
        .observe("a", AlertKind::NotApplied, Observation::Clear)
        .await;
    let robots = async |query: &str| -> Vec<String> {
        let page = bench.get(&format!("/api/v1/alerts{query}")).await.json();
        let items = page["items"].as_array().unwrap().clone();
        let names = items.iter().map(|item| item["robot"].as_str().unwrap());
        names.map(str::to_owned).collect()
    };
    assert_eq!(robots("").await, ["c", "b", "a"]);
    assert_eq!(robots("?state=active").await, ["c", "b"]);
    assert_eq!(robots("?state=normal").await, ["a"]);
    assert_eq!(robots("?robot=b").await, ["b"]);
    let first = bench.get("/api/v1/alerts?limit=2").await.json();
    let next = first["next"].as_str().unwrap();
    assert_eq!(robots(&format!("?limit=2&cursor={next}")).await, ["a"]);
    let told = async |query: &str| bench.get(&format!("/api/v1/alerts{query}")).await.told();
    assert_snapshot!(told("?state=angry").await, @r#"400 value_refused [state]: state is "angry", accepted is active or one of normal, pending, alerting, recovering, no_data"#);
    assert_snapshot!(told("?cursor=x").await, @r#"400 value_refused [cursor]: cursor is "x", accepted is `next` of the page before"#);
    assert_snapshot!(told("?limit=0").await, @r#"400 value_refused [limit]: limit is "0", accepted is a whole number from 1 to 1000"#);
}

#[tokio::test]
async fn an_acknowledgement_needs_the_version_and_comes_once() {
    let bench = bench(&["a"]).await;
    bench
        .observe("a", AlertKind::NotApplied, Observation::Firing)
        .await;
    let id = bench.get("/api/v1/alerts").await.json()["items"][0]["id"].clone();
    let uri = format!("/api/v1/alerts/{id}/ack");
    let ack = async |uri: &str, headers: &[(&str, &str)], body: &str| {
        bench
            .send_body("POST", uri, headers, body.to_owned())
            .await
            .told()
    };
    assert_snapshot!(ack(&uri, &[], "{}").await, @"428 precondition_required [If-Match]: send the ETag of GET as If-Match, or If-None-Match: * for a new one");
    let stale = [("if-match", "\"7\"")];
    assert_snapshot!(ack(&uri, &stale, "{}").await, @"412 version_conflict: it is at version 1 now: it changed since you opened it");
    let first = [("if-match", "\"1\"")];
    let long = serde_json::json!({ "note": "x".repeat(1_001) }).to_string();
    assert_snapshot!(ack(&uri, &first, &long).await, @"400 value_refused [note]: note has 1001 characters, accepted are 1000 at most");
    assert_eq!(ack(&uri, &first, "{}").await, "200");
    let second = [("if-match", "\"2\"")];
    assert_snapshot!(ack(&uri, &second, "{}").await, @"409 acknowledged_already: tester has acknowledged this already");
    assert_snapshot!(ack("/api/v1/alerts/99/ack", &first, "{}").await, @"404 alert_unknown: no alert 99 is known");
    assert_snapshot!(ack("/api/v1/alerts/x/ack", &first, "{}").await, @r#"400 value_refused [id]: id is "x", accepted is the number of an alert"#);
    assert_snapshot!(bench.get("/api/v1/alerts/99").await.told(), @"404 alert_unknown: no alert 99 is known");
    let audit = bench.get("/api/v1/audit?action=alert.").await.json();
    assert_eq!(audit["items"].as_array().unwrap().len(), 1);
    assert_eq!(audit["items"][0]["robot"], "a");
}

#[tokio::test]
async fn a_webhook_shows_its_secret_once_and_refuses_by_name() {
    let bench = bench(&[]).await;
    let uri = "/api/v1/webhooks";
    let post = async |body: &str| bench.send_body("POST", uri, &[], body.to_owned()).await;
    let made = post(r#"{"url": "http://127.0.0.1:9/hook"}"#).await;
    assert_eq!(made.told(), "201");
    let made = made.json();
    let secret = made["secret"].as_str().unwrap();
    assert!(
        secret.starts_with("whsec_") && secret.len() > 40,
        "{secret}"
    );
    assert_eq!(made["webhook"]["events"].as_array().unwrap().len(), 3);
    let listed = bench.get(uri).await;
    assert_eq!(listed.json()["items"][0], made["webhook"]);
    let audit = bench.get("/api/v1/audit").await;
    for shown in [&listed.body, &audit.body] {
        assert!(!shown.contains(secret), "{shown}");
    }
    // An address is often a secret itself, and every viewer reads the audit.
    assert!(audit.body.contains("http://127.0.0.1:9") && !audit.body.contains("/hook"));
    assert_snapshot!(post(r#"{"url": "http://127.0.0.1:9/hook"}"#).await.told(), @"409 webhook_exists [url]: url is that of webhook 1 already");
    assert_snapshot!(post(r#"{"url": "ftp://a/"}"#).await.told(), @r#"400 value_refused [url]: url is "ftp://a/", accepted is an address such as https://example.org/hook"#);
    assert_snapshot!(post(r#"{"url": "http://a/", "events": []}"#).await.told(), @r#"400 value_refused [events]: events is "[]", accepted is one or more of alert.alerting, alert.resolved, proposal.waiting"#);
    let unknown = post(r#"{"url": "http://a/", "events": ["alert.angry"]}"#).await;
    assert!(unknown.told().contains("alert.angry"), "{}", unknown.body);
    assert_eq!(
        bench.send("DELETE", "/api/v1/webhooks/1", &[]).await.told(),
        "204"
    );
    assert_snapshot!(bench.send("DELETE", "/api/v1/webhooks/1", &[]).await.told(), @"404 webhook_unknown: no webhook 1 is known");
    assert_snapshot!(bench.get("/api/v1/webhooks/1/deliveries").await.told(), @"404 webhook_unknown: no webhook 1 is known");
}

#[tokio::test]
async fn alerts_and_proposals_are_told_and_the_log_says_what_came_of_it() {
    let bench = bench(&["a"]).await;
    // Nobody listens there: every attempt fails at once.
    let body = r#"{"url": "http://127.0.0.1:1/"}"#;
    let made = bench.send_body("POST", "/api/v1/webhooks", &[], body).await;
    assert_eq!(made.told(), "201");
    bench
        .observe("a", AlertKind::NotApplied, Observation::Firing)
        .await;
    let values = CalibrationValues {
        steering_offset_rad: 0.02,
        ..CalibrationValues::default()
    };
    let propose = Command::Propose {
        origin: Origin::Person,
        values,
        sigmas: CalibrationValues::default(),
        evidence: Evidence::default(),
        nominal: None,
        reason: Some("measured by hand".to_owned()),
    };
    let ada = Actor {
        name: "ada".to_owned(),
        ..Actor::service()
    };
    bench
        .clerk
        .decide(&robot("a"), propose, ada, None)
        .await
        .unwrap();
    let uri = "/api/v1/webhooks/1/deliveries";
    let log = bench
        .once(uri, |log| {
            let items = log["items"].as_array().unwrap();
            items.len() == 2 && items.iter().all(|item| item["attempts_made"] == 1)
        })
        .await;
    let (proposal, alert) = (&log["items"][0], &log["items"][1]);
    assert_eq!(proposal["event"], "proposal.waiting");
    assert_eq!(proposal["body"]["type"], "proposal.waiting");
    assert_eq!(proposal["body"]["data"]["proposed_by"], "ada");
    assert_eq!(
        proposal["body"]["data"]["values"]["steering_offset_rad"],
        0.02
    );
    assert_eq!(alert["body"]["data"]["kind"], "not_applied");
    assert_eq!(alert["state"], "waiting");
    assert_eq!(alert["attempts"][0]["status"], Value::Null);
    let error = alert["attempts"][0]["error"].as_str().unwrap();
    assert!(error.to_lowercase().contains("refused"), "{error}");
    let first = bench.get(&format!("{uri}?limit=1")).await.json();
    let next = first["next"].as_str().unwrap();
    let rest = bench.get(&format!("{uri}?cursor={next}")).await.json();
    assert_eq!(rest["items"][0]["id"], alert["id"]);
}
