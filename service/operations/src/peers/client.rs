//! Request to another instance.

use std::net::IpAddr;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Duration;

use fleetcal_domain::access::FORWARDED_BY;
use fleetcal_domain::limits;
use fleetcal_proto::key::ServiceInstance;
use http_body_util::Empty;
use hyper::body::{Bytes, Incoming};
use hyper::header::{self, HeaderMap, HeaderName};
use hyper::{Request, Response};
use hyper_rustls::{HttpsConnector, HttpsConnectorBuilder};
use hyper_util::client::legacy::Client;
use hyper_util::client::legacy::connect::HttpConnector;
use hyper_util::rt::{TokioExecutor, TokioTimer};
use rustls::pki_types::CertificateDer;
use rustls::pki_types::pem::PemObject;
use rustls::{ClientConfig, RootCertStore};

use super::url::PeerUrl;
use super::{ForwardError, Forwarded, PeersError};
use crate::cause::whole;

/// Headers of a caller's request that the answer depends on.
const ASKED: [HeaderName; 6] = [
    header::AUTHORIZATION,
    header::COOKIE,
    header::ACCEPT,
    header::ACCEPT_ENCODING,
    header::IF_NONE_MATCH,
    HeaderName::from_static("x-request-id"),
];

/// Headers of an answer that describe its body and its refusal.
const ANSWERED: [HeaderName; 9] = [
    header::CONTENT_TYPE,
    header::CONTENT_ENCODING,
    header::CONTENT_DISPOSITION,
    header::CONTENT_LENGTH,
    header::CACHE_CONTROL,
    header::ETAG,
    header::VARY,
    header::RETRY_AFTER,
    header::WWW_AUTHENTICATE,
];

/// Silence of a peer after which TCP probes it, three times, before its connection is closed.
const PROBED_AFTER: Duration = Duration::from_secs(5);
/// Idle time after which a kept connection is closed.
const KEPT_IDLE: Duration = Duration::from_secs(8);

/// Trust in a peer's certificate.
#[derive(Debug)]
pub(super) struct Trust {
    /// Certificates of authorities; the machine's unless given.
    pub(super) root_certificates: Option<PathBuf>,
    /// True if requests to peers may be sent without encryption.
    pub(super) plaintext: bool,
}

/// HTTP client, which follows no redirection and uses no proxy.
#[derive(Debug)]
pub(super) struct HttpClient(Client<HttpsConnector<HttpConnector>, Empty<Bytes>>);

impl HttpClient {
    /// Makes a client that trusts these peers.
    ///
    /// # Errors
    /// [`PeersError::Certificates`], [`PeersError::Tls`].
    pub(super) fn new(trust: &Trust) -> Result<Self, PeersError> {
        let mut http = HttpConnector::new();
        http.enforce_http(false);
        http.set_connect_timeout(Some(limits::PEER_CONNECT_TIMEOUT));
        http.set_keepalive(Some(PROBED_AFTER));
        http.set_keepalive_interval(Some(PROBED_AFTER));
        http.set_keepalive_retries(Some(3));
        http.set_nodelay(true);
        let https = HttpsConnectorBuilder::new()
            .with_tls_config(trusted(trust.root_certificates.as_deref())?);
        let https = if trust.plaintext {
            https.https_or_http()
        } else {
            https.https_only()
        };
        let client = Client::builder(TokioExecutor::new())
            .pool_timer(TokioTimer::new())
            .pool_idle_timeout(KEPT_IDLE)
            .pool_max_idle_per_host(limits::PEER_IDLE_CONNECTIONS_MAX)
            .http1_max_buf_size(limits::HTTP_HEADER_BYTES_MAX)
            .build(https.enable_http1().wrap_connector(http));
        Ok(Self(client))
    }

    /// Sends a request for the instance `own`; returns the answer, whose body is not read.
    pub(super) async fn send(
        &self,
        to: &PeerUrl,
        own: &ServiceInstance,
        request: Forwarded<'_>,
    ) -> Result<Response<Incoming>, ForwardError> {
        let mut sent = Request::builder()
            .method(request.method)
            .uri(format!("{to}{}", request.target))
            .header(FORWARDED_BY, own.as_str());
        if let Some(client) = request.client {
            sent = sent.header("x-forwarded-for", written(client));
        }
        let mut sent = sent.body(Empty::new())?;
        copy(&ASKED, request.headers, sent.headers_mut());
        let answer = tokio::time::timeout(limits::PEER_ANSWER_TIMEOUT, self.0.request(sent));
        let answer = answer.await.map_err(|_| ForwardError::Timeout)?;
        let mut answer = answer.map_err(|error| ForwardError::Exchange(whole(&error)))?;
        let mut kept = HeaderMap::new();
        copy(&ANSWERED, answer.headers(), &mut kept);
        *answer.headers_mut() = kept;
        Ok(answer)
    }
}

/// Text of an address for a header.
fn written(address: IpAddr) -> String {
    address.to_canonical().to_string()
}

fn copy(names: &[HeaderName], from: &HeaderMap, to: &mut HeaderMap) {
    for name in names {
        for value in from.get_all(name) {
            to.append(name, value.clone());
        }
    }
}

/// Makes a TLS configuration that trusts the authorities of a file, or else those of the machine.
pub(crate) fn trusted(authorities: Option<&Path>) -> Result<ClientConfig, PeersError> {
    let roots = match authorities {
        Some(path) => roots_of(path)?,
        None => roots_of_machine(),
    };
    let provider = Arc::new(rustls::crypto::ring::default_provider());
    let config =
        ClientConfig::builder_with_provider(provider).with_safe_default_protocol_versions()?;
    Ok(config.with_root_certificates(roots).with_no_client_auth())
}

/// Authorities that this machine trusts.
fn roots_of_machine() -> RootCertStore {
    let mut roots = RootCertStore::empty();
    roots.add_parsable_certificates(rustls_native_certs::load_native_certs().certs);
    roots
}

/// Authorities in a file.
fn roots_of(path: &Path) -> Result<RootCertStore, PeersError> {
    let refused = |reason: String| PeersError::Certificates {
        path: path.to_owned(),
        reason,
    };
    let text = std::fs::read(path).map_err(|error| refused(error.to_string()))?;
    let mut roots = RootCertStore::empty();
    for certificate in CertificateDer::pem_slice_iter(&text) {
        let certificate = certificate.map_err(|error| refused(error.to_string()))?;
        let added = roots.add(certificate);
        added.map_err(|error| refused(error.to_string()))?;
    }
    if roots.is_empty() {
        return Err(refused("got no certificate, expected PEM".to_owned()));
    }
    Ok(roots)
}
