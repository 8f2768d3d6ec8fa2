//! Route of a robot's joining checks.

use std::time::Duration;

use serde_json::json;

use super::robots::straight_on;
use super::*;

#[tokio::test]
async fn the_joining_checks_of_a_robot_are_those_of_what_it_sends() {
    let bench = bench(&["a"]).await;
    let path = "/api/v1/robots/a/checks";
    let before = bench.get(path).await.json();
    assert_eq!(
        (&before["streams"], &before["findings"]),
        (&json!([]), &json!([]))
    );
    straight_on(&bench, 0);
    while bench.fleet.robot(&robot("a")).unwrap().counters.processed < 2 {
        tokio::time::sleep(Duration::from_millis(1)).await;
    }
    let checks = bench.get(path).await.json();
    assert_eq!(checks["robot"], "a");
    let stream = &checks["streams"][0];
    assert_eq!(
        (&stream["messages"], &stream["left_out"]),
        (&json!(1), &json!([]))
    );
    let finding = &checks["findings"][0];
    assert_eq!(
        (&finding["check"], &finding["state"]),
        (&json!("streams"), &json!("not_yet"))
    );
    assert_eq!(finding["spoils_values"], false);
    let told = bench.get("/api/v1/robots/nobody/checks").await.told();
    assert!(told.starts_with("404 "), "{told}");
}
