//! A recording that is cut in time.

use std::fs::{self, File};
use std::io::BufWriter;
use std::ops::Range;
use std::path::Path;

/// The messages of a recording.
pub struct Recorded {
    messages: Vec<mcap::Message<'static>>,
    first_ns: u64,
    /// Time from the first message to the last, ns.
    pub length_ns: u64,
}

impl Recorded {
    /// Reads a recording.
    pub fn read(path: &Path) -> Self {
        let bytes = fs::read(path).unwrap();
        let messages: Vec<_> = mcap::MessageStream::new(&bytes)
            .unwrap()
            .map(Result::unwrap)
            .collect();
        let times = || messages.iter().map(|message| message.log_time);
        let first_ns = times().min().unwrap();
        Self {
            length_ns: times().max().unwrap() - first_ns,
            first_ns,
            messages,
        }
    }

    /// Writes the messages of a stretch since the first message, ns, as a recording of its own.
    pub fn write(&self, path: &Path, stretch_ns: Range<u64>) {
        let mut writer = mcap::Writer::new(BufWriter::new(File::create(path).unwrap())).unwrap();
        for message in &self.messages {
            if stretch_ns.contains(&(message.log_time - self.first_ns)) {
                writer.write(message).unwrap();
            }
        }
        writer.finish().unwrap();
    }
}
