//! Environment variables that libraries read at the start alone.
//!
//! Zenoh handles a declaration (of a key, a token, a subscriber) on the thread that has read it, under
//! a lock that all sessions share, and for longer the more keys there are. On its own two threads, four
//! sessions that go on declaring leave none to read the other robots' data.
//!
//! One pool of threads accepts connections, opens them and reads them. The system wakes a thread of the
//! pool in which a connection began; were that another pool, each message would wake two threads. Only
//! what Zenoh opens again after a loss begins in its pool `net`.
//!
//! Over TLS one thread does all of it: Zenoh 1.10 reads and writes one TLS connection at the same time
//! on two threads, which corrupts memory (eclipse-zenoh/zenoh#2557). A few sessions that go on declaring
//! then keep the others' data waiting, which is better than a process that ends.
//!
//! jemalloc keeps freed pages for 10 s by default, for each of its arenas. Returned at once, a flood
//! leaves nothing behind, and what is resident is what the process holds; it costs 2 % of the CPU time
//! of a robot (`make load` with either value).

use std::ffi::OsString;
use std::io;
use std::os::unix::process::CommandExt as _;
use std::path::Path;
use std::process::Command;

use fleetcal_domain::limits::{ZENOH_CONFIG_BYTES_MAX, ZENOH_RECEIVING_THREADS};

/// Variable from which Zenoh reads its number of threads.
const ZENOH: &str = "ZENOH_RUNTIME";
/// Value for one thread, for connections whose bytes two threads must not share.
const ONE_THREAD: &str =
    "(rx:(worker_threads:1),tx:(handover:rx),acc:(handover:rx),net:(handover:rx))";
/// Prefix of the endpoint of a TLS connection.
const TLS: &[u8] = b"tls/";
/// Variable from which jemalloc reads the delay before it returns pages, and its value, ms.
const JEMALLOC: (&str, &str) = ("_RJEM_MALLOC_CONF", "dirty_decay_ms:0,muzzy_decay_ms:0");

/// Peers of a process.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Peers {
    /// Many sessions that nobody answers for.
    Many,
    /// Its service or router alone.
    One,
}

/// Restarts the process, under the same number, with [`ZENOH_RECEIVING_THREADS`] threads and an
/// allocator that soon returns memory, unless the environment sets them otherwise; with one thread
/// if an argument or a word in `more` names a TLS endpoint, or a file that one of them or
/// `ZENOH_CONFIG` names does.
///
/// # Errors
/// Returns only if it did not restart: with the reason, or `Ok` if there was no need.
pub fn ensure(peers: Peers, more: Vec<OsString>) -> io::Result<()> {
    let words = std::env::args_os().chain(std::env::var_os("ZENOH_CONFIG"));
    let over_tls = speaks_of_tls(words.chain(more));
    let threads = if over_tls {
        Some(ONE_THREAD.to_owned())
    } else {
        (peers == Peers::Many).then(|| {
            let many = ZENOH_RECEIVING_THREADS;
            format!("(app:(worker_threads:{many}),rx:(handover:app),acc:(handover:app))")
        })
    };
    let threads = threads.as_deref().map(|threads| (ZENOH, threads));
    let mut missing = threads
        .into_iter()
        .chain([JEMALLOC])
        .filter(|(variable, _)| std::env::var_os(variable).is_none())
        .peekable();
    if missing.peek().is_none() {
        if over_tls {
            let threads = std::env::var(ZENOH).unwrap_or_default();
            tracing::info!(threads, "connections over TLS: Zenoh has few threads");
        }
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

/// True if a word, or the file that it names, holds the endpoint of a TLS connection. A match for
/// another reason also leads to one thread, which is logged at the start.
fn speaks_of_tls(mut words: impl Iterator<Item = OsString>) -> bool {
    words.any(|word| {
        let has = |bytes: &[u8]| bytes.windows(TLS.len()).any(|part| part == TLS);
        let is_small = |path: &Path| {
            let metadata = path.metadata();
            metadata.is_ok_and(|file| file.is_file() && file.len() <= ZENOH_CONFIG_BYTES_MAX)
        };
        // Also as `--option=FILE` and `-oFILE`.
        let text = word.to_string_lossy();
        let named = text.split_once('=').map_or(&*text, |(_, value)| value);
        let behind_letter = text.strip_prefix('-').and_then(|text| text.get(1..));
        let in_file =
            |path: &Path| is_small(path) && std::fs::read(path).is_ok_and(|bytes| has(&bytes));
        has(word.as_encoded_bytes())
            || in_file(Path::new(named))
            || behind_letter.is_some_and(|path| in_file(Path::new(path)))
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn one_thread_serves_connections_over_tls() {
        let file = tempfile::NamedTempFile::new().unwrap();
        let path = file.path().display();
        let speaks = |words: &[&str]| speaks_of_tls(words.iter().map(OsString::from));
        assert!(speaks(&["serve", "--listen", "tls/0.0.0.0:7447"]));
        assert!(!speaks(&["serve", "--listen", "tcp/0.0.0.0:7447"]));
        let named = [
            path.to_string(),
            format!("--config={path}"),
            format!("-c{path}"),
        ];
        for word in &named {
            assert!(!speaks(&["serve", word]));
        }
        std::fs::write(
            file.path(),
            r#"{ connect: { endpoints: ["tls/r1:7447"] } }"#,
        )
        .unwrap();
        for word in &named {
            assert!(speaks(&["serve", word]));
        }
    }
}
