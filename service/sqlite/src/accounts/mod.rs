//! Users, sessions and tokens: every change with its audit row in one transaction.

mod read;
mod token;
mod user;

use fleetcal_domain::limits;
use fleetcal_store::{Credential, CredentialUse, IdempotencyKey, StoreError};
use sqlx::sqlite::SqliteConnection;

pub(super) use token::write as write_token;
pub(super) use user::write as write_user;

/// Notes when a session or token was used.
pub(super) async fn note_use(
    connection: &mut SqliteConnection,
    used: &CredentialUse,
) -> Result<(), StoreError> {
    let (sql, hash) = match used.credential {
        Credential::Session(hash) => (
            "UPDATE session SET used_ns = max(used_ns, ?1) WHERE sha256 = ?2",
            hash,
        ),
        Credential::Token(hash) => (
            "UPDATE token SET used_ns = max(coalesce(used_ns, ?1), ?1) WHERE sha256 = ?2",
            hash,
        ),
    };
    sqlx::query(sql)
        .bind(used.now_ns)
        .bind(hash.as_bytes())
        .execute(connection)
        .await
        .map_err(StoreError::database("note a use"))?;
    Ok(())
}

/// The number of what the same request made before.
async fn made_before(
    connection: &mut SqliteConnection,
    made: &'static str,
    request: Option<&IdempotencyKey>,
) -> Result<Option<i64>, StoreError> {
    let Some(request) = request else {
        return Ok(None);
    };
    let found: Option<(Vec<u8>, i64)> = sqlx::query_as(
        "SELECT request_sha256, id FROM access_idempotency WHERE made = ?1 AND key = ?2",
    )
    .bind(made)
    .bind(request.key.as_str())
    .fetch_optional(connection)
    .await
    .map_err(StoreError::database("look up an Idempotency-Key"))?;
    match found {
        None => Ok(None),
        Some((sha256, id)) if sha256 == request.request_sha256 => Ok(Some(id)),
        Some(_) => Err(StoreError::KeyReused),
    }
}

/// Keeps what a request made, and forgets what was kept long enough.
async fn note_made(
    connection: &mut SqliteConnection,
    made: &'static str,
    request: Option<&IdempotencyKey>,
    id: i64,
    now_ns: i64,
) -> Result<(), StoreError> {
    let Some(request) = request else {
        return Ok(());
    };
    let kept_ns = i64::try_from(limits::IDEMPOTENCY_KEPT.as_nanos()).unwrap_or(i64::MAX);
    let failed = || StoreError::database("write an Idempotency-Key");
    sqlx::query("DELETE FROM access_idempotency WHERE received_ns < ?1")
        .bind(now_ns.saturating_sub(kept_ns))
        .execute(&mut *connection)
        .await
        .map_err(failed())?;
    sqlx::query(
        "INSERT INTO access_idempotency (made, key, request_sha256, id, received_ns)
         VALUES (?1, ?2, ?3, ?4, ?5)",
    )
    .bind(made)
    .bind(request.key.as_str())
    .bind(request.request_sha256.as_slice())
    .bind(id)
    .bind(now_ns)
    .execute(connection)
    .await
    .map_err(failed())?;
    Ok(())
}

/// How many rows a table has.
async fn count(connection: &mut SqliteConnection, sql: &'static str) -> Result<u32, StoreError> {
    sqlx::query_scalar(sql)
        .fetch_one(connection)
        .await
        .map_err(StoreError::database("count users and tokens"))
}
