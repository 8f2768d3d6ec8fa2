//! Idle, unfinished and never-reading connections from 250 addresses, reopened as they close, while
//! probes ask.

use std::io::{Read, Write};
use std::net::SocketAddr;
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};

use fleetcal_tests::service::{Service, now, wait_for};
use tokio::io::{AsyncReadExt, AsyncWriteExt};
use tokio::net::{TcpSocket, TcpStream};
use tokio_util::sync::CancellationToken;

use super::sockets::{Held, files};

/// Idle connections.
const IDLE: usize = 1_000;
/// Connections with an unfinished header.
const UNFINISHED: usize = 1_000;
/// Connections that never read.
const NEVER_READING: usize = 600;
/// Addresses that the connections come from.
const ADDRESSES: usize = 250;
/// Bound of the probes' 99th percentile.
const PROBE_P99: Duration = Duration::from_millis(250);
/// Time within which the service closes each connection.
const GONE_WITHIN: Duration = Duration::from_secs(15);
/// Files that may remain open beyond those before the flood.
const FILES_BEYOND_BASELINE: usize = 2;
/// Default duration of the flood, s.
const FLOOD_S: u64 = 20;
/// Pause between two probes of a kind.
const PROBE_EVERY: Duration = Duration::from_millis(50);
/// Pause between two looks at the sockets.
const LOOK_EVERY: Duration = Duration::from_millis(250);
/// Pause before a connection is reopened.
const REOPEN_AFTER: Duration = Duration::from_millis(20);

#[derive(Clone, Copy)]
enum Kind {
    Idle,
    Unfinished,
    NeverReading,
}

/// State that the attackers share.
struct Flood {
    service: SocketAddr,
    /// Path of a public file of some 300 kB.
    asset: String,
    held: Mutex<Held>,
    opened: Mutex<u64>,
    stop: CancellationToken,
}

impl Flood {
    /// Keeps one connection of a kind open, reopening it as necessary, until the flood is over.
    async fn keep(self: Arc<Self>, kind: Kind, number: usize) {
        while !self.stop.is_cancelled() {
            if let Some(socket) = self.open(number).await {
                *self.opened.lock().unwrap() += 1;
                tokio::select! {
                    () = self.hold(kind, socket) => {}
                    () = self.stop.cancelled() => {}
                }
            }
            tokio::time::sleep(REOPEN_AFTER).await;
        }
    }

    async fn open(&self, number: usize) -> Option<TcpStream> {
        let socket = TcpSocket::new_v4().ok()?;
        let host = u8::try_from(number % ADDRESSES).unwrap() + 1;
        socket.bind(SocketAddr::from(([127, 0, 1, host], 0))).ok()?;
        socket.set_recv_buffer_size(2_048).ok()?;
        socket.connect(self.service).await.ok()
    }

    /// Holds a connection until the service has closed it.
    async fn hold(&self, kind: Kind, mut socket: TcpStream) {
        match kind {
            Kind::Idle => {}
            Kind::Unfinished => {
                let part = b"GET /healthz HTTP/1.1\r\nHost: 127.0.0.1\r\nX-Slow: ";
                if socket.write_all(part).await.is_err() {
                    return;
                }
            }
            Kind::NeverReading => return self.never_read(socket).await,
        }
        let mut rest = Vec::new();
        // A reset is an end as well.
        drop(socket.read_to_end(&mut rest).await);
    }

    async fn never_read(&self, mut socket: TcpStream) {
        let request = format!("GET {} HTTP/1.1\r\nHost: 127.0.0.1\r\n\r\n", self.asset);
        if socket
            .write_all(request.repeat(40).as_bytes())
            .await
            .is_err()
        {
            return;
        }
        let Ok(own) = socket.local_addr() else { return };
        // Unread, its end is not seen on the socket.
        tokio::time::sleep(2 * LOOK_EVERY).await;
        while self.held.lock().unwrap().has(own) {
            tokio::time::sleep(LOOK_EVERY).await;
        }
        drop(socket.set_zero_linger());
    }
}

/// Latency of each answer to a probe, and number of missing answers.
#[derive(Debug, Default)]
struct Probed {
    took: Vec<Duration>,
    failed: usize,
}

impl Probed {
    fn quantile(&self, share: f64) -> Duration {
        let mut took = self.took.clone();
        took.sort_unstable();
        let last = took.len().checked_sub(1).unwrap();
        took[(last as f64 * share).ceil() as usize]
    }
}

/// Starts a server that answers anything at once, on a thread of its own: its latency is the
/// machine's own delay, which a flood shares with everything else that runs.
fn control() -> SocketAddr {
    let listener = std::net::TcpListener::bind("127.0.0.1:0").unwrap();
    let address = listener.local_addr().unwrap();
    std::thread::spawn(move || {
        for socket in listener.incoming() {
            let mut socket = socket.unwrap();
            let mut request = [0; 1_024];
            // A probe that has gone needs no answer.
            drop(socket.read(&mut request));
            drop(socket.write_all(b"HTTP/1.1 200 OK\r\n\r\n"));
        }
    });
    address
}

/// Requests `path` on a connection of its own, again and again.
async fn probe(service: SocketAddr, path: &'static str, stop: CancellationToken) -> Probed {
    let mut probed = Probed::default();
    while !stop.is_cancelled() {
        let began = now();
        let answered = tokio::time::timeout(Duration::from_secs(5), ask(service, path)).await;
        match answered {
            Ok(Some(())) => probed.took.push(began.elapsed()),
            Ok(None) | Err(_) => probed.failed += 1,
        }
        tokio::time::sleep(PROBE_EVERY).await;
    }
    probed
}

