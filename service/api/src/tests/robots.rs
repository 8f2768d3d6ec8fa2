//! Routes of `/robots` and below.

use std::time::Duration;

use axum::body::Body;
use fleetcal_model::{Stream, WallTime};
use fleetcal_proto::encoding::Encoding;
use fleetcal_proto::estimate::EstimateDocument;
use insta::assert_snapshot;
use serde_json::json;

use super::*;

const CONFIG: &str = r#"{"model": "tricycle", "wheelbase_m": 1.55, "wheel_odometry": "raw"}"#;

/// Estimate of second `second` after [`NOW_NS`].
fn estimate(name: &str, second: i64, offset_rad: f64) -> EstimateDocument {
    let parameter = |value: f64, unit: &str, status: &str| json!({"value": value, "sigma": 0.001, "unit": unit, "status": status, "needs": null});
    serde_json::from_value(json!({
        "robot": name,
        "stamp_ns": NOW_NS + second * 1_000_000_000,
        "time_s": second,
        "distance_m": 1.0,
        "parameters": {
            "steering_offset": parameter(offset_rad, "rad", "converged"),
            "lidar_x": parameter(0.4, "m", "learning"),
            "lidar_y": parameter(0.0, "m", "learning"),
            "lidar_yaw": parameter(0.0, "rad", "learning"),
            "speed_scale": parameter(1.0, "1", "learning"),
            "wheelbase": parameter(1.2, "m", "fixed"),
            "time_offset": parameter(0.0, "s", "learning"),
            "steering_gain": parameter(1.0, "1", "fixed"),
        },
        "consistency": {"nis_mean": 3.0, "nis_dof": 3.0, "samples": 5},
        "counts": {"drive_samples": 1, "scans": 1, "scans_rejected": 0, "late": 0, "duplicates": 0},
    }))
    .unwrap()
}

#[tokio::test]
async fn the_list_is_paged_sorted_and_filtered() {
    let bench = bench(&["c", "a", "b"]).await;
    let list = bench.get("/api/v1/robots").await.json();
    let ids = |page: &Value| -> Vec<String> {
        let items = page["items"].as_array().unwrap();
        items
            .iter()
            .map(|item| item["id"].as_str().unwrap().to_owned())
            .collect()
    };
    assert_eq!(ids(&list), ["a", "b", "c"]);
    assert_eq!(list.get("next"), None);
    assert_eq!(list["counts"].as_object().unwrap().len(), 6);
    let first = bench
        .get("/api/v1/robots?sort=severity&limit=2")
        .await
        .json();
    assert_eq!(ids(&first), ["a", "b"]);
    let next = first["next"].as_str().unwrap();
    let rest = bench
        .get(&format!("/api/v1/robots?sort=severity&cursor={next}"))
        .await
        .json();
    assert_eq!((ids(&rest), rest.get("next")), (vec!["c".to_owned()], None));
    let state = list["items"][0]["state"].as_str().unwrap().to_owned();
    assert_eq!(
        ids(&bench
            .get(&format!("/api/v1/robots?state={state}"))
            .await
            .json())
        .len(),
        3
    );
    assert!(ids(&bench.get("/api/v1/robots?state=failed").await.json()).is_empty());
}

