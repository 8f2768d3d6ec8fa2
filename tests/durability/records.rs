//! What a database holds of the life cycle, read past the store.

use std::collections::BTreeMap;
use std::path::Path;

use fleetcal_proto::calibration::Envelope;
use serde_json::Value;
use sqlx::sqlite::{SqliteConnectOptions, SqliteConnection};
use sqlx::{Connection, Row as _};

use crate::said::Row;

/// A row of the audit with the record before.
#[derive(Debug, Clone)]
pub struct Audited {
    pub before: Option<Value>,
    pub row: Row,
}

/// Everything that there is of the life cycle.
#[derive(Debug)]
pub struct Records {
    /// What `PRAGMA integrity_check` and `PRAGMA foreign_key_check` complain about.
    pub complaints: Vec<String>,
    /// The audit by robot, oldest first.
    pub audit: BTreeMap<String, Vec<Audited>>,
    /// Proposals, deployments and shadows under their name in the audit.
    pub by_subject: BTreeMap<(String, String), Value>,
    /// Signed documents by robot and generation.
    pub envelopes: BTreeMap<(String, u64), Envelope>,
    /// Revisions' hashes by number.
    pub revisions: BTreeMap<u64, String>,
    /// What waits to be sent: generations by robot and kind.
    pub outbox: BTreeMap<(String, String), u64>,
    /// Entries of the robots' histories by robot and kind.
    pub events: BTreeMap<(String, String), usize>,
}

/// Reads the database of a folder.
///
/// # Errors
/// The database's failure.
pub async fn read(folder: &Path) -> Result<Records, sqlx::Error> {
    let options = SqliteConnectOptions::new().filename(folder.join("fleetcal.db"));
    let mut connection = SqliteConnection::connect_with(&options.read_only(true)).await?;
    let records = Records {
        complaints: complaints(&mut connection).await?,
        audit: audit(&mut connection).await?,
        by_subject: records(&mut connection).await?,
        envelopes: envelopes(&mut connection).await?,
        revisions: revisions(&mut connection).await?,
        outbox: outbox(&mut connection).await?,
        events: events(&mut connection).await?,
    };
    connection.close().await?;
    Ok(records)
}

fn json(text: &str) -> Value {
    serde_json::from_str(text).unwrap_or_else(|error| Value::String(format!("{error}: {text}")))
}

async fn complaints(connection: &mut SqliteConnection) -> Result<Vec<String>, sqlx::Error> {
    let mut found: Vec<String> = sqlx::query_scalar("PRAGMA integrity_check")
        .fetch_all(&mut *connection)
        .await?;
    found.retain(|line| line != "ok");
    let broken = sqlx::query("PRAGMA foreign_key_check").fetch_all(connection);
    let broken = broken.await?.into_iter();
    found.extend(broken.map(|row| format!("a reference of {:?}", row.try_get::<String, _>(0))));
    Ok(found)
}

async fn audit(
    connection: &mut SqliteConnection,
) -> Result<BTreeMap<String, Vec<Audited>>, sqlx::Error> {
    let mut found: BTreeMap<String, Vec<Audited>> = BTreeMap::new();
    let sql = "SELECT robot, action, subject, subject_id, before, after FROM audit ORDER BY id";
    for row in sqlx::query(sql).fetch_all(connection).await? {
        let before: Option<String> = row.try_get(4)?;
        let after: String = row.try_get(5)?;
        let audited = Audited {
            before: before.as_deref().map(json),
            row: Row {
                action: row.try_get(1)?,
                subject: row.try_get(2)?,
                subject_id: row.try_get(3)?,
                after: json(&after),
            },
        };
        found.entry(row.try_get(0)?).or_default().push(audited);
    }
    Ok(found)
}

async fn records(
    connection: &mut SqliteConnection,
) -> Result<BTreeMap<(String, String), Value>, sqlx::Error> {
    let sql = "SELECT 'proposal', CAST(id AS TEXT), record FROM proposal
         UNION ALL SELECT 'deployment', CAST(id AS TEXT), record FROM deployment
         UNION ALL SELECT 'shadow', robot, record FROM shadow";
    let rows = sqlx::query(sql).fetch_all(connection).await?;
    rows.iter()
        .map(|row| {
            let record: String = row.try_get(2)?;
            Ok(((row.try_get(0)?, row.try_get(1)?), json(&record)))
        })
        .collect()
}

async fn envelopes(
    connection: &mut SqliteConnection,
) -> Result<BTreeMap<(String, u64), Envelope>, sqlx::Error> {
    let sql = "SELECT robot, generation, record FROM envelope";
    let mut found = BTreeMap::new();
    for row in sqlx::query(sql).fetch_all(connection).await? {
        let generation: i64 = row.try_get(1)?;
        let record: String = row.try_get(2)?;
        let envelope =
            serde_json::from_str(&record).map_err(|error| sqlx::Error::Decode(Box::new(error)))?;
        found.insert((row.try_get(0)?, generation.unsigned_abs()), envelope);
    }
    Ok(found)
}

async fn revisions(
    connection: &mut SqliteConnection,
) -> Result<BTreeMap<u64, String>, sqlx::Error> {
    let sql = "SELECT id, record ->> '$.sha256' FROM revision";
    let rows = sqlx::query(sql).fetch_all(connection).await?;
    rows.iter()
        .map(|row| {
            let id: i64 = row.try_get(0)?;
            Ok((id.unsigned_abs(), row.try_get(1)?))
        })
        .collect()
}

async fn outbox(
    connection: &mut SqliteConnection,
) -> Result<BTreeMap<(String, String), u64>, sqlx::Error> {
    let sql = "SELECT robot, kind, generation FROM outbox";
    let rows = sqlx::query(sql).fetch_all(connection).await?;
    rows.iter()
        .map(|row| {
            let generation: i64 = row.try_get(2)?;
            Ok((
                (row.try_get(0)?, row.try_get(1)?),
                generation.unsigned_abs(),
            ))
        })
        .collect()
}

async fn events(
    connection: &mut SqliteConnection,
) -> Result<BTreeMap<(String, String), usize>, sqlx::Error> {
    let sql = "SELECT robot.id, kind, count(*) FROM robot_event
         JOIN robot ON robot.key = robot_event.robot GROUP BY 1, 2";
    let rows = sqlx::query(sql).fetch_all(connection).await?;
    rows.iter()
        .map(|row| {
            let count: i64 = row.try_get(2)?;
            let count = usize::try_from(count).unwrap_or(usize::MAX);
            Ok(((row.try_get(0)?, row.try_get(1)?), count))
        })
        .collect()
}
