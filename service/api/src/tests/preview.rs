//! Route of an unregistered robot's preview.

use fleetcal_domain::limits;
use fleetcal_patience::until_answered;
use serde_json::json;

use super::robots::straight_on;
use super::*;

const PATH: &str = "/api/v1/robots/a/preview";
const CONFIG: &str = r#"{"model": "bicycle", "wheelbase_m": 1.2}"#;

async fn preview(bench: &Bench, path: &str, config: &str) -> Answer {
    bench.send_body("POST", path, &[], config.to_owned()).await
}

#[tokio::test]
async fn what_a_robot_sends_is_shown_and_nothing_is_stored() {
    let bench = bench(&[]).await;
    let told = preview(&bench, PATH, CONFIG).await.told();
    assert_eq!(told, "404 robot_unknown: no robot a is known");
    straight_on(&bench, 0);
    // Messages are kept from the first request on.
    let empty = preview(&bench, PATH, CONFIG).await.json();
    assert_eq!(
        (
            &empty["checks"]["streams"],
            &empty["top_view"],
            &empty["dropped"]
        ),
        (&json!([]), &Value::Null, &json!(0))
    );
    for step in 1..100 {
        straight_on(&bench, step);
    }
    let shown = preview(&bench, PATH, CONFIG).await.json();
    let streams = shown["checks"]["streams"].as_array().unwrap();
    let counts: Vec<_> = streams.iter().map(|stream| &stream["messages"]).collect();
    assert_eq!(counts, [&json!(99), &json!(99)], "{shown}");
    assert!(shown["top_view"]["lidar"]["x_m"].as_f64().unwrap() > 1.2);
    assert!(!shown["checks"]["findings"].as_array().unwrap().is_empty());

    let robot = bench.get("/api/v1/robots/a").await.json();
    assert_eq!(
        (&robot["state"], &robot["config"]),
        (&json!("unregistered"), &Value::Null)
    );
    assert_eq!(
        bench.get("/api/v1/audit?robot=a").await.json()["items"],
        json!([])
    );
    // Another configuration begins again.
    let other = preview(&bench, PATH, &CONFIG.replace("1.2", "1.5"))
        .await
        .json();
    assert_eq!(other["checks"]["streams"], json!([]));

    let made = bench
        .send_body("PUT", "/api/v1/robots/a", &[("if-none-match", "*")], CONFIG)
        .await;
    assert_eq!(made.told(), "201");
    let told = preview(&bench, PATH, CONFIG).await.told();
    assert!(
        told.starts_with("409 robot_registered: robot a is registered"),
        "{told}"
    );
}

#[tokio::test]
async fn previews_are_bounded_and_end_when_nobody_looks() {
    let bench = bench(&[]).await;
    let path = |name: &str| format!("/api/v1/robots/{name}/preview");
    let names: Vec<_> = (0..=limits::PREVIEWS_MAX)
        .map(|number| format!("r{number}"))
        .collect();
    for name in &names {
        bench.fleet.set_alive(&robot(name), true);
    }
    for name in &names[1..] {
        assert_eq!(preview(&bench, &path(name), CONFIG).await.told(), "200");
    }
    let told = preview(&bench, &path("r0"), CONFIG).await.told();
    assert!(
        told.starts_with("503 robot_busy: 4 other robots than r0"),
        "{told}"
    );
    bench.clock.advance(limits::PREVIEW_KEPT);
    until_answered("a place for another robot", async || {
        preview(&bench, &path("r0"), CONFIG).await.status == 200
    })
    .await;
}

#[tokio::test]
async fn operators_look_at_configurations_that_can_be() {
    let bench = bench(&[]).await;
    straight_on(&bench, 0);
    for (role, status) in [(Role::Viewer, 403), (Role::Operator, 200)] {
        let name = format!("{role:?}").to_lowercase();
        let bearer = format!(
            "Bearer {}",
            token(&bench.store, &name, grant(role), None).await
        );
        let by = [("authorization", bearer.as_str())];
        assert_eq!(
            bench.send_body("POST", PATH, &by, CONFIG).await.status,
            status
        );
    }
    let told = preview(&bench, PATH, r#"{"model": "bicycle", "wheelbase_m": 120}"#)
        .await
        .told();
    assert!(told.starts_with("422 body_refused [wheelbase_m]"), "{told}");
}
