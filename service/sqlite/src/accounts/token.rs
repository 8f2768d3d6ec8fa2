//! Changes of tokens.

use fleetcal_domain::access::{AccountName, AccountRefused, Grant, SecretHash, allow_new_token};
use fleetcal_store::{
    AuditEntry, IdempotencyKey, StoreError, TokenChange, TokenRecord, TokenWrite, Written,
};
use serde_json::{Value, json};
use sqlx::AssertSqlSafe;
use sqlx::sqlite::SqliteConnection;

use super::read::{TOKEN, token_of};
use super::{count, made_before, note_made};
use crate::audit;

/// What `access_idempotency.made` says.
const MADE: &str = "token";

/// Writes a change of a token and its audit row, or refuses and writes nothing.
pub(crate) async fn write(
    connection: &mut SqliteConnection,
    write: &TokenWrite,
) -> Result<Written<TokenRecord>, StoreError> {
    match &write.change {
        TokenChange::Create {
            name,
            grant,
            hash,
            expires_ns,
            key,
        } => {
            let new = New {
                name,
                grant,
                hash,
                expires_ns: *expires_ns,
            };
            create(connection, write, &new, key.as_ref()).await
        }
        TokenChange::Revoke { id } => revoke(connection, write, *id).await,
    }
}

/// A token to be made.
struct New<'a> {
    name: &'a AccountName,
    grant: &'a Grant,
    hash: &'a SecretHash,
    expires_ns: Option<i64>,
}

async fn create(
    connection: &mut SqliteConnection,
    write: &TokenWrite,
    new: &New<'_>,
    key: Option<&IdempotencyKey>,
) -> Result<Written<TokenRecord>, StoreError> {
    if let Some(id) = made_before(connection, MADE, key).await? {
        return Ok(Written {
            record: known(connection, id).await?,
            repeated: true,
        });
    }
    let tokens = count(connection, "SELECT count(*) FROM token").await?;
    let taken = is_taken(connection, new.name, write.now_ns).await?;
    allow_new_token(tokens, new.name, taken)?;
    let id: i64 = sqlx::query_scalar(
        "INSERT INTO token (sha256, name, role, robot, created_by, created_ns, expires_ns)
         VALUES (?1, ?2, ?3, ?4, ?5, ?6, ?7) RETURNING id",
    )
    .bind(new.hash.as_bytes())
    .bind(new.name.as_str())
    .bind(new.grant.role().as_str())
    .bind(new.grant.robot().map(fleetcal_proto::RobotId::as_str))
    .bind(write.actor.name.as_str())
    .bind(write.now_ns)
    .bind(new.expires_ns)
    .fetch_one(&mut *connection)
    .await
    .map_err(StoreError::database("write a token"))?;
    note_made(connection, MADE, key, id, write.now_ns).await?;
    let record = known(connection, id).await?;
    append(connection, write, "token.create", None, &record).await?;
    Ok(Written {
        record,
        repeated: false,
    })
}

/// Whether a token that counts has the name.
async fn is_taken(
    connection: &mut SqliteConnection,
    name: &AccountName,
    now_ns: i64,
) -> Result<bool, StoreError> {
    let taken: Option<i64> = sqlx::query_scalar(
        "SELECT id FROM token WHERE name = ?1 COLLATE NOCASE AND revoked_ns IS NULL
         AND (expires_ns IS NULL OR expires_ns > ?2)",
    )
    .bind(name.as_str())
    .bind(now_ns)
    .fetch_optional(connection)
    .await
    .map_err(StoreError::database("look up a token's name"))?;
    Ok(taken.is_some())
}

async fn revoke(
    connection: &mut SqliteConnection,
    write: &TokenWrite,
    id: i64,
) -> Result<Written<TokenRecord>, StoreError> {
    let before = known(connection, id).await?;
    if before.span.revoked_ns.is_some() {
        return Ok(Written {
            record: before,
            repeated: true,
        });
    }
    sqlx::query("UPDATE token SET revoked_ns = ?1 WHERE id = ?2")
        .bind(write.now_ns)
        .bind(id)
        .execute(&mut *connection)
        .await
        .map_err(StoreError::database("revoke a token"))?;
    let record = known(connection, id).await?;
    append(connection, write, "token.revoke", Some(&before), &record).await?;
    Ok(Written {
        record,
        repeated: false,
    })
}

async fn known(connection: &mut SqliteConnection, id: i64) -> Result<TokenRecord, StoreError> {
    let sql = format!("SELECT {TOKEN} FROM token AS t WHERE t.id = ?1");
    let row = sqlx::query(AssertSqlSafe(sql))
        .bind(id)
        .fetch_optional(connection)
        .await
        .map_err(StoreError::database("read a token"))?;
    match row {
        Some(row) => token_of(&row),
        None => Err(AccountRefused::TokenUnknown(id).into()),
    }
}

async fn append(
    connection: &mut SqliteConnection,
    write: &TokenWrite,
    action: &'static str,
    before: Option<&TokenRecord>,
    after: &TokenRecord,
) -> Result<(), StoreError> {
    let entry = AuditEntry {
        at_ns: write.now_ns,
        actor: write.actor.clone(),
        action,
        subject: "token",
        subject_id: after.id.to_string(),
        robot: after.grant.robot().cloned(),
        before: before.map(shown),
        after: Some(shown(after)),
        reason: None,
    };
    audit::append(connection, &entry).await?;
    Ok(())
}

/// A token as the audit shows it: without its hash.
fn shown(token: &TokenRecord) -> Value {
    json!({
        "name": token.name,
        "role": token.grant.role(),
        "robot": token.grant.robot(),
        "expires_ns": token.span.expires_ns,
        "revoked_ns": token.span.revoked_ns,
    })
}
