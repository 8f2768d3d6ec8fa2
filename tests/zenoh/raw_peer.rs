//! A Zenoh session by hand, as Zenoh's library does not let anybody misuse one.

use std::io::{Read as _, Result, Write as _};
use std::net::{IpAddr, SocketAddr, TcpStream};
use std::time::Duration;

use tokio::net::TcpSocket;

/// Longest wait for the other side.
const PATIENCE: Duration = Duration::from_secs(10);
/// Version of the protocol.
const VERSION: u8 = 9;
/// Kinds of transport messages.
const INIT: u8 = 0x01;
const OPEN: u8 = 0x02;
const FRAGMENT: u8 = 0x06;
/// Flags of transport messages.
const ACK: u8 = 0x20;
const SIZES: u8 = 0x40;
const IN_SECONDS: u8 = 0x40;
const RELIABLE: u8 = 0x20;
const MORE: u8 = 0x40;
const EXTENDED: u8 = 0x80;
/// Extension of [`INIT`] that offers priorities.
const OFFERS_PRIORITIES: u8 = 0x01;
/// Extension of [`FRAGMENT`] that names a priority.
const HAS_PRIORITY: u8 = 0x31;

/// A session that lasts as long as it is kept.
pub struct RawPeer(TcpStream);

/// Channel of a session for a fragment.
#[derive(Debug, Clone, Copy)]
pub struct Channel {
    pub is_reliable: bool,
    /// Priority, 0 to 7; `None` for the usual one.
    pub priority: Option<u8>,
}

impl RawPeer {
    /// Opens a session of a client that offers priorities, from an address of this machine.
    pub async fn open(from: IpAddr, to: SocketAddr, zid: u128) -> Result<Self> {
        let socket = TcpSocket::new_v4()?;
        socket.bind(SocketAddr::new(from, 0))?;
        let stream = socket.connect(to).await?.into_std()?;
        stream.set_nonblocking(false)?;
        stream.set_read_timeout(Some(PATIENCE))?;
        stream.set_write_timeout(Some(PATIENCE))?;
        let mut peer = Self(stream);
        let mut init = vec![INIT | SIZES | EXTENDED, VERSION, 0xf2];
        init.extend(zid.to_le_bytes());
        // Numbers of 32 bits, batches of 65,535 bytes.
        init.extend([0x0a, 0xff, 0xff, OFFERS_PRIORITIES]);
        peer.send(&[init])?;
        let cookie = cookie_of(&peer.receive()?);
        let mut open = vec![OPEN | IN_SECONDS];
        open.extend(number(10));
        open.extend(number(0));
        open.extend(number(cookie.len() as u64));
        open.extend(cookie);
        peer.send(&[open])?;
        let answer = peer.receive()?;
        assert_eq!(answer[0] & (ACK | 0x1f), OPEN | ACK, "{answer:02x?}");
        Ok(peer)
    }

    /// Sends the beginning of a message, in `fragments` of `bytes` each, and never its end.
    pub fn begin_message(&mut self, channel: Channel, fragments: u64, bytes: usize) -> Result<()> {
        let payload = vec![0x55; bytes];
        let at_once = (65_536 / (bytes + 16)).max(1) as u64;
        for first in (0..fragments).step_by(at_once as usize) {
            let batches = (first..fragments.min(first + at_once)).map(|sequence| {
                let mut batch = vec![FRAGMENT | MORE];
                if channel.is_reliable {
                    batch[0] |= RELIABLE;
                }
                batch.extend(number(sequence));
                if let Some(priority) = channel.priority {
                    batch[0] |= EXTENDED;
                    batch.extend([HAS_PRIORITY, priority]);
                }
                batch.extend(&payload);
                batch
            });
            self.send(&batches.collect::<Vec<_>>())?;
        }
        Ok(())
    }

    /// Sends batches, each behind its length.
    fn send(&mut self, batches: &[Vec<u8>]) -> Result<()> {
        let mut bytes = Vec::new();
        for batch in batches {
            bytes.extend((batch.len() as u16).to_le_bytes());
            bytes.extend(batch);
        }
        self.0.write_all(&bytes)
    }

    fn receive(&mut self) -> Result<Vec<u8>> {
        let mut length = [0; 2];
        self.0.read_exact(&mut length)?;
        let mut batch = vec![0; u16::from_le_bytes(length).into()];
        self.0.read_exact(&mut batch)?;
        Ok(batch)
    }
}

/// Encodes a number in the protocol's form: seven bits in each byte.
fn number(mut value: u64) -> Vec<u8> {
    let mut bytes = Vec::new();
    while value >= 0x80 {
        bytes.push(value as u8 | 0x80);
        value >>= 7;
    }
    bytes.push(value as u8);
    bytes
}

/// Extracts the cookie of an answer to [`INIT`].
fn cookie_of(answer: &[u8]) -> Vec<u8> {
    let name = usize::from(answer[2] >> 4) + 1;
    let sizes = if answer[0] & SIZES == 0 { 0 } else { 3 };
    let (mut at, mut length, mut shift) = (3 + name + sizes, 0, 0);
    loop {
        let byte = answer[at];
        length |= usize::from(byte & 0x7f) << shift;
        (at, shift) = (at + 1, shift + 7);
        if byte < 0x80 {
            return answer[at..at + length].to_vec();
        }
    }
}
