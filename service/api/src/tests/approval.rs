//! Proposals, deployments, shadows, the deployment freeze, and the audit.

use fleetcal_model::{Generation, Version};
use fleetcal_proto::calibration::{AppliedStatus, Confirmed, Envelope};
use fleetcal_proto::offer::Offered;
use fleetcal_proto::signing::{SigningKey, TrustedKeys};
use serde_json::json;

use super::*;

const VALUES: &str = r#"{"steering_offset_rad": 0.02, "lidar_x_m": 0.43, "lidar_y_m": 0.01,
    "lidar_yaw_rad": 0.01}"#;

/// Person with a token, who writes to the API.
struct Person {
    authorization: String,
}

fn trusted() -> TrustedKeys {
    SigningKey::from_bytes(&[7; 32]).public_key().into()
}

impl Bench {
    async fn person(&self, name: &str, role: Role) -> Person {
        let token = token(&self.store, name, grant(role), None).await;
        let authorization = format!("Bearer {token}");
        Person { authorization }
    }

    async fn write(
        &self,
        person: &Person,
        method: &str,
        uri: &str,
        more: &[(&str, &str)],
        body: String,
    ) -> Answer {
        let mut headers = vec![("authorization", person.authorization.as_str())];
        headers.extend(more);
        self.send_body(method, uri, &headers, body).await
    }

