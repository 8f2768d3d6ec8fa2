//! Routes of `/alerts` and `/webhooks`.

use std::time::Duration;

use fleetcal_clock::Clock;
use fleetcal_domain::access::Actor;
use fleetcal_domain::alert::{AlertKind, Observation, Sighting};
use fleetcal_domain::approval::{Command, Evidence, Origin};
use fleetcal_model::{Stream, WallTime};
use fleetcal_operations::alert_evaluator::Observe;
use fleetcal_proto::calibration::CalibrationValues;
use insta::assert_snapshot;

use super::*;

/// Timeout beyond any duration of these tests.
const PATIENCE: Duration = Duration::from_mins(1);

impl Bench {
    /// Applies an observation of a robot, as the rules would make it.
    pub(super) async fn observe(&self, name: &str, kind: AlertKind, observation: Observation) {
        let sighting = Sighting {
            kind,
            observation,
            what: "deployment 3 was refused by the robot: <b>on a mission</b>".to_owned(),
            robots: Vec::new(),
        };
        let write = Observe {
            sightings: vec![(robot(name).into(), sighting)],
            policy: Arc::new(AlertPolicy::default()),
            standing: BTreeMap::new(),
            evaluator: None,
            now: WallTime(NOW_NS),
        };
        self.store.transact(write).await.unwrap();
    }

