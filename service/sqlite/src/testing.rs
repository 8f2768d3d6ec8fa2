//! Access of tests to a database, as another program has it.

use std::path::Path;

use fleetcal_folder::Folder;
use fleetcal_store::StoreError;
use sqlx::{AssertSqlSafe, ConnectOptions as _};

/// Runs statements on the database of a folder, beside the store that may be open.
///
/// # Errors
/// [`StoreError::Database`].
pub async fn execute_for_test(folder: &Path, sql: &str) -> Result<(), StoreError> {
    let failed = || StoreError::database("run the statements of a test");
    let options = super::options(&Folder::database_in(folder));
    let mut connection = options.connect().await.map_err(failed())?;
    let statements = sqlx::raw_sql(AssertSqlSafe(sql.to_owned()));
    statements
        .execute(&mut connection)
        .await
        .map_err(failed())?;
    super::close(connection).await
}
