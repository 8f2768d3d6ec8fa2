//! Commands beside the service and without it.

use fleetcal_contract::AddUser;
use fleetcal_store::StoreError;
use sqlx::ConnectOptions;

use super::*;
use crate::{Restored, administration, backup, restore};

async fn raw(folder: &Path) -> sqlx::SqliteConnection {
    sqlx::sqlite::SqliteConnectOptions::new()
        .filename(folder.join("fleetcal.db"))
        .connect()
        .await
        .unwrap()
}

#[tokio::test]
async fn administration_works_beside_the_service_and_without_it() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("data");
    let refused = administration(&path).await.unwrap_err();
    assert!(matches!(refused, StoreError::Missing { .. }), "{refused}");
    assert!(!path.exists());
    open(&path, &clock()).await.close().await.unwrap();
    let mut alone = administration(&path).await.unwrap();
    alone.transact(AddUser("ann")).await.unwrap();
    alone.close().await.unwrap();
    let store = open(&path, &clock()).await;
    let mut beside = administration(&path).await.unwrap();
    beside.transact(AddUser("ci")).await.unwrap();
    assert_eq!(beside.users().await.unwrap().len(), 2);
    beside.close().await.unwrap();
    assert_eq!(store.users(0, 10).await.unwrap().len(), 2);
    store.transact(AddUser("bob")).await.unwrap();
    let users = store.users(2, 10).await.unwrap();
    assert_eq!(users.first().map(|user| user.name.as_str()), Some("bob"));
}

#[tokio::test]
async fn a_service_of_another_schema_is_left_alone() {
    let folder = tempfile::tempdir().unwrap();
    let store = open(folder.path(), &clock()).await;
    sqlx::query(
        "INSERT INTO _sqlx_migrations (version, description, success, checksum, execution_time)
         VALUES (99991231235959, 'later', TRUE, x'00', 0)",
    )
    .execute(&mut raw(folder.path()).await)
    .await
    .unwrap();
    let refused = administration(folder.path()).await.unwrap_err();
    assert!(
        matches!(refused, StoreError::OtherSchema { .. }),
        "{refused}"
    );
    drop(store);
}

#[tokio::test]
async fn a_backup_is_whole_private_and_replaces_an_earlier_one() {
    let folder = tempfile::tempdir().unwrap();
    let store = open(folder.path(), &clock()).await;
    let to = folder.path().join("backup.db");
    std::fs::write(folder.path().join("backup.db.tmp"), "left behind").unwrap();
    for admin in ["a", "b"] {
        store.transact(AddUser(admin)).await.unwrap();
        backup(folder.path(), &to).await.unwrap();
    }
    let mut copy = sqlx::sqlite::SqliteConnectOptions::new()
        .filename(&to)
        .connect()
        .await
        .unwrap();
    let users: i64 = sqlx::query_scalar("SELECT count(*) FROM user")
        .fetch_one(&mut copy)
        .await
        .unwrap();
    assert_eq!(users, 2);
    let missing = backup(&folder.path().join("none"), &to).await.unwrap_err();
    assert!(matches!(missing, StoreError::Missing { .. }), "{missing}");
    let nowhere = folder.path().join("no/such/backup.db");
    let refused = backup(folder.path(), &nowhere).await.unwrap_err();
    assert!(matches!(refused, StoreError::Backup { .. }), "{refused}");
}

#[tokio::test]
async fn a_backup_is_restored_with_its_key_into_an_empty_folder_alone() {
    let folder = tempfile::tempdir().unwrap();
    let [old, new, to] = ["old", "new", "backup.db"].map(|name| folder.path().join(name));
    let store = open(&old, &clock()).await;
    store.transact(AddUser("ann")).await.unwrap();
    backup(&old, &to).await.unwrap();
    let key = folder.path().join("signing.key");
    std::fs::write(&key, [7; 32]).unwrap();
    let changes = folder.path().join("signing.key.changes");
    std::fs::write(&changes, "changes").unwrap();
    let restored = restore(&to, Some(&key), &new).await.unwrap();
    let whole = Restored {
        robots: 0,
        has_key: true,
    };
    assert_eq!(restored, whole);
    let restored = std::fs::read_to_string(new.join("signing.key.changes"));
    assert_eq!(restored.unwrap(), "changes");
    let again = open(&new, &clock()).await;
    assert_eq!(again.users(0, 10).await.unwrap().len(), 1);
    // The folder of a running service, and one that has a database.
    let refused = restore(&to, None, &new).await.unwrap_err();
    assert!(matches!(refused, StoreError::InUse { .. }), "{refused}");
    again.close().await.unwrap();
    drop(again);
    let refused = restore(&to, None, &new).await.unwrap_err();
    assert!(
        refused.to_string().contains("is a database already"),
        "{refused}"
    );
}

#[tokio::test]
async fn what_is_no_usable_backup_is_refused_and_leaves_nothing() {
    let folder = tempfile::tempdir().unwrap();
    let [old, new, to] = ["old", "new", "backup.db"].map(|name| folder.path().join(name));
    open(&old, &clock()).await.close().await.unwrap();
    backup(&old, &to).await.unwrap();
    let short = folder.path().join("short.key");
    std::fs::write(&short, [7; 31]).unwrap();
    let mut bytes = std::fs::read(&to).unwrap();
    let (text, cut) = (folder.path().join("text"), folder.path().join("cut.db"));
    std::fs::write(&text, "not a database, though long enough to be looked at").unwrap();
    bytes.truncate(bytes.len() / 2);
    std::fs::write(&cut, bytes).unwrap();
    for (from, key, said) in [
        (&text, None, "is not a usable backup"),
        (&cut, None, "cut.db is "),
        (&old, None, "is not a file"),
        (&to, Some(short.as_path()), "31 bytes long, expected"),
    ] {
        let refused = restore(from, key, &new).await.unwrap_err().to_string();
        assert!(refused.contains(said), "{refused}");
        assert!(!new.exists(), "{refused}");
    }
}

#[tokio::test]
async fn a_restoration_that_fails_leaves_no_key_and_can_be_run_again() {
    let folder = tempfile::tempdir().unwrap();
    let [old, new, to] = ["old", "new", "backup.db"].map(|name| folder.path().join(name));
    open(&old, &clock()).await.close().await.unwrap();
    backup(&old, &to).await.unwrap();
    let key = folder.path().join("signing.key");
    std::fs::write(&key, [7; 32]).unwrap();
    // A folder stands where the database would be made.
    std::fs::create_dir_all(new.join("fleetcal.db.tmp")).unwrap();
    assert!(restore(&to, Some(&key), &new).await.is_err());
    assert!(!new.join("signing.key").exists() && !new.join("fleetcal.db").exists());
    std::fs::remove_dir(new.join("fleetcal.db.tmp")).unwrap();
    // As a run leaves it that was killed in its middle.
    std::fs::write(new.join("signing.key"), [7; 32]).unwrap();
    assert!(restore(&to, Some(&key), &new).await.unwrap().has_key);
    // Another key is not replaced.
    let other = folder.path().join("other");
    std::fs::create_dir(&other).unwrap();
    std::fs::write(other.join("signing.key"), [8; 32]).unwrap();
    let refused = restore(&to, Some(&key), &other).await.unwrap_err();
    assert!(refused.to_string().contains("is another key"), "{refused}");
    assert_eq!(std::fs::read(other.join("signing.key")).unwrap(), [8; 32]);
}
