//! Endpoints of Zenoh: `quic/host:7447?metadata#settings`.

use serde_json::Value;

/// Setting that keeps a QUIC connection's messages in their order.
const IN_ORDER: &str = "multistream=0";
/// Setting that leaves the number of streams to the other end, like an endpoint without it.
const UNDECIDED: &str = "multistream=auto";
/// Prefix of both settings.
const STREAMS: &str = "multistream=";

/// Text that is no endpoint.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("got {0:?}, expected PROTOCOL/ADDRESS such as tcp/192.0.2.7:7447")]
pub struct EndpointRefused(String);

/// Parses an endpoint as far as its form: a protocol, a slash, and the rest.
///
/// # Errors
/// [`EndpointRefused`] names the text.
pub fn parse(text: &str) -> Result<String, EndpointRefused> {
    let is_protocol = |name: &str| {
        let is_of_name = |c: char| c.is_ascii_alphanumeric() || c == '-';
        !name.is_empty() && name.chars().all(is_of_name)
    };
    match text.split_once('/') {
        Some((protocol, address)) if is_protocol(protocol) && !address.is_empty() => {
            Ok(text.to_owned())
        }
        _ => Err(EndpointRefused(text.to_owned())),
    }
}

/// Sets a QUIC endpoint to one stream; any other endpoint, and one that sets its number of streams,
/// stays unchanged.
///
/// Zenoh 1.10 gives a QUIC connection a stream for each priority, without any order among them:
/// data overtake the declaration of their key, and the receiver drops data without a key. One end
/// of a connection is enough, unless the other insists on `multistream=1`: these two cannot
/// connect.
pub fn in_order(endpoint: &str) -> String {
    let is_quic = endpoint.starts_with("quic/");
    let (address, settings) = match endpoint.split_once('#') {
        Some((address, settings)) => (address, format!("#{settings}")),
        None => (endpoint, String::new()),
    };
    if !is_quic {
        return endpoint.to_owned();
    }
    if address.contains(STREAMS) {
        return format!("{}{settings}", address.replace(UNDECIDED, IN_ORDER));
    }
    let separator = match address.split_once('?') {
        None => "?",
        Some((_, "")) => "",
        Some(_) => ";",
    };
    format!("{address}{separator}{IN_ORDER}{settings}")
}

/// Fields of a Zenoh configuration that hold endpoints.
pub const FIELDS: [&str; 2] = ["listen/endpoints", "connect/endpoints"];

/// Returns one of [`FIELDS`], as JSON text, with every endpoint [`in_order`]; `None` if that
/// changes nothing, or the text is not JSON.
pub fn field_in_order(text: &str) -> Option<Value> {
    let given: Value = serde_json::from_str(text).ok()?;
    let mut endpoints = given.clone();
    put_in_order(&mut endpoints);
    (endpoints != given).then_some(endpoints)
}

/// Sets the endpoints of a list, or of lists by mode.
fn put_in_order(endpoints: &mut Value) {
    match endpoints {
        Value::String(endpoint) => *endpoint = in_order(endpoint),
        Value::Array(list) => list.iter_mut().for_each(put_in_order),
        Value::Object(by_mode) => by_mode.values_mut().for_each(put_in_order),
        Value::Null | Value::Bool(_) | Value::Number(_) => {}
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn quic_has_one_stream_unless_somebody_says_otherwise() {
        for (given, wanted) in [
            ("quic/h:1", "quic/h:1?multistream=0"),
            ("quic/[::1]:1?rel=1", "quic/[::1]:1?rel=1;multistream=0"),
            ("quic/h:1?", "quic/h:1?multistream=0"),
            ("quic/h:1#iface=eth0", "quic/h:1?multistream=0#iface=eth0"),
            ("quic/h:1?multistream=1", "quic/h:1?multistream=1"),
            (
                "quic/h:1?multistream=auto#a=b",
                "quic/h:1?multistream=0#a=b",
            ),
            ("tls/h:1", "tls/h:1"),
            ("tcp/h:1?prio=6-7", "tcp/h:1?prio=6-7"),
        ] {
            assert_eq!(in_order(given), wanted);
        }
    }

    #[test]
    fn an_endpoint_is_a_protocol_and_an_address() {
        for given in [
            "tcp/[::1]:7447",
            "quic/h:1?a=b#c=d",
            "unixsock-stream//tmp/s",
        ] {
            assert_eq!(parse(given).unwrap(), given);
        }
        for given in ["", "bogus", "10.0.0.7:7447", "/h:1", "tcp/", "tcp :/h:1"] {
            let refused = parse(given).unwrap_err().to_string();
            assert!(
                refused.starts_with(&format!("got {given:?}, expected")),
                "{refused}"
            );
        }
    }

    #[test]
    fn endpoints_are_found_in_lists_by_mode() {
        let by_mode = serde_json::json!({
            "router": ["quic/h:1", "tcp/h:2"], "peer": [["quic/h:3"]], "client": null,
        });
        let wanted = serde_json::json!({
            "router": ["quic/h:1?multistream=0", "tcp/h:2"],
            "peer": [["quic/h:3?multistream=0"]],
            "client": null,
        });
        assert_eq!(field_in_order(&by_mode.to_string()), Some(wanted));
        assert_eq!(field_in_order(r#"["tcp/h:2"]"#), None);
        assert_eq!(field_in_order("no JSON"), None);
    }
}
