//! Extractors of a request's parts, with a problem document for each that does not fit.

use axum::Json;
use axum::body::Bytes;
use axum::extract::{DefaultBodyLimit, FromRequest, FromRequestParts, Path, Query, Request};
use axum::http::request::Parts;
use axum::http::{HeaderMap, HeaderName, StatusCode, header};
use fleetcal_domain::limits;
use fleetcal_proto::RobotId;
use fleetcal_store::IdempotencyKey;
use serde::Deserialize;
use serde::de::DeserializeOwned;
use sha2::{Digest, Sha256};

use super::problem::Problem;

static IDEMPOTENCY_KEY: HeaderName = HeaderName::from_static("idempotency-key");

/// Query of a route without parameters: every parameter is refused by name.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct NoParameters {}

/// Query of a request.
#[derive(Debug)]
pub struct Parameters<T>(pub T);

impl<S: Send + Sync, T: DeserializeOwned> FromRequestParts<S> for Parameters<T> {
    type Rejection = Problem;

    async fn from_request_parts(parts: &mut Parts, _: &S) -> Result<Self, Problem> {
        let Query(query) = Query::try_from_uri(&parts.uri).map_err(|rejection| {
            let status = StatusCode::BAD_REQUEST;
            unreadable(status, "query_refused", "the query", &rejection.body_text())
        })?;
        Ok(Self(query))
    }
}

/// Robot that a path names, by its part `{id}`.
#[derive(Debug)]
pub struct RobotPath(pub RobotId);

/// Parts of a path.
#[derive(Deserialize)]
struct Named {
    id: String,
}

impl<S: Send + Sync> FromRequestParts<S> for RobotPath {
    type Rejection = Problem;

    async fn from_request_parts(parts: &mut Parts, state: &S) -> Result<Self, Problem> {
        let refused = |detail: String| {
            Problem::new(StatusCode::BAD_REQUEST, "value_refused", detail).of_field("id")
        };
        let Path(named) = Path::<Named>::from_request_parts(parts, state)
            .await
            .map_err(|rejection| refused(rejection.body_text()))?;
        RobotId::parse(&named.id)
            .map(Self)
            .map_err(|error| refused(error.to_string()))
    }
}

/// JSON body of a request, of at most `BYTES_MAX` bytes.
#[derive(Debug)]
pub struct Body<T, const BYTES_MAX: usize = { limits::HTTP_BODY_BYTES_MAX }> {
    /// Its content.
    pub value: T,
    /// SHA-256 of its bytes.
    pub sha256: [u8; 32],
}

impl<S: Send + Sync, T: DeserializeOwned, const BYTES_MAX: usize> FromRequest<S>
    for Body<T, BYTES_MAX>
{
    type Rejection = Problem;

    async fn from_request(request: Request, state: &S) -> Result<Self, Problem> {
        if !is_json(request.headers()) {
            let detail = "the body must be sent as Content-Type: application/json";
            let status = StatusCode::UNSUPPORTED_MEDIA_TYPE;
            return Err(Problem::new(status, "not_json", detail).of_field("Content-Type"));
        }
        let bytes = bytes_of(request, state, BYTES_MAX).await?;
        Ok(Self {
            value: parsed(&bytes)?,
            sha256: Sha256::digest(&bytes).into(),
        })
    }
}

/// Parses JSON.
///
/// # Errors
/// A [`Problem`] that names the field that does not fit.
pub fn parsed<T: DeserializeOwned>(bytes: &[u8]) -> Result<T, Problem> {
    let value = Json::from_bytes(bytes).map_err(|rejection| {
        let (status, said) = (rejection.status(), rejection.body_text());
        unreadable(status, "body_refused", "the body", &said)
    });
    value.map(|Json(value)| value)
}

/// Reads a body of at most `bytes_max` bytes.
///
/// # Errors
/// A [`Problem`] if it is longer, or did not come whole.
pub async fn bytes_of<S: Send + Sync>(
    mut request: Request,
    state: &S,
    bytes_max: usize,
) -> Result<Bytes, Problem> {
    DefaultBodyLimit::max(bytes_max).apply(&mut request);
    let bytes = Bytes::from_request(request, state).await;
    bytes.map_err(|rejection| {
        let detail = match rejection.status() {
            StatusCode::PAYLOAD_TOO_LARGE => {
                format!("the body is larger than {bytes_max} bytes")
            }
            _ => rejection.body_text(),
        };
        Problem::new(rejection.status(), "body_refused", detail)
    })
}

