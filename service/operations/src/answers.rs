//! Repeated requests with their `Idempotency-Key`.

use fleetcal_model::WallTime;
use fleetcal_store::transaction::AnswerScope;
use fleetcal_store::{IdempotencyKey, Records, StoreError};

/// Number of the record that the same request created before.
///
/// # Errors
/// [`StoreError::KeyReused`] if the key came with another request.
pub(crate) async fn made_before(
    records: &mut dyn Records,
    scope: AnswerScope<'_>,
    request: Option<&IdempotencyKey>,
) -> Result<Option<i64>, StoreError> {
    let Some(request) = request else {
        return Ok(None);
    };
    match records.answer(scope, &request.key).await? {
        None => Ok(None),
        Some(answer) if answer.request_sha256 == request.request_sha256 => Ok(Some(answer.made)),
        Some(_) => Err(StoreError::KeyReused),
    }
}

/// Stores the record that a request created.
pub(crate) async fn note_made(
    records: &mut dyn Records,
    scope: AnswerScope<'_>,
    request: Option<&IdempotencyKey>,
    made: i64,
    now: WallTime,
) -> Result<(), StoreError> {
    match request {
        Some(request) => records.add_answer(scope, request, made, now).await,
        None => Ok(()),
    }
}