#[tokio::test]
async fn a_robot_that_has_sent_something_is_told_what_to_drive_next() {
    let bench = bench(&["a"]).await;
    let path = "/api/v1/robots/a/manoeuvres";
    let names = async |query: &str| -> Vec<String> {
        let found = bench.get(&format!("{path}{query}")).await.json();
        let items = found["items"].as_array().unwrap();
        let name = |item: &Value| item["name"].as_str().unwrap().to_owned();
        items.iter().map(name).collect()
    };
    assert!(names("").await.is_empty());
    let drive = json!({
        "header": {"stamp": {"sec": 1_760_000_000, "nanosec": 0}, "frame_id": ""},
        "drive": {
            "steering_angle": 0.1, "steering_angle_velocity": 0.0,
            "speed": 1.0, "acceleration": 0.0, "jerk": 0.0,
        },
    });
    let payload = drive.to_string().into_bytes();
    let length = payload.len();
    let (a, form) = (robot("a"), Encoding::Json);
    bench
        .fleet
        .receive(&a, Stream::WheelOdometry, form, length, || payload);
    while bench.fleet.robot(&a).unwrap().counters.processed == 0 {
        tokio::time::sleep(Duration::from_millis(1)).await;
    }
    let all = names("").await;
    assert!(all.len() > 5, "{all:?}");
    let found = bench.get(path).await.json();
    // What the page draws and fills its bars by: of each manoeuvre path and time, and the limits.
    for item in found["items"].as_array().unwrap() {
        let distance_m = item["distance_m"].as_f64().unwrap();
        let points = item["path_m"].as_array().unwrap().len();
        assert!(points as f64 > 2.0 * distance_m, "{item}");
        assert!(
            item["duration_s"].as_f64().unwrap() > 0.5 * distance_m,
            "{item}"
        );
    }
    assert_eq!(found["sigma_limits"]["lidar_x"], json!(0.005));
    // A corridor has no room for circles.
    let corridor = names("?length_m=1.5&width_m=30").await;
    assert!(!corridor.is_empty() && corridor.len() < all.len());
    assert!(corridor.iter().all(|name| all.contains(name)));
    let told = async |query: &str| bench.get(&format!("{path}{query}")).await.told();
    assert_snapshot!(told("?length_m=0&width_m=3").await, @r#"400 value_refused [length_m]: length_m: got "0", expected both sides of the floor, each more than 0 and at most 10000 m"#);
    assert_snapshot!(told("?length_m=3").await, @r#"400 value_refused [width_m]: width_m: got "nothing", expected both sides of the floor, each more than 0 and at most 10000 m"#);
    assert_snapshot!(told("?floor=3").await, @"400 query_refused [floor]: the query: unknown field `floor`, expected `length_m` or `width_m`");
}

/// Sends a pose of the LiDAR and a drive sample, `step` steps of 20 ms after the begin, on a
/// straight path.
pub(super) fn straight_on(bench: &Bench, step: u32) {
    let stamp = json!({"sec": 1_760_000_000 + step / 50, "nanosec": step % 50 * 20_000_000});
    let header = json!({"stamp": stamp, "frame_id": "odom"});
    let drive = json!({
        "header": header,
        "drive": {
            "steering_angle": 0.0, "steering_angle_velocity": 0.0,
            "speed": 1.0, "acceleration": 0.0, "jerk": 0.0,
        },
    });
    let zero = json!({"x": 0.0, "y": 0.0, "z": 0.0});
    let position = json!({"x": f64::from(step) * 0.02, "y": 0.0, "z": 0.0});
    let orientation = json!({"x": 0.0, "y": 0.0, "z": 0.0, "w": 1.0});
    let pose = json!({
        "header": header,
        "child_frame_id": "lidar",
        "pose": {"pose": {"position": position, "orientation": orientation}, "covariance": vec![0.0; 36]},
        "twist": {"twist": {"linear": zero, "angular": zero}, "covariance": vec![0.0; 36]},
    });
    let sent = [
        (Stream::WheelOdometry, drive),
        (Stream::LidarOdometry, pose),
    ];
    for (stream, message) in sent {
        let payload = message.to_string().into_bytes();
        let length = payload.len();
        bench
            .fleet
            .receive(&robot("a"), stream, Encoding::Json, length, || payload);
    }
}

#[tokio::test]
async fn a_top_view_is_drawn_up_for_all_who_ask() {
    let bench = bench(&["a"]).await;
    let path = "/api/v1/robots/a/top-view";
    assert_eq!(bench.get(path).await.body, "null");
    for step in 0..100 {
        straight_on(&bench, step);
        let taken = || bench.fleet.robot(&robot("a")).unwrap().counters;
        while taken().processed < u64::from(2 * (step + 1)) {
            assert_eq!(taken().refused, 0, "{:?}", taken().last_refusal);
            tokio::time::sleep(Duration::from_millis(1)).await;
        }
    }
    // Half a second waits in the merger; nothing can be guessed from a straight way.
    let view = bench.get(path).await.json();
    assert!(view["lidar"]["x_m"].as_f64().unwrap() > 1.2, "{view}");
    assert_eq!(
        view["stamp_ns"].as_i64().unwrap() / 1_000_000_000,
        1_760_000_001
    );
    assert_eq!(view["lidar_in_base"], Value::Null);
    for empty in ["returns_m", "surfaces_m", "trajectory"] {
        assert_eq!(view[empty], json!([]), "{empty}");
    }
    // Everybody at once gets the same, and nobody is left waiting.
    let all = futures::future::join_all((0..20).map(|_| bench.get(path))).await;
    assert!(all.iter().all(|answer| answer.json() == view));
    assert_snapshot!(bench.get("/api/v1/robots/b/top-view").await.told(), @"404 robot_unknown: no robot b is known");
    assert_snapshot!(bench.get(&format!("{path}?x=1")).await.told(), @"400 query_refused [x]: the query: unknown field `x`, there are no fields");
    bench.fleet.stop().await;
    assert_eq!(bench.fleet.top_view(&robot("a")).await, Ok(None));
}

#[tokio::test]
async fn the_list_refuses_by_name() {
    let bench = bench(&[]).await;
    let told = async |query: &str| bench.get(&format!("/api/v1/robots?{query}")).await.told();
    assert_snapshot!(told("stat=failed").await, @"400 query_refused [stat]: the query: unknown field `stat`, expected one of `q`, `state`, `standing`, `connection`, `sort`, `limit`, `cursor`, `format`");
    assert_snapshot!(told("state=broken").await, @r#"400 value_refused [state]: state: got "broken", expected one of unregistered, no_data, failed, changed, learning, calibrated"#);
    assert_snapshot!(told("sort=name").await, @r#"400 value_refused [sort]: sort: got "name", expected one of id, severity, deviation, age, site, type, model, with - before it for the opposite"#);
    assert_snapshot!(told("limit=0").await, @r#"400 value_refused [limit]: limit: got "0", expected a whole number from 1 to 1000"#);
    assert_snapshot!(told("limit=ten").await, @r#"400 value_refused [limit]: limit: got "ten", expected a whole number from 1 to 1000"#);
    assert_snapshot!(told("cursor=x").await, @r#"400 value_refused [cursor]: cursor: got "x", expected `next` of the page before"#);
}

#[tokio::test]
async fn a_robot_is_registered_and_changed_with_conditions() {
    let bench = bench(&[]).await;
    let put = async |headers: &[(&str, &str)]| {
        bench
            .send_body("PUT", "/api/v1/robots/agv_1", headers, CONFIG)
            .await
    };
    assert_snapshot!(bench.get("/api/v1/robots/agv_1").await.told(), @"404 robot_unknown: no robot agv_1 is known");
    assert_snapshot!(put(&[]).await.told(), @"428 precondition_required [If-Match]: send the ETag of GET as If-Match, or If-None-Match: * for a new one");
    let created = put(&[("if-none-match", "*")]).await;
    assert_eq!(
        (created.status.as_u16(), created.header("etag")),
        (201, "\"1\"")
    );
    assert_eq!(created.json()["config"]["wheelbase_m"], 1.55);
    assert_snapshot!(put(&[("if-none-match", "*")]).await.told(), @"412 version_conflict: robot agv_1 is at version 1");
    let found = bench.get("/api/v1/robots/agv_1").await;
    assert_eq!(
        (found.status.as_u16(), found.header("etag")),
        (200, "\"1\"")
    );
    assert_eq!(found.json()["configured"], "2026-01-01T00:00:00Z");
    let changed = put(&[("if-match", "\"1\"")]).await;
    assert_eq!(
        (changed.status.as_u16(), changed.header("etag")),
        (200, "\"2\"")
    );
    assert_snapshot!(put(&[("if-match", "\"1\"")]).await.told(), @"412 version_conflict: robot agv_1 is at version 2");
    assert_snapshot!(put(&[("if-match", "*")]).await.told(), @r#"400 value_refused [If-Match]: If-Match: got "*", expected the ETag of GET, such as "3""#);
    let config = bench.fleet.robot(&robot("agv_1")).unwrap().config;
    assert_eq!(config, Some(serde_json::from_str(CONFIG).unwrap()));
}

#[tokio::test]
async fn an_answer_says_whether_the_estimate_begins_again() {
    let bench = bench(&[]).await;
    let put = async |version: &str, body: &str| {
        let condition = match version {
            "*" => "if-none-match",
            _ => "if-match",
        };
        let headers = [(condition, version)];
        let path = "/api/v1/robots/a";
        bench
            .send_body("PUT", path, &headers, body.to_owned())
            .await
            .json()
    };
    let with = |more: &str| CONFIG.replace('}', &format!(", {more}}}"));
    let key = "estimate_begins_again_by";
    assert_eq!(put("*", CONFIG).await.get(key), None);
    let axle = r#""rear_axle_in_base_link": {"x_m": -0.4, "y_m": 0, "yaw_rad": 0}"#;
    assert_eq!(put("\"1\"", &with(axle)).await.get(key), None);
    let topic = r#""streams": {"scan": {"topic": "front/scan"}}"#;
    assert_eq!(put("\"2\"", &with(topic)).await.get(key), None);
    let longer = CONFIG.replace("1.55", "1.6").replace("raw", "compensated");
    let keys = json!(["wheelbase_m", "wheel_odometry"]);
    assert_eq!(put("\"3\"", &longer).await[key], keys);
    assert_eq!(bench.get("/api/v1/robots/a").await.json().get(key), None);
}

#[tokio::test]
async fn former_names_of_wheel_odometry_are_accepted_and_answered_by_todays() {
    let bench = bench(&[]).await;
    let put = async |version: &str, body: &str| {
        let condition = if version == "*" {
            "if-none-match"
        } else {
            "if-match"
        };
        let path = "/api/v1/robots/a";
        let answer = bench
            .send_body("PUT", path, &[(condition, version)], body.to_owned())
            .await;
        answer.json()["config"].clone()
    };
    let config = |more: &str| format!(r#"{{"model": "bicycle", "wheelbase_m": 1.2{more}}}"#);
    let former = r#", "drive": "compensated", "streams": {"drive": {"topic": "feedback"}}"#;
    let config_a = put("*", &config(former)).await;
    assert_eq!(config_a["wheel_odometry"], "compensated", "{config_a}");
    let streams = json!({"wheel_odometry": {"topic": "feedback"}});
    assert_eq!(config_a["streams"], streams, "{config_a}");

    // The topic that a migrated robot is on stays its own until somebody names one.
    let migrated = json!({"former_topic": true});
    let with_streams = |streams: &Value| config(&format!(r#", "streams": {streams}"#));
    let config_a = put("\"1\"", &with_streams(&migrated)).await;
    assert_eq!(config_a["streams"], migrated, "{config_a}");
    let config_a = put("\"2\"", &config("")).await;
    assert_eq!(config_a["streams"], migrated, "{config_a}");
    let config_a = put("\"3\"", &with_streams(&streams)).await;
    assert_eq!(config_a["streams"], streams, "{config_a}");
}

#[tokio::test]
async fn of_two_who_change_the_same_version_one_is_told() {
    let bench = bench(&["a"]).await;
    let put = || bench.send_body("PUT", "/api/v1/robots/a", &[("if-match", "\"1\"")], CONFIG);
    let (one, other) = tokio::join!(put(), put());
    let mut statuses = [one.status.as_u16(), other.status.as_u16()];
    statuses.sort_unstable();
    assert_eq!(statuses, [200, 412]);
}

#[tokio::test]
async fn a_configuration_is_refused_by_field() {
    let bench = bench(&[]).await;
    let told = async |body: &str| {
        let headers = [("if-none-match", "*")];
        bench
            .send_body("PUT", "/api/v1/robots/a", &headers, body.to_owned())
            .await
            .told()
    };
    assert_snapshot!(told("{").await, @"400 body_refused: the body: EOF while parsing an object at line 1 column 1");
    assert_snapshot!(told("[]").await, @"422 body_refused: the body: invalid length 0, expected struct RobotConfig with 13 elements at line 1 column 2");
    assert_snapshot!(told(r#"{"model": "bicycle"}"#).await, @"422 body_refused: the body: missing field `wheelbase_m` at line 1 column 20");
    assert_snapshot!(told(r#"{"model": "bicycle", "wheelbase_m": -1}"#).await, @"422 body_refused [wheelbase_m]: the body: wheelbase_m: got -1, expected more than 0 and at most 30 m at line 1 column 39");
    assert_snapshot!(told(r#"{"model": "hovercraft", "wheelbase_m": 1}"#).await, @"422 body_refused [model]: the body: unknown variant `hovercraft`, expected one of `bicycle`, `tricycle`, `rear_steered` at line 1 column 22");
    assert_snapshot!(told(r#"{"model": "bicycle", "wheelbase_m": 1, "colour": "red"}"#).await, @"422 body_refused [colour]: the body: unknown field `colour`, expected one of `model`, `wheelbase_m`, `speed_measured_at`, `nominal`, `nominal_extrinsics`, `drive`, `wheel_odometry`, `rear_axle_in_base_link`, `scan_type`, `point_cloud`, `site`, `vehicle_type`, `tags`, `streams`, `estimator` at line 1 column 47");
    assert_eq!(bench.store.load_robot(&robot("a")).await.unwrap(), None);
}

#[tokio::test]
async fn bodies_are_json_and_limited() {
    let bench = bench(&[]).await;
    let put = async |content_type: &str, body: Body| {
        let headers = [("if-none-match", "*"), ("content-type", content_type)];
        bench
            .send_body("PUT", "/api/v1/robots/a", &headers, body)
            .await
            .told()
    };
    assert_snapshot!(put("text/plain", CONFIG.into()).await, @"415 not_json [Content-Type]: the body must be sent as Content-Type: application/json");
    assert_snapshot!(put("application/json", vec![b' '; 70_000].into()).await, @"413 body_refused: the body is larger than 65536 bytes");
    assert_snapshot!(put("application/json", vec![0xff, 0xfe, 0].into()).await, @"400 body_refused: the body: expected value at line 1 column 1");
    assert_eq!(
        put("application/json; charset=utf-8", CONFIG.into()).await,
        "201"
    );
}

#[tokio::test]
async fn ids_that_cannot_be_are_refused() {
    let bench = bench(&[]).await;
    let told = async |id: &str| bench.get(&format!("/api/v1/robots/{id}")).await.told();
    assert_snapshot!(told("a*").await, @"400 value_refused [id]: robot id \"a*\" contains '*', expected A-Z, a-z, 0-9, _ and -");
    assert_snapshot!(told("a%2Fb").await, @r#"400 value_refused [id]: robot id "a/b" contains '/', expected A-Z, a-z, 0-9, _ and -"#);
    assert_snapshot!(told("%ff").await, @"400 value_refused [id]: Invalid URL: Invalid UTF-8 in `id`");
    assert_snapshot!(told("..").await, @r#"400 value_refused [id]: robot id ".." contains '.', expected A-Z, a-z, 0-9, _ and -"#);
}

#[tokio::test]
async fn an_estimate_that_is_not_there_yet_is_a_problem() {
    let bench = bench(&["a"]).await;
    let told = async |path: &str| bench.get(&format!("/api/v1/robots/{path}")).await.told();
    assert_snapshot!(told("a/estimate").await, @"404 estimate_missing: robot a has no estimate yet");
    assert_snapshot!(told("b/estimate").await, @"404 robot_unknown: no robot b is known");
    assert_snapshot!(told("a/estimate?x=1").await, @"400 query_refused [x]: the query: unknown field `x`, there are no fields");
}

#[tokio::test]
async fn history_comes_in_columns() {
    let bench = bench(&["a"]).await;
    for second in 0..10 {
        bench.store.record_history(
            &estimate("a", second, second as f64 / 100.0),
            WallTime(NOW_NS),
        );
    }
    bench.store.flush().await.unwrap();
    let uri = "/api/v1/robots/a/history?parameter=steering_offset,wheelbase\
               &from=2026-01-01T00:00:04Z&to=2026-01-01T00:00:08Z&max_points=2";
    let history = bench.get(uri).await.json();
    assert_eq!(
        history,
        json!({
            "robot": "a",
            "from": "2026-01-01T00:00:04Z",
            "to": "2026-01-01T00:00:08Z",
            "bucket_s": 4,
            "time": ["2026-01-01T00:00:04Z"],
            "count": [4],
            "nis": [3.0],
            "series": [
                {
                    "parameter": "steering_offset", "unit": "rad",
                    "mean": [0.055], "min": [0.04], "max": [0.07], "sigma": [0.001],
                    "status": ["converged"],
                },
                {
                    "parameter": "wheelbase", "unit": "m",
                    "mean": [null], "min": [null], "max": [null], "sigma": [null],
                    "status": ["fixed"],
                },
            ],
        })
    );
    let all = bench.get("/api/v1/robots/a/history").await.json();
    assert_eq!(
        (all["series"].as_array().unwrap().len(), all["to"].as_str()),
        (8, Some("2026-01-01T00:00:10Z"))
    );
}

#[tokio::test]
async fn history_refuses_by_name() {
    let bench = bench(&["a"]).await;
    let told = async |rest: &str| bench.get(&format!("/api/v1/robots/{rest}")).await.told();
    assert_snapshot!(told("b/history").await, @"404 robot_unknown: no robot b is known");
    assert_snapshot!(told("a/history?parameter=colour").await, @r#"400 value_refused [parameter]: parameter: got "colour", expected some of steering_offset, lidar_x, lidar_y, lidar_yaw, speed_scale, wheelbase, time_offset, steering_gain"#);
    assert_snapshot!(told("a/history?parameter=lidar_x,lidar_y,lidar_x").await, @r#"400 value_refused [parameter]: parameter: got "lidar_x", expected each name once"#);
    assert_snapshot!(told("a/history?parameter=").await, @r#"400 value_refused [parameter]: parameter: got "", expected some of steering_offset, lidar_x, lidar_y, lidar_yaw, speed_scale, wheelbase, time_offset, steering_gain"#);
    assert_snapshot!(told("a/history?from=yesterday").await, @r#"400 value_refused [from]: from: got "yesterday", expected RFC 3339, such as 2026-01-31T12:00:00Z"#);
    assert_snapshot!(told("a/history?from=2026-01-02T00:00:00Z&to=2026-01-01T00:00:00Z").await, @r#"400 value_refused [from]: from: got "2026-01-02T00:00:00Z", expected a time before `to`, 2026-01-01T00:00:00Z"#);
    assert_snapshot!(told("a/history?max_points=1").await, @r#"400 value_refused [max_points]: max_points: got "1", expected a whole number from 2 to 5000"#);
    assert_snapshot!(told("a/history?points=1").await, @"400 query_refused [points]: the query: unknown field `points`, expected one of `parameter`, `from`, `to`, `max_points`, `format`");
    // A span of thousands of years is read, not run through.
    assert_eq!(
        told("a/history?from=0001-01-01T00:00:00Z&to=9999-01-01T00:00:00Z").await,
        "200"
    );
}

#[tokio::test]
async fn who_registered_and_configured_a_robot_stands_in_the_audit() {
    let bench = bench(&[]).await;
    let uri = "/api/v1/robots/a";
    let put = async |header: (&str, &str), body: &str| {
        let headers = [header];
        let answer = bench.send_body("PUT", uri, &headers, body.to_owned());
        answer.await.status.as_u16()
    };
    assert_eq!(put(("if-none-match", "*"), CONFIG).await, 201);
    let changed = CONFIG.replace("1.55", "1.6");
    assert_eq!(put(("if-match", "\"1\""), &changed).await, 200);
    assert_eq!(put(("if-match", "\"1\""), CONFIG).await, 412);
    let audit = bench.get("/api/v1/audit?action=robot.").await.json();
    let rows = audit["items"].as_array().unwrap();
    let told: Vec<_> = rows
        .iter()
        .map(|row| {
            assert_eq!(
                (&row["actor"], &row["robot"]),
                (&json!("tester"), &json!("a"))
            );
            let wheelbase = |side: &str| row[side]["wheelbase_m"].as_f64();
            (
                row["action"].as_str().unwrap(),
                wheelbase("before"),
                wheelbase("after"),
            )
        })
        .collect();
    assert_eq!(
        told,
        [
            ("robot.configure", Some(1.55), Some(1.6)),
            ("robot.register", None, Some(1.55)),
        ]
    );
}
