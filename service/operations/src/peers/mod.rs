//! Peers: the other instances of a cluster, and requests that one forwards to another.
//!
//! Requests go only to configured instances, at their configured addresses: the rows of the
//! database state which instance to use, and not its address. A request is forwarded once, with the
//! caller's own credential, so that the other instance checks the permission.

mod addresses;
mod client;
mod url;

#[cfg(test)]
mod tests;

use std::collections::{BTreeMap, BTreeSet};
use std::net::IpAddr;
use std::path::PathBuf;
use std::sync::Arc;

use fleetcal_domain::limits;
use fleetcal_proto::key::ServiceInstance;
use hyper::http::{HeaderMap, Method};
use hyper::{Response, body::Incoming};
use thiserror::Error;
use tokio::sync::watch;
use tokio_util::sync::CancellationToken;

pub use url::PeerUrl;

pub(crate) use client::trusted;
use client::{HttpClient, Trust};

/// Configuration of this instance and the others: `[cluster]` of `fleetcal.toml`.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct PeersSetup {
    /// Name of this instance.
    pub instance: ServiceInstance,
    /// Address of this instance for the others.
    pub url: PeerUrl,
    /// Addresses of the others, by their names. Its own name may be among them.
    pub urls: BTreeMap<ServiceInstance, PeerUrl>,
    /// Certificates (PEM) of the authorities of the others' certificates; the machine's unless
    /// given.
    pub root_certificates: Option<PathBuf>,
    /// True if requests to the others may be sent without encryption.
    pub plaintext: bool,
}

/// Reason for which the other instances cannot be used.
#[derive(Debug, Error)]
pub enum PeersError {
    /// Address without encryption that was not permitted.
    #[error(
        "cluster.peers.{name}: got {url}, expected https://…; `plaintext_peers = true` permits \
         http:// on a network that nobody else reaches: callers' credentials pass over it"
    )]
    Plaintext {
        /// Name of the instance.
        name: String,
        /// Address of the instance.
        url: String,
    },
    /// Malformed address.
    #[error("cluster.peers: {0}")]
    Url(String),
    /// Too many instances.
    #[error(
        "cluster.peers: got {count} instances, expected {} at most",
        limits::PEERS_MAX
    )]
    TooMany {
        /// Number of instances.
        count: usize,
    },
    /// Certificates that cannot be used.
    #[error("cluster.peer_root_certificates: {path}: {reason}")]
    Certificates {
        /// Path of the file.
        path: PathBuf,
        /// Problem of the file.
        reason: String,
    },
    /// TLS unavailable on this machine.
    #[error("TLS cannot be used: {0}")]
    Tls(#[from] rustls::Error),
}

/// Reason for which another instance gave no answer.
#[derive(Debug, Error)]
pub enum ForwardError {
    /// Instance that is not configured.
    #[error("instance {0} is not among cluster.peers of this instance")]
    Unknown(String),
    /// Request that cannot be made.
    #[error("the request cannot be made: {0}")]
    Request(#[from] hyper::http::Error),
    /// Instance that cannot be reached, has an untrusted certificate, or does not use HTTP.
    #[error("{0}")]
    Exchange(String),
    /// Timeout.
    #[error("no answer within {} s", limits::PEER_ANSWER_TIMEOUT.as_secs())]
    Timeout,
}

/// Request for another instance.
#[derive(Debug)]
pub struct Forwarded<'a> {
    /// Method of the request.
    pub method: &'a Method,
    /// Path and query.
    pub target: &'a str,
    /// Headers, of which only those that the answer depends on are forwarded.
    pub headers: &'a HeaderMap,
    /// Address of the caller.
    pub client: Option<IpAddr>,
}

/// Other instances of the cluster; empty for a single service. Cheap to clone.
#[derive(Debug, Clone, Default)]
pub struct Peers {
    inner: Option<Arc<Inner>>,
}

#[derive(Debug)]
struct Inner {
    instance: ServiceInstance,
    url: PeerUrl,
    urls: BTreeMap<ServiceInstance, PeerUrl>,
    client: HttpClient,
    addresses: watch::Receiver<BTreeSet<IpAddr>>,
}

impl PeersSetup {
    /// Checks that requests to all of them are permitted.
    ///
    /// # Errors
    /// [`PeersError::Plaintext`], [`PeersError::TooMany`].
    pub fn check(&self) -> Result<(), PeersError> {
        let count = self.urls.len();
        if count > limits::PEERS_MAX {
            return Err(PeersError::TooMany { count });
        }
        let mut urls = self.urls.iter();
        match urls.find(|(_, url)| !url.is_https() && !self.plaintext) {
            None => Ok(()),
            Some((name, url)) => Err(PeersError::Plaintext {
                name: name.as_str().to_owned(),
                url: url.as_str().to_owned(),
            }),
        }
    }
}

impl Peers {
    /// Sets the instances, and resolves their addresses until `stop`.
    ///
    /// # Errors
    /// [`PeersError`].
    pub fn start(setup: PeersSetup, stop: CancellationToken) -> Result<Self, PeersError> {
        setup.check()?;
        let trust = Trust {
            root_certificates: setup.root_certificates,
            plaintext: setup.plaintext,
        };
        let client = HttpClient::new(&trust)?;
        let mut urls = setup.urls;
        urls.remove(&setup.instance);
        let hosts = urls.values().cloned().collect();
        let inner = Inner {
            instance: setup.instance,
            url: setup.url,
            addresses: addresses::followed(hosts, stop),
            urls,
            client,
        };
        Ok(Self {
            inner: Some(Arc::new(inner)),
        })
    }

    /// Host, and port if any, that others use for this instance; `None` for a single service.
    pub fn own_authority(&self) -> Option<&str> {
        Some(self.inner.as_ref()?.url.authority())
    }

    /// Present addresses of the others; `None` for a single service.
    pub fn addresses(&self) -> Option<watch::Receiver<BTreeSet<IpAddr>>> {
        Some(self.inner.as_ref()?.addresses.clone())
    }

    /// Forwards a request to another instance. Its answer begins when this returns; the body
    /// continues as long as the other instance sends.
    ///
    /// # Errors
    /// [`ForwardError`].
    pub async fn forward(
        &self,
        to: &ServiceInstance,
        request: Forwarded<'_>,
    ) -> Result<Response<Incoming>, ForwardError> {
        let unknown = || ForwardError::Unknown(to.as_str().to_owned());
        let inner = self.inner.as_ref().ok_or_else(unknown)?;
        let url = inner.urls.get(to).ok_or_else(unknown)?;
        inner.client.send(url, &inner.instance, request).await
    }
}
