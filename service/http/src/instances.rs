//! The other instances of a cluster, which pass requests on for their callers.

use std::collections::BTreeSet;
use std::net::IpAddr;

use axum::http::{HeaderMap, HeaderName};
use fleetcal_domain::access::FORWARDED_BY;
use tokio::sync::watch;

static HEADER: HeaderName = HeaderName::from_static(FORWARDED_BY);

/// Addresses of the cluster's other instances as they are known now. Each stands for many callers,
/// like a proxy: of a request that it passes on, its word about the caller's address counts.
#[derive(Debug, Clone, Default)]
pub struct InstanceAddresses(Option<watch::Receiver<BTreeSet<IpAddr>>>);

impl InstanceAddresses {
    /// Those that somebody keeps up to date.
    pub fn watched(addresses: watch::Receiver<BTreeSet<IpAddr>>) -> Self {
        Self(Some(addresses))
    }

    /// Whether an instance has this address.
    pub(crate) fn contain(&self, address: IpAddr) -> bool {
        let known = self.0.as_ref();
        known.is_some_and(|known| known.borrow().contains(&address.to_canonical()))
    }
}

/// Whether a request says that an instance passes it on. Anybody can say so.
pub fn is_forwarded(headers: &HeaderMap) -> bool {
    headers.contains_key(&HEADER)
}
