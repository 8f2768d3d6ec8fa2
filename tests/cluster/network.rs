//! Network between an instance and its database or its router, and how it fails: as a network
//! that loses the packets of one direction or of both, or as one that is slow.

use std::net::SocketAddr;
use std::time::Duration;

use tokio::io::{AsyncReadExt, AsyncWriteExt};
use tokio::net::tcp::{OwnedReadHalf, OwnedWriteHalf};
use tokio::net::{TcpListener, TcpStream};
use tokio::sync::{mpsc, watch};
use tokio::time::Instant;

use crate::namespaces::Wire;

/// Most pieces of 64 KiB that a direction holds in flight.
const ON_THEIR_WAY_MAX: usize = 256;

/// Direction of lost bytes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Cut {
    /// Both directions.
    Both,
    /// Bytes from the instance.
    FromInstance,
    /// Bytes to the instance.
    ToInstance,
}

/// A line between an instance and one server.
#[derive(Debug, Clone)]
pub enum Line {
    /// A TCP proxy, which holds bytes back instead of losing packets.
    Proxy(Proxy),
    /// The virtual Ethernet of the instance's own network namespace, where packets are lost.
    Wire(Wire),
}

impl Line {
    /// Returns the address that the instance connects to, `HOST:PORT`.
    pub fn address(&self) -> String {
        match self {
            Self::Proxy(proxy) => proxy.address(),
            Self::Wire(wire) => wire.server.to_string(),
        }
    }

    /// Cuts it from now on.
    pub fn cut(&self, cut: Cut) {
        match self {
            Self::Proxy(proxy) => drop(proxy.cut.send_replace(Some(cut))),
            Self::Wire(wire) => wire.cut(cut),
        }
    }

    /// Forwards everything again.
    pub fn heal(&self) {
        match self {
            Self::Proxy(proxy) => drop(proxy.cut.send_replace(None)),
            Self::Wire(wire) => wire.heal(),
        }
    }

    /// Delays all bytes from now on, in either direction. A wire has no delay.
    pub fn delay(&self, delay: Duration) {
        match self {
            Self::Proxy(proxy) => drop(proxy.delay.send_replace(delay)),
            Self::Wire(_) => panic!("a wire has no delay"),
        }
    }
}

/// Lines between an instance and the others.
#[derive(Debug)]
pub struct Lines {
    /// Line to the database.
    pub database: Line,
    /// Line to its router.
    pub router: Line,
}

/// Proxy that runs as long as the runtime that has started it.
#[derive(Debug, Clone)]
pub struct Proxy {
    address: SocketAddr,
    cut: watch::Sender<Option<Cut>>,
    delay: watch::Sender<Duration>,
}

impl Proxy {
    /// Begins to forward to a server, `HOST:PORT`.
    pub async fn before(server: String) -> Self {
        let listener = TcpListener::bind("127.0.0.1:0").await.unwrap();
        let address = listener.local_addr().unwrap();
        let proxy = Self {
            address,
            cut: watch::Sender::new(None),
            delay: watch::Sender::new(Duration::ZERO),
        };
        let serving = proxy.clone();
        tokio::spawn(async move {
            while let Ok((instance, _)) = listener.accept().await {
                tokio::spawn(serving.clone().serve(instance, server.clone()));
            }
        });
        proxy
    }

    /// Returns the address that it listens on.
    pub fn address(&self) -> String {
        self.address.to_string()
    }

    async fn serve(self, instance: TcpStream, server: String) {
        // A connection that begins during a cut comes through after it.
        passes(&mut self.cut.subscribe(), Cut::FromInstance).await;
        let Ok(server) = TcpStream::connect(server).await else {
            return;
        };
        for side in [&instance, &server] {
            side.set_nodelay(true).unwrap();
        }
        let (from_instance, to_instance) = instance.into_split();
        let (from_server, to_server) = server.into_split();
        tokio::select! {
            () = self.forward(from_instance, to_server, Cut::FromInstance) => {}
            () = self.forward(from_server, to_instance, Cut::ToInstance) => {}
        }
    }

    /// Forwards one direction until it ends or the other side is gone.
    async fn forward(&self, from: OwnedReadHalf, to: OwnedWriteHalf, direction: Cut) {
        let (way, arrives) = mpsc::channel(ON_THEIR_WAY_MAX);
        tokio::join!(
            self.send(from, way),
            deliver(arrives, to, self.cut.subscribe(), direction)
        );
    }

    async fn send(&self, mut from: OwnedReadHalf, way: mpsc::Sender<(Instant, Vec<u8>)>) {
        let mut bytes = vec![0; 64 * 1_024];
        loop {
            let count = tokio::select! {
                read = from.read(&mut bytes) => read.unwrap_or(0),
                () = way.closed() => 0,
            };
            let arrives_at = Instant::now() + *self.delay.borrow();
            let sent = way.send((arrives_at, bytes[..count].to_vec())).await;
            if count == 0 || sent.is_err() {
                return;
            }
        }
    }
}

/// Writes arriving bytes when they are due; an empty piece marks the end.
async fn deliver(
    mut arrives: mpsc::Receiver<(Instant, Vec<u8>)>,
    mut to: OwnedWriteHalf,
    mut cut: watch::Receiver<Option<Cut>>,
    direction: Cut,
) {
    while let Some((at, bytes)) = arrives.recv().await {
        // Even a moment that has passed costs a tick of the timer.
        if at > Instant::now() {
            tokio::time::sleep_until(at).await;
        }
        passes(&mut cut, direction).await;
        if bytes.is_empty() || to.write_all(&bytes).await.is_err() {
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
