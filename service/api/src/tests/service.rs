//! Health, metrics, the description, the pages, and properties of every route.

use insta::assert_snapshot;

use super::*;
use crate::openapi;

#[tokio::test]
async fn health_and_readiness() {
    let bench = bench(&[]).await;
    assert_eq!(bench.get("/healthz").await.body, "ok\n");
    let ready = bench.get("/readyz").await;
    assert_eq!(ready.status.as_u16(), 200, "{}", ready.body);
    bench.link_open.send_replace(false);
    let unready = bench.get("/readyz").await;
    assert_eq!(unready.status.as_u16(), 503);
    assert_snapshot!(unready.body, @r#"{"ready":false,"database":{"ok":true},"survives_machine_loss":"no","migrations":{"ok":true},"zenoh":{"ok":false,"detail":"the Zenoh session is not open"}}"#);
    bench.link_open.send_replace(true);
    bench.store.close().await.unwrap();
    let unready = bench.get("/readyz").await;
    assert_eq!(
        (unready.status.as_u16(), &unready.json()["migrations"]["ok"]),
        (503, &Value::Bool(false))
    );
    assert_eq!(bench.get("/healthz").await.status.as_u16(), 200);
}

#[tokio::test]
async fn security_txt_names_the_configured_contacts_to_everybody() {
    let (path, mut bench) = ("/.well-known/security.txt", bench(&[]).await);
    assert_eq!(bench.get(path).await.status.as_u16(), 404);
    let contact = SecurityContact::try_from("mailto:a@example.com".to_owned()).unwrap();
    bench.setup.security_contacts.contacts = vec![contact];
    bench.routes = router(bench.setup.clone());
    let answer = bench.send("GET", path, &[("authorization", "")]).await;
    let is_named = answer
        .body
        .starts_with("Contact: mailto:a@example.com\nExpires: ");
    assert!(is_named, "{}", answer.body);
}

#[tokio::test]
async fn a_closed_store_is_unavailable() {
    let bench = bench(&["a"]).await;
    bench.store.close().await.unwrap();
    let body = r#"{"kind": "maintenance"}"#;
    let answer = bench
        .send_body("POST", "/api/v1/robots/a/events", &[], body)
        .await;
    assert_snapshot!(answer.told(), @"503 database_unavailable: the database could not read a token");
    assert_eq!(answer.header("retry-after"), "2");
    assert_snapshot!(bench.get("/api/v1/robots/a/history").await.told(), @"503 database_unavailable: the database could not read a token");
}

#[test]
fn the_description_in_the_repository_is_current() {
    let path = concat!(env!("CARGO_MANIFEST_DIR"), "/../../web/openapi.json");
    let committed: Value = serde_json::from_str(&std::fs::read_to_string(path).unwrap()).unwrap();
    let current = serde_json::to_value(openapi()).unwrap();
    assert!(
        committed == current,
        "web/openapi.json is not that of the routes: run \
         `cargo run --release -p fleetcal --example openapi > web/openapi.json`"
    );
}

#[tokio::test]
async fn the_description_is_served_with_a_tag() {
    let bench = bench(&[]).await;
    let first = bench.get("/api/v1/openapi.json").await;
    assert_eq!(first.json()["openapi"], "3.1.0");
    let again = [("if-none-match", first.header("etag"))];
    let again = bench.send("GET", "/api/v1/openapi.json", &again).await;
    assert_eq!((again.status.as_u16(), again.body.as_str()), (304, ""));
}

#[tokio::test]
async fn the_description_can_be_read_in_a_browser() {
    let bench = bench(&[]).await;
    let moved = bench.get("/docs").await;
    assert_eq!(
        (moved.status.as_u16(), moved.header("location")),
        (303, "/docs/")
    );
    let page = bench.get("/docs/").await;
    assert!(page.body.contains("swagger-ui-bundle.js"), "{}", page.body);
    assert!(!page.header("content-security-policy").contains("unsafe"));
    assert_eq!(
        bench
            .get("/docs/swagger-ui-bundle.js")
            .await
            .status
            .as_u16(),
        200
    );
    let start = bench.get("/docs/swagger-initializer.js").await.body;
    assert!(
        start.contains("/api/v1/openapi.json") && !start.contains("https://"),
        "{start}"
    );
    assert_snapshot!(bench.get("/docs/none.js").await.told(), @"404 not_found: nothing is at /docs/none.js");
}

/// Every operation of the description, with a real path.
pub(super) fn operations() -> Vec<(String, String)> {
    let document = serde_json::to_value(openapi()).unwrap();
    let paths = document["paths"].as_object().unwrap();
    let methods = |item: &Value| {
        item.as_object()
            .unwrap()
            .keys()
            .cloned()
            .collect::<Vec<_>>()
    };
    paths
        .iter()
        .flat_map(|(path, item)| methods(item).into_iter().map(move |m| (m, path)))
        .map(|(method, path)| {
            let id = if path.contains("/robots/") {
                "a"
            } else {
                "999999"
            };
            (method.to_uppercase(), path.replace("{id}", id))
        })
        .collect()
}

#[tokio::test]
async fn every_route_refuses_unknown_parameters_and_has_security_headers() {
    let bench = bench(&["a"]).await;
    let operations = operations();
    assert!(operations.len() > 20);
    for (method, path) in operations {
        let headers = [("if-match", "\"1\"")];
        let answer = bench
            .send_body(&method, &format!("{path}?surprise=1"), &headers, "{}")
            .await;
        let told = answer.told();
        // What only a robot may call is refused to everybody else before its query is read.
        let robots_own = told.ends_with("expected the robot itself");
        assert!(
            robots_own
                || told.starts_with(
                    "400 query_refused [surprise]: the query: unknown field `surprise`"
                ),
            "{method} {path}: {told}"
        );
        assert_eq!(answer.header("x-content-type-options"), "nosniff");
        assert_eq!(answer.header("referrer-policy"), "no-referrer");
        assert_eq!(answer.header("cache-control"), "no-cache");
        let policy = answer.header("content-security-policy");
        assert!(
            policy.contains("script-src 'self';") && !policy.contains("unsafe"),
            "{policy}"
        );
        assert!(policy.contains("frame-ancestors 'none'"), "{policy}");
        assert!(!answer.header("x-request-id").is_empty());
    }
}

#[tokio::test]
async fn every_route_refuses_other_methods() {
    let bench = bench(&["a"]).await;
    let operations = operations();
    for (_, path) in &operations {
        let is_answered = |method: &str| {
            let operation = (method.to_owned(), path.clone());
            operations.contains(&operation)
        };
        for method in ["DELETE", "PATCH", "TRACE", "BREW"] {
            if is_answered(method) {
                continue;
            }
            let told = bench.send(method, path, &[]).await.told();
            assert_eq!(
                told,
                format!("405 method_refused: {method} is not answered at {path}")
            );
        }
    }
    assert!(
        bench
            .send("DELETE", "/healthz", &[])
            .await
            .header("allow")
            .contains("GET")
    );
}

#[tokio::test]
async fn what_is_not_there_is_a_problem() {
    let bench = bench(&[]).await;
    let told = async |path: &str| bench.get(path).await.told();
    assert_snapshot!(told("/api").await, @"404 not_found: nothing is at /api");
    assert_snapshot!(told("/api/v1/nothing").await, @"404 not_found: nothing is at /api/v1/nothing");
    assert_snapshot!(told("/api/v2/robots").await, @"404 not_found: nothing is at /api/v2/robots");
    assert_snapshot!(told("/assets/none.js").await, @"404 not_found: nothing is at /assets/none.js");
    assert_snapshot!(told("/../../etc/passwd.txt").await, @"404 not_found: nothing is at /../../etc/passwd.txt");
    assert_snapshot!(bench.send("POST", "/", &[]).await.told(), @"405 method_refused: POST is not answered at /");
}

#[tokio::test]
async fn answers_are_compressed_for_who_accepts_it() {
    let bench = bench(&[]).await;
    let plain = bench.get("/api/v1/openapi.json").await;
    let packed = bench
        .send(
            "GET",
            "/api/v1/openapi.json",
            &[("accept-encoding", "gzip")],
        )
        .await;
    assert_eq!(
        (
            plain.header("content-encoding"),
            packed.header("content-encoding")
        ),
        ("", "gzip")
    );
    assert!(packed.header("vary").contains("accept-encoding"));
}
