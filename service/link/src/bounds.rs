//! Bounds of what any peer may take of a router, whoever it is: they come before every access list.

use std::fmt;

use fleetcal_domain::limits;
use serde_json::{Value, json};
use zenoh::Config;

use crate::LinkError;
use crate::setting::{set, value as value_of};

/// Makes the transport's settings in the form of Zenoh's configuration.
pub fn transport() -> Value {
    json!({
        "unicast": {
            "max_sessions": limits::ZENOH_SESSIONS_MAX + limits::ZENOH_SESSIONS_OPENING_MAX,
            "accept_pending": limits::ZENOH_HANDSHAKES_MAX,
            "accept_timeout": limits::ZENOH_HANDSHAKE_TIMEOUT.as_millis() as u64,
            // With priorities a session has eight pairs of channels instead of one, and can leave a
            // message unfinished on each. Peers that offer them connect without.
            "qos": { "enabled": false },
        },
        "link": { "rx": { "max_message_size": limits::ZENOH_MESSAGE_BYTES_MAX } },
    })
}

/// Setting of an operator's configuration that is beyond its bound.
#[derive(Debug, Clone, PartialEq)]
pub struct Beyond {
    key: String,
    found: Value,
    bound: Value,
}

impl fmt::Display for Beyond {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { key, found, bound } = self;
        write!(f, "{key}: got {found}, expected at most {bound}")
    }
}

/// Sets the bounds in a configuration where it has Zenoh's own values.
///
/// # Errors
/// Zenoh refuses a bound.
pub fn complete(config: &mut Config) -> Result<(), LinkError> {
    let unset = Config::default();
    for (key, bound) in leaves("transport", transport()) {
        if value_of(config, &key) == value_of(&unset, &key) {
            set(config, &key, &bound)?;
        }
    }
    Ok(())
}

/// Returns the settings of a configuration that are beyond their bounds.
pub fn beyond(config: &Config) -> Vec<Beyond> {
    let bounds = leaves("transport", transport()).into_iter();
    let found = bounds.map(|(key, bound)| Beyond {
        found: value_of(config, &key),
        key,
        bound,
    });
    found
        .filter(|one| one.found.as_u64() > one.bound.as_u64())
        .collect()
}

/// Returns the number of sessions that a router of this configuration opens.
pub fn sessions_max(config: &Config) -> usize {
    let sessions = value_of(config, "transport/unicast/max_sessions").as_u64();
    sessions.map_or(0, |sessions| {
        usize::try_from(sessions).unwrap_or(usize::MAX)
    })
}

/// Returns the settings of a tree with their keys.
fn leaves(key: &str, value: Value) -> Vec<(String, Value)> {
    match value {
        Value::Object(fields) => fields
            .into_iter()
            .flat_map(|(name, value)| leaves(&format!("{key}/{name}"), value))
            .collect(),
        leaf => vec![(key.to_owned(), leaf)],
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn completed(transport: &str) -> (Config, Vec<String>) {
        let text = format!("{{ mode: 'router', transport: {transport} }}");
        let mut config = Config::from_json5(&text).unwrap();
        complete(&mut config).unwrap();
        let beyond = beyond(&config);
        (config, beyond.iter().map(ToString::to_string).collect())
    }

    #[test]
    fn a_file_that_sets_no_bound_has_all_of_them() {
        let (config, beyond) = completed("{}");
        assert_eq!(beyond, [""; 0]);
        for (key, bound) in leaves("transport", transport()) {
            assert_eq!(value_of(&config, &key), bound, "{key}");
        }
        assert_eq!(sessions_max(&config), 4_352);
    }

    #[test]
    fn what_a_file_sets_stays_and_is_named_where_it_is_beyond() {
        // A list that a former version has generated.
        let former =
            "{ link: { rx: { max_message_size: 4194304 } }, unicast: { max_sessions: 300 } }";
        let (config, beyond) = completed(former);
        let most = limits::ZENOH_MESSAGE_BYTES_MAX;
        let expected =
            format!("transport/link/rx/max_message_size: got 4194304, expected at most {most}");
        assert_eq!(beyond, [expected]);
        assert_eq!(sessions_max(&config), 300);
        let key = "transport/unicast/qos/enabled";
        assert_eq!(value_of(&config, key), Value::Bool(false));
    }
}
