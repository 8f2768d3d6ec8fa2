//! Many robots at once: registered by one request, acted on by another, and retired.

use std::time::Duration;

use fleetcal_clock::{Clock as _, SystemClock};
use fleetcal_domain::timestamp;
use fleetcal_tests::service::Service;
use serde_json::{Value, json};

const ROBOTS: usize = 500;

fn ids() -> impl Iterator<Item = String> {
    (0..ROBOTS).map(|number| format!("agv_{number:03}"))
}

fn action(action: &Value, ids: impl Iterator<Item = String>) -> String {
    let robots: Vec<_> = ids.map(|id| json!({ "id": id })).collect();
    json!({ "action": action, "robots": robots }).to_string()
}

#[test]
fn five_hundred_are_registered_maintained_and_retired_by_one_request_each() {
    let mut service = Service::start(&[]);
    // Each robot counts as one change of its caller.
    let [first, second, third] = ["first", "second", "third"]
        .map(|name| service.made_token(&["--role", "operator", "--name", name]));
    let robots: Vec<_> = ids()
        .map(|id| json!({ "id": id, "config": { "model": "tricycle", "wheelbase_m": 1.2 } }))
        .collect();
    let robots = json!({ "robots": robots }).to_string();
    let dry = service.send(
        "POST /api/v1/fleet/import?dry_run=true",
        &first,
        "",
        &robots,
    );
    assert_eq!(
        dry,
        json!({ "dry_run": true, "robots": ROBOTS, "wrong": [] })
    );
    let done = service.send("POST /api/v1/fleet/import", &first, "", &robots);
    assert_eq!(done["robots"], ROBOTS);

    let parked = json!({ "maintenance": { "until": null, "reason": "x" } });
    let refused = service.send(
        "POST /api/v1/fleet/actions",
        &second,
        "",
        &action(&parked, ids().take(2)),
    );
    assert_eq!(
        (&refused["done"], &refused["refused"]),
        (&json!(0), &json!(2))
    );
    assert_eq!(refused["items"][0]["problem"]["code"], "not_in_maintenance");

    let until = SystemClock::start().now().plus(Duration::from_hours(1));
    let until = timestamp::of(until).to_string();
    let begin = action(
        &json!({ "maintenance": { "until": until, "reason": "x" } }),
        ids(),
    );
    let maintained = service.send("POST /api/v1/fleet/actions", &third, "", &begin);
    assert_eq!(maintained["done"], ROBOTS, "{maintained}");

    let retire = action(&json!({ "retire": { "reason": "sold" } }), ids());
    let retired = service.send("POST /api/v1/fleet/actions", &second, "", &retire);
    assert_eq!(retired["done"], ROBOTS, "{retired}");
    service.kill();
    service.restart();
    let listed = service.get("/api/v1/robots");
    assert_eq!(listed["items"], json!([]));
    let page = service.get("/api/v1/fleet/retired?limit=1000");
    assert_eq!(page["items"].as_array().unwrap().len(), ROBOTS);
}
