//! Routes `/robots/{id}/description`: what a robot says of itself.

use fleetcal_fleet::{ArrivedDescription, DescriptionTopic};
use fleetcal_proto::encoding::Encoding;
use fleetcal_proto::ros::{RosMessage, StringMessage};
use serde_json::json;

use super::*;

const TUGGER: &str = include_str!("../../../../proto/description/tests/urdf/tugger.urdf");
const TRICYCLE: &str = include_str!("../../../../proto/description/tests/urdf/tricycle.urdf");
const ACKERMANN: &str = include_str!("../../../../proto/description/tests/urdf/ackermann.urdf");

/// Publishes a URDF as robot `name` does.
fn publish(bench: &Bench, name: &str, urdf: &str) {
    let data = urdf.to_owned();
    let payload = StringMessage { data }.to_cdr();
    let arrived = ArrivedDescription {
        topic: DescriptionTopic::RobotDescription,
        encoding: Ok(Encoding::Cdr),
        length: payload.len(),
        payload: || payload,
    };
    bench.fleet.take_description(&robot(name), arrived);
}

fn of(name: &str) -> String {
    format!("/api/v1/robots/{name}/description")
}

/// Keys of a description's values.
fn keys(answer: &Value) -> Vec<&str> {
    let values = answer["description"]["values"].as_array().unwrap().iter();
    values.map(|value| value["key"].as_str().unwrap()).collect()
}

/// Keys of the values that the configuration contradicts.
fn contradicted(answer: &Value) -> Vec<&str> {
    let values = answer["description"]["values"].as_array().unwrap().iter();
    let contradicted = values.filter(|value| value["contradicted"] == true);
    contradicted
        .map(|value| value["key"].as_str().unwrap())
        .collect()
}

#[tokio::test]
async fn a_robot_that_describes_itself_is_registered_by_one_request() {
    let bench = bench(&[]).await;
    publish(&bench, "a", TUGGER);
    let described = bench.get(&of("a")).await.json();
    assert_eq!(
        described["description"]["origins"],
        json!(["robot_description"])
    );
    let wanted = [
        "model",
        "speed_measured_at",
        "wheelbase_m",
        "track_m",
        "streams.joints",
        "rear_axle_in_base_link",
        "nominal_extrinsics",
    ];
    assert_eq!(keys(&described), wanted);
    assert_eq!(described["description"]["values"][3]["in_use"], Value::Null);
    assert_eq!(described["proposed"]["model"], "bicycle");
    assert!((described["proposed"]["wheelbase_m"].as_f64().unwrap() - 1.2).abs() < 1e-9);

    let new = [("if-none-match", "*")];
    let made = bench.send("POST", &of("a"), &new).await;
    assert_eq!(made.told(), "201");
    let robot = bench.get("/api/v1/robots/a").await.json();
    assert_eq!(robot["config"], described["proposed"]);
    let audit = bench.get("/api/v1/audit?robot=a").await.json();
    let rows = audit["items"].as_array().unwrap();
    assert_eq!(rows.len(), 1);
    assert_eq!(rows[0]["actor"], "tester");

    // All of it is in use, and a second time is refused: the robot is there.
    let described = bench.get(&of("a")).await.json();
    let values = described["description"]["values"].as_array().unwrap();
    assert!(
        values
            .iter()
            .all(|of| of["used"] == (of["key"] != "track_m"))
    );
    assert_eq!(contradicted(&described), Vec::<&str>::new());
    assert_eq!(bench.send("POST", &of("a"), &new).await.status, 412);
}

#[tokio::test]
async fn what_contradicts_the_configuration_is_named_and_replaced_on_request_alone() {
    let bench = bench(&["a"]).await;
    let config = r#"{"model": "tricycle", "wheelbase_m": 1.55, "wheel_odometry": "raw",
        "rear_axle_in_base_link": {"x_m": -0.401, "y_m": 0.0, "yaw_rad": 0.0}}"#;
    let tag = [("if-match", "\"1\"")];
    let put = bench.send_body("PUT", "/api/v1/robots/a", &tag, config);
    assert_eq!(put.await.told(), "200");
    publish(&bench, "a", TUGGER);
    let described = bench.get(&of("a")).await.json();
    let remarks = described["description"]["remarks"].to_string();
    assert!(remarks.contains("model: \\\"tricycle\\\" is used, and the description has"));
    assert!(remarks.contains("wheelbase_m: 1.55 is used, and the description has 1.2"));
    let apart = ["model", "speed_measured_at", "wheelbase_m"];
    assert_eq!(contradicted(&described), apart);
    assert_eq!(described["description"]["values"][2]["in_use"], 1.55);
    let robot = bench.get("/api/v1/robots/a").await;
    assert_eq!(robot.json()["config"]["wheelbase_m"], 1.55);

    assert_eq!(bench.send("POST", &of("a"), &[]).await.status, 428);
    assert_eq!(bench.send("POST", &of("a"), &tag).await.status, 412);
    let tag = robot.header("etag").to_owned();
    let taken = bench.send("POST", &of("a"), &[("if-match", &tag)]).await;
    assert_eq!(taken.told(), "200");
    let config = &bench.get("/api/v1/robots/a").await.json()["config"];
    assert_eq!(config["model"], "bicycle");
    assert_eq!(config["wheelbase_m"], 1.2);
    // What agrees, and what no description has, stays.
    assert_eq!(config["rear_axle_in_base_link"]["x_m"], -0.401);
    assert_eq!(config["wheel_odometry"], "raw");
    let described = bench.get(&of("a")).await.json();
    assert_eq!(contradicted(&described), Vec::<&str>::new());
}

