//! Rows of users, sessions and tokens.

use async_trait::async_trait;
use fleetcal_domain::access::{
    AccountName, Grant, PasswordHash, Role, SecretHash, SessionSpan, SetupCode, TokenSpan,
};
use fleetcal_model::{TokenId, UserId, Version};
use fleetcal_proto::RobotId;
use fleetcal_store::backend::AccountReader;
use fleetcal_store::{SessionRecord, StoreError, TokenRecord, UserRecord};

use crate::SqlReader;
use crate::query::query;
use crate::row::{column, corrupt, wall_time, wall_time_or_null};
use crate::value::Row;

/// Columns that [`user_of`] reads.
pub(super) const USER: &str = "u.id, u.name, u.role, u.password, u.disabled, u.version, \
                               u.created_ns, u.updated_ns, u.signed_in_ns";
/// Columns that [`token_of`] reads.
pub(super) const TOKEN: &str = "t.id, t.name, t.role, t.robot, t.sha256, t.created_by, \
                                t.created_ns, t.expires_ns, t.revoked_ns, t.used_ns";

#[async_trait]
impl AccountReader for SqlReader {
    async fn users(&self, after: i64, limit: u32) -> Result<Vec<UserRecord>, StoreError> {
        let sql =
            format!(r#"SELECT {USER} FROM "user" AS u WHERE u.id > $1 ORDER BY u.id LIMIT $2"#);
        let rows = query(sql)
            .bind(after)
            .bind(limit)
            .fetch_all(&mut self.connection())
            .await
            .map_err(StoreError::database("read the users"))?;
        rows.iter().map(user_of).collect()
    }

    async fn user(&self, id: UserId) -> Result<Option<UserRecord>, StoreError> {
        let sql = format!(r#"SELECT {USER} FROM "user" AS u WHERE u.id = $1"#);
        let row = query(sql)
            .bind(id.0)
            .fetch_optional(&mut self.connection())
            .await
            .map_err(StoreError::database("read a user"))?;
        row.as_ref().map(user_of).transpose()
    }

    async fn user_named(&self, name: &str) -> Result<Option<UserRecord>, StoreError> {
        let sql = format!(r#"SELECT {USER} FROM "user" AS u WHERE lower(u.name) = lower($1)"#);
        let row = query(sql)
            .bind(name)
            .fetch_optional(&mut self.connection())
            .await
            .map_err(StoreError::database("read a user"))?;
        row.as_ref().map(user_of).transpose()
    }

    async fn tokens(&self, after: i64, limit: u32) -> Result<Vec<TokenRecord>, StoreError> {
        let sql = format!("SELECT {TOKEN} FROM token AS t WHERE t.id > $1 ORDER BY t.id LIMIT $2");
        let rows = query(sql)
            .bind(after)
            .bind(limit)
            .fetch_all(&mut self.connection())
            .await
            .map_err(StoreError::database("read the tokens"))?;
        rows.iter().map(token_of).collect()
    }

    async fn token_of(&self, hash: SecretHash) -> Result<Option<TokenRecord>, StoreError> {
        let sql = format!("SELECT {TOKEN} FROM token AS t WHERE t.sha256 = $1");
        let row = query(sql)
            .bind(hash.as_bytes())
            .fetch_optional(&mut self.connection())
            .await
            .map_err(StoreError::database("read a token"))?;
        let found = row.as_ref().map(token_of).transpose()?;
        Ok(found.filter(|token| token.hash == hash))
    }

    async fn session_of(&self, hash: SecretHash) -> Result<Option<SessionRecord>, StoreError> {
        let sql = format!(
            r#"SELECT {USER}, s.created_ns, s.used_ns, s.sha256
             FROM session AS s JOIN "user" AS u ON u.id = s."user"
             WHERE s.sha256 = $1 AND NOT u.disabled"#
        );
        let row = query(sql)
            .bind(hash.as_bytes())
            .fetch_optional(&mut self.connection())
            .await
            .map_err(StoreError::database("read a session"))?;
        let Some(row) = row else { return Ok(None) };
        if hash_of(&row, "session", 11)? != hash {
            return Ok(None);
        }
        Ok(Some(SessionRecord {
            user: user_of(&row)?,
            span: SessionSpan {
                created_ns: wall_time(&row, "session", 9)?,
                used_ns: wall_time(&row, "session", 10)?,
            },
        }))
    }

    async fn setup_code(&self, hash: SecretHash) -> Result<Option<SetupCode>, StoreError> {
        const TABLE: &str = "setup_code";
        let row = query("SELECT sha256, ends_ns FROM setup_code WHERE sha256 = $1")
            .bind(hash.as_bytes())
            .fetch_optional(&mut self.connection())
            .await
            .map_err(StoreError::database("read a setup code"))?;
        let Some(row) = row else { return Ok(None) };
        let code = SetupCode {
            hash: hash_of(&row, TABLE, 0)?,
            ends_ns: wall_time(&row, TABLE, 1)?,
        };
        Ok((code.hash == hash).then_some(code))
    }
}

/// Reads a user from the columns of [`USER`].
pub(super) fn user_of(row: &Row) -> Result<UserRecord, StoreError> {
    const TABLE: &str = "user";
    let version: i64 = column(row, TABLE, 5)?;
    Ok(UserRecord {
        id: column(row, TABLE, 0).map(UserId)?,
        name: name_of(row, TABLE)?,
        grant: Grant::of_person(role_of(row, TABLE)?).map_err(corrupt(TABLE))?,
        password: PasswordHash::stored(column(row, TABLE, 3)?),
        disabled: column(row, TABLE, 4)?,
        version: Version(u64::try_from(version).map_err(corrupt(TABLE))?),
        created_ns: wall_time(row, TABLE, 6)?,
        updated_ns: wall_time(row, TABLE, 7)?,
        signed_in_ns: wall_time_or_null(row, TABLE, 8)?,
    })
}

/// Reads a token from the columns of [`TOKEN`].
pub(super) fn token_of(row: &Row) -> Result<TokenRecord, StoreError> {
    const TABLE: &str = "token";
    let robot: Option<String> = column(row, TABLE, 3)?;
    let robot = robot
        .map(|id| RobotId::parse(&id).map_err(corrupt(TABLE)))
        .transpose()?;
    Ok(TokenRecord {
        id: column(row, TABLE, 0).map(TokenId)?,
        name: name_of(row, TABLE)?,
        grant: Grant::of_token(role_of(row, TABLE)?, robot).map_err(corrupt(TABLE))?,
        hash: hash_of(row, TABLE, 4)?,
        created_by: column(row, TABLE, 5)?,
        span: TokenSpan {
            created_ns: wall_time(row, TABLE, 6)?,
            expires_ns: wall_time_or_null(row, TABLE, 7)?,
            revoked_ns: wall_time_or_null(row, TABLE, 8)?,
        },
        used_ns: wall_time_or_null(row, TABLE, 9)?,
    })
}

fn name_of(row: &Row, table: &'static str) -> Result<AccountName, StoreError> {
    let name: String = column(row, table, 1)?;
    AccountName::parse(&name).map_err(corrupt(table))
}

fn role_of(row: &Row, table: &'static str) -> Result<Role, StoreError> {
    let role: String = column(row, table, 2)?;
    let unknown = || corrupt(table)(format!("role {role:?} is unknown"));
    Role::parse(&role).ok_or_else(unknown)
}

fn hash_of(row: &Row, table: &'static str, index: usize) -> Result<SecretHash, StoreError> {
    let bytes: Vec<u8> = column(row, table, index)?;
    SecretHash::stored(&bytes).ok_or_else(|| corrupt(table)("a hash has not 32 bytes"))
}
