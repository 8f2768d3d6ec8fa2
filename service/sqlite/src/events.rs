//! Events: written once, however often they are sent.

use fleetcal_domain::access::Actor;
use fleetcal_store::backend::{EventWrite, Repetition};
use fleetcal_store::{AuditEntry, EventRecord, IdempotencyKey, NewEvent, StoreError};
use sqlx::sqlite::SqliteConnection;
use sqlx::{AssertSqlSafe, Row};

use super::audit;
use super::row::{Keys, NS_PER_S, json, key_of};

/// The columns of [`super::read::event_of`].
const EVENT: &str = "e.id, r.id, e.kind, e.stamp_ns, e.received_ns, e.source, e.author, e.note, \
                     e.details";

/// Writes an event, unless it was written before.
pub(super) async fn write(
    connection: &mut SqliteConnection,
    keys: &mut Keys,
    write: &EventWrite,
) -> Result<EventRecord, StoreError> {
    let event = &write.event;
    let failed = || StoreError::database("write an event");
    let key = key_of(connection, keys, &event.robot, event.received_ns).await?;
    let before = match &write.repetition {
        Repetition::Never => None,
        Repetition::Content => same_content(connection, key, event).await?,
        Repetition::Completes => completed(connection, key, event).await?,
        Repetition::Key(request) => answered_before(connection, event, request).await?,
    };
    if let Some(record) = before {
        return Ok(record);
    }
    let id: i64 = sqlx::query_scalar(
        "INSERT INTO robot_event
             (robot, kind, stamp_ns, received_ns, source, author, note, details)
         VALUES (?1, ?2, ?3, ?4, ?5, ?6, ?7, ?8) RETURNING id",
    )
    .bind(key)
    .bind(event.kind.as_str())
    .bind(event.stamp_ns)
    .bind(event.received_ns)
    .bind(event.source.as_str())
    .bind(event.author.as_deref())
    .bind(event.note.as_deref())
    .bind(details_of(event)?)
    .fetch_one(&mut *connection)
    .await
    .map_err(failed())?;
    if let Repetition::Key(request) = &write.repetition {
        sqlx::query(
            "INSERT INTO idempotency (scope, key, request_sha256, event, received)
             VALUES (?1, ?2, ?3, ?4, ?5)",
        )
        .bind(event.robot.as_str())
        .bind(request.key.as_str())
        .bind(request.request_sha256.as_slice())
        .bind(id)
        .bind(event.received_ns.div_euclid(NS_PER_S))
        .execute(&mut *connection)
        .await
        .map_err(failed())?;
    }
    if let Some(actor) = &write.noted_by {
        audit::append(connection, &entry_of(id, event, actor)).await?;
    }
    Ok(EventRecord {
        id,
        repeated: false,
        event: event.clone(),
    })
}

fn entry_of(id: i64, event: &NewEvent, actor: &Actor) -> AuditEntry {
    let after = serde_json::json!({
        "kind": event.kind.as_str(),
        "stamp_ns": event.stamp_ns,
        "note": event.note,
    });
    AuditEntry {
        at_ns: event.received_ns,
        actor: actor.clone(),
        action: "event.note",
        subject: "event",
        subject_id: id.to_string(),
        robot: Some(event.robot.clone()),
        before: None,
        after: Some(after),
        reason: event.note.clone(),
    }
}

fn details_of(event: &NewEvent) -> Result<Option<String>, StoreError> {
    let details = event.details.as_ref();
    details
        .map(|details| json("robot_event", details))
        .transpose()
}

/// The event that this one says more of, with what it says now.
async fn completed(
    connection: &mut SqliteConnection,
    key: i64,
    event: &NewEvent,
) -> Result<Option<EventRecord>, StoreError> {
    let Some(mut record) = same_content(connection, key, event).await? else {
        return Ok(None);
    };
    sqlx::query("UPDATE robot_event SET details = ?2 WHERE id = ?1")
        .bind(record.id)
        .bind(details_of(event)?)
        .execute(connection)
        .await
        .map_err(StoreError::database("complete an event"))?;
    record.event.details.clone_from(&event.details);
    Ok(Some(record))
}

/// The event that the same request wrote before.
async fn answered_before(
    connection: &mut SqliteConnection,
    event: &NewEvent,
    request: &IdempotencyKey,
) -> Result<Option<EventRecord>, StoreError> {
    let sql = format!(
        "SELECT {EVENT}, i.request_sha256
         FROM idempotency AS i JOIN robot_event AS e ON e.id = i.event
         JOIN robot AS r ON r.key = e.robot
         WHERE i.scope = ?1 AND i.key = ?2"
    );
    let failed = || StoreError::database("look up an Idempotency-Key");
    let found = sqlx::query(AssertSqlSafe(sql))
        .bind(event.robot.as_str())
        .bind(request.key.as_str())
        .fetch_optional(connection)
        .await
        .map_err(failed())?;
    let Some(row) = found else { return Ok(None) };
    let sha256: Vec<u8> = row.try_get(9).map_err(failed())?;
    if sha256 != request.request_sha256 {
        return Err(StoreError::KeyReused);
    }
    super::read::event_of(&row, true).map(Some)
}

/// The event of the same robot, kind, stamp and note.
async fn same_content(
    connection: &mut SqliteConnection,
    key: i64,
    event: &NewEvent,
) -> Result<Option<EventRecord>, StoreError> {
    let sql = format!(
        "SELECT {EVENT} FROM robot_event AS e JOIN robot AS r ON r.key = e.robot
         WHERE e.robot = ?1 AND e.stamp_ns = ?2 AND e.kind = ?3 AND e.note IS ?4 LIMIT 1"
    );
    let found = sqlx::query(AssertSqlSafe(sql))
        .bind(key)
        .bind(event.stamp_ns)
        .bind(event.kind.as_str())
        .bind(event.note.as_deref())
        .fetch_optional(connection)
        .await
        .map_err(StoreError::database("look up an event"))?;
    found
        .map(|row| super::read::event_of(&row, true))
        .transpose()
}
