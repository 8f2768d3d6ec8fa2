//! Errors of a store that cannot be opened, and the rights it needs.

use std::error::Error as _;
use std::fs;
use std::sync::Arc;

use async_trait::async_trait;
use fleetcal_contract::{NOW_S, TestDatabase, clock, record};
use fleetcal_postgres::{PostgresSetup, migrate, open};
use fleetcal_store::database_url::PostgresUrl;
use fleetcal_store::{Job, Records, Store, StoreError};

use crate::decision::{Decide, times_decided};
use fleetcal_contract::own_server::{OwnServer, named, psql, setup, url_of};

async fn opened(setup: PostgresSetup) -> Result<Store, StoreError> {
    open(setup, Box::new(()), clock() as _).await
}

/// Asserts that a store cannot be opened, with an error of one line that names everything in
/// `named`.
async fn refused(setup: PostgresSetup, named: &[&str]) {
    let error = opened(setup).await.unwrap_err();
    let mut text = error.to_string();
    let mut source = error.source();
    while let Some(cause) = source {
        text = format!("{text}: {cause}");
        source = cause.source();
    }
    assert!(!text.contains('\n'), "{text}");
    for name in named {
        assert!(text.contains(name), "{name} is not in: {text}");
    }
}

/// Makes a database on the named server.
async fn empty() -> PostgresUrl {
    fleetcal_postgres::create_for_test(&named()).await.unwrap()
}

/// Makes a role on the named server, which may only sign in.
pub fn new_role(name: &str) -> String {
    let role = format!("fleetcal_{name}_{}", std::process::id());
    psql(&named(), &format!("CREATE ROLE {role} LOGIN"));
    role
}

#[tokio::test]
async fn a_server_that_is_not_there_is_named() {
    named();
    let url = url_of(&["127.0.0.1:1", "127.0.0.1:2"], "fleetcal", "site");
    let named = [
        "postgres://fleetcal@127.0.0.1:1,127.0.0.1:2/site",
        "127.0.0.1:1 cannot be reached",
        "127.0.0.1:2 cannot be reached",
    ];
    refused(setup(&url), &named).await;
}

#[tokio::test]
async fn a_wrong_password_is_told_and_the_right_one_opens() {
    let server = OwnServer::start_new("scram-sha-256");
    let url = server.url("postgres");
    let folder = tempfile::tempdir().unwrap();
    let with = |password: &str| {
        let path = folder.path().join("password");
        fs::write(&path, format!("{password}\n")).unwrap();
        PostgresSetup {
            url: url.clone(),
            password_file: Some(path),
        }
    };
    let host = server.host();
    let named = ["refuses the user", "password authentication failed", &host];
    refused(with("wrong"), &named).await;
    let absent = PostgresSetup {
        url: url.clone(),
        password_file: Some(folder.path().join("absent")),
    };
    refused(absent, &["needs the password of", "absent"]).await;
    let store = opened(with("secret of the test")).await.unwrap();
    store.close().await.unwrap();
}

#[tokio::test]
async fn a_database_that_is_not_there_is_named() {
    let url = PostgresUrl {
        database: "absent".to_owned(),
        ..named()
    };
    refused(setup(&url), &["database \"absent\" does not exist"]).await;
}

#[tokio::test]
async fn a_role_that_may_not_make_tables_is_told() {
    let role = new_role("powerless");
    let url = PostgresUrl {
        user: role.clone(),
        ..empty().await
    };
    refused(
        setup(&url),
        &[&role, "may not make", "CREATE on the schema public"],
    )
    .await;
}

#[tokio::test]
async fn a_newer_schema_is_refused() {
    let url = empty().await;
    let store = opened(setup(&url)).await.unwrap();
    store.close().await.unwrap();
    let later = "INSERT INTO _sqlx_migrations
        (version, description, success, checksum, execution_time)
        VALUES (29991231235959, 'later', true, '', 0)";
    psql(&url, later);
    let named = ["29991231235959", "run a newer fleetcal", &url.database];
    refused(setup(&url), &named).await;
    let error = migrate(setup(&url), None).await.unwrap_err();
    assert!(matches!(error, StoreError::NewerSchema { .. }), "{error:?}");
    let error = fleetcal_postgres::administration(setup(&url))
        .await
        .unwrap_err();
    assert!(matches!(error, StoreError::OtherSchema { .. }), "{error:?}");

    // One that takes away what this program needs is refused as well.
    let known = psql(&url, "SELECT max(version) FROM schema_compatible");
    let known = known.trim();
    psql(
        &url,
        "INSERT INTO schema_compatible VALUES (29991231235959, 29991231235959)",
    );
    refused(setup(&url), &named).await;

    // One that only adds is not in the way.
    psql(
        &url,
        &format!("UPDATE schema_compatible SET oldest = {known} WHERE version = 29991231235959"),
    );
    let store = opened(setup(&url)).await.unwrap();
    store.probe().await.unwrap();
    store.close().await.unwrap();
    fleetcal_postgres::administration(setup(&url))
        .await
        .unwrap();
}

