//! Description of this instance for the others, and its knowledge of them.

use std::net::SocketAddr;

use fleetcal_config::{ClusterConfig, Config};
use fleetcal_fleet::CHECKPOINT_FORMAT_READ_MAX;
use fleetcal_operations::lifecycle::Lifecycle;
use fleetcal_operations::peers::{PeerUrl, Peers, PeersError, PeersSetup};
use fleetcal_proto::signing::PublicKey;
use fleetcal_store::cluster::Joining;
use tokio_util::sync::CancellationToken;

/// Makes this process's description for joining a cluster; `None` where it is alone.
pub fn joining(config: &Config, lifecycle: &Lifecycle, http: SocketAddr) -> Option<Joining> {
    let cluster = &config.cluster;
    Some(Joining {
        instance: cluster.instance.clone()?,
        url: own_url(cluster, http),
        capacity: cluster.capacity,
        program: env!("CARGO_PKG_VERSION").to_owned(),
        checkpoint_format: i64::from(CHECKPOINT_FORMAT_READ_MAX),
        config_sha256: config.agreed_sha256(),
        signing_key: lifecycle.public_key().to_string(),
        former_signing_keys: lifecycle
            .key_changes()
            .former_keys()
            .iter()
            .map(PublicKey::to_string)
            .collect(),
    })
}

/// Makes the clients of the configured other instances; none where this process is alone. Their
/// addresses are looked up until `stop`.
///
/// # Errors
/// They may not be contacted, or the certificates by which they are authenticated cannot be used.
pub fn peers(
    config: &Config,
    http: SocketAddr,
    stop: CancellationToken,
) -> Result<Peers, PeersError> {
    let cluster = &config.cluster;
    let Some(instance) = cluster.instance.clone() else {
        return Ok(Peers::default());
    };
    let urls = cluster.peers.iter();
    let setup = PeersSetup {
        instance,
        url: peer_url(own_url(cluster, http))?,
        urls: urls
            .map(|(name, url)| Ok((name.clone(), peer_url(url.as_str().to_owned())?)))
            .collect::<Result<_, PeersError>>()?,
        root_certificates: cluster.peer_root_certificates.clone(),
        plaintext: cluster.plaintext_peers,
    };
    Peers::start(setup, stop)
}

fn peer_url(text: String) -> Result<PeerUrl, PeersError> {
    PeerUrl::try_from(text).map_err(PeersError::Url)
}

fn own_url(cluster: &ClusterConfig, http: SocketAddr) -> String {
    let url = cluster.url.as_ref();
    url.map_or_else(|| format!("http://{http}"), |url| url.as_str().to_owned())
}
