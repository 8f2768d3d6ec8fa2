//! Notes of people and tools about a robot: `/robots/{id}/events`.

use insta::assert_snapshot;
use serde_json::json;

use super::*;

#[tokio::test]
async fn a_note_is_kept_once_and_listed() {
    let bench = bench(&["a"]).await;
    let uri = "/api/v1/robots/a/events";
    let body = r#"{"kind": "reassembled", "note": "new LiDAR bracket",
                   "time": "2026-01-01T01:00:00+01:00"}"#;
    let post = async |key: &str, body: &str| {
        bench
            .send_body("POST", uri, &[("idempotency-key", key)], body.to_owned())
            .await
    };
    let first = post("k1", body).await;
    assert_eq!(first.status.as_u16(), 201);
    assert_eq!(
        first.json(),
        json!({
            "id": 1, "robot": "a", "kind": "reassembled", "source": "person",
            "time": "2026-01-01T00:00:00Z", "received": "2026-01-01T00:00:00Z",
            "author": "tester", "note": "new LiDAR bracket", "details": null,
        })
    );
    assert_eq!(post("k1", body).await.json(), first.json());
    assert_snapshot!(post("k1", r#"{"kind": "maintenance"}"#).await.told(), @"422 idempotency_key_reused [Idempotency-Key]: the Idempotency-Key was used before with another request");
    for _ in 0..2 {
        assert_eq!(
            bench
                .send_body("POST", uri, &[], r#"{"kind": "maintenance"}"#)
                .await
                .told(),
            "201"
        );
    }
    // The oldest is the last of the last page; the service may have added events of its own.
    let mut uri = format!("{uri}?limit=1");
    let mut notes = Vec::new();
    loop {
        let page = bench.get(&uri).await.json();
        let [item] = page["items"].as_array().unwrap().as_slice() else {
            panic!("{page}")
        };
        notes.extend((item["source"] == "person").then(|| item.clone()));
        let Some(next) = page["next"].as_str() else {
            break;
        };
        uri = format!("/api/v1/robots/a/events?limit=1&cursor={next}");
    }
    assert_eq!((notes.len(), notes.last()), (3, Some(&first.json())));
    let audit = bench.get("/api/v1/audit?action=event.note").await.json();
    let rows = audit["items"].as_array().unwrap();
    assert_eq!(rows.len(), 3, "a repeated request is noted once");
    let row = &rows[2];
    assert_eq!(
        (&row["actor"], &row["robot"], &row["reason"]),
        (&json!("tester"), &json!("a"), &json!("new LiDAR bracket"))
    );
    assert_eq!(row["after"]["kind"], "reassembled");
}

/// Invariant: the estimator receives each note that is answered with 201, whatever else it has to
/// do; a note without room is refused before it is stored.
#[tokio::test]
async fn every_note_is_taken_or_refused() {
    let bench = bench(&["a"]).await;
    let uri = "/api/v1/robots/a/events";
    let bodies = [
        r#"{"kind": "reassembled"}"#,
        r#"{"kind": "reassembled", "time": "1999-01-01T00:00:00Z"}"#,
        r#"{"kind": "power_on", "time": "2199-01-01T00:00:00Z", "note": "LiDAR"}"#,
    ];
    let posts = (0..200).map(|number| {
        let body = bodies[number % bodies.len()].to_owned();
        bench.send_body("POST", uri, &[], body)
    });
    let mut stored = 0;
    for answer in futures::future::join_all(posts).await {
        match answer.status.as_u16() {
            201 => stored += 1,
            503 => assert!(answer.told().contains("robot_busy")),
            other => panic!("{other}: {}", answer.told()),
        }
    }
    let audit = bench
        .get("/api/v1/audit?action=event.note&limit=1000")
        .await;
    let audit = audit.json();
    let rows = audit["items"].as_array().unwrap();
    assert_eq!(rows.len(), stored, "what is refused is not stored");
    let last = rows[0]["id"].as_i64().unwrap();
    let taken = async {
        while bench
            .fleet
            .notes_taken(&robot("a"))
            .is_none_or(|taken| taken.0 < last)
        {
            tokio::time::sleep(std::time::Duration::from_millis(5)).await;
        }
    };
    let limit = std::time::Duration::from_secs(30);
    tokio::time::timeout(limit, taken).await.unwrap();
    let view = bench.fleet.robot(&robot("a")).unwrap();
    assert!(view.reassembly_open);
    let unregistered =
        bench.send_body("POST", "/api/v1/robots/b/events", &[], bodies[0].to_owned());
    assert_eq!(unregistered.await.status.as_u16(), 404);
}

#[tokio::test]
async fn a_note_is_refused_by_field() {
    let bench = bench(&["a"]).await;
    let told = async |id: &str, body: String| {
        bench
            .send_body("POST", &format!("/api/v1/robots/{id}/events"), &[], body)
            .await
            .told()
    };
    let long = |field: &str, chars: usize| {
        json!({"kind": "maintenance", field: "x".repeat(chars)}).to_string()
    };
    assert_snapshot!(told("b", r#"{"kind": "maintenance"}"#.to_owned()).await, @"404 robot_unknown: no robot b is known");
    assert_snapshot!(told("a", r#"{"kind": "exploded"}"#.to_owned()).await, @"422 body_refused [kind]: the body: unknown variant `exploded`, expected one of `reassembled`, `maintenance`, `power_on` at line 1 column 19");
    assert_snapshot!(told("a", r#"{"kind": "maintenance", "when": 1}"#.to_owned()).await, @"422 body_refused [when]: the body: unknown field `when`, expected one of `kind`, `time`, `note` at line 1 column 30");
    assert_snapshot!(told("a", r#"{"kind": "maintenance", "time": "now"}"#.to_owned()).await, @"422 body_refused [time]: the body: expected four digit year (or leading sign for six digit year), but found end of input at line 1 column 37");
    assert_snapshot!(told("a", r#"{"kind": "maintenance", "time": "1960-01-01T00:00:00Z"}"#.to_owned()).await, @r#"400 value_refused [time]: time: got "1960-01-01T00:00:00Z", expected a time between 1970 and 2262"#);
    assert_snapshot!(told("a", long("note", 1_001)).await, @"400 value_refused [note]: note: got 1001 characters, expected 1000 at most");
    assert_snapshot!(told("a", long("author", 3)).await, @"422 body_refused [author]: the body: unknown field `author`, expected one of `kind`, `time`, `note` at line 1 column 9");
    let headers = [("idempotency-key", "")];
    let empty = bench
        .send_body(
            "POST",
            "/api/v1/robots/a/events",
            &headers,
            r#"{"kind": "power_on"}"#,
        )
        .await;
    assert_snapshot!(empty.told(), @r#"400 value_refused [Idempotency-Key]: Idempotency-Key: got "", expected 1 to 128 characters"#);
    assert_snapshot!(bench.get("/api/v1/robots/a/events?limit=1001").await.told(), @r#"400 value_refused [limit]: limit: got "1001", expected a whole number from 1 to 1000"#);
    assert_snapshot!(bench.get("/api/v1/robots/a/events?cursor=x").await.told(), @r#"400 value_refused [cursor]: cursor: got "x", expected `next` of the page before"#);
}
