//! Records with strace what a process does to a folder, and reads the recording.

use std::collections::HashMap;
use std::fs::File;
use std::io::{BufRead, BufReader};
use std::path::Path;
use std::process::{Command, Stdio};

/// An action of a process.
#[derive(Debug, Clone, PartialEq)]
pub enum Event {
    /// A file was created.
    Create { file: String },
    /// Bytes were written.
    Write {
        file: String,
        offset: usize,
        bytes: Vec<u8>,
    },
    /// A file was truncated or extended.
    Truncate { file: String, length: usize },
    /// All changes of the file before event `begun` are on the disk.
    Sync { file: String, begun: usize },
    /// All changes of the folder's entries before event `begun` are on the disk.
    SyncFolder { begun: usize },
    /// A file was removed.
    Unlink { file: String },
    /// A file was renamed.
    Rename { from: String, to: String },
    /// Bytes were printed.
    Print(Vec<u8>),
}

const CALLS: &str = "trace=openat,pwrite64,write,pwritev,writev,fsync,fdatasync,ftruncate,\
    ?unlink,unlinkat,?rename,?renameat,renameat2,fallocate,?sync_file_range";

/// Returns the reason for which this machine cannot record, in one sentence.
pub fn missing() -> Option<String> {
    let tried = Command::new("strace")
        .args(["-f", "-o", "/dev/null", "true"])
        .output();
    match tried {
        Ok(output) if output.status.success() => None,
        Ok(output) => Some(format!(
            "strace may not trace here, which the power-loss test needs: {}",
            String::from_utf8_lossy(&output.stderr).trim()
        )),
        Err(error) => Some(format!(
            "strace is missing, which the power-loss test needs ({error}): install the package strace"
        )),
    }
}

/// Runs a command and returns its actions on `folder` and its output.
pub fn record(program: &str, arguments: &[&str], folder: &Path) -> Vec<Event> {
    let logs = tempfile::tempdir().unwrap();
    let log = logs.path().join("strace.log");
    let status = Command::new("strace")
        .args([
            "-f",
            "-y",
            "-xx",
            "-s",
            "1048576",
            "-e",
            "signal=none",
            "-e",
            CALLS,
            "-o",
        ])
        .arg(&log)
        .arg(program)
        .args(arguments)
        .stdout(Stdio::null())
        .status()
        .unwrap();
    assert!(status.success(), "{program} under strace: {status}");
    let mut reader = Reader::new(folder);
    for line in BufReader::new(File::open(&log).unwrap()).split(b'\n') {
        reader.read(&String::from_utf8(line.unwrap()).unwrap());
    }
    reader.events
}

struct Reader {
    folder: String,
    events: Vec<Event>,
    /// Calls in progress, by thread: their text, and the number of events before them.
    begun: HashMap<String, (String, usize)>,
    known: Vec<String>,
}

impl Reader {
    fn new(folder: &Path) -> Self {
        Self {
            folder: folder.canonicalize().unwrap().to_str().unwrap().to_owned(),
            events: Vec::new(),
            begun: HashMap::new(),
            known: Vec::new(),
        }
    }

    fn read(&mut self, line: &str) {
        let Some((thread, rest)) = line.split_once(' ') else {
            return;
        };
        let rest = rest.trim_start();
        if let Some(call) = rest.strip_suffix(" <unfinished ...>") {
            let begun = (call.to_owned(), self.events.len());
            self.begun.insert(thread.to_owned(), begun);
            return;
        }
        if let Some(resumed) = rest.strip_prefix("<... ") {
            let (begun, at) = self.begun.remove(thread).unwrap();
            let (_, end) = resumed.split_once(" resumed>").unwrap();
            self.take(&format!("{begun}{end}"), at);
            return;
        }
        let at = self.events.len();
        self.take(rest, at);
    }

