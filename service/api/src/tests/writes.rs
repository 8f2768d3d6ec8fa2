//! Limits of the changes by one user or token per time.

use fleetcal_domain::limits;

use super::*;

/// Requests a change that is refused before anything is written.
async fn change(bench: &Bench, token: &str) -> Answer {
    let authorization = format!("Bearer {token}");
    let headers = [("authorization", authorization.as_str())];
    let uri = "/api/v1/robots/nobody/events";
    bench.send_body("POST", uri, &headers, "{}").await
}

#[tokio::test]
async fn a_token_in_a_loop_is_slowed_down_and_nobody_else() {
    let bench = bench(&["a"]).await;
    let looping = token(&bench.store, "loop", grant(Role::Operator), None).await;
    let other = token(&bench.store, "other", grant(Role::Operator), None).await;
    for _ in 0..limits::CALLER_WRITES_BURST {
        let answer = change(&bench, &looping).await;
        assert_ne!(answer.status, 429, "{}", answer.told());
    }
    let refused = change(&bench, &looping).await;
    insta::assert_snapshot!(
        refused.told(),
        @"429 too_many_writes: loop has changed too much; try again in 1 s"
    );
    assert_eq!(refused.header("retry-after"), "1");
    let authorization = format!("Bearer {looping}");
    let headers = [("authorization", authorization.as_str())];
    let read = bench.send("GET", "/api/v1/robots/a", &headers).await;
    assert_eq!(read.told(), "200");
    assert_ne!(change(&bench, &other).await.status, 429);
    let metrics = bench.get("/metrics").await.body;
    let line = "fleetcal_http_turned_away_total{reason=\"caller_writes\"} 1";
    assert!(metrics.contains(line), "{metrics}");

    bench.clock.advance(limits::CALLER_WRITES_EVERY);
    assert_ne!(change(&bench, &looping).await.status, 429);
    assert_eq!(change(&bench, &looping).await.status, 429);
}

#[tokio::test]
async fn several_decisions_in_one_request_count_as_so_many() {
    let bench = bench(&["a"]).await;
    let approver = token(&bench.store, "approver", grant(Role::Approver), None).await;
    let authorization = format!("Bearer {approver}");
    let headers = [("authorization", authorization.as_str())];
    let one = serde_json::json!({ "id": 1, "version": 1, "sha256": "00" });
    let most = vec![one; limits::APPROVED_AT_ONCE_MAX];
    let body = serde_json::json!({ "proposals": most }).to_string();
    let uri = "/api/v1/proposals/approve";
    let fit = limits::CALLER_WRITES_BURST as usize / limits::APPROVED_AT_ONCE_MAX;
    for _ in 0..fit {
        let answer = bench.send_body("POST", uri, &headers, body.clone()).await;
        assert_eq!(answer.told(), "200");
    }
    let refused = bench.send_body("POST", uri, &headers, body).await;
    assert!(
        refused.told().starts_with("429 too_many_writes"),
        "{}",
        refused.told()
    );
}
