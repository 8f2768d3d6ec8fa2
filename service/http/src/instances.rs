//! The other instances of a cluster, which pass requests on for their callers.

use std::collections::BTreeSet;
use std::net::IpAddr;

use axum::http::{HeaderMap, HeaderName};
use fleetcal_domain::access::FORWARDED_BY;
use tokio::sync::watch;

static HEADER: HeaderName = HeaderName::from_static(FORWARDED_BY);

/// Present addresses of the cluster's other instances. Each stands for many callers, like a proxy:
/// its forwarded client addresses are trusted.
#[derive(Debug, Clone, Default)]
pub struct InstanceAddresses(Option<watch::Receiver<BTreeSet<IpAddr>>>);

impl InstanceAddresses {
    /// Makes the addresses from a channel that is kept up to date.
    pub fn watched(addresses: watch::Receiver<BTreeSet<IpAddr>>) -> Self {
        Self(Some(addresses))
    }

    /// True if an instance has this address.
    pub(crate) fn contain(&self, address: IpAddr) -> bool {
        let known = self.0.as_ref();
        known.is_some_and(|known| known.borrow().contains(&address.to_canonical()))
    }
}

/// True if a request claims to be forwarded by an instance. Anybody can claim that.
pub fn is_forwarded(headers: &HeaderMap) -> bool {
    headers.contains_key(&HEADER)
}
