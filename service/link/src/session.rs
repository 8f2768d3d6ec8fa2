//! Opens and closes the Zenoh session, which is a router.

use std::path::Path;
use std::sync::Arc;

use fleetcal_domain::limits;
use fleetcal_proto::endpoint;
use serde_json::Value;
use tokio::sync::oneshot;
use zenoh::internal::runtime::{DynamicRuntime, Runtime, RuntimeBuilder, ZRuntime};
use zenoh::key_expr::OwnedKeyExpr;
use zenoh::{Config, Session, Wait};

use crate::places::Shares;
use crate::sessions::Sessions;
use crate::setting::set;
use crate::{LinkError, LinkSetup, access, anonymous, bounds, password_file};

/// An open session.
#[derive(Debug)]
pub struct Opened {
    /// The session.
    pub session: Session,
    /// Zenoh's runtime beneath it.
    pub runtime: Runtime,
    /// True if it is a router to which robots can connect; else they are reached over others.
    pub listens: bool,
}

fn is_router_that_listens(config: &Config) -> bool {
    let is_router = config
        .get_json("mode")
        .is_ok_and(|mode| mode.contains("router"));
    let endpoints = config.get_json("listen/endpoints");
    is_router && endpoints.is_ok_and(|endpoints| endpoints.contains('/'))
}

/// Opens the session on a thread of its own, as `zenoh::open` may block for ever. The embedded
/// router's access list has `more` rules beside those of our own keys. `sessions` receives the
/// largest numbers of sessions of this router.
pub async fn open(
    setup: &LinkSetup,
    more: &[Value],
    sessions: impl FnOnce(Shares) -> Sessions,
) -> Result<Opened, LinkError> {
    let config = configuration(setup, more)?;
    let sessions = sessions(setup.shares.within(bounds::sessions_max(&config)));
    let listens = is_router_that_listens(&config);
    let endpoints = match &setup.zenoh_config {
        Some(path) => path.display().to_string(),
        None => [setup.listen.join(" "), setup.connect.join(" ")].join(" "),
    };
    let endpoints = endpoints.trim().to_owned();
    warn_without_list(&config, setup);
    warn_beyond_bounds(&config);
    let opened = on_own_thread("zenoh-open", move || opened_with(config, sessions));
    match tokio::time::timeout(limits::ZENOH_OPEN_TIMEOUT, opened).await {
        Ok(Some(Ok((session, runtime)))) => Ok(Opened {
            session,
            runtime,
            listens,
        }),
        Ok(Some(Err(error))) => Err(LinkError::Open {
            endpoints,
            reason: error.to_string(),
        }),
        Ok(None) | Err(_) => Err(LinkError::Timeout { endpoints }),
    }
}

/// Opens a session as `zenoh::open` does, but with `sessions` notified of every peer.
fn opened_with(config: Config, sessions: Sessions) -> zenoh::Result<(Session, Runtime)> {
    let aggregated = |key: &str| {
        let keys = config.get_json(key).unwrap_or_default();
        serde_json::from_str::<Vec<OwnedKeyExpr>>(&keys).unwrap_or_default()
    };
    let (subscribers, publishers) = (
        aggregated("aggregation/subscribers"),
        aggregated("aggregation/publishers"),
    );
    ZRuntime::Application.block_in_place(async move {
        let mut runtime = RuntimeBuilder::new(config).build().await?;
        let shared = DynamicRuntime::from(runtime.clone());
        shared.new_handler(Arc::new(sessions));
        let session = zenoh::session::init(shared)
            .aggregated_subscribers(subscribers)
            .aggregated_publishers(publishers)
            .await?;
        if let Err(error) = runtime.start().await {
            drop(runtime.close().await);
            return Err(error);
        }
        Ok((session, runtime))
    })
}

/// Makes the session's configuration, in which peers beyond this machine have to authenticate
/// unless anonymous ones are allowed.
pub fn configuration(setup: &LinkSetup, more: &[Value]) -> Result<Config, LinkError> {
    let mut config = match &setup.zenoh_config {
        Some(path) => native(path, setup)?,
        None => embedded(setup, more)?,
    };
    if setup.membership.cluster().is_some() {
        // Others have to notice soon that this instance is gone.
        let lease_ms = limits::CLUSTER_ZENOH_LEASE.as_millis() as u64;
        set(
            &mut config,
            "transport/link/tx/lease",
            &serde_json::json!(lease_ms),
        )?;
    }
    for key in endpoint::FIELDS {
        let text = config.get_json(key).unwrap_or_default();
        if let Some(endpoints) = endpoint::field_in_order(&text) {
            set(&mut config, key, &endpoints)?;
        }
    }
    if let Some(passwords) = anonymous::password_file(&config) {
        password_file::check(&passwords)?;
    }
    match anonymous::open_endpoint(&config) {
        Some(endpoint) if !setup.allow_anonymous => Err(LinkError::Anonymous { endpoint }),
        _ => Ok(config),
    }
}

/// Closes the session; one that does not close in time is left to the end of the process.
pub async fn close(session: Session, runtime: Runtime) {
    let closed = on_own_thread("zenoh-close", move || {
        session.close().wait()?;
        runtime.close().wait()
    });
    match tokio::time::timeout(limits::ZENOH_CLOSE_TIMEOUT, closed).await {
        Ok(Some(Ok(()))) => {}
        Ok(Some(Err(error))) => tracing::warn!(error, "the Zenoh session did not close"),
        Ok(None) | Err(_) => tracing::warn!("the Zenoh session did not close in time"),
    }
}