/// Makes the problem of an invalid query or body. The error `said` reads "Failed to …: the field:
/// the fault", with the field left out if it is the whole.
fn unreadable(status: StatusCode, code: &'static str, part: &str, said: &str) -> Problem {
    let reason = said.split_once(": ").map_or(said, |(_, reason)| reason);
    let is_field = |name: &str| !name.contains([' ', '`']);
    match reason.split_once(": ").filter(|(name, _)| is_field(name)) {
        Some((field, reason)) => {
            Problem::new(status, code, format!("{part}: {reason}")).of_field(field)
        }
        None => Problem::new(status, code, format!("{part}: {reason}")),
    }
}

fn is_json(headers: &HeaderMap) -> bool {
    let content_type = headers
        .get(header::CONTENT_TYPE)
        .and_then(|value| value.to_str().ok());
    content_type
        .and_then(|text| text.split(';').next())
        .is_some_and(|media| media.trim().eq_ignore_ascii_case("application/json"))
}

/// Returns a header's text.
///
/// # Errors
/// A [`Problem`] that names the refused value.
pub fn header_text<'a>(
    headers: &'a HeaderMap,
    name: &HeaderName,
) -> Result<Option<&'a str>, Problem> {
    headers
        .get(name)
        .map(|value| {
            value.to_str().map_err(|_| {
                let shown = String::from_utf8_lossy(value.as_bytes());
                Problem::refused(name.as_str(), &shown, "ASCII text")
            })
        })
        .transpose()
}

/// Returns the `Idempotency-Key` of a request.
///
/// # Errors
/// A [`Problem`] that names the refused value.
pub fn idempotency_key(
    headers: &HeaderMap,
    request_sha256: [u8; 32],
) -> Result<Option<IdempotencyKey>, Problem> {
    let Some(key) = header_text(headers, &IDEMPOTENCY_KEY)? else {
        return Ok(None);
    };
    if key.is_empty() || key.len() > limits::HTTP_IDEMPOTENCY_KEY_CHARS_MAX {
        return Err(Problem::refused(
            "Idempotency-Key",
            key,
            "1 to 128 characters",
        ));
    }
    Ok(Some(IdempotencyKey {
        key: key.to_owned(),
        request_sha256,
    }))
}

/// Parses a number of a query within its limits; `default` if it is absent.
///
/// # Errors
/// A [`Problem`] that names the refused value.
pub fn number_within(
    field: &str,
    given: Option<&str>,
    range: std::ops::RangeInclusive<u32>,
    default: u32,
) -> Result<u32, Problem> {
    let Some(text) = given else {
        return Ok(default);
    };
    text.parse()
        .ok()
        .filter(|number| range.contains(number))
        .ok_or_else(|| {
            let accepted = format!("a whole number from {} to {}", range.start(), range.end());
            Problem::refused(field, text, &accepted)
        })
}

/// Parses a time of a query.
///
/// # Errors
/// A [`Problem`] that names the refused value.
pub fn time(field: &str, given: Option<&str>) -> Result<Option<jiff::Timestamp>, Problem> {
    given
        .map(|text| {
            text.parse().map_err(|_| {
                Problem::refused(field, text, "RFC 3339, such as 2026-01-31T12:00:00Z")
            })
        })
        .transpose()
}

/// Refuses a text that is too long.
///
/// # Errors
/// A [`Problem`] that names the refused value.
pub fn check_length(field: &str, text: &str, chars_max: usize) -> Result<(), Problem> {
    let chars = text.chars().count();
    if chars > chars_max {
        let detail = format!("{field}: got {chars} characters, expected {chars_max} at most");
        let status = StatusCode::BAD_REQUEST;
        return Err(Problem::new(status, "value_refused", detail).of_field(field));
    }
    Ok(())
}

/// Parses the number in a cursor.
///
/// # Errors
/// A [`Problem`] that names the refused value.
pub fn number_of(cursor: &str) -> Result<i64, Problem> {
    cursor
        .parse()
        .map_err(|_| Problem::refused("cursor", cursor, "`next` of the page before"))
}
