//! Events: written once, however often they are sent.

use fleetcal_model::EventId;
use fleetcal_store::backend::{EventWrite, Repetition};
use fleetcal_store::{EventKind, EventRecord, EventSource, NewEvent, StoreError};

use super::connection::Connection;
use super::query::{query, query_scalar};
use super::row::{Keys, column, json, key_of, parsed, robot_id, robot_time, wall_time};
use super::value::Row;

/// Columns that [`event_of`] reads.
const EVENT: &str = "e.id, r.id, e.kind, e.stamp_ns, e.received_ns, e.source, e.author, e.note, \
                     e.details";

/// Writes an event, unless it was written before.
pub(super) async fn write(
    connection: &mut dyn Connection,
    keys: &mut Keys,
    write: &EventWrite,
) -> Result<(), StoreError> {
    let event = &write.event;
    let key = key_of(connection, keys, &event.robot, event.received_ns).await?;
    let before = match write.repetition {
        Repetition::Never => None,
        Repetition::Content | Repetition::Completes => same_content(connection, key, event).await?,
    };
    match (before, write.repetition) {
        (None, _) => add(connection, key, event).await.map(drop),
        (Some(id), Repetition::Completes) => complete(connection, EventId(id), event).await,
        (Some(_), _) => Ok(()),
    }
}

/// Adds an event of the robot with this key; returns its number.
pub(super) async fn add(
    connection: &mut dyn Connection,
    key: i64,
    event: &NewEvent,
) -> Result<i64, StoreError> {
    query_scalar(
        "INSERT INTO robot_event
             (robot, kind, stamp_ns, received_ns, source, author, note, details)
         VALUES ($1, $2, $3, $4, $5, $6, $7, $8) RETURNING id",
    )
    .bind(key)
    .bind(event.kind.as_str())
    .bind(event.stamp_ns.0)
    .bind(event.received_ns.0)
    .bind(event.source.as_str())
    .bind(event.author.as_deref())
    .bind(event.note.as_deref())
    .bind(details_of(event)?)
    .fetch_one(connection)
    .await
    .map_err(StoreError::database("write an event"))
}

/// Returns an event by its number.
pub(super) async fn by_number(
    connection: &mut dyn Connection,
    id: EventId,
) -> Result<Option<EventRecord>, StoreError> {
    let sql = format!(
        "SELECT {EVENT} FROM robot_event AS e JOIN robot AS r ON r.key = e.robot WHERE e.id = $1"
    );
    let found = query(sql)
        .bind(id.0)
        .fetch_optional(connection)
        .await
        .map_err(StoreError::database("read an event"))?;
    found.map(|row| event_of(&row, false)).transpose()
}

fn details_of(event: &NewEvent) -> Result<Option<String>, StoreError> {
    let details = event.details.as_ref();
    details
        .map(|details| json("robot_event", details))
        .transpose()
}

/// Updates the details of an event.
async fn complete(
    connection: &mut dyn Connection,
    id: EventId,
    event: &NewEvent,
) -> Result<(), StoreError> {
    query("UPDATE robot_event SET details = $2 WHERE id = $1")
        .bind(id.0)
        .bind(details_of(event)?)
        .execute(connection)
        .await
        .map_err(StoreError::database("complete an event"))?;
    Ok(())
}

/// Returns the number of the event of the same robot, kind, stamp and note.
async fn same_content(
    connection: &mut dyn Connection,
    key: i64,
    event: &NewEvent,
) -> Result<Option<i64>, StoreError> {
    query_scalar(
        "SELECT id FROM robot_event
         WHERE robot = $1 AND stamp_ns = $2 AND kind = $3
             AND (note = $4 OR (note IS NULL AND $4 IS NULL)) LIMIT 1",
    )
    .bind(key)
    .bind(event.stamp_ns.0)
    .bind(event.kind.as_str())
    .bind(event.note.as_deref())
    .fetch_optional(connection)
    .await
    .map_err(StoreError::database("look up an event"))
}

/// Reads an event from `id, robot, kind, stamp_ns, received_ns, source, author, note, details`.
pub(super) fn event_of(row: &Row, repeated: bool) -> Result<EventRecord, StoreError> {
    const TABLE: &str = "robot_event";
    let kind: String = column(row, TABLE, 2)?;
    let source: String = column(row, TABLE, 5)?;
    let details: Option<String> = column(row, TABLE, 8)?;
    let unknown = |what, name: &str| StoreError::Corrupt {
        table: TABLE,
        reason: format!("{what} {name:?} is unknown"),
    };
    Ok(EventRecord {
        id: column(row, TABLE, 0).map(EventId)?,
        repeated,
        event: NewEvent {
            robot: robot_id(row, TABLE, 1)?,
            kind: EventKind::parse(&kind).ok_or_else(|| unknown("kind", &kind))?,
            stamp_ns: robot_time(row, TABLE, 3)?,
            received_ns: wall_time(row, TABLE, 4)?,
            source: EventSource::parse(&source).ok_or_else(|| unknown("source", &source))?,
            author: column(row, TABLE, 6)?,
            note: column(row, TABLE, 7)?,
            details: details.map(|details| parsed(TABLE, &details)).transpose()?,
        },
    })
}
