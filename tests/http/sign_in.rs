//! Floods of passwords: what they cost, and who still gets in.

use std::io::Write;
use std::net::SocketAddr;
use std::process::{Command, Stdio};
use std::sync::Arc;
use std::time::Duration;

use fleetcal_tests::binary;
use fleetcal_tests::service::{Service, now};
use tokio::io::{AsyncReadExt, AsyncWriteExt};
use tokio::net::TcpSocket;
use tokio_util::sync::CancellationToken;

/// Addresses of the flood.
const ADDRESSES: usize = 250;
/// Checks at once.
const CHECKS: usize = 2_000;
/// Largest growth of resident memory by the checks, bytes.
const GROWTH_MAX: u64 = 48 << 20;
/// Growth limit where PostgreSQL's answers are read beside them.
const GROWTH_POSTGRES_MAX: u64 = 56 << 20;
/// Longest duration of the growth.
const LASTS_MAX: Duration = Duration::from_secs(30);
/// Growth below which the measurement sees nothing: a hash takes 19 MiB.
const GROWTH_MIN: u64 = 15 << 20;
/// Largest growth that may remain after either flood.
const STAYS_MAX: u64 = 4 << 20;
/// Time after which the allocator has returned memory.
const GIVEN_BACK_AFTER: Duration = Duration::from_secs(3);
/// Wait after which a refused client retries.
const COME_BACK_AFTER: Duration = Duration::from_millis(20);
/// Correct passwords amid the flood.
const RIGHT_TRIES: usize = 20;
/// Time limit of each correct password.
const RIGHT_WITHIN: Duration = Duration::from_secs(5);

const NAME: &str = "ana";
const PASSWORD: &str = "correct horse battery";

