//! Route `GET /webhooks/{id}/deliveries`: the deliveries of a webhook.

use axum::extract::{Path, State};
use axum::response::Response;
use fleetcal_domain::webhook::{Attempt, Delivery, DeliveryState, WebhookEvent, WebhookRefused};
use fleetcal_model::DeliveryId;
use futures::FutureExt;
use jiff::Timestamp;
use serde::{Deserialize, Serialize};

use super::one::webhook_number;
use crate::ApiState;
use crate::extract::{Parameters, number_of};
use crate::listing::{self, Rows, number};
use crate::page::page_limit;
use crate::problem::Problem;
use crate::time;

#[derive(Debug, Deserialize, utoipa::IntoParams)]
#[into_params(parameter_in = Query)]
#[serde(deny_unknown_fields)]
pub(super) struct DeliveryParameters {
    /// Deliveries of a page, 1 to 1000.
    #[param(value_type = Option<u32>)]
    limit: Option<String>,
    /// Value of `next` of the previous page.
    cursor: Option<String>,
}

/// Delivery of one message to one receiver.
#[derive(Debug, Serialize, utoipa::ToSchema)]
#[schema(as = WebhookDelivery)]
struct DeliveryDocument {
    /// Number of the delivery.
    id: DeliveryId,
    /// Value of the message's `webhook-id`.
    message: String,
    /// Event that the message reports.
    event: WebhookEvent,
    state: DeliveryState,
    /// Time of the event.
    #[schema(value_type = String, format = DateTime)]
    created: Timestamp,
    /// Time of the next attempt; `null` once it is finished.
    #[schema(value_type = Option<String>, format = DateTime)]
    due: Option<Timestamp>,
    /// Time at which it was delivered or given up.
    #[schema(value_type = Option<String>, format = DateTime)]
    finished: Option<Timestamp>,
    /// Number of attempts made.
    attempts_made: u32,
    /// Latest 20 attempts, the oldest first.
    attempts: Vec<AttemptDocument>,
    /// Body of the message.
    #[schema(value_type = Object)]
    body: serde_json::Value,
}

/// Attempt at a delivery.
#[derive(Debug, Serialize, utoipa::ToSchema)]
#[schema(as = WebhookAttempt)]
struct AttemptDocument {
    #[schema(value_type = String, format = DateTime)]
    time: Timestamp,
    /// Duration of the attempt, ms.
    took_ms: u64,
    /// HTTP status of the answer; `null` without an answer.
    status: Option<u16>,
    /// Reason for which there was no answer.
    error: Option<String>,
}

impl DeliveryDocument {
    fn of(delivery: Delivery) -> Self {
        let waits = delivery.state == DeliveryState::Waiting;
        let attempt = |attempt: Attempt| AttemptDocument {
            time: time::of(attempt.at_ns),
            took_ms: attempt.took_ms,
            status: attempt.status,
            error: attempt.error,
        };
        Self {
            id: delivery.id,
            message: delivery.message,
            event: delivery.event,
            state: delivery.state,
            created: time::of(delivery.created_ns),
            due: waits.then(|| time::of(delivery.due_ns)),
            finished: delivery.finished_ns.map(time::of),
            attempts_made: delivery.attempts_made,
            attempts: delivery.attempts.into_iter().map(attempt).collect(),
            body: serde_json::from_str(&delivery.body).unwrap_or_default(),
        }
    }
}

/// A page of deliveries, newest first.
#[derive(Serialize, utoipa::ToSchema)]
pub(super) struct DeliveryPage {
    items: Vec<DeliveryDocument>,
    /// Value of `cursor` for the next page; absent on the last one.
    #[serde(skip_serializing_if = "Option::is_none")]
    next: Option<String>,
}

/// Lists a webhook's messages with the state of each, newest first: those that wait, and the latest
/// 1000 that were delivered or given up.
#[utoipa::path(
    get,
    path = "/webhooks/{id}/deliveries",
    tag = "alerts",
    params(("id" = u64, Path, description = "The webhook."), DeliveryParameters),
    responses(
        (status = OK, description = "A page of deliveries", body = DeliveryPage),
        (status = NOT_FOUND, description = "The webhook is unknown"),
    )
)]
pub(super) async fn list_deliveries(
    State(api): State<ApiState>,
    Path(id): Path<String>,
    Parameters(query): Parameters<DeliveryParameters>,
) -> Result<Response, Problem> {
    let id = webhook_number(&id)?;
    let limit = page_limit(query.limit.as_deref())?;
    let before = query.cursor.as_deref().map(number_of).transpose()?;
    let webhooks = api.store.webhooks().await?;
    if !webhooks.iter().any(|webhook| webhook.id == id) {
        return Err(WebhookRefused::Unknown(id).into());
    }
    let store = api.store.clone();
    let read = move |before, limit| {
        let store = store.clone();
        let documents = async move {
            let found = store.deliveries(id, before, limit).await?;
            let numbered = |one: Delivery| (number(one.id.0), DeliveryDocument::of(one));
            Ok(found.into_iter().map(numbered).collect())
        };
        documents.boxed()
    };
    listing::page(Rows::new(before, limit, read)).await
}
