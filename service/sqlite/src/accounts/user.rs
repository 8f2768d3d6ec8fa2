//! Changes of users and of their sessions.

use fleetcal_domain::access::{
    AccountName, AccountRefused, Grant, PasswordHash, Role, SecretHash, allow_change,
    allow_new_user, allow_set_up, counts_as_admin, ended_before,
};
use fleetcal_domain::limits;
use fleetcal_store::{
    AuditEntry, Expected, IdempotencyKey, StoreError, UserChange, UserEdit, UserRecord, UserWrite,
    Written,
};
use serde_json::{Value, json};
use sqlx::AssertSqlSafe;
use sqlx::sqlite::SqliteConnection;

use super::read::{USER, user_of};
use super::{count, made_before, note_made};
use crate::audit;

/// What `access_idempotency.made` says.
const MADE: &str = "user";

/// Writes a change of a user and its audit row, or refuses and writes nothing.
pub(crate) async fn write(
    connection: &mut SqliteConnection,
    write: &UserWrite,
) -> Result<Written<UserRecord>, StoreError> {
    let record = match &write.change {
        UserChange::Create {
            name,
            grant,
            password,
            key,
        } => return create(connection, write, (name, grant, password), key.as_ref()).await,
        UserChange::SetUp {
            name,
            password,
            session,
        } => set_up(connection, write, (name, password), session).await?,
        UserChange::Edit {
            id,
            expected,
            edit,
            keep,
        } => self::edit(connection, write, (*id, *expected), edit, keep.as_ref()).await?,
        UserChange::Remove { id, expected } => remove(connection, write, *id, *expected).await?,
        UserChange::SignIn {
            id,
            version,
            session,
        } => sign_in(connection, write, (*id, *version), session).await?,
        UserChange::SignOut { session } => sign_out(connection, write, session).await?,
    };
    Ok(Written {
        record,
        repeated: false,
    })
}

async fn create(
    connection: &mut SqliteConnection,
    write: &UserWrite,
    new: (&AccountName, &Grant, &PasswordHash),
    key: Option<&IdempotencyKey>,
) -> Result<Written<UserRecord>, StoreError> {
    if let Some(id) = made_before(connection, MADE, key).await? {
        return Ok(Written {
            record: known(connection, id).await?,
            repeated: true,
        });
    }
    let record = insert(connection, write, new).await?;
    note_made(connection, MADE, key, record.id, write.now_ns).await?;
    append(connection, write, "user.create", None, Some(&record)).await?;
    Ok(Written {
        record,
        repeated: false,
    })
}

async fn insert(
    connection: &mut SqliteConnection,
    write: &UserWrite,
    (name, grant, password): (&AccountName, &Grant, &PasswordHash),
) -> Result<UserRecord, StoreError> {
    let users = count(connection, "SELECT count(*) FROM user").await?;
    let taken: Option<i64> =
        sqlx::query_scalar("SELECT id FROM user WHERE name = ?1 COLLATE NOCASE")
            .bind(name.as_str())
            .fetch_optional(&mut *connection)
            .await
            .map_err(StoreError::database("look up a user's name"))?;
    allow_new_user(users, name, taken.is_some())?;
    let id: i64 = sqlx::query_scalar(
        "INSERT INTO user (name, role, password, created_ns, updated_ns)
         VALUES (?1, ?2, ?3, ?4, ?4) RETURNING id",
    )
    .bind(name.as_str())
    .bind(grant.role().as_str())
    .bind(password.as_str())
    .bind(write.now_ns)
    .fetch_one(&mut *connection)
    .await
    .map_err(StoreError::database("write a user"))?;
    known(connection, id).await
}

async fn set_up(
    connection: &mut SqliteConnection,
    write: &UserWrite,
    (name, password): (&AccountName, &PasswordHash),
    session: &SecretHash,
) -> Result<UserRecord, StoreError> {
    allow_set_up(count(connection, "SELECT count(*) FROM user").await?)?;
    let admin = Grant::of_person(Role::Admin).map_err(|error| StoreError::Corrupt {
        table: "user",
        reason: error.to_string(),
    })?;
    let record = insert(connection, write, (name, &admin, password)).await?;
    begin_session(connection, &record, session, write.now_ns).await?;
    append(connection, write, "user.set_up", None, Some(&record)).await?;
    Ok(record)
}

async fn edit(
    connection: &mut SqliteConnection,
    write: &UserWrite,
    (id, expected): (i64, Expected),
    edit: &UserEdit,
    keep: Option<&SecretHash>,
) -> Result<UserRecord, StoreError> {
    let before = expected_user(connection, id, expected).await?;
    let grant = edit.grant.as_ref().unwrap_or(&before.grant);
    let disabled = edit.disabled.unwrap_or(before.disabled);
    check_admin_stays(connection, &before, counts_as_admin(grant, disabled)).await?;
    let password = edit.password.as_ref().unwrap_or(&before.password);
    sqlx::query(
        "UPDATE user SET role = ?1, disabled = ?2, password = ?3, version = version + 1,
             updated_ns = ?4
         WHERE id = ?5",
    )
    .bind(grant.role().as_str())
    .bind(disabled)
    .bind(password.as_str())
    .bind(write.now_ns)
    .bind(id)
    .execute(&mut *connection)
    .await
    .map_err(StoreError::database("write a user"))?;
    if disabled || edit.password.is_some() {
        sqlx::query("DELETE FROM session WHERE user = ?1 AND (?2 IS NULL OR sha256 <> ?2)")
            .bind(id)
            .bind(keep.map(SecretHash::as_bytes))
            .execute(&mut *connection)
            .await
            .map_err(StoreError::database("end a user's sessions"))?;
    }
    let record = known(connection, id).await?;
    let action = match (&edit.password, &edit.grant, edit.disabled) {
        (Some(_), None, None) => "user.password",
        _ => "user.edit",
    };
    append(connection, write, action, Some(&before), Some(&record)).await?;
    Ok(record)
}

