//! Refusals of connections and requests.

use super::progress::Overdue;

/// Reason for which a connection or request was refused.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Turned {
    /// Its address has as many connections as it may have.
    AddressConnections,
    /// All places are taken, and its address has its share or no connection waits for a peer.
    Places,
    /// The connection waited for its peer longest when a place was needed.
    Evicted,
    /// The next request did not come in time, as on a connection that a browser keeps open.
    IdleTimeout,
    /// A header began and did not end in time.
    HeaderTimeout,
    /// The body did not come whole in time.
    BodyTimeout,
    /// Its peer did not read the answer.
    WriteStalled,
    /// Its address has as many requests in progress as it may have.
    AddressRequests,
    /// The number of requests in progress has reached its limit.
    Requests,
    /// Its header was too large.
    HeaderBytes,
    /// The request was meant for another host.
    Host,
    /// Too many event streams: all together, of one caller, or of one address.
    Streams,
    /// Too many files are written: all together, or of one caller.
    Exports,
    /// A user or token changes too much.
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

    /// Returns its name in `/metrics`.
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
