//! Route `GET /certificates/{id}`: one certificate, to be kept or printed.

use axum::body::Body;
use axum::extract::{Path, State};
use axum::http::{HeaderName, StatusCode, header};
use axum::response::{IntoResponse, Response};
use fleetcal_http::csv;
use fleetcal_model::DeploymentId;
use fleetcal_proto::calibration::Envelope;
use fleetcal_proto::certificate::CertificateDocument;
use fleetcal_store::StoreError;
use serde::Deserialize;

use crate::ApiState;
use crate::extract::Parameters;
use crate::problem::Problem;

/// Content security policy of the page: its own style alone. It has no script and loads nothing.
const PAGE_POLICY: &str = "default-src 'none'; style-src 'unsafe-inline'; base-uri 'none'; \
    form-action 'none'; frame-ancestors 'none'";

#[derive(Debug, Deserialize, utoipa::IntoParams)]
#[into_params(parameter_in = Query)]
#[serde(deny_unknown_fields)]
pub(super) struct FormatParameters {
    /// Format: `json` (the signed file) or `html` (one page that prints); `json` unless given.
    format: Option<String>,
}

/// Returns a certificate: a signed file, which `fleetcal verify` checks without the service, or its
/// content as one page.
#[utoipa::path(
    get,
    path = "/certificates/{id}",
    tag = "approval",
    params(
        ("id" = DeploymentId, Path,
            description = "The certificate: the number of the deployment which was verified."),
        FormatParameters,
    ),
    responses(
        (status = OK,
            description = "The certificate; the content of `document` is a `CertificateDocument`",
            content((Envelope = "application/json"), (String = "text/html"))),
        (status = NOT_FOUND,
            description = "There is none: nothing was verified by that number, or it was before \
                there were certificates, or too long ago"),
    )
)]
pub(super) async fn get_certificate(
    State(api): State<ApiState>,
    Path(number): Path<String>,
    Parameters(query): Parameters<FormatParameters>,
) -> Result<Response, Problem> {
    let as_page = match query.format.as_deref() {
        None | Some("json") => false,
        Some("html") => true,
        Some(other) => return Err(Problem::refused("format", other, "json or html")),
    };
    let number = number
        .parse()
        .map(DeploymentId)
        .map_err(|_| Problem::refused("id", &number, "a certificate's number"))?;
    let found = api.store.certificate(number).await?;
    let envelope = found.ok_or_else(|| unknown(number))?.envelope;
    if as_page {
        page(&envelope)
    } else {
        file(number, &envelope)
    }
}

/// The signed file, on one line.
fn file(number: DeploymentId, envelope: &Envelope) -> Result<Response, Problem> {
    let text = serde_json::to_string(envelope).map_err(|error| corrupt(&error))?;
    let name = format!("certificate-{number}.json");
    Ok(csv::file("application/json", &name, Body::from(text)))
}

fn page(envelope: &Envelope) -> Result<Response, Problem> {
    let document = serde_json::from_str(&envelope.document);
    let document: CertificateDocument = document.map_err(|error| corrupt(&error))?;
    let headers: [(HeaderName, &str); 2] = [
        (header::CONTENT_TYPE, "text/html; charset=utf-8"),
        (header::CONTENT_SECURITY_POLICY, PAGE_POLICY),
    ];
    let page = fleetcal_certificate::page(&document, envelope);
    Ok((headers, page).into_response())
}

fn corrupt(error: &serde_json::Error) -> StoreError {
    StoreError::Corrupt {
        table: "certificate",
        reason: error.to_string(),
    }
}

fn unknown(number: DeploymentId) -> Problem {
    let detail = format!("there is no certificate of number {number}");
    Problem::new(StatusCode::NOT_FOUND, "certificate_unknown", detail)
}