    /// Proposes values for robot "a".
    async fn propose(&self, person: &Person, key: &str) -> Answer {
        let body = format!(r#"{{"robot": "a", "values": {VALUES}, "reason": "by tape"}}"#);
        let key = [("idempotency-key", key)];
        self.write(person, "POST", "/api/v1/proposals", &key, body)
            .await
    }

    async fn approve(&self, person: &Person, proposal: &Value, version: Version) -> Answer {
        let uri = format!("/api/v1/proposals/{}/approve", proposal["id"]);
        let tag = format!("\"{version}\"");
        let body = json!({ "sha256": proposal["revision"]["sha256"], "reason": "fits" });
        self.write(
            person,
            "POST",
            &uri,
            &[("if-match", &tag)],
            body.to_string(),
        )
        .await
    }

    /// Answer to the robot's own request over HTTP with a new number; a request that only reads
    /// makes no offer.
    async fn pull(&self, robot: &Person) -> Envelope {
        let question = "0123456789abcdef0123456789abcdef";
        let uri = format!("/api/v1/robots/a/calibration?question={question}");
        let pulled = self.write(robot, "GET", &uri, &[], String::new()).await;
        let offered: Offered = serde_json::from_str(&pulled.body).unwrap();
        let envelope = offered.envelope.clone();
        assert_eq!(pulled.header("etag"), format!("\"{}\"", envelope.sha256));
        let document = envelope.open(&trusted()).unwrap();
        assert_eq!(
            (document.generation, document.approved_by.as_str()),
            (Generation(1), "ana, cem")
        );
        let offer = offered.open_offer(&trusted()).unwrap();
        assert_eq!(
            (offer.generation, &offer.sha256),
            (Generation(1), &envelope.sha256)
        );
        assert_eq!(offer.question.unwrap().as_str(), question);
        let shown: Offered = serde_json::from_str(&self.get(&uri).await.body).unwrap();
        assert_eq!(shown, Offered::from(envelope.clone()));
        let refused = self.get(&uri.replace('f', "F")).await;
        assert!(refused.told().contains("hexadecimal"), "{}", refused.told());
        envelope
    }

    /// Answers that the robot has applied a document, and checks the signed confirmation of that
    /// answer.
    async fn is_confirmed(&self, robot: &Person, envelope: &Envelope) {
        let stored = self.answer(robot, envelope, "applied").await;
        assert_eq!(stored.status, 200);
        let confirmed: Confirmed = serde_json::from_str(&stored.body).unwrap();
        let confirmed = confirmed.open(&trusted()).unwrap();
        assert_eq!(
            (confirmed.status, confirmed.applied_at_ns.0),
            (AppliedStatus::Applied, NOW_NS)
        );
    }

    /// Answers as the robot over HTTP.
    async fn answer(&self, robot: &Person, envelope: &Envelope, status: &str) -> Answer {
        let document: Value = serde_json::from_str(&envelope.document).unwrap();
        let body = json!({
            "generation": document["generation"],
            "sha256": envelope.sha256,
            "status": status,
            "applied_at_ns": NOW_NS,
            "values": document["values"],
        });
        let uri = "/api/v1/robots/a/calibration/applied";
        self.write(robot, "PUT", uri, &[], body.to_string()).await
    }
}

/// Bench with a robot "a" that has a drawing near to [`VALUES`] in the configuration file.
async fn drawn() -> Bench {
    let bench = bench(&["a"]).await;
    let config = RobotConfig {
        nominal_extrinsics: Some(serde_json::from_value(drawing()).unwrap()),
        ..config()
    };
    let actor = Actor::service();
    let done = configure(&bench.store, &robot("a"), &config, Expected::Any, actor);
    done.await.unwrap();
    bench
}

fn drawing() -> Value {
    json!({ "x_m": 0.425, "y_m": 0.0, "yaw_rad": 0.0 })
}

#[tokio::test]
async fn two_approve_what_is_measured_from_nothing_or_from_the_proposers_own_drawing() {
    let bench = bench(&["a"]).await;
    let ana = bench.person("ana", Role::Approver).await;
    let bo = bench.person("bo", Role::Operator).await;
    let asks = |proposal: &Value| {
        let of = |name: &str| proposal[name].clone();
        [
            of("approvals_needed"),
            of("second_approver"),
            of("drawn_by"),
        ]
    };
    let unknown = bench.propose(&bo, "k1").await.json();
    assert_eq!(asks(&unknown), [json!(2), json!("unknown"), Value::Null]);
    let config = RobotConfig {
        nominal_extrinsics: Some(serde_json::from_value(drawing()).unwrap()),
        ..config()
    };
    let body = serde_json::to_string(&config).unwrap();
    let uri = "/api/v1/robots/a";
    let put = bench.write(&bo, "PUT", uri, &[("if-match", "\"1\"")], body);
    assert_eq!(put.await.told(), "200");
    let own = bench.propose(&bo, "k2").await.json();
    assert_eq!(asks(&own), [json!(2), json!("own_drawing"), json!("bo")]);
    let once = bench.approve(&ana, &own, Version(1)).await.json();
    assert_eq!(once["state"], "proposed");
    let others = bench.propose(&ana, "k3").await.json();
    assert_eq!(asks(&others), [json!(1), Value::Null, json!("bo")]);
}

#[tokio::test]
async fn nothing_from_before_a_reassembly_is_proposed_or_approved() {
    let bench = bench(&["a"]).await;
    let ana = bench.person("ana", Role::Approver).await;
    let bo = bench.person("bo", Role::Operator).await;
    let before = bench.propose(&bo, "k1").await.json();
    let events = "/api/v1/robots/a/events";
    let body = r#"{"kind": "reassembled"}"#.to_owned();
    assert_eq!(
        bench.write(&bo, "POST", events, &[], body).await.told(),
        "201"
    );
    // At once, and later.
    for key in ["k2", "k3"] {
        let told = bench.propose(&bo, key).await.told();
        assert!(told.starts_with("409 reassembly_open"), "{told}");
    }
    let told = bench.approve(&ana, &before, Version(1)).await.told();
    assert!(
        told.starts_with("409 proposal_outdated") || told.starts_with("412"),
        "{told}"
    );
    // The service closes what was proposed before.
    let closed = async {
        loop {
            let uri = format!("/api/v1/proposals/{}", before["id"]);
            let now = bench.get(&uri).await.json();
            if now["state"] == "superseded" {
                break now;
            }
            tokio::time::sleep(std::time::Duration::from_millis(20)).await;
        }
    };
    let limit = std::time::Duration::from_secs(30);
    let closed = tokio::time::timeout(limit, closed).await.unwrap();
    let reason = closed["closing"]["reason"].as_str().unwrap();
    assert!(reason.contains("reassembled"), "{closed}");
    let events = bench.get(events).await.json();
    let kinds = events["items"].as_array().unwrap().iter();
    let kinds: Vec<_> = kinds.filter_map(|event| event["kind"].as_str()).collect();
    assert!(kinds.contains(&"proposal_closed"), "{kinds:?}");
}

#[tokio::test]
async fn a_calibration_goes_from_a_proposal_to_its_robot_and_back() {
    let bench = bench(&["a"]).await;
    let ana = bench.person("ana", Role::Approver).await;
    let bo = bench.person("bo", Role::Operator).await;
    let cem = bench.person("cem", Role::Approver).await;
    let robot = bench.person("robot", Role::Robot).await;
    assert_eq!(bench.get("/api/v1/robots/a/calibration").await.status, 404);

    let created = bench.propose(&bo, "k1").await;
    assert_eq!(
        (created.status.as_u16(), created.header("etag")),
        (201, "\"1\"")
    );
    let proposal = created.json();
    let again = bench.propose(&bo, "k1").await.json();
    assert_eq!(
        again["id"], proposal["id"],
        "the same request makes nothing twice"
    );

    // Nothing says what the robot uses: one is not enough.
    let once = bench.approve(&ana, &proposal, Version(1)).await;
    assert_eq!(once.json()["state"], "proposed");
    let approved = bench.approve(&cem, &proposal, Version(2)).await;
    assert_eq!(approved.told(), "200");
    assert_eq!(approved.json()["state"], "approved");

    let envelope = bench.pull(&robot).await;
    bench.is_confirmed(&robot, &envelope).await;

    let shadow = bench.get("/api/v1/robots/a/shadow").await;
    assert_eq!(shadow.json()["in_use"]["generation"], 1);
    assert_eq!(shadow.json()["deployment"]["state"], "applied");
    // What followed from the decision is told with it.
    let decided = bench.get("/api/v1/proposals?state=approved").await.json();
    assert_eq!(decided["items"][0]["deployment"], "applied");
    let summary = bench.get("/api/v1/robots").await.json();
    assert_eq!(summary["items"][0]["calibration"]["in_sync"], true);
    assert_eq!(shadow.json()["sync"], "in_sync");

    let back = json!({ "reason": "it weaves" }).to_string();
    let tag = [("if-match", shadow.header("etag"))];
    let uri = "/api/v1/robots/a/rollback";
    let refused = bench.write(&ana, "POST", uri, &tag, back).await;
    assert!(
        refused.told().starts_with("409 nothing_to_return_to"),
        "{}",
        refused.told()
    );
    let audit = bench
        .get("/api/v1/audit?robot=a&action=deployment.")
        .await
        .json();
    let actions: Vec<_> = audit["items"]
        .as_array()
        .unwrap()
        .iter()
        .map(|row| &row["action"])
        .collect();
    assert_eq!(
        actions,
        ["deployment.apply", "deployment.offer", "deployment.create"]
    );
}

#[tokio::test]
async fn a_decision_is_bound_to_what_was_looked_at() {
    let bench = drawn().await;
    let ana = bench.person("ana", Role::Approver).await;
    let proposal = bench.propose(&ana, "k").await.json();
    let own = bench.approve(&ana, &proposal, Version(1)).await;
    assert!(
        own.told().starts_with("403 second_person_needed"),
        "{}",
        own.told()
    );

    let cem = bench.person("cem", Role::Approver).await;
    let uri = format!("/api/v1/proposals/{}/approve", proposal["id"]);
    let body = json!({ "sha256": "00" }).to_string();
    let bare = bench.write(&cem, "POST", &uri, &[], body.clone()).await;
    assert!(
        bare.told().starts_with("428 precondition_required"),
        "{}",
        bare.told()
    );
    let other = bench
        .write(&cem, "POST", &uri, &[("if-match", "\"1\"")], body)
        .await;
    assert!(
        other.told().starts_with("412 other_revision"),
        "{}",
        other.told()
    );
    assert_eq!(
        bench.approve(&cem, &proposal, Version(1)).await.told(),
        "200"
    );
    let late = bench.approve(&cem, &proposal, Version(1)).await;
    assert!(
        late.told().starts_with("412 version_conflict"),
        "{}",
        late.told()
    );
    let closed = bench.approve(&cem, &proposal, Version(2)).await;
    assert!(
        closed.told().starts_with("409 proposal_closed"),
        "{}",
        closed.told()
    );
}

#[tokio::test]
async fn the_deployment_freeze_keeps_robots_from_what_they_have_not_seen() {
    let bench = drawn().await;
    let ana = bench.person("ana", Role::Approver).await;
    let bo = bench.person("bo", Role::Operator).await;
    let robot = bench.person("robot", Role::Robot).await;
    let freeze = async |frozen: bool, tag: &str| {
        let body = json!({ "frozen": frozen, "reason": "crane works" }).to_string();
        bench
            .write(
                &ana,
                "PUT",
                "/api/v1/deployments/freeze",
                &[("if-match", tag)],
                body,
            )
            .await
    };
    assert_eq!(freeze(true, "\"1\"").await.told(), "200");
    assert!(freeze(true, "\"1\"").await.told().starts_with("412"));
    let proposal = bench.propose(&bo, "k").await.json();
    assert_eq!(
        bench.approve(&ana, &proposal, Version(1)).await.told(),
        "200"
    );
    let uri = "/api/v1/robots/a/calibration";
    let pull = async || {
        bench
            .write(&robot, "GET", uri, &[], String::new())
            .await
            .status
    };
    assert_eq!(pull().await, 404);
    assert_eq!(freeze(false, "\"2\"").await.told(), "200");
    assert_eq!(pull().await, 200);
}

#[tokio::test]
async fn several_are_approved_at_once_each_on_its_own() {
    let bench = drawn().await;
    let ana = bench.person("ana", Role::Approver).await;
    let bo = bench.person("bo", Role::Operator).await;
    let proposal = bench.propose(&bo, "k").await.json();
    let one = |id: &Value, sha256: &Value| json!({ "id": id, "version": 1, "sha256": sha256 });
    let sha256 = &proposal["revision"]["sha256"];
    let body = json!({ "proposals": [one(&json!(99), sha256), one(&proposal["id"], sha256)] });
    let uri = "/api/v1/proposals/approve";
    let answer = bench
        .write(&ana, "POST", uri, &[], body.to_string())
        .await
        .json();
    assert_eq!(answer["items"][0].get("state"), None);
    assert_eq!(answer["items"][0]["problem"]["code"], "proposal_unknown");
    assert_eq!(answer["items"][1]["state"], "approved");
    let none = bench
        .write(&ana, "POST", uri, &[], r#"{"proposals": []}"#.to_owned())
        .await;
    assert!(
        none.told().starts_with("400 value_refused [proposals]"),
        "{}",
        none.told()
    );
}

#[tokio::test]
async fn what_cannot_be_is_refused_by_name() {
    let bench = bench(&["a"]).await;
    let bo = bench.person("bo", Role::Operator).await;
    let propose = async |body: Value| {
        let key = [("idempotency-key", "k")];
        let uri = "/api/v1/proposals";
        bench
            .write(&bo, "POST", uri, &key, body.to_string())
            .await
            .told()
    };
    let wild = json!({
        "steering_offset_rad": 0.5, "lidar_x_m": 0.4, "lidar_y_m": 0.0, "lidar_yaw_rad": 0.0,
    });
    let told = propose(json!({ "robot": "a", "values": wild, "reason": "x" })).await;
    assert!(
        told.starts_with("400 value_refused [steering_offset_rad]"),
        "{told}"
    );
    let told = propose(json!({ "robot": "a", "reason": "x" })).await;
    assert!(told.starts_with("409 not_known_yet"), "{told}");
    let told = propose(json!({ "robot": "b", "reason": "x" })).await;
    assert!(told.starts_with("404 robot_unknown"), "{told}");
    for query in ["format=xml", "from=yesterday", "actr=x", "cursor=x"] {
        let told = bench.get(&format!("/api/v1/audit?{query}")).await.told();
        assert!(told.starts_with("400"), "{query}: {told}");
    }
    let csv = bench.get("/api/v1/audit?format=csv").await;
    assert!(csv.body.starts_with("id,time,actor"), "{}", csv.body);
    let csv = bench.get("/api/v1/robots/a/history?format=csv").await;
    assert!(
        csv.body
            .starts_with("time,seconds_of_data,steering_offset_mean (rad)"),
        "{}",
        csv.body
    );
    let key = bench.get("/api/v1/signing-key").await.json();
    assert_eq!(key["algorithm"], "Ed25519");
}