#[tokio::test]
async fn every_migration_says_which_programs_may_use_it() {
    let url = empty().await;
    let store = opened(setup(&url)).await.unwrap();
    store.close().await.unwrap();
    let silent = "SELECT version FROM _sqlx_migrations
        WHERE version >= 20261124160000 AND version NOT IN (SELECT version FROM schema_compatible)";
    assert_eq!(psql(&url, silent).trim(), "");
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn several_that_open_an_empty_database_at_once_all_succeed() {
    for _ in 0..5 {
        let database = Arc::new(TestDatabase::on(&named()).await);
        let one = || {
            let database = Arc::clone(&database);
            tokio::spawn(async move { database.open(clock()).await })
        };
        let (first, second, third) = tokio::join!(one(), one(), one());
        for store in [first, second, third] {
            let store = store.unwrap();
            store.probe().await.unwrap();
            store.close().await.unwrap();
        }
    }
}

#[tokio::test]
async fn a_second_service_is_refused_until_the_first_one_ends() {
    let url = empty().await;
    let store = opened(setup(&url)).await.unwrap();
    let named = [
        &url.database,
        "is served by another fleetcal, from 127.0.0.1 since 2",
        "end that one first",
    ];
    refused(setup(&url), &named).await;
    // Commands that administrate work beside it.
    let administration = fleetcal_postgres::administration(setup(&url));
    administration.await.unwrap().close().await.unwrap();
    store.close().await.unwrap();
    let store = opened(setup(&url)).await.unwrap();
    store.close().await.unwrap();
}

/// Job that counts users over a store's connection of jobs.
#[derive(Debug)]
struct Count;

#[async_trait]
impl Job for Count {
    type Done = u32;

    async fn run(&self, records: &mut dyn Records) -> Result<u32, StoreError> {
        records.count_users().await
    }
}

#[tokio::test]
async fn a_role_with_fewer_rights_serves_and_leaves_the_audit_alone() {
    let url = empty().await;
    let role = new_role("serving");
    let error = migrate(setup(&url), Some("nobody here")).await.unwrap_err();
    assert!(error.to_string().contains("CREATE ROLE"), "{error}");
    migrate(setup(&url), Some(&role)).await.unwrap();
    // Again, as with every upgrade.
    migrate(setup(&url), Some(&role)).await.unwrap();
    let serving = PostgresUrl {
        user: role.clone(),
        ..url.clone()
    };
    let store = opened(setup(&serving)).await.unwrap();
    let decision = Decide("by the serving role".to_owned());
    store.transact(decision.clone()).await.unwrap();
    assert_eq!(store.transact(Count).await.unwrap(), 0);
    record(&store, "a", NOW_S, 0.1);
    store.flush().await.unwrap();
    assert_eq!(times_decided(&store, &[decision]).await, [1]);
    store.close().await.unwrap();
    for (sql, told) in [
        (
            "UPDATE audit SET actor = 'nobody'",
            "permission denied for table audit",
        ),
        ("DELETE FROM audit", "permission denied for table audit"),
        ("TRUNCATE audit", "permission denied for table audit"),
        (
            "ALTER TABLE audit DISABLE TRIGGER ALL",
            "must be owner of table audit",
        ),
        ("DROP TABLE audit", "must be owner of table audit"),
        (
            "UPDATE revision SET id = 7",
            "permission denied for table revision",
        ),
        (
            "DELETE FROM _sqlx_migrations",
            "permission denied for table _sqlx_migrations",
        ),
        (
            "CREATE TABLE mine (id int)",
            "permission denied for schema public",
        ),
    ] {
        let error = fleetcal_contract::own_server::psql_refused(&serving, sql);
        assert!(error.contains(told), "{sql}: {error}");
    }
    // Not even who owns it changes a row of the audit by mistake.
    let error = fleetcal_contract::own_server::psql_refused(&url, "DELETE FROM audit");
    assert!(error.contains("never changed and never deleted"), "{error}");
    let rows = psql(&url, "SELECT count(*) FROM audit");
    assert_eq!(rows.trim(), "1");
}
