//! Users, sessions and tokens in a transaction.

use async_trait::async_trait;
use fleetcal_domain::access::{AccountName, Role, SecretHash, SetupCode};
use fleetcal_model::{RobotId, TokenId, UserId, WallTime};
use fleetcal_store::transaction::{AccountRecords, SessionRecords, TokenRecords};
use fleetcal_store::{StoreError, TokenRecord, UserRecord};

use super::read::{TOKEN, USER, token_of, user_of};
use crate::query::{query, query_scalar};
use crate::transaction::SqlRecords;

#[async_trait]
impl AccountRecords for SqlRecords<'_> {
    async fn count_users(&mut self) -> Result<u32, StoreError> {
        query_scalar(r#"SELECT count(*) FROM "user""#)
            .fetch_one(&mut *self.connection)
            .await
            .map_err(StoreError::database("count the users"))
    }

    async fn count_admins(&mut self) -> Result<u32, StoreError> {
        query_scalar(r#"SELECT count(*) FROM "user" WHERE role = $1 AND NOT disabled"#)
            .bind(Role::Admin.as_str())
            .fetch_one(&mut *self.connection)
            .await
            .map_err(StoreError::database("count the administrators"))
    }

    async fn user(&mut self, id: UserId) -> Result<Option<UserRecord>, StoreError> {
        let sql = format!(r#"SELECT {USER} FROM "user" AS u WHERE u.id = $1"#);
        let row = query(sql)
            .bind(id.0)
            .fetch_optional(&mut *self.connection)
            .await
            .map_err(StoreError::database("read a user"))?;
        row.as_ref().map(user_of).transpose()
    }

    async fn user_named(&mut self, name: &AccountName) -> Result<Option<UserRecord>, StoreError> {
        let sql = format!(r#"SELECT {USER} FROM "user" AS u WHERE lower(u.name) = lower($1)"#);
        let row = query(sql)
            .bind(name.as_str())
            .fetch_optional(&mut *self.connection)
            .await
            .map_err(StoreError::database("look up a user's name"))?;
        row.as_ref().map(user_of).transpose()
    }

    async fn add_user(&mut self, user: &UserRecord) -> Result<UserId, StoreError> {
        query_scalar(
            r#"INSERT INTO "user" (name, role, password, disabled, version, created_ns, updated_ns,
                 signed_in_ns)
             VALUES ($1, $2, $3, $4, $5, $6, $7, $8) RETURNING id"#,
        )
        .bind(user.name.as_str())
        .bind(user.grant.role().as_str())
        .bind(user.password.as_str())
        .bind(user.disabled)
        .bind(user.version.0 as i64)
        .bind(user.created_ns.0)
        .bind(user.updated_ns.0)
        .bind(user.signed_in_ns.map(|at| at.0))
        .fetch_one(&mut *self.connection)
        .await
        .map_err(StoreError::database("write a user"))
        .map(UserId)
    }

    async fn save_user(&mut self, user: &UserRecord) -> Result<(), StoreError> {
        query(
            r#"UPDATE "user" SET role = $2, password = $3, disabled = $4, version = $5,
                 updated_ns = $6, signed_in_ns = $7
             WHERE id = $1"#,
        )
        .bind(user.id.0)
        .bind(user.grant.role().as_str())
        .bind(user.password.as_str())
        .bind(user.disabled)
        .bind(user.version.0 as i64)
        .bind(user.updated_ns.0)
        .bind(user.signed_in_ns.map(|at| at.0))
        .execute(&mut *self.connection)
        .await
        .map_err(StoreError::database("write a user"))?;
        Ok(())
    }

    async fn delete_user(&mut self, id: UserId) -> Result<(), StoreError> {
        query(r#"DELETE FROM "user" WHERE id = $1"#)
            .bind(id.0)
            .execute(&mut *self.connection)
            .await
            .map_err(StoreError::database("remove a user"))?;
        Ok(())
    }

    async fn add_setup_code(&mut self, code: &SetupCode) -> Result<(), StoreError> {
        query("INSERT INTO setup_code (sha256, ends_ns) VALUES ($1, $2)")
            .bind(code.hash.as_bytes())
            .bind(code.ends_ns.0)
            .execute(&mut *self.connection)
            .await
            .map_err(StoreError::database("write a setup code"))?;
        Ok(())
    }

    async fn keep_setup_codes(&mut self, kept: u32) -> Result<(), StoreError> {
        query(
            "DELETE FROM setup_code WHERE sha256 NOT IN
                 (SELECT sha256 FROM setup_code ORDER BY ends_ns DESC, sha256 LIMIT $1)",
        )
        .bind(kept)
        .execute(&mut *self.connection)
        .await
        .map_err(StoreError::database("delete old setup codes"))?;
        Ok(())
    }
}

#[async_trait]
impl SessionRecords for SqlRecords<'_> {
    async fn add_session(
        &mut self,
        user: UserId,
        session: &SecretHash,
        now: WallTime,
    ) -> Result<(), StoreError> {
        query(
            r#"INSERT INTO session (sha256, "user", created_ns, used_ns) VALUES ($1, $2, $3, $3)"#,
        )
        .bind(session.as_bytes())
        .bind(user.0)
        .bind(now.0)
        .execute(&mut *self.connection)
        .await
        .map_err(StoreError::database("begin a session"))?;
        Ok(())
    }

    async fn delete_session(&mut self, session: &SecretHash) -> Result<Option<UserId>, StoreError> {
        query_scalar(r#"DELETE FROM session WHERE sha256 = $1 RETURNING "user""#)
            .bind(session.as_bytes())
            .fetch_optional(&mut *self.connection)
            .await
            .map_err(StoreError::database("end a session"))
            .map(|user: Option<i64>| user.map(UserId))
    }

    async fn delete_sessions(
        &mut self,
        user: UserId,
        keep: Option<&SecretHash>,
    ) -> Result<(), StoreError> {
        query(r#"DELETE FROM session WHERE "user" = $1 AND ($2 IS NULL OR sha256 <> $2)"#)
            .bind(user.0)
            .bind(keep.map(SecretHash::as_bytes))
            .execute(&mut *self.connection)
            .await
            .map_err(StoreError::database("end a user's sessions"))?;
        Ok(())
    }

    async fn delete_old_sessions(
        &mut self,
        created_ns: WallTime,
        used_ns: WallTime,
    ) -> Result<(), StoreError> {
        query("DELETE FROM session WHERE created_ns <= $1 OR used_ns <= $2")
            .bind(created_ns.0)
            .bind(used_ns.0)
            .execute(&mut *self.connection)
            .await
            .map_err(StoreError::database("delete sessions that have ended"))?;
        Ok(())
    }

    async fn keep_sessions(&mut self, user: UserId, kept: u32) -> Result<(), StoreError> {
        query(
            r#"DELETE FROM session WHERE "user" = $1 AND id NOT IN
                 (SELECT id FROM session WHERE "user" = $1 ORDER BY id DESC LIMIT $2)"#,
        )
        .bind(user.0)
        .bind(kept)
        .execute(&mut *self.connection)
        .await
        .map_err(StoreError::database("end a user's oldest sessions"))?;
        Ok(())
    }
}

#[async_trait]
impl TokenRecords for SqlRecords<'_> {
    async fn count_tokens(&mut self) -> Result<u32, StoreError> {
        query_scalar("SELECT count(*) FROM token")
            .fetch_one(&mut *self.connection)
            .await
            .map_err(StoreError::database("count the tokens"))
    }

    async fn token(&mut self, id: TokenId) -> Result<Option<TokenRecord>, StoreError> {
        let sql = format!("SELECT {TOKEN} FROM token AS t WHERE t.id = $1");
        let row = query(sql)
            .bind(id.0)
            .fetch_optional(&mut *self.connection)
            .await
            .map_err(StoreError::database("read a token"))?;
        row.as_ref().map(token_of).transpose()
    }

    async fn token_named(
        &mut self,
        name: &AccountName,
        now: WallTime,
    ) -> Result<Option<TokenRecord>, StoreError> {
        let sql = format!(
            "SELECT {TOKEN} FROM token AS t WHERE lower(t.name) = lower($1)
             AND t.revoked_ns IS NULL AND (t.expires_ns IS NULL OR t.expires_ns > $2) LIMIT 1"
        );
        let row = query(sql)
            .bind(name.as_str())
            .bind(now.0)
            .fetch_optional(&mut *self.connection)
            .await
            .map_err(StoreError::database("look up a token's name"))?;
        row.as_ref().map(token_of).transpose()
    }

    async fn add_token(&mut self, token: &TokenRecord) -> Result<TokenId, StoreError> {
        query_scalar(
            "INSERT INTO token (sha256, name, role, robot, created_by, created_ns, expires_ns)
             VALUES ($1, $2, $3, $4, $5, $6, $7) RETURNING id",
        )
        .bind(token.hash.as_bytes())
        .bind(token.name.as_str())
        .bind(token.grant.role().as_str())
        .bind(token.grant.robot().map(RobotId::as_str))
        .bind(token.created_by.as_str())
        .bind(token.span.created_ns.0)
        .bind(token.span.expires_ns.map(|at| at.0))
        .fetch_one(&mut *self.connection)
        .await
        .map_err(StoreError::database("write a token"))
        .map(TokenId)
    }

    async fn save_token_revoked(
        &mut self,
        id: TokenId,
        revoked_ns: WallTime,
    ) -> Result<(), StoreError> {
        query("UPDATE token SET revoked_ns = $1 WHERE id = $2")
            .bind(revoked_ns.0)
            .bind(id.0)
            .execute(&mut *self.connection)
            .await
            .map_err(StoreError::database("revoke a token"))?;
        Ok(())
    }
}
