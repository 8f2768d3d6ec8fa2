//! Pages of the dashboard, embedded into the program.

use axum::http::{HeaderMap, HeaderValue, Method, StatusCode, Uri, header};
use axum::response::{IntoResponse, Response};
use rust_embed::{EmbeddedFile, RustEmbed};

use super::etag;
use super::problem::Problem;

/// Files of the dashboard's build.
#[derive(RustEmbed)]
#[folder = "../../web/dist"]
#[allow_missing = true]
struct Pages;

/// Page at every address of the dashboard.
const INDEX: &str = "index.html";
/// Folder of files whose names change with their contents.
const HASHED: &str = "assets/";
/// Text in place of pages that were not built.
const NOT_BUILT: &str =
    "The dashboard is not part of this build: run `make dashboard` and build fleetcal again.\n";

/// Answers every request outside the API.
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
    // The digest is the build's: hashing a file for each request would be most of its cost.
    let tag = etag::tag_of_digest(file.metadata.sha256_hash());
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

#[cfg(test)]
mod tests {
    use std::borrow::Cow;

    use axum::body::to_bytes;
    use rust_embed::Metadata;

    use super::*;

    fn file(name: &str) -> Option<EmbeddedFile> {
        let (data, mimetype): (&[u8], _) = match name {
            "index.html" => (b"<!doctype html>", "text/html"),
            "assets/main-abc123.js" => (b"main()", "text/javascript"),
            "favicon.svg" => (b"<svg/>", "image/svg+xml"),
            _ => return None,
        };
        let metadata = Metadata::__rust_embed_new([0; 32], None, None, mimetype);
        Some(EmbeddedFile {
            data: Cow::Borrowed(data),
            metadata,
        })
    }

    async fn get(path: &str, built: bool) -> (u16, String, String) {
        let get = |name: &str| file(name).filter(|_| built);
        let response = answer(&Method::GET, path, &HeaderMap::new(), get);
        let caching = response.headers().get(header::CACHE_CONTROL);
        let caching = caching
            .map_or("", |value| value.to_str().unwrap())
            .to_owned();
        let status = response.status().as_u16();
        let body = to_bytes(response.into_body(), 1_000).await.unwrap();
        (status, caching, String::from_utf8(body.to_vec()).unwrap())
    }

    #[tokio::test]
    async fn every_address_of_the_dashboard_is_its_page() {
        let page = (200, "no-cache".to_owned(), "<!doctype html>".to_owned());
        for path in ["/", "/index.html", "/robots/tugger_01", "/settings"] {
            assert_eq!(get(path, true).await, page, "{path}");
        }
    }

    #[tokio::test]
    async fn files_whose_names_change_are_kept_for_ever() {
        let (status, caching, body) = get("/assets/main-abc123.js", true).await;
        assert_eq!((status, body.as_str()), (200, "main()"));
        assert_eq!(caching, "public, max-age=31536000, immutable");
        assert_eq!(get("/favicon.svg", true).await.1, "no-cache");
        assert_eq!(get("/assets/main-000000.js", true).await.0, 404);
    }

    #[tokio::test]
    async fn a_file_that_the_client_has_is_not_sent_again() {
        let first = answer(&Method::GET, "/favicon.svg", &HeaderMap::new(), file);
        let tag = first.headers()[header::ETAG].clone();
        let has = HeaderMap::from_iter([(header::IF_NONE_MATCH, tag)]);
        let again = answer(&Method::GET, "/favicon.svg", &has, file);
        assert_eq!(again.status(), StatusCode::NOT_MODIFIED);
    }

    #[tokio::test]
    async fn without_pages_it_says_how_to_build_them() {
        let (status, _, body) = get("/", false).await;
        assert_eq!((status, body.contains("make dashboard")), (404, true));
        assert_eq!(get("/robots/a", false).await.0, 404);
    }
}
