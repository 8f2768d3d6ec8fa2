//! Tolerances: read by everybody, set by administrators.

use insta::assert_snapshot;
use serde_json::json;

use super::*;

const PATH: &str = "/api/v1/policy";

impl Bench {
    async fn set_policy(&self, version: &str, policy: &Value, reason: &str) -> Answer {
        let body = json!({"policy": policy, "reason": reason}).to_string();
        self.send_body("PUT", PATH, &[("if-match", version)], body)
            .await
    }
}

#[tokio::test]
async fn what_is_set_counts_from_then_on_and_outlives_the_service() {
    let bench = bench(&["a"]).await;
    let given = bench.get(PATH).await;
    assert_eq!(given.header("etag"), "\"1\"");
    let mut policy = given.json();
    assert_eq!(policy["propose_beyond"]["steering_offset_deg"], 0.15);
    assert_eq!(policy.get("set_by"), None);
    policy["propose_beyond"]["steering_offset_deg"] = json!(0.4);
    policy["roll_back"] = json!(false);

    let set = bench.set_policy("\"1\"", &policy, "narrow aisles").await;
    assert_eq!((set.status.as_u16(), set.header("etag")), (200, "\"2\""));
    let set = set.json();
    assert_eq!(set["propose_beyond"]["steering_offset_deg"], 0.4);
    assert_eq!(
        (&set["set_by"], &set["set_reason"]),
        (&json!("tester"), &json!("narrow aisles"))
    );
    assert_eq!(bench.get(PATH).await.json(), set);
    let counts = bench.lifecycle.policy();
    assert_eq!(
        (counts.propose_beyond.steering_offset_deg, counts.roll_back),
        (0.4, false)
    );
    // Another start of the service reads it again.
    let stored = bench.store.stored_policy().await.unwrap();
    assert_eq!(stored.policy, Some(*counts));
    let audit = bench.get("/api/v1/audit?action=policy.change").await.json();
    let row = &audit["items"][0];
    assert_eq!(
        (&row["actor"], &row["reason"]),
        (&json!("tester"), &json!("narrow aisles"))
    );
    assert_eq!(row["before"]["policy"], Value::Null);
    assert_eq!(row["after"]["policy"]["roll_back"], json!(false));

    // And back to the file's.
    let back = bench.set_policy("\"2\"", &Value::Null, "as agreed").await;
    assert_eq!((back.status.as_u16(), back.header("etag")), (200, "\"3\""));
    assert_eq!(back.json(), given.json());
    assert_eq!(*bench.lifecycle.policy(), Policy::default());
}

#[tokio::test]
async fn a_policy_is_refused_by_field() {
    let bench = bench(&[]).await;
    let policy = bench.get(PATH).await.json();
    let with = |key: &str, value: Value| {
        let mut policy = policy.clone();
        policy[key] = value;
        policy
    };
    let told = async |policy: Value, reason: &str| {
        let answer = bench.set_policy("\"1\"", &policy, reason).await;
        answer.told()
    };
    assert_snapshot!(told(with("verify_after_m", json!(0)), "x").await, @"400 value_refused [policy.verify_after_m]: policy.verify_after_m: got 0, expected 1 to 100000");
    let tolerance =
        json!({"steering_offset_deg": 0.1, "lidar_yaw_deg": -1, "lidar_position_mm": 10});
    assert_snapshot!(told(with("verify_within", tolerance), "x").await, @"400 value_refused [policy.verify_within.lidar_yaw_deg]: policy.verify_within.lidar_yaw_deg: got -1, expected more than 0 and at most 180");
    assert_snapshot!(told(policy.clone(), " ").await, @"400 value_refused [reason]: reason: got nothing, expected why, in words");
    assert_snapshot!(bench.send_body("PUT", PATH, &[], json!({"policy": policy, "reason": "x"}).to_string()).await.told(), @"428 precondition_required [If-Match]: send the ETag of GET as If-Match, or If-None-Match: * for a new one");
    let unknown = told(with("tolerance", json!(1)), "x").await;
    assert!(
        unknown.starts_with("422 body_refused [policy.tolerance]"),
        "{unknown}"
    );
    let stale = bench.set_policy("\"7\"", &policy, "x").await;
    assert_eq!(stale.status.as_u16(), 412);
    assert_eq!(bench.get(PATH).await.header("etag"), "\"1\"");
}
