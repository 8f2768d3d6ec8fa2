//! Records of the life cycle in a database, read past the store.

use std::collections::BTreeMap;

use fleetcal_proto::calibration::Envelope;
use serde_json::Value;
use sqlx::postgres::{PgConnection, PgRow};
use sqlx::sqlite::{SqliteConnectOptions, SqliteConnection, SqliteRow};
use sqlx::{Connection, Row as _};

use crate::durability::place::Place;
use crate::durability::said::Row;

/// A row of the audit with the record before.
#[derive(Debug, Clone)]
pub struct Audited {
    pub before: Option<Value>,
    pub row: Row,
}

/// All records of the life cycle.
#[derive(Debug)]
pub struct Records {
    /// Complaints of `PRAGMA integrity_check` and `PRAGMA foreign_key_check`.
    pub complaints: Vec<String>,
    /// The audit by robot, oldest first.
    pub audit: BTreeMap<String, Vec<Audited>>,
    /// Proposals, deployments and shadows under their name in the audit.
    pub by_subject: BTreeMap<(String, String), Value>,
    /// Signed documents by robot and generation.
    pub envelopes: BTreeMap<(String, u64), Envelope>,
    /// Revisions' hashes by number.
    pub revisions: BTreeMap<u64, String>,
    /// Outbox: generations by robot and kind.
    pub outbox: BTreeMap<(String, String), u64>,
    /// Entries of the robots' histories by robot and kind.
    pub events: BTreeMap<(String, String), usize>,
}

/// Reads a database.
///
/// # Errors
/// The database's failure.
pub async fn read(place: &Place) -> Result<Records, sqlx::Error> {
    let mut reader = Reader::open(place).await?;
    let records = Records {
        complaints: complaints(&mut reader).await?,
        audit: audit(&mut reader).await?,
        by_subject: records(&mut reader).await?,
        envelopes: envelopes(&mut reader).await?,
        revisions: revisions(&mut reader).await?,
        outbox: outbox(&mut reader).await?,
        events: events(&mut reader).await?,
    };
    reader.close().await?;
    Ok(records)
}

/// A row with every column as text.
type Texts = Vec<Option<String>>;

/// A connection that bypasses the store.
enum Reader {
    Sqlite(SqliteConnection),
    Postgres(PgConnection),
}

impl Reader {
    async fn open(place: &Place) -> Result<Self, sqlx::Error> {
        Ok(match place {
            Place::Folder(folder) => {
                let options = SqliteConnectOptions::new().filename(folder.join("fleetcal.db"));
                let options = options.read_only(true);
                Self::Sqlite(SqliteConnection::connect_with(&options).await?)
            }
            Place::Server(setup) => {
                Self::Postgres(PgConnection::connect(&setup.url.to_string()).await?)
            }
        })
    }

    async fn close(self) -> Result<(), sqlx::Error> {
        match self {
            Self::Sqlite(connection) => connection.close().await,
            Self::Postgres(connection) => connection.close().await,
        }
    }

    /// Returns the rows of a query with text columns only.
    async fn texts(&mut self, sql: &'static str) -> Result<Vec<Texts>, sqlx::Error> {
        match self {
            Self::Sqlite(connection) => {
                let rows = sqlx::query(sql).fetch_all(connection).await?;
                let texts = |row: &SqliteRow| (0..row.len()).map(|i| row.try_get(i)).collect();
                rows.iter().map(texts).collect()
            }
            Self::Postgres(connection) => {
                let rows = sqlx::query(sql).fetch_all(connection).await?;
                let texts = |row: &PgRow| (0..row.len()).map(|i| row.try_get(i)).collect();
                rows.iter().map(texts).collect()
            }
        }
    }
}

fn json(text: &str) -> Value {
    serde_json::from_str(text).unwrap_or_else(|error| Value::String(format!("{error}: {text}")))
}

/// Removes and returns a column that is never NULL.
fn text(row: &mut Texts, index: usize) -> String {
    row[index].take().unwrap()
}

fn number(row: &mut Texts, index: usize) -> u64 {
    text(row, index).parse().unwrap()
}

