//! Client of a running service's API, for commands that read from it.

use std::net::IpAddr;
use std::path::{Path, PathBuf};
use std::time::Duration;

use fleetcal_domain::limits;
use http_body_util::{BodyExt as _, Empty, Limited};
use hyper::body::{Bytes, Incoming};
use hyper::header::{AUTHORIZATION, HeaderValue, USER_AGENT};
use hyper::http::uri::Scheme;
use hyper::{Request, Response, Uri};
use hyper_rustls::{HttpsConnector, HttpsConnectorBuilder};
use hyper_util::client::legacy::Client;
use hyper_util::client::legacy::connect::HttpConnector;
use hyper_util::rt::TokioExecutor;
use thiserror::Error;
use tokio::io::{AsyncWrite, AsyncWriteExt as _};

use crate::cause::whole;
use crate::peers::{PeersError, trusted};

/// Silence of a service after which a request has failed.
const SILENCE_MAX: Duration = Duration::from_secs(30);

/// Reason for which a request has no answer.
#[derive(Debug, Error)]
pub enum ApiError {
    /// Address or token that cannot be sent.
    #[error("the request cannot be made: {0}")]
    Request(#[from] hyper::http::Error),
    /// Address to which a token would be sent without encryption.
    #[error(
        "--url: got {0}, expected https://…; --plaintext permits http:// on a network that nobody \
         else reaches: the token passes over it"
    )]
    Plaintext(String),
    /// Certificates that cannot be read.
    #[error("--authorities: {path}: {reason}", path = path.display())]
    Authorities {
        /// Path of the file.
        path: PathBuf,
        /// Problem of the file.
        reason: String,
    },
    /// TLS unavailable on this machine.
    #[error("TLS cannot be used: {0}")]
    Tls(String),
    /// Service that cannot be reached, or an answer that ended early.
    #[error("no answer of {url}: {reason}")]
    Exchange {
        /// Address of the service.
        url: String,
        /// Cause of the failure.
        reason: String,
    },
    /// Refusal of the service.
    #[error("{url} answered {status}: {detail}")]
    Refused {
        /// Address of the service.
        url: String,
        /// HTTP status of the answer.
        status: u16,
        /// Detail of the answer's problem document.
        detail: String,
    },
    /// File that cannot be written.
    #[error(transparent)]
    Write(#[from] std::io::Error),
}

/// Client of one service, with the rights of one token. It follows no redirection and uses no proxy.
#[derive(Debug)]
pub struct ApiClient {
    client: Client<HttpsConnector<HttpConnector>, Empty<Bytes>>,
    /// Address without a slash at its end.
    url: String,
    authorization: HeaderValue,
}

impl ApiClient {
    /// Makes a client of the service at `url` that trusts the machine's authorities, or those of a
    /// file. Beyond this machine `plaintext` permits http.
    ///
    /// # Errors
    /// The address, the token or the file cannot be used.
    pub fn new(
        url: &str,
        token: &str,
        authorities: Option<&Path>,
        plaintext: bool,
    ) -> Result<Self, ApiError> {
        let uri = Uri::try_from(url).map_err(hyper::http::Error::from)?;
        if !plaintext && !is_confidential(&uri) {
            return Err(ApiError::Plaintext(url.to_owned()));
        }
        let mut authorization =
            HeaderValue::try_from(format!("Bearer {token}")).map_err(hyper::http::Error::from)?;
        authorization.set_sensitive(true);
        let mut http = HttpConnector::new();
        http.enforce_http(false);
        http.set_connect_timeout(Some(limits::PEER_CONNECT_TIMEOUT));
        let https = HttpsConnectorBuilder::new()
            .with_tls_config(trusted(authorities).map_err(not_trusted)?)
            .https_or_http()
            .enable_http1()
            .wrap_connector(http);
        Ok(Self {
            client: Client::builder(TokioExecutor::new()).build(https),
            url: url.trim_end_matches('/').to_owned(),
            authorization,
        })
    }

