//! The dashboard's pages, embedded into the program.

use axum::http::{HeaderMap, HeaderValue, Method, StatusCode, Uri, header};
use axum::response::{IntoResponse, Response};
use rust_embed::{EmbeddedFile, RustEmbed};

use super::etag;
use super::problem::Problem;

/// What the dashboard's build makes.
#[derive(RustEmbed)]
#[folder = "../web/dist"]
#[allow_missing = true]
struct Pages;

/// The page that every address of the dashboard is.
const INDEX: &str = "index.html";
/// Folder of files whose names change with their contents.
const HASHED: &str = "assets/";
/// What stands in place of pages that were not built.
const NOT_BUILT: &str =
    "The dashboard is not part of this build: run `make dashboard` and build fleetcal again.\n";

/// Answers everything that is no route of the API.
pub(super) async fn pages(method: Method, uri: Uri, headers: HeaderMap) -> Response {
    answer(&method, uri.path(), &headers, Pages::get)
}

fn answer(
    method: &Method,
    path: &str,
    headers: &HeaderMap,
    get: impl Fn(&str) -> Option<EmbeddedFile>,
) -> Response {
    if path == "/api" || path.starts_with("/api/") {
        return Problem::not_found(path).into_response();
    }
    if method != Method::GET && method != Method::HEAD {
        return Problem::method_refused(method, path).into_response();
    }
    let name = path.trim_start_matches('/');
    if let Some(file) = get(name).filter(|_| name != INDEX) {
        return embedded(name, &file, headers);
    }
    // An address of the dashboard has no ending; a missing file must not look like a page.
    let is_file = name
        .rsplit('/')
        .next()
        .is_some_and(|last| last.contains('.'));
    if is_file && name != INDEX {
        return Problem::not_found(path).into_response();
    }
    match get(INDEX) {
        Some(index) => embedded(INDEX, &index, headers),
        None if name.is_empty() => (StatusCode::NOT_FOUND, NOT_BUILT).into_response(),
        None => Problem::not_found(path).into_response(),
    }
}

fn embedded(name: &str, file: &EmbeddedFile, headers: &HeaderMap) -> Response {
    let tag = etag::tag_of(&file.data);
    let caching = if name.starts_with(HASHED) {
        HeaderValue::from_static("public, max-age=31536000, immutable")
    } else {
        HeaderValue::from_static("no-cache")
    };
    let cached = [
        (header::ETAG, tag.clone()),
        (header::CACHE_CONTROL, caching),
    ];
    if etag::client_has(headers, &tag) {
        return (StatusCode::NOT_MODIFIED, cached).into_response();
    }
    let mime = HeaderValue::from_str(file.metadata.mimetype())
        .unwrap_or(HeaderValue::from_static("application/octet-stream"));
    (cached, [(header::CONTENT_TYPE, mime)], file.data.clone()).into_response()
}
