//! Accepting connections on a thread of its own: who has no place is refused at the cost of an
//! accept, and whoever has one does not wait behind the work of the service.

use std::io::{self, ErrorKind};
use std::net::SocketAddr;
use std::sync::Arc;
use std::thread;
use std::time::Duration;

use fleetcal_domain::limits;
use tokio::net::{TcpListener, TcpSocket, TcpStream};
use tokio::runtime;
use tokio::sync::mpsc;
use tokio_util::sync::CancellationToken;

use super::client_address::PeerAddress;
use super::connections::{Connections, Place};
use super::refusal::Turned;

/// Wait after a failed accept, which mostly means that the process has no file left to open.
const ACCEPT_RETRY: Duration = Duration::from_millis(100);
/// Name of the thread.
const THREAD: &str = "http-accept";

/// Listens on an address, with a backlog for more connections than come at once in a flood: the
/// system does not answer further ones, and their clients retry only after seconds.
///
/// # Errors
/// The address is in use, or cannot be listened on.
pub fn listen(address: SocketAddr) -> io::Result<TcpListener> {
    let socket = match address {
        SocketAddr::V4(_) => TcpSocket::new_v4()?,
        SocketAddr::V6(_) => TcpSocket::new_v6()?,
    };
    // A restart must not wait for the connections of the run before.
    socket.set_reuseaddr(true)?;
    // Each connection has the same. The system would let it grow to megabytes for a peer that does
    // not read.
    socket.set_send_buffer_size(limits::HTTP_SEND_BUFFER_BYTES)?;
    socket.bind(address)?;
    socket.listen(limits::HTTP_BACKLOG)
}

/// An accepted connection, and its place.
pub(crate) type Accepted = (std::net::TcpStream, Arc<Place>);

/// Begins to accept, until `stop`; then the listener is closed.
///
/// # Errors
/// The system refuses to create a thread.
pub(crate) fn begin(
    listener: TcpListener,
    connections: Connections,
    stop: CancellationToken,
) -> io::Result<mpsc::Receiver<Accepted>> {
    let (accepted, places) = mpsc::channel(limits::HTTP_CONNECTIONS_MAX);
    let listener = listener.into_std()?;
    let runtime = runtime::Builder::new_current_thread()
        .enable_all()
        .build()?;
    let accepting = async move {
        let accepting = async {
            // A listener belongs to the runtime in which it was made.
            let listener = TcpListener::from_std(listener)?;
            accept_all(&listener, &connections, &accepted).await
        };
        tokio::select! {
            () = stop.cancelled() => {}
            ended = accepting => if let Err(error) = ended {
                tracing::error!(%error, "HTTP connections cannot be accepted");
            }
        }
    };
    thread::Builder::new()
        .name(THREAD.to_owned())
        .spawn(move || runtime.block_on(accepting))?;
    Ok(places)
}

/// Accepts until the receiver of the connections is gone. It never waits for a place, or probes
/// would wait behind all other clients.
async fn accept_all(
    listener: &TcpListener,
    connections: &Connections,
    accepted: &mpsc::Sender<Accepted>,
) -> io::Result<()> {
    while !accepted.is_closed() {
        match listener.accept().await {
            Ok((socket, peer)) => admit(socket, peer, connections, accepted),
            Err(error) if is_of_peer(error.kind()) => {}
            Err(error) => {
                tracing::error!(%error, "an HTTP connection could not be accepted");
                connections.make_room();
                tokio::time::sleep(ACCEPT_RETRY).await;
            }
        }
    }
    Ok(())
}

/// Hands a connection over if there is a place for it, and refuses it otherwise.
fn admit(
    socket: TcpStream,
    peer: SocketAddr,
    connections: &Connections,
    accepted: &mpsc::Sender<Accepted>,
) {
    let handed_over = connections
        .admit(PeerAddress(Some(peer.ip())))
        .and_then(|place| {
            let room = accepted.try_reserve().map_err(|_| Turned::Places)?;
            Ok((room, place))
        });
    match handed_over {
        Ok((room, place)) => match socket.into_std() {
            Ok(socket) => room.send((socket, place)),
            Err(error) => tracing::debug!(%error, "a connection was lost"),
        },
        Err(reason) => {
            connections.count(reason);
            refuse(&socket);
        }
    }
}

/// Resets a connection: the system keeps nothing of it, and its peer knows at once.
fn refuse(socket: &TcpStream) {
    if let Err(error) = socket.set_zero_linger() {
        tracing::debug!(%error, "a refused connection stays with the system for a while");
    }
}

/// True if an accept failed because the client had gone already.
const fn is_of_peer(kind: ErrorKind) -> bool {
    matches!(
        kind,
        ErrorKind::ConnectionAborted | ErrorKind::ConnectionReset | ErrorKind::ConnectionRefused
    )
}
