//! Several instances: the cluster's document, and requests that one forwards to another.

use std::net::SocketAddr;
use std::time::Duration;

use fleetcal_cluster::{
    ClaimId, Duty, DutyOwnership, Epoch, Hearing, Incarnation, InstanceId, Member, Ownership, Seat,
    Snapshot, Takeover, Tenure,
};
use fleetcal_http::InstanceAddresses;
use fleetcal_operations::peers::PeersSetup;
use insta::assert_snapshot;
use tokio::net::TcpListener;

use super::metrics_text::parse;
use super::*;
use crate::serve;

const S: i64 = 1_000_000_000;
const TOP_VIEW: &str = "/api/v1/robots/agv_1/top-view";

fn instance(name: &str) -> InstanceId {
    InstanceId::parse(name).unwrap()
}

fn seat(name: &str) -> Seat {
    Seat {
        instance: instance(name),
        incarnation: Incarnation(1),
    }
}

fn member(name: &str) -> Member {
    Member {
        seat: seat(name),
        lease_left: Duration::from_millis(4_500),
        is_ended: false,
        capacity: 1,
        draining: false,
        linked: true,
        hearing: Hearing::default(),
        url: format!("https://{name}.example.com"),
        program: "1.2.3".to_owned(),
        checkpoint_format: 2,
        config_sha256: vec![1],
        clock_ahead_ns: 0,
        joined_ns: NOW_NS,
    }
}

fn owned(by: Option<&str>, epoch: i64) -> Ownership {
    Ownership {
        owner: by.map(seat),
        epoch: Epoch(epoch),
        claim: ClaimId(epoch),
        heir: None,
        heir_ready: None,
        free_since: by.is_none().then_some(WallTime(NOW_NS)),
        checkpoint_format: 2,
    }
}

/// Snapshot of instances a and b; each of these robots has an owner or none.
fn snapshot(robots: &[(&str, Option<&str>)]) -> Snapshot {
    let numbered = robots.iter().zip(1..);
    let rows = numbered.map(|((name, by), epoch)| (robot(name), owned(*by, epoch)));
    let alerts = DutyOwnership {
        owner: Some(seat("b")),
        free_since: None,
    };
    Snapshot {
        now: WallTime(NOW_NS),
        members: vec![member("a"), member("b")],
        robots: rows.collect(),
        duties: BTreeMap::from([(Duty::Alerts, alerts)]),
    }
}

/// Membership of the instance `name` in a cluster with these rows.
fn membership(name: &str, snapshot: &Snapshot) -> Membership {
    let membership = Membership::of(instance(name));
    let cluster = membership.cluster().unwrap();
    cluster.joined(seat(name));
    cluster.read(Arc::new(snapshot.clone()));
    for (id, row) in &snapshot.robots {
        if row.owner == Some(seat(name)) {
            cluster.began(Tenure {
                robot: id.clone(),
                seat: seat(name),
                epoch: row.epoch,
                claim: row.claim,
            });
        }
    }
    membership
}

impl Bench {
    /// Turns the service into an instance of a cluster, which reaches instance b at an address.
    fn instance(mut self, name: &str, snapshot: &Snapshot, b: Option<SocketAddr>) -> Self {
        let urls = b.map(|b| (instance("b"), format!("http://{b}").parse().unwrap()));
        let peers = PeersSetup {
            instance: instance(name),
            url: format!("https://{name}.example.com").parse().unwrap(),
            urls: urls.into_iter().collect(),
            root_certificates: None,
            plaintext: true,
        };
        self.setup.membership = membership(name, snapshot);
        self.setup.peers = Peers::start(peers, self.stop.clone()).unwrap();
        self.routes = router(self.setup.clone());
        self
    }

    fn cluster(&self) -> &fleetcal_cluster::Cluster {
        self.setup.membership.cluster().unwrap()
    }