/// Attempts to sign in from an address of 127.0.0.0/8; returns the status.
async fn sign_in(service: SocketAddr, from: [u8; 4], name: &str, password: &str) -> Option<u16> {
    let body = format!(r#"{{"name":"{name}","password":"{password}"}}"#);
    let request = format!(
        "POST /api/v1/session HTTP/1.1\r\nHost: {service}\r\nContent-Type: application/json\r\n\
         Content-Length: {}\r\nConnection: close\r\n\r\n{body}",
        body.len()
    );
    ask(service, from, &request).await
}

/// Sends a request from an address of 127.0.0.0/8; returns the status.
async fn ask(service: SocketAddr, from: [u8; 4], request: &str) -> Option<u16> {
    let socket = TcpSocket::new_v4().ok()?;
    socket.bind(SocketAddr::from((from, 0))).ok()?;
    let mut socket = socket.connect(service).await.ok()?;
    socket.write_all(request.as_bytes()).await.ok()?;
    let mut answer = String::new();
    socket.read_to_string(&mut answer).await.ok()?;
    answer.get(9..12)?.parse().ok()
}

fn attacker(number: usize) -> [u8; 4] {
    [127, 0, 1, u8::try_from(number % ADDRESSES).unwrap() + 1]
}

fn make_user(service: &Service) {
    let mut command = Command::new(binary::path())
        .args([
            "user", "create", "--role", "viewer", "--name", NAME, "--data",
        ])
        .arg(service.data())
        .envs(fleetcal_tests::database::variable(&service.data()))
        .stdin(Stdio::piped())
        .stdout(Stdio::null())
        .spawn()
        .unwrap();
    let mut input = command.stdin.take().unwrap();
    writeln!(input, "{PASSWORD}").unwrap();
    drop(input);
    assert!(command.wait().unwrap().success());
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn two_thousand_checks_at_once_take_little_memory_and_give_it_back() {
    let service = Service::start(&[]);
    // As many connections, and a first check, take what they take with or without passwords.
    let host = service.http();
    let plain = format!("GET /healthz HTTP/1.1\r\nHost: {host}\r\nConnection: close\r\n\r\n");
    let asked = (0..CHECKS).map(|number| {
        let plain = plain.clone();
        tokio::spawn(async move {
            while ask(host, attacker(number), &plain).await.is_none() {
                tokio::time::sleep(COME_BACK_AFTER).await;
            }
        })
    });
    for asked in asked.collect::<Vec<_>>() {
        asked.await.unwrap();
    }
    let first = sign_in(service.http(), [127, 0, 0, 9], "nobody", "x").await;
    assert_eq!(first, Some(401));
    tokio::time::sleep(GIVEN_BACK_AFTER).await;
    for _ in 0..2 {
        let cost = check_many(&service).await;
        assert!(cost.growth >= GROWTH_MIN, "{cost:?}");
        let growth_max = match fleetcal_contract::server() {
            Some(_) => GROWTH_POSTGRES_MAX,
            None => GROWTH_MAX,
        };
        assert!(cost.growth <= growth_max, "{cost:?}");
        assert!(cost.stays <= STAYS_MAX, "{cost:?}");
    }
}

/// Cost of many checks at once, in bytes of resident memory.
#[derive(Debug)]
struct Cost {
    growth: u64,
    stays: u64,
}

/// Checks [`CHECKS`] passwords at once, and waits until at most [`STAYS_MAX`] is left of their
/// memory. Refused clients retry until there is an answer.
async fn check_many(service: &Service) -> Cost {
    let before = service.memory_bytes();
    let checks: Vec<_> = (0..CHECKS)
        .map(|number| tokio::spawn(answered(service.http(), number)))
        .collect();
    let mut most = before;
    while !checks.iter().all(tokio::task::JoinHandle::is_finished) {
        most = most.max(service.memory_bytes());
        tokio::time::sleep(Duration::from_millis(5)).await;
    }
    let mut statuses = std::collections::BTreeMap::new();
    for check in checks {
        *statuses.entry(check.await.unwrap()).or_insert(0) += 1;
    }
    let ended = now();
    let mut after = service.memory_bytes();
    while after > before + STAYS_MAX && ended.elapsed() < LASTS_MAX {
        tokio::time::sleep(Duration::from_millis(500)).await;
        after = service.memory_bytes();
    }
    let mib = |bytes: u64| bytes as f64 / f64::from(1 << 20);
    eprintln!(
        "{CHECKS} checks: {statuses:?}; resident {:.0} MiB before, {:.0} at most, {:.0} after {:?}",
        mib(before),
        mib(most),
        mib(after),
        ended.elapsed()
    );
    assert!(statuses.get(&401).copied().unwrap_or(0) > 0, "{statuses:?}");
    Cost {
        growth: most - before,
        stays: after.saturating_sub(before),
    }
}

/// Returns the answer to a password, after as many connections as that takes.
async fn answered(service: SocketAddr, number: usize) -> u16 {
    let name = format!("user{number}");
    loop {
        if let Some(status) = sign_in(service, attacker(number), &name, "x").await {
            return status;
        }
        tokio::time::sleep(COME_BACK_AFTER).await;
    }
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn the_right_password_gets_in_amid_a_flood_of_wrong_ones() {
    let service = Service::start(&[]);
    make_user(&service);
    let home = [127, 0, 0, 9];
    assert_eq!(
        sign_in(service.http(), home, NAME, PASSWORD).await,
        Some(201)
    );
    let stop = CancellationToken::new();
    let flood: Vec<_> = (0..ADDRESSES)
        .map(|number| tokio::spawn(guess(service.http(), number, stop.clone())))
        .collect();
    tokio::time::sleep(Duration::from_secs(2)).await;
    let mut took = Vec::new();
    for _ in 0..RIGHT_TRIES {
        let began = now();
        let status = sign_in(service.http(), home, NAME, PASSWORD).await;
        took.push((status, began.elapsed()));
    }
    stop.cancel();
    let mut guesses = 0;
    for attacker in flood {
        guesses += attacker.await.unwrap();
    }
    let slowest = took.iter().map(|(_, took)| *took).max();
    eprintln!("{guesses} wrong passwords; {RIGHT_TRIES} right ones, the slowest in {slowest:?}");
    for (status, took) in &took {
        assert_eq!(*status, Some(201), "{took:?}");
        assert!(*took <= RIGHT_WITHIN, "{took:?}");
    }
}

/// Guesses until the flood is over; returns the number of guesses.
async fn guess(service: SocketAddr, number: usize, stop: CancellationToken) -> usize {
    let wrong = Arc::new(format!("wrong wrong wrong {number}"));
    let mut guesses = 0;
    while !stop.is_cancelled() {
        let answer = sign_in(service, attacker(number), NAME, &wrong).await;
        guesses += usize::from(answer.is_some());
        tokio::time::sleep(Duration::from_millis(50)).await;
    }
    guesses
}