async fn complaints(reader: &mut Reader) -> Result<Vec<String>, sqlx::Error> {
    // PostgreSQL checks references at every commit, and has no such check of its files.
    let Reader::Sqlite(connection) = reader else {
        return Ok(Vec::new());
    };
    let mut found: Vec<String> = sqlx::query_scalar("PRAGMA integrity_check")
        .fetch_all(&mut *connection)
        .await?;
    found.retain(|line| line != "ok");
    let broken = sqlx::query("PRAGMA foreign_key_check").fetch_all(connection);
    let broken = broken.await?.into_iter();
    found.extend(broken.map(|row| format!("a reference of {:?}", row.try_get::<String, _>(0))));
    Ok(found)
}

/// Reads the audit of the life cycle: the deciding process registers its robots, too.
async fn audit(reader: &mut Reader) -> Result<BTreeMap<String, Vec<Audited>>, sqlx::Error> {
    let mut found: BTreeMap<String, Vec<Audited>> = BTreeMap::new();
    let sql = "SELECT robot, action, subject, subject_id, before, after FROM audit
        WHERE subject <> 'robot' ORDER BY id";
    for mut row in reader.texts(sql).await? {
        let audited = Audited {
            before: row[4].as_deref().map(json),
            row: Row {
                action: text(&mut row, 1),
                subject: text(&mut row, 2),
                subject_id: text(&mut row, 3),
                after: json(&text(&mut row, 5)),
            },
        };
        found.entry(text(&mut row, 0)).or_default().push(audited);
    }
    Ok(found)
}

async fn records(reader: &mut Reader) -> Result<BTreeMap<(String, String), Value>, sqlx::Error> {
    let sql = "SELECT 'proposal', CAST(id AS TEXT), record FROM proposal
         UNION ALL SELECT 'deployment', CAST(id AS TEXT), record FROM deployment
         UNION ALL SELECT 'shadow', robot, record FROM shadow";
    let rows = reader.texts(sql).await?.into_iter();
    Ok(rows
        .map(|mut row| {
            let subject = (text(&mut row, 0), text(&mut row, 1));
            (subject, json(&text(&mut row, 2)))
        })
        .collect())
}

async fn envelopes(reader: &mut Reader) -> Result<BTreeMap<(String, u64), Envelope>, sqlx::Error> {
    let sql = "SELECT robot, CAST(generation AS TEXT), record FROM envelope";
    let mut found = BTreeMap::new();
    for mut row in reader.texts(sql).await? {
        let envelope = serde_json::from_str(&text(&mut row, 2))
            .map_err(|error| sqlx::Error::Decode(Box::new(error)))?;
        found.insert((text(&mut row, 0), number(&mut row, 1)), envelope);
    }
    Ok(found)
}

async fn revisions(reader: &mut Reader) -> Result<BTreeMap<u64, String>, sqlx::Error> {
    let sql = "SELECT CAST(id AS TEXT), record FROM revision";
    let rows = reader.texts(sql).await?.into_iter();
    Ok(rows
        .map(|mut row| {
            let record = json(&text(&mut row, 1));
            let sha256 = record["sha256"].as_str().unwrap_or_default().to_owned();
            (number(&mut row, 0), sha256)
        })
        .collect())
}

async fn outbox(reader: &mut Reader) -> Result<BTreeMap<(String, String), u64>, sqlx::Error> {
    let sql = "SELECT robot, kind, CAST(generation AS TEXT) FROM outbox";
    let rows = reader.texts(sql).await?.into_iter();
    Ok(rows
        .map(|mut row| ((text(&mut row, 0), text(&mut row, 1)), number(&mut row, 2)))
        .collect())
}

async fn events(reader: &mut Reader) -> Result<BTreeMap<(String, String), usize>, sqlx::Error> {
    let sql = "SELECT robot.id, kind, CAST(count(*) AS TEXT) FROM robot_event
         JOIN robot ON robot.key = robot_event.robot GROUP BY 1, 2";
    let rows = reader.texts(sql).await?.into_iter();
    Ok(rows
        .map(|mut row| {
            let count = usize::try_from(number(&mut row, 2)).unwrap_or(usize::MAX);
            ((text(&mut row, 0), text(&mut row, 1)), count)
        })
        .collect())
}
