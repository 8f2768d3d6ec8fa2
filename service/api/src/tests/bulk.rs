//! Actions on many robots in one request.

use std::fmt::Write as _;

use fleetcal_domain::alert::{AlertKind, Observation};
use fleetcal_domain::limits;
use serde_json::json;

use super::*;

const URI: &str = "/api/v1/fleet/actions";

impl Bench {
    async fn act(&self, role: Role, headers: &[(&str, &str)], body: &Value) -> Answer {
        let name = format!("{}-{}", role.as_str(), uuid());
        let token = token(&self.store, &name, grant(role), None).await;
        let authorization = format!("Bearer {token}");
        let mut all = vec![("authorization", authorization.as_str())];
        all.extend(headers);
        self.send_body("POST", URI, &all, body.to_string()).await
    }
}

/// Number that no other token's name has.
fn uuid() -> u64 {
    use std::sync::atomic::{AtomicU64, Ordering};
    static LAST: AtomicU64 = AtomicU64::new(0);
    LAST.fetch_add(1, Ordering::Relaxed)
}

fn parked(ids: &[&str]) -> Value {
    let robots: Vec<_> = ids.iter().map(|id| json!({ "id": id })).collect();
    json!({
        "action": { "maintenance": { "until": "2026-01-02T00:00:00Z", "reason": "holidays" } },
        "robots": robots,
    })
}

/// Code of each outcome's problem.
fn codes(answer: &Value) -> Vec<Option<&str>> {
    let items = answer["items"].as_array().unwrap().iter();
    items.map(|item| item["problem"]["code"].as_str()).collect()
}

#[tokio::test]
async fn each_robot_has_its_outcome_and_its_row_of_the_audit() {
    let bench = bench(&["a", "b"]).await;
    let body = parked(&["a", "nobody", "b"]);
    let answer = bench.act(Role::Operator, &[], &body).await.json();
    assert_eq!(codes(&answer), [None, Some("robot_unknown"), None]);
    assert_eq!(
        (&answer["done"], &answer["refused"]),
        (&json!(2), &json!(1))
    );
    let single = bench.get("/api/v1/robots/b").await.json();
    assert_eq!(single["connection"]["state"], "maintenance");
    let audit = bench
        .get("/api/v1/audit?action=maintenance.begin")
        .await
        .json();
    let rows = audit["items"].as_array().unwrap();
    assert_eq!(rows.len(), 2, "{audit}");
    // Its end is refused where there is none, as by the single call.
    let mut ended = parked(&["a"]);
    ended["action"]["maintenance"]["until"] = Value::Null;
    for expected in [None, Some("not_in_maintenance")] {
        let answer = bench.act(Role::Operator, &[], &ended).await.json();
        assert_eq!(codes(&answer), [expected]);
    }
}

#[tokio::test]
async fn an_action_needs_the_role_of_its_single_call() {
    let bench = bench(&["a"]).await;
    let approve = json!({ "action": { "approve": {} }, "robots": [{ "id": "a" }] });
    let refused = bench.act(Role::Operator, &[], &approve).await;
    assert!(
        refused.told().starts_with("403 not_permitted"),
        "{}",
        refused.told()
    );
    let answer = bench.act(Role::Approver, &[], &approve).await.json();
    assert_eq!(answer["items"][0]["problem"]["field"], "robots.proposal");
}

#[tokio::test]
async fn proposals_are_made_approved_and_rejected_by_the_rules_of_one() {
    let bench = bench(&["a"]).await;
    let propose = json!({ "action": { "propose": { "reason": "x" } }, "robots": [{ "id": "a" }] });
    let told = bench.act(Role::Operator, &[], &propose).await.told();
    assert!(
        told.starts_with("428 precondition_required [Idempotency-Key]"),
        "{told}"
    );
    let key = [("idempotency-key", "k")];
    let answer = bench.act(Role::Operator, &key, &propose).await.json();
    assert_eq!(codes(&answer), [Some("not_known_yet")]);

    let values = json!({ "steering_offset_rad": 0.02, "lidar_x_m": 0.43, "lidar_y_m": 0.01,
        "lidar_yaw_rad": 0.01 });
    let body = json!({ "robot": "a", "values": values, "reason": "by tape" }).to_string();
    let authorization = format!("Bearer {}", bench.token);
    let headers = [("authorization", authorization.as_str()), key[0]];
    let made = bench
        .send_body("POST", "/api/v1/proposals", &headers, body)
        .await
        .json();
    let read = |sha256: &str| json!([{ "id": "a", "proposal": { "id": made["id"], "version": 1, "sha256": sha256 } }]);
    let sha256 = made["revision"]["sha256"].as_str().unwrap();
    let mut approve = json!({ "action": { "approve": {} }, "robots": read("00") });
    let answer = bench.act(Role::Approver, &[], &approve).await.json();
    assert_eq!(answer["items"][0]["problem"]["status"], 412, "{answer}");
    approve["robots"] = read(sha256);
    approve["robots"][0]["id"] = json!("b");
    let answer = bench.act(Role::Approver, &[], &approve).await.json();
    assert_eq!(
        answer["items"][0]["problem"]["field"], "robots.proposal.id",
        "{answer}"
    );
    let reject = json!({ "action": { "reject": { "reason": "no" } }, "robots": read(sha256) });
    let answer = bench.act(Role::Approver, &[], &reject).await.json();
    assert_eq!(answer["items"][0]["proposal"], made["id"], "{answer}");
    let answer = bench.act(Role::Approver, &[], &reject).await.json();
    assert_eq!(answer["items"][0]["problem"]["status"], 412, "{answer}");
}

