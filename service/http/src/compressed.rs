//! The event stream as gzip: each event is a flushed block of its own, so that none waits for the
//! next, and all share one window, in which the names of fields are written once.

use std::convert::Infallible;
use std::io::Write;

use axum::body::{Body, Bytes};
use axum::http::{HeaderMap, HeaderValue, header};
use axum::response::Response;
use flate2::Compression;
use flate2::write::GzEncoder;
use futures::StreamExt;

/// True if a client accepts gzip.
pub fn is_accepted(headers: &HeaderMap) -> bool {
    let accepted = headers.get_all(header::ACCEPT_ENCODING).iter();
    let mut codings = accepted
        .filter_map(|value| value.to_str().ok())
        .flat_map(|value| value.split(','));
    codings.any(|coding| {
        let mut parts = coding.split(';').map(str::trim);
        let is_gzip = parts
            .next()
            .is_some_and(|name| name.eq_ignore_ascii_case("gzip"));
        let refused = parts.any(|part| matches!(part, "q=0" | "q=0.0" | "q=0.00" | "q=0.000"));
        is_gzip && !refused
    })
}

/// Compresses a response.
pub fn gzip(response: Response) -> Response {
    let (mut parts, body) = response.into_parts();
    let headers = &mut parts.headers;
    headers.insert(header::CONTENT_ENCODING, HeaderValue::from_static("gzip"));
    headers.append(header::VARY, HeaderValue::from_static("accept-encoding"));
    headers.remove(header::CONTENT_LENGTH);
    let mut encoder = GzEncoder::new(Vec::new(), Compression::fast());
    let blocks = body.into_data_stream().map(move |chunk| {
        // The stream of events cannot fail, and neither can a write to memory.
        let chunk = chunk.unwrap_or_default();
        let written = encoder.write_all(&chunk).and_then(|()| encoder.flush());
        if let Err(error) = written {
            tracing::error!(%error, "an event cannot be compressed");
        }
        Ok::<_, Infallible>(Bytes::from(std::mem::take(encoder.get_mut())))
    });
    Response::from_parts(parts, Body::from_stream(blocks))
}

#[cfg(test)]
mod tests {
    use std::io::Read;

    use flate2::read::MultiGzDecoder;
    use futures::stream;

    use super::*;

    fn accepts(coding: &str) -> bool {
        let mut headers = HeaderMap::new();
        headers.insert(header::ACCEPT_ENCODING, coding.parse().unwrap());
        is_accepted(&headers)
    }

    #[test]
    fn who_refuses_gzip_gets_none() {
        assert!(accepts("gzip, deflate, br, zstd"));
        assert!(accepts("br, GZIP;q=0.8"));
        assert!(!accepts("gzip;q=0, br"));
        assert!(!accepts("identity"));
        assert!(!is_accepted(&HeaderMap::new()));
    }

    #[tokio::test]
    async fn each_event_can_be_read_before_the_next_one_comes() {
        let events = ["event: a\n\n", "event: b\n\n"];
        let body = stream::iter(events.map(Ok::<_, Infallible>));
        let response = gzip(Response::new(Body::from_stream(body)));
        assert_eq!(response.headers()[header::CONTENT_ENCODING], "gzip");
        let mut blocks = response.into_body().into_data_stream();
        let mut sent = Vec::new();
        let mut read = String::new();
        for event in events {
            sent.extend_from_slice(&blocks.next().await.unwrap().unwrap());
            let mut decoder = MultiGzDecoder::new(sent.as_slice());
            let mut so_far = vec![0; read.len() + event.len()];
            decoder.read_exact(&mut so_far).unwrap();
            read.push_str(event);
            assert_eq!(so_far, read.as_bytes());
        }
    }
}
