//! Gives each Zenoh session a place, or closes it. Zenoh asks nobody before it opens one.

use std::net::{IpAddr, SocketAddr};
use std::sync::{Arc, Mutex, PoisonError, Weak};

use fleetcal_clock::SharedClock;
use fleetcal_domain::limits;
use fleetcal_fleet::budget::Budget;
use fleetcal_fleet::{FleetHandle, SessionClosed};
use tokio::runtime::Handle;
use tokio::time::MissedTickBehavior;
use zenoh::Result;
use zenoh_link::Link;
use zenoh_protocol::network::NetworkMessageMut;
use zenoh_transport::multicast::TransportMulticast;
use zenoh_transport::unicast::TransportUnicast;
use zenoh_transport::{
    DummyTransportMulticastEventHandler, TransportEventHandler, TransportMulticastEventHandler,
    TransportPeer, TransportPeerEventHandler,
};

use crate::places::{Of, Owner, Places, Shares};
use crate::session_memory::{MemoryWatch, SessionMemory};

/// Sessions of a router, which reports each that it has opened.
pub struct Sessions(Arc<Inner>);

struct Inner {
    /// Number of places.
    all: usize,
    /// Number of places of sessions without a name.
    nameless: usize,
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
            nameless: shares.nameless,
            places: Mutex::new(Places::new(shares)),
            fleet,
            clock,
            lines: Mutex::new(Budget::per_hour(limits::ZENOH_SESSION_LINES_PER_HOUR_MAX)),
            runtime: Handle::current(),
        }))
    }

    /// Closes the newest sessions while the memory of the process is short.
    #[must_use]
    pub fn within(self, memory: Option<SessionMemory>) -> Self {
        if let Some(memory) = memory {
            let closing = close_while_short(memory, Arc::downgrade(&self.0));
            self.0.runtime.spawn(closing);
        }
        self
    }
}

/// Closes the sessions of one owner after another while memory is short.
///
/// Zenoh keeps a whole receiving buffer for each fragment of an unfinished message, however short,
/// and bounds the bytes of the fragments alone. A session's buffers are freed with it.
async fn close_while_short(memory: SessionMemory, sessions: Weak<Inner>) {
    let mut watch = MemoryWatch::new(memory.allowed_bytes);
    let mut ticks = tokio::time::interval(limits::ZENOH_SESSION_MEMORY_LOOK_EVERY);
    ticks.set_missed_tick_behavior(MissedTickBehavior::Delay);
    loop {
        ticks.tick().await;
        let Some(sessions) = sessions.upgrade() else {
            return;
        };
        let now = sessions.clock.elapsed();
        if (memory.resident)().is_some_and(|bytes| watch.is_to_close(now, bytes)) {
            sessions.close_newest_owner();
        }
    }
}

impl Inner {
    /// Closes all sessions of the owner of the newest.
    fn close_newest_owner(&self) {
        let mut places = self.places.lock().unwrap_or_else(PoisonError::into_inner);
        let Some((owner, closed)) = places.leave_newest_owner() else {
            return;
        };
        self.report(&places);
        drop(places);
        for transport in closed {
            self.close(transport, SessionClosed::Memory, Some(&owner));
        }
    }

    fn admit(&self, owner: &Owner, transport: &TransportUnicast) -> Option<u64> {
        let mut places = self.places.lock().unwrap_or_else(PoisonError::into_inner);
        let admitted = places.admit(owner.clone(), transport.clone());
        self.report(&places);
        match admitted {
            Ok((place, evicted)) => {
                if let Some(evicted) = evicted {
                    let greediest = places.greediest(Of::All).map(|(owner, _)| owner.clone());
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
                SessionClosed::Memory => tracing::warn!(
                    whose,
                    "memory is short: the newest Zenoh sessions are closed"
                ),
                SessionClosed::Full | SessionClosed::MadeRoom => tracing::warn!(
                    most = self.all,
                    whose,
                    without_name = self.nameless,
                    "all places of Zenoh sessions, or of those without a name, are taken: one is closed"
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
    use std::sync::atomic::{AtomicU64, Ordering};

    use fleetcal_clock::MockClock;
    use fleetcal_contract::TestDatabase;
    use fleetcal_estimator::EstimatorSettings;
    use fleetcal_fleet::FleetSetup;
    use fleetcal_patience::until;
    use fleetcal_ports::free_address;
    use serde_json::json;
    use zenoh::Session;

    use super::*;
    use crate::{LinkSetup, session};

    const SHARES: Shares = Shares {
        all: 8,
        nameless: 8,
        of_address: 6,
        of_name: 6,
    };

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

    /// Starts a fleet without robots on this database.
    async fn fleet(database: &TestDatabase, clock: &Arc<MockClock>) -> FleetHandle {
        let store = database.open(clock.clone()).await;
        FleetHandle::start(FleetSetup {
            clock: clock.clone(),
            journal: Arc::new(store),
            estimator: EstimatorSettings::default(),
            robots: BTreeMap::new(),
            cross_tracks: BTreeMap::new(),
            checkpoints: BTreeMap::new(),
            last_heard: BTreeMap::new(),
            membership: fleetcal_cluster::Membership::alone(),
            audited: fleetcal_model::AuditId(0),
        })
    }

    /// Starts a router on a port of this machine.
    async fn router(port: u16, sessions: impl FnOnce(Shares) -> Sessions) -> session::Opened {
        let setup = LinkSetup {
            listen: vec![format!("tcp/127.0.0.1:{port}")],
            shares: SHARES,
            ..LinkSetup::default()
        };
        session::open(&setup, &[], sessions).await.unwrap()
    }

    #[tokio::test(flavor = "multi_thread", worker_threads = 2)]
    async fn idle_sessions_of_one_address_keep_no_other_out_and_are_counted() {
        let clock = MockClock::at(1_763_700_000_000_000_000);
        let database = TestDatabase::new().await;
        let fleet = fleet(&database, &clock).await;
        let port = free_address().port();
        let router = router(port, |shares| Sessions::new(shares, fleet.clone(), clock)).await;

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

    /// Memory that the process of the test below pretends to hold, bytes.
    static RESIDENT: AtomicU64 = AtomicU64::new(0);

    #[tokio::test(flavor = "multi_thread", worker_threads = 2)]
    async fn the_newest_sessions_are_closed_while_memory_is_short_and_come_back() {
        let clock = MockClock::at(1_763_700_000_000_000_000);
        let database = TestDatabase::new().await;
        let fleet = fleet(&database, &clock).await;
        let port = free_address().port();
        let memory = SessionMemory {
            resident: || Some(RESIDENT.load(Ordering::Relaxed)),
            allowed_bytes: 4 << 30,
        };
        let router = router(port, |shares| {
            Sessions::new(shares, fleet.clone(), clock).within(Some(memory))
        })
        .await;
        let first = client(port, "127.0.0.2").await;
        let second = client(port, "127.0.0.3").await;
        until("both are open", || fleet.peers().open() == 2).await;
        let closed = || fleet.peers().closed()[SessionClosed::Memory as usize].1;
        assert_eq!(closed(), 0);

        RESIDENT.store(2 << 30, Ordering::Relaxed);
        until("both are closed", || closed() >= 2).await;
        RESIDENT.store(1, Ordering::Relaxed);
        until("both are back", || fleet.peers().open() == 2).await;

        first.close().await.unwrap();
        second.close().await.unwrap();
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
