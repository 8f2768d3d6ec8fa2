//! Views of the fleet: groups of robots, queries, orders, and the list as a file.

use fleetcal_model::Stream;
use fleetcal_proto::Encoding;
use insta::assert_snapshot;

use super::*;

const FLEET: [(&str, &str); 4] = [
    (
        "agv_1",
        r#"{"model": "tricycle", "wheelbase_m": 1.5, "site": "Hamburg", "vehicle_type": "EKX 516",
            "tags": ["night shift", "leased"]}"#,
    ),
    (
        "agv_2",
        r#"{"model": "bicycle", "wheelbase_m": 1.2, "site": "Hamburg"}"#,
    ),
    (
        "tug_1",
        r#"{"model": "tricycle", "wheelbase_m": 1.5, "site": "Munich, west"}"#,
    ),
    ("tug_2", r#"{"model": "bicycle", "wheelbase_m": 1.2}"#),
];

async fn registered() -> Bench {
    let bench = bench(&[]).await;
    for (id, config) in FLEET {
        let uri = format!("/api/v1/robots/{id}");
        let headers = [("if-none-match", "*")];
        let made = bench.send_body("PUT", &uri, &headers, config).await;
        assert_eq!(made.told(), "201");
    }
    bench
}

fn encoded(text: &str) -> String {
    let keep = |byte: u8| byte.is_ascii_alphanumeric();
    let encode = |byte: u8| match byte {
        byte if keep(byte) => char::from(byte).to_string(),
        byte => format!("%{byte:02X}"),
    };
    text.bytes().map(encode).collect()
}

impl Bench {
    /// Ids of a view, in its order: the same in the list, in the file and alone.
    async fn view(&self, query: &str, sort: &str) -> Vec<String> {
        let view = format!("q={}&sort={sort}", encoded(query));
        let own = self.get(&format!("/api/v1/views/robots?{view}")).await;
        let own: Vec<String> = serde_json::from_value(own.json()["robots"].clone()).unwrap();
        let list = self.get(&format!("/api/v1/robots?{view}")).await.json();
        let items = list["items"].as_array().unwrap().iter();
        let listed: Vec<_> = items.map(|item| item["id"].as_str().unwrap()).collect();
        assert_eq!(listed, own);
        let file = self.get(&format!("/api/v1/robots?{view}&format=csv")).await;
        let lines = file.body.lines().skip(1);
        let filed: Vec<_> = lines.map(|line| line.split(',').next().unwrap()).collect();
        assert_eq!(filed, own);
        own
    }
}

#[tokio::test]
async fn a_view_is_the_same_in_the_list_in_a_file_and_by_its_ids() {
    let bench = registered().await;
    for (query, sort, ids) in [
        ("", "id", "agv_1 agv_2 tug_1 tug_2"),
        ("agv", "-id", "agv_2 agv_1"),
        ("site:hamburg model:tricycle", "id", "agv_1"),
        (
            "site:hamburg,\"munich, west\"",
            "-site",
            "tug_1 agv_1 agv_2",
        ),
        ("-site:hamburg", "site", "tug_1 tug_2"),
        ("tag:\"Night shift\"", "id", "agv_1"),
        ("no:site", "-deviation", "tug_2"),
        (
            "standing:no_data connection:silent",
            "severity",
            "agv_1 agv_2 tug_1 tug_2",
        ),
        ("deviation>1", "id", ""),
    ] {
        assert_eq!(bench.view(query, sort).await.join(" "), ids, "{query}");
    }
    let list = bench
        .get("/api/v1/robots?q=site:hamburg&standing=drift")
        .await;
    let list = list.json();
    assert_eq!(list["standings"]["no_data"], 2, "of the query alone");
    assert_eq!(list["items"], serde_json::json!([]));
    let first = bench.get("/api/v1/robots?sort=-site&limit=3").await.json();
    let next = first["next"].as_str().unwrap();
    let rest = format!("/api/v1/robots?sort=-site&cursor={next}");
    let rest = bench.get(&rest).await.json();
    assert_eq!(rest["items"][0]["id"], "tug_2");
}

