//! Addresses of the other instances, resolved from their names.

use std::collections::BTreeSet;
use std::net::IpAddr;

use fleetcal_domain::limits;
use tokio::sync::watch;
use tokio::time::MissedTickBehavior;
use tokio_util::sync::CancellationToken;

use super::url::PeerUrl;

/// Addresses of these instances, resolved periodically until `stop`.
pub(super) fn followed(
    urls: Vec<PeerUrl>,
    stop: CancellationToken,
) -> watch::Receiver<BTreeSet<IpAddr>> {
    // An address that needs no look-up counts at once.
    let literal = urls
        .iter()
        .filter_map(|url| url.host_and_port().0.parse().ok());
    let (known, followed) = watch::channel(literal.collect());
    tokio::spawn(async move {
        let mut ticks = tokio::time::interval(limits::PEER_ADDRESSES_EVERY);
        ticks.set_missed_tick_behavior(MissedTickBehavior::Delay);
        let mut found = vec![BTreeSet::new(); urls.len()];
        loop {
            tokio::select! {
                () = stop.cancelled() => return,
                () = known.closed() => return,
                _ = ticks.tick() => {}
            }
            for (url, addresses) in urls.iter().zip(&mut found) {
                look_up(url, addresses).await;
            }
            let all = found.iter().flatten().copied().collect();
            known.send_if_modified(|known| {
                let changed = *known != all;
                *known = all;
                changed
            });
        }
    });
    followed
}

/// Resolves the address of an instance; the known one stays if that fails.
async fn look_up(url: &PeerUrl, addresses: &mut BTreeSet<IpAddr>) {
    match tokio::net::lookup_host(url.host_and_port()).await {
        Ok(found) => {
            *addresses = found.map(|address| address.ip().to_canonical()).collect();
        }
        Err(error) => tracing::warn!(%url, %error, "an instance's address was not resolved"),
    }
}
