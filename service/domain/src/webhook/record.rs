//! Record of a webhook.

use fleetcal_model::{WallTime, WebhookId};
use serde::{Deserialize, Serialize};
use strum::{EnumString, IntoStaticStr};
use thiserror::Error;
use url::Url;

use crate::limits;

/// What somebody can be told of.
#[derive(
    Debug,
    Clone,
    Copy,
    PartialEq,
    Eq,
    PartialOrd,
    Ord,
    Hash,
    Serialize,
    Deserialize,
    EnumString,
    IntoStaticStr,
)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub enum WebhookEvent {
    /// An alert began to alert.
    #[serde(rename = "alert.alerting")]
    #[strum(serialize = "alert.alerting")]
    AlertAlerting,
    /// An alert is over.
    #[serde(rename = "alert.resolved")]
    #[strum(serialize = "alert.resolved")]
    AlertResolved,
    /// A proposal waits for people.
    #[serde(rename = "proposal.waiting")]
    #[strum(serialize = "proposal.waiting")]
    ProposalWaiting,
}

impl WebhookEvent {
    /// All of them.
    pub const ALL: [Self; 3] = [
        Self::AlertAlerting,
        Self::AlertResolved,
        Self::ProposalWaiting,
    ];

    /// The name in messages and in the database.
    pub fn as_str(self) -> &'static str {
        self.into()
    }

    /// The event of this name.
    pub fn parse(name: &str) -> Option<Self> {
        name.parse().ok()
    }
}

/// Why a webhook was refused.
#[derive(Debug, Clone, PartialEq, Eq, Error)]
pub enum WebhookRefused {
    /// No webhook has this number.
    #[error("no webhook {0} is known")]
    Unknown(WebhookId),
    /// Its address cannot be told anything.
    #[error("url: got {url:?}, expected {accepted}")]
    Url {
        /// What was given.
        url: String,
        /// What would have been accepted.
        accepted: &'static str,
    },
    /// Another webhook has this address.
    #[error("url is that of webhook {0} already")]
    UrlTaken(WebhookId),
    /// There are too many.
    #[error("{} webhooks are there, which is the limit", limits::WEBHOOKS_MAX)]
    TooMany,
}

/// An address that a message can be sent to: `http` or `https`, with a host, without user,
/// password and fragment. Addresses of the site's own network are accepted: most receivers are
/// there.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(try_from = "String", into = "String")]
pub struct WebhookUrl(Url);

impl WebhookUrl {
    /// Parses an address.
    ///
    /// # Errors
    /// [`WebhookRefused::Url`].
    pub fn parse(text: &str) -> Result<Self, WebhookRefused> {
        let refused = |accepted| {
            Err(WebhookRefused::Url {
                url: text.chars().take(100).collect(),
                accepted,
            })
        };
        if text.len() > limits::WEBHOOK_URL_BYTES_MAX {
            return refused("an address of at most 2000 bytes");
        }
        let Ok(url) = Url::parse(text) else {
            return refused("an address such as https://example.org/hook");
        };
        if !matches!(url.scheme(), "http" | "https") || !url.has_host() {
            return refused("an address such as https://example.org/hook");
        }
        if url.fragment().is_some() {
            return refused("an address without a fragment");
        }
        if !url.username().is_empty() || url.password().is_some() {
            return refused("an address without user and password");
        }
        Ok(Self(url))
    }

    /// Scheme, host and port: what everybody may see, for the rest is often a secret itself.
    pub fn origin(&self) -> String {
        self.0.origin().ascii_serialization()
    }

    /// The address.
    pub fn as_str(&self) -> &str {
        self.0.as_str()
    }
}

impl TryFrom<String> for WebhookUrl {
    type Error = WebhookRefused;

    fn try_from(text: String) -> Result<Self, WebhookRefused> {
        Self::parse(&text)
    }
}

impl From<WebhookUrl> for String {
    fn from(url: WebhookUrl) -> Self {
        url.0.to_string()
    }
}

/// Somebody who is told. The secret that signs the messages is kept beside it.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Webhook {
    /// Its number; the store gives it, and 0 stands for none yet.
    #[serde(skip)]
    pub id: WebhookId,
    /// Where messages go.
    pub url: WebhookUrl,
    /// What it is told of.
    pub events: Vec<WebhookEvent>,
    /// Who made it.
    pub created_by: String,
    /// When, ns since 1970, wall time.
    pub created_ns: WallTime,
}

impl Webhook {
    /// What the audit shows of it.
    pub fn audited(&self) -> serde_json::Value {
        serde_json::json!({ "origin": self.url.origin(), "events": self.events })
    }
}

/// Allows a webhook with this address beside those that are `present`.
///
/// # Errors
/// [`WebhookRefused::UrlTaken`] or [`WebhookRefused::TooMany`].
pub fn allow_new_webhook<'a>(
    present: impl Iterator<Item = &'a Webhook>,
    url: &WebhookUrl,
) -> Result<(), WebhookRefused> {
    let mut count = 0;
    for webhook in present {
        if webhook.url == *url {
            return Err(WebhookRefused::UrlTaken(webhook.id));
        }
        count += 1;
    }
    if count >= limits::WEBHOOKS_MAX {
        return Err(WebhookRefused::TooMany);
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_address_is_http_with_a_host_and_nothing_hidden() {
        for url in [
            "http://127.0.0.1:9000/hook",
            "https://chat.example.org/a/b?c=d",
            "http://[::1]:80/",
            "http://erp",
        ] {
            assert!(WebhookUrl::parse(url).is_ok(), "{url}");
        }
        let long = format!("http://a/{}", "x".repeat(limits::WEBHOOK_URL_BYTES_MAX));
        for url in [
            "",
            "hook",
            "/hook",
            "ftp://a/b",
            "file:///etc/passwd",
            "http://",
            "http://user:secret@a/",
            "http://a/#part",
            "http://a b/",
            &long,
        ] {
            let refused = WebhookUrl::parse(url).unwrap_err();
            assert!(refused.to_string().starts_with("url: got "), "{refused}");
        }
    }

    #[test]
    fn an_event_has_one_name() {
        for event in WebhookEvent::ALL {
            assert_eq!(WebhookEvent::parse(event.as_str()), Some(event));
            assert_eq!(serde_json::json!(event), event.as_str());
        }
    }
}
