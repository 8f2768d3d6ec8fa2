//! The other instances of a cluster, and what one asks of another for its own caller.
//!
//! Only those that are configured are ever asked, under the addresses of the configuration: what
//! stands in the database says which instance it is, not where. A request goes one hop, with the
//! caller's own credential, so the other instance decides whether it is permitted.

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

use client::{HttpClient, Trust};

/// What an instance is told of itself and the others: `[cluster]` of `fleetcal.toml`.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct PeersSetup {
    /// The name of this instance.
    pub instance: ServiceInstance,
    /// Where others reach it.
    pub url: PeerUrl,
    /// Where it reaches the others, by their names. Its own name may be among them.
    pub urls: BTreeMap<ServiceInstance, PeerUrl>,
    /// Certificates (PEM) of the authorities that others' certificates come from; those that the
    /// machine trusts without it.
    pub root_certificates: Option<PathBuf>,
    /// Whether others may be asked without encryption.
    pub plaintext: bool,
}

/// Why the other instances cannot be asked.
#[derive(Debug, Error)]
pub enum PeersError {
    /// An address without encryption, and nobody has said that this is wanted.
    #[error(
        "cluster.peers.{name}: got {url}, expected https://…; `plaintext_peers = true` permits \
         http:// on a network that nobody else reaches: callers' credentials pass over it"
    )]
    Plaintext {
        /// Of which instance.
        name: String,
        /// Its address.
        url: String,
    },
    /// An address that is none.
    #[error("cluster.peers: {0}")]
    Url(String),
    /// Too many of them.
    #[error(
        "cluster.peers: got {count} instances, expected {} at most",
        limits::PEERS_MAX
    )]
    TooMany {
        /// How many there are.
        count: usize,
    },
    /// The certificates cannot be used.
    #[error("cluster.peer_root_certificates: {path}: {reason}")]
    Certificates {
        /// The file.
        path: PathBuf,
        /// What is wrong with it.
        reason: String,
    },
    /// This machine has no TLS.
    #[error("TLS cannot be used: {0}")]
    Tls(#[from] rustls::Error),
}

/// Why another instance gave no answer.
#[derive(Debug, Error)]
pub enum ForwardError {
    /// It is not among the configured ones.
    #[error("instance {0} is not among cluster.peers of this instance")]
    Unknown(String),
    /// The request cannot be made.
    #[error("the request cannot be made: {0}")]
    Request(#[from] hyper::http::Error),
    /// It cannot be reached, shows a certificate that is not trusted, or does not speak HTTP.
    #[error("{0}")]
    Exchange(String),
    /// It took too long.
    #[error("no answer within {} s", limits::PEER_ANSWER_TIMEOUT.as_secs())]
    Timeout,
}

/// A request that another instance should answer.
#[derive(Debug)]
pub struct Forwarded<'a> {
    /// Its method.
    pub method: &'a Method,
    /// Path and query.
    pub target: &'a str,
    /// Its header, of which only what the answer depends on is passed on.
    pub headers: &'a HeaderMap,
    /// Where the caller is.
    pub client: Option<IpAddr>,
}

/// The other instances; of a service that is alone, none. Cheap to clone.
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
    /// Whether all of them may be asked.
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
    /// Takes who they are, and looks up their addresses until `stop`.
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

    /// Host and port under which others ask this instance; `None` of a service that is alone.
    pub fn own_authority(&self) -> Option<&str> {
        Some(self.inner.as_ref()?.url.authority())
    }

    /// The addresses of the others as they are known now; `None` of a service that is alone.
    pub fn addresses(&self) -> Option<watch::Receiver<BTreeSet<IpAddr>>> {
        Some(self.inner.as_ref()?.addresses.clone())
    }

    /// Has another instance answer a request. Its answer begins when this returns; the body goes on
    /// as long as the other instance sends.
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
