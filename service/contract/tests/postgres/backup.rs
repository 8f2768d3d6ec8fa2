//! A database that is dumped while a service works, and restored into another.

use fleetcal_contract::clock;
use fleetcal_postgres::{migrate, open};
use fleetcal_store::Store;
use fleetcal_store::database_url::PostgresUrl;

use crate::differential::{Calls, export, filled};
use fleetcal_contract::own_server::{dump_and_restore, named, psql, setup};

/// Returns the content of a database: rows and hash of every table.
fn contents(url: &PostgresUrl) -> Vec<String> {
    let tables = psql(
        url,
        "SELECT quote_ident(relname) FROM pg_class
         WHERE relnamespace = 'public'::regnamespace AND relkind IN ('r', 'p') ORDER BY relname",
    );
    let content = |table: &str| {
        let rows = psql(
            url,
            &format!(
                "SELECT count(*), md5(coalesce(string_agg(t::text, E'\\n' ORDER BY t::text), ''))
                 FROM {table} AS t"
            ),
        );
        format!("{table}: {}", rows.trim())
    };
    tables.lines().map(content).collect()
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_dump_is_restored_with_every_row_and_serves() {
    let url = fleetcal_postgres::create_for_test(&named()).await.unwrap();
    let opened = async |url: &PostgresUrl| -> Store {
        open(setup(url), Box::new(()), clock() as _).await.unwrap()
    };
    let store = opened(&url).await;
    let calls = Calls::default();
    filled(&store, 200, &calls).await;
    let told = export::everything(&store, &calls).await;
    let restored = fleetcal_postgres::create_for_test(&named()).await.unwrap();
    dump_and_restore(&url, &restored);
    store.close().await.unwrap();
    let there = contents(&url);
    assert!(
        there.len() > 25 && there.iter().filter(|table| !table.contains(": 0|")).count() > 20,
        "{there:#?}"
    );
    assert_eq!(contents(&restored), there);
    migrate(setup(&restored), None).await.unwrap();
    let store = opened(&restored).await;
    let again = export::everything(&store, &calls).await;
    // The restored one has been started once more.
    let events = |text: &str| text.matches("ServiceStarted").count();
    assert!(events(&again) >= events(&told));
    let without_events = |text: &str| -> Vec<String> {
        let lines = text.lines().filter(|line| !line.starts_with("events"));
        lines.map(str::to_owned).collect()
    };
    assert_eq!(without_events(&again), without_events(&told));
    store.close().await.unwrap();
}
