//! A TCP proxy between an instance and its database or its router, which can hold back the bytes of
//! either direction or of both, as a network does that loses them: what waits goes on when the cut
//! is healed, and neither side is told that the other one has closed its end before.

use std::net::SocketAddr;

use tokio::io::{AsyncReadExt, AsyncWriteExt};
use tokio::net::tcp::{OwnedReadHalf, OwnedWriteHalf};
use tokio::net::{TcpListener, TcpStream};
use tokio::sync::watch;

/// Which bytes are held back.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Cut {
    /// All of them.
    Both,
    /// What the instance sends.
    FromInstance,
    /// What is sent to the instance.
    ToInstance,
}

/// A proxy that runs as long as this value's runtime.
#[derive(Debug, Clone)]
pub struct Proxy {
    address: SocketAddr,
    cut: watch::Sender<Option<Cut>>,
}

impl Proxy {
    /// Begins to forward to a server, `HOST:PORT`.
    pub async fn before(server: String) -> Self {
        let listener = TcpListener::bind("127.0.0.1:0").await.unwrap();
        let address = listener.local_addr().unwrap();
        let (cut, seen) = watch::channel(None);
        tokio::spawn(async move {
            while let Ok((instance, _)) = listener.accept().await {
                tokio::spawn(serve(instance, server.clone(), seen.clone()));
            }
        });
        Self { address, cut }
    }

    /// Where it listens.
    pub fn address(&self) -> String {
        self.address.to_string()
    }

    /// Holds bytes back from now on.
    pub fn cut(&self, cut: Cut) {
        self.cut.send_replace(Some(cut));
    }

    /// Lets everything through again.
    pub fn heal(&self) {
        self.cut.send_replace(None);
    }
}

async fn serve(instance: TcpStream, server: String, mut cut: watch::Receiver<Option<Cut>>) {
    // A connection that begins during a cut comes through after it.
    passes(&mut cut, Cut::FromInstance).await;
    let Ok(server) = TcpStream::connect(server).await else {
        return;
    };
    for side in [&instance, &server] {
        side.set_nodelay(true).unwrap();
    }
    let (from_instance, to_instance) = instance.into_split();
    let (from_server, to_server) = server.into_split();
    tokio::select! {
        () = forward(from_instance, to_server, cut.clone(), Cut::FromInstance) => {}
        () = forward(from_server, to_instance, cut, Cut::ToInstance) => {}
    }
}

/// Forwards one direction until it ends or the other side is gone.
async fn forward(
    mut from: OwnedReadHalf,
    mut to: OwnedWriteHalf,
    mut cut: watch::Receiver<Option<Cut>>,
    direction: Cut,
) {
    let mut bytes = vec![0; 64 * 1_024];
    loop {
        let count = from.read(&mut bytes).await.unwrap_or(0);
        passes(&mut cut, direction).await;
        if count == 0 || to.write_all(&bytes[..count]).await.is_err() {
            return;
        }
    }
}

/// Waits while a direction is cut.
async fn passes(cut: &mut watch::Receiver<Option<Cut>>, direction: Cut) {
    let open = |cut: &Option<Cut>| cut.is_none_or(|cut| cut != Cut::Both && cut != direction);
    if cut.wait_for(open).await.is_err() {
        // The test has ended.
        std::future::pending::<()>().await;
    }
}
