//! Section `[cluster]` of `fleetcal.toml`.

use std::collections::BTreeMap;
use std::path::PathBuf;

use fleetcal_cluster::InstanceId;
use fleetcal_http::PublicUrl;
use serde::de::Error as _;
use serde::{Deserialize, Deserializer};

/// `[cluster]`.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct ClusterConfig {
    /// The name of this instance; without one, this service has all robots.
    #[serde(deserialize_with = "instance")]
    pub instance: Option<InstanceId>,
    /// URL at which other instances reach its HTTP API; `http://` and the address of `http` by
    /// default.
    pub url: Option<PublicUrl>,
    /// Its weight against others, at least 1.
    #[serde(deserialize_with = "capacity")]
    pub capacity: u32,
    /// The instances that requests are forwarded to, by name.
    #[serde(deserialize_with = "peers")]
    pub peers: BTreeMap<InstanceId, PublicUrl>,
    /// Certificates by which they are authenticated (PEM); the system's by default.
    pub peer_root_certificates: Option<PathBuf>,
    /// True if requests may be forwarded to them without TLS.
    pub plaintext_peers: bool,
    /// True if an instance may be declared dead before its lease ends, once its connection to the
    /// database is gone and Zenoh receives nothing from it.
    pub fast_takeover: bool,
    /// File of the key that all instances sign with; that of the data folder by default.
    pub signing_key: Option<PathBuf>,
}

impl Default for ClusterConfig {
    fn default() -> Self {
        Self {
            instance: None,
            url: None,
            capacity: 1,
            peers: BTreeMap::new(),
            peer_root_certificates: None,
            plaintext_peers: false,
            fast_takeover: true,
            signing_key: None,
        }
    }
}

impl ClusterConfig {
    /// Checks the constraints between keys.
    ///
    /// # Errors
    /// The key, its value, and the accepted values.
    pub fn check(&self) -> Result<(), String> {
        for (instance, url) in &self.peers {
            if !url.is_https() && !self.plaintext_peers {
                return Err(format!(
                    "cluster.peers.{}: got {:?}, expected https://, or plaintext_peers = true \
                     where nobody else is on the network",
                    instance.as_str(),
                    url.as_str()
                ));
            }
        }
        Ok(())
    }
}

fn named<E: serde::de::Error>(text: &str) -> Result<InstanceId, E> {
    InstanceId::parse(text).map_err(E::custom)
}

fn instance<'de, D: Deserializer<'de>>(from: D) -> Result<Option<InstanceId>, D::Error> {
    let text = String::deserialize(from)?;
    named(&text).map(Some)
}

fn peers<'de, D: Deserializer<'de>>(from: D) -> Result<BTreeMap<InstanceId, PublicUrl>, D::Error> {
    let peers = BTreeMap::<String, PublicUrl>::deserialize(from)?;
    let named = |(name, url): (String, _)| Ok((named(&name)?, url));
    peers.into_iter().map(named).collect()
}

fn capacity<'de, D: Deserializer<'de>>(from: D) -> Result<u32, D::Error> {
    match u32::deserialize(from)? {
        0 => Err(D::Error::custom("capacity: got 0, expected at least 1")),
        capacity => Ok(capacity),
    }
}

#[cfg(test)]
mod tests {
    use crate::Config;

    fn parsed(text: &str) -> Result<Config, String> {
        Config::parse(&format!("[cluster]\n{text}"))
    }

    #[test]
    fn an_instance_has_a_name_and_peers() {
        let text = "instance = \"a\"\npeers = { b = \"https://b.example.com\" }\n";
        let cluster = parsed(text).expect("documented").cluster;
        assert_eq!(cluster.instance.expect("a name").as_str(), "a");
        let peers: Vec<_> = cluster.peers.iter().collect();
        assert_eq!(peers.len(), 1);
        assert_eq!(peers[0].0.as_str(), "b");
        assert_eq!(peers[0].1.as_str(), "https://b.example.com");
    }

    #[test]
    fn a_peer_without_tls_needs_a_word() {
        let plain = "peers = { b = \"http://10.0.0.2:8080\" }\n";
        let refused = parsed(plain).expect_err("refused");
        assert!(refused.contains("cluster.peers.b"), "{refused}");
        parsed(&format!("{plain}plaintext_peers = true\n")).expect("accepted");
    }

    #[test]
    fn what_cannot_be_is_refused_by_name() {
        for (text, name) in [
            ("instance = \"a/b\"", "a/b"),
            ("capacity = 0", "capacity"),
            ("peers = { b = \"b\" }", "\"b\""),
            ("instanze = \"a\"", "instanze"),
        ] {
            let refused = parsed(text).expect_err(text);
            assert!(refused.contains(name), "{text}: {refused}");
        }
    }
}
