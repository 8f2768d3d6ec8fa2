//! Refusals of connections and requests.

use super::progress::Overdue;

/// Why a connection or request was not served.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Turned {
    /// Its address has as many connections as it may have.
    AddressConnections,
    /// Every place is taken, and its address has its share or nobody waits for a peer.
    Places,
    /// It waited for its peer longest when a place was needed.
    Evicted,
    /// No request came in time, as on a connection that a browser keeps for the next one.
    IdleTimeout,
    /// A header began and did not end in time.
    HeaderTimeout,
    /// No whole body came in time.
    BodyTimeout,
    /// Its peer did not read the answer.
    WriteStalled,
    /// Its address has as many requests under way as it may have.
    AddressRequests,
    /// As many requests are under way as there may be.
    Requests,
    /// Its header was too large.
    HeaderBytes,
    /// It was meant for another host.
    Host,
    /// Too many event streams: all together, of one caller, or of one address.
    Streams,
    /// Too many files are written: all together, or of one caller.
    Exports,
    /// One user or token changes too much.
    CallerWrites,
}

impl Turned {
    /// Every reason.
    pub const ALL: [Self; 14] = [
        Self::AddressConnections,
        Self::Places,
        Self::Evicted,
        Self::IdleTimeout,
        Self::HeaderTimeout,
        Self::BodyTimeout,
        Self::WriteStalled,
        Self::AddressRequests,
        Self::Requests,
        Self::HeaderBytes,
        Self::Host,
        Self::Streams,
        Self::Exports,
        Self::CallerWrites,
    ];

    /// Its name in `/metrics`.
    pub const fn as_str(self) -> &'static str {
        match self {
            Self::AddressConnections => "address_connections",
            Self::Places => "places",
            Self::Evicted => "evicted",
            Self::IdleTimeout => "idle_timeout",
            Self::HeaderTimeout => "header_timeout",
            Self::BodyTimeout => "body_timeout",
            Self::WriteStalled => "write_stalled",
            Self::AddressRequests => "address_requests",
            Self::Requests => "requests",
            Self::HeaderBytes => "header_bytes",
            Self::Host => "host",
            Self::Streams => "streams",
            Self::Exports => "exports",
            Self::CallerWrites => "caller_writes",
        }
    }
}

impl From<Overdue> for Turned {
    fn from(overdue: Overdue) -> Self {
        match overdue {
            Overdue::Idle => Self::IdleTimeout,
            Overdue::Header => Self::HeaderTimeout,
            Overdue::Body => Self::BodyTimeout,
            Overdue::Write => Self::WriteStalled,
        }
    }
}