    /// Serves it on loopback, where it trusts another instance on loopback.
    async fn served(&mut self) -> SocketAddr {
        let addresses = std::collections::BTreeSet::from(["127.0.0.1".parse().unwrap()]);
        let addresses = InstanceAddresses::watched(watch::channel(addresses).1);
        let clock = self.clock.clone();
        let trusted = TrustedProxies::default();
        self.setup.connections = Connections::of_cluster(clock, trusted, addresses);
        self.routes = router(self.setup.clone());
        let listener = TcpListener::bind("127.0.0.1:0").await.unwrap();
        let address = listener.local_addr().unwrap();
        let connections = self.setup.connections.clone();
        let serving = serve(
            listener,
            self.routes.clone(),
            connections,
            self.stop.clone(),
        );
        tokio::spawn(serving.unwrap());
        address
    }
}

/// Benches of instance b with the robot, served, and of instance a, which knows its address.
async fn two(robots: &[(&str, Option<&str>)]) -> (Bench, Bench) {
    let names: Vec<&str> = robots.iter().map(|(name, _)| *name).collect();
    let rows = snapshot(robots);
    let mut b = bench(&names).await.instance("b", &rows, None);
    let address = b.served().await;
    let a = bench(&names).await.instance("a", &rows, Some(address));
    (a, b)
}

