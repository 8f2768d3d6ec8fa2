//! A GET and a PUT, without a client library: the answers are small and end with the connection.

use std::io::{Read, Write};
use std::net::{SocketAddr, TcpStream};
use std::time::Duration;

/// An answer.
#[derive(Debug, Clone)]
pub struct Answer {
    /// Its status.
    pub status: u16,
    /// Its body.
    pub body: String,
}

/// Puts a new JSON document at `path` with an API token; `None` when nobody answers.
pub fn put(address: SocketAddr, path: &str, token: &str, body: &str) -> Option<Answer> {
    let length = body.len();
    exchange(
        address,
        &format!(
            "PUT {path} HTTP/1.1\r\nHost: {address}\r\nAuthorization: Bearer {token}\r\n\
             If-None-Match: *\r\nContent-Type: application/json\r\nContent-Length: {length}\r\n\
             Connection: close\r\n\r\n{body}"
        ),
    )
}

/// Asks for `path` with an API token, or without; `None` when nobody answers.
pub fn get(address: SocketAddr, path: &str, token: Option<&str>) -> Option<Answer> {
    let credential = token.map_or_else(String::new, |token| {
        format!("Authorization: Bearer {token}\r\n")
    });
    exchange(
        address,
        &format!("GET {path} HTTP/1.1\r\nHost: {address}\r\n{credential}Connection: close\r\n\r\n"),
    )
}

fn exchange(address: SocketAddr, request: &str) -> Option<Answer> {
    let mut connection = TcpStream::connect(address).ok()?;
    connection
        .set_read_timeout(Some(Duration::from_secs(10)))
        .ok()?;
    connection.write_all(request.as_bytes()).ok()?;
    let mut answer = String::new();
    connection.read_to_string(&mut answer).ok()?;
    let (head, body) = answer.split_once("\r\n\r\n")?;
    let status = head.split(' ').nth(1)?.parse().ok()?;
    Some(Answer {
        status,
        body: body.to_owned(),
    })
}
