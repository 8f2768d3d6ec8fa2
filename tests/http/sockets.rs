//! The connections that a process really has, as the system sees them.

use std::collections::HashMap;
use std::fs;
use std::net::SocketAddr;
use std::time::{Duration, Instant};

use fleetcal_tests::service::now;

/// A connection: the peer's address and port, and the inode of the service's socket. A peer may
/// soon reuse a port; the inode then differs.
type Connection = (u32, u16, u64);

/// Start of each connection of a service.
#[derive(Debug)]
pub struct Held {
    port: u16,
    since: HashMap<Connection, Instant>,
    longest: Duration,
    most: usize,
}

impl Held {
    /// Watches a service that listens there.
    pub fn by(service: SocketAddr) -> Self {
        Self {
            port: service.port(),
            since: HashMap::new(),
            longest: Duration::ZERO,
            most: 0,
        }
    }

    /// Looks at the present connections and their ages.
    pub fn look(&mut self) {
        let found = established(self.port);
        let at = now();
        self.since
            .retain(|connection, _| found.contains(connection));
        for connection in &found {
            let since = *self.since.entry(*connection).or_insert(at);
            self.longest = self.longest.max(at - since);
        }
        self.most = self.most.max(found.len());
    }

    /// True if a peer's connection is there.
    pub fn has(&self, peer: SocketAddr) -> bool {
        match peer {
            SocketAddr::V4(peer) => {
                let address = u32::from_ne_bytes(peer.ip().octets());
                let mut held = self.since.keys();
                held.any(|one| (one.0, one.1) == (address, peer.port()))
            }
            SocketAddr::V6(_) => false,
        }
    }

    /// Returns the longest age of any connection.
    pub fn longest(&self) -> Duration {
        self.longest
    }

    /// Returns the most connections at once.
    pub fn most(&self) -> usize {
        self.most
    }
}

/// Returns the established connections on a port that a process has accepted and not closed:
/// proc(5) `net/tcp`. Those that wait to be accepted, or that the process has closed, have no
/// inode.
fn established(port: u16) -> std::collections::BTreeSet<Connection> {
    let table = fs::read_to_string("/proc/net/tcp").unwrap();
    let end = |text: &str| {
        let (address, port) = text.split_once(':').unwrap();
        let address = u32::from_str_radix(address, 16).unwrap();
        (address, u16::from_str_radix(port, 16).unwrap())
    };
    let rows = table.lines().skip(1).filter_map(|line| {
        let fields: Vec<_> = line.split_whitespace().collect();
        let (local, peer) = (end(fields[1]), end(fields[2]));
        let inode: u64 = fields[9].parse().unwrap();
        let is_held = local.1 == port && fields[3] != "0A" && inode != 0;
        is_held.then_some((peer.0, peer.1, inode))
    });
    rows.collect()
}

/// Counts the open files of a process.
pub fn files(pid: u32) -> usize {
    fs::read_dir(format!("/proc/{pid}/fd")).unwrap().count()
}
