//! Settings of a Zenoh configuration by their keys.

use serde_json::Value;
use zenoh::Config;

use crate::LinkError;

/// Returns the value of a key; null where there is none.
pub fn value(config: &Config, key: &str) -> Value {
    let text = config.get_json(key).unwrap_or_default();
    serde_json::from_str(&text).unwrap_or_default()
}

/// Sets a key.
///
/// # Errors
/// Zenoh refuses it.
pub fn set(config: &mut Config, key: &str, value: &Value) -> Result<(), LinkError> {
    config
        .insert_json5(key, &value.to_string())
        .map_err(|error| LinkError::Config(format!("{key} is {value}: {error}")))
}
