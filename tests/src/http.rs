//! Requests, without a client library: the answers are small and end with the connection.

use std::io::{Read, Write};
use std::net::{SocketAddr, TcpStream};
use std::time::Duration;

/// An HTTP answer.
#[derive(Debug, Clone)]
pub struct Answer {
    /// Its status.
    pub status: u16,
    /// Its body.
    pub body: String,
}

/// Puts a new JSON document at `path` with an API token; `None` without an answer.
pub fn put(address: SocketAddr, path: &str, token: &str, body: &str) -> Option<Answer> {
    let content = Some(("If-None-Match: *\r\n", body));
    send(address, &format!("PUT {path}"), Some(token), content)
}

/// Requests `path` with an API token, or without; `None` without an answer.
pub fn get(address: SocketAddr, path: &str, token: Option<&str>) -> Option<Answer> {
    send(address, &format!("GET {path}"), token, None)
}

/// Sends a request, `PUT /path`; the content is further headers, each with its line's end, and a
/// body in JSON. `None` without an answer.
pub fn send(
    address: SocketAddr,
    request: &str,
    token: Option<&str>,
    content: Option<(&str, &str)>,
) -> Option<Answer> {
    let credential = token.map_or_else(String::new, |token| {
        format!("Authorization: Bearer {token}\r\n")
    });
    let mut connection = TcpStream::connect(address).ok()?;
    connection
        .set_read_timeout(Some(Duration::from_secs(10)))
        .ok()?;
    let (headers, body) = content.unwrap_or_default();
    let length = body.len();
    let request = format!(
        "{request} HTTP/1.1\r\nHost: {address}\r\n{credential}{headers}Content-Type: application/json\r\n\
         Content-Length: {length}\r\nConnection: close\r\n\r\n{body}"
    );
    connection.write_all(request.as_bytes()).ok()?;
    let mut answer = String::new();
    connection.read_to_string(&mut answer).ok()?;
    let (head, body) = answer.split_once("\r\n\r\n")?;
    let status = head.split(' ').nth(1)?.parse().ok()?;
    let is_chunked = head
        .to_ascii_lowercase()
        .contains("\r\ntransfer-encoding: chunked");
    let body = if is_chunked {
        joined(body)?
    } else {
        body.to_owned()
    };
    Some(Answer { status, body })
}

/// Joins the chunks of a body; `None` if its end is missing.
fn joined(mut chunks: &str) -> Option<String> {
    let mut body = String::new();
    loop {
        let (length, rest) = chunks.split_once("\r\n")?;
        let length = usize::from_str_radix(length, 16).ok()?;
        if length == 0 {
            return Some(body);
        }
        body.push_str(rest.get(..length)?);
        chunks = rest.get(length..)?.strip_prefix("\r\n")?;
    }
}