#[tokio::test]
async fn alerts_of_a_robot_are_acknowledged_all_or_none() {
    let bench = bench(&["a"]).await;
    let kinds = [AlertKind::RollbackFailed, AlertKind::VerificationFailed];
    for kind in kinds {
        bench.observe("a", kind, Observation::Firing).await;
    }
    let all = "/api/v1/alerts";
    let page = bench.get(all).await.json();
    let alerts = page["items"].as_array().unwrap().iter();
    let mut alerts: Vec<_> = alerts
        .map(|alert| json!({ "id": alert["id"], "version": alert["version"] }))
        .collect();
    assert_eq!(alerts.len(), 2, "{page}");
    alerts[1]["version"] = json!(99);
    let body =
        json!({ "action": { "acknowledge": {} }, "robots": [{ "id": "a", "alerts": alerts }] });
    let answer = bench.act(Role::Operator, &[], &body).await.json();
    assert_eq!(answer["items"][0]["problem"]["status"], 412, "{answer}");
    let page = bench.get(all).await.json();
    for alert in page["items"].as_array().unwrap() {
        assert_eq!(alert["acknowledgement"], Value::Null, "{alert}");
    }
}

#[tokio::test]
async fn what_no_single_call_takes_is_refused_whole() {
    let bench = bench(&["a"]).await;
    let many: Vec<String> = (0..=limits::ACTED_AT_ONCE_MAX)
        .map(|n| format!("r{n}"))
        .collect();
    let many: Vec<&str> = many.iter().map(String::as_str).collect();
    for (ids, expected) in [
        (&[][..], "0 robots"),
        (&["a", "a"][..], "a is named twice"),
        (&many[..], "501 robots"),
    ] {
        let told = bench.act(Role::Operator, &[], &parked(ids)).await.told();
        assert!(told.starts_with("400 value_refused [robots]"), "{told}");
        assert!(told.contains(expected), "{told}");
    }
    let unknown = json!({ "action": { "tow": {} }, "robots": [{ "id": "a" }] });
    let told = bench.act(Role::Operator, &[], &unknown).await.told();
    assert!(told.starts_with("422 body_refused"), "{told}");
    let audit = bench
        .get("/api/v1/audit?action=maintenance.begin")
        .await
        .json();
    assert_eq!(audit["items"], json!([]));
}