/// Runs blocking work on a thread of its own and returns the result. The runtime's threads for
/// blocking work are unsuitable, because the process could not end before it.
async fn on_own_thread<T: Send + 'static>(
    name: &str,
    work: impl FnOnce() -> T + Send + 'static,
) -> Option<T> {
    let (sender, receiver) = oneshot::channel();
    let spawned = std::thread::Builder::new()
        .name(name.to_owned())
        .spawn(move || {
            // Nobody waits any more when the time is over.
            drop(sender.send(work()));
        });
    match spawned {
        Ok(_) => receiver.await.ok(),
        Err(_) => None,
    }
}

/// Reads a native file unchanged, except for the endpoints given beside it and, for one that
/// listens, the [`bounds`] that it does not set.
fn native(path: &Path, setup: &LinkSetup) -> Result<Config, LinkError> {
    let mut config = Config::from_file(path)
        .map_err(|error| LinkError::Config(format!("{}: {error}", path.display())))?;
    let given = [
        ("listen/endpoints", &setup.listen),
        ("connect/endpoints", &setup.connect),
    ];
    for (key, endpoints) in given {
        if !endpoints.is_empty() {
            set(&mut config, key, &serde_json::json!(endpoints))?;
        }
    }
    if anonymous::listens(&config) {
        bounds::complete(&mut config)?;
    }
    Ok(config)
}

fn warn_without_list(config: &Config, setup: &LinkSetup) {
    let Some(path) = &setup.zenoh_config else {
        return;
    };
    let is_listed = config
        .get_json("access_control/enabled")
        .is_ok_and(|enabled| enabled == "true");
    let listens = config
        .get_json("listen/endpoints")
        .is_ok_and(|endpoints| endpoints.contains('/'));
    if listens && !is_listed {
        tracing::warn!(
            path = %path.display(),
            "the Zenoh configuration has no access list: every client that connects reads and \
             writes every robot's keys"
        );
    }
}

fn warn_beyond_bounds(config: &Config) {
    if anonymous::listens(config) {
        for beyond in bounds::beyond(config) {
            tracing::warn!(%beyond, "the Zenoh configuration lets peers take much memory");
        }
    }
}

/// Configures the embedded router: it listens on the given endpoints, has no discovery, limits
/// peers by [`bounds`], and admits only what the access list names.
fn embedded(setup: &LinkSetup, more: &[Value]) -> Result<Config, LinkError> {
    let mut config = Config::default();
    let list = match setup.membership.cluster() {
        None => access::list(&setup.keys, more),
        Some(_) => access::list_of_cluster(&setup.keys, more),
    };
    let settings = [
        ("mode", serde_json::json!("router")),
        ("listen/endpoints", serde_json::json!(setup.listen)),
        ("connect/endpoints", serde_json::json!(setup.connect)),
        ("scouting/multicast/enabled", serde_json::json!(false)),
        ("scouting/gossip/enabled", serde_json::json!(false)),
        ("transport", bounds::transport()),
        ("access_control", list),
    ];
    for (key, value) in settings {
        set(&mut config, key, &value)?;
    }
    Ok(config)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_embedded_configuration_is_what_zenoh_accepts() {
        let listen = vec!["tcp/127.0.0.1:7447".to_owned()];
        assert!(
            embedded(
                &LinkSetup {
                    listen,
                    ..LinkSetup::default()
                },
                &[]
            )
            .is_ok()
        );
        let listen = vec!["no endpoint".to_owned()];
        let hostile = LinkSetup {
            listen,
            ..LinkSetup::default()
        };
        let reason = embedded(&hostile, &[]).expect_err("refused").to_string();
        assert!(reason.contains("listen/endpoints"), "{reason}");
    }

    #[test]
    fn a_password_file_is_there_has_its_form_and_a_user() {
        let folder = tempfile::TempDir::new().unwrap();
        let passwords = folder.path().join("passwords.txt");
        let zenoh_config = folder.path().join("router.json5");
        let file = passwords.display();
        let text = format!(
            "{{ mode: 'router', listen: {{ endpoints: ['tcp/0.0.0.0:7447'] }}, \
             transport: {{ auth: {{ usrpwd: {{ dictionary_file: '{file}' }} }} }} }}"
        );
        std::fs::write(&zenoh_config, text).unwrap();
        let setup = LinkSetup {
            zenoh_config: Some(zenoh_config),
            ..LinkSetup::default()
        };
        let refusal = || configuration(&setup, &[]).expect_err("refused").to_string();
        let missing = refusal();
        for part in [
            "passwords.txt: No such file",
            "acl generate",
            "user:password",
        ] {
            assert!(missing.contains(part), "{missing}");
        }
        // Zenoh asks nobody for a password when it knows none.
        std::fs::write(&passwords, "\n").unwrap();
        assert!(refusal().contains("line 1: got no user"), "{}", refusal());
        std::fs::write(&passwords, "tugger_01:secret\ntugger_02\n").unwrap();
        assert!(refusal().contains("line 2: got no colon"), "{}", refusal());
        std::fs::write(&passwords, "tugger_01:secret\n").unwrap();
        assert!(configuration(&setup, &[]).is_ok());
    }

    #[test]
    fn a_native_file_that_is_not_there_is_named() {
        let reason = native(Path::new("/nowhere/zenoh.json5"), &LinkSetup::default())
            .expect_err("refused")
            .to_string();
        assert!(reason.contains("/nowhere/zenoh.json5"), "{reason}");
    }
}
