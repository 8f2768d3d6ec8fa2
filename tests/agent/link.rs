//! A radio link that can fade: connections stay open, new ones are taken, and nothing comes through.

use tokio::io::{AsyncRead, AsyncReadExt as _, AsyncWrite, AsyncWriteExt as _};
use tokio::net::{TcpListener, TcpStream};
use tokio::sync::watch;

pub struct Link {
    pub endpoint: String,
    carries: watch::Sender<bool>,
}

impl Link {
    /// Makes a link to a router's endpoint.
    pub async fn to(router: &str) -> Self {
        let router = router.strip_prefix("tcp/").unwrap().to_owned();
        let listener = TcpListener::bind("127.0.0.1:0").await.unwrap();
        let endpoint = format!("tcp/{}", listener.local_addr().unwrap());
        let (carries, watched) = watch::channel(true);
        tokio::spawn(async move {
            loop {
                let (near, _) = listener.accept().await.unwrap();
                let (from_near, to_near) = near.into_split();
                let (from_far, to_far) = TcpStream::connect(&router).await.unwrap().into_split();
                tokio::spawn(carry(from_near, to_far, watched.clone()));
                tokio::spawn(carry(from_far, to_near, watched.clone()));
            }
        });
        Self { endpoint, carries }
    }

    pub fn carries(&self, whether: bool) {
        self.carries.send(whether).unwrap();
    }
}

/// Forwards until either end closes, or the test ends.
async fn carry(
    mut from: impl AsyncRead + Unpin,
    mut to: impl AsyncWrite + Unpin,
    mut carries: watch::Receiver<bool>,
) {
    let mut buffer = [0; 4096];
    while let Ok(length) = from.read(&mut buffer).await {
        if length == 0 || carries.wait_for(|carries| *carries).await.is_err() {
            return;
        }
        if to.write_all(&buffer[..length]).await.is_err() {
            return;
        }
    }
}
