//! Two routers before the service, each with the generated list: a robot at one, the service at the
//! other.

use std::fs;
use std::net::SocketAddr;
use std::path::Path;
use std::time::Duration;

use fleetcal_ports::free_address;
use fleetcal_tests::certificates::Authority;
use fleetcal_tests::service::Service;
use serde_json::json;
use tempfile::TempDir;

use super::lists::{arriving, generated, received, wait_until_received};
use super::robot;
use super::router::Router;
use super::session;

/// Writes the configuration of the router of a name, which admits robots and the other router and
/// connects to it; returns its path.
pub fn configured(
    authority: &Authority,
    folder: &Path,
    robots: &[&str],
    [own, other]: [(&str, SocketAddr); 2],
) -> String {
    let folder = folder.join(own.0);
    fs::create_dir(&folder).unwrap();
    let path = |ending: &str| authority.path(&format!("{}{ending}", own.0));
    let (certificate, key, ca) = (path(".pem"), path(".key.pem"), authority.path("ca.pem"));
    let (listen, connect) = (format!("quic/{}", own.1), format!("quic/{}", other.1));
    let robots = robots.iter().flat_map(|name| ["--robot", name]);
    let files = [
        "--service",
        "fleetcal",
        "--tls-certificate",
        &certificate,
        "--tls-key",
        &key,
        "--tls-ca",
        &ca,
    ];
    let mesh = [
        "--router",
        other.0,
        "--connect",
        &connect,
        "--listen",
        &listen,
    ];
    let flags: Vec<&str> = robots.chain(files).chain(mesh).collect();
    generated(&folder, &flags)
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn robots_at_one_router_reach_the_service_at_the_other_under_their_own_names_alone() {
    let folder = TempDir::new().unwrap();
    let authority = Authority::new(folder.path());
    for name in ["router_1", "router_2", "fleetcal", "robot_a"] {
        authority.sign(name);
    }
    let (first, second) = (("router_1", free_address()), ("router_2", free_address()));
    let config = |pair| configured(&authority, folder.path(), &["robot_a", "robot_b"], pair);
    let one = Router::start_process(Path::new(&config([first, second])));
    let two = Router::start_process(Path::new(&config([second, first])));

    let client = |endpoint: SocketAddr, name| {
        robot::client(
            &format!("quic/{endpoint}"),
            &session::tls(authority.folder(), Some(name)),
        )
    };
    let own = folder.path().join("service.json5");
    let mut config = client(second.1, "fleetcal");
    // The router may come later.
    config["connect"]["timeout_ms"] = json!(-1);
    config["connect"]["exit_on_failure"] = json!(false);
    fs::write(&own, config.to_string()).unwrap();
    let entry = |id| format!("[[robot]]\nid = \"{id}\"\nmodel = \"bicycle\"\nwheelbase_m = 1.2\n");
    let known: String = ["robot_a", "robot_b"].into_iter().map(entry).collect();
    let service = Service::start_on(second.1, &known, &["-c", own.to_str().unwrap()]);

    let a = robot::open(client(first.1, "robot_a")).await.unwrap();
    let token = a.liveliness().declare_token("fleet/@alive/robot_a").await;
    let token = token.unwrap();
    let estimates = a.declare_subscriber("fleet/robot_a/estimate").await;
    let estimates = estimates.unwrap();
    // What is forged before the routers know the service would be lost, not refused.
    let (as_a, of_a) = arriving(&service, &a, "robot_a").await;
    let forged = tokio::time::timeout(Duration::from_secs(5), robot::stream(&a, "robot_b"));
    if let Ok(as_b) = forged.await {
        robot::send(&as_b, 1_000).await;
    }
    robot::send(&as_a, 500).await;
    wait_until_received(&service, "robot_a", of_a + 500);
    assert_eq!(received(&service, "robot_b"), 0, "of 1,000 forged samples");
    assert_eq!(robot::answers(&a, "fleet/robot_a/progress").await, 1);
    assert_eq!(robot::answers(&a, "fleet/robot_b/progress").await, 0);
    assert_eq!(service.robot("robot_a")["alive"], json!(true));
    let estimate = tokio::time::timeout(Duration::from_secs(30), estimates.recv_async());
    assert!(estimate.await.is_ok(), "no estimate came back");
    token.undeclare().await.unwrap();
    one.stop().await;
    two.stop().await;
}
