//! The messages of a recording in the order in which they were logged.

use std::cmp::Reverse;
use std::collections::{BinaryHeap, VecDeque};
use std::fs::File;
use std::io::BufReader;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use mcap::io::MessageReader;

use super::bag::BagMessages;
use super::recorded_message::RecordedMessage;
use super::scan::{Reading, open_reader};
use super::storage::{Kind, Storage};
use super::{HELD_BYTES_MAX, RecordingError};

/// Iterator over the messages of some topics in the order of their log times.
///
/// It holds back as many as the recording's own disorder requires: later messages of the file never
/// precede one that it has returned.
pub struct Messages {
    path: PathBuf,
    /// Files that are still to be read, the present one first. They are held, so that an unpacked
    /// file stays while it is read.
    storages: VecDeque<Storage>,
    topics: Vec<Arc<str>>,
    /// Reader of the first of them.
    reader: Option<Reader>,
    disorder_ns: u64,
    /// Number of messages read from the file.
    place: u64,
    newest_ns: u64,
    held: BinaryHeap<Reverse<Held>>,
    held_bytes: usize,
    ended: bool,
}

/// Reader of a file.
enum Reader {
    /// Reader in the order of the file.
    Mcap(Box<MessageReader<BufReader<File>>>, Reading),
    /// Reader in the order of log times.
    Bag(BagMessages),
}

impl Reader {
    fn open(storage: &Storage, topics: &[Arc<str>]) -> Result<Self, RecordingError> {
        let path = storage.path();
        Ok(match storage.kind {
            Kind::Mcap => Self::Mcap(Box::new(open_reader(path)?), Reading::default()),
            Kind::Sqlite => Self::Bag(BagMessages::open(path, topics)?),
        })
    }

    /// Returns the next message of these topics, and counts the skipped ones.
    fn next(&mut self, path: &Path, topics: &[Arc<str>]) -> Option<Result<Next, RecordingError>> {
        let (reader, reading) = match self {
            Self::Bag(messages) => return Some(messages.next()?.map(Next::Wanted)),
            Self::Mcap(reader, reading) => (reader, reading),
        };
        let message = match reader.next()? {
            Ok(message) => message,
            Err(error) => return Some(Err(reading.refused(path, error))),
        };
        reading.advance(message.log_time);
        let wanted = |topic: &&Arc<str>| ***topic == *message.channel.topic;
        let Some(topic) = topics.iter().find(wanted).map(Arc::clone) else {
            return Some(Ok(Next::PassedOver(message.log_time)));
        };
        Some(Ok(Next::Wanted(RecordedMessage {
            log_time_ns: message.log_time,
            topic,
            payload: message.data.into_owned(),
        })))
    }
}

/// Next entry of a file.
enum Next {
    /// A message of a wanted topic.
    Wanted(RecordedMessage),
    /// A message of another topic, logged at this time.
    PassedOver(u64),
}

/// A message on hold, ordered by log time and then by its place in the file.
struct Held {
    place: u64,
    message: RecordedMessage,
}

impl Held {
    fn key(&self) -> (u64, u64) {
        (self.message.log_time_ns, self.place)
    }
}

impl PartialEq for Held {
    fn eq(&self, other: &Self) -> bool {
        self.key() == other.key()
    }
}

impl Eq for Held {}

impl PartialOrd for Held {
    fn partial_cmp(&self, other: &Self) -> Option<std::cmp::Ordering> {
        Some(self.cmp(other))
    }
}

impl Ord for Held {
    fn cmp(&self, other: &Self) -> std::cmp::Ordering {
        self.key().cmp(&other.key())
    }
}

impl std::fmt::Debug for Messages {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let mut shown = f.debug_struct("Messages");
        shown
            .field("path", &self.path)
            .field("topics", &self.topics)
            .finish_non_exhaustive()
    }
}

impl Messages {
    pub(super) fn open(
        path: &Path,
        storages: &[Storage],
        topics: &[&str],
        disorder_ns: u64,
    ) -> Result<Self, RecordingError> {
        let topics: Vec<Arc<str>> = topics.iter().map(|&topic| Arc::from(topic)).collect();
        let open = |first| Reader::open(first, &topics);
        Ok(Self {
            path: path.to_owned(),
            reader: storages.first().map(open).transpose()?,
            storages: storages.iter().cloned().collect(),
            topics,
            disorder_ns,
            place: 0,
            newest_ns: 0,
            held: BinaryHeap::new(),
            held_bytes: 0,
            ended: false,
        })
    }

    /// Returns the next entry, possibly of the file after one that has ended.
    fn next_in_files(&mut self) -> Option<Result<Next, RecordingError>> {
        loop {
            let path = self.storages.front()?.path();
            if let Some(next) = self.reader.as_mut()?.next(path, &self.topics) {
                return Some(next);
            }
            self.storages.pop_front();
            match Reader::open(self.storages.front()?, &self.topics) {
                Ok(reader) => self.reader = Some(reader),
                Err(error) => return Some(Err(error)),
            }
        }
    }

    /// Reads on in the file until a message can be returned or nothing is left.
    fn read_on(&mut self) -> Result<(), RecordingError> {
        while !self.ended && !self.can_give_out() {
            let Some(next) = self.next_in_files() else {
                self.ended = true;
                return Ok(());
            };
            let message = match next? {
                Next::Wanted(message) => message,
                Next::PassedOver(log_time_ns) => {
                    self.newest_ns = self.newest_ns.max(log_time_ns);
                    continue;
                }
            };
            self.newest_ns = self.newest_ns.max(message.log_time_ns);
            self.place += 1;
            self.held_bytes += message.payload.len();
            if self.held_bytes > HELD_BYTES_MAX {
                let disorder_s = self.disorder_ns as f64 * 1e-9;
                return Err(RecordingError::OutOfOrder {
                    path: self.path.clone(),
                    disorder_s,
                });
            }
            self.held.push(Reverse(Held {
                place: self.place,
                message,
            }));
        }
        Ok(())
    }

    fn can_give_out(&self) -> bool {
        let settled_ns = self.newest_ns.saturating_sub(self.disorder_ns);
        let oldest = self.held.peek();
        oldest.is_some_and(|Reverse(held)| held.message.log_time_ns <= settled_ns)
    }
}

impl Iterator for Messages {
    type Item = Result<RecordedMessage, RecordingError>;

    fn next(&mut self) -> Option<Self::Item> {
        if let Err(error) = self.read_on() {
            self.ended = true;
            self.held.clear();
            return Some(Err(error));
        }
        let Reverse(held) = self.held.pop()?;
        self.held_bytes -= held.message.payload.len();
        Some(Ok(held.message))
    }
}
