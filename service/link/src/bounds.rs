//! Bounds of what any peer may take of a router, whoever it is: they come before every access list.

use fleetcal_domain::limits;
use serde_json::{Value, json};

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
