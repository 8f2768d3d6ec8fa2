//! The SQLite databases of `rosbag2`: tables `topics` and `messages`, with messages in CDR that may
//! be packed with zstd one by one.

use std::borrow::Cow;
use std::io::Read as _;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::mpsc::{Receiver, SyncSender, sync_channel};

use fleetcal_proto::Encoding;
use futures::TryStreamExt as _;
use sqlx::sqlite::{SqliteConnectOptions, SqliteRow};
use sqlx::{ConnectOptions as _, Row as _, SqliteConnection};

use super::recorded_message::RecordedMessage;
use super::scan::Found;
use super::storage::ZSTD_MAGIC;
use super::{CHANNELS_MAX, Channel, RECORD_BYTES_MAX, RecordingError, normalised_type};

/// Messages that are read ahead.
const READ_AHEAD_MAX: usize = 8;
/// Rows that SQLite's thread reads ahead.
const ROWS_AHEAD_MAX: usize = 4;

/// Query for real tables alone: a view of the file's own could run for ever. A file cannot hide
/// this table.
const TABLES: &str = "SELECT COUNT(*) FROM sqlite_schema WHERE type = 'table' AND rootpage > 0 \
     AND name IN ('topics', 'messages')";
/// Query for computed columns; `rosbag2` has none.
const COMPUTED: &str = "SELECT (SELECT COUNT(*) FROM pragma_table_xinfo('messages') WHERE hidden <> 0) \
     + (SELECT COUNT(*) FROM pragma_table_xinfo('topics') WHERE hidden <> 0)";
/// Query for topics, at most one more than [`CHANNELS_MAX`].
const TOPICS: &str = "SELECT name, type, serialization_format, coalesce(n, 0) AS count FROM topics \
     LEFT JOIN (SELECT topic_id, COUNT(*) AS n FROM messages GROUP BY topic_id) \
     ON topic_id = topics.id ORDER BY name LIMIT ?";
const TIMES: &str = "SELECT MIN(timestamp), MAX(timestamp) FROM messages";
/// Query for messages. Data larger than [`RECORD_BYTES_MAX`] come as NULL, which is refused.
const MESSAGES: &str = "SELECT timestamp, name, iif(length(data) <= ?, data, NULL) AS data \
     FROM messages \
     JOIN topics ON topics.id = topic_id \
     WHERE name IN (SELECT value FROM json_each(?)) ORDER BY timestamp, messages.id";

/// Reads a database from end to end, checks it and counts its messages.
pub(super) fn read_through(path: &Path) -> Result<Found, RecordingError> {
    let refused = |error: sqlx::Error| refused(path, &error);
    on_runtime(path, async {
        let mut connection = open(path).await.map_err(refused)?;
        let tables: i64 = sqlx::query_scalar(TABLES)
            .fetch_one(&mut connection)
            .await
            .map_err(refused)?;
        let computed: i64 = sqlx::query_scalar(COMPUTED)
            .fetch_one(&mut connection)
            .await
            .map_err(refused)?;
        if (tables, computed) != (2, 0) {
            let reason = "it does not have the tables topics and messages of rosbag2";
            return Err(damaged(path, reason));
        }
        let check: String = sqlx::query_scalar("PRAGMA quick_check(1)")
            .fetch_one(&mut connection)
            .await
            .map_err(refused)?;
        if check != "ok" {
            return Err(damaged(path, &check));
        }
        let most = i64::try_from(CHANNELS_MAX).unwrap_or(i64::MAX);
        let topics = sqlx::query(TOPICS).bind(most.saturating_add(1));
        let topics = topics.fetch_all(&mut connection).await.map_err(refused)?;
        if topics.len() > CHANNELS_MAX {
            return Err(RecordingError::TooManyChannels {
                path: path.to_owned(),
                limit: CHANNELS_MAX,
            });
        }
        let channels: Result<Vec<Channel>, _> = topics.iter().map(channel).collect();
        let mut channels = channels.map_err(refused)?;
        channels.retain(|channel| channel.count > 0);
        if channels.is_empty() {
            return Ok(Found::default());
        }
        let times: (i64, i64) = sqlx::query_as(TIMES)
            .fetch_one(&mut connection)
            .await
            .map_err(refused)?;
        Ok(Found {
            channels,
            start_ns: times.0.max(0).unsigned_abs(),
            end_ns: times.1.max(0).unsigned_abs(),
            disorder_ns: 0,
        })
    })
}

fn channel(row: &SqliteRow) -> Result<Channel, sqlx::Error> {
    let encoding = match row.try_get("serialization_format")? {
        "cdr" => Some(Encoding::Cdr),
        _ => None,
    };
    let count: i64 = row.try_get("count")?;
    Ok(Channel {
        topic: row.try_get("name")?,
        message_type: normalised_type(row.try_get("type")?),
        encoding,
        count: count.max(0).unsigned_abs(),
    })
}

