//! Entity tags and the conditions that name them.

use axum::Json;
use axum::http::{HeaderMap, HeaderValue, StatusCode, header};
use axum::response::{IntoResponse, Response};
use fleetcal_model::Version;
use fleetcal_store::Expected;
use serde::Serialize;
use sha2::{Digest, Sha256};

use super::extract::header_text;
use super::problem::Problem;

/// Answers with a document and the tag of its bytes; 304 if the client has them.
///
/// # Errors
/// A [`Problem`] that names the refused value.
pub fn tagged_json<T: Serialize>(headers: &HeaderMap, document: &T) -> Result<Response, Problem> {
    let bytes = serde_json::to_vec(document).map_err(|error| {
        let status = StatusCode::INTERNAL_SERVER_ERROR;
        Problem::new(status, "not_serializable", error.to_string())
    })?;
    let tag = tag_of(&bytes);
    if client_has(headers, &tag) {
        return Ok((StatusCode::NOT_MODIFIED, [(header::ETAG, tag)]).into_response());
    }
    let json = HeaderValue::from_static("application/json");
    Ok(([(header::ETAG, tag), (header::CONTENT_TYPE, json)], bytes).into_response())
}

/// Makes the tag of these bytes.
pub fn tag_of(bytes: &[u8]) -> HeaderValue {
    tag_of_digest(Sha256::digest(bytes).into())
}

/// Makes the tag of the bytes with this SHA-256.
pub fn tag_of_digest(digest: [u8; 32]) -> HeaderValue {
    let (half, _) = digest.split_at(16);
    quoted(
        &half
            .iter()
            .fold(0, |number: u128, byte| (number << 8) | u128::from(*byte)),
    )
}

/// Answers with a document and the tag of its version.
pub fn versioned_json<T: Serialize>(status: StatusCode, version: Version, document: T) -> Response {
    (status, [(header::ETAG, quoted(&version))], Json(document)).into_response()
}

/// True if `If-None-Match` names this tag.
pub fn client_has(headers: &HeaderMap, tag: &HeaderValue) -> bool {
    let Some(named) = headers
        .get(header::IF_NONE_MATCH)
        .and_then(|value| value.to_str().ok())
    else {
        return false;
    };
    let Ok(tag) = tag.to_str() else { return false };
    named
        .split(',')
        .map(str::trim)
        .any(|one| one == "*" || one.trim_start_matches("W/") == tag)
}

/// Returns the version that a change is meant for: `If-Match: "3"`, or `If-None-Match: *` for
/// something that must not exist yet.
///
/// # Errors
/// A [`Problem`] that names the refused value.
pub fn expected(headers: &HeaderMap) -> Result<Expected, Problem> {
    if let Some(text) = header_text(headers, &header::IF_MATCH)? {
        let version = text
            .strip_prefix('"')
            .and_then(|rest| rest.strip_suffix('"'));
        return version
            .and_then(|version| version.parse().ok())
            .map(Expected::Version)
            .ok_or_else(|| {
                let accepted = "the ETag of GET, such as \"3\"";
                Problem::refused("If-Match", text, accepted)
            });
    }
    match header_text(headers, &header::IF_NONE_MATCH)? {
        Some("*") => Ok(Expected::Absent),
        Some(other) => Err(Problem::refused("If-None-Match", other, "*")),
        None => {
            let detail = "send the ETag of GET as If-Match, or If-None-Match: * for a new one";
            let status = StatusCode::PRECONDITION_REQUIRED;
            Err(Problem::new(status, "precondition_required", detail).of_field("If-Match"))
        }
    }
}

/// Returns the version that a change of an existing object is meant for: `If-Match: "3"`.
///
/// # Errors
/// A [`Problem`] that names the refused value.
pub fn expected_version(headers: &HeaderMap) -> Result<Version, Problem> {
    match expected(headers)? {
        Expected::Version(version) => Ok(version),
        Expected::Any | Expected::Absent => {
            let detail = "send the ETag of GET as If-Match";
            let status = StatusCode::PRECONDITION_REQUIRED;
            Err(Problem::new(status, "precondition_required", detail).of_field("If-Match"))
        }
    }
}

fn quoted(tag: &impl std::fmt::Display) -> HeaderValue {
    HeaderValue::from_str(&format!("\"{tag}\"")).unwrap_or(HeaderValue::from_static("\"\""))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn headers(name: header::HeaderName, value: &'static str) -> HeaderMap {
        HeaderMap::from_iter([(name, HeaderValue::from_static(value))])
    }

    #[test]
    fn a_condition_names_a_version() {
        let expected = |name, value| expected(&headers(name, value));
        assert_eq!(
            expected(header::IF_MATCH, "\"3\"").unwrap(),
            Expected::Version(Version(3))
        );
        assert_eq!(
            expected(header::IF_NONE_MATCH, "*").unwrap(),
            Expected::Absent
        );
        for wrong in ["3", "\"x\"", "*", "W/\"3\"", "\"3\", \"4\"", "\""] {
            assert!(expected(header::IF_MATCH, wrong).is_err(), "{wrong}");
        }
        assert!(expected(header::IF_NONE_MATCH, "\"3\"").is_err());
        assert!(super::expected(&HeaderMap::new()).is_err());
    }

    #[test]
    fn a_client_that_has_the_bytes_says_so() {
        let tag = tag_of(b"x");
        let named = format!("\"0\", {}", tag.to_str().unwrap());
        let mut headers = HeaderMap::new();
        assert!(!client_has(&headers, &tag));
        headers.insert(
            header::IF_NONE_MATCH,
            HeaderValue::from_str(&named).unwrap(),
        );
        assert!(client_has(&headers, &tag));
        assert!(!client_has(&headers, &tag_of(b"y")));
    }
}
