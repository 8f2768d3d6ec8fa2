//! The first reading of a recording: whether it is whole, and what is in it.

use std::collections::BTreeMap;
use std::collections::btree_map::Entry;
use std::fs::File;
use std::io::BufReader;
use std::path::Path;

use fleetcal_proto::Encoding;
use mcap::io::MessageReader;
use mcap::sans_io::LinearReaderOptions;
use mcap::{McapError, Message};

use super::{CHANNELS_MAX, Channel, RECORD_BYTES_MAX, RecordingError, normalised_type};

/// Result of reading from end to end; a recording without messages has none.
#[derive(Debug, Clone, Default)]
pub(super) struct Found {
    /// Channels in the order of their names.
    pub(super) channels: Vec<Channel>,
    pub(super) start_ns: u64,
    pub(super) end_ns: u64,
    /// Largest lag of a message's log time behind one that precedes it.
    pub(super) disorder_ns: u64,
}

/// Combined content of a recording's files.
#[derive(Debug, Default)]
pub(super) struct Together {
    channels: BTreeMap<(String, String), Channel>,
    start_ns: u64,
    end_ns: u64,
    disorder_ns: u64,
}

impl Together {
    /// Adds the content of the next file. Returns false if there is one topic too many.
    pub(super) fn add(&mut self, next: Found) -> bool {
        if next.channels.is_empty() {
            return true;
        }
        if self.channels.is_empty() {
            (self.start_ns, self.end_ns) = (next.start_ns, next.start_ns);
        }
        let back_ns = self.end_ns.saturating_sub(next.start_ns);
        self.disorder_ns = self.disorder_ns.max(next.disorder_ns).max(back_ns);
        self.start_ns = self.start_ns.min(next.start_ns);
        self.end_ns = self.end_ns.max(next.end_ns);
        for channel in next.channels {
            let key = (channel.topic.clone(), channel.message_type.clone());
            match self.channels.entry(key) {
                Entry::Occupied(mut known) => known.get_mut().count += channel.count,
                Entry::Vacant(place) => {
                    place.insert(channel);
                }
            }
        }
        self.channels.len() <= CHANNELS_MAX
    }

    /// Returns the combined content.
    pub(super) fn finish(self) -> Found {
        Found {
            channels: self.channels.into_values().collect(),
            start_ns: self.start_ns,
            end_ns: self.end_ns,
            disorder_ns: self.disorder_ns,
        }
    }
}

/// Opens an MCAP file to read its messages in the order of the file.
pub(super) fn open_reader(path: &Path) -> Result<MessageReader<BufReader<File>>, RecordingError> {
    let io = |source| RecordingError::Io {
        path: path.to_owned(),
        source,
    };
    let file = File::open(path).map_err(io)?;
    let options = LinearReaderOptions::default()
        .with_validate_chunk_crcs(true)
        .with_validate_data_section_crc(true)
        .with_validate_summary_section_crc(true)
        .with_record_length_limit(RECORD_BYTES_MAX);
    Ok(MessageReader::new_with_options(
        BufReader::new(file),
        options,
    ))
}

/// Reads a file from end to end.
pub(super) fn read_through(path: &Path) -> Result<Found, RecordingError> {
    let mut reading = Reading::default();
    for message in open_reader(path)? {
        let message = message.map_err(|error| reading.refused(path, error))?;
        if !reading.take(&message) {
            let path = path.to_owned();
            return Err(RecordingError::TooManyChannels {
                path,
                limit: CHANNELS_MAX,
            });
        }
    }
    Ok(reading.finish())
}

/// State of reading a file.
#[derive(Debug, Default)]
pub(super) struct Reading {
    messages: u64,
    start_ns: u64,
    end_ns: u64,
    disorder_ns: u64,
    channels: BTreeMap<(String, String), Channel>,
}

impl Reading {
    /// Counts a message. Returns false if it belongs to one topic too many.
    fn take(&mut self, message: &Message<'_>) -> bool {
        self.advance(message.log_time);
        let type_name = message
            .channel
            .schema
            .as_ref()
            .map_or("", |schema| schema.name.as_str());
        let key = (message.channel.topic.clone(), normalised_type(type_name));
        if let Some(channel) = self.channels.get_mut(&key) {
            channel.count += 1;
            return true;
        }
        let encoding = match message.channel.message_encoding.as_str() {
            "cdr" => Some(Encoding::Cdr),
            "json" => Some(Encoding::Json),
            _ => None,
        };
        let (topic, message_type) = key.clone();
        self.channels.insert(
            key,
            Channel {
                topic,
                message_type,
                encoding,
                count: 1,
            },
        );
        self.channels.len() <= CHANNELS_MAX
    }

    /// Updates the range and disorder of log times.
    pub(super) fn advance(&mut self, log_time_ns: u64) {
        if self.messages == 0 {
            (self.start_ns, self.end_ns) = (log_time_ns, log_time_ns);
        }
        self.disorder_ns = self
            .disorder_ns
            .max(self.end_ns.saturating_sub(log_time_ns));
        self.start_ns = self.start_ns.min(log_time_ns);
        self.end_ns = self.end_ns.max(log_time_ns);
        self.messages += 1;
    }

    /// Converts a reader's error to one about the recording.
    pub(super) fn refused(&self, path: &Path, error: McapError) -> RecordingError {
        let path = path.to_owned();
        let readable_s = self.end_ns.saturating_sub(self.start_ns) as f64 * 1e-9;
        let messages = self.messages;
        match error {
            // Errors of a decompressor have no number of the system's.
            McapError::Io(source) if source.raw_os_error().is_some() => {
                RecordingError::Io { path, source }
            }
            McapError::UnexpectedEof | McapError::UnexpectedEoc | McapError::BadMagic => {
                RecordingError::Truncated {
                    path,
                    readable_s,
                    messages,
                }
            }
            error => {
                let source = Box::new(error);
                RecordingError::Damaged {
                    path,
                    readable_s,
                    messages,
                    source,
                }
            }
        }
    }

    fn finish(self) -> Found {
        Found {
            channels: self.channels.into_values().collect(),
            start_ns: self.start_ns,
            end_ns: self.end_ns,
            disorder_ns: self.disorder_ns,
        }
    }
}
