//! Detection of a router that would serve unauthenticated peers beyond this machine.

use std::net::IpAddr;
use std::path::PathBuf;

use serde_json::Value;
use zenoh::Config;

use crate::setting::value;

/// Returns the first endpoint at which anybody beyond this machine could connect; `None` if peers
/// need a password or a certificate everywhere, or all endpoints are loopback.
pub fn open_endpoint(config: &Config) -> Option<String> {
    if password_file(config).is_some() {
        return None;
    }
    let asks_for_certificates =
        value(config, "transport/link/tls/enable_mtls") == Value::Bool(true);
    let is_open = |endpoint: &String| {
        let (protocol, address) = endpoint.split_once('/').unwrap_or(("", endpoint));
        let knows_peers = matches!(protocol, "tls" | "quic") && asks_for_certificates;
        !knows_peers && !is_loopback(address)
    };
    listened_on(config).into_iter().find(is_open)
}

/// True if others can connect to a session of this configuration.
pub fn listens(config: &Config) -> bool {
    !listened_on(config).is_empty()
}

/// Returns the endpoints that a router of this configuration listens on: the same in every mode, or
/// by mode.
fn listened_on(config: &Config) -> Vec<String> {
    let endpoints = value(config, "listen/endpoints");
    let of_mode = match &endpoints {
        Value::Object(by_mode) => {
            let mode = value(config, "mode");
            // What Zenoh is without a mode.
            by_mode.get(mode.as_str().unwrap_or("peer"))
        }
        all => Some(all),
    };
    let of_mode = of_mode.and_then(Value::as_array);
    let texts = of_mode.into_iter().flatten().filter_map(Value::as_str);
    texts.map(str::to_owned).collect()
}

/// True if an endpoint's address, `HOST:PORT` with metadata behind it, is of this machine alone.
fn is_loopback(address: &str) -> bool {
    let address = address.split(['?', '#']).next().unwrap_or(address);
    let host = address.rsplit_once(':').map_or(address, |(host, _)| host);
    let host = host.trim_start_matches('[').trim_end_matches(']');
    host == "localhost"
        || host
            .parse::<IpAddr>()
            .is_ok_and(|address| address.to_canonical().is_loopback())
}

/// Returns the file of the passwords by which peers authenticate.
pub fn password_file(config: &Config) -> Option<PathBuf> {
    let file = value(config, "transport/auth/usrpwd/dictionary_file");
    let file = file.as_str().filter(|file| !file.is_empty());
    file.map(PathBuf::from)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn open(json5: &str) -> Option<String> {
        open_endpoint(&Config::from_json5(json5).unwrap())
    }

    #[test]
    fn loopback_is_open_to_nobody_else() {
        for endpoint in [
            "tcp/127.0.0.1:7447",
            "tcp/127.1.2.3:7447",
            "tcp/localhost:7447",
            "tcp/[::1]:7447",
            "tcp/[::ffff:127.0.0.1]:7447",
        ] {
            let config = format!("{{ mode: 'router', listen: {{ endpoints: ['{endpoint}'] }} }}");
            assert_eq!(open(&config), None, "{endpoint}");
        }
        assert_eq!(open("{ mode: 'router', listen: { endpoints: [] } }"), None);
    }

    #[test]
    fn what_others_reach_is_open_until_they_have_to_show_who_they_are() {
        for endpoint in [
            "tcp/0.0.0.0:7447",
            "tcp/[::]:7447",
            "tcp/192.168.1.2:7447#iface=eth0",
            "tcp/robots.example:7447",
            "tls/0.0.0.0:7447",
            "tcp/localhost.example:7447",
        ] {
            let listen = format!("mode: 'router', listen: {{ endpoints: ['{endpoint}'] }}");
            assert_eq!(open(&format!("{{ {listen} }}")), Some(endpoint.to_owned()));
            let passwords = "transport: { auth: { usrpwd: { dictionary_file: 'p.txt' } } }";
            assert_eq!(open(&format!("{{ {listen}, {passwords} }}")), None);
            let certificates = "transport: { link: { tls: { enable_mtls: true } } }";
            let with_mtls = open(&format!("{{ {listen}, {certificates} }}"));
            assert_eq!(
                with_mtls.is_none(),
                endpoint.starts_with("tls/"),
                "{endpoint}"
            );
        }
    }

    #[test]
    fn the_mode_says_which_endpoints_count() {
        let by_mode = "listen: { endpoints: { router: ['tcp/0.0.0.0:1'], peer: ['tcp/[::1]:1'] } }";
        let of = |mode: &str| open(&format!("{{ mode: '{mode}', {by_mode} }}"));
        assert_eq!(of("router").as_deref(), Some("tcp/0.0.0.0:1"));
        assert_eq!(of("peer"), None);
        assert_eq!(of("client"), None);
        // Zenoh's own default listens everywhere.
        assert!(open("{ mode: 'router' }").is_some());
    }
}
