//! What Zenoh and the C library read from the environment alone, and at the start alone.
//!
//! Zenoh handles a declaration (of a key, a token, a subscriber) on the thread that has read it, under
//! a lock that all sessions share, and for longer the more keys there are. On its own two threads, four
//! sessions that go on declaring leave none to read the other robots' data.
//!
//! The GNU allocator maps large blocks on their own and gives them back at once, until the first is
//! freed: from then on it keeps blocks up to that size. A password's hash takes 19 MiB, which would stay.

use std::io;
use std::os::unix::process::CommandExt as _;
use std::process::Command;

use fleetcal_domain::limits::ZENOH_RECEIVING_THREADS;

/// Blocks from this size on are given back when they are freed, bytes; mallopt(3), `M_MMAP_THRESHOLD`.
const GIVEN_BACK_BYTES: usize = 4 << 20;

/// The variables, and what they should be.
fn variables() -> [(&'static str, String); 2] {
    let threads = format!("(rx:(worker_threads:{ZENOH_RECEIVING_THREADS}))");
    [
        ("ZENOH_RUNTIME", threads),
        ("MALLOC_MMAP_THRESHOLD_", GIVEN_BACK_BYTES.to_string()),
    ]
}

/// Starts the process again, under the same number, with each of these variables that is not set.
///
/// # Errors
/// Returns only when it did not start again: with the reason, or `Ok` when there was no need.
pub fn ensure() -> io::Result<()> {
    let missing: Vec<_> = variables()
        .into_iter()
        .filter(|(name, _)| std::env::var_os(name).is_none())
        .collect();
    if missing.is_empty() {
        return Ok(());
    }
    let mut arguments = std::env::args_os();
    let name = arguments.next();
    let mut again = Command::new(std::env::current_exe()?);
    if let Some(name) = name {
        again.arg0(name);
    }
    again.args(arguments);
    again.envs(missing);
    Err(again.exec())
}
