//! Settings of a connection to the database.

use sqlx::ConnectOptions;

use crate::options;

#[tokio::test]
async fn a_connection_is_durable_and_keeps_references() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("fleetcal.db");
    let mut connection = options(&path)
        .create_if_missing(true)
        .connect()
        .await
        .unwrap();
    let mut pragma = async |sql: &'static str| -> String {
        sqlx::query_scalar::<_, String>(sql)
            .fetch_one(&mut connection)
            .await
            .unwrap()
    };
    assert_eq!(
        pragma("SELECT journal_mode FROM pragma_journal_mode").await,
        "wal"
    );
    let numbers = "SELECT s.synchronous || ' ' || f.foreign_keys || ' ' || b.timeout
         FROM pragma_synchronous AS s, pragma_foreign_keys AS f, pragma_busy_timeout AS b";
    // 2 is FULL.
    assert_eq!(pragma(numbers).await, "2 1 1500");
}
