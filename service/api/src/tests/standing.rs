//! Standing of a robot: the same in the list, on its page, on the event stream and in webhooks, and
//! published whatever changes it.

use std::time::Duration;

use fleetcal_clock::Clock;
use fleetcal_domain::approval::{Command, Evidence, Origin};
use fleetcal_domain::standing::Standing;
use fleetcal_model::Stream;
use fleetcal_proto::Encoding;
use fleetcal_proto::calibration::CalibrationValues;

use super::*;

const PATIENCE: Duration = Duration::from_secs(30);
const FLEET: &str = "/api/v1/stream?topics=fleet";

/// Waits until the stream has published this standing of a robot; returns the event's content.
async fn told(stream: &mut axum::body::BodyDataStream, name: &str, standing: &str) -> Value {
    let wait = async {
        loop {
            let (event, data) = next_event(stream).await;
            let data: Value = serde_json::from_str(&data).unwrap_or_default();
            if event == "robot_state" && data["robot"] == name && data["standing"] == standing {
                return data;
            }
        }
    };
    let late = |_| panic!("{name} was not told to be {standing}");
    tokio::time::timeout(PATIENCE, wait)
        .await
        .unwrap_or_else(late)
}

impl Bench {
    /// Standing of a robot, by its page and by the list.
    async fn stands(&self, name: &str) -> String {
        let page = self.get(&format!("/api/v1/robots/{name}")).await.json();
        let list = self.get("/api/v1/robots").await.json();
        let items = list["items"].as_array().unwrap();
        let item = items.iter().find(|item| item["id"] == name).unwrap();
        assert_eq!(item["standing"], page["standing"]);
        page["standing"].as_str().unwrap().to_owned()
    }

    pub(super) async fn propose_for(&self, name: &str) {
        let command = Command::Propose {
            origin: Origin::Person,
            values: CalibrationValues::default(),
            sigmas: CalibrationValues::default(),
            evidence: Evidence::default(),
            reason: Some("measured by hand".to_owned()),
        };
        let actor = Actor::service();
        let done = self
            .lifecycle
            .decide(&robot(name), command, actor, None)
            .await;
        done.unwrap();
    }

    pub(super) async fn maintain(&self, name: &str, hours: u64) {
        let until = crate::time::of(self.clock.now().plus(Duration::from_hours(hours)));
        let body = format!(r#"{{"until": "{until}", "reason": "parked"}}"#);
        let uri = format!("/api/v1/robots/{name}/maintenance");
        let done = self.send_body("PUT", &uri, &[], body).await;
        assert_eq!(done.told(), "200");
    }
}

#[tokio::test]
async fn a_change_is_told_and_a_maintenance_hides_none() {
    let bench = bench(&["a"]).await;
    assert_eq!(bench.stands("a").await, "no_data");
    let mut stream = bench.begin(FLEET, &[]).await;
    assert_eq!(next_event(&mut stream).await.0, "ready");
    bench.maintain("a", 8).await;
    assert_eq!(bench.stands("a").await, "no_data");
    bench.propose_for("a").await;
    let state = told(&mut stream, "a", "awaiting_approval").await;
    assert_eq!(
        (&state["state"], &state["stale"], &state["deviation"]),
        (&"no_data".into(), &true.into(), &Value::Null)
    );
    assert_eq!(bench.stands("a").await, "awaiting_approval");
    bench.clock.advance(Duration::from_hours(8));
    assert_eq!(bench.stands("a").await, "awaiting_approval");
}

#[tokio::test]
async fn a_robot_that_nobody_has_registered_is_told_too() {
    let bench = bench(&[]).await;
    let mut stream = bench.begin(FLEET, &[]).await;
    assert_eq!(next_event(&mut stream).await.0, "ready");
    let id = robot("new");
    bench
        .fleet
        .receive(&id, Stream::Event, Encoding::Cdr, 1, || vec![0]);
    told(&mut stream, "new", "unregistered").await;
    assert_eq!(bench.stands("new").await, "unregistered");
}

#[tokio::test]
async fn what_changed_while_nobody_listened_is_told_to_who_read_before_it() {
    let bench = bench(&["a"]).await;
    let first = bench.begin(FLEET, &[]).await;
    drop(first);
    let mut stream = bench.begin(FLEET, &[]).await;
    assert_eq!(bench.stands("a").await, "no_data");
    bench.propose_for("a").await;
    told(&mut stream, "a", "awaiting_approval").await;
}

#[tokio::test]
async fn the_list_counts_filters_and_sorts_by_it() {
    let bench = bench(&["a", "b", "c"]).await;
    bench.propose_for("c").await;
    bench.maintain("c", 8).await;
    bench.maintain("b", 8).await;
    let list = bench.get("/api/v1/robots?sort=severity").await.json();
    let names = |list: &Value| -> Vec<String> {
        let items = list["items"].as_array().unwrap().iter();
        items
            .map(|item| item["id"].as_str().unwrap().to_owned())
            .collect()
    };
    assert_eq!(names(&list), ["c", "a", "b"]);
    let counts = list["standings"].as_object().unwrap();
    assert_eq!(counts.len(), Standing::ALL.len());
    for (standing, count) in [("no_data", 2), ("awaiting_approval", 1), ("learning", 0)] {
        assert_eq!(counts[standing], count, "{standing}");
    }
    let first = bench
        .get("/api/v1/robots?sort=severity&limit=1")
        .await
        .json();
    let next = first["next"].as_str().unwrap();
    let rest = bench
        .get(&format!("/api/v1/robots?sort=severity&cursor={next}"))
        .await
        .json();
    assert_eq!(names(&rest), ["a", "b"]);
    let waiting = bench
        .get("/api/v1/robots?standing=awaiting_approval")
        .await
        .json();
    assert_eq!(names(&waiting), ["c"]);
    let refused = bench.get("/api/v1/robots?standing=fine").await.told();
    let expected =
        r#"400 value_refused [standing]: standing: got "fine", expected one of rollback_failed, "#;
    assert!(refused.starts_with(expected), "{refused}");
}

#[tokio::test]
async fn webhooks_say_how_the_robot_stands() {
    let bench = bench_after_restart(&["a", "b"]).await;
    bench.maintain("b", 8).await;
    let body = r#"{"url": "http://127.0.0.1:1/"}"#;
    let made = bench.send_body("POST", "/api/v1/webhooks", &[], body).await;
    assert_eq!(made.told(), "201");
    bench.propose_for("b").await;
    // The robot that stays away raises an alert after some seconds.
    let alert = "/api/v1/alerts?robot=a";
    bench.clock.advance(Duration::from_secs(5));
    bench
        .once(alert, |page| page["items"][0]["state"] == "pending")
        .await;
    bench.clock.advance(Duration::from_secs(11));
    bench
        .once(alert, |page| page["items"][0]["state"] == "alerting")
        .await;
    let uri = "/api/v1/webhooks/1/deliveries";
    let both = |log: &Value| log["items"].as_array().unwrap().len() == 2;
    let log = bench.once(uri, both).await;
    let (alert, proposal) = (&log["items"][0]["body"], &log["items"][1]["body"]);
    assert_eq!(alert["type"], "alert.alerting");
    assert_eq!(alert["data"]["standing"], "no_data");
    assert_eq!(proposal["type"], "proposal.waiting");
    assert_eq!(proposal["data"]["standing"], "awaiting_approval");
    assert_eq!(bench.stands("a").await, "no_data");
    assert_eq!(bench.stands("b").await, "awaiting_approval");
}