/// Messages of some topics by their log times, read on a thread of their own.
#[derive(Debug)]
pub(super) struct BagMessages(Receiver<Result<RecordedMessage, RecordingError>>);

impl BagMessages {
    /// Begins reading.
    pub(super) fn open(path: &Path, topics: &[Arc<str>]) -> Result<Self, RecordingError> {
        let (sender, receiver) = sync_channel(READ_AHEAD_MAX);
        let (path, topics) = (path.to_owned(), topics.to_vec());
        let io = |source| RecordingError::Io {
            path: path.clone(),
            source,
        };
        std::thread::Builder::new()
            .name("rosbag2".to_owned())
            .spawn({
                let path = path.clone();
                move || send(&path, &topics, &sender)
            })
            .map_err(io)?;
        Ok(Self(receiver))
    }
}

impl Iterator for BagMessages {
    type Item = Result<RecordedMessage, RecordingError>;

    fn next(&mut self) -> Option<Self::Item> {
        self.0.recv().ok()
    }
}

/// Sends all messages, and the error that ends them early. The receiver may be dropped at any time.
fn send(
    path: &Path,
    topics: &[Arc<str>],
    sender: &SyncSender<Result<RecordedMessage, RecordingError>>,
) {
    let sending = on_runtime(path, async {
        let refused = |error: sqlx::Error| refused(path, &error);
        let mut connection = open(path).await.map_err(refused)?;
        let names: Vec<&str> = topics.iter().map(|topic| &**topic).collect();
        let names = serde_json::Value::from(names).to_string();
        let most = i64::try_from(RECORD_BYTES_MAX).unwrap_or(i64::MAX);
        let query = sqlx::query(MESSAGES).bind(most).bind(names);
        let mut rows = query.fetch(&mut connection);
        while let Some(row) = rows.try_next().await.map_err(refused)? {
            let message = message(path, topics, &row)?;
            if sender.send(Ok(message)).is_err() {
                break;
            }
        }
        Ok(())
    });
    if let Err(error) = sending {
        drop(sender.send(Err(error)));
    }
}

fn message(
    path: &Path,
    topics: &[Arc<str>],
    row: &SqliteRow,
) -> Result<RecordedMessage, RecordingError> {
    let refused = |error: sqlx::Error| refused(path, &error);
    let log_time_ns: i64 = row.try_get("timestamp").map_err(refused)?;
    let name: &str = row.try_get("name").map_err(refused)?;
    let data: &[u8] = row.try_get("data").map_err(refused)?;
    let topic = topics.iter().find(|topic| &***topic == name);
    Ok(RecordedMessage {
        log_time_ns: log_time_ns.max(0).unsigned_abs(),
        topic: topic.map_or_else(|| Arc::from(name), Arc::clone),
        payload: unpacked(data)
            .map_err(|error| damaged(path, &format!("a message of {name}: {error}")))?
            .into_owned(),
    })
}

/// Unpacks a message. CDR never begins like zstd.
fn unpacked(data: &[u8]) -> std::io::Result<Cow<'_, [u8]>> {
    if !data.starts_with(&ZSTD_MAGIC) {
        return Ok(Cow::Borrowed(data));
    }
    let mut message = Vec::new();
    let reader = zstd::Decoder::with_buffer(data)?;
    let limit = RECORD_BYTES_MAX as u64;
    if reader.take(limit + 1).read_to_end(&mut message)? as u64 > limit {
        return Err(std::io::Error::other(format!(
            "unpacked it is larger than {limit} bytes"
        )));
    }
    Ok(Cow::Owned(message))
}

/// Opens a database read-only, without writing to it or beside it.
async fn open(path: &Path) -> Result<SqliteConnection, sqlx::Error> {
    let mut log = path.as_os_str().to_owned();
    log.push("-wal");
    let was_closed = !PathBuf::from(log).exists();
    SqliteConnectOptions::new()
        .filename(path)
        .read_only(true)
        .immutable(was_closed)
        .row_buffer_size(ROWS_AHEAD_MAX)
        .connect()
        .await
}

fn on_runtime<T>(
    path: &Path,
    reading: impl Future<Output = Result<T, RecordingError>>,
) -> Result<T, RecordingError> {
    let runtime = tokio::runtime::Builder::new_current_thread()
        .enable_all()
        .build();
    let io = |source| RecordingError::Io {
        path: path.to_owned(),
        source,
    };
    runtime.map_err(io)?.block_on(reading)
}

fn refused(path: &Path, error: &sqlx::Error) -> RecordingError {
    damaged(path, &error.to_string())
}

fn damaged(path: &Path, reason: &str) -> RecordingError {
    RecordingError::DamagedBag {
        path: path.to_owned(),
        reason: reason.replace('\n', ", "),
    }
}