    /// Answer, once it satisfies a condition.
    pub(super) async fn once(&self, uri: &str, is_ready: impl Fn(&Value) -> bool) -> Value {
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
    bench
        .fleet
        .refuse(&robot("a"), Stream::WheelOdometry, "no CDR");
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
    bench
        .fleet
        .refuse(&robot("a"), Stream::WheelOdometry, "no CDR");
    bench.once(all, one("recovering")).await;
    // Two steps, because a robot that sends nothing for a minute would be silent again.
    for _ in 0..30 {
        bench.clock.advance(Duration::from_secs(2));
        bench
            .fleet
            .refuse(&robot("a"), Stream::WheelOdometry, "no CDR");
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
    assert_snapshot!(told("?state=angry").await, @r#"400 value_refused [state]: state: got "angry", expected active or one of normal, pending, alerting, recovering, no_data"#);
    assert_snapshot!(told("?cursor=x").await, @r#"400 value_refused [cursor]: cursor: got "x", expected `next` of the page before"#);
    assert_snapshot!(told("?limit=0").await, @r#"400 value_refused [limit]: limit: got "0", expected a whole number from 1 to 1000"#);
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
    assert_snapshot!(ack(&uri, &first, &long).await, @"400 value_refused [note]: note: got 1001 characters, expected 1000 at most");
    assert_eq!(ack(&uri, &first, "{}").await, "200");
    let second = [("if-match", "\"2\"")];
    assert_snapshot!(ack(&uri, &second, "{}").await, @"409 acknowledged_already: tester has acknowledged this already");
    assert_snapshot!(ack("/api/v1/alerts/99/ack", &first, "{}").await, @"404 alert_unknown: no alert 99 is known");
    assert_snapshot!(ack("/api/v1/alerts/x/ack", &first, "{}").await, @r#"400 value_refused [id]: id: got "x", expected the number of an alert"#);
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
    assert_eq!(made["webhook"]["events"].as_array().unwrap().len(), 4);
    let listed = bench.get(uri).await;
    assert_eq!(listed.json()["items"][0], made["webhook"]);
    let audit = bench.get("/api/v1/audit").await;
    for shown in [&listed.body, &audit.body] {
        assert!(!shown.contains(secret), "{shown}");
    }
    // An address is often a secret itself, and every viewer reads the audit.
    assert!(audit.body.contains("http://127.0.0.1:9") && !audit.body.contains("/hook"));
    assert_snapshot!(post(r#"{"url": "http://127.0.0.1:9/hook"}"#).await.told(), @"409 webhook_exists [url]: url is that of webhook 1 already");
    assert_snapshot!(post(r#"{"url": "ftp://a/"}"#).await.told(), @r#"400 value_refused [url]: url: got "ftp://a/", expected an address such as https://example.org/hook"#);
    assert_snapshot!(post(r#"{"url": "http://a/", "events": []}"#).await.told(), @r#"400 value_refused [events]: events: got "[]", expected one or more of alert.alerting, alert.resolved, proposal.waiting, rollout.halted"#);
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
        reason: Some("measured by hand".to_owned()),
    };
    let ada = Actor {
        name: "ada".to_owned(),
        ..Actor::service()
    };
    bench
        .lifecycle
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

#[tokio::test]
async fn robots_that_stay_away_after_a_restart_raise_one_alert() {
    let names: Vec<String> = (1..=24)
        .map(|number| format!("tugger_{number:02}"))
        .collect();
    let names: Vec<&str> = names.iter().map(String::as_str).collect();
    let bench = bench_after_restart(&names).await;
    for name in &names[..6] {
        bench
            .fleet
            .refuse(&robot(name), Stream::WheelOdometry, "no CDR");
    }
    let silent = "/api/v1/robots?connection=silent";
    let page = bench.get(silent).await.json();
    assert_eq!(page["items"].as_array().unwrap().len(), 18);
    assert_eq!(page["connections"]["online"], 6);
    // The six go on sending; the clock of the alerts goes on beside them.
    for _ in 0..8 {
        bench.clock.advance(Duration::from_secs(2));
        for name in &names[..6] {
            bench
                .fleet
                .refuse(&robot(name), Stream::WheelOdometry, "no CDR");
        }
        tokio::time::sleep(Duration::from_millis(1_100)).await;
    }
    let page = bench.get("/api/v1/alerts").await.json();
    let alerts = page["items"].as_array().unwrap();
    assert_eq!(alerts.len(), 1, "{page}");
    assert_eq!(alerts[0]["state"], "alerting");
    assert_eq!(alerts[0]["robot"], Value::Null);
    assert_eq!(alerts[0]["robots"].as_array().unwrap().len(), 18);
    let what = alerts[0]["what"].as_str().unwrap();
    assert!(
        what.starts_with("18 of 24 robots send nothing: tugger_07,"),
        "{what}"
    );
    // It is also found at each of them.
    for (name, found) in [("tugger_07", 1), ("tugger_01", 0)] {
        let page = bench
            .get(&format!("/api/v1/alerts?robot={name}"))
            .await
            .json();
        assert_eq!(page["items"].as_array().unwrap().len(), found, "{name}");
    }
    let metrics = bench.get("/metrics").await.body;
    let metric = "fleetcal_robots_by_connection{connection=\"silent\"} 18";
    assert!(metrics.contains(metric), "{metrics}");
}

#[tokio::test]
async fn a_robot_in_maintenance_is_neither_silent_nor_alerted() {
    let bench = bench_after_restart(&["a"]).await;
    let uri = "/api/v1/robots/a/maintenance";
    let hours = |hours: i64| {
        let until = WallTime(bench.clock.now().0 + hours * 3_600_000_000_000);
        let until = crate::time::of(until);
        format!(r#"{{"until": "{until}", "reason": "parked for the night"}}"#)
    };
    let long = bench.send_body("PUT", uri, &[], hours(2_161)).await;
    assert_eq!(
        long.told(),
        "400 value_refused [until]: until: got 2161, expected more than 0 and at most 2160 hours \
         from now"
    );
    let end = r#"{"until": null, "reason": "back at work"}"#;
    let none = bench.send_body("PUT", uri, &[], end).await;
    assert_eq!(
        none.told(),
        "409 not_in_maintenance: the robot is not in maintenance"
    );

    let parked = bench.send_body("PUT", uri, &[], hours(8)).await;
    assert_eq!(parked.told(), "200");
    let found = bench.get("/api/v1/robots/a").await.json();
    let connection = &found["connection"];
    assert_eq!(connection["state"], "maintenance");
    assert_eq!(connection["maintenance"]["by"], "tester");
    assert_eq!(connection["maintenance"]["reason"], "parked for the night");
    assert_ne!(connection["silent_since"], Value::Null);
    bench.clock.advance(Duration::from_mins(30));
    tokio::time::sleep(Duration::from_millis(2_500)).await;
    let alerts = bench.get("/api/v1/alerts").await.json();
    assert_eq!(
        alerts["items"],
        serde_json::json!([]),
        "nobody expects it to send"
    );

    let back = bench.send_body("PUT", uri, &[], end).await;
    assert_eq!(back.json()["state"], "silent");
    bench
        .once("/api/v1/alerts", |page| {
            page["items"][0]["kind"] == "no_data"
        })
        .await;
    let audit = bench.get("/api/v1/audit?action=maintenance").await.json();
    let actions = audit["items"].as_array().unwrap().iter();
    let actions: Vec<_> = actions.map(|row| row["action"].as_str().unwrap()).collect();
    assert_eq!(actions, ["maintenance.end", "maintenance.begin"]);
}