async fn remove(
    connection: &mut SqliteConnection,
    write: &UserWrite,
    id: i64,
    expected: Expected,
) -> Result<UserRecord, StoreError> {
    let before = expected_user(connection, id, expected).await?;
    check_admin_stays(connection, &before, false).await?;
    sqlx::query("DELETE FROM user WHERE id = ?1")
        .bind(id)
        .execute(&mut *connection)
        .await
        .map_err(StoreError::database("remove a user"))?;
    append(connection, write, "user.remove", Some(&before), None).await?;
    Ok(before)
}

async fn sign_in(
    connection: &mut SqliteConnection,
    write: &UserWrite,
    (id, version): (i64, u64),
    session: &SecretHash,
) -> Result<UserRecord, StoreError> {
    // Since the password was compared the user may have been disabled, or have got another one.
    let before = expected_user(connection, id, Expected::Version(version)).await?;
    if before.disabled {
        return Err(AccountRefused::UserUnknown(id).into());
    }
    begin_session(connection, &before, session, write.now_ns).await?;
    append(connection, write, "session.sign_in", None, Some(&before)).await?;
    known(connection, id).await
}

/// A new session; ended ones go, and the oldest of a user who has too many.
async fn begin_session(
    connection: &mut SqliteConnection,
    user: &UserRecord,
    session: &SecretHash,
    now_ns: i64,
) -> Result<(), StoreError> {
    let (created_ns, used_ns) = ended_before(now_ns);
    let failed = || StoreError::database("begin a session");
    sqlx::query(
        "DELETE FROM session WHERE created_ns <= ?1 OR used_ns <= ?2 OR id IN
             (SELECT id FROM session WHERE user = ?3 ORDER BY id DESC LIMIT -1 OFFSET ?4)",
    )
    .bind(created_ns)
    .bind(used_ns)
    .bind(user.id)
    .bind(limits::SESSIONS_PER_USER_MAX - 1)
    .execute(&mut *connection)
    .await
    .map_err(failed())?;
    sqlx::query("INSERT INTO session (sha256, user, created_ns, used_ns) VALUES (?1, ?2, ?3, ?3)")
        .bind(session.as_bytes())
        .bind(user.id)
        .bind(now_ns)
        .execute(&mut *connection)
        .await
        .map_err(failed())?;
    sqlx::query("UPDATE user SET signed_in_ns = ?1 WHERE id = ?2")
        .bind(now_ns)
        .bind(user.id)
        .execute(connection)
        .await
        .map_err(failed())?;
    Ok(())
}

async fn sign_out(
    connection: &mut SqliteConnection,
    write: &UserWrite,
    session: &SecretHash,
) -> Result<UserRecord, StoreError> {
    let failed = || StoreError::database("end a session");
    let user: Option<i64> =
        sqlx::query_scalar("DELETE FROM session WHERE sha256 = ?1 RETURNING user")
            .bind(session.as_bytes())
            .fetch_optional(&mut *connection)
            .await
            .map_err(failed())?;
    let id = user.ok_or(AccountRefused::SessionUnknown)?;
    let record = known(connection, id).await?;
    append(connection, write, "session.sign_out", Some(&record), None).await?;
    Ok(record)
}

/// Refuses what would leave nobody who can administrate.
async fn check_admin_stays(
    connection: &mut SqliteConnection,
    user: &UserRecord,
    stays_admin: bool,
) -> Result<(), StoreError> {
    let sql = "SELECT count(*) FROM user WHERE role = 'admin' AND NOT disabled";
    let admins = count(connection, sql).await?;
    let was_admin = counts_as_admin(&user.grant, user.disabled);
    Ok(allow_change(was_admin, stays_admin, admins)?)
}

async fn expected_user(
    connection: &mut SqliteConnection,
    id: i64,
    expected: Expected,
) -> Result<UserRecord, StoreError> {
    let user = known(connection, id).await?;
    if expected.accepts(user.version) {
        Ok(user)
    } else {
        let found = user.version;
        Err(AccountRefused::VersionConflict { id, found }.into())
    }
}

async fn known(connection: &mut SqliteConnection, id: i64) -> Result<UserRecord, StoreError> {
    let sql = format!("SELECT {USER} FROM user AS u WHERE u.id = ?1");
    let row = sqlx::query(AssertSqlSafe(sql))
        .bind(id)
        .fetch_optional(connection)
        .await
        .map_err(StoreError::database("read a user"))?;
    match row {
        Some(row) => user_of(&row),
        None => Err(AccountRefused::UserUnknown(id).into()),
    }
}

async fn append(
    connection: &mut SqliteConnection,
    write: &UserWrite,
    action: &'static str,
    before: Option<&UserRecord>,
    after: Option<&UserRecord>,
) -> Result<(), StoreError> {
    let subject = after.or(before);
    let entry = AuditEntry {
        at_ns: write.now_ns,
        actor: write.actor.clone(),
        action,
        subject: "user",
        subject_id: subject.map_or_else(String::new, |user| user.id.to_string()),
        robot: None,
        before: before.map(shown),
        after: after.map(shown),
        reason: None,
    };
    audit::append(connection, &entry).await?;
    Ok(())
}

/// A user as the audit shows it: without the password's hash.
fn shown(user: &UserRecord) -> Value {
    json!({
        "name": user.name,
        "role": user.grant.role(),
        "disabled": user.disabled,
        "version": user.version,
    })
}
