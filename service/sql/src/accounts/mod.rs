//! Users, sessions and tokens.

mod read;
mod records;

use fleetcal_store::{Credential, CredentialUse, StoreError};

use crate::connection::Connection;
use crate::query::query;

/// Records the use of a session or token.
pub(super) async fn note_use(
    connection: &mut dyn Connection,
    used: &CredentialUse,
) -> Result<(), StoreError> {
    let (sql, hash) = match used.credential {
        Credential::Session(hash) => (
            "UPDATE session SET used_ns = $1 WHERE sha256 = $2 AND used_ns < $1",
            hash,
        ),
        Credential::Token(hash) => (
            "UPDATE token SET used_ns = $1
             WHERE sha256 = $2 AND (used_ns IS NULL OR used_ns < $1)",
            hash,
        ),
    };
    query(sql)
        .bind(used.now.0)
        .bind(hash.as_bytes())
        .execute(connection)
        .await
        .map_err(StoreError::database("note a use"))?;
    Ok(())
}
