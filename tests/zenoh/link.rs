//! A link that can be cut: its connections end, and new ones end at once until it is mended.

use std::net::SocketAddr;

use tokio::io::copy_bidirectional;
use tokio::net::{TcpListener, TcpStream};
use tokio::sync::watch;

pub struct Link {
    pub endpoint: String,
    carries: watch::Sender<bool>,
}

impl Link {
    /// Makes a link to a router.
    pub async fn to(router: SocketAddr) -> Self {
        let listener = TcpListener::bind("127.0.0.1:0").await.unwrap();
        let endpoint = format!("tcp/{}", listener.local_addr().unwrap());
        let (carries, watched) = watch::channel(true);
        tokio::spawn(async move {
            loop {
                let (near, _) = listener.accept().await.unwrap();
                if *watched.borrow() {
                    tokio::spawn(carry(near, router, watched.clone()));
                }
            }
        });
        Self { endpoint, carries }
    }

    pub fn carries(&self, whether: bool) {
        self.carries.send(whether).unwrap();
    }
}

/// Forwards until either end closes, or the link is cut.
async fn carry(mut near: TcpStream, router: SocketAddr, mut carries: watch::Receiver<bool>) {
    let Ok(mut far) = TcpStream::connect(router).await else {
        return;
    };
    tokio::select! {
        _ = copy_bidirectional(&mut near, &mut far) => {}
        _ = carries.wait_for(|carries| !carries) => {}
    }
}