#[tokio::test]
async fn a_service_that_is_alone_has_no_instances() {
    let bench = bench(&["agv_1"]).await;
    let answer = bench.get("/api/v1/cluster").await;
    assert_snapshot!(answer.body, @r#"{"alone":true,"instances":[],"duties":[],"robots_without_instance":0,"without_instance":[]}"#);
    let robot = bench.get("/api/v1/robots/agv_1").await.json();
    assert!(robot.get("instance").is_none());
    assert!(
        !bench
            .get("/metrics")
            .await
            .body
            .contains("fleetcal_cluster")
    );
}

#[tokio::test]
async fn an_instance_tells_of_all() {
    let mut rows = snapshot(&[("agv_1", Some("a")), ("agv_2", Some("b")), ("agv_3", None)]);
    rows.members[0]
        .hearing
        .unheard_instances
        .insert(instance("b"));
    rows.members[1].clock_ahead_ns = -S;
    rows.members[1].config_sha256 = vec![2];
    let bench = bench(&["agv_1", "agv_2", "agv_3"]).await;
    let bench = bench.instance("a", &rows, None);
    bench.cluster().took_over(Takeover {
        from: instance("c"),
        at: WallTime(NOW_NS),
        robots: 2,
    });
    let told = bench.get("/api/v1/cluster").await.json();
    let of_a = serde_json::json!({
        "name": "a", "url": "https://a.example.com", "program": "1.2.3", "robots": 1,
        "epoch_max": 1, "capacity": 1, "lease_left_s": 4.5, "linked": true, "unheard": ["b"],
        "draining": false,
        "clock_ahead_s": 0.0, "joined": "2026-01-01T00:00:00Z", "config_differs": false,
    });
    let mut of_b = of_a.clone();
    for (key, value) in [
        ("name", serde_json::json!("b")),
        ("url", serde_json::json!("https://b.example.com")),
        ("epoch_max", serde_json::json!(2)),
        ("clock_ahead_s", serde_json::json!(-1.0)),
        ("config_differs", serde_json::json!(true)),
        ("unheard", serde_json::json!([])),
    ] {
        of_b[key] = value;
    }
    let free = |duty| serde_json::json!({ "duty": duty, "instance": null });
    let expected = serde_json::json!({
        "alone": false,
        "instance": "a",
        "read": "2026-01-01T00:00:00Z",
        "instances": [of_a, of_b],
        "duties": [
            { "duty": "alerts", "instance": "b" },
            free("webhooks"), free("retention"), free("discovery"),
        ],
        "robots_without_instance": 1,
        "without_instance": ["agv_3"],
        "last_takeover": { "from": "c", "by": "a", "at": "2026-01-01T00:00:00Z", "robots": 2 },
    });
    assert_eq!(told, expected);
    let list = bench.get("/api/v1/robots").await.json();
    let items = list["items"].as_array().unwrap().iter();
    let owners: Vec<_> = items.map(|one| one["instance"].as_str()).collect();
    assert_eq!(owners, [Some("a"), Some("b"), None]);
    let one = bench.get("/api/v1/robots/agv_2").await.json();
    assert_eq!(one["instance"], "b");
}

#[tokio::test]
async fn metrics_tell_of_the_cluster_and_of_own_robots_one_by_one() {
    let rows = snapshot(&[("agv_1", Some("a")), ("agv_2", Some("b")), ("agv_3", None)]);
    let bench = bench(&["agv_1", "agv_2", "agv_3"]).await;
    let bench = bench.instance("a", &rows, None);
    let text = bench.get("/metrics").await.body;
    let families = parse(&text).unwrap();
    let value = |name: &str| families[name].samples[0].value;
    assert!((value("fleetcal_cluster_instances") - 2.0).abs() < 1e-9);
    assert!((value("fleetcal_cluster_epoch") - 3.0).abs() < 1e-9);
    assert!((value("fleetcal_cluster_robots_without_instance") - 1.0).abs() < 1e-9);
    assert!((value("fleetcal_cluster_lease_left_seconds") - 4.5).abs() < 1e-9);
    assert!(value("fleetcal_cluster_takeovers").abs() < 1e-9);
    assert_eq!(families["fleetcal_cluster_robots"].samples.len(), 2);
    let robots = &families["fleetcal_robot_unpaired"].samples;
    let robots: Vec<_> = robots
        .iter()
        .map(|one| one.labels["robot"].as_str())
        .collect();
    assert_eq!(
        robots,
        ["agv_1"],
        "each robot is told of by its own instance"
    );
}

#[tokio::test]
async fn readiness_is_that_of_the_instance() {
    let rows = snapshot(&[]);
    let mut bench = bench(&[]).await.instance("a", &rows, None);
    assert_eq!(bench.get("/readyz").await.status, 200);
    // A cut between routers makes no instance unready, and is said.
    let mut cut = rows.clone();
    let hearing = &mut cut.members[0].hearing;
    hearing.unheard_instances.insert(instance("b"));
    bench.cluster().read(Arc::new(cut));
    let answer = bench.get("/readyz").await;
    assert_eq!(answer.status, 200);
    let detail = &answer.json()["cluster"]["detail"];
    assert_eq!(detail, "not heard over Zenoh: b");
    let told = async |bench: &Bench, rows: &Snapshot| {
        bench.cluster().read(Arc::new(rows.clone()));
        let answer = bench.get("/readyz").await;
        assert_eq!(answer.status, 503);
        answer.json()
    };
    let mut unlinked = rows.clone();
    unlinked.members[0].linked = false;
    let answer = told(&bench, &unlinked).await;
    assert_eq!(answer["zenoh"]["detail"], "no Zenoh router is reached");
    let mut late = unlinked.clone();
    late.members[0].clock_ahead_ns = -12_500_000_000;
    let answer = told(&bench, &late).await;
    let detail = answer["zenoh"]["detail"].as_str().unwrap();
    assert!(
        detail.starts_with("the clock is 12.5 s behind the database's"),
        "{detail}"
    );
    let mut draining = rows.clone();
    draining.members[0].draining = true;
    let answer = told(&bench, &draining).await;
    assert_eq!(answer["cluster"]["detail"], "the instance is about to end");
    bench.setup.membership = Membership::of(instance("a"));
    bench.routes = router(bench.setup.clone());
    let answer = told(&bench, &rows).await;
    let detail = "the instance has not joined the cluster";
    assert_eq!(answer["cluster"]["detail"], detail);
}

#[tokio::test]
async fn the_owner_answers_what_lives_in_its_memory() {
    let (a, b) = two(&[("agv_1", Some("b"))]).await;
    let of_robot = |what: &str| format!("/api/v1/robots/agv_1/{what}");
    for path in [TOP_VIEW, &of_robot("checks"), &of_robot("manoeuvres")] {
        let (at_a, at_b) = (a.get(path).await, b.get(path).await);
        assert_eq!(at_a.status, 200, "{}", at_a.body);
        assert_eq!(at_a.body, at_b.body);
        assert_eq!(at_a.header("x-content-type-options"), "nosniff");
    }
    // Its refusals as well.
    let refused = a.get(&format!("{TOP_VIEW}?surprise=1")).await;
    assert!(refused.told().starts_with("400 query_refused [surprise]"));
}

#[tokio::test]
async fn the_owner_decides_what_the_credential_permits() {
    let (a, b) = two(&[("agv_1", Some("b"))]).await;
    let only_a = token(&a.store, "only-a", grant(Role::Viewer), None).await;
    let header = format!("Bearer {only_a}");
    let answer = a.send("GET", TOP_VIEW, &[("authorization", &header)]).await;
    assert_snapshot!(answer.told(), @"401 token_unknown: the token is unknown");
    // Nobody is asked for a caller without a credential.
    let answer = a.send("GET", TOP_VIEW, &[("authorization", "")]).await;
    let told = answer.told();
    assert!(told.starts_with("401 setup_required"), "{told}");
    drop(b);
}

#[tokio::test]
async fn a_recording_is_passed_on_as_it_is_made() {
    let (a, b) = two(&[("agv_1", Some("b"))]).await;
    let uri = "/api/v1/robots/agv_1/recording?duration_s=1";
    let answer = a.send("GET", uri, &[]).await;
    assert_eq!(answer.status, 200);
    assert_eq!(answer.header("content-type"), "application/octet-stream");
    let name = "attachment; filename=\"agv_1.mcap\"";
    assert_eq!(answer.header("content-disposition"), name);
    assert!(answer.body.contains("MCAP0"), "{}", answer.body.len());
    drop(b);
}

#[tokio::test]
async fn a_robot_without_an_instance_is_asked_for_again() {
    let (a, b) = two(&[("agv_1", None), ("agv_2", Some("a")), ("agv_3", Some("b"))]).await;
    let answer = a.get(TOP_VIEW).await;
    assert_snapshot!(answer.told(), @"503 no_instance: no instance estimates robot agv_1 at this moment");
    assert_eq!(answer.header("retry-after"), "1");
    // Its own is answered here, and one that nobody knows is unknown.
    let own = a.get("/api/v1/robots/agv_2/top-view").await;
    assert_eq!(own.status, 200, "{}", own.body);
    let told = a.get("/api/v1/robots/none/top-view").await.told();
    assert_eq!(told, "404 robot_unknown: no robot none is known");
    // One hop: an instance that does not have it asks nobody else.
    let by = [("x-fleetcal-forwarded-by", "b")];
    let answer = a.send("GET", "/api/v1/robots/agv_3/top-view", &by).await;
    assert!(answer.told().starts_with("503 no_instance"));
    drop(b);
}

#[tokio::test]
async fn an_owner_that_is_gone_or_not_configured_is_said() {
    let rows = snapshot(&[("agv_1", Some("b"))]);
    let unknown = bench(&["agv_1"]).await.instance("a", &rows, None);
    let told = unknown.get(TOP_VIEW).await;
    assert_snapshot!(told.told(), @"503 instance_unreachable: instance b, which has the robot, did not answer: instance b is not among cluster.peers of this instance");
    let (a, b) = two(&[("agv_1", Some("b"))]).await;
    b.stop.cancel();
    let gone = async {
        while a.get(TOP_VIEW).await.status == 200 {
            tokio::time::sleep(Duration::from_millis(20)).await;
        }
        a.get(TOP_VIEW).await
    };
    let gone = tokio::time::timeout(Duration::from_secs(10), gone).await;
    let gone = gone.unwrap();
    assert!(gone.told().starts_with("503 instance_unreachable"));
    assert_eq!(gone.header("retry-after"), "1");
}

#[tokio::test]
async fn other_instances_ask_under_the_name_that_they_know() {
    let rows = snapshot(&[("agv_1", Some("b"))]);
    let mut b = bench(&["agv_1"]).await.instance("b", &rows, None);
    let public = "https://fleetcal.example.com".parse().unwrap();
    b.setup.access.public_url = Some(public);
    b.routes = router(b.setup.clone());
    // With a cookie, which a browser would send too.
    let asked = async |host| {
        let headers = [("host", host), ("cookie", "__Host-fleetcal_session=none")];
        b.send("GET", TOP_VIEW, &headers).await.status.as_u16()
    };
    assert_eq!(asked("b.example.com").await, 401);
    assert_eq!(asked("evil.example.com").await, 421);
}
