//! Routes of `/webhooks`: the receivers of messages.

use axum::Json;
use axum::extract::{Path, State};
use axum::http::StatusCode;
use axum::response::{IntoResponse, Response};
use fleetcal_documents::{NewWebhookBody, SecretDocument, WebhookDocument, WebhookList};
use fleetcal_domain::webhook::{Secret, WebhookEvent, WebhookUrl};
use fleetcal_model::WebhookId;
use fleetcal_operations::entropy;
use fleetcal_operations::webhook_dispatcher::{CreateWebhook, DeleteWebhook};

use crate::ApiState;
use crate::access::Caller;
use crate::extract::{Body, NoParameters, Parameters};
use crate::problem::Problem;

/// Lists the webhooks, the oldest first.
///
/// Their secrets are not shown again.
#[utoipa::path(
    get,
    path = "/webhooks",
    tag = "alerts",
    responses(
        (status = OK, description = "All webhooks, without their secrets", body = WebhookList),
    )
)]
pub(super) async fn list_webhooks(
    State(api): State<ApiState>,
    Parameters(NoParameters {}): Parameters<NoParameters>,
) -> Result<Json<WebhookList>, Problem> {
    let webhooks = api.store.webhooks().await?;
    let items = webhooks.into_iter().map(WebhookDocument::of).collect();
    Ok(Json(WebhookList { items }))
}

/// Creates a webhook.
///
/// Messages follow the Standard Webhooks scheme: headers `webhook-id`, `webhook-timestamp` and
/// `webhook-signature` (HMAC-SHA256), a JSON body with `type`, `timestamp` and `data`. A message
/// that is not answered with 2xx within 10 s is sent again, at increasing intervals, for a day; the
/// same `webhook-id` can arrive twice. Redirections are not followed.
#[utoipa::path(
    post,
    path = "/webhooks",
    tag = "alerts",
    request_body = NewWebhookBody,
    responses(
        (status = CREATED, description = "The new webhook, with its secret", body = SecretDocument),
        (status = CONFLICT,
            description = "A webhook with this URL exists, or the limit of webhooks is reached"),
    )
)]
pub(super) async fn post_webhook(
    State(api): State<ApiState>,
    caller: Caller,
    Parameters(NoParameters {}): Parameters<NoParameters>,
    Body { value, .. }: Body<NewWebhookBody>,
) -> Result<Response, Problem> {
    let url = WebhookUrl::parse(&value.url)?;
    let secret = new_secret()?;
    let create = CreateWebhook {
        url,
        events: events_of(value.events)?,
        secret: secret.clone(),
        actor: caller.actor,
        now: api.clock.now(),
    };
    let webhook = api.store.transact(create).await?;
    let document = SecretDocument {
        webhook: WebhookDocument::of(webhook),
        secret: secret.to_text(),
    };
    Ok((StatusCode::CREATED, Json(document)).into_response())
}

fn events_of(given: Option<Vec<WebhookEvent>>) -> Result<Vec<WebhookEvent>, Problem> {
    let mut events = given.unwrap_or_else(|| WebhookEvent::ALL.to_vec());
    events.sort_unstable();
    events.dedup();
    if events.is_empty() {
        let accepted = WebhookEvent::ALL.map(WebhookEvent::as_str).join(", ");
        let accepted = format!("one or more of {accepted}");
        return Err(Problem::refused("events", "[]", &accepted));
    }
    Ok(events)
}

fn new_secret() -> Result<Secret, Problem> {
    let bytes = entropy::secret().map_err(|error| {
        let detail = format!("no secret could be drawn: {error}");
        Problem::new(StatusCode::SERVICE_UNAVAILABLE, "no_randomness", detail)
    })?;
    Ok(Secret::from_bytes(bytes.to_vec()))
}

/// Deletes a webhook, with its waiting messages.
#[utoipa::path(
    delete,
    path = "/webhooks/{id}",
    tag = "alerts",
    params(("id" = u64, Path, description = "The webhook.")),
    responses(
        (status = NO_CONTENT, description = "The webhook is deleted"),
        (status = NOT_FOUND, description = "The webhook is unknown"),
    )
)]
pub(super) async fn delete_webhook(
    State(api): State<ApiState>,
    caller: Caller,
    Path(id): Path<String>,
    Parameters(NoParameters {}): Parameters<NoParameters>,
) -> Result<StatusCode, Problem> {
    let delete = DeleteWebhook {
        id: webhook_number(&id)?,
        actor: caller.actor,
        now: api.clock.now(),
    };
    api.store.transact(delete).await?;
    Ok(StatusCode::NO_CONTENT)
}

pub(super) fn webhook_number(id: &str) -> Result<WebhookId, Problem> {
    id.parse()
        .map_err(|_| Problem::refused("id", id, "the number of a webhook"))
}
