//! Gives each Zenoh session a place, or closes it. Zenoh asks nobody before it opens one.

use std::net::{IpAddr, SocketAddr};
use std::sync::{Arc, Mutex, PoisonError};

use fleetcal_clock::SharedClock;
use fleetcal_domain::limits;
use fleetcal_fleet::budget::Budget;
use fleetcal_fleet::{FleetHandle, SessionClosed};
use tokio::runtime::Handle;
use zenoh::Result;
use zenoh_link::Link;
use zenoh_protocol::network::NetworkMessageMut;
use zenoh_transport::multicast::TransportMulticast;
use zenoh_transport::unicast::TransportUnicast;
use zenoh_transport::{
    DummyTransportMulticastEventHandler, TransportEventHandler, TransportMulticastEventHandler,
    TransportPeer, TransportPeerEventHandler,
};

use crate::places::{Owner, Places, Shares};

/// Sessions of a router, which reports each that it has opened.
pub struct Sessions(Arc<Inner>);

struct Inner {
    /// Number of places.
    all: usize,
    places: Mutex<Places<TransportUnicast>>,
    fleet: FleetHandle,
    clock: SharedClock,
    lines: Mutex<Budget>,
    runtime: Handle,
}

/// One session; it has a place unless it is about to be closed.
struct Opened {
    sessions: Arc<Inner>,
    place: Option<u64>,
}

impl Sessions {
    /// Makes an empty set of sessions, which are closed on the runtime that this is called on.
    pub fn new(shares: Shares, fleet: FleetHandle, clock: SharedClock) -> Self {
        Self(Arc::new(Inner {
            all: shares.all,
            places: Mutex::new(Places::new(shares)),
            fleet,
            clock,
            lines: Mutex::new(Budget::per_hour(limits::ZENOH_SESSION_LINES_PER_HOUR_MAX)),
            runtime: Handle::current(),
        }))
    }
}

impl Inner {
    fn admit(&self, owner: &Owner, transport: &TransportUnicast) -> Option<u64> {
        let mut places = self.places.lock().unwrap_or_else(PoisonError::into_inner);
        let admitted = places.admit(owner.clone(), transport.clone());
        self.report(&places);
        match admitted {
            Ok((place, evicted)) => {
                if let Some(evicted) = evicted {
                    let greediest = places.greediest().map(|(owner, _)| owner.clone());
                    drop(places);
                    self.close(evicted, SessionClosed::MadeRoom, greediest.as_ref());
                }
                Some(place)
            }
            Err(reason) => {
                drop(places);
                self.close(transport.clone(), reason, Some(owner));
                None
            }
        }
    }

    fn leave(&self, place: u64) {
        let mut places = self.places.lock().unwrap_or_else(PoisonError::into_inner);
        places.leave(place);
        self.report(&places);
    }

    fn report(&self, places: &Places<TransportUnicast>) {
        self.fleet
            .peers()
            .set_open(places.taken(), places.crowded());
    }

    fn close(&self, transport: TransportUnicast, reason: SessionClosed, whose: Option<&Owner>) {
        self.fleet.peers().count_closed(reason);
        self.runtime.spawn(async move {
            // It may have ended by itself.
            drop(transport.close().await);
        });
        let mut lines = self.lines.lock().unwrap_or_else(PoisonError::into_inner);
        if lines.take(self.clock.elapsed(), 1) {
            let whose = whose.map(ToString::to_string).unwrap_or_default();
            match reason {
                SessionClosed::Share => tracing::warn!(
                    whose,
                    "too many Zenoh sessions of one name or address: a further one is closed; \
                     sessions_per_name and sessions_per_address of fleetcal.toml admit more"
                ),
                SessionClosed::Full | SessionClosed::MadeRoom => tracing::warn!(
                    most = self.all,
                    whose,
                    "all places of Zenoh sessions are taken: one is closed"
                ),
            }
        }
    }
}

impl TransportEventHandler for Sessions {
    fn new_unicast(
        &self,
        peer: TransportPeer,
        transport: TransportUnicast,
    ) -> Result<Arc<dyn TransportPeerEventHandler>> {
        let place = self.0.admit(&owner(&peer, &transport), &transport);
        Ok(Arc::new(Opened {
            sessions: Arc::clone(&self.0),
            place,
        }))
    }

    fn new_multicast(
        &self,
        _transport: TransportMulticast,
    ) -> Result<Arc<dyn TransportMulticastEventHandler>> {
        Ok(Arc::new(DummyTransportMulticastEventHandler))
    }
}

impl TransportPeerEventHandler for Opened {
    fn handle_message(&self, _message: NetworkMessageMut) -> Result<()> {
        Ok(())
    }

    fn new_link(&self, _link: Link) {}

    fn del_link(&self, _link: Link) {}

    fn closed(&self) {
        if let Some(place) = self.place {
            self.sessions.leave(place);
        }
    }

    fn as_any(&self) -> &dyn std::any::Any {
        self
    }
}

/// Returns the owner of a session: the name by which the peer authenticated, else its address.
fn owner(peer: &TransportPeer, transport: &TransportUnicast) -> Owner {
    let shown = transport.get_auth_ids().ok();
    let name = shown.as_ref().and_then(|shown| {
        let certificates = shown.link_auth_ids();
        let mut of_certificates = certificates
            .iter()
            .filter_map(|id| id.get_cert_common_name());
        let user = shown.username().map(String::as_str);
        user.or_else(|| of_certificates.next())
    });
    match (name, peer.links.first()) {
        (Some(name), _) => Owner::Name(name.to_owned()),
        (None, Some(link)) => Owner::Address(site(link.dst.address().as_str())),
        (None, None) => Owner::Address("unknown".to_owned()),
    }
}

