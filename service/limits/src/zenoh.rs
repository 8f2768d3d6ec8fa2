//! Zenoh sessions of a router, and the memory that they may hold.

use std::time::Duration;

use crate::{ROBOTS_MAX, ZENOH_MESSAGE_BYTES_MAX};

/// Unauthenticated connections to the Zenoh port at once; one more waits.
pub const ZENOH_HANDSHAKES_MAX: usize = ROBOTS_MAX;
/// Time within which a connection to the Zenoh port has authenticated.
pub const ZENOH_HANDSHAKE_TIMEOUT: Duration = Duration::from_secs(3);
/// Zenoh sessions of all peers together. When all places are taken, the owner of the most gives one
/// to a peer that has fewer.
pub const ZENOH_SESSIONS_MAX: usize = ROBOTS_MAX;
/// Default number of Zenoh sessions of one address whose peers have no name: a machine that
/// simulates a fleet, or a small one behind a gateway.
pub const ZENOH_SESSIONS_PER_ADDRESS_DEFAULT: usize = 64;
/// Default number of Zenoh sessions of one name, by password or certificate: a robot's agent, its
/// drivers and tools.
pub const ZENOH_SESSIONS_PER_NAME_DEFAULT: usize = 16;
/// Messages that one session can leave unfinished: one on its reliable channel, one on the other.
pub const ZENOH_UNFINISHED_PER_SESSION_MAX: usize = 2;
/// Bytes of unfinished messages that all sessions of one owner hold by default.
pub const ZENOH_UNFINISHED_BYTES_DEFAULT: usize =
    ZENOH_SESSIONS_PER_ADDRESS_DEFAULT * ZENOH_UNFINISHED_PER_SESSION_MAX * ZENOH_MESSAGE_BYTES_MAX;
/// Part of the memory that the process may use which unfinished messages of all sessions without a
/// name may fill together: one in so many.
pub const ZENOH_UNFINISHED_MEMORY_PART: usize = 2;
/// Part of the free memory that goes at once before Zenoh sessions are closed: one in so many.
pub const ZENOH_SESSION_MEMORY_PART: u64 = 4;
/// Largest memory that a service counts as settled, in quarters of what the process may use.
pub const ZENOH_SESSION_MEMORY_SETTLED_QUARTERS: u64 = 3;
/// Growth of memory for which no session is closed, in bytes: what a request may need for a moment.
pub const ZENOH_SESSION_MEMORY_LEAST_BYTES: u64 = 32 << 20;
/// Owners whose sessions are closed in a row before memory that stays counts as settled.
pub const ZENOH_SESSION_MEMORY_OWNERS_MAX: u32 = 8;
/// Time after which memory counts as settled.
pub const ZENOH_SESSION_MEMORY_RECENT: Duration = Duration::from_millis(500);
/// Time between two measurements of memory, in which one session can fill some 5 MiB.
pub const ZENOH_SESSION_MEMORY_LOOK_EVERY: Duration = Duration::from_millis(5);
/// Sessions that Zenoh opens beyond, so that one can come while its place is still taken by
/// another.
pub const ZENOH_SESSIONS_OPENING_MAX: usize = 256;
/// Log lines about places of Zenoh sessions, an hour.
pub const ZENOH_SESSION_LINES_PER_HOUR_MAX: u32 = 60;
/// Lines that Zenoh itself logs, an hour: peers can make it log at will.
pub const ZENOH_LOG_LINES_PER_HOUR_MAX: u32 = 1_200;
/// Time limit for opening the Zenoh session.
pub const ZENOH_OPEN_TIMEOUT: Duration = Duration::from_secs(10);
/// Time limit for closing it; after that the process ends without.
pub const ZENOH_CLOSE_TIMEOUT: Duration = Duration::from_secs(1);