#[tokio::test]
async fn a_retired_robot_keeps_its_records_and_comes_back() {
    let bench = bench(&["a", "b"]).await;
    let send = async |method: &str, uri: &str, body: &str| {
        let authorization = format!("Bearer {}", bench.token);
        let headers = [
            ("authorization", authorization.as_str()),
            ("if-match", "\"1\""),
        ];
        let uri = format!("/api/v1/{uri}");
        bench
            .send_body(method, &uri, &headers, body.to_owned())
            .await
    };
    let listed = async || {
        let robots = bench.get("/api/v1/robots").await.json();
        let items = robots["items"].as_array().unwrap().iter();
        items
            .map(|one| one["id"].as_str().unwrap().to_owned())
            .collect::<Vec<_>>()
    };
    let told = send("DELETE", "robots/a", "").await.told();
    assert!(told.starts_with("400 query_refused"), "{told}");
    let told = send("DELETE", "robots/nobody?reason=x", "").await.told();
    assert!(told.starts_with("404 robot_unknown"), "{told}");
    let retired = send("DELETE", "robots/a?reason=sold", "").await.json();
    assert_eq!(
        (&retired["robot"], &retired["reason"]),
        (&json!("a"), &json!("sold"))
    );
    assert_eq!(listed().await, ["b"]);
    let retired = bench.get("/api/v1/fleet/retired").await.json();
    assert_eq!(retired["items"][0]["robot"], "a");
    let one = bench.get("/api/v1/robots/a").await.json();
    assert_eq!(one["retired"]["by"], "tester", "{one}");

    let config = r#"{"model": "tricycle", "wheelbase_m": 1.5}"#;
    let note = r#"{"kind": "power_on", "note": "gone"}"#;
    for (method, uri, body) in [
        ("DELETE", "robots/a?reason=sold", ""),
        ("PUT", "robots/a", config),
        ("POST", "robots/a/events", note),
        (
            "PUT",
            "robots/a/maintenance",
            r#"{"until": null, "reason": "x"}"#,
        ),
    ] {
        let told = send(method, uri, body).await.told();
        assert!(
            told.starts_with("409 robot_retired"),
            "{method} {uri}: {told}"
        );
    }

    let count = async || {
        let one = bench.get("/api/v1/robots/a").await.json();
        one["counters"]["refused"].clone()
    };
    let form = fleetcal_proto::encoding::Encoding::Json;
    let stream = fleetcal_model::Stream::WheelOdometry;
    bench
        .fleet
        .receive(&robot("a"), stream, form, 2, || b"{}".to_vec());
    assert_eq!(count().await, 1);

    let told = send("POST", "robots/a/bring-back", r#"{"reason": "again"}"#)
        .await
        .told();
    assert_eq!(told, "204");
    assert_eq!(listed().await, ["a", "b"]);
    let audit = bench.get("/api/v1/audit?robot=a").await.json();
    let rows = audit["items"].as_array().unwrap().iter();
    let actions: Vec<_> = rows.map(|row| row["action"].as_str().unwrap()).collect();
    assert_eq!(actions[..2], ["robot.bring_back", "robot.retire"]);
}

/// Registers by one request; `query` begins with a question mark.
async fn import(bench: &Bench, query: &str, media: &str, body: String) -> Answer {
    let authorization = format!("Bearer {}", bench.token);
    let headers = [
        ("authorization", authorization.as_str()),
        ("content-type", media),
    ];
    let uri = format!("/api/v1/fleet/import{query}");
    bench.send_body("POST", &uri, &headers, body).await
}

#[tokio::test]
async fn five_hundred_are_registered_by_one_request() {
    let bench = bench(&["a"]).await;
    let mut table = "id,model,wheelbase_m,nominal_extrinsics.x_m,nominal_extrinsics.y_m,\
        nominal_extrinsics.yaw_rad\n"
        .to_owned();
    for number in 0..500 {
        writeln!(table, "agv_{number:03},tricycle,1.2,0.43,0,0").unwrap();
    }
    let dry = import(&bench, "?dry_run=true", "text/csv", table.clone())
        .await
        .json();
    assert_eq!(dry, json!({ "dry_run": true, "robots": 500, "wrong": [] }));
    assert_eq!(bench.fleet.ids().len(), 1);
    let answer = import(&bench, "", "text/csv; charset=utf-8", table.clone()).await;
    assert_eq!(answer.told(), "201");
    assert_eq!(bench.fleet.ids().len(), 501);
    let one = bench.get("/api/v1/robots/agv_499").await.json();
    assert_eq!(one["config"]["nominal_extrinsics"]["x_m"], 0.43);
    let audit = bench
        .get("/api/v1/audit?action=robot.register&limit=1000")
        .await
        .json();
    assert_eq!(audit["items"].as_array().unwrap().len(), 501);
    let again = import(&bench, "", "text/csv", table).await.told();
    assert!(again.starts_with("422 lines_refused"), "{again}");
}

#[tokio::test]
async fn every_wrong_line_is_named_and_none_is_registered() {
    let bench = bench(&["a"]).await;
    let table = "id,model,wheelbase_m,streams.prefix,colour\n\
        a,tricycle,1.2,,\n\
        r1,tricycle,1.2,,\n\
        r1,tricycle,1.2,,\n\
        r 2,tricycle,1.2,,\n\
        r3,hovercraft,1.2,,\n\
        r4,tricycle,1200,,\n\
        r5,tricycle,,,\n\
        r6,tricycle,1.2,,red\n";
    let dry = import(&bench, "?dry_run=true", "text/csv", table.to_owned())
        .await
        .json();
    assert_eq!(dry["robots"], 1);
    let wrong = dry["wrong"].as_array().unwrap().iter();
    let wrong: Vec<_> = wrong
        .map(|one| {
            (
                one["line"].as_u64().unwrap(),
                one["field"].clone(),
                one["value"].clone(),
            )
        })
        .collect();
    let null = Value::Null;
    assert_eq!(
        wrong,
        [
            (2, json!("id"), json!("a")),
            (4, json!("id"), json!("r1")),
            (5, json!("id"), json!("r 2")),
            (6, json!("model"), json!("hovercraft")),
            (7, json!("wheelbase_m"), json!(1200)),
            (8, null.clone(), null),
            (9, json!("colour"), json!("red")),
        ],
        "{dry}"
    );
    let told = import(&bench, "", "text/csv", table.to_owned())
        .await
        .told();
    assert!(told.starts_with("422 lines_refused"), "{told}");
    assert!(told.contains("7 of 8 robots are wrong"), "{told}");
    let list = json!({ "robots": [{ "id": "r1", "config": { "model": "tricycle" } }] });
    let told = import(&bench, "", "application/json", list.to_string())
        .await
        .told();
    assert!(told.contains("line 1: "), "{told}");
    let told = import(&bench, "", "text/plain", String::new()).await.told();
    assert!(told.starts_with("415"), "{told}");
    assert_eq!(bench.fleet.ids().len(), 1);
}

#[tokio::test]
async fn a_dry_run_of_a_change_says_what_restarts_and_stores_nothing() {
    let bench = bench(&["a"]).await;
    let before = bench.get("/api/v1/robots/a").await.json();
    let tried = async |version: &str, config: Value| {
        let authorization = format!("Bearer {}", bench.token);
        let headers = [
            ("authorization", authorization.as_str()),
            ("if-match", version),
        ];
        let uri = "/api/v1/robots/a?dry_run=true";
        bench
            .send_body("PUT", uri, &headers, config.to_string())
            .await
    };
    let mut config = before["config"].clone();
    config["wheelbase_m"] = json!(1.7);
    config["nominal_extrinsics"] = json!({ "x_m": 0.5, "y_m": 0.0, "yaw_rad": 0.0 });
    let answer = tried("\"1\"", config.clone()).await.json();
    let keys = json!(["wheelbase_m", "nominal_extrinsics"]);
    assert_eq!(answer["estimate_begins_again_by"], keys, "{answer}");
    assert_eq!(answer["config"], before["config"]);
    let told = tried("\"7\"", config.clone()).await.told();
    assert!(told.starts_with("412 version_conflict"), "{told}");
    let same = tried("\"1\"", before["config"].clone()).await.json();
    assert_eq!(same.get("estimate_begins_again_by"), None);
    let after = bench.get("/api/v1/robots/a").await.json();
    assert_eq!(
        (&after["config"], &after["version"]),
        (&before["config"], &before["version"])
    );
}

#[tokio::test]
async fn a_table_has_few_short_columns_each_once() {
    let bench = bench(&["a"]).await;
    let told = async |table: String| {
        let answer = import(&bench, "?dry_run=true", "text/csv", table).await;
        answer.told()
    };
    let wide = (0..64).fold("id".to_owned(), |header, number| {
        format!("{header},c{number}")
    });
    let deep = format!("id,{}\nx,1\n", vec!["a"; 100_000].join("."));
    for (table, expected) in [
        (
            deep,
            "the name of column 2 has 199999 bytes, expected 64 at most",
        ),
        (
            "id,a.b.c.d\nx,1\n".to_owned(),
            "column a.b.c.d has 4 parts, expected 3 at most",
        ),
        (
            format!("{wide}\nx\n"),
            "its first line has 65 columns, expected 64 at most",
        ),
        (
            "id,wheelbase_m,wheelbase_m\nx,1,2\n".to_owned(),
            "column wheelbase_m is there twice, expected each column once",
        ),
        (
            "id,streams,streams.prefix\nx,,7\n".to_owned(),
            "columns streams and streams.prefix overlap, expected one of them",
        ),
    ] {
        let told = told(table).await;
        assert!(told.starts_with("422 body_refused"), "{told}");
        assert!(told.contains(expected), "{told}");
    }
    let many = format!("id,model\n{}", "x,tricycle\n".repeat(1_001));
    let told = told(many).await;
    assert!(told.starts_with("422 value_refused [robots]"), "{told}");
}

#[tokio::test]
async fn a_cell_has_the_type_of_its_column() {
    let bench = bench(&[]).await;
    let table = "id,model,wheelbase_m,site,vehicle_type,tags,streams.prefix,streams.scan.topic\n\
        r1,tricycle,1.2,1010,516,7; leased,7,8\n";
    let answer = import(&bench, "", "text/csv", table.to_owned()).await;
    assert_eq!(answer.told(), "201", "{}", answer.body);
    let config = bench.get("/api/v1/robots/r1").await.json()["config"].clone();
    assert_eq!(
        (&config["site"], &config["vehicle_type"], &config["tags"]),
        (&json!("1010"), &json!("516"), &json!(["7", "leased"]))
    );
    let streams = (
        &config["streams"]["prefix"],
        &config["streams"]["scan"]["topic"],
    );
    assert_eq!(streams, (&json!("7"), &json!("8")));
}
