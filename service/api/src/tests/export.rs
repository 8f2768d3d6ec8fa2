//! Files and long lists, which are sent while they are read.

use fleetcal_contract::AppendAudit;
use fleetcal_domain::limits;

use super::*;

/// Number of rows, of which several reads fetch one part each.
const ROWS: u32 = 700;

async fn audited() -> Bench {
    let bench = bench(&["a"]).await;
    bench.store.transact(AppendAudit(ROWS)).await.unwrap();
    bench
}

/// Number of an answer's lines that arrive before the rest is read.
async fn first_lines(bench: &Bench, uri: &str) -> usize {
    let mut body = bench.begin(uri, &[]).await;
    let first = body.next().await.unwrap().unwrap();
    String::from_utf8_lossy(&first).lines().count()
}

const OF_A: &str = "/api/v1/audit?robot=a&action=deployment.";

#[tokio::test]
async fn a_file_is_given_while_it_is_read() {
    let bench = audited().await;
    for format in ["csv", "ndjson"] {
        let lines = first_lines(&bench, &format!("{OF_A}&format={format}")).await;
        assert!((1..300).contains(&lines), "{format}: {lines} lines at once");
    }
    let mut page = bench.begin(&format!("{OF_A}&limit=1000"), &[]).await;
    let first = page.next().await.unwrap().unwrap();
    assert!(page.next().await.is_some(), "{} bytes at once", first.len());
}

#[tokio::test]
async fn every_format_has_every_row_once() {
    let bench = audited().await;
    let page = bench.get(&format!("{OF_A}&limit=1000")).await.json();
    let items = page["items"].as_array().unwrap();
    assert_eq!(items.len(), ROWS as usize);
    assert_eq!(page.get("next"), None);
    let number = |item: &Value| item["after"]["number"].as_u64().unwrap();
    let numbers: Vec<_> = items.iter().map(number).collect();
    assert!(numbers.iter().copied().eq((0..u64::from(ROWS)).rev()));

    let ndjson = bench.get(&format!("{OF_A}&format=ndjson")).await;
    assert_eq!(ndjson.header("content-type"), "application/x-ndjson");
    let lines = ndjson.body.lines();
    let lines: Vec<Value> = lines
        .map(|line| serde_json::from_str(line).unwrap())
        .collect();
    assert_eq!(lines, *items);

    let csv = bench.get(&format!("{OF_A}&format=csv")).await;
    assert_eq!(csv.header("content-type"), "text/csv; charset=utf-8");
    let disposition = csv.header("content-disposition");
    assert_eq!(disposition, "attachment; filename=\"audit.csv\"");
    let lines: Vec<_> = csv.body.split_terminator("\r\n").collect();
    assert_eq!(lines.len(), items.len() + 1);
    let told = format!("{}, with some {ROWS}", lines[1]);
    assert!(lines[1].contains("offered"), "{told}");
    assert!(lines[1].contains(",\"x;'=1+1\","), "{told}");
}

#[tokio::test]
async fn pages_follow_each_other() {
    let bench = audited().await;
    let mut numbers = Vec::new();
    let mut cursor = String::new();
    loop {
        let page = bench.get(&format!("{OF_A}&limit=350{cursor}")).await.json();
        let items = page["items"].as_array().unwrap();
        numbers.extend(items.iter().map(|item| item["id"].as_i64().unwrap()));
        let Some(next) = page["next"].as_str() else {
            break;
        };
        assert_eq!(items.len(), 350);
        cursor = format!("&cursor={next}");
    }
    assert_eq!(numbers.len(), ROWS as usize);
    assert!(numbers.is_sorted_by(|one, next| one > next));
    let limited = bench.get(&format!("{OF_A}&format=ndjson&limit=600")).await;
    assert_eq!(limited.body.lines().count(), 600);
    let none = bench.get("/api/v1/audit?robot=nobody&format=ndjson").await;
    assert_eq!(none.body, "");
    let none = bench.get("/api/v1/audit?robot=nobody").await;
    assert_eq!(none.json(), serde_json::json!({ "items": [] }));
}

#[tokio::test]
async fn so_many_files_are_written_at_once_and_no_more() {
    let bench = audited().await;
    let uri = format!("{OF_A}&format=csv");
    let mut open = Vec::new();
    for number in 0..limits::EXPORTS_MAX {
        let name = format!("reader_{}", number / limits::EXPORTS_PER_CALLER_MAX);
        let known = number % limits::EXPORTS_PER_CALLER_MAX != 0;
        let token = if known {
            open.last()
                .map(|(_, token): &(_, String)| token.clone())
                .unwrap()
        } else {
            token(&bench.store, &name, grant(Role::Viewer), None).await
        };
        let authorization = format!("Bearer {token}");
        let body = bench
            .begin(&uri, &[("authorization", &authorization)])
            .await;
        open.push((body, token));
    }
    let own = format!("Bearer {}", open[0].1);
    let own = bench.send("GET", &uri, &[("authorization", &own)]).await;
    assert!(
        own.told().starts_with("429 exports_of_caller"),
        "{}",
        own.told()
    );
    let other = bench.get(&uri).await;
    assert!(
        other.told().starts_with("503 exports_full"),
        "{}",
        other.told()
    );
    // Pages are bounded by themselves.
    assert_eq!(bench.get(OF_A).await.told(), "200");
    open.clear();
    // Each writing task frees its place when it sees that its reader is gone, at its next turn.
    tokio::task::yield_now().await;
    assert_eq!(bench.get(&uri).await.told(), "200");
}