/// Returns the address of a `HOST:PORT`; for IPv6 its network, which belongs to one site and has
/// many addresses.
fn site(host_and_port: &str) -> String {
    let Ok(address) = host_and_port.parse::<SocketAddr>() else {
        return host_and_port.to_owned();
    };
    match address.ip().to_canonical() {
        IpAddr::V4(address) => address.to_string(),
        IpAddr::V6(address) => {
            let [a, b, c, d, ..] = address.segments();
            format!("{a:x}:{b:x}:{c:x}:{d:x}::/64")
        }
    }
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeMap;
    use std::time::Duration;

    use fleetcal_clock::MockClock;
    use fleetcal_contract::TestDatabase;
    use fleetcal_estimator::EstimatorSettings;
    use fleetcal_fleet::FleetSetup;
    use fleetcal_ports::free_address;
    use serde_json::json;
    use zenoh::Session;

    use super::*;
    use crate::{LinkSetup, session};

    /// Longest wait for a condition.
    const PATIENCE: Duration = Duration::from_secs(20);
    const SHARES: Shares = Shares {
        all: 8,
        of_address: 6,
        of_name: 6,
    };

    async fn until(what: &str, done: impl Fn() -> bool) {
        let waited = tokio::time::timeout(PATIENCE, async {
            while !done() {
                tokio::time::sleep(Duration::from_millis(5)).await;
            }
        });
        assert!(waited.await.is_ok(), "waited in vain until {what}");
    }

    /// Opens a client of a router from this address.
    async fn client(port: u16, from: &str) -> Session {
        let config = json!({
            "mode": "client",
            "connect": {
                "endpoints": [format!("tcp/127.0.0.1:{port}#bind={from}:0")], "timeout_ms": 10_000,
            },
            "scouting": { "multicast": { "enabled": false }, "gossip": { "enabled": false } },
        });
        let config = zenoh::Config::from_json5(&config.to_string()).unwrap();
        zenoh::open(config).await.unwrap()
    }

    async fn is_connected(session: &Session) -> bool {
        session.info().routers_zid().await.next().is_some()
    }

    #[tokio::test(flavor = "multi_thread", worker_threads = 2)]
    async fn idle_sessions_of_one_address_keep_no_other_out_and_are_counted() {
        let clock = MockClock::at(1_763_700_000_000_000_000);
        let database = TestDatabase::new().await;
        let store = database.open(clock.clone()).await;
        let fleet = FleetHandle::start(FleetSetup {
            clock: clock.clone(),
            journal: Arc::new(store),
            estimator: EstimatorSettings::default(),
            robots: BTreeMap::new(),
            cross_tracks: BTreeMap::new(),
            checkpoints: BTreeMap::new(),
            last_heard: BTreeMap::new(),
            membership: fleetcal_cluster::Membership::alone(),
            audited: fleetcal_model::AuditId(0),
        });
        let port = free_address().port();
        let setup = LinkSetup {
            listen: vec![format!("tcp/127.0.0.1:{port}")],
            shares: SHARES,
            ..LinkSetup::default()
        };
        let sessions = |shares| Sessions::new(shares, fleet.clone(), clock);
        let router = session::open(&setup, &[], sessions).await.unwrap();

        // Zenoh connects a client again and again, as an attacker would.
        let mut idle = Vec::new();
        for _ in 0..=SHARES.of_address {
            idle.push(client(port, "127.0.0.2").await);
        }
        let closed = |reason: SessionClosed| fleet.peers().closed()[reason as usize].1;
        until("one is too many", || closed(SessionClosed::Share) > 0).await;
        assert!(fleet.peers().open() <= SHARES.of_address);

        let mut robots = Vec::new();
        for from in ["127.0.0.3", "127.0.0.4", "127.0.0.5", "127.0.0.6"] {
            robots.push(client(port, from).await);
        }
        until("idle ones made room", || {
            closed(SessionClosed::MadeRoom) >= 2
        })
        .await;
        for robot in &robots {
            assert!(is_connected(robot).await);
        }
        let crowded = fleet.peers().crowded().unwrap();
        let expected = "all 8 places of Zenoh sessions are taken, 4 of them by 127.0.0.2";
        assert_eq!(crowded, expected);
        assert_eq!(fleet.peers().open(), SHARES.all);

        for session in idle.into_iter().chain(robots) {
            session.close().await.unwrap();
        }
        until("all are gone", || fleet.peers().open() == 0).await;
        assert_eq!(fleet.peers().crowded(), None);
        session::close(router.session, router.runtime).await;
    }

    #[test]
    fn ports_of_one_address_and_addresses_of_one_site_are_one_owner() {
        assert_eq!(site("192.0.2.7:40000"), site("192.0.2.7:40001"));
        assert_eq!(site("[::ffff:192.0.2.7]:1"), "192.0.2.7");
        assert_eq!(site("[2001:db8:1:2:3::4]:1"), "2001:db8:1:2::/64");
        assert_eq!(site("[2001:db8:1:2::9]:1"), site("[2001:db8:1:2:3::4]:2"));
        assert_ne!(site("[2001:db8:1:3::9]:1"), site("[2001:db8:1:2::9]:1"));
        assert_eq!(site("/dev/ttyS0"), "/dev/ttyS0");
    }
}
