//! Limits of addresses, callers, hosts and headers.

use std::io::{Read, Write};
use std::net::TcpStream;
use std::time::Duration;

use fleetcal_tests::http;
use fleetcal_tests::service::{Service, wait_for};

/// Sends a request's header unchanged; returns the status of the answer, on a connection that
/// stays.
fn send(service: &Service, head: &str) -> (u16, TcpStream) {
    let mut socket = TcpStream::connect(service.http()).unwrap();
    socket
        .set_read_timeout(Some(Duration::from_secs(10)))
        .unwrap();
    socket.write_all(head.as_bytes()).unwrap();
    let mut line = [0; 12];
    socket.read_exact(&mut line).unwrap();
    let text = String::from_utf8_lossy(&line).into_owned();
    (text[9..].parse().unwrap(), socket)
}

/// Returns the number of refusals for a reason.
fn turned_away(service: &Service, reason: &str) -> u64 {
    let metrics = service.page("/metrics");
    let name = format!("fleetcal_http_turned_away_total{{reason=\"{reason}\"}} ");
    let line = metrics.lines().find_map(|line| line.strip_prefix(&name));
    line.unwrap().parse().unwrap()
}

/// Opens an event stream with a token, from a client that a proxy on this machine names.
fn listen(service: &Service, token: &str, client: &str) -> (u16, TcpStream) {
    let head = format!(
        "GET /api/v1/stream HTTP/1.1\r\nHost: 127.0.0.1\r\nAuthorization: Bearer {token}\r\n\
         X-Forwarded-For: {client}\r\n\r\n"
    );
    send(service, &head)
}

#[test]
fn one_viewers_event_streams_leave_places_for_others() {
    let service = Service::start_with("trusted_proxies = [\"127.0.0.1\"]");
    let wall = service.made_token(&["--role", "viewer", "--name", "wall"]);
    let other = service.made_token(&["--role", "viewer", "--name", "other"]);
    // 1. One token, from an address each time.
    let streams: Vec<_> = (0..20)
        .map(|number| listen(&service, &wall, &format!("192.0.2.{number}")))
        .collect();
    let open = streams.iter().filter(|(status, _)| *status == 200).count();
    assert!((1..=8).contains(&open), "{open}");
    assert!(
        streams
            .iter()
            .all(|(status, _)| [200, 429].contains(status))
    );
    // 2. Another caller.
    let (status, _stream) = listen(&service, &other, "192.0.2.1");
    assert_eq!(status, 200);
    assert_eq!(turned_away(&service, "streams"), 20 - open as u64);
    // 3. The places are free again.
    drop(streams);
    wait_for("a free place", || {
        let (status, _stream) = listen(&service, &wall, "192.0.2.1");
        (status == 200).then_some(())
    });
}

#[test]
fn tries_to_sign_in_are_counted_by_the_client_behind_a_trusted_proxy() {
    let sign_in = |service: &Service, client: &str| {
        let body = r#"{"name":"nobody","password":"wrong wrong wrong"}"#;
        let head = format!(
            "POST /api/v1/session HTTP/1.1\r\nHost: 127.0.0.1\r\nX-Forwarded-For: {client}\r\n\
             Content-Type: application/json\r\nContent-Length: {}\r\nConnection: close\r\n\r\n{body}",
            body.len()
        );
        send(service, &head).0
    };
    let behind = Service::start_with("trusted_proxies = [\"127.0.0.0/8\"]");
    let tried: Vec<_> = (0..12).map(|_| sign_in(&behind, "192.0.2.1")).collect();
    assert_eq!(
        tried.iter().filter(|status| **status == 429).count(),
        2,
        "{tried:?}"
    );
    assert_eq!(sign_in(&behind, "192.0.2.2"), 401, "another client");
    // Without the setting the header is anybody's claim.
    let direct = Service::start(&[]);
    let tried: Vec<_> = (0..12)
        .map(|client| sign_in(&direct, &format!("192.0.2.{client}")))
        .collect();
    assert_eq!(
        tried.iter().filter(|status| **status == 429).count(),
        2,
        "{tried:?}"
    );
}

