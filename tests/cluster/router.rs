//! A Zenoh router as a process of its own, which is what `zenohd` is: listens on the first argument
//! and connects to the others, until it is killed. As `zenohd`, it takes `-c FILE` instead, a native
//! configuration.
#![expect(
    clippy::expect_used,
    reason = "a test's process ends where it cannot go on"
)]

use std::env;

use zenoh::Config;

#[tokio::main]
async fn main() {
    zenoh::init_log_from_env_or("warn");
    let words: Vec<String> = env::args().skip(1).collect();
    let config = match words.as_slice() {
        [flag, file] if flag == "-c" => Config::from_file(file).expect("a configuration"),
        endpoints => of_endpoints(endpoints),
    };
    let session = zenoh::open(config).await.expect("a router");
    std::future::pending::<()>().await;
    drop(session);
}

/// Configures a router without a list, which listens on the first endpoint and connects to the
/// others.
fn of_endpoints(endpoints: &[String]) -> Config {
    let (own, others) = endpoints.split_first().expect("an endpoint to listen on");
    let mut config = Config::default();
    for (key, value) in [
        ("mode", serde_json::json!("router")),
        ("listen/endpoints", serde_json::json!([own])),
        ("connect/endpoints", serde_json::json!(others)),
        ("connect/timeout_ms", serde_json::json!(-1)),
        ("connect/exit_on_failure", serde_json::json!(false)),
        ("scouting/multicast/enabled", serde_json::json!(false)),
        ("scouting/gossip/enabled", serde_json::json!(false)),
        ("transport/link/tx/lease", serde_json::json!(3_000)),
    ] {
        config
            .insert_json5(key, &value.to_string())
            .expect("an accepted value");
    }
    config
}
