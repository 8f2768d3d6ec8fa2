//! Record of a webhook.

use fleetcal_model::{WallTime, WebhookId};
use serde::{Deserialize, Serialize};
use strum::{EnumString, IntoStaticStr};
use thiserror::Error;
use url::Url;

use crate::limits;

/// Event that a webhook can report.
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
    /// First alert of a problem.
    #[serde(rename = "alert.alerting")]
    #[strum(serialize = "alert.alerting")]
    AlertAlerting,
    /// End of an alert.
    #[serde(rename = "alert.resolved")]
    #[strum(serialize = "alert.resolved")]
    AlertResolved,
    /// Proposal that awaits approval.
    #[serde(rename = "proposal.waiting")]
    #[strum(serialize = "proposal.waiting")]
    ProposalWaiting,
    /// Halt of a roll-out, by itself or by a person.
    #[serde(rename = "rollout.halted")]
    #[strum(serialize = "rollout.halted")]
    RolloutHalted,
}

impl WebhookEvent {
    /// Every event.
    pub const ALL: [Self; 4] = [
        Self::AlertAlerting,
        Self::AlertResolved,
        Self::ProposalWaiting,
        Self::RolloutHalted,
    ];

    /// The name in messages and in the database.
    pub fn as_str(self) -> &'static str {
        self.into()
    }

    /// Parses the name of an event.
    pub fn parse(name: &str) -> Option<Self> {
        name.parse().ok()
    }
}

/// Reason for which a webhook was refused.
#[derive(Debug, Clone, PartialEq, Eq, Error)]
pub enum WebhookRefused {
    /// Unknown number.
    #[error("no webhook {0} is known")]
    Unknown(WebhookId),
    /// Address that no message can be sent to.
    #[error("url: got {url:?}, expected {accepted}")]
    Url {
        /// Given address.
        url: String,
        /// Accepted addresses, in words.
        accepted: &'static str,
    },
    /// Address of another webhook.
    #[error("url is that of webhook {0} already")]
    UrlTaken(WebhookId),
    /// Limit of webhooks reached.
    #[error("{} webhooks are there, which is the limit", limits::WEBHOOKS_MAX)]
    TooMany,
}

/// Address that messages can be sent to: `http` or `https`, with a host, without user, password and
/// fragment. Addresses of the site's own network are accepted, since most receivers are there.
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

    /// Scheme, host and port: the public part of the address, as the rest is often a secret itself.
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

/// Receiver of messages. The secret that signs its messages is stored separately.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Webhook {
    /// Number that the store assigns; 0 before that.
    #[serde(skip)]
    pub id: WebhookId,
    /// Address of the receiver.
    pub url: WebhookUrl,
    /// Events that it receives.
    pub events: Vec<WebhookEvent>,
    /// Person or tool that created it.
    pub created_by: String,
    /// Time of its creation, ns since 1970, wall time.
    pub created_ns: WallTime,
}

impl Webhook {
    /// Record for the audit, without the secret part of its address.
    pub fn audited(&self) -> serde_json::Value {
        serde_json::json!({ "origin": self.url.origin(), "events": self.events })
    }
}

/// Allows a webhook with this address beside the present ones.
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