#[tokio::test]
async fn the_groups_of_a_robot_stand_in_its_documents() {
    let bench = registered().await;
    let robot = bench.get("/api/v1/robots/agv_1").await.json();
    assert_eq!(robot["site"], "Hamburg");
    assert_eq!(robot["vehicle_type"], "EKX 516");
    assert_eq!(robot["tags"], serde_json::json!(["leased", "night shift"]));
    assert_eq!(robot["deviation"], Value::Null);
    let headers = [("if-match", "\"1\"")];
    let moved = FLEET[0].1.replace("Hamburg", "Bremen");
    let moved = bench
        .send_body("PUT", "/api/v1/robots/agv_1", &headers, moved)
        .await
        .json();
    assert_eq!(moved["site"], "Bremen");
    assert_eq!(moved.get("estimate_begins_again_by"), None);
    let file = bench.get("/api/v1/robots?q=agv_1&format=csv").await;
    assert_eq!(
        file.header("content-disposition"),
        "attachment; filename=\"robots.csv\""
    );
    assert_snapshot!(file.body.replace("\r\n", "\n").trim(), @r#"
    id,site,type,tags,model,state,standing,connection,in_maintenance,last_seen,deviation_tolerances,deviation_parameter,steering_offset_rad,lidar_x_m,lidar_y_m,lidar_yaw_rad
    agv_1,Bremen,EKX 516,"leased; night shift",tricycle,no_data,no_data,silent,false,,,,,,,
    "#);
}

#[tokio::test]
async fn statistics_count_the_robots_of_each_group_of_a_view() {
    let bench = registered().await;
    let counts = async |query: &str| {
        let answer = bench
            .get(&format!("/api/v1/fleet/statistics?{query}"))
            .await;
        let groups = answer.json()["groups"].as_array().unwrap().clone();
        let of =
            |group: &Value| format!("{} {}", group["group"].as_str().unwrap(), group["robots"]);
        groups.iter().map(of).collect::<Vec<_>>().join(", ")
    };
    assert_eq!(counts("").await, "EKX 516 1, bicycle 2, tricycle 1");
    assert_eq!(counts("by=site").await, "Hamburg 2, Munich, west 1");
    assert_eq!(
        counts("by=tag&q=site:hamburg").await,
        "leased 1, night shift 1"
    );
    let all = bench
        .get("/api/v1/fleet/statistics?q=model:tricycle")
        .await
        .json();
    let sums = (&all["q"], &all["by"], &all["common_causes"], &all["unlike"]);
    let none = serde_json::json!([]);
    assert_eq!(
        sums,
        (&"model:tricycle".into(), &"type".into(), &none, &none)
    );
    let refused = bench.get("/api/v1/fleet/statistics?by=colour").await;
    assert_snapshot!(refused.told(), @r#"400 value_refused [by]: by: got "colour", expected site, type or tag"#);
}

#[tokio::test]
async fn a_view_is_refused_by_the_part_that_is_wrong() {
    let bench = bench(&[]).await;
    let told = async |query: &str| {
        let list = bench.get(&format!("/api/v1/robots?{query}")).await.told();
        let view = bench.get(&format!("/api/v1/views/robots?{query}")).await;
        assert_eq!(view.told(), list);
        list
    };
    assert_snapshot!(told("q=site:a%20modle:x").await, @r#"400 value_refused [q]: q: got "modle" at character 8, expected one of id:, site:, type:, tag:, model:, state:, standing:, connection:, no:, deviation>, age>, or a robot's name"#);
    assert_snapshot!(told("q=age%3E10").await, @r#"400 value_refused [q]: q: got "10" at character 5, expected a time, such as 30s, 10m, 8h or 7d"#);
    assert_snapshot!(told("sort=worst").await, @r#"400 value_refused [sort]: sort: got "worst", expected one of id, severity, deviation, age, site, type, model, with - before it for the opposite"#);
    let uri = "/api/v1/robots/a";
    let body = r#"{"model": "bicycle", "wheelbase_m": 1, "site": " "}"#;
    let refused = bench
        .send_body("PUT", uri, &[("if-none-match", "*")], body)
        .await;
    assert_snapshot!(refused.told(), @r#"422 body_refused [site]: the body: got " ", expected 1 to 64 characters without control characters and without spaces around them at line 1 column 51"#);
}

#[tokio::test]
async fn a_robot_in_maintenance_is_found_whether_it_sends_or_not() {
    let bench = bench(&["a", "b"]).await;
    bench.maintain("a", 8).await;
    let found = bench.view("connection:maintenance", "id").await;
    assert_eq!(found, ["a"]);
    bench
        .fleet
        .receive(&robot("a"), Stream::Event, Encoding::Cdr, 1, || vec![0]);
    let page = bench.get("/api/v1/robots?connection=maintenance").await;
    let page = page.json();
    assert_eq!(page["items"][0]["connection"]["state"], "online");
    assert_eq!(
        page["items"][0]["connection"]["maintenance"]["by"],
        "tester"
    );
    let counts = &page["connections"];
    assert_eq!(
        (&counts["online"], &counts["silent"], &counts["maintenance"]),
        (&1.into(), &1.into(), &1.into())
    );
    assert_eq!(bench.view("connection:maintenance", "id").await, ["a"]);
    assert_eq!(bench.view("connection:silent", "id").await, ["b"]);
}

#[tokio::test]
async fn silence_hides_no_proposal() {
    let bench = bench(&["a", "b"]).await;
    bench.propose_for("b").await;
    let query = "standing:awaiting_approval connection:silent";
    assert_eq!(bench.view(query, "id").await, ["b"]);
    assert_eq!(bench.view("", "severity").await, ["b", "a"]);
}
