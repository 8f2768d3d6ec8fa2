//! Errors of Zenoh for people: without the places in its sources.
//!
//! Every error of Zenoh ends in ` at PATH.rs:LINE.`, in which PATH is one of the machine that built it.

use std::io::{Result, Write};

/// Separator between Zenoh's message and the place.
const AT: &str = " at ";
/// Ending of a source file, before the line.
const ENDING: &str = ".rs:";

/// Returns a text without the places in sources that Zenoh's errors name in it.
pub fn without_places(text: &str) -> String {
    let mut said = String::with_capacity(text.len());
    let mut rest = text;
    while let Some(ending) = rest.find(ENDING) {
        let (before, line) = rest.split_at(ending);
        let line = line.strip_prefix(ENDING).unwrap_or_default();
        let begins = before.rfind(AT).filter(|&at| {
            let path = before.get(at + AT.len()..).unwrap_or_default();
            path.contains('/') && !path.contains(char::is_whitespace)
        });
        let behind = line.trim_start_matches(|sign: char| sign.is_ascii_digit());
        if let Some(at) = begins {
            said.push_str(before.get(..at).unwrap_or_default());
            rest = behind.strip_prefix('.').unwrap_or(behind);
        } else {
            said.push_str(before);
            said.push_str(ENDING);
            rest = line;
        }
    }
    said.push_str(rest);
    said
}

/// Writer of a log without places in Zenoh's sources. Each line is written at once.
#[derive(Debug)]
pub struct WithoutPlaces<W>(pub W);

impl<W: Write> Write for WithoutPlaces<W> {
    fn write(&mut self, line: &[u8]) -> Result<usize> {
        let text = without_places(&String::from_utf8_lossy(line));
        self.0.write_all(text.as_bytes())?;
        Ok(line.len())
    }

    fn flush(&mut self) -> Result<()> {
        self.0.flush()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn places_in_sources_are_left_out_and_nothing_else() {
        let path = "/home/builder/.cargo/registry/src/index-1949cf8c/zenoh-link-tcp-1.10.2/src";
        let listening = format!(
            "Can not listen: [127.0.0.1:1: Address in use (os error 98) at {path}/tcp.rs:61.] at \
             {path}/unicast.rs:338. - Caused by a peer at {path}/a.rs:7."
        );
        assert_eq!(
            without_places(&listening),
            "Can not listen: [127.0.0.1:1: Address in use (os error 98)] - Caused by a peer"
        );
        for kept in [
            "",
            "robot_a: 1,000 drive samples at 100 Hz",
            "look at main.rs: it is short",
            "got main.rs:12",
            "the mount is at 1.2 m. See docs/mount.rs:",
        ] {
            assert_eq!(without_places(kept), kept);
        }
    }

    #[test]
    fn a_line_of_the_log_is_written_whole() {
        let mut log = WithoutPlaces(Vec::new());
        let line = "WARN zenoh: no at /a/b.rs:388.\n";
        assert_eq!(log.write(line.as_bytes()).unwrap(), line.len());
        assert_eq!(log.0, b"WARN zenoh: no\n");
    }
}
