//! What libraries read from the environment alone, and at the start alone.
//!
//! Zenoh handles a declaration (of a key, a token, a subscriber) on the thread that has read it, under
//! a lock that all sessions share, and for longer the more keys there are. On its own two threads, four
//! sessions that go on declaring leave none to read the other robots' data.
//!
//! One pool of threads accepts connections, opens them and reads them. The system wakes a thread of the
//! pool in which a connection began; were that another pool, each message would wake two threads. Only
//! what Zenoh opens again after a loss begins in its pool `net`.
//!
//! jemalloc keeps freed pages for 10 s unless told otherwise; at 1 s a flood leaves nothing behind. Its
//! background threads, which see to that while the service is idle, do not work with musl: there pages
//! go back as they are freed.

use std::io;
use std::os::unix::process::CommandExt as _;
use std::process::Command;

use fleetcal_domain::limits::ZENOH_RECEIVING_THREADS;

/// Where Zenoh reads how many threads it has.
const ZENOH: &str = "ZENOH_RUNTIME";
/// Where jemalloc reads when it gives pages back, ms.
const JEMALLOC: (&str, &str) = (
    "_RJEM_MALLOC_CONF",
    if cfg!(target_env = "musl") {
        "dirty_decay_ms:0,muzzy_decay_ms:0"
    } else {
        "dirty_decay_ms:1000,muzzy_decay_ms:0"
    },
);

/// Begins the process again, under the same number, with [`ZENOH_RECEIVING_THREADS`] threads and an
/// allocator that gives memory back soon, unless the environment says otherwise.
///
/// # Errors
/// Returns only when it did not begin again: with the reason, or `Ok` when there was no need.
pub fn ensure() -> io::Result<()> {
    let threads = format!(
        "(app:(worker_threads:{ZENOH_RECEIVING_THREADS}),rx:(handover:app),acc:(handover:app))"
    );
    let mut missing = [(ZENOH, threads.as_str()), JEMALLOC]
        .into_iter()
        .filter(|(variable, _)| std::env::var_os(variable).is_none())
        .peekable();
    if missing.peek().is_none() {
        return Ok(());
    }
    let mut arguments = std::env::args_os();
    let name = arguments.next();
    let mut again = Command::new(std::env::current_exe()?);
    if let Some(name) = name {
        again.arg0(name);
    }
    again.args(arguments).envs(missing);
    Err(again.exec())
}
