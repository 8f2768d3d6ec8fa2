//! As many threads as Zenoh needs to receive.
//!
//! Zenoh handles a declaration (of a key, a token, a subscriber) on the thread that has read it, under
//! a lock that all sessions share, and for longer the more keys there are. On its own two threads, four
//! sessions that go on declaring leave none to read the other robots' data. It reads the number of
//! threads from the environment alone, and at the start alone, so the process begins again with it.

use std::io;
use std::os::unix::process::CommandExt as _;
use std::process::Command;

use fleetcal_domain::limits::ZENOH_RECEIVING_THREADS;

/// Where Zenoh reads how many threads it has.
const VARIABLE: &str = "ZENOH_RUNTIME";

/// Begins the process again, under the same number, with [`ZENOH_RECEIVING_THREADS`] threads, unless
/// the environment says how many there are.
///
/// # Errors
/// Returns only when it did not begin again: with the reason, or `Ok` when there was no need.
pub fn ensure() -> io::Result<()> {
    if std::env::var_os(VARIABLE).is_some() {
        return Ok(());
    }
    let mut arguments = std::env::args_os();
    let name = arguments.next();
    let mut again = Command::new(std::env::current_exe()?);
    if let Some(name) = name {
        again.arg0(name);
    }
    again.args(arguments);
    again.env(
        VARIABLE,
        format!("(rx:(worker_threads:{ZENOH_RECEIVING_THREADS}))"),
    );
    Err(again.exec())
}
