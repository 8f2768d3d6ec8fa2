//! Decisions of one request, each on its own.

use axum::http::StatusCode;
use fleetcal_domain::limits;
use futures::StreamExt;
use tokio::time::Instant;

use crate::problem::Problem;

/// Decides on each item, and returns the outcomes in the order of the items. A refused decision
/// does not affect the others. Those whose turn does not come within [`limits::APPROVED_WITHIN`]
/// are not tried.
pub(crate) async fn each<T, D, F>(items: Vec<T>, decide: impl Fn(T) -> F) -> Vec<Result<D, Problem>>
where
    F: Future<Output = Result<D, Problem>>,
{
    let end = Instant::now() + limits::APPROVED_WITHIN;
    let decided = items.into_iter().map(|item| {
        let deciding = decide(item);
        async move {
            if Instant::now() >= end {
                return Err(not_tried());
            }
            let ended = tokio::time::timeout_at(end, deciding).await;
            ended.unwrap_or_else(|_| Err(Problem::outcome_unknown()))
        }
    });
    let decided = futures::stream::iter(decided).buffered(limits::DECIDED_TOGETHER);
    decided.collect().await
}

fn not_tried() -> Problem {
    let detail = "the database was too slow: the turn of this one did not come; send it again";
    Problem::new(StatusCode::SERVICE_UNAVAILABLE, "not_tried", detail)
}