async fn ask(service: SocketAddr, path: &str) -> Option<()> {
    let mut socket = TcpStream::connect(service).await.ok()?;
    let request = format!("GET {path} HTTP/1.1\r\nHost: {service}\r\nConnection: close\r\n\r\n");
    socket.write_all(request.as_bytes()).await.ok()?;
    let mut answer = Vec::new();
    socket.read_to_end(&mut answer).await.ok()?;
    answer.starts_with(b"HTTP/1.1 200 ").then_some(())
}

fn asset(service: &Service) -> String {
    let page = service.page("/");
    let from = page.find("/assets/index-").unwrap();
    let name = page[from..].split('"').next().unwrap();
    let kind = std::path::Path::new(name).extension();
    assert_eq!(kind.and_then(std::ffi::OsStr::to_str), Some("js"), "{name}");
    name.to_owned()
}

fn duration() -> Duration {
    let asked = std::env::var("FLEETCAL_HTTP_FLOOD_S").ok();
    Duration::from_secs(asked.map_or(FLOOD_S, |text| text.parse().unwrap()))
}

#[test]
fn probes_are_answered_in_a_flood_of_silent_and_slow_peers() {
    let service = Service::start(&[]);
    // Attackers run beside the probes, not on their threads: a busy attacker delays no probe.
    let attackers = runtime();
    let flood = Arc::new(Flood {
        service: service.http(),
        asset: asset(&service),
        held: Mutex::new(Held::by(service.http())),
        opened: Mutex::new(0),
        stop: CancellationToken::new(),
    });
    let baseline = wait_for_calm(&service);
    let kinds = [
        (Kind::Idle, IDLE),
        (Kind::Unfinished, UNFINISHED),
        (Kind::NeverReading, NEVER_READING),
    ];
    let mut number = 0;
    for (kind, count) in kinds {
        for _ in 0..count {
            attackers.spawn(Arc::clone(&flood).keep(kind, number));
            number += 1;
        }
    }
    let looking = watch(Arc::clone(&flood));
    let [healthz, readyz, control] = probe_for(&flood, duration());
    flood.stop.cancel();
    looking.join().unwrap();
    let after = wait_for("the files' baseline", || {
        let open = files(service.pid());
        (open <= baseline + FILES_BEYOND_BASELINE).then_some(open)
    });
    report(&flood, [&healthz, &readyz, &control], (baseline, after));
    drop(attackers);
    for probed in [&healthz, &readyz] {
        assert_eq!(probed.failed, 0);
        let p99 = probed.quantile(0.99).saturating_sub(control.quantile(0.99));
        assert!(p99 <= PROBE_P99, "{p99:?} beyond the machine's own delay");
    }
    let longest = flood.held.lock().unwrap().longest();
    assert!(longest <= GONE_WITHIN, "{longest:?}");
}

fn runtime() -> tokio::runtime::Runtime {
    let mut builder = tokio::runtime::Builder::new_multi_thread();
    builder.worker_threads(1).enable_all().build().unwrap()
}

/// Counts the files of a service that has answered and waits.
fn wait_for_calm(service: &Service) -> usize {
    assert_eq!(service.status("/readyz", None), 200);
    std::thread::sleep(Duration::from_secs(1));
    files(service.pid())
}

/// Watches the service's sockets until the flood is over.
fn watch(flood: Arc<Flood>) -> std::thread::JoinHandle<()> {
    std::thread::spawn(move || {
        while !flood.stop.is_cancelled() {
            flood.held.lock().unwrap().look();
            std::thread::sleep(LOOK_EVERY);
        }
    })
}

fn probe_for(flood: &Flood, duration: Duration) -> [Probed; 3] {
    let end: Instant = now() + duration;
    let stop = CancellationToken::new();
    let control = control();
    runtime().block_on(async {
        let service = flood.service;
        let probes = [(service, "/healthz"), (service, "/readyz"), (control, "/")];
        let [healthz, readyz, control] =
            probes.map(|(whom, path)| tokio::spawn(probe(whom, path, stop.clone())));
        tokio::time::sleep_until(end.into()).await;
        stop.cancel();
        [
            healthz.await.unwrap(),
            readyz.await.unwrap(),
            control.await.unwrap(),
        ]
    })
}

fn report(flood: &Flood, [healthz, readyz, control]: [&Probed; 3], files: (usize, usize)) {
    let held = flood.held.lock().unwrap();
    let opened = flood.opened.lock().unwrap();
    eprintln!(
        "{IDLE} idle, {UNFINISHED} unfinished, {NEVER_READING} never-reading connections from \
         {ADDRESSES} addresses for {:?}: opened {opened} times, at most {} held at once, the \
         longest for {:.1} s",
        duration(),
        held.most(),
        held.longest().as_secs_f64(),
    );
    let probes = [
        ("/healthz", healthz),
        ("/readyz", readyz),
        ("a server beside it", control),
    ];
    for (name, probed) in probes {
        let ms = |share| probed.quantile(share).as_secs_f64() * 1e3;
        eprintln!(
            "{name}: {} answers, {} failures, p50 {:.1} ms, p99 {:.1} ms, longest {:.1} ms",
            probed.took.len(),
            probed.failed,
            ms(0.5),
            ms(0.99),
            ms(1.0),
        );
    }
    eprintln!("open files: {} before, {} after", files.0, files.1);
}