#[tokio::test]
async fn viewers_read_and_operators_confirm() {
    let bench = bench(&[]).await;
    publish(&bench, "a", TUGGER);
    for (name, role, confirmed) in [
        ("viewer", Role::Viewer, 403),
        ("operator", Role::Operator, 201),
    ] {
        let token = token(&bench.store, name, grant(role), None).await;
        let bearer = format!("Bearer {token}");
        let by = [("authorization", bearer.as_str()), ("if-none-match", "*")];
        assert_eq!(bench.send("GET", &of("a"), &by[..1]).await.status, 200);
        assert_eq!(bench.send("POST", &of("a"), &by).await.status, confirmed);
    }
    let nobody = [("authorization", "")];
    assert_eq!(bench.send("GET", &of("a"), &nobody).await.status, 401);
}

#[tokio::test]
async fn garbage_is_refused_with_its_reason_and_disturbs_nothing() {
    let bench = bench(&["a"]).await;
    let before = bench.get("/api/v1/robots/a").await.json()["config"].clone();
    let new = [("if-none-match", "*")];
    let silent = bench.get(&of("a")).await.json();
    assert_eq!(silent["description"]["origins"], json!([]));
    let told = bench.send("POST", &of("a"), &[("if-match", "\"1\"")]).await;
    assert_eq!(
        told.told(),
        "400 value_refused [description]: description: got \"nothing\", expected one with model \
         and wheelbase_m"
    );
    assert_eq!(bench.get(&of("nobody")).await.status, 404);

    let bomb = "<!DOCTYPE a [<!ENTITY b \"bb\"><!ENTITY c \"&b;&b;&b;\">]><robot name=\"&c;\"/>";
    let unsteered = TUGGER.replace(
        "name=\"steer_joint\" type=\"revolute\"",
        "name=\"steer_joint\" type=\"fixed\"",
    );
    let large = "x".repeat(10_000_000);
    for (name, urdf, wanted) in [
        ("a", large.as_str(), "expected 1048576 at most"),
        ("b", bomb, "robot_description: got no XML"),
        ("c", "wheelbase: 1.2", "robot_description: got no XML"),
        ("d", "<robot name=\"d\"/>", "model, "),
        ("e", unsteered.as_str(), "wheels of several axles"),
    ] {
        publish(&bench, name, urdf);
        let answer = bench.get(&of(name)).await;
        assert_eq!(answer.told(), "200");
        assert!(answer.body.contains(wanted), "{name}: {}", answer.body);
        if name != "a" {
            assert_eq!(answer.json()["proposed"], Value::Null);
            let told = bench.send("POST", &of(name), &new).await.told();
            assert!(
                told.starts_with("400 value_refused [description]"),
                "{told}"
            );
        }
    }
    let after = bench.get("/api/v1/robots/a").await.json()["config"].clone();
    assert_eq!(before, after);
}

#[tokio::test]
async fn layouts_of_public_robots_are_proposed() {
    let bench = bench(&[]).await;
    publish(&bench, "tricycle", TRICYCLE);
    let described = bench.get(&of("tricycle")).await.json();
    assert_eq!(described["proposed"]["model"], "tricycle");
    let missing = described["description"]["missing"].to_string();
    assert!(missing.contains("nominal_extrinsics: got "), "{missing}");

    publish(&bench, "ackermann", ACKERMANN);
    let described = bench.get(&of("ackermann")).await.json();
    assert_eq!(described["proposed"]["model"], "bicycle");
    let missing = described["description"]["missing"].to_string();
    assert!(
        missing.contains("nominal_extrinsics: got 2 frames"),
        "{missing}"
    );
    let chosen = format!("{}?scan_frame=nowhere", of("ackermann"));
    let missing = bench.get(&chosen).await.json()["description"]["missing"].to_string();
    assert!(missing.contains("nowhere"), "{missing}");
}
