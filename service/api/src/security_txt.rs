//! Route `/.well-known/security.txt`: the contact for reports of vulnerabilities (RFC 9116).

use std::time::Duration;

use axum::extract::State;
use axum::http::{StatusCode, header};
use axum::response::{IntoResponse, Response};
use fleetcal_http::{PublicUrl, SecurityContact};

use crate::ApiState;
use crate::extract::{NoParameters, Parameters};
use crate::problem::Problem;
use crate::time;

/// Time for which an answer counts: RFC 9116 recommends less than a year.
const VALID_FOR: Duration = Duration::from_hours(180 * 24);

/// Returns the contacts for reports of vulnerabilities, as RFC 9116 asks for.
#[utoipa::path(get, path = "/.well-known/security.txt", tag = "service",
    responses(
        (status = OK, description = "The contacts, valid for 180 days", body = String,
            content_type = "text/plain"),
        (status = NOT_FOUND, description = "No `security_contacts` are configured"),
    ))]
pub(super) async fn security_txt(
    State(api): State<ApiState>,
    Parameters(NoParameters {}): Parameters<NoParameters>,
) -> Result<Response, Problem> {
    if api.security_contacts.is_empty() {
        let detail = "no security_contacts are configured";
        let status = StatusCode::NOT_FOUND;
        return Err(Problem::new(status, "no_security_contacts", detail));
    }
    let expires = time::of(api.clock.now().plus(VALID_FOR)).to_string();
    let text = text(&api.security_contacts, &expires, api.public_url.as_ref());
    let content_type = "text/plain; charset=utf-8";
    Ok(([(header::CONTENT_TYPE, content_type)], text).into_response())
}

fn text(contacts: &[SecurityContact], expires: &str, url: Option<&PublicUrl>) -> String {
    let contacts = contacts.iter();
    let mut text: String = contacts
        .map(|contact| format!("Contact: {}\n", contact.as_str()))
        .collect();
    text += &format!("Expires: {expires}\nPreferred-Languages: en\n");
    if let Some(url) = url.filter(|url| url.is_https()) {
        text += &format!("Canonical: {}/.well-known/security.txt\n", url.as_str());
    }
    text
}
