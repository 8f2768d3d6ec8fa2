//! Routes of `/webhooks`: the receivers of messages.

use axum::Json;
use axum::extract::{Path, State};
use axum::http::StatusCode;
use axum::response::{IntoResponse, Response};
use fleetcal_domain::webhook::{Secret, Webhook, WebhookEvent, WebhookUrl};
use fleetcal_model::WebhookId;
use fleetcal_operations::entropy;
use fleetcal_operations::webhook_dispatcher::{CreateWebhook, DeleteWebhook};
use jiff::Timestamp;
use serde::{Deserialize, Serialize};

use crate::ApiState;
use crate::access::Caller;
use crate::extract::{Body, NoParameters, Parameters};
use crate::problem::Problem;
use crate::time;

/// Receiver of messages.
#[derive(Debug, Serialize, utoipa::ToSchema)]
#[schema(as = Webhook)]
pub(super) struct WebhookDocument {
    /// Number of the webhook.
    id: WebhookId,
    /// Address of the receiver.
    url: String,
    /// Events that it receives.
    events: Vec<WebhookEvent>,
    /// Person or tool that created it.
    created_by: String,
    #[schema(value_type = String, format = DateTime)]
    created: Timestamp,
}

impl WebhookDocument {
    fn of(webhook: Webhook) -> Self {
        Self {
            id: webhook.id,
            url: webhook.url.into(),
            events: webhook.events,
            created_by: webhook.created_by,
            created: time::of(webhook.created_ns),
        }
    }
}

/// List of every webhook.
#[derive(Debug, Serialize, utoipa::ToSchema)]
pub(super) struct WebhookList {
    items: Vec<WebhookDocument>,
}

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

/// Webhook to be created.
#[derive(Debug, Deserialize, utoipa::ToSchema)]
#[schema(as = NewWebhook)]
#[serde(deny_unknown_fields)]
pub(super) struct NewWebhookBody {
    /// Address of the receiver: `http` or `https`, at most 2000 bytes, without user and password.
    /// The service sends from its own network, so a person who may create webhooks can make it send
    /// requests to addresses that only it can reach; it reads the answer's status alone.
    #[schema(max_length = 2000)]
    url: String,
    /// Events that it receives; all unless given.
    #[serde(default)]
    events: Option<Vec<WebhookEvent>>,
}

/// Webhook with its secret, which is shown this once.
#[derive(Debug, Serialize, utoipa::ToSchema)]
#[schema(as = WebhookWithSecret)]
pub(super) struct SecretDocument {
    /// Created webhook.
    webhook: WebhookDocument,
    /// Secret that signs its messages: `whsec_` and base64. The service stores it in plain form,
    /// because it signs with it; it is in the database and in every backup of it.
    secret: String,
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
