//! Request to one receiver.

use std::sync::Arc;

use fleetcal_domain::limits;
use fleetcal_store::DueDelivery;
use http_body_util::Full;
use hyper::body::Bytes;
use hyper::header::{CONTENT_TYPE, USER_AGENT};
use hyper::{Method, Request};
use hyper_rustls::{HttpsConnector, HttpsConnectorBuilder};
use hyper_util::client::legacy::Client;
use hyper_util::client::legacy::connect::HttpConnector;
use hyper_util::rt::TokioExecutor;
use rustls::{ClientConfig, RootCertStore};
use thiserror::Error;

use crate::cause::whole;

/// Reason for which a receiver gave no answer.
#[derive(Debug, Error)]
pub(super) enum PostError {
    /// Request that cannot be made from the webhook's address.
    #[error("the request cannot be made: {0}")]
    Request(#[from] hyper::http::Error),
    /// Receiver that cannot be reached, or does not answer in HTTP.
    #[error("{}", whole(.0))]
    Exchange(#[from] hyper_util::client::legacy::Error),
    /// Timeout of the receiver.
    #[error("no answer within {} s", limits::WEBHOOK_TIMEOUT.as_secs())]
    Timeout,
    /// TLS unavailable on this machine.
    #[error("TLS cannot be used: {0}")]
    Tls(String),
}

type HttpClient = Client<HttpsConnector<HttpConnector>, Full<Bytes>>;

/// HTTP client of the dispatcher. It follows no redirection, uses no proxy, keeps no connection,
/// and reads only the status of an answer.
#[derive(Debug)]
pub(super) struct Post {
    client: Result<HttpClient, String>,
}

impl Post {
    pub(super) fn new() -> Self {
        let client = tls().map_err(|error| error.to_string()).map(client);
        if let Err(error) = &client {
            tracing::error!(%error, "webhooks cannot be sent: TLS is unavailable");
        }
        Self { client }
    }

    /// Sends a message; returns the status of the answer.
    pub(super) async fn send(&self, due: &DueDelivery, now_s: i64) -> Result<u16, PostError> {
        let client = self.client.as_ref();
        let client = client.map_err(|error| PostError::Tls(error.clone()))?;
        let delivery = &due.delivery;
        let signature = due.secret.sign(&delivery.message, now_s, &delivery.body);
        let request = Request::builder()
            .method(Method::POST)
            .uri(due.url.as_str())
            .header(CONTENT_TYPE, "application/json")
            .header(USER_AGENT, concat!("fleetcal/", env!("CARGO_PKG_VERSION")))
            .header("webhook-id", &delivery.message)
            .header("webhook-timestamp", now_s)
            .header("webhook-signature", signature)
            .body(Full::new(Bytes::from(delivery.body.clone())))?;
        let answer = tokio::time::timeout(limits::WEBHOOK_TIMEOUT, client.request(request));
        let answer = answer.await.map_err(|_| PostError::Timeout)??;
        Ok(answer.status().as_u16())
    }
}

/// TLS configuration with the certificates that this machine trusts, to which a site adds its own.
fn tls() -> Result<ClientConfig, rustls::Error> {
    let mut roots = RootCertStore::empty();
    let found = rustls_native_certs::load_native_certs();
    let (_, unusable) = roots.add_parsable_certificates(found.certs);
    if roots.is_empty() || unusable > 0 || !found.errors.is_empty() {
        let (usable, errors) = (roots.len(), found.errors.len());
        tracing::warn!(
            usable,
            unusable,
            errors,
            "this machine's trusted certificates"
        );
    }
    let provider = Arc::new(rustls::crypto::ring::default_provider());
    let config =
        ClientConfig::builder_with_provider(provider).with_safe_default_protocol_versions()?;
    Ok(config.with_root_certificates(roots).with_no_client_auth())
}

fn client(tls: ClientConfig) -> HttpClient {
    let mut http = HttpConnector::new();
    http.enforce_http(false);
    http.set_connect_timeout(Some(limits::WEBHOOK_CONNECT_TIMEOUT));
    let https = HttpsConnectorBuilder::new()
        .with_tls_config(tls)
        .https_or_http()
        .enable_http1()
        .wrap_connector(http);
    Client::builder(TokioExecutor::new())
        .pool_max_idle_per_host(0)
        .retry_canceled_requests(false)
        .http1_max_buf_size(limits::WEBHOOK_ANSWER_BYTES_MAX)
        .build(https)
}