    /// Handles a call that has ended and began after `begun` events.
    fn take(&mut self, call: &str, begun: usize) {
        let Some((head, result)) = call.rsplit_once(" = ") else {
            return;
        };
        let Some((name, arguments)) = head.split_once('(') else {
            return;
        };
        if result.starts_with('-') || result.starts_with('?') {
            return;
        }
        let arguments = arguments.trim_end().trim_end_matches(')');
        let words: Vec<&str> = arguments.split(", ").collect();
        match name {
            "openat" => self.opened(&words, arguments),
            "write" if words[0].starts_with("1<") => {
                self.events.push(Event::Print(bytes_of(words[1])));
            }
            "unlink" | "unlinkat" | "rename" | "renameat" | "renameat2" => {
                self.renamed(name, &words);
            }
            _ => self.written(name, &words, result, begun),
        }
    }

    fn opened(&mut self, words: &[&str], arguments: &str) {
        let Some(file) = self.inside(&text_of(words[1])) else {
            return;
        };
        if arguments.contains("O_CREAT") && !self.known.contains(&file) {
            self.known.push(file.clone());
            self.events.push(Event::Create { file: file.clone() });
        }
        if arguments.contains("O_TRUNC") {
            self.events.push(Event::Truncate { file, length: 0 });
        }
    }

    fn renamed(&mut self, name: &str, words: &[&str]) {
        let paths = words.iter().filter(|word| word.starts_with('"'));
        let files: Vec<_> = paths
            .filter_map(|word| self.inside(&text_of(word)))
            .collect();
        if let Some(first) = files.first() {
            self.known.retain(|known| known != first);
        }
        match (name.starts_with("unlink"), files.as_slice()) {
            (true, [file]) => self.events.push(Event::Unlink { file: file.clone() }),
            (false, [from, to]) => {
                self.known.push(to.clone());
                let (from, to) = (from.clone(), to.clone());
                self.events.push(Event::Rename { from, to });
            }
            _ => {}
        }
    }

    /// Handles a call on an open file of the folder, or on the folder.
    fn written(&mut self, name: &str, words: &[&str], result: &str, begun: usize) {
        let Some((_, path)) = words[0].split_once('<') else {
            return;
        };
        let Some((path, "")) = path.split_once('>') else {
            // Of a file that is gone already.
            return;
        };
        let path = unescaped(path);
        if path == self.folder && name.ends_with("sync") {
            self.events.push(Event::SyncFolder { begun });
            return;
        }
        let Some(file) = self.inside(&path) else {
            return;
        };
        let number = |word: &str| word.parse::<usize>().unwrap();
        self.events.push(match name {
            "pwrite64" => {
                let mut bytes = bytes_of(words[1]);
                bytes.truncate(number(result.trim()));
                Event::Write {
                    file,
                    offset: number(words[3]),
                    bytes,
                }
            }
            "ftruncate" => Event::Truncate {
                file,
                length: number(words[1]),
            },
            "fsync" | "fdatasync" => Event::Sync { file, begun },
            // The lock file holds nothing that counts.
            "write" if file.ends_with("lock") => return,
            other => panic!("{other} on {file} is not understood"),
        });
    }

    /// Returns the name of a file of the folder. The index of the log is not data: it is made
    /// again.
    fn inside(&self, path: &str) -> Option<String> {
        let name = path.strip_prefix(&self.folder)?.strip_prefix('/')?;
        let is_data = !name.ends_with("-shm") && !name.ends_with(" (deleted)");
        (!name.contains('/') && is_data).then(|| name.to_owned())
    }
}

/// Parses a string in strace's form with `-xx`.
fn bytes_of(word: &str) -> Vec<u8> {
    let digits = word.trim_start_matches('"').split('"').next().unwrap();
    let bytes = digits.split("\\x").skip(1);
    bytes
        .map(|digits| u8::from_str_radix(digits, 16).unwrap())
        .collect()
}

fn text_of(word: &str) -> String {
    String::from_utf8(bytes_of(word)).unwrap()
}

fn unescaped(path: &str) -> String {
    if path.starts_with("\\x") {
        String::from_utf8(bytes_of(path)).unwrap()
    } else {
        path.to_owned()
    }
}