#[test]
fn a_header_ends_at_its_limit() {
    let service = Service::start(&[]);
    let with = |bytes: usize| {
        let padding = "x".repeat(bytes);
        let head = format!("GET /healthz HTTP/1.1\r\nHost: 127.0.0.1\r\nX-Long: {padding}\r\n\r\n");
        send(&service, &head).0
    };
    assert_eq!(with(30_000), 200);
    for bytes in [33_000, 40_000] {
        assert_eq!(with(bytes), 431, "{bytes}");
    }
}

#[test]
fn a_request_for_another_host_is_refused() {
    let public = Service::start_with("public_url = \"https://fleetcal.example.com\"");
    let own = Service::start(&[]);
    let asked = |service: &Service, path: &str, host: &str, origin: &str| {
        let head =
            format!("GET {path} HTTP/1.1\r\nHost: {host}\r\n{origin}Connection: close\r\n\r\n");
        send(service, &head).0
    };
    let key = "/api/v1/signing-key";
    for (host, with_public, without) in [
        ("127.0.0.1", 200, 200),
        ("localhost:8080", 200, 200),
        ("fleetcal.example.com", 200, 421),
        ("evil.example", 421, 421),
    ] {
        assert_eq!(asked(&public, key, host, ""), with_public, "{host}");
        assert_eq!(asked(&own, key, host, ""), without, "{host}");
    }
    // An Origin that equals a foreign Host is foreign.
    let order = "POST /api/v1/session HTTP/1.1\r\nHost: evil.example\r\n\
                 Origin: https://evil.example\r\nContent-Length: 0\r\n\r\n";
    assert_eq!(send(&public, order).0, 421);
    assert_eq!(
        asked(&public, "/healthz", "evil.example", ""),
        200,
        "a probe"
    );
    assert_eq!(turned_away(&public, "host"), 2);
}

#[test]
fn one_address_has_so_many_connections() {
    let service = Service::start(&[]);
    let silent: Vec<_> = (0..100)
        .map(|_| TcpStream::connect(service.http()).unwrap())
        .collect();
    let closed = wait_for("the closed ones", || {
        let closed = silent.iter().filter(|socket| is_closed(socket)).count();
        (closed >= 36).then_some(closed)
    });
    assert_eq!(closed, 36);
    // A moment later the address may replace its own.
    wait_for("an answer", || {
        http::get(service.http(), "/healthz", None).filter(|answer| answer.status == 200)
    });
    // The request is answered once an older connection has been told to close, which it does a moment later.
    wait_for("the replaced one", || {
        let closed = silent.iter().filter(|socket| is_closed(socket)).count();
        (closed >= 37).then_some(())
    });
    assert!(turned_away(&service, "address_connections") >= 36);
    assert!(turned_away(&service, "evicted") >= 1);
    // None was closed because it had said nothing for too long.
    assert_eq!(turned_away(&service, "idle_timeout"), 0);
    assert_eq!(turned_away(&service, "header_timeout"), 0);
}

#[test]
fn reasons_are_named_truthfully() {
    let service = Service::start(&[]);
    let began = "GET /healthz HTTP/1.1\r\nHost: 127.0.0.1\r\nX-Slow: ";
    let (status, idle) = send(&service, "GET /healthz HTTP/1.1\r\nHost: 127.0.0.1\r\n\r\n");
    assert_eq!(status, 200);
    let mut slow = TcpStream::connect(service.http()).unwrap();
    slow.write_all(began.as_bytes()).unwrap();
    wait_for("a header that was given up", || {
        (turned_away(&service, "header_timeout") == 1).then_some(())
    });
    wait_for("a connection without a request", || {
        (turned_away(&service, "idle_timeout") == 1).then_some(())
    });
    drop((idle, slow));
}

/// True if the service has closed a silent connection.
fn is_closed(socket: &TcpStream) -> bool {
    socket.set_nonblocking(true).unwrap();
    match socket.peek(&mut [0]) {
        Ok(read) => read == 0,
        Err(error) => error.kind() != std::io::ErrorKind::WouldBlock,
    }
}
