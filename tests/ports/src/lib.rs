//! Free ports for tests that start a listener in another process or a library.
//!
//! A port that the system chose for a listener that is closed again is a port that the system may
//! choose again at once, for any connection and any listener on port 0. So these lie outside the
//! system's range for that (32,768 and above on Linux, 49,152 and above elsewhere), and no process
//! returns one twice.

#![expect(clippy::expect_used, reason = "a test that cannot go on fails")]

use std::net::{Ipv4Addr, SocketAddr, TcpListener};
use std::sync::atomic::{AtomicU32, Ordering};

/// First port.
const FIRST: u16 = 20_000;
/// Number of ports.
const COUNT: u32 = 12_000;
/// Distance between the first ports of two processes that started one after the other: more than a
/// test uses.
const APART: u32 = 64;

/// Returned ports of this process.
static RETURNED: AtomicU32 = AtomicU32::new(0);

/// Returns an address of the loopback whose port is free on every address of this machine.
///
/// # Panics
/// When there is none.
#[must_use]
pub fn free_address() -> SocketAddr {
    let first = std::process::id().wrapping_mul(APART);
    (0..COUNT)
        .map(|_| first.wrapping_add(RETURNED.fetch_add(1, Ordering::Relaxed)))
        .filter_map(|place| u16::try_from(place % COUNT).ok())
        .map(|place| FIRST + place)
        .find(|&port| TcpListener::bind((Ipv4Addr::UNSPECIFIED, port)).is_ok())
        .map(|port| SocketAddr::from((Ipv4Addr::LOCALHOST, port)))
        .expect("a free port")
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeSet;

    use super::*;

    #[test]
    fn ports_differ_are_free_and_lie_below_those_of_connections() {
        let ports: BTreeSet<u16> = (0..200).map(|_| free_address().port()).collect();
        assert_eq!(ports.len(), 200);
        assert!(ports.iter().all(|&port| (FIRST..32_768).contains(&port)));
        let taken = TcpListener::bind(free_address()).unwrap();
        let taken = taken.local_addr().unwrap();
        assert!((1..COUNT).all(|_| free_address() != taken));
    }
}
