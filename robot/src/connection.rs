//! Connection of a robot to its service: endpoints, a native Zenoh configuration, or both.

use std::path::PathBuf;

use fleetcal_proto::endpoint;

use crate::session_error::SessionError;

/// Largest message that a robot reads, bytes.
const MESSAGE_BYTES_MAX: usize = 4 * 1024 * 1024;

/// Endpoints and configuration of a robot's connection.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Connection {
    /// Endpoints of the service's router, `tcp/127.0.0.1:7447`; the first that answers is used.
    pub endpoints: Vec<String>,
    /// A native Zenoh configuration (JSON5 or YAML by its suffix), used unchanged except for the
    /// streams of QUIC endpoints; `endpoints` replace its own if they are not empty. Without it,
    /// the session is a client without discovery.
    pub zenoh_config: Option<PathBuf>,
}

impl From<Vec<String>> for Connection {
    fn from(endpoints: Vec<String>) -> Self {
        Self {
            endpoints,
            zenoh_config: None,
        }
    }
}

impl std::fmt::Display for Connection {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match &self.zenoh_config {
            Some(path) if self.endpoints.is_empty() => write!(f, "what {} says", path.display()),
            _ => f.write_str(&self.endpoints.join(", ")),
        }
    }
}

impl Connection {
    /// Makes the session's configuration, with QUIC in one stream. Opening a client of
    /// [`Connection::endpoints`] alone fails after `timeout_ms`.
    ///
    /// # Errors
    /// The file cannot be read or used, or an endpoint is invalid.
    pub(crate) fn config(&self, timeout_ms: u64) -> Result<zenoh::Config, SessionError> {
        let mut config = match &self.zenoh_config {
            Some(path) => zenoh::Config::from_file(path).map_err(|error| SessionError::File {
                path: path.clone(),
                reason: error.to_string(),
            })?,
            None => client(timeout_ms)?,
        };
        if !self.endpoints.is_empty() {
            let endpoints = serde_json::Value::from(self.endpoints.clone());
            set(&mut config, "connect/endpoints", endpoints.to_string())?;
        }
        for field in endpoint::FIELDS {
            let text = config.get_json(field).unwrap_or_default();
            if let Some(endpoints) = endpoint::field_in_order(&text) {
                set(&mut config, field, endpoints.to_string())?;
            }
        }
        Ok(config)
    }
}

fn client(timeout_ms: u64) -> Result<zenoh::Config, SessionError> {
    let settings = [
        ("mode", "\"client\"".to_owned()),
        ("connect/timeout_ms", timeout_ms.to_string()),
        ("connect/exit_on_failure", "true".to_owned()),
        ("scouting/multicast/enabled", "false".to_owned()),
        ("scouting/gossip/enabled", "false".to_owned()),
        (
            "transport/link/rx/max_message_size",
            MESSAGE_BYTES_MAX.to_string(),
        ),
    ];
    let mut config = zenoh::Config::default();
    for (field, value) in settings {
        set(&mut config, field, value)?;
    }
    Ok(config)
}

fn set(config: &mut zenoh::Config, field: &'static str, value: String) -> Result<(), SessionError> {
    config
        .insert_json5(field, &value)
        .map_err(|error| SessionError::Config {
            field,
            value,
            reason: error.to_string(),
        })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn written(connection: &Connection, field: &str) -> String {
        let config = connection.config(2000).unwrap();
        config.get_json(field).unwrap()
    }

    #[test]
    fn a_native_file_is_taken_as_it_is_and_endpoints_replace_its_own() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("zenoh.json5");
        let text = "{ mode: 'peer', connect: { endpoints: ['tcp/192.0.2.1:7447'] } } // mine";
        std::fs::write(&path, text).unwrap();
        let mut connection = Connection {
            endpoints: Vec::new(),
            zenoh_config: Some(path),
        };
        assert_eq!(written(&connection, "mode"), "\"peer\"");
        let endpoints = || written(&connection, "connect/endpoints");
        assert_eq!(endpoints(), "[\"tcp/192.0.2.1:7447\"]");
        connection.endpoints = vec!["tcp/192.0.2.2:7447".to_owned()];
        let endpoints = written(&connection, "connect/endpoints");
        assert_eq!(endpoints, "[\"tcp/192.0.2.2:7447\"]");
        assert_eq!(written(&connection, "mode"), "\"peer\"");
    }

    #[test]
    fn over_quic_nothing_overtakes_what_was_sent_before() {
        let connection =
            Connection::from(vec!["quic/n1:7447".to_owned(), "tcp/n2:7447".to_owned()]);
        let endpoints = written(&connection, "connect/endpoints");
        assert_eq!(endpoints, r#"["quic/n1:7447?multistream=0","tcp/n2:7447"]"#);
    }

    #[test]
    fn a_file_that_cannot_be_used_is_named() {
        let connection = Connection {
            endpoints: Vec::new(),
            zenoh_config: Some(PathBuf::from("/nowhere/zenoh.json5")),
        };
        let refused = connection.config(2000).unwrap_err().to_string();
        assert!(refused.contains("/nowhere/zenoh.json5"), "{refused}");
        let refused = Connection::from(vec!["nonsense".to_owned()]).config(2000);
        let refused = refused.unwrap_err().to_string();
        assert!(refused.contains("connect/endpoints"), "{refused}");
    }
}