    /// Reads a document of at most [`limits::SUPPORT_DOCUMENT_BYTES_MAX`] at a path of the API.
    ///
    /// # Errors
    /// The service cannot be reached or refuses.
    pub async fn document(&self, path: &str) -> Result<Bytes, ApiError> {
        let answer = self.get(path).await?;
        let body = Limited::new(answer.into_body(), limits::SUPPORT_DOCUMENT_BYTES_MAX);
        let read = tokio::time::timeout(SILENCE_MAX, body.collect()).await;
        let read = read.map_err(|_| self.failed(SILENT))?;
        let read = read.map_err(|error| self.failed(error.to_string()))?;
        Ok(read.to_bytes())
    }

    /// Writes a file of the API; returns its size, bytes.
    ///
    /// # Errors
    /// The service cannot be reached or refuses, the answer ends early, or `to` cannot be written.
    pub async fn save(&self, path: &str, mut to: impl AsyncWrite + Unpin) -> Result<u64, ApiError> {
        let mut body = self.get(path).await?.into_body();
        let mut written = 0;
        loop {
            let frame = tokio::time::timeout(SILENCE_MAX, body.frame()).await;
            let Some(frame) = frame.map_err(|_| self.failed(SILENT))? else {
                break;
            };
            let frame = frame.map_err(|error| self.failed(whole(&error)))?;
            if let Ok(data) = frame.into_data() {
                to.write_all(&data).await?;
                written += data.len() as u64;
            }
        }
        to.flush().await?;
        Ok(written)
    }

    async fn get(&self, path: &str) -> Result<Response<Incoming>, ApiError> {
        let request = Request::builder()
            .uri(format!("{}/api/v1{path}", self.url))
            .header(AUTHORIZATION, self.authorization.clone())
            .header(USER_AGENT, concat!("fleetcal/", env!("CARGO_PKG_VERSION")))
            .body(Empty::new())?;
        let answer = tokio::time::timeout(SILENCE_MAX, self.client.request(request)).await;
        let answer = answer.map_err(|_| self.failed(SILENT))?;
        let answer = answer.map_err(|error| self.failed(whole(&error)))?;
        if answer.status().is_success() {
            return Ok(answer);
        }
        let status = answer.status().as_u16();
        let body = Limited::new(answer.into_body(), limits::SUPPORT_DOCUMENT_BYTES_MAX);
        // A refusal whose reason does not come is one.
        let body = tokio::time::timeout(SILENCE_MAX, body.collect()).await;
        let body = body.ok().and_then(Result::ok).unwrap_or_default();
        let problem = serde_json::from_slice(&body.to_bytes());
        let problem: serde_json::Value = problem.unwrap_or_default();
        let detail = problem["detail"].as_str().or(problem["title"].as_str());
        Err(ApiError::Refused {
            url: self.url.clone(),
            status,
            detail: detail.unwrap_or("no reason given").to_owned(),
        })
    }

    fn failed(&self, reason: impl Into<String>) -> ApiError {
        ApiError::Exchange {
            url: self.url.clone(),
            reason: reason.into(),
        }
    }
}

/// True if nobody else can read what is sent there: it is encrypted, or stays on this machine.
fn is_confidential(uri: &Uri) -> bool {
    let host = uri.host().unwrap_or_default();
    let host = host.trim_start_matches('[').trim_end_matches(']');
    let is_loopback = host.parse().is_ok_and(|of: IpAddr| of.is_loopback());
    uri.scheme() == Some(&Scheme::HTTPS) || is_loopback || host == "localhost"
}

fn not_trusted(error: PeersError) -> ApiError {
    match error {
        PeersError::Certificates { path, reason } => ApiError::Authorities { path, reason },
        other => ApiError::Tls(other.to_string()),
    }
}

/// Reason of a request that was not answered in time.
const SILENT: &str = "it was silent for 30 s";

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_token_stays_on_the_machine_or_is_encrypted() {
        let refusal = |url: &str, plaintext| {
            let made = ApiClient::new(url, "cal_a", None, plaintext);
            made.err().map(|refused| refused.to_string())
        };
        for url in [
            "http://127.0.0.1:8080",
            "http://[::1]:8080/",
            "http://localhost",
            "https://fleetcal.example.com",
        ] {
            assert_eq!(refusal(url, false), None, "{url}");
        }
        for url in ["http://10.0.0.2:8080", "http://127.0.0.1.example.com"] {
            let refused = refusal(url, false).unwrap_or_default();
            assert!(refused.starts_with(&format!("--url: got {url}, expected https")));
            assert_eq!(refusal(url, true), None, "{url}");
        }
    }
}
