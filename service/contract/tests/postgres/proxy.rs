//! A proxy before a server, which cuts the connection exactly at COMMIT, loses clients without the server's
//! notice, or counts how often clients wait for an answer.

use std::net::SocketAddr;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::sync::{Arc, Mutex};

use fleetcal_contract::own_server::url_of;
use fleetcal_store::database_url::{PostgresUrl, Server};
use tokio::io::{AsyncReadExt, AsyncWriteExt};
use tokio::net::tcp::{OwnedReadHalf, OwnedWriteHalf};
use tokio::net::{TcpListener, TcpStream};
use tokio::sync::Notify;

/// Point at which the connection of the next job or transaction is cut.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Cut {
    /// The server does not receive the COMMIT.
    BeforeCommit,
    /// The server has committed, and the client does not receive the answer.
    AfterCommit,
    /// The server does not receive the COMMIT of the next transaction, a job's or not, and keeps
    /// the connection.
    NeverCommits,
}

/// Proxy that runs as long as this value's runtime.
#[derive(Debug, Clone)]
pub struct Proxy {
    address: SocketAddr,
    armed: Arc<Mutex<Option<Cut>>>,
    lose_clients: Arc<Notify>,
    round_trips: Arc<AtomicUsize>,
}

impl Proxy {
    /// Starts a proxy before the server of a database; returns it with the database's address
    /// behind it.
    pub async fn before_database(direct: &PostgresUrl) -> (Self, PostgresUrl) {
        let Some(Server::Tcp { host, port }) = direct.servers.first() else {
            panic!("a proxy needs a server that listens on TCP, got {direct}");
        };
        let proxy = Self::before(format!("{host}:{port}")).await;
        let url = url_of(&[&proxy.host()], &direct.user, &direct.database);
        (proxy, url)
    }

    /// Begins to forward to a server.
    pub async fn before(server: String) -> Self {
        let listener = TcpListener::bind("127.0.0.1:0").await.unwrap();
        let proxy = Self {
            address: listener.local_addr().unwrap(),
            armed: Arc::default(),
            lose_clients: Arc::default(),
            round_trips: Arc::default(),
        };
        let here = proxy.clone();
        tokio::spawn(async move {
            while let Ok((client, _)) = listener.accept().await {
                let (here, server) = (here.clone(), server.clone());
                tokio::spawn(async move {
                    if let Ok(server) = TcpStream::connect(server).await {
                        here.serve(client, server).await;
                    }
                });
            }
        });
        proxy
    }

    /// Forwards until either side ends it; the server's side is kept open when clients are lost.
    async fn serve(&self, client: TcpStream, server: TcpStream) {
        let server = server.into_std().unwrap();
        let kept = server.try_clone().unwrap();
        let server = TcpStream::from_std(server).unwrap();
        tokio::select! {
            () = self.forward(client, server) => {}
            () = self.lose_clients.notified() => {
                // As when a machine is gone: the server hears nothing, until the test ends.
                std::future::pending::<()>().await;
            }
        }
        drop(kept);
    }

    /// Forwards until either side or a cut ends it; both connections are closed then.
    async fn forward(&self, client: TcpStream, server: TcpStream) {
        // Messages are forwarded one by one, and none waits for the answer to the one before.
        for side in [&client, &server] {
            side.set_nodelay(true).unwrap();
        }
        let (from_client, to_client) = client.into_split();
        let (from_server, to_server) = server.into_split();
        let muted = AtomicBool::new(false);
        tokio::select! {
            _ = self.requests(from_client, to_server, &muted) => {}
            _ = answers(from_server, to_client, &muted) => {}
        }
    }

    /// Forwards the client's messages one by one.
    async fn requests(
        &self,
        mut from: OwnedReadHalf,
        mut to: OwnedWriteHalf,
        muted: &AtomicBool,
    ) -> std::io::Result<()> {
        // The first message has no kind.
        let length = from.read_u32().await?;
        to.write_all(&message(None, &body(&mut from, length).await?))
            .await?;
        let mut is_job = false;
        loop {
            let kind = from.read_u8().await?;
            let length = from.read_u32().await?;
            let body = body(&mut from, length).await?;
            let asked = (kind == b'Q').then_some(body.as_slice());
            if let Some(begin) = asked.filter(|sql| sql.starts_with(b"BEGIN")) {
                is_job = begin.ends_with(b"SERIALIZABLE\0");
            }
            let is_meant = |cut: &mut Cut| is_job || *cut == Cut::NeverCommits;
            let commits = asked == Some(b"COMMIT\0");
            let cut = commits.then(|| self.armed.lock().unwrap().take_if(is_meant));
            let cut = cut.flatten();
            match cut {
                Some(Cut::BeforeCommit) => return Ok(()),
                Some(Cut::NeverCommits) => std::future::pending::<()>().await,
                Some(Cut::AfterCommit) => muted.store(true, Ordering::SeqCst),
                None => {}
            }
            // A query of words alone, or the end of a prepared one.
            if matches!(kind, b'Q' | b'S') {
                self.round_trips.fetch_add(1, Ordering::SeqCst);
            }
            to.write_all(&message(Some(kind), &body)).await?;
            if cut.is_some() {
                // The answer's side ends it.
                std::future::pending::<()>().await;
            }
        }
    }

    /// Returns the number of requests so far that clients awaited an answer to.
    pub fn round_trips(&self) -> usize {
        self.round_trips.load(Ordering::SeqCst)
    }

    /// Ends every client's connection without the server's notice.
    pub fn lose_clients(&self) {
        self.lose_clients.notify_waiters();
    }

    /// Returns the address that it listens on.
    pub fn host(&self) -> String {
        self.address.to_string()
    }

    /// Cuts the connection of the next job, or transaction, that commits.
    pub fn cut_next(&self, cut: Cut) {
        *self.armed.lock().unwrap() = Some(cut);
    }

    /// True if the requested cut has not happened yet.
    pub fn is_armed(&self) -> bool {
        self.armed.lock().unwrap().is_some()
    }
}

/// Forwards the server's bytes.
async fn answers(
    mut from: OwnedReadHalf,
    mut to: OwnedWriteHalf,
    muted: &AtomicBool,
) -> std::io::Result<()> {
    let mut bytes = vec![0; 64 * 1_024];
    loop {
        let count = from.read(&mut bytes).await?;
        if count == 0 || muted.load(Ordering::SeqCst) {
            return Ok(());
        }
        to.write_all(&bytes[..count]).await?;
    }
}

async fn body(from: &mut OwnedReadHalf, length: u32) -> std::io::Result<Vec<u8>> {
    let mut body = vec![0; length as usize - 4];
    from.read_exact(&mut body).await?;
    Ok(body)
}

fn message(kind: Option<u8>, body: &[u8]) -> Vec<u8> {
    let mut message: Vec<u8> = kind.into_iter().collect();
    message.extend((body.len() as u32 + 4).to_be_bytes());
    message.extend(body);
    message
}
