//! Host and length of a request's header.

use std::net::IpAddr;

use axum::http::header;
use axum::http::request::Parts;

use super::public_url::PublicUrl;
use super::server::LocalAddress;

/// Returns the size of a request's header as it was sent, except for the request line's exact
/// length, bytes.
pub fn header_bytes(parts: &Parts) -> usize {
    /// Length of colon, blank, and line end.
    const BETWEEN: usize = 4;
    let of_target = parts
        .uri
        .path_and_query()
        .map_or(0, |target| target.as_str().len());
    let headers = parts.headers.iter();
    headers.fold(of_target, |sum, (name, value)| {
        sum + name.as_str().len() + value.len() + BETWEEN
    })
}

/// Returns the host that a request is for; HTTP/1.0 has none.
pub fn host(parts: &Parts) -> Option<&str> {
    let of_target = parts
        .uri
        .authority()
        .map(axum::http::uri::Authority::as_str);
    let of_header = || {
        parts
            .headers
            .get(header::HOST)
            .map(|host| host.to_str().unwrap_or("?"))
    };
    of_target.or_else(of_header)
}

/// Returns the address of this machine that the connection came to.
pub fn local(parts: &Parts) -> Option<IpAddr> {
    parts.extensions.get::<LocalAddress>()?.0
}

/// True if a request for `host` is meant for this service. A page whose name an attacker points
/// here (DNS rebinding) is requested under that name: so names are accepted only if they are known.
/// Addresses, `localhost` and the machine's own name cannot be redirected. Other instances of a
/// cluster send requests to `among_instances`, host and maybe port.
pub fn is_ours(
    host: &str,
    own_name: &str,
    public: Option<&PublicUrl>,
    among_instances: Option<&str>,
    local: Option<IpAddr>,
) -> bool {
    let name = without_port(host);
    let is_address = name.trim_matches(['[', ']']).parse::<IpAddr>().is_ok();
    let name = name.to_ascii_lowercase();
    let is_local_name = name == "localhost" || name.ends_with(".localhost");
    let of_cluster = among_instances.map(without_port);
    let of_cluster = of_cluster.is_some_and(|known| known.eq_ignore_ascii_case(&name));
    if is_address || is_local_name || is_of_machine(&name, own_name) || of_cluster {
        return true;
    }
    match public {
        Some(url) => url.is_for(host),
        // On loopback nobody else has a name for it; elsewhere its names are not known.
        None => !local.is_some_and(|address| address.is_loopback()),
    }
}

/// Returns this machine's name; empty without one.
pub fn own_name() -> String {
    let system = rustix::system::uname();
    system.nodename().to_string_lossy().to_ascii_lowercase()
}

/// True if a name is the machine's own, in full or without its domain, which nobody else can
/// redirect here.
fn is_of_machine(name: &str, own_name: &str) -> bool {
    let first = own_name.split('.').next().unwrap_or("");
    !first.is_empty() && (name == own_name || name == first)
}

fn without_port(host: &str) -> &str {
    match host.rsplit_once(':') {
        Some((name, port)) if port.bytes().all(|byte| byte.is_ascii_digit()) => name,
        _ => host,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_request_for_another_host_is_not_ours() {
        let public: PublicUrl = "https://fleetcal.example.com".parse().unwrap();
        let loopback = Some(IpAddr::from([127, 0, 0, 1]));
        let outside = Some(IpAddr::from([192, 0, 2, 1]));
        let own = "hall-7.example.net";
        for (host, with_public, on_loopback) in [
            ("hall-7:8080", true, true),
            ("Hall-7.example.net", true, true),
            ("hall-7.evil.example", false, false),
            ("127.0.0.1:8080", true, true),
            ("[::1]:8080", true, true),
            ("localhost", true, true),
            ("LOCALHOST:5173", true, true),
            ("fleetcal.example.com", true, false),
            ("Fleetcal.Example.com:443", true, false),
            ("fleetcal.example.com:8080", false, false),
            ("evil.example", false, false),
            ("fleetcal.example.com.evil.example", false, false),
            ("localhost.evil.example", false, false),
            ("127.0.0.1.evil.example", false, false),
            ("", false, false),
        ] {
            assert_eq!(
                is_ours(host, own, Some(&public), None, outside),
                with_public,
                "{host}"
            );
            assert_eq!(
                is_ours(host, own, Some(&public), None, loopback),
                with_public,
                "{host}"
            );
            assert_eq!(
                is_ours(host, own, None, None, loopback),
                on_loopback,
                "{host}"
            );
            assert!(is_ours(host, own, None, None, outside), "{host}");
        }
        let nameless = is_ours("", "", None, None, loopback);
        assert!(!nameless, "a machine without a name");
    }

    #[test]
    fn other_instances_ask_under_a_name_of_its_own() {
        let public: PublicUrl = "https://fleetcal.example.com".parse().unwrap();
        let asked = |host| is_ours(host, "", Some(&public), Some("b.hall.example:8443"), None);
        assert!(asked("b.hall.example:8443") && asked("B.hall.example"));
        assert!(asked("fleetcal.example.com") && !asked("c.hall.example:8443"));
    }
}
