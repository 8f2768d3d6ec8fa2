//! A session with the configuration of any Zenoh client.

use std::path::Path;
use std::time::Duration;

use serde_json::{Value, json};
use zenoh::{Config, Session, Wait};

/// Longest wait for a connection, or for a subscriber.
pub const PATIENCE: Duration = Duration::from_secs(30);

/// Makes a client's configuration, with `transport` in Zenoh's form.
pub fn client(endpoint: &str, transport: &Value) -> Value {
    json!({
        "mode": "client",
        "connect": { "endpoints": [endpoint], "timeout_ms": 10_000 },
        "scouting": { "multicast": { "enabled": false }, "gossip": { "enabled": false } },
        "transport": transport,
    })
}

/// Makes the configuration of a client with a password.
pub fn with_password(endpoint: &str, user: &str, password: &str) -> Value {
    let auth = json!({ "auth": { "usrpwd": { "user": user, "password": password } } });
    client(endpoint, &auth)
}

/// Makes the transport of a client that knows the authority whose certificate is `ca.pem` in a
/// folder; with a name, it has the certificate of that name.
pub fn tls(folder: &Path, name: Option<&str>) -> Value {
    let path = |file: &str| folder.join(file).display().to_string();
    let mut tls = json!({ "root_ca_certificate": path("ca.pem") });
    if let Some(name) = name {
        tls["enable_mtls"] = json!(true);
        tls["connect_certificate"] = json!(path(&format!("{name}.pem")));
        tls["connect_private_key"] = json!(path(&format!("{name}.key.pem")));
    }
    json!({ "link": { "tls": tls } })
}

/// Opens a session, or returns the reason of its refusal.
pub async fn open(config: Value) -> Result<Session, String> {
    let config = Config::from_json5(&config.to_string()).unwrap();
    let opened = tokio::task::spawn_blocking(move || zenoh::open(config).wait()).await;
    opened.unwrap().map_err(|error| error.to_string())
}
