//! Route `GET /webhooks/{id}/deliveries`: the deliveries of a webhook.

use axum::extract::{Path, State};
use axum::response::Response;
use fleetcal_documents::{DeliveryDocument, DeliveryPage};
use fleetcal_domain::webhook::{Delivery, WebhookRefused};
use futures::FutureExt;
use serde::Deserialize;

use super::one::webhook_number;
use crate::ApiState;
use crate::extract::{Parameters, number_of};
use crate::listing::{self, Rows, number};
use crate::page::page_limit;
use crate::problem::Problem;

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
