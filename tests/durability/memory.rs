//! A service that has 256 MiB of memory, by a control group of the kernel: `make hardening-process`.

use std::fs;
use std::net::{IpAddr, Ipv4Addr, SocketAddr};
use std::path::{Path, PathBuf};
use std::time::Duration;

use fleetcal_domain::limits::ZENOH_SESSIONS_PER_ADDRESS_DEFAULT;
use fleetcal_tests::service::{Service, now, wait_for};

use crate::durability::lifecycle::{Fleet, received};
use crate::zenoh::raw_peer::{Channel, RawPeer};

const MEMORY_BYTES: u64 = 256 << 20;
/// Robots of the nominal load, and its duration, s.
const ROBOTS: usize = 50;
const DRIVE_S: u64 = 60;
/// Addresses that begin messages and never end them.
const ADDRESSES: u8 = 3;
/// Number of fragments of such a message, and the bytes of one: close to the largest message.
const LONG: (u64, usize) = (40, 48_000);
/// Counter of sessions closed for want of memory.
const CLOSED: &str = "fleetcal_zenoh_sessions_closed_total{reason=\"memory\"}";
/// Fragments of one byte that one session sends: each keeps a receiving buffer of 48 KiB.
const SHORT: u64 = 200_000;
/// Time for which these sessions go on.
const ATTACKED_FOR: Duration = Duration::from_secs(3);

/// A control group with a limit of memory, removed with the test.
struct Limited {
    group: PathBuf,
    /// Former group of this process.
    home: PathBuf,
}

impl Limited {
    /// Makes a group of version 1 or 2, whichever the machine has.
    fn new() -> Self {
        let of_first = Path::new("/sys/fs/cgroup/memory");
        let (root, limit, controller) = if of_first.is_dir() {
            (of_first, "memory.limit_in_bytes", "memory")
        } else {
            (Path::new("/sys/fs/cgroup"), "memory.max", "")
        };
        let mine = fs::read_to_string("/proc/self/cgroup").unwrap();
        let path = mine
            .lines()
            .filter_map(|line| line.split_once(':')?.1.split_once(':'))
            .find(|(controllers, _)| *controllers == controller)
            .map(|(_, path)| path.trim_start_matches('/'))
            .unwrap();
        let group = root.join(format!("fleetcal_{}", std::process::id()));
        fs::create_dir(&group)
            .unwrap_or_else(|error| panic!("{}, to be made as root: {error}", group.display()));
        let limited = Self {
            group,
            home: root.join(path),
        };
        fs::write(limited.group.join(limit), MEMORY_BYTES.to_string()).unwrap();
        limited
    }

    fn enter(group: &Path) {
        fs::write(group.join("cgroup.procs"), std::process::id().to_string()).unwrap();
    }

    /// Runs `make` so that the processes it starts belong to the group, and this process does not.
    fn inside<T>(&self, make: impl FnOnce() -> T) -> T {
        Self::enter(&self.group);
        let made = make();
        Self::enter(&self.home);
        made
    }
}

impl Drop for Limited {
    fn drop(&mut self) {
        // Processes that were just killed leave the group a moment later.
        for _ in 0..100 {
            if fs::remove_dir(&self.group).is_ok() {
                return;
            }
            std::thread::sleep(std::time::Duration::from_millis(50));
        }
        eprintln!("{} was not removed", self.group.display());
    }
}

#[test]
#[ignore = "makes a control group, which takes root; make hardening-process"]
fn fifty_robots_are_served_within_256_mib() {
    let limited = Limited::new();
    let names: Vec<String> = (1..=ROBOTS)
        .map(|number| format!("robot_{number:02}"))
        .collect();
    let names: Vec<&str> = names.iter().map(String::as_str).collect();
    let service = limited.inside(|| Service::start(&names));
    let pid = service.pid();
    let fleet = Fleet::drives(&service, ROBOTS, DRIVE_S);
    let mut most = 0;
    wait_for("a minute of driving", || {
        most = most.max(service.memory_bytes());
        (received(&service) >= DRIVE_S * 105).then_some(())
    });
    drop(fleet);
    assert_eq!(service.status("/readyz", None), 200);
    assert_eq!(service.pid(), pid);
    assert_eq!(service.metric(CLOSED), 0);
    println!(
        "{ROBOTS} robots for {DRIVE_S} s within {} MiB: at most {} MiB resident",
        MEMORY_BYTES >> 20,
        most >> 20
    );
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
#[ignore = "makes a control group, which takes root; make hardening-process"]
async fn unfinished_messages_of_several_addresses_leave_a_service_within_256_mib() {
    let limited = Limited::new();
    let service = limited.inside(|| Service::start(&["robot_a"]));
    let pid = service.pid();
    let endpoint = service.endpoint();
    let to: SocketAddr = endpoint.trim_start_matches("tcp/").parse().unwrap();
    let mut peers = Vec::new();
    for number in 0..u128::from(ADDRESSES) * ZENOH_SESSIONS_PER_ADDRESS_DEFAULT as u128 {
        let last = 2 + (number % u128::from(ADDRESSES)) as u8;
        let from = IpAddr::V4(Ipv4Addr::new(127, 0, 0, last));
        // One beyond the share is closed, maybe before it is open.
        let Ok(mut peer) = RawPeer::open(from, to, number + 1).await else {
            continue;
        };
        for is_reliable in [true, false] {
            let channel = Channel {
                is_reliable,
                priority: None,
            };
            drop(peer.begin_message(channel, LONG.0, LONG.1));
        }
        peers.push(peer);
    }
    tokio::time::sleep(ATTACKED_FOR).await;
    println!(
        "{} sessions of {ADDRESSES} addresses: {} MiB resident",
        peers.len(),
        service.memory_bytes() >> 20
    );
    assert!(!peers.is_empty(), "nobody has attacked it");
    assert_eq!(service.status("/readyz", None), 200);
    assert_eq!(service.pid(), pid);
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
#[ignore = "makes a control group, which takes root; make hardening-process"]
async fn fragments_of_one_byte_leave_a_service_within_256_mib() {
    let limited = Limited::new();
    let service = limited.inside(|| Service::start(&["robot_a"]));
    let pid = service.pid();
    let endpoint = service.endpoint();
    let to: SocketAddr = endpoint.trim_start_matches("tcp/").parse().unwrap();
    let begun = now();
    let (mut sent, mut most) = (0, 0);
    for number in 1.. {
        let from = IpAddr::V4(Ipv4Addr::LOCALHOST);
        if let Ok(mut peer) = RawPeer::open(from, to, number).await {
            let channel = Channel {
                is_reliable: true,
                priority: None,
            };
            drop(peer.begin_message(channel, SHORT, 1));
            sent += SHORT;
        }
        most = most.max(service.memory_bytes());
        if begun.elapsed() > ATTACKED_FOR {
            break;
        }
    }
    println!("{sent} fragments of one byte: {} MiB resident", most >> 20);
    assert!(sent >= SHORT, "nobody has attacked it");
    assert_eq!(service.status("/readyz", None), 200);
    assert_eq!(service.pid(), pid);
    assert!(service.metric(CLOSED) > 0, "no session was closed");
}
