//! Accept loop on a real socket.

use std::time::Duration;

use tokio::io::{AsyncReadExt, AsyncWriteExt};
use tokio::net::{TcpListener, TcpStream};
use tokio::task::JoinHandle;

use super::*;
use crate::serve;

async fn served(bench: &Bench) -> (std::net::SocketAddr, JoinHandle<()>) {
    let listener = TcpListener::bind("127.0.0.1:0").await.unwrap();
    let address = listener.local_addr().unwrap();
    (
        address,
        tokio::spawn(
            serve(
                listener,
                bench.routes.clone(),
                bench.setup.connections.clone(),
                bench.stop.clone(),
            )
            .unwrap(),
        ),
    )
}

/// Sends bytes and reads until the other side closes.
async fn talk(address: std::net::SocketAddr, bytes: &[u8]) -> String {
    let mut socket = TcpStream::connect(address).await.unwrap();
    socket.write_all(bytes).await.unwrap();
    let mut answer = Vec::new();
    // A reset after the answer is as good as an end.
    drop(socket.read_to_end(&mut answer).await);
    String::from_utf8_lossy(&answer).into_owned()
}

#[tokio::test]
async fn a_slow_header_is_given_up_and_others_are_served_meanwhile() {
    let bench = bench(&[]).await;
    let (address, _) = served(&bench).await;
    let slow = tokio::spawn(talk(
        address,
        b"GET /healthz HTTP/1.1\r\nHost: localhost\r\nX-Slow",
    ));
    let quick = talk(
        address,
        b"GET /healthz HTTP/1.1\r\nHost: localhost\r\nConnection: close\r\n\r\n",
    )
    .await;
    assert!(quick.starts_with("HTTP/1.1 200"), "{quick}");
    assert!(!slow.is_finished());
    let answer = tokio::time::timeout(Duration::from_secs(15), slow)
        .await
        .unwrap()
        .unwrap();
    assert!(!answer.starts_with("HTTP/1.1 200"), "{answer}");
}

#[tokio::test]
async fn a_slow_body_is_a_problem_in_time() {
    let bench = bench(&[]).await;
    let (address, _) = served(&bench).await;
    let request = format!(
        "PUT /api/v1/robots/a HTTP/1.1\r\nHost: localhost\r\nIf-None-Match: *\r\n\
         Authorization: Bearer {}\r\nContent-Type: application/json\r\nContent-Length: 100\r\n\
         Connection: close\r\n\r\n{{",
        bench.token
    );
    let answer = tokio::time::timeout(Duration::from_secs(15), talk(address, request.as_bytes()))
        .await
        .unwrap();
    assert!(answer.starts_with("HTTP/1.1 503"), "{answer}");
    assert!(answer.contains("application/problem+json"), "{answer}");
}

#[tokio::test]
async fn garbage_ends_one_connection() {
    let bench = bench(&[]).await;
    let (address, _) = served(&bench).await;
    for garbage in [
        &b"\x16\x03\x01\x02\x00\x01\x00\x01\xfc\x03\x03"[..],
        b"GET\r\n\r\n",
        b"GET / HTTP/9.9\r\n\r\n",
        b"\0\0\0\0\r\n\r\n",
    ] {
        let answer = talk(address, garbage).await;
        assert!(
            answer.is_empty() || answer.starts_with("HTTP/1.1 400"),
            "{answer}"
        );
    }
    let long = format!(
        "GET /{} HTTP/1.1\r\nHost: localhost\r\n\r\n",
        "x".repeat(100_000)
    );
    let answer = talk(address, long.as_bytes()).await;
    assert!(!answer.starts_with("HTTP/1.1 200"), "{answer}");
    let fine = talk(
        address,
        b"GET /healthz HTTP/1.1\r\nHost: localhost\r\nConnection: close\r\n\r\n",
    )
    .await;
    assert!(fine.starts_with("HTTP/1.1 200"), "{fine}");
}

#[tokio::test]
async fn a_shutdown_ends_streams_and_idle_connections() {
    let bench = bench(&[]).await;
    let (address, server) = served(&bench).await;
    let request = format!(
        "GET /api/v1/stream HTTP/1.1\r\nHost: localhost\r\nAuthorization: Bearer {}\r\n\r\n",
        bench.token
    );
    let stream = tokio::spawn(async move { talk(address, request.as_bytes()).await });
    let idle = tokio::spawn(talk(
        address,
        b"GET /healthz HTTP/1.1\r\nHost: localhost\r\n\r\n",
    ));
    // Both have been answered once a third request has.
    talk(
        address,
        b"GET /healthz HTTP/1.1\r\nHost: localhost\r\nConnection: close\r\n\r\n",
    )
    .await;
    bench.stop.cancel();
    let ended = async {
        server.await.unwrap();
        (stream.await.unwrap(), idle.await.unwrap())
    };
    tokio::time::timeout(Duration::from_secs(3), ended)
        .await
        .unwrap();
    assert!(TcpStream::connect(address).await.is_err());
}
